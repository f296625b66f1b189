//! Tests of the stage machine: signs, rows of the table, limits, and flights of a small model.

mod fixes;
mod flights;
mod fuzz;
mod model;
mod table;

use core::mem::size_of;

use super::observation::{Bad, Pad, PadObservation, Seen};
use super::*;
use crate::doa::bearing::Bearing;
use crate::localize::source::near;

pub(super) const TICK_US: u64 = 20_000;

/// The landing behind the belief's filter of the last metres, as guidance calls them.
pub(super) struct Landing {
    lander: Lander,
}

/// The state of both.
#[derive(Default)]
pub(super) struct Memory {
    pub(super) landing: State,
    near: near::State,
    poses: Poses,
}

/// What both are told in a step.
pub(super) struct Told<'a> {
    pub(super) now: Instant,
    pub(super) ownship: Option<&'a Ownship>,
    pub(super) height_m: Option<f32>,
    pub(super) bearing: Option<&'a Bearing>,
    pub(super) estimate: Option<&'a Estimate>,
    pub(super) look: Option<PadObservation>,
    pub(super) is_landed: bool,
    pub(super) is_blocked: bool,
    pub(super) clearance_m: f32,
    pub(super) tick_s: f32,
}

impl Landing {
    pub(super) fn new(config: Config) -> Self {
        Self { lander: config.build(2.0).unwrap() }
    }

    pub(super) fn step(&self, state: &mut Memory, told: &Told<'_>) -> Output {
        let Told { now, ownship, height_m, bearing, estimate, look, is_landed, is_blocked, clearance_m, tick_s } =
            *told;
        let fix = fresh(ownship, now).and_then(|ownship| {
            if let Some(jump) = state.poses.note(ownship) {
                state.near.shift(jump);
                state.landing.shift(jump);
            }
            let pose = FullPose::carried(ownship, now);
            let height_m = plausible_height_m(height_m);
            if let Some(bearing) = bearing {
                let pose = state.poses.at(bearing.time).unwrap_or(pose);
                state.near.hear(bearing, &pose, height_m);
            }
            if let Some(estimate) = estimate {
                state.near.suggest(estimate, &pose, height_m);
            }
            state.near.fix(now, pose.place_ned_m)
        });
        let poses = &state.poses;
        let input =
            Input { now, ownship, height_m, poses, fix, estimate, look, is_landed, is_blocked, clearance_m, tick_s };
        self.lander.step(&mut state.landing, &input)
    }
}

/// A vehicle that hovers.
fn hovering(micros: u64, place: Ned, yaw_rad: f32) -> Ownship {
    Ownship {
        position_time: Instant(micros),
        attitude_time: Instant(micros),
        position_ned_m: place,
        yaw_rad,
        ..Ownship::default()
    }
}

pub(super) fn nothing(micros: u64) -> Told<'static> {
    Told {
        now: Instant(micros),
        ownship: None,
        height_m: None,
        bearing: None,
        estimate: None,
        look: None,
        is_landed: false,
        is_blocked: false,
        clearance_m: f32::INFINITY,
        tick_s: 0.02,
    }
}

fn pad(forward: f32, right: f32, radius: f32) -> Pad {
    Pad { forward, right, radius, confidence: 0.9, is_cut: false }
}

#[test]
fn the_state_is_small() {
    assert!(size_of::<State>() <= 700, "{}", size_of::<State>());
    assert!(size_of::<Option<Output>>() <= 64, "{}", size_of::<Option<Output>>());
}

/// Flies a lander with a hovering vehicle that sees the pad from the first step on, for `seconds`; returns the last
/// output.
fn shown(place: Ned, yaw_rad: f32, seen: impl Fn(u64) -> Option<Seen>, seconds: f32) -> Output {
    shown_late(place, yaw_rad, seen, seconds, 0)
}

#[test]
fn a_pad_that_is_not_the_beacon_s_tells_no_height_and_is_no_target_once_it_is_out_of_sight() {
    let lander = Landing::new(Config { has_camera: true, ..Config::default() });
    for beside_m in [0.0, 8.0] {
        let estimate = Estimate { covariance_m2: [0.1, 0.0, 0.1], ..Estimate::default() };
        let (mut state, mut targets) = (Memory::default(), std::vec::Vec::new());
        for tick in 0..300 {
            let micros = 10_000_000 + tick * TICK_US;
            let ownship = hovering(micros, Ned { north: beside_m, east: 0.0, down: -3.0 }, 0.0);
            let is_seen = tick < 100 && tick % 5 == 0;
            let seen = Seen::Pad(pad(0.0, 0.0, 0.25 / 3.0));
            let look = is_seen.then_some(PadObservation { time: Instant(micros), seen });
            let input = Told { ownship: Some(&ownship), estimate: Some(&estimate), look, ..nothing(micros) };
            targets.push(lander.step(&mut state, &input).target.is_some_and(|target| target.is_pad));
        }
        let is_beacon_s = beside_m == 0.0;
        assert_eq!(
            (state.landing.height_m(-3.0).is_some(), targets[99], targets[299]),
            (is_beacon_s, true, is_beacon_s)
        );
    }
}

