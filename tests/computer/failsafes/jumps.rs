//! Jumps of the autopilot's estimate: the vehicle's true path is that of the same flight without them.

use foxhound_sim::autopilot::Start;
use foxhound_sim::drive::soak::course;
use foxhound_sim::drive::trial::{Clocks, Step, Trial};
use foxhound_sim::scenario::Software;

use super::stand::{BOTH, Stand, Stream};

const SEEDS: u64 = 4;
const TURN_RAD: f64 = 30.0 * std::f64::consts::PI / 180.0;

/// How much longer the true path may be than without a jump, for each.
const EXTRA_M: f64 = 0.5;
/// Least clearance of the hull from every pillar.
const CLEAR_M: f64 = 0.02;
/// Largest error of the height.
const HEIGHT_M: f64 = 0.1;

/// What happens when the vehicle has come that far north.
struct Jump {
    at_north_m: f64,
    step_ned_m: [f64; 3],
    turn_rad: f64,
    tells_origin: bool,
}

const NONE: Jump = Jump { at_north_m: 0.0, step_ned_m: [0.0; 3], turn_rad: 0.0, tells_origin: false };

fn way_m(steps: &[Step]) -> f64 {
    steps.windows(2).map(|pair| pair[1].place().minus(pair[0].place()).norm()).sum()
}

/// What is flown: pillars stand from `pillars_from_m` to `pillars_to_m`, and the heading is wrong from the beginning.
#[derive(Clone, Copy)]
struct Field {
    pillars_from_m: f64,
    pillars_to_m: f64,
    turned_rad: f64,
}

const ALL: Field = Field { pillars_from_m: 0.0, pillars_to_m: 100.0, turned_rad: 0.0 };

/// The true way to the beacon with jumps.
fn fly(software: Software, seed: u64, field: Field, jumps: &[Jump], why: &str) -> f64 {
    let mut scenario = course();
    scenario.obstacles.retain(|pillar| (field.pillars_from_m..field.pillars_to_m).contains(&pillar.y));
    let trial = Trial::new(&scenario, software, Start::Hovering, Clocks::default(), seed).unwrap();
    let mut stand = Stand::of(trial);
    stand.trial.rig.autopilot.jump_yaw(field.turned_rad);
    stand.run(2.0);
    stand.get_under_way();
    let down_m = stand.trial.motion().pose.position_ned_m[2];
    for jump in jumps {
        stand.fly_past(jump.at_north_m);
        let now_us = stand.trial.autopilot_us();
        if jump.step_ned_m != [0.0; 3] {
            stand.trial.rig.autopilot.jump(now_us, jump.step_ned_m, jump.tells_origin);
        }
        if jump.turn_rad != 0.0 {
            stand.trial.rig.autopilot.jump_yaw(jump.turn_rad);
        }
        let from = stand.steps.len();
        stand.run(0.6);
        let fastest = stand.steps[from..].iter().map(Step::speed_mps).fold(0.0, f64::max);
        assert!(fastest < 1.1, "{why}, {software:?}: {fastest} m/s after a jump");
    }
    stand.expect_beacon(why);
    let high_m = stand.steps.iter().map(|step| (step.motion.pose.position_ned_m[2] - down_m).abs()).fold(0.0, f64::max);
    assert!(high_m < HEIGHT_M, "{why}, {software:?}: the height changes by {high_m} m");
    let clear_m = stand.trial.min_clearance_m();
    assert!(clear_m > CLEAR_M, "{why}, {software:?}: {clear_m} m from a pillar");
    way_m(&stand.steps)
}

fn assert_no_worse(field: Field, jumps: &[Jump], extra_m: f64, why: &str) {
    for software in BOTH {
        for seed in 1..=SEEDS {
            let without_m = fly(software, seed, Field { turned_rad: 0.0, ..field }, &[], "without a jump");
            let with_m = fly(software, seed, field, jumps, why);
            assert!(with_m < without_m + extra_m, "{why}, {software:?}, seed {seed}: {with_m} m, not {without_m} m");
        }
    }
}

