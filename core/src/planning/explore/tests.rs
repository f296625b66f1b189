use super::*;
use std::vec::Vec;

const VEHICLE_M: f32 = 0.15;
const DT_S: f32 = 0.5;
const STEP_M: f32 = 0.5;

fn at(north: f32, east: f32) -> Horizontal {
    Horizontal { north, east }
}

fn seconds(s: f32) -> Instant {
    Instant((s * 1e6) as u64)
}

/// A wall as the map stores it: small circles in a row.
fn wall(from: Horizontal, to: Horizontal) -> Vec<Disc> {
    let count = (to.minus(from).norm() / 0.3) as usize + 1;
    let place = |k: usize| from.plus(to.minus(from).times(k as f32 / count as f32));
    (0..=count).map(|k| Disc { center_ned_m: place(k), radius_m: 0.1, ..Disc::default() }).collect()
}

fn square(half_m: f32) -> Vec<Disc> {
    let corners = [at(-half_m, -half_m), at(-half_m, half_m), at(half_m, half_m), at(half_m, -half_m)];
    (0..4).flat_map(|k| wall(corners[k], corners[(k + 1) % 4])).collect()
}

/// Paths for a disc on a fine grid around the origin, by breadth-first search.
struct Ways {
    from: Vec<Option<usize>>,
}

const FINE_M: f32 = 0.25;
const FINE: i32 = 128;

fn fine(place: Horizontal) -> (i32, i32) {
    ((place.north / FINE_M).round() as i32 + FINE / 2, (place.east / FINE_M).round() as i32 + FINE / 2)
}

fn coarse(index: usize) -> Horizontal {
    let (row, column) = (index as i32 / FINE, index as i32 % FINE);
    at((row - FINE / 2) as f32 * FINE_M, (column - FINE / 2) as f32 * FINE_M)
}

impl Ways {
    /// The paths from a position, among circles.
    fn new(here: Horizontal, circles: &[Disc]) -> Self {
        let mut taken = std::vec![false; (FINE * FINE) as usize];
        for circle in circles {
            let reach_m = circle.radius_m + VEHICLE_M;
            let (row, column) = fine(circle.center_ned_m);
            let cells = (reach_m / FINE_M) as i32 + 1;
            for (r, c) in (-cells..=cells).flat_map(|r| (-cells..=cells).map(move |c| (row + r, column + c))) {
                let index = (r * FINE + c) as usize;
                taken[index] |= circle.center_ned_m.minus(coarse(index)).norm() <= reach_m;
            }
        }
        let mut from = std::vec![None; (FINE * FINE) as usize];
        let (row, column) = fine(here);
        let begin = (row * FINE + column) as usize;
        from[begin] = Some(begin);
        let mut queue = std::collections::VecDeque::from([begin]);
        while let Some(index) = queue.pop_front() {
            let (row, column) = (index as i32 / FINE, index as i32 % FINE);
            for (r, c) in [(row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)] {
                let next = (r * FINE + c) as usize;
                if (0..FINE).contains(&r) && (0..FINE).contains(&c) && from[next].is_none() && !taken[next] {
                    from[next] = Some(index);
                    queue.push_back(next);
                }
            }
        }
        Self { from }
    }

    /// The next position, one step along the path.
    fn towards(&self, target: Horizontal) -> Option<Horizontal> {
        let (row, column) = fine(target);
        let mut index = (row * FINE + column) as usize;
        let mut path = std::vec![index];
        while self.from[index]? != index {
            index = self.from[index]?;
            path.push(index);
        }
        path.reverse();
        path.get(((STEP_M / FINE_M) as usize).min(path.len() - 1)).map(|index| coarse(*index))
    }
}

/// Where a vehicle flew, what it saw and where it was sent.
struct Flight {
    poses: Vec<Pose>,
    targets: Vec<Horizontal>,
    blocked: usize,
    outcome: Explored,
    state: State,
}

const AROUND: RangeSensor = RangeSensor { range_m: 4.0, fov_rad: TAU, ..RangeSensor::DEFAULT };
const AHEAD: RangeSensor = RangeSensor { range_m: 4.0, fov_rad: 1.6, ..RangeSensor::DEFAULT };
const CLEARANCE_M: f32 = 0.2;

fn around(range_m: f32) -> RangeSensor {
    RangeSensor { range_m, fov_rad: TAU, ..RangeSensor::DEFAULT }
}

