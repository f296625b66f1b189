//! Lines of reflection as mirrors, one after another: eq. 9 of the mmWave paper without its system of equations.
//!
//! A ray off the lines `1..n`, in this order from the source, goes straight from the source's image in line 1,
//! mirrored in line 2, and so on. Conversely, the vehicle mirrored in line `n`, then `n - 1`, down to 1, receives the
//! source directly. That is exact, has no singular walls and costs a few products per line.

use super::{Degenerate, Sighting};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::mapping::walls::Wall;

/// Least sine of the angle between ray and line.
const GRAZING: f32 = 1e-3;
/// Nearer to a line the vehicle counts as on it.
const ON_LINE_M: f32 = 1e-3;

/// A sighting off known lines, in the order from the source, converted to a direct sighting of the source.
///
/// The lines are taken as unbounded: near the ends of a wall noise moves the ray off it, not the reflection.
///
/// # Errors
/// Where the ray meets no line.
#[inline]
pub fn fold(lines: &[Wall], sighting: &Sighting) -> Result<Sighting, Degenerate> {
    let mut folded = *sighting;
    for line in lines.iter().rev() {
        if !line.is_valid() {
            return Err(Degenerate::NoLine);
        }
        let (distance_m, approach) = (line.distance_m(folded.place_ned_m), line.normal_ned.dot(folded.direction_ned));
        if libm::fabsf(distance_m) < ON_LINE_M {
            return Err(Degenerate::OnLine);
        }
        // The ray comes from the line when it leads there.
        let towards = if distance_m > 0.0 { -approach } else { approach };
        if !(towards > GRAZING) {
            return Err(Degenerate::NoReflection);
        }
        folded.place_ned_m = line.mirror(folded.place_ned_m);
        folded.direction_ned = line.mirror_direction(folded.direction_ned);
    }
    Ok(folded)
}

