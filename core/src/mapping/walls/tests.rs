use super::*;
use crate::base::rng::Rng;
use std::vec::Vec;

fn at(north: f32, east: f32) -> Horizontal {
    Horizontal { north, east }
}

fn found(points: &[Horizontal]) -> Vec<Wall> {
    Config::default().build().unwrap().find(&mut Workspace::default(), points).iter().copied().collect()
}

fn wall(rng: &mut Rng, from: Horizontal, to: Horizontal, step_m: f32, sigma_m: f32) -> Vec<Horizontal> {
    let line = Wall::between(from, to).unwrap();
    let count = (length_m(&line) / step_m) as usize + 1;
    let place = |k: usize| from.plus(to.minus(from).times((k as f32 + 0.5) / count as f32));
    (0..count).map(|k| place(k).plus(line.normal_ned.times(sigma_m * rng.gaussian()))).collect()
}

/// Whether a line is a wall: both ends within `near_m` of it, and as long but for `short_m`.
fn is_wall(line: &Wall, truth: &Wall, near_m: f32, short_m: f32) -> bool {
    let ends = line.ends_ned_m().map(|end| truth.distance_m(end).abs());
    let along = line.ends_ned_m().map(|end| truth.along_ned().dot(end));
    let (from_m, to_m) = if along[0] < along[1] { (along[0], along[1]) } else { (along[1], along[0]) };
    ends.iter().all(|end| *end < near_m)
        && (from_m - truth.from_m).abs() < short_m
        && (to_m - truth.to_m).abs() < short_m
}

fn assert_same_walls(lines: &[Wall], truths: &[[f32; 4]], near_m: f32, short_m: f32) {
    assert_eq!(lines.len(), truths.len(), "{lines:?}");
    for [a, b, c, d] in truths {
        let truth = Wall::between(at(*a, *b), at(*c, *d)).unwrap();
        assert!(lines.iter().any(|line| is_wall(line, &truth, near_m, short_m)), "{truth:?} is not in {lines:?}");
    }
}

#[test]
fn remembered_circles_count_with_the_place_that_faces_the_vehicle_in_the_order_of_their_bearings() {
    let circle =
        |north: f32, east: f32, radius_m: f32| Disc { center_ned_m: at(north, east), radius_m, ..Disc::default() };
    let here = at(1.0, 1.0);
    let mover = Disc { moves: true, ..circle(3.0, 3.0, 0.2) };
    let circles = [
        circle(1.0, 3.0, 0.5),
        circle(4.0, 1.0, 1.0),
        circle(1.0, -2.0, 0.25),
        mover,
        circle(f32::NAN, 0.0, 0.1),
        circle(1.1, 0.95, 0.3),
        circle(-1.0, 1.5, 0.0),
    ];
    let points = points_of(&circles, here);
    let wanted = [at(1.0, -1.75), at(1.1, 0.95), at(3.0, 1.0), at(1.0, 2.5), at(-1.0, 1.5)];
    assert_eq!(points.len(), wanted.len());
    for (point, wanted) in points.iter().zip(wanted) {
        assert!(point.minus(wanted).norm() < 1e-6, "{point:?}");
    }
}

#[test]
fn a_configuration_that_contradicts_itself_is_refused() {
    let refused = |config: Config| config.build().unwrap_err().field;
    assert_eq!(refused(Config { gap_m: f32::NAN, ..Config::default() }), "walls.gap_m");
}

#[test]
fn the_workspace_is_small() {
    assert!(core::mem::size_of::<Workspace>() <= 12 * POINTS_MAX, "{}", core::mem::size_of::<Workspace>());
}

#[test]
fn a_long_wall_is_found_beside_many_short_rows() {
    for rows in [0, 15, 16, 30] {
        let short = (0..rows).flat_map(|row| (0..3).map(move |post| at(-10.0, 4.0 * row as f32 + 0.5 * post as f32)));
        let points: Vec<_> = short.chain((0..30).map(|post| at(20.0 + 0.5 * post as f32, 0.0))).collect();
        let found = found(&points);
        assert!(matches!(&found[..], [wall] if length_m(wall) > 14.0), "{rows}: {found:?}");
    }
}

