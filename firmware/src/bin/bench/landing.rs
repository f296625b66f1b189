//! The row of the landing with the belief's fix of the last metres: their worst step, from the first bearing to the
//! ground.

use core::hint::black_box;

use crate::halt;
use foxhound_core::base::history::{FullPose, Poses};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::{Horizontal, Ned};
use foxhound_core::base::ownship::Ownship;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::sin_cos;
use foxhound_core::doa::bearing::{Bearing, Flags, Quality};
use foxhound_core::landing::observation::{Pad, PadObservation, Seen};
use foxhound_core::landing::{Config, Input, Stage, State};
use foxhound_core::localize::source::near;

use crate::row;

const TICK_S: f32 = 0.02;
/// Five detections a second, each a tenth of a second old.
const LOOK_TICKS: u32 = 10;
const STEPS_MAX: u32 = 6_000;

/// A vehicle that follows commands at once comes from three metres aside and down onto the pad, with a bearing in
/// each step.
#[inline(never)]
pub fn rows(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let config = Config { has_camera: true, ..Config::default() };
    let Ok(lander) = config.build(2.0) else { halt(format_args!("the lander does not build")) };
    let (mut state, mut near, mut poses, mut worst) = (State::default(), near::State::default(), Poses::default(), 0);
    let mut place = Ned { north: -3.0, east: 0.5, down: -3.0 };
    let mut velocity = Ned::default();
    for step in 1..STEPS_MAX {
        let now = Instant(u64::from(step) * 20_000);
        let ownship = Ownship {
            position_time: now,
            position_ned_m: place,
            velocity_ned_mps: velocity,
            attitude_time: now,
            roll_rad: 0.02,
            pitch_rad: -0.03,
            yaw_rad: 0.4,
            ..Ownship::default()
        };
        let [forward, right, down] =
            ownship.vector_to_body(Ned { north: -place.north, east: -place.east, down: -place.down });
        let level = sqrt(forward * forward + right * right);
        let range = sqrt(level * level + down * down);
        let bearing = Bearing {
            time: now,
            valid: true,
            azimuth_rad: Horizontal { north: forward, east: right }.bearing_rad(),
            sigma_rad: 0.01,
            elevation_rad: Horizontal { north: level, east: down }.bearing_rad(),
            elevation_sigma_rad: 0.02,
            quality: Quality { wavenumber: level / range, ..Quality::default() },
            flags: Flags::default(),
        };
        let pad =
            Pad { forward: forward / down, right: right / down, radius: 0.25 / down, confidence: 1.0, is_cut: false };
        let is_in_sight = down > 0.1 && pad.forward.abs() < 0.4 && pad.right.abs() < 0.55;
        let look =
            (step % LOOK_TICKS == 0 && is_in_sight).then_some(PadObservation { time: now, seen: Seen::Pad(pad) });
        let height_m = Some(-place.down);
        let mut advice = None;
        worst = worst.max(measure(&mut || {
            let ownship = black_box(&ownship);
            poses.note(ownship);
            let pose = FullPose::carried(ownship, now);
            near.hear(&bearing, &poses.at(now).unwrap_or(pose), height_m);
            let input = Input {
                now,
                ownship: Some(ownship),
                height_m,
                poses: &poses,
                fix: near.fix(now, pose.place_ned_m),
                estimate: None,
                look,
                is_landed: place.down >= 0.0,
                is_blocked: false,
                clearance_m: f32::INFINITY,
                tick_s: TICK_S,
            };
            advice = Some(lander.step(&mut state, black_box(&input)));
        }));
        let Some(advice) = advice else { break };
        if advice.stage == Stage::Landed {
            row("landing_step", worst, 5_000);
            return;
        }
        // The planner, until there is a demand.
        let (sin, cos) = sin_cos(Horizontal { north: -place.north, east: -place.east }.bearing_rad());
        let (horizontal, down_mps) = advice.demand.unwrap_or_default();
        let sought = if advice.demand.is_none() { 0.5 } else { 0.0 };
        velocity = Ned { north: horizontal.north + sought * cos, east: horizontal.east + sought * sin, down: down_mps };
        place = Ned {
            north: place.north + TICK_S * velocity.north,
            east: place.east + TICK_S * velocity.east,
            down: if place.down + TICK_S * velocity.down < 0.0 { place.down + TICK_S * velocity.down } else { 0.0 },
        };
    }
    halt(format_args!("it does not land: {:?}", state.stage()))
}