/// The points of reflection `p_r,1..n` between a source and a vehicle, within the lines' extents: a system of equations in
/// the paper (9), here the crossings of straight rays.
///
/// # Errors
/// If there is no such ray.
pub fn points<const N: usize>(
    lines: &[Wall; N],
    source_ned_m: Horizontal,
    vehicle_ned_m: Horizontal,
) -> Result<[Horizontal; N], Degenerate> {
    let mut images = [source_ned_m; N];
    let mut image = source_ned_m;
    for (line, kept) in lines.iter().zip(&mut images) {
        if !line.is_valid() {
            return Err(Degenerate::NoLine);
        }
        image = line.mirror(image);
        *kept = image;
    }
    let mut points = [Horizontal::default(); N];
    let mut from = vehicle_ned_m;
    for ((line, image), point) in lines.iter().zip(&images).zip(&mut points).rev() {
        if libm::fabsf(line.distance_m(from)) < ON_LINE_M {
            return Err(Degenerate::OnLine);
        }
        let to = image.minus(from);
        let norm = to.norm();
        let direction = to.times(1.0 / norm);
        match line.range_along_m(from, direction, 0.0) {
            Some(range_m) if range_m < norm => from = from.plus(direction.times(range_m)),
            _ => return Err(Degenerate::NoReflection),
        }
        *point = from;
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::base::rng::Rng;

    fn place(rng: &mut Rng) -> Horizontal {
        Horizontal { north: 40.0 * rng.uniform() - 20.0, east: 40.0 * rng.uniform() - 20.0 }
    }

    /// Both sides of eq. 9 at one point.
    fn sides(line: &Wall, before: Horizontal, at: Horizontal, after: Horizontal) -> [f32; 2] {
        let u = line.along_ned();
        let (back, on) = (at.minus(before), at.minus(after));
        [back.dot(u) / back.norm(), -on.dot(u) / on.norm()]
    }

    fn chains<const N: usize>(seed: u64) {
        let mut rng = Rng::new(seed, 23);
        let mut found = 0;
        for case in 0..4000 {
            let lines: [Wall; N] = core::array::from_fn(|k| {
                let (a, mut b) = (place(&mut rng), place(&mut rng));
                // Every wall is vertical in the paper's frame now and then.
                if case % 3 == k % 3 {
                    b.east = a.east;
                }
                let line = Wall::between(a, b).unwrap();
                Wall { from_m: line.from_m - 60.0, to_m: line.to_m + 60.0, ..line }
            });
            let (source, vehicle) = (place(&mut rng), place(&mut rng));
            let Ok(points) = points(&lines, source, vehicle) else { continue };
            let near = |a: Horizontal, b: Horizontal| a.minus(b).norm() < 0.3;
            let ends = points.windows(2).any(|pair| near(pair[0], pair[1]));
            if ends || near(points[0], source) || near(points[N - 1], vehicle) {
                continue;
            }
            found += 1;
            for k in 0..N {
                let before = if k == 0 { source } else { points[k - 1] };
                let after = if k == N - 1 { vehicle } else { points[k + 1] };
                assert!(lines[k].distance_m(points[k]).abs() < 1e-3);
                let [left, right] = sides(&lines[k], before, points[k], after);
                assert!((left - right).abs() < 2e-3, "{case} {k}: {left} {right}");
                // And it is a reflection: both rays are on one side of the line.
                assert!(lines[k].distance_m(before) * lines[k].distance_m(after) > 0.0);
            }
            let to = points[N - 1].minus(vehicle);
            let heard = Sighting {
                place_ned_m: vehicle,
                direction_ned: to.times(1.0 / to.norm()),
                sigma_rad: 0.05,
                since_s: 0.1,
            };
            let Ok(folded) = fold(&lines, &heard) else { continue };
            let direct = source.minus(folded.place_ned_m);
            let miss = direct.times(1.0 / direct.norm()).minus(folded.direction_ned).norm();
            assert!(miss < 2e-3, "{case}: {miss}");
            assert_eq!((folded.sigma_rad, folded.since_s), (0.05, 0.1));
        }
        assert!(found > 40, "{found}");
    }

    #[test]
    fn chains_of_one_to_four_reflections_obey_eq_9_and_fold_into_a_direct_ray() {
        chains::<1>(1);
        chains::<2>(2);
        chains::<3>(3);
        chains::<4>(4);
    }

    #[test]
    fn rays_that_lead_to_no_line_are_told() {
        let wall = Wall::between(Horizontal { north: 5.0, east: -9.0 }, Horizontal { north: 5.0, east: 9.0 }).unwrap();
        let from = |north: f32, bearing_rad: f32| Sighting {
            place_ned_m: Horizontal { north, east: 0.0 },
            direction_ned: Horizontal::from_bearing(bearing_rad),
            sigma_rad: 0.05,
            since_s: 0.1,
        };
        assert!(fold(&[wall], &from(0.0, 0.3)).is_ok());
        assert_eq!(fold(&[wall], &from(5.0, 0.3)), Err(Degenerate::OnLine));
        for along in [core::f32::consts::FRAC_PI_2, -core::f32::consts::FRAC_PI_2, 3.0] {
            assert_eq!(fold(&[wall], &from(0.0, along)), Err(Degenerate::NoReflection), "{along}");
        }
        let none = Wall::default();
        assert_eq!(fold(&[none], &from(0.0, 0.3)), Err(Degenerate::NoLine));
        let nan = Wall { offset_m: f32::NAN, ..wall };
        assert_eq!(fold(&[nan], &from(0.0, 0.3)), Err(Degenerate::NoLine));
        // A source on the far side, or beyond the end of the wall, is not reflected.
        let source = |north: f32, east: f32| points(&[wall], Horizontal { north, east }, Horizontal::default());
        assert_eq!(source(8.0, 3.0), Err(Degenerate::NoReflection));
        assert_eq!(source(0.0, 30.0), Err(Degenerate::NoReflection));
        assert!(source(0.0, 3.0).is_ok());
        assert_eq!(
            points(&[wall], Horizontal::default(), Horizontal { north: 5.0, east: 1.0 }),
            Err(Degenerate::OnLine)
        );
    }
}