/// A vehicle that flies where it is sent, on paths that it knows, and knows the circles that it has been near.
fn fly(config: &Config, sensor: &RangeSensor, world: &[Disc], begins: Horizontal) -> Flight {
    let explorer = config.build(CLEARANCE_M, &Fence::DEFAULT).unwrap();
    let mut pose = Pose { position_ned_m: begins, yaw_rad: 0.3 };
    let mut flight =
        Flight { poses: Vec::new(), targets: Vec::new(), blocked: 0, outcome: Explored::NoPose, state: State::new() };
    let mut known: Vec<Disc> = Vec::new();
    let mut unknown = world.to_vec();
    for step in 0..10_000 {
        let here = pose.position_ned_m;
        unknown.retain(|circle| {
            let is_seen = circle.center_ned_m.minus(here).norm() < sensor.range_m + 1.0;
            if is_seen {
                known.push(*circle);
            }
            !is_seen
        });
        let now = seconds(step as f32 * DT_S);
        flight.poses.push(pose);
        flight.outcome = explorer.step(&mut flight.state, now, &pose, sensor, known.iter());
        let Explored::Target(target) = flight.outcome else { return flight };
        if flight.targets.last() != Some(&target) {
            flight.targets.push(target);
        }
        match Ways::new(here, &known).towards(target) {
            Some(next) if next != here => {
                pose = Pose { position_ned_m: next, yaw_rad: next.minus(here).bearing_rad() };
            }
            Some(_) => {}
            None => {
                flight.state.blocked();
                flight.blocked += 1;
            }
        }
    }
    flight
}

/// Whether a place was ever in the sensor's view with no obstacle in between, in the true world.
fn was_seen(place: Horizontal, flight: &Flight, sensor: &RangeSensor, world: &[Disc]) -> bool {
    flight.poses.iter().any(|pose| {
        let away = place.minus(pose.position_ned_m);
        let off_rad = wrap_pi(away.bearing_rad() - pose.yaw_rad).abs();
        let hidden =
            |c: &Disc| Horizontal::distance_to_segment(c.center_ned_m, pose.position_ned_m, place) < c.radius_m;
        away.norm() < 0.75
            || (away.norm() <= sensor.range_m && off_rad <= 0.5 * sensor.fov_rad && !world.iter().any(hidden))
    })
}

/// Share of the places of a square, half a metre apart, that were seen.
fn seen_share(half_m: f32, flight: &Flight, sensor: &RangeSensor, world: &[Disc]) -> f32 {
    let count = (2.0 * half_m / 0.5) as i32;
    let (mut seen, mut all) = (0.0, 0.0);
    for k in 1..count * count {
        let place = at((k / count) as f32 * 0.5 - half_m, (k % count) as f32 * 0.5 - half_m);
        if world.iter().all(|c| c.center_ned_m.minus(place).norm() > c.radius_m + 0.2) {
            all += 1.0;
            seen += f32::from(u8::from(was_seen(place, flight, sensor, world)));
        }
    }
    seen / all
}

#[test]
fn an_empty_square_is_looked_at_from_end_to_end() {
    let world = square(7.3);
    for sensor in [AROUND, AHEAD] {
        let flight = fly(&Config::default(), &sensor, &world, at(-2.0, 3.0));
        assert_eq!(flight.outcome, Explored::Exhausted, "{} targets", flight.targets.len());
        let share = seen_share(7.0, &flight, &sensor, &world);
        assert!(share > 0.97, "{share}");
    }
}

#[test]
fn the_room_behind_the_door_is_found_wherever_the_door_is() {
    for k in 0..8 {
        let door = -4.9 + 1.37 * k as f32;
        let mut world = square(7.3);
        world.extend(wall(at(-7.3, 1.2), at(door - 0.6, 1.2)));
        world.extend(wall(at(door + 0.6, 1.2), at(7.3, 1.2)));
        for sensor in [AROUND, AHEAD] {
            let flight = fly(&Config::default(), &sensor, &world, at(1.0, -3.0));
            let share = seen_share(7.0, &flight, &sensor, &world);
            let outcome = flight.outcome;
            assert_eq!(outcome, Explored::Exhausted, "{door}: {}", flight.targets.len());
            assert!(share > 0.95, "{door}: {share}");
        }
    }
}

