//! The table in the module's documentation, row by row.

use std::vec::Vec;

use super::super::*;
use super::flights::landing;
use super::model::{Camera, Flight, NEVER, World, restless, stay, towards_beacon};
use super::{Landing, Memory};

const FOR_EVER: f32 = 1e9;

/// A beacon 5 m to the north, a pad half a metre from it, both 2 m below; no disturbances.
fn quiet() -> World {
    World {
        start_ned_m: Ned { down: -2.0, ..Ned::default() },
        beacon_ned_m: Ned { north: 5.0, ..Ned::default() },
        pad_ned_m: Some(Horizontal { north: 5.0, east: 0.5 }),
        ..World::new(3)
    }
}

fn camera() -> Config {
    Config { has_camera: true, ..Config::default() }
}

/// Flies; returns the last output, and every stage with its reason.
fn fly(config: Config, world: World) -> (Output, Vec<(Stage, Option<Reason>)>) {
    let lander = Landing::new(config);
    let (mut flight, mut state) = (Flight::new(world), Memory::default());
    let (mut output, mut trail) = (Output::default(), Vec::new());
    while flight.time_s() < 200.0 {
        output = flight.step(&lander, &mut state, towards_beacon);
        if trail.last() != Some(&(output.stage, output.reason)) {
            trail.push((output.stage, output.reason));
        }
        if matches!(output.stage, Stage::Landed | Stage::HandedOver) {
            break;
        }
    }
    (output, trail)
}

fn has(trail: &[(Stage, Option<Reason>)], stages: &[Stage]) -> bool {
    let stages_flown: Vec<Stage> = trail.iter().map(|(stage, _)| *stage).collect();
    stages_flown.windows(stages.len()).any(|window| window == stages)
}

fn ends(config: Config, world: World, reason: Reason, after: Stage) {
    let (output, trail) = fly(config, world);
    assert_eq!((output.stage, output.reason), (Stage::HandedOver, Some(reason)), "{trail:?}");
    assert!(has(&trail, &[after, Stage::HandedOver]), "{trail:?}");
}

/// When a stage begins in a flight.
fn begins(config: Config, world: World, stage: Stage) -> f32 {
    let lander = Landing::new(config);
    let (mut flight, mut state) = (Flight::new(world), Memory::default());
    while flight.time_s() < 200.0 {
        if flight.step(&lander, &mut state, towards_beacon).stage == stage {
            return flight.time_s();
        }
    }
    panic!("{stage:?} does not begin");
}

#[test]
fn far_away_the_planner_is_followed_whatever_is_heard() {
    let far = World { beacon_ned_m: Ned { north: 15.0, ..Ned::default() }, ..quiet() };
    for world in [
        far,
        World { bearing_sigma_rad: 0.35, ..far },
        World { outlier_share: 0.4, ..far },
        World { bias_rad: 0.087, ..far },
        World { has_elevation: false, bearing_sigma_rad: 0.35, ..far },
        World { has_elevation: false, outlier_share: 0.4, ..far },
    ] {
        for seed in 0..10 {
            for planner in [stay as fn(&Flight) -> Horizontal, |flight: &Flight| {
                // Back and forth across the bearing.
                Horizontal { north: 0.0, east: libm::cosf(0.8 * flight.time_s()) }
            }] {
                let lander = Landing::new(camera());
                let (mut flight, mut state) = (Flight::new(World { seed, ..world }), Memory::default());
                while flight.time_s() < 40.0 {
                    let output = flight.step(&lander, &mut state, planner);
                    assert!(output.stage == Stage::Seeking && output.demand.is_none(), "{seed}: {output:?} {world:?}");
                }
            }
        }
    }
}

#[test]
fn a_bearing_that_swings_from_a_reflection_to_the_source_is_no_arrival() {
    // Flying north towards a mirror image; after 6 s the source itself is received, 12 m to the south, behind.
    for has_elevation in [false, true] {
        let lander = Landing::new(Config::default());
        let world = World { has_elevation, beacon_ned_m: Ned { north: 20.0, ..Ned::default() }, ..quiet() };
        let (mut flight, mut state) = (Flight::new(world), Memory::default());
        while flight.time_s() < 16.0 {
            if flight.time_s() > 6.0 {
                flight.world.beacon_ned_m = Ned { north: -12.0, ..Ned::default() };
            }
            let output = flight.step(&lander, &mut state, restless);
            assert_eq!(output.stage, Stage::Seeking, "{} s", flight.time_s());
        }
    }
}

