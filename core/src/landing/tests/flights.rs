//! Flights in closed loop.

use super::super::*;
use super::model::{Answer, Flight, World, restless, towards_beacon};
use super::{Landing, Memory};
use crate::base::rng::Rng;

/// How near to the pad's middle it must land, and how near to the beacon it must hover without a camera.
const ON_PAD_M: f32 = 0.15;
const ABOVE_BEACON_M: f32 = 1.5;

fn camera() -> Landing {
    Landing::new(Config { has_camera: true, ..Config::default() })
}

/// A beacon with a pad near it; one detection in ten is of something else, one is missing.
pub(super) fn landing(seed: u64) -> World {
    let mut rng = Rng::new(seed, 5);
    let at = |rng: &mut Rng, metres: f32| metres * (2.0 * rng.uniform() - 1.0);
    let beacon = Horizontal { north: 5.0 + at(&mut rng, 1.0), east: at(&mut rng, 3.0) };
    let pad = beacon.plus(Horizontal { north: at(&mut rng, 0.5), east: at(&mut rng, 0.5) });
    World {
        pad_ned_m: Some(pad),
        beacon_ned_m: Ned { north: beacon.north, east: beacon.east, down: 0.0 },
        false_share: 0.1,
        missed_share: 0.1,
        ..World::new(seed)
    }
}

/// Of this many flights: how many landed, how many of those on the pad's middle, and the farthest from it.
fn land(flights: u64, world: impl Fn(u64) -> World) -> (u32, u32, f32) {
    let lander = camera();
    let (mut down, mut on_pad, mut farthest_m) = (0, 0, 0.0_f32);
    for seed in 0..flights {
        let world = world(seed);
        let mut flight = Flight::new(world);
        let (output, stages) = flight.run(&lander, 250.0, towards_beacon);
        assert!(output.stage == Stage::Landed || output.stage == Stage::HandedOver, "seed {seed}: {stages:?}");
        assert!(output.reason.is_some() && !output.wants_land, "seed {seed}: {output:?}");
        if let Some(place) = flight.lands_at {
            let off_m = place.minus(world.pad_ned_m.unwrap()).norm();
            down += 1;
            on_pad += u32::from(off_m <= ON_PAD_M);
            farthest_m = farthest_m.max(off_m);
        }
    }
    (down, on_pad, farthest_m)
}

#[test]
fn in_calm_air_it_lands_on_the_middle_of_the_pad() {
    for answer in [Answer::ArduCopter, Answer::Fast] {
        let (down, on_pad, farthest_m) = land(100, |seed| World { answer, ..landing(seed) });
        assert!(down == 100 && on_pad == 100 && farthest_m < 0.08, "{answer:?}: {down} {on_pad} {farthest_m}");
    }
}

#[test]
fn it_arrives_above_a_beacon_that_pulses() {
    let lander = Landing::new(Config::default());
    // 0.1 s a second, and every 1.4 s.
    for pulse in [(5, 50), (5, 70)] {
        for seed in 0..20 {
            let bearing = Horizontal::from_bearing(0.31 * seed as f32).times(8.0);
            let beacon_ned_m = Ned { north: bearing.north, east: bearing.east, down: 0.0 };
            let mut flight = Flight::new(World { pulse, beacon_ned_m, ..World::new(seed) });
            let (output, stages) = flight.run(&lander, 250.0, towards_beacon);
            assert_eq!(output.reason, Some(Reason::Arrived), "{pulse:?} {seed}: {stages:?}");
        }
    }
}

#[test]
fn in_gusts_of_up_to_3_m_s_it_lands_on_the_middle_of_the_pad() {
    // Three times the standard deviation, along each of two axes.
    for answer in [Answer::ArduCopter, Answer::Fast] {
        let (down, on_pad, farthest_m) = land(200, |seed| World { answer, gust_mps: 1.0, ..landing(seed) });
        assert!(
            down >= 199 && 100 * on_pad >= 99 * down && farthest_m < 0.2,
            "{answer:?}: {down} {on_pad} {farthest_m}"
        );
    }
}

#[test]
fn with_a_range_finder_and_without_the_autopilots_word_it_lands_as_well() {
    let (down, on_pad, farthest_m) =
        land(60, |seed| World { has_finder: true, says_landed: false, gust_mps: 0.5, ..landing(seed) });
    assert!(down == 60 && on_pad == 60, "{down} {on_pad} {farthest_m}");
}

#[test]
fn in_gusts_three_times_as_strong_it_lands_near_the_middle_or_hands_over() {
    for answer in [Answer::ArduCopter, Answer::Fast] {
        let (down, on_pad, farthest_m) = land(60, |seed| World { answer, gust_mps: 3.0, ..landing(seed) });
        assert!(down > 15 && 2 * on_pad > down && farthest_m < 0.5, "{answer:?}: {down} {on_pad} {farthest_m}");
    }
}

#[test]
fn late_and_rare_looks_do_no_harm() {
    let (down, on_pad, farthest_m) =
        land(60, |seed| World { look_period_ticks: 10, look_late_ticks: 7, missed_share: 0.3, ..landing(seed) });
    assert!(down >= 58 && on_pad == down, "{down} {on_pad} {farthest_m}");
}

