use super::*;
use std::format;
use std::vec::Vec as StdVec;

/// Ray-casts circles (north, east, radius) from the origin, nose to the north, as a 90 deg sensor of 3 m would, in cm.
fn cast(circles: &[(f64, f64, f64)]) -> Scan {
    cast_wide(circles, 90.0, 3.0, 1)
}

/// The same for any field of view and range; a sector reports the nearest of a number of rays.
fn cast_wide(circles: &[(f64, f64, f64)], fov_deg: f64, range: f64, rays: usize) -> Scan {
    let fov = fov_deg.to_radians();
    let step = fov / 72.0;
    let first = -fov / 2.0 + step / 2.0;
    let mut sectors = [Sector::Clear; SECTORS_MAX];
    for (ray, index) in (0..72 * rays).map(|ray| (ray, ray / rays)) {
        let sector = &mut sectors[index];
        let azimuth = -fov / 2.0 + step / rays as f64 * (ray as f64 + 0.5);
        for (north, east, radius) in circles {
            let along = north * azimuth.cos() + east * azimuth.sin();
            let across = (north * azimuth.sin() - east * azimuth.cos()).abs();
            if across < *radius && along > 0.0 {
                let hit = ((along - (radius * radius - across * across).sqrt()) * 100.0).round() / 100.0;
                let nearer = !matches!(sector, Sector::Hit(old) if f64::from(*old) < hit);
                if hit < range && nearer {
                    *sector = Sector::Hit(hit as f32);
                }
            }
        }
    }
    Scan {
        time: Instant(0),
        turn_s: 0.0,
        first_azimuth_rad: first as f32,
        step_rad: step as f32,
        range_max_m: range as f32,
        rays: sectors.into_iter().collect(),
    }
}

fn fit(circles: &[(f64, f64, f64)]) -> StdVec<Detection> {
    super::fit(&cast(circles), &Pose::default()).unwrap().detections.into_iter().collect()
}

#[test]
fn what_a_longer_scan_left_behind_a_shorter_one_is_not_read() {
    let mut rays: rays::Rays = [Sector::Clear; 288].into_iter().collect();
    rays.resize(0);
    (0..72).for_each(|_| rays.push(Sector::Hit(2.0)));
    assert!(rays.get(71) == Sector::Hit(2.0) && rays.get(72) == Sector::Unknown && rays.get(287) == Sector::Unknown);
}

#[test]
fn a_pillar_is_found_where_it_stands_and_as_thick_as_it_is() {
    for radius in [0.1, 0.15, 0.25, 0.33, 0.5] {
        for distance in [0.9, 1.5, 2.2] {
            for side in [-0.4, 0.0, 0.3] {
                let found = fit(&[(distance, side, radius)]);
                assert_eq!(found.len(), 1, "{radius} {distance} {side}: {found:?}");
                let center = found[0].center_ned_m;
                let miss = (f64::from(center.north) - distance).hypot(f64::from(center.east) - side);
                let allowed = 0.03 + 0.02 * distance;
                assert!(miss < allowed, "{radius} {distance} {side}: {found:?}");
                assert!((f64::from(found[0].radius_m) - radius).abs() < allowed, "{radius} {distance}: {found:?}");
                // Its near face, the part that a vehicle would hit, is accurate to a few centimetres.
                let face = f64::from(center.norm() - found[0].radius_m);
                let truth = (distance.hypot(side)) - radius;
                assert!((face - truth).abs() < 0.03, "{radius} {distance} {side}: face {face} {truth}");
            }
        }
    }
}