#[test]
fn arrived_it_goes_above_the_beacon_and_hands_over_and_lands_only_if_the_user_wants_it() {
    for request_land in [false, true] {
        let (output, trail) = fly(Config { request_land, ..Config::default() }, quiet());
        let stages = [Stage::Seeking, Stage::Approaching, Stage::HandedOver];
        assert!(trail.len() == 3 && has(&trail, &stages), "{trail:?}");
        assert_eq!((output.reason, output.wants_land), (Some(Reason::Arrived), request_land));
        assert_eq!(output.target.map(|target| target.is_pad), Some(false));
    }
}

#[test]
fn near_for_long_and_not_known_it_searches_until_it_knows() {
    // Only by the bank's estimate; hovering gives no more information.
    let world = World {
        has_elevation: false,
        start_ned_m: Ned { north: 3.5, east: 0.5, down: -2.0 },
        believed_ned_m: Some(Horizontal { north: 4.5, east: 0.5 }),
        ..quiet()
    };
    let lander = Landing::new(Config::default());
    let (output, stages) = Flight::new(world).run(&lander, 100.0, stay);
    assert_eq!(output.reason, Some(Reason::Arrived), "{stages:?}");
    assert!(stages.windows(2).any(|pair| pair == [Stage::SearchingBeacon, Stage::Approaching]), "{stages:?}");
}

#[test]
fn a_beacon_that_is_not_found_is_searched_for_within_limits() {
    // Estimated to be near, but no signal.
    let world = World {
        deaf_s: (0.0, FOR_EVER),
        start_ned_m: Ned { north: 4.0, east: 0.5, down: -2.0 },
        believed_ned_m: Some(Horizontal { north: 4.5, east: 0.5 }),
        ..quiet()
    };
    let limited = |search: search::Config| Config { search, ..Config::default() };
    let short = search::Config { radius_m: 1.5, ..search::Config::default() };
    for (config, world, reason) in [
        (limited(short), world, Reason::SearchLimit),
        (limited(search::Config { time_s: 3.0, ..short }), world, Reason::TimeLimit),
        (limited(short), World { blocked_s: (8.0, FOR_EVER), ..world }, Reason::Blocked),
    ] {
        let lander = Landing::new(config);
        let (mut ended, mut farthest_m) = (0, 0.0_f32);
        for seed in 0..10 {
            let (mut flight, mut state) = (Flight::new(World { seed, ..world }), Memory::default());
            while flight.time_s() < 150.0 {
                let output = flight.step(&lander, &mut state, stay);
                farthest_m = farthest_m.max(flight.here().minus(Horizontal { north: 4.5, east: 0.5 }).norm());
                if output.stage == Stage::HandedOver {
                    ended += u32::from(output.reason == Some(reason));
                    break;
                }
            }
        }
        assert!(ended == 10 && farthest_m < 4.0, "{reason:?}: {ended} {farthest_m}");
    }
}

#[test]
fn a_pad_in_sight_of_an_ambiguous_beacon_is_gone_for_at_once() {
    let (output, trail) = fly(camera(), World { start_ned_m: Ned { down: -4.0, ..Ned::default() }, ..quiet() });
    assert_eq!((output.stage, output.reason), (Stage::Landed, Some(Reason::Landed)));
    assert!(has(&trail, &[Stage::Centring, Stage::Descending, Stage::Committed, Stage::Landed]), "{trail:?}");
}

#[test]
fn without_a_pad_it_searches_and_says_so() {
    ends(camera(), World { pad_ned_m: None, ..quiet() }, Reason::NoPad, Stage::SearchingPad);
    let pad_ned_m = Some(Horizontal { north: 5.0, east: 2.2 });
    let (output, trail) = fly(camera(), World { pad_ned_m, ..quiet() });
    assert!(output.stage == Stage::Landed && has(&trail, &[Stage::SearchingPad, Stage::Centring]), "{trail:?}");
}

#[test]
fn a_pad_that_is_not_the_beacon_s_is_not_landed_on_however_long_it_is_in_sight() {
    let high = World { start_ned_m: Ned { down: -10.0, ..Ned::default() }, has_finder: true, ..quiet() };
    let aside = World { pad_ned_m: Some(Horizontal { north: 5.0, east: 5.5 }), ..high };
    ends(camera(), aside, Reason::NoPad, Stage::SearchingPad);
}

#[test]
fn no_frames_and_bad_frames_are_no_camera() {
    for camera_is in [Camera::Dead, Camera::Bad] {
        ends(camera(), World { camera: camera_is, ..quiet() }, Reason::NoCamera, Stage::Approaching);
    }
}