#[test]
fn no_target_is_farther_from_the_beginning_than_the_radius_and_none_is_in_an_obstacle() {
    let config = Config { radius_m: 6.0, limit_s: 3600.0, ..Config::default() };
    let begins = at(3.0, -4.0);
    let pillar = Disc { center_ned_m: at(5.0, -2.0), radius_m: 1.2, ..Disc::default() };
    let flight = fly(&config, &AHEAD, &[pillar], begins);
    assert_eq!(flight.outcome, Explored::Exhausted);
    assert!(flight.targets.len() > 3);
    for target in &flight.targets {
        assert!(target.minus(begins).norm() <= 6.0, "{target:?}");
        assert!(target.minus(pillar.center_ned_m).norm() >= 1.2 + CLEARANCE_M, "{target:?}");
    }
}

#[test]
fn no_target_lies_outside_of_the_fence() {
    let fence = Fence { center_ned_m: at(3.0, 0.0), radius_m: 6.0, ..Fence::DEFAULT };
    let explorer = Config { limit_s: 3600.0, ..Config::default() }.build(CLEARANCE_M, &fence).unwrap();
    let (mut state, mut pose, mut targets) = (State::new(), Pose::default(), 0);
    let outcome = loop {
        let outcome = explorer.step(&mut state, seconds(targets as f32), &pose, &around(2.0), [].iter());
        let Explored::Target(target) = outcome else { break outcome };
        assert!(target.minus(fence.center_ned_m).norm() <= 5.5, "{target:?}");
        (pose.position_ned_m, targets) = (target, targets + 1);
    };
    assert!(outcome == Explored::Exhausted && targets > 10, "{outcome:?} after {targets}");
}

#[test]
fn a_search_ends_by_time_and_begins_anew_where_the_vehicle_is_after_its_end() {
    let explorer = Config { limit_s: 20.0, ..Config::default() }.build(CLEARANCE_M, &Fence::DEFAULT).unwrap();
    let mut state = State::new();
    let pose = Pose { position_ned_m: at(40.0, 2.0), yaw_rad: 1.0 };
    let step = |state: &mut State, s: f32, pose: &Pose| explorer.step(state, seconds(s), pose, &around(2.0), [].iter());
    assert!(matches!(step(&mut state, 5.0, &pose), Explored::Target(_)));
    assert!(matches!(step(&mut state, 25.0, &pose), Explored::Target(_)));
    for s in [25.1, 26.0, 300.0] {
        assert_eq!(step(&mut state, s, &pose), Explored::TimedOut);
    }
    state.end();
    assert!(state.began.is_none() && state.looked == [0; SIDE]);
    let elsewhere = Pose { position_ned_m: at(-300.0, 9.0), yaw_rad: 1.0 };
    let Explored::Target(target) = step(&mut state, 301.0, &elsewhere) else { panic!("no target") };
    assert!(target.minus(elsewhere.position_ned_m).norm() < 4.0, "{target:?}");
}

/// A bearing now and then, as one false detection is, gives a search neither more time nor another place; a signal that lasts ends it.
#[test]
fn a_signal_that_flickers_does_not_renew_a_search() {
    let explorer = Config { limit_s: 20.0, ..Config::default() }.build(CLEARANCE_M, &Fence::DEFAULT).unwrap();
    let mut state = State::new();
    let step = |state: &mut State, s: f32| {
        explorer.step(state, seconds(s), &Pose { position_ned_m: at(s, 0.0), yaw_rad: 1.0 }, &around(2.0), [].iter())
    };
    for s in 0..20 {
        assert!(matches!(step(&mut state, s as f32), Explored::Target(_)), "{s}");
        state.home();
    }
    assert_eq!(step(&mut state, 21.0), Explored::TimedOut);
    (0..HOMED_MIN).for_each(|_| state.home());
    assert!(state.began.is_none());
    assert!(matches!(step(&mut state, 22.0), Explored::Target(_)));
}

#[test]
fn the_same_seed_goes_the_same_way_and_another_another() {
    let world = square(7.3);
    let targets = |seed| fly(&Config { seed, ..Config::default() }, &AHEAD, &world, at(0.0, 0.0)).targets;
    assert_eq!(targets(1), targets(1));
    assert!((2..6).any(|seed| targets(seed) != targets(1)));
}

#[test]
fn a_target_is_kept_until_it_is_looked_at() {
    // Without obstacles: every target except the last few is given up because it, or one much nearer, was seen.
    let flight = fly(&Config { limit_s: 3600.0, ..Config::default() }, &AROUND, &[], at(0.0, 0.0));
    assert_eq!(flight.outcome, Explored::Exhausted);
    assert_eq!(flight.blocked, 0);
    for (index, target) in flight.targets.iter().enumerate() {
        assert!(!flight.targets[..index].contains(target), "back to {target:?}");
    }
    // About 700 cells within 15 m of the beginning, and those that were seen from near its edge.
    let looked_at: u32 = flight.state.looked.iter().map(|row| row.count_ones()).sum();
    assert!((690..1024).contains(&looked_at), "{looked_at}");
}