/// The same with delayed detections.
fn shown_late(place: Ned, yaw_rad: f32, seen: impl Fn(u64) -> Option<Seen>, seconds: f32, late_us: u64) -> Output {
    let lander = Landing::new(Config { has_camera: true, ..Config::default() });
    let estimate = Estimate { covariance_m2: [0.1, 0.0, 0.1], ..Estimate::default() };
    let mut state = Memory::default();
    let mut output = Output::default();
    for tick in 0..(seconds * 50.0) as u64 {
        let micros = 10_000_000 + tick * TICK_US;
        let ownship = hovering(micros, place, yaw_rad);
        let look = seen(tick).map(|seen| PadObservation { time: Instant(micros - late_us), seen });
        let input = Told { ownship: Some(&ownship), estimate: Some(&estimate), look, ..nothing(micros) };
        output = lander.step(&mut state, &input);
    }
    output
}

#[test]
fn a_pad_ahead_of_a_nose_to_the_east_is_to_the_east() {
    let east = core::f32::consts::FRAC_PI_2;
    let at = Ned { down: -2.0, ..Ned::default() };
    for (yaw_rad, forward, right, expected) in [
        (0.0, 0.4, 0.0, (1.0, 0.0)),
        (0.0, 0.0, 0.4, (0.0, 1.0)),
        (east, 0.4, 0.0, (0.0, 1.0)),
        (east, 0.0, 0.4, (-1.0, 0.0)),
        (-east, 0.4, 0.0, (0.0, -1.0)),
    ] {
        let output = shown(at, yaw_rad, |_| Some(Seen::Pad(pad(forward, right, 0.125))), 2.0);
        let (velocity, down_mps) = output.demand.unwrap();
        assert_eq!(output.stage, Stage::Centring);
        let along = velocity.north * expected.0 + velocity.east * expected.1;
        let across = velocity.north * expected.1 - velocity.east * expected.0;
        assert!(along > 0.3 && across.abs() < 0.02 && down_mps == 0.0, "{yaw_rad} {forward} {right}: {output:?}");
        let target = output.target.unwrap();
        assert!(target.is_pad && (target.place_ned_m.down - 0.0).abs() < 0.1, "{target:?}");
        let place = target.place_ned_m.horizontal();
        assert!(
            place.minus(Horizontal { north: 0.8 * expected.0, east: 0.8 * expected.1 }).norm() < 0.05,
            "{target:?}"
        );
    }
}

#[test]
fn right_above_the_pad_it_goes_down() {
    let at = Ned { down: -2.0, ..Ned::default() };
    let output = shown(at, 1.0, |_| Some(Seen::Pad(pad(0.0, 0.0, 0.125))), 3.0);
    assert_eq!(output.stage, Stage::Descending);
    let (velocity, down_mps) = output.demand.unwrap();
    assert!(velocity.norm() < 0.02 && down_mps > 0.3, "{output:?}");
}

#[test]
fn looks_that_are_too_old_or_no_numbers_are_as_good_as_none() {
    let at = Ned { down: -2.0, ..Ned::default() };
    let ahead = pad(0.2, 0.0, 0.125);
    let good = |_| Some(Seen::Pad(ahead));
    assert_eq!(shown_late(at, 0.0, good, 2.0, 150_000).stage, Stage::Centring);
    assert_eq!(shown_late(at, 0.0, good, 2.0, 600_000).stage, Stage::Seeking);
    for wild in [
        Pad { forward: f32::NAN, ..ahead },
        Pad { right: f32::INFINITY, ..ahead },
        Pad { forward: 8.0, ..ahead },
        Pad { radius: f32::NAN, ..ahead },
        Pad { radius: -0.1, ..ahead },
        Pad { confidence: f32::NAN, ..ahead },
        Pad { confidence: 0.0, ..ahead },
    ] {
        let output = shown(at, 0.0, |_| Some(Seen::Pad(wild)), 2.0);
        assert!(output.stage == Stage::Seeking && output.demand.is_none(), "{wild:?}: {output:?}");
    }
}

#[test]
fn bad_frames_in_the_descent_hold_the_height() {
    let at = Ned { down: -2.0, ..Ned::default() };
    for bad in [Bad::Size, Bad::Line, Bad::Order, Bad::Cut, Bad::Flat] {
        let output =
            shown(at, 0.0, |tick| Some(if tick < 100 { Seen::Pad(pad(0.0, 0.0, 0.125)) } else { Seen::Bad(bad) }), 3.0);
        let (velocity, down_mps) = output.demand.unwrap();
        assert!(output.stage == Stage::Centring && velocity.norm() < 0.02 && down_mps == 0.0, "{bad:?}: {output:?}");
    }
}