/// Flights without a camera: each hovers within reach of the beacon, or gives a reason. Returns how many arrived.
fn seek(name: &str, flights: u64, row: World) -> u32 {
    let lander = Landing::new(Config::default());
    let mut arrived = 0;
    for seed in 0..flights {
        let mut rng = Rng::new(seed, 9);
        let bearing = Horizontal::from_bearing(core::f32::consts::TAU * rng.uniform()).times(8.0);
        let beacon_ned_m = Ned { north: bearing.north, east: bearing.east, down: 0.0 };
        let mut flight = Flight::new(World { seed, beacon_ned_m, ..row });
        let planner = if seed % 2 == 0 { towards_beacon as fn(&Flight) -> Horizontal } else { restless };
        let (output, stages) = flight.run(&lander, 200.0, planner);
        let off_m = flight.beacon().minus(flight.here()).norm();
        let is_typed = output.stage == Stage::HandedOver && output.reason.is_some();
        let is_arrived = output.reason == Some(Reason::Arrived);
        assert!(is_typed && (!is_arrived || off_m < ABOVE_BEACON_M), "{name} {seed}: {off_m} {output:?} {stages:?}");
        arrived += u32::from(is_arrived);
    }
    arrived
}

#[test]
fn without_a_camera_it_hovers_above_the_beacon_or_says_why_not() {
    let high = |metres: f32| Ned { down: -metres, ..Ned::default() };
    let base = World::new(0);
    let biased = World { bias_rad: 5.0 / 57.3, ..base };
    let flat = World { has_elevation: false, ..base };
    for (name, row) in [
        ("clean", World { bearing_sigma_rad: 0.003, ..base }),
        ("biased", biased),
        ("biased, fast", World { answer: Answer::Fast, ..biased }),
        ("biased, gusts", World { gust_mps: 2.0, ..biased }),
        ("biased, low", World { start_ned_m: high(1.0), ..biased }),
        ("biased, higher than assumed by four sigma", World { start_ned_m: high(6.0), ..biased }),
        ("biased, range finder", World { has_finder: true, ..biased }),
        ("biased, walking beacon", World { beacon_mps: 0.2, ..biased }),
        ("20 degrees", World { bearing_sigma_rad: 0.35, ..base }),
        ("outliers", World { outlier_share: 0.3, ..base }),
        ("horizontal, 2 degrees", World { bearing_sigma_rad: 0.035, ..flat }),
        ("horizontal, biased", World { bias_rad: 5.0 / 57.3, bearing_sigma_rad: 0.087, ..flat }),
        ("horizontal, 20 degrees", World { bearing_sigma_rad: 0.35, ..flat }),
    ] {
        let arrived = seek(name, 40, row);
        assert!(arrived >= 38, "{name}: {arrived} of 40");
    }
}

#[test]
fn a_jump_of_the_autopilots_position_leads_nowhere_else() {
    let lander = camera();
    for seed in 0..20 {
        let mut flight = Flight::new(landing(seed));
        let mut state = Memory::default();
        let mut jumped = false;
        while flight.time_s() < 100.0 {
            let output = flight.step(&lander, &mut state, towards_beacon);
            if output.stage == Stage::Descending && !jumped && flight.place_ned_m[2] > -2.0 {
                jumped = true;
                flight.reported_off_m = Horizontal { north: 5.0, east: -3.0 };
            }
            if output.stage == Stage::Landed {
                break;
            }
        }
        let off_m = flight.lands_at.map(|place| place.minus(flight.world.pad_ned_m.unwrap()).norm());
        assert!(jumped && off_m.is_some_and(|off_m| off_m < ON_PAD_M), "{seed}: {off_m:?}");
    }
}

#[test]
fn the_position_loop_amplifies_no_disturbance_by_more_than_2_1() {
    // Of the loop with the autopilot's response and all delays, at all frequencies: 1 / |1 + L|.
    let c = centring::Config::default();
    let [kp, ki, kd] = [c.kp_per_s, centring::KI_PER_S2, c.kd].map(f64::from);
    let amplifies = |late_s: f64, answer: &dyn Fn([f64; 2]) -> [f64; 2]| {
        let times = |[a, b]: [f64; 2], [c, d]: [f64; 2]| [a * c - b * d, a * d + b * c];
        let over = |[a, b]: [f64; 2], [c, d]: [f64; 2]| {
            let squared = c * c + d * d;
            [(a * c + b * d) / squared, (b * c - a * d) / squared]
        };
        (0..4_000).fold(0.0_f64, |most, step| {
            let w = 0.01 * 10.0_f64.powf(f64::from(step) / 1_000.0);
            let controller = [kp, kd * w - ki / w];
            let late = [(w * late_s).cos(), -(w * late_s).sin()];
            let open = over(times(times(controller, late), answer([0.0, w])), [0.0, w]);
            most.max(1.0 / (1.0 + open[0]).hypot(open[1]))
        })
    };
    let over = |[a, b]: [f64; 2], squared: f64| [a / squared, -b / squared];
    // 0.22 s and 0.05 s of telemetry; a critically damped second order of 3.1 rad/s.
    let arducopter = amplifies(0.27, &|[_, w]| {
        let denominator = [1.0 - w * w / 9.61, 2.0 * w / 3.1];
        over(denominator, denominator[0] * denominator[0] + denominator[1] * denominator[1])
    });
    let fast = amplifies(0.15, &|[_, w]| over([1.0, 0.15 * w], 1.0 + 0.0225 * w * w));
    assert!(arducopter < 2.1 && fast < 2.1, "{arducopter} {fast}");
}