#[test]
fn what_is_blocked_is_not_tried_again_and_what_comes_no_nearer_is_blocked() {
    let explorer = Config { limit_s: 3600.0, ..Config::default() }.build(CLEARANCE_M, &Fence::DEFAULT).unwrap();
    let pose = Pose::default();
    let mut state = State::new();
    let mut tried: Vec<Horizontal> = Vec::new();
    let mut now_s = 0.0;
    // The vehicle never moves: every second target is reported as blocked, the others end by `patience_s`.
    let outcome = loop {
        let outcome = explorer.step(&mut state, seconds(now_s), &pose, &around(2.5), [].iter());
        now_s += 1.0;
        let Explored::Target(target) = outcome else { break outcome };
        if tried.last() != Some(&target) {
            assert!(!tried.contains(&target), "{target:?}");
            tried.push(target);
            if tried.len().is_multiple_of(2) {
                state.blocked();
            }
        }
        assert!(now_s < 1000.0);
    };
    assert_eq!(outcome, Explored::Exhausted);
    // The ring around a disc of 2.5 cells.
    assert!(tried.len() == 16, "{}", tried.len());
}

#[test]
fn what_is_behind_a_wall_has_not_been_looked_at() {
    let explorer = Config::default().build(CLEARANCE_M, &Fence::DEFAULT).unwrap();
    let mut state = State::new();
    let pose = Pose::default();
    let world = wall(at(2.0, -8.0), at(2.0, 8.0));
    explorer.step(&mut state, seconds(0.0), &pose, &around(6.0), world.iter());
    let grid = Grid { began_ned_m: at(0.0, 0.0), cell_m: 1.0 };
    let looked = |north, east| state.looked(grid.cell_at(at(north, east)).unwrap());
    assert!(looked(1.0, 0.0) && looked(2.0, 0.0) && looked(-5.0, 0.0) && looked(0.0, 5.0));
    assert!(!looked(3.0, 0.0) && !looked(4.0, 1.0) && !looked(3.0, 3.0) && !looked(-7.0, 0.0));
}

#[test]
fn poses_ranges_and_circles_that_are_no_numbers_do_no_harm() {
    let explorer = Config::default().build(CLEARANCE_M, &Fence::DEFAULT).unwrap();
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1.0, 0.0, 3.0];
    let mut state = State::new();
    let nowhere = Pose { position_ned_m: at(f32::NAN, 0.0), yaw_rad: 0.0 };
    assert_eq!(explorer.step(&mut state, seconds(1.0), &nowhere, &around(3.0), [].iter()), Explored::NoPose);
    assert!(state.began.is_none());
    let here = explorer.step(&mut state, seconds(1.0), &Pose::default(), &around(3.0), [].iter());
    assert!(matches!(here, Explored::Target(_)));
    // The target is unchanged.
    assert_eq!(explorer.step(&mut state, seconds(1.0), &nowhere, &around(3.0), [].iter()), here);
    for (k, value) in (0..odd.len().pow(4)).map(|k| (k, move |n: u32| odd[k / odd.len().pow(n) % odd.len()])) {
        let pose = Pose { position_ned_m: at(value(0), value(1)), yaw_rad: value(2) };
        let circle = Disc { center_ned_m: at(value(1), value(3)), radius_m: value(2), ..Disc::default() };
        let outcome = explorer.step(
            &mut state,
            seconds(1.0),
            &pose,
            &RangeSensor { range_m: value(3), fov_rad: value(2), ..RangeSensor::DEFAULT },
            [circle].iter(),
        );
        if let Explored::Target(target) = outcome {
            assert!(target.is_finite(), "{k}");
        }
    }
}

#[test]
fn a_configuration_that_does_not_fit_its_grid_is_refused() {
    let refused = |config: Config| config.build(CLEARANCE_M, &Fence::DEFAULT).unwrap_err().field;
    assert_eq!(refused(Config { radius_m: 15.5, ..Config::default() }), "explore.radius_m");
    assert_eq!(refused(Config { limit_s: f32::INFINITY, ..Config::default() }), "explore.limit_s");
    assert!(Config { radius_m: 30.0, cell_m: 2.0, ..Config::default() }.build(CLEARANCE_M, &Fence::DEFAULT).is_ok());
    assert!(core::mem::size_of::<State>() <= 312, "{}", core::mem::size_of::<State>());
}
