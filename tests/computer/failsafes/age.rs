//! A setpoint on the line is never older than its limit, and no setpoint moves after the mode was left.

use std::collections::VecDeque;

use foxhound_link::dialect::SET_POSITION_TARGET_LOCAL_NED_DATA;
use foxhound_sim::autopilot::{Start, Wire};
use foxhound_sim::drive::trial::{Clocks, Step};
use foxhound_sim::scenario::Software;
use foxhound_sim::world::random::Random;

use super::stand::{BOTH, STANDS_MPS, Stand, is_zero, manual};

/// `setpoint_age_max_s`, and a period of the stream.
const OLDEST_US: u64 = 250_000 + 50_000;
const HEARTBEAT_US: u64 = 1_000_000;

/// Properties of a setpoint that do not depend on the rotation between the autopilot's frame and ours: horizontal
/// speed, vertical speed, yaw rate. A restart and a jump may rotate it.
fn parts(setpoint: &SET_POSITION_TARGET_LOCAL_NED_DATA) -> [f32; 3] {
    [setpoint.vx.hypot(setpoint.vy), setpoint.vz, setpoint.yaw_rate]
}

fn are_same(a: [f32; 3], b: [f32; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6)
}

/// Number of moving setpoints; each is one that guidance published recently.
fn count_checked(steps: &[Step]) -> usize {
    let mut published: VecDeque<(u64, [f32; 3])> = VecDeque::new();
    let mut moving = 0;
    for step in steps {
        if let Some(output) = step.output {
            let [vx, vy, vz] = [
                output.setpoint.velocity_ned_mps.north,
                output.setpoint.velocity_ned_mps.east,
                output.setpoint.velocity_ned_mps.down,
            ];
            let yaw_rate = output.setpoint.yaw_rate_radps;
            let setpoint = SET_POSITION_TARGET_LOCAL_NED_DATA { vx, vy, vz, yaw_rate, ..Default::default() };
            published.push_back((step.time_us, parts(&setpoint)));
        }
        while published.front().is_some_and(|(at_us, _)| at_us + OLDEST_US < step.time_us) {
            published.pop_front();
        }
        for setpoint in step.setpoints().filter(|setpoint| !is_zero(setpoint)) {
            let is_known = published.iter().any(|(_, published)| are_same(*published, parts(setpoint)));
            assert!(is_known, "at {} s: {setpoint:?}", step.time_s());
            moving += 1;
        }
    }
    moving
}

/// Something goes wrong for a while, then nothing for a while, again and again.
fn fly_with_random_faults(software: Software, seed: u64) -> Stand {
    let mut stand = Stand::with(software, Start::Hovering, Clocks::default(), seed);
    let mut random = Random::new(seed, 0xfa17);
    stand.run(2.0);
    while stand.trial.time_us() < 60_000_000 {
        stand.trial.give_control();
        stand.run(2.0 + 3.0 * random.uniform());
        let now_us = stand.trial.autopilot_us();
        let trial = &mut stand.trial;
        match (random.uniform() * 9.0) as u32 {
            0 => trial.computer_stands_still = true,
            1 => trial.ownship_is_silent = true,
            2 => trial.obstacles_are_silent = true,
            3 => trial.rig.autopilot.faults.heartbeat_is_silent = true,
            4 => trial.rig.autopilot.faults.is_silent = true,
            5 => trial.wire = Some(Wire::new(seed, 0.01 * random.uniform(), 0.01 * random.uniform())),
            6 => assert!(trial.rig.autopilot.select_mode(now_us, manual(software))),
            7 => trial.rig.autopilot.jump(now_us, [5.0 * random.uniform(), -3.0, 0.0], random.uniform() < 0.5),
            _ => trial.rig.autopilot.reboot(now_us, 500_000),
        }
        stand.run(0.1 + 3.0 * random.uniform());
        let trial = &mut stand.trial;
        (trial.computer_stands_still, trial.ownship_is_silent, trial.obstacles_are_silent) = (false, false, false);
        (trial.rig.autopilot.faults.heartbeat_is_silent, trial.rig.autopilot.faults.is_silent) = (false, false);
        trial.wire = None;
        let now_us = trial.autopilot_us();
        if !trial.rig.autopilot.armed {
            stand.run(1.0);
            stand.trial.rig.autopilot.arm(now_us);
        }
        // A pilot who looks after his vehicle.
        if random.uniform() < 0.5 {
            let now_us = stand.trial.autopilot_us();
            stand.trial.rig.autopilot.select_mode(now_us, manual(software));
            stand.run(1.5);
        }
    }
    stand
}

/// Whatever goes wrong, every setpoint that moves is younger than its limit.
#[test]
fn whatever_goes_wrong_every_setpoint_was_published_within_its_limit_or_is_zero() {
    for software in BOTH {
        for seed in 1..=6 {
            let stand = fly_with_random_faults(software, seed);
            let moving = count_checked(&stand.steps);
            assert!(moving > 100, "{software:?}, seed {seed}: {moving} setpoints that move show something");
        }
    }
}

/// When guidance stops, its last setpoint is not repeated.
#[test]
fn a_guidance_that_stands_still_is_not_repeated() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        stand.trial.computer_stands_still = true;
        stand.run(0.9);
        stand.trial.computer_stands_still = false;
        let from = stand.steps.len();
        stand.run(2.0);
        count_checked(&stand.steps);
        let after: Vec<_> = stand.steps[from..].iter().flat_map(Step::setpoints).collect();
        assert!(after.len() > 35, "{}", after.len());
    }
}

/// From the first heartbeat after the pilot leaves the mode, no setpoint moves and the vehicle stands.
#[test]
fn from_the_next_heartbeat_after_the_mode_was_left_no_setpoint_moves_and_the_vehicle_stands() {
    for software in BOTH {
        let mut stand = Stand::under_way(software);
        let mut latest_us = 0;
        // At every phase of the heartbeat.
        for phase in 0..8_u32 {
            stand.run(0.3 + 0.12 * f64::from(phase));
            let (from, now_us) = (stand.steps.len(), stand.trial.autopilot_us());
            let left_us = stand.trial.time_us();
            assert!(stand.trial.rig.autopilot.select_mode(now_us, manual(software)));
            stand.run(2.6);
            for step in &stand.steps[from..] {
                if step.setpoints().any(|setpoint| !is_zero(setpoint)) {
                    latest_us = latest_us.max(step.time_us - left_us);
                }
            }
            assert!(stand.trial.motion().velocity_ned_mps.iter().all(|v| v.abs() < STANDS_MPS));
            assert!(stand.trial.give_control());
            stand.run(1.5);
            if stand.trial.to_source_m() < 3.0 {
                break;
            }
        }
        assert!(latest_us < HEARTBEAT_US, "{software:?}: still after {latest_us} us");
        assert!(latest_us > HEARTBEAT_US / 3, "{software:?}: the phases say something: {latest_us} us");
    }
}