#[test]
fn points_that_are_no_numbers_or_absurd_change_nothing() {
    let points: Vec<_> = (0..20).map(|k| at(0.5 * k as f32, 3.0)).collect();
    let wanted = found(&points);
    assert_eq!(wanted.len(), 1);
    let mut with = Vec::new();
    let absurd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e6];
    for (k, point) in points.iter().enumerate() {
        with.push(if k % 2 == 0 { at(absurd[k % 5], 1.0) } else { at(1.0, absurd[k % 5]) });
        with.push(*point);
    }
    assert_eq!(found(&with), wanted);
    assert_eq!(found(&[at(f32::NAN, f32::NAN); 200]), []);
}

#[test]
fn pillars_are_no_walls_be_they_points_or_round() {
    let mut rng = Rng::new(22, 1);
    for case in 0..300 {
        // Pillars apart by more than a gap, as points, discs or rings.
        let mut centres: Vec<Horizontal> = Vec::new();
        for _ in 0..40 {
            let centre = at(12.0 * rng.uniform(), 12.0 * rng.uniform());
            if centres.len() < 12 && centres.iter().all(|c| c.minus(centre).norm() > 2.6) {
                centres.push(centre);
            }
        }
        let mut points = Vec::new();
        for centre in centres {
            let (count, radius_m) = if case % 3 == 0 { (1, 0.0) } else { (10, 0.2 + 0.4 * rng.uniform()) };
            for k in 0..count {
                let bearing_rad = k as f32 * core::f32::consts::TAU / 10.0;
                let away_m = if case % 3 == 1 { radius_m } else { radius_m * sqrt(rng.uniform()) };
                points.push(centre.plus(Horizontal::from_bearing(bearing_rad).times(away_m)));
            }
        }
        assert_eq!(found(&points), [], "{case}");
    }
}

/// What came of many random rooms.
#[derive(Debug, Default)]
struct Count {
    walls: u32,
    found: u32,
    wrong: u32,
    wrong_without_walls: u32,
}

/// Skewed rooms of up to four walls with up to nine pillars inside, points 0.25 to 1 m apart, noise 0.02 to 0.07 m.
fn random_rooms() -> Count {
    let mut count = Count::default();
    for seed in 0..1000 {
        let mut rng = Rng::new(seed, 3);
        let sides = (seed % 5) as usize;
        let (a, b) = (3.0 + 6.0 * rng.uniform(), 3.0 + 6.0 * rng.uniform());
        let turned = Horizontal::from_bearing(core::f32::consts::TAU * rng.uniform());
        let middle = at(100.0 * rng.uniform(), 100.0 * rng.uniform());
        let skew = 0.6 * (rng.uniform() - 0.5);
        let to_ned = |north: f32, east: f32| {
            let along = turned.times(north + skew * east);
            middle.plus(along).plus(at(-turned.east, turned.north).times(east))
        };
        let corners = [(-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)];
        let corners = corners.map(|(north, east)| to_ned(a * north, b * east));
        let (step_m, sigma_m) = (0.25 + 0.75 * rng.uniform(), 0.02 + 0.05 * rng.uniform());
        let mut points = Vec::new();
        for side in corners.windows(2).take(sides) {
            points.extend(wall(&mut rng, side[0], side[1], step_m, sigma_m));
        }
        let mut pillars: Vec<Horizontal> = Vec::new();
        for _ in 0..20 {
            let pillar = to_ned(0.8 * a * (rng.uniform() - 0.5), 0.8 * b * (rng.uniform() - 0.5));
            if pillars.len() < (seed / 5 % 10) as usize && pillars.iter().all(|p| p.minus(pillar).norm() > 0.8) {
                pillars.push(pillar);
            }
        }
        points.extend(pillars);
        assert!(points.len() <= POINTS_MAX);
        points.sort_by(|a, b| a.minus(middle).bearing_rad().total_cmp(&b.minus(middle).bearing_rad()));
        let lines = found(&points);
        let mut right = 0;
        for side in corners.windows(2).take(sides) {
            let truth = Wall::between(side[0], side[1]).unwrap();
            let same = |line: &&Wall| {
                line.normal_ned.dot(truth.along_ned()).abs() < 0.06
                    && line.ends_ned_m().iter().all(|end| truth.distance_m(*end).abs() < 0.15)
                    && length_m(line) > 0.6 * length_m(&truth)
            };
            right += u32::from(lines.iter().filter(same).count() == 1);
        }
        count.walls += sides as u32;
        count.found += right;
        count.wrong += (lines.len() as u32).saturating_sub(right);
        if sides == 0 {
            count.wrong_without_walls += lines.len() as u32;
        }
    }
    count
}