#[test]
fn what_was_heard_and_is_not_there_any_more_is_left_to_the_planner_so_many_times() {
    let from_s = begins(Config::default(), quiet(), Stage::Approaching) + 0.1;
    let world = World { deaf_s: (from_s, FOR_EVER), ..quiet() };
    let (_, trail) = fly(Config::default(), world);
    assert!(trail.contains(&(Stage::Seeking, Some(Reason::Ambiguous))), "{trail:?}");
    ends(Config { retries_max: 0, ..Config::default() }, world, Reason::Ambiguous, Stage::Approaching);
    ends(Config { approach_s: 2.0, ..Config::default() }, world, Reason::TimeLimit, Stage::Approaching);
}

#[test]
fn blocked_on_the_last_metres_it_says_so() {
    let early = arrival::Config { arrive_m: 2.5 };
    let config = Config { arrival: early, ..Config::default() };
    let from_s = begins(config, quiet(), Stage::Approaching) - 0.5;
    ends(config, World { blocked_s: (from_s, FOR_EVER), ..quiet() }, Reason::Blocked, Stage::Approaching);
    let from_s = begins(camera(), quiet(), Stage::Centring) + 0.1;
    let (output, _) = fly(camera(), World { blocked_s: (from_s, FOR_EVER), ..quiet() });
    assert_eq!((output.stage, output.reason), (Stage::HandedOver, Some(Reason::Blocked)));
}

#[test]
fn held_by_the_mission_on_its_last_centimetres_it_does_not_take_its_hover_for_the_ground() {
    let landed_s = begins(camera(), quiet(), Stage::Landed);
    let mut held_above = 0;
    for tenths in 5..30 {
        let from_s = landed_s - 0.1 * tenths as f32;
        let world = World { held_s: (from_s, from_s + 4.0), ..quiet() };
        let (lander, mut flight, mut state) = (Landing::new(camera()), Flight::new(world), Memory::default());
        while flight.time_s() < landed_s + 40.0 {
            let output = flight.step(&lander, &mut state, towards_beacon);
            let above_m = world.ground_down_m - flight.place_ned_m[2];
            held_above += u32::from(above_m > 0.05 && flight.time_s() > from_s + 2.0 && flight.time_s() < from_s + 4.0);
            if output.stage == Stage::Landed {
                assert!(above_m < 0.05, "{tenths}: landed {above_m} m above the ground");
                break;
            }
        }
    }
    assert!(held_above > 500, "{held_above}");
}

#[test]
fn the_time_for_which_the_mission_holds_it_is_no_stage_s_own() {
    // Long enough for every limit but that of all of it.
    let ended = |config: Config, world: World, stage: Stage| {
        let from_s = begins(config, world, stage) + 0.5;
        fly(config, World { held_s: (from_s, from_s + 100.0), ..world })
    };
    let (output, trail) = ended(Config::default(), quiet(), Stage::Approaching);
    assert_eq!(output.reason, Some(Reason::Arrived), "{trail:?}");
    let (output, trail) = ended(camera(), World { says_landed: true, ..quiet() }, Stage::Descending);
    assert_eq!(output.reason, Some(Reason::Landed), "{trail:?}");
    // The legs of a search are flown afterwards, so that what is not there has been looked for.
    let (output, trail) = ended(camera(), World { pad_ned_m: None, ..quiet() }, Stage::SearchingPad);
    assert_eq!(output.reason, Some(Reason::NoPad), "{trail:?}");
    let all = Config { total_s: 60.0, ..camera() };
    let (output, trail) = ended(all, World { pad_ned_m: None, ..quiet() }, Stage::SearchingPad);
    assert_eq!(output.reason, Some(Reason::TimeLimit), "{trail:?}");
}

#[test]
fn the_search_for_the_pad_has_limits() {
    let none = World { pad_ned_m: None, ..quiet() };
    let short = search::Config { time_s: 3.0, ..search::Config::default() };
    ends(Config { search: short, ..camera() }, none, Reason::TimeLimit, Stage::SearchingPad);
    let from_s = begins(camera(), none, Stage::SearchingPad) + 0.1;
    ends(camera(), World { blocked_s: (from_s, FOR_EVER), ..none }, Reason::Blocked, Stage::SearchingPad);
    ends(camera(), World { lacks_radius: true, ..quiet() }, Reason::NoHeight, Stage::SearchingPad);
    // With a range finder the radius is not needed.
    let (output, trail) = fly(camera(), World { lacks_radius: true, has_finder: true, ..quiet() });
    assert_eq!(output.stage, Stage::Landed, "{trail:?}");
}