#[test]
fn wide_sectors_make_a_pillar_no_wider() {
    let mut pillars = 0;
    for (fov_deg, rays) in [(120.0, 2), (270.0, 3), (360.0, 4)] {
        for (distance, radius) in [(1.0, 0.15), (1.5, 0.1), (1.5, 0.3), (2.5, 0.3), (3.5, 0.2)] {
            let mut wider = StdVec::new();
            for turn in 0..40 {
                let azimuth = (f64::from(turn) * 0.53 - 10.0).to_radians();
                let pillar = (distance * azimuth.cos(), distance * azimuth.sin(), radius);
                let scan = cast_wide(&[pillar], fov_deg, 4.0, rays);
                let found = super::fit(&scan, &Pose::default()).unwrap().detections;
                wider.extend(found.iter().filter(|d| d.kind == Kind::Pillar).map(|d| f64::from(d.radius_m) - radius));
            }
            let case = format!("{fov_deg} deg, {distance} m, radius {radius} m");
            pillars += wider.len();
            if wider.len() < 10 {
                continue;
            }
            let mean = wider.iter().sum::<f64>() / wider.len() as f64;
            let least = wider.iter().copied().fold(f64::INFINITY, f64::min);
            let half_sector = 0.5 * distance * (fov_deg / 72.0_f64).to_radians();
            assert!(mean.abs() < 0.02, "{case}: {mean} m wider on average");
            assert!(least > -half_sector - 0.01, "{case}: {least}");
        }
    }
    assert!(pillars > 500, "a pillar in {pillars} of 600 looks");
}

#[test]
fn two_pillars_side_by_side_are_two_even_when_they_touch() {
    assert_eq!(fit(&[(1.5, -0.4, 0.2), (1.6, 0.4, 0.2)]).len(), 2);
    let touching = fit(&[(1.5, -0.25, 0.25), (1.5, 0.25, 0.25)]);
    assert!(touching.len() >= 2, "{touching:?}");
}

#[test]
fn a_wall_becomes_a_chain_of_circles_that_leaves_no_gap_to_slip_through() {
    // A circle of 30 m radius is a wall at this range.
    let found = fit(&[(31.5, 0.0, 30.0)]);
    assert!(found.len() >= 3, "{found:?}");
    for azimuth in (-40..=40).map(|a| f64::from(a).to_radians()) {
        let point = Horizontal { north: 1.5, east: (1.5 * azimuth.tan()) as f32 };
        let nearest =
            found.iter().map(|d| d.center_ned_m.minus(point).norm() - d.radius_m).fold(f32::INFINITY, f32::min);
        assert!(nearest < 0.15, "open at {azimuth}: {nearest}");
    }
}

#[test]
fn the_pose_turns_and_shifts_what_is_seen() {
    let scan = cast(&[(1.5, 0.0, 0.25)]);
    let pose = Pose { position_ned_m: Horizontal { north: 10.0, east: -4.0 }, yaw_rad: core::f32::consts::FRAC_PI_2 };
    let found = super::fit(&scan, &pose).unwrap().detections;
    assert_eq!(found.len(), 1);
    assert!((found[0].center_ned_m.north - 10.0).abs() < 0.05, "{found:?}");
    assert!((found[0].center_ned_m.east + 2.5).abs() < 0.05, "{found:?}");
}

#[test]
fn garbage_in_sectors_is_refused() {
    for value in [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e30] {
        let mut scan = cast(&[(2.0, 0.0, 0.3)]);
        let good = super::fit(&scan, &Pose::default()).unwrap();
        scan.rays.set(0, Sector::Hit(value));
        let one = super::fit(&scan, &Pose::default()).unwrap();
        assert_eq!((one.refused, one.points_m.len()), (1, good.points_m.len()), "{value}");
        scan.rays = [Sector::Hit(value); SECTORS_MAX].into_iter().collect();
        assert_eq!(super::fit(&scan, &Pose::default()), Err(Refusal::Absurd), "{value}");
    }
}

#[test]
fn a_hit_that_touches_the_sensor_yields_finite_circles() {
    let mut scan = cast(&[]);
    scan.rays = [Sector::Hit(1e-20); SECTORS_MAX].into_iter().collect();
    for detection in super::fit(&scan, &Pose::default()).unwrap().detections {
        assert!(detection.center_ned_m.is_finite() && detection.radius_m.is_finite());
    }
}