#[test]
fn more_than_nine_of_ten_walls_of_random_rooms_are_found_and_none_where_there_are_none() {
    let count = random_rooms();
    assert_eq!((count.walls, count.wrong_without_walls), (2000, 0));
    assert!(count.found >= 1850 && count.wrong <= 75, "{count:?}");
}

#[test]
fn a_hundred_and_twenty_eight_random_points_stay_bounded_and_finite() {
    let mut rng = Rng::new(23, 1);
    for case in 0..400 {
        let scale = [0.0, 1e-4, 1.0, 10.0, 300.0, 9e4][case % 6];
        let points: Vec<_> = (0..150 + case % 3)
            .map(|k| match case % 5 {
                0 => at(scale * rng.gaussian(), scale * rng.gaussian()),
                1 => at(scale * (k % 3) as f32, scale * rng.uniform()),
                2 => at(scale, scale * k as f32 / 128.0),
                3 => at((k % 12) as f32, (k / 12) as f32),
                _ => at(scale * rng.uniform(), -scale),
            })
            .collect();
        for line in found(&points) {
            let [from, to] = line.ends_ned_m();
            assert!(from.is_finite() && to.is_finite() && (line.normal_ned.norm() - 1.0).abs() < 1e-4, "{line:?}");
            assert!(line.to_m > line.from_m, "{line:?}");
        }
    }
}

#[test]
fn a_wide_door_makes_two_walls_of_one_and_a_missing_point_does_not() {
    let row = |skipped: core::ops::Range<usize>| -> Vec<_> {
        (0..20).filter(|k| !skipped.contains(k)).map(|k| at(0.5 * k as f32, 3.0)).collect()
    };
    assert_same_walls(&found(&row(9..10)), &[[0.0, 3.0, 9.5, 3.0]], 1e-3, 1e-3);
    assert_same_walls(&found(&row(8..12)), &[[0.0, 3.0, 3.5, 3.0], [6.0, 3.0, 9.5, 3.0]], 1e-3, 1e-3);
}

#[test]
fn the_two_faces_of_a_corridor_stay_two_walls_and_the_longest_come_first() {
    let mut points: Vec<_> = (0..16).map(|k| at(0.5 * k as f32, 0.0)).collect();
    points.extend((0..12).map(|k| at(0.5 * k as f32, 0.8)));
    let lines = found(&points);
    assert_same_walls(&lines, &[[0.0, 0.0, 7.5, 0.0], [0.0, 0.8, 5.5, 0.8]], 1e-3, 1e-3);
    assert!(length_m(&lines[0]) > length_m(&lines[1]));
}

#[test]
fn the_face_of_a_wall_is_found_behind_a_chain_of_circles() {
    let circle = |north: f32, east: f32| Disc { center_ned_m: at(north, east), radius_m: 0.1, ..Disc::default() };
    // A chain of small circles behind the face of a wall, as the map has it.
    let chain: Vec<_> = (0..20).map(|k| circle(5.1, -5.0 + 0.5 * k as f32)).collect();
    assert_same_walls(&found(&points_of(&chain, at(1.0, 0.0))), &[[5.02, -5.0, 5.02, 4.5]], 0.05, 0.1);
}