#[test]
fn a_moment_without_sight_holds_the_height_and_no_more() {
    let from_s = begins(camera(), quiet(), Stage::Descending) + 0.5;
    let (output, trail) = fly(camera(), World { covered_s: (from_s, from_s + 1.0), ..quiet() });
    assert!(has(&trail, &[Stage::Descending, Stage::Centring, Stage::Descending]), "{trail:?}");
    assert!(output.stage == Stage::Landed && !has(&trail, &[Stage::Recovering]), "{trail:?}");
}

#[test]
fn a_pad_that_is_lost_is_waited_for_climbed_for_and_searched_for() {
    let from_s = begins(camera(), quiet(), Stage::Descending) + 0.5;
    let (output, trail) = fly(camera(), World { covered_s: (from_s, from_s + 3.0), ..quiet() });
    assert!(has(&trail, &[Stage::Centring, Stage::Recovering, Stage::Centring]), "{trail:?}");
    assert_eq!(output.stage, Stage::Landed, "{trail:?}");
    let (output, trail) = fly(camera(), World { covered_s: (from_s, from_s + 9.0), ..quiet() });
    assert!(has(&trail, &[Stage::Recovering, Stage::SearchingPad, Stage::Centring]), "{trail:?}");
    assert_eq!(output.stage, Stage::Landed, "{trail:?}");
    let for_ever = World { covered_s: (from_s, FOR_EVER), ..quiet() };
    ends(camera(), for_ever, Reason::PadLost, Stage::SearchingPad);
    let (output, trail) = fly(Config { retries_max: 0, ..camera() }, for_ever);
    assert_eq!((output.stage, output.reason), (Stage::HandedOver, Some(Reason::PadLost)), "{trail:?}");
    assert!(has(&trail, &[Stage::Recovering]) && !has(&trail, &[Stage::SearchingPad]), "{trail:?}");
}

#[test]
fn it_climbs_for_a_lost_pad_so_far_and_no_farther() {
    let config = camera();
    let from_s = begins(config, quiet(), Stage::Descending) + 0.5;
    for (altitude_band_m, most_m) in [(2.0, centring::CLIMB_M), (0.3, 0.3)] {
        let lander = Landing { lander: config.build(altitude_band_m).unwrap() };
        let (mut flight, mut state) =
            (Flight::new(World { covered_s: (from_s, FOR_EVER), ..quiet() }), Memory::default());
        let mut highest_m = 0.0_f32;
        while flight.time_s() < 100.0 {
            flight.step(&lander, &mut state, towards_beacon);
            highest_m = highest_m.max(-flight.place_ned_m[2]);
        }
        assert!(highest_m < 2.0 + most_m, "band {altitude_band_m} m: {highest_m} m");
    }
}

#[test]
fn not_coming_into_the_cone_in_time_is_a_reason() {
    let config = Config { attempt_s: 1.0, retries_max: 0, ..camera() };
    let (output, trail) = fly(config, quiet());
    assert_eq!((output.stage, output.reason), (Stage::HandedOver, Some(Reason::TimeLimit)), "{trail:?}");
}

#[test]
fn on_the_ground_it_stands_still_and_disarms_only_if_the_user_wants_it() {
    for request_land in [false, true] {
        for says_landed in [false, true] {
            let lander = Landing::new(Config { request_land, ..camera() });
            let (mut flight, mut state) = (Flight::new(World { says_landed, ..quiet() }), Memory::default());
            let mut output = Output::default();
            while flight.time_s() < 60.0 {
                output = flight.step(&lander, &mut state, towards_beacon);
            }
            assert_eq!((output.stage, output.reason), (Stage::Landed, Some(Reason::Landed)), "{says_landed}");
            // Until the autopilot has seen the ground it is told to sink.
            let down_mps = if says_landed { 0.0 } else { centring::COMMIT_MPS };
            assert_eq!((output.demand, output.wants_land), (Some((Horizontal::default(), down_mps)), request_land));
        }
    }
}