#[test]
fn what_is_no_sensor_or_looks_from_nowhere_is_refused() {
    let good = Scan { rays: [Sector::Hit(1.0); SECTORS_MAX].into_iter().collect(), ..cast(&[]) };
    for bad in [
        Scan { step_rad: 0.0, ..good.clone() },
        Scan { step_rad: f32::NAN, ..good.clone() },
        Scan { first_azimuth_rad: f32::INFINITY, ..good.clone() },
        Scan { range_max_m: -1.0, ..good.clone() },
        Scan { range_max_m: f32::NAN, ..good.clone() },
    ] {
        assert_eq!(super::fit(&bad, &Pose::default()), Err(Refusal::Geometry), "{bad:?}");
    }
    let points = Points { points_m: [Horizontal::default()].into_iter().collect(), ..Points::default() };
    let fit_points = |pose: &Pose| fit_points_into(&mut Segmentation::default(), &points, pose);
    assert_eq!(fit_points(&Pose::default()), Err(Refusal::Absurd));
    let nowhere = Horizontal { north: f32::NAN, east: 0.0 };
    for pose in [Pose { position_ned_m: nowhere, ..Pose::default() }, Pose { yaw_rad: f32::NAN, ..Pose::default() }] {
        assert_eq!(super::fit(&good, &pose), Err(Refusal::NoOwnship));
        assert_eq!(fit_points(&pose), Err(Refusal::NoOwnship));
    }
}

#[test]
fn the_hits_of_a_turn_during_which_the_vehicle_yawed_lie_where_their_rays_point() {
    // A gap in the turn, from which it is read; the vehicle yaws along, or against it.
    let rays = (0..360).map(|ray| if (100..110).contains(&ray) { Sector::Clear } else { Sector::Hit(2.0) }).collect();
    let step_rad = core::f32::consts::TAU / 360.0;
    let scan = Scan { time: Instant(0), turn_s: 0.1, first_azimuth_rad: 0.3, step_rad, range_max_m: 5.0, rays };
    for yawed_rad in [0.0_f32, 0.12, -0.12] {
        let scan = scan.clone().straightened(yawed_rad).unwrap();
        let mut hits = heapless::Vec::new();
        scan.hits_into(&mut hits, 0.0, Horizontal::default());
        assert!((340..=350).contains(&hits.len()), "{}", hits.len());
        for hit in &hits {
            let off =
                wrap_pi(hit.bearing_rad() - scan.first_azimuth_rad).rem_euclid(core::f32::consts::TAU) / scan.step_rad;
            assert!((off - off.round()).abs() < 0.01, "{yawed_rad}: {off}");
        }
    }
}

#[test]
fn a_scan_lasts_as_long_as_its_sensor_takes_and_was_measured_before_it_was_sent() {
    let told = |turn_s: f32| Scan { time: Instant(1_000_000), turn_s, ..cast(&[]) };
    for (told_s, takes_s, time_us, turn_s) in [
        (0.0, 0.0, 1_000_000, 0.0),
        (0.0, 0.1, 950_000, 0.1),
        // The last ray came first.
        (0.0, -0.1, 950_000, -0.1),
        // Its messages came in a burst of 20 ms when it was whole.
        (0.02, 0.1, 960_000, 0.1),
        // They came while it turned.
        (0.08, 0.1, 1_000_000, 0.08),
    ] {
        let scan = told(told_s).lasting(takes_s);
        assert_eq!(scan.turn_s, turn_s, "{told_s} {takes_s}");
        assert!(scan.time.0.abs_diff(time_us) <= 1, "{told_s} {takes_s}: {:?}", scan.time);
    }
    let backwards = told(-0.1);
    assert!(backwards.after_s(0.0) > 0.04 && backwards.after_s(71.0) < -0.04);
    // The nose turns to the right: what the last ray saw, before, lay farther left of the nose in the middle.
    let straight = backwards.clone().straightened(0.1).unwrap();
    let last = (backwards.rays.len() - 1) as f32;
    let at = |scan: &Scan, ray: f32| scan.first_azimuth_rad + ray * scan.step_rad;
    assert!((at(&straight, 0.0) - at(&backwards, 0.0) - 0.05).abs() < 1e-3);
    assert!((at(&straight, last) - at(&backwards, last) + 0.05).abs() < 1e-3);
}