/// A jump of the autopilot's position by 5 m costs at most 0.5 m of path and no clearance, announced or not.
#[test]
fn five_metres_in_any_direction_lead_nowhere_else_announced_or_not() {
    for (index, step_ned_m) in [[5.0, 0.0, 0.0], [-3.0, 4.0, 0.0], [0.0, -5.0, 0.0]].into_iter().enumerate() {
        let jump = Jump { at_north_m: 11.5, step_ned_m, tells_origin: index % 2 == 1, ..NONE };
        assert_no_worse(ALL, &[jump], EXTRA_M, &format!("jump {step_ned_m:?}"));
    }
}

/// A jump of the autopilot's height by 2 m changes the true height by less than 0.1 m.
#[test]
fn two_metres_up_or_down_leave_the_true_height_alone() {
    for down_m in [-2.0, 2.0] {
        let jump = Jump { at_north_m: 11.5, step_ned_m: [0.0, 0.0, down_m], ..NONE };
        assert_no_worse(ALL, &[jump], EXTRA_M, &format!("jump {down_m} m down"));
    }
}

/// Four jumps in a row cost no more than four times one jump.
#[test]
fn several_jumps_in_a_row_add_nothing_up() {
    let jumps = [[5.0, 0.0, 0.0], [-2.0, 4.0, 1.0], [0.0, -3.0, -2.0], [-5.0, 5.0, 0.0]].into_iter().enumerate().map(
        |(index, step_ned_m)| Jump {
            at_north_m: 8.0 + 4.0 * index as f64,
            step_ned_m,
            tells_origin: index % 2 == 0,
            ..NONE
        },
    );
    assert_no_worse(ALL, &jumps.collect::<Vec<_>>(), 4.0 * EXTRA_M, "four jumps");
}

/// A heading that is wrong by 30 degrees and corrected in flight leads to no collision among the pillars behind.
#[test]
fn a_wrong_heading_that_the_filter_puts_right_in_flight_is_right_among_the_pillars_that_follow() {
    // Until it is corrected, obstacles and bearings are rotated, but the motion is not: no place for pillars.
    for turned_rad in [-TURN_RAD, TURN_RAD] {
        let jump = Jump { at_north_m: 8.0, turn_rad: -turned_rad, ..NONE };
        let field = Field { pillars_from_m: 11.0, turned_rad, ..ALL };
        assert_no_worse(field, &[jump], 3.0, "heading put right");
    }
}

/// A heading that becomes wrong by 30 degrees in flight makes the path longer, but the beacon is reached.
#[test]
fn a_heading_that_is_right_and_becomes_wrong_bends_the_way_to_the_beacon() {
    for turn_rad in [-TURN_RAD, TURN_RAD] {
        let jump = Jump { at_north_m: 14.5, turn_rad, ..NONE };
        let field = Field { pillars_to_m: 14.0, ..ALL };
        // A spiral towards the beacon, 30 degrees off all the way, is longer by 15 %, here 2 m; and it overshoots,
        // once more in one of 16 flights, beside PX4 (7.3 m in all).
        assert_no_worse(field, &[jump], 8.0, "heading put wrong");
    }
}

/// A jump makes the vehicle brake within half a second and continue, and the autopilot accepts every setpoint.
#[test]
fn a_jump_makes_it_stop_for_half_a_second_and_the_setpoints_stay_in_the_mode() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        let now_us = stand.trial.autopilot_us();
        stand.trial.rig.autopilot.jump(now_us, [3.0, -4.0, 0.0], false);
        let from = stand.steps.len();
        stand.run(0.5);
        let setpoints = stand.steps[from..].iter().flat_map(Step::setpoints);
        let last = setpoints.last().unwrap();
        assert!(last.vx.hypot(last.vy) < 0.2, "it brakes: {last:?}");
        stand.run(2.0);
        assert_eq!(stand.stream_now(), Stream::Moving);
        assert!(stand.steps[from..].iter().all(|step| step.obeyed));
    }
}