#[test]
fn the_last_part_is_broken_off_when_it_is_pushed_out_or_takes_too_long() {
    let pushed = (0..20).any(|seed| {
        let (_, trail) = fly(camera(), World { gust_mps: 2.0, ..landing(seed) });
        has(&trail, &[Stage::Committed, Stage::Centring])
    });
    assert!(pushed);
    let from_s = begins(camera(), quiet(), Stage::Committed) + 0.1;
    let (output, trail) = fly(camera(), World { blocked_s: (from_s, from_s + 12.0), ..quiet() });
    assert!(has(&trail, &[Stage::Committed, Stage::Centring, Stage::Committed]), "{trail:?}");
    assert_eq!(output.stage, Stage::Landed, "{trail:?}");
    // Dropped, but not down: it climbs again.
    let from_s = begins(camera(), quiet(), Stage::Landed) - 0.5;
    let (output, trail) = fly(camera(), World { blocked_s: (from_s, from_s + 12.0), ..quiet() });
    assert!(has(&trail, &[Stage::Committed, Stage::Recovering]), "{trail:?}");
    assert_eq!(output.stage, Stage::Landed, "{trail:?}");
}

#[test]
fn without_a_word_of_the_own_vehicle_it_stops_says_so_and_goes_on_afterwards() {
    let from_s = begins(camera(), quiet(), Stage::Descending) + 0.3;
    let span = (from_s, from_s + 2.0);
    for world in [World { silent_s: span, ..quiet() }, World { nan_s: span, ..quiet() }] {
        let lander = Landing::new(camera());
        let (mut flight, mut state) = (Flight::new(world), Memory::default());
        while flight.time_s() < 60.0 {
            let output = flight.step(&lander, &mut state, towards_beacon);
            if flight.time_s() > from_s + 0.6 && flight.time_s() < span.1 {
                assert_eq!(
                    (output.demand, output.reason),
                    (Some((Horizontal::default(), 0.0)), Some(Reason::NoOwnship))
                );
            }
        }
        assert_eq!(state.landing.stage(), Stage::Landed);
    }
    // Before it has taken over, it does not act.
    let (mut flight, mut state) = (Flight::new(World { silent_s: (0.0, FOR_EVER), ..quiet() }), Memory::default());
    let output = flight.step(&Landing::new(camera()), &mut state, stay);
    assert_eq!((output.demand, output.reason), (None, Some(Reason::NoOwnship)));
}

#[test]
fn all_of_it_has_an_end_and_the_end_is_one() {
    let config = Config { total_s: 3.0, ..camera() };
    let lander = Landing::new(config);
    let (mut flight, mut state) = (Flight::new(World { covered_s: NEVER, ..quiet() }), Memory::default());
    let mut over_s = None;
    while flight.time_s() < 60.0 {
        let output = flight.step(&lander, &mut state, towards_beacon);
        if output.stage == Stage::HandedOver {
            over_s.get_or_insert(flight.time_s());
            assert_eq!(output.reason, Some(Reason::TimeLimit));
            assert!(flight.time_s() < over_s.unwrap() + 1.0 || output.demand == Some((Horizontal::default(), 0.0)));
        } else {
            assert!(over_s.is_none(), "{output:?}");
        }
    }
    assert!(over_s.is_some());
}

#[test]
fn a_moment_with_room_beside_it_is_no_place_to_land() {
    let lander =
        Lander { config: Config { request_land: true, ..Config::default() }, ..Config::default().build(2.0).unwrap() };
    let mut state = State::default();
    state.enter(Stage::HandedOver, Some(Reason::Arrived), Instant(0));
    let mut step = |micros: u64, clearance_m: f32, aside_m: Option<f32>| {
        let ownship = Ownship { position_time: Instant(micros), attitude_time: Instant(micros), ..Ownship::default() };
        let (now, tick_s, poses) = (Instant(micros), 0.02, &crate::base::history::Poses::default());
        let (height_m, estimate, look, ownship) = (None, None, None, Some(&ownship));
        let fix = aside_m.map(|distance_m| Fix { distance_m, ..Fix::default() });
        let (is_landed, is_blocked) = (false, false);
        let input =
            Input { now, ownship, height_m, poses, fix, estimate, look, is_landed, is_blocked, clearance_m, tick_s };
        lander.step(&mut state, &input)
    };
    for tick in 0..500 {
        let output = step(20_000 * tick, if tick % 40 == 0 { 0.19 } else { 0.28 }, None);
        assert_eq!((output.wants_land, output.reason), (false, Some(Reason::Blocked)), "{tick}");
    }
    for tick in 500..600 {
        let output = step(20_000 * tick, 0.28, None);
        assert!(output.wants_land == (tick > 530) || tick == 530, "{tick}");
    }
    // Somebody has pushed it aside.
    assert!(step(12_020_000, 0.28, Some(1.0)).wants_land);
    assert!(!step(12_040_000, 0.28, Some(3.0)).wants_land);
}
