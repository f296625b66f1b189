//! Tests of guidance above the beacon: who walks by, and what was given up.

use super::*;
use crate::base::ned::Ned;
use crate::base::units::wrap_pi;
use crate::control::vehicle::Vehicle;
use crate::doa::bearing::{Flags, Quality};
use crate::landing::observation::{Nothing, Pad, PadObservation, Seen};
use crate::landing::{self, Stage};

const HEIGHT_M: f32 = 2.0;
/// Radius of a vehicle and of a person.
const APART_M: f32 = 0.45;

/// A vehicle above a beacon, with a camera.
struct Above {
    guidance: Guidance<64>,
    state: State<64>,
    vehicle: Vehicle,
    now: Instant,
    /// Neither obstacles nor the vehicle's position come any more.
    is_blind: bool,
}

impl Above {
    fn new() -> Self {
        let landing = Some(landing::Config { has_camera: true, ..landing::Config::default() });
        let guidance = Config { landing, ..Config::default() }.build::<64>().unwrap();
        let (state, now) = (guidance.start(), Instant(1_000_000));
        Self { guidance, state, vehicle: Vehicle::new(Horizontal::default(), 4, 0.45), now, is_blind: false }
    }

    /// A step of 20 ms with the beacon 0.3 m north of the origin, and the pad there too if it is seen.
    fn step(&mut self, sees_pad: bool, circles: &[Circle]) -> Output {
        let now = self.now;
        let level = |ned: Horizontal, down| Ned { north: ned.north, east: ned.east, down };
        let ownship = Ownship {
            position_time: now,
            position_ned_m: level(self.vehicle.position, -HEIGHT_M),
            velocity_ned_mps: level(self.vehicle.velocity, 0.0),
            attitude_time: now,
            yaw_rad: self.vehicle.yaw_rad,
            ..Ownship::default()
        };
        let away = Horizontal { north: 0.3, east: 0.0 }.minus(self.vehicle.position);
        let elevation_rad = libm::atan2f(HEIGHT_M, away.norm());
        let quality = Quality { wavenumber: libm::cosf(elevation_rad), ..Quality::default() };
        let bearing = Bearing {
            valid: true,
            azimuth_rad: wrap_pi(away.bearing_rad() - self.vehicle.yaw_rad),
            sigma_rad: 0.01,
            elevation_rad,
            elevation_sigma_rad: 0.05,
            ..Bearing::without(now, quality, Flags::default())
        };
        let (sin, cos) = self.vehicle.yaw_rad.sin_cos();
        let pad = Pad {
            forward: (cos * away.north + sin * away.east) / HEIGHT_M,
            right: (cos * away.east - sin * away.north) / HEIGHT_M,
            radius: 0.125,
            confidence: 1.0,
            is_cut: false,
        };
        let seen = if sees_pad { Seen::Pad(pad) } else { Seen::Nothing(Nothing::NoRegion) };
        let output = self.guidance.step(
            &mut self.state,
            &Input {
                front_end: FrontEnd::Bearing(bearing),
                ownship: (!self.is_blind).then_some(ownship),
                circles: (!self.is_blind).then_some(circles),
                height_m: Some(HEIGHT_M),
                look: now.0.is_multiple_of(100_000).then_some(PadObservation { time: now, seen }),
                control: Control::Granted,
                ..Input::at(now)
            },
        );
        self.vehicle.follow(&output.setpoint);
        self.now = now.plus_micros(20_000);
        output
    }
}

#[test]
fn who_walks_by_while_it_centres_or_searches_the_pad_is_given_way() {
    for (sees_pad, stage) in [(true, Stage::Centring), (false, Stage::SearchingPad)] {
        for (direction, offset) in (0..24).flat_map(|direction| (-3..=3).map(move |offset| (direction, offset))) {
            let velocity_ned_mps = Horizontal::from_bearing((15.0 * direction as f32 + 7.0).to_radians()).times(1.2);
            let across = Horizontal { north: velocity_ned_mps.east, east: -velocity_ned_mps.north };
            let from = velocity_ned_mps.times(-3.0).plus(across.times(0.083 * offset as f32));
            let mut above = Above::new();
            let met =
                (0..1500).find(|_| above.step(sees_pad, &[]).landing.is_some_and(|landing| landing.stage == stage));
            assert!(met.is_some(), "{stage:?}");
            let begin = above.vehicle.position;
            for step in 0..300 {
                let center_ned_m = begin.plus(from).plus(velocity_ned_mps.times(0.02 * step as f32));
                above.step(sees_pad, &[Circle { center_ned_m, radius_m: 0.3, velocity_ned_mps }]);
                let clear_m = above.vehicle.position.minus(center_ned_m).norm() - APART_M;
                assert!(clear_m > 0.0, "{stage:?}, from {direction}, {offset} aside: {clear_m} m");
            }
        }
    }
}

#[test]
fn on_the_ground_it_moves_for_nobody() {
    let mut above = Above::new();
    let is_at = |stage: Stage, output: &Output| output.landing.is_some_and(|landing| landing.stage == stage);
    assert!((0..1500).any(|_| is_at(Stage::Centring, &above.step(true, &[]))));
    above.state.arrival.landing.put_down(above.now);
    let feet_ned_m = above.vehicle.position;
    for step in 0..200 {
        let center_ned_m = feet_ned_m.plus(Horizontal { north: 2.5 - 0.02 * step as f32, east: 0.1 });
        let velocity_ned_mps = Horizontal { north: -1.0, east: 0.0 };
        let output = above.step(true, &[Circle { center_ned_m, radius_m: 0.3, velocity_ned_mps }]);
        assert!(is_at(Stage::Landed, &output) && output.outcome == Outcome::Landed, "{output:?}");
        let Ned { north, east, down } = output.setpoint.velocity_ned_mps;
        assert_eq!((north, east, output.setpoint.yaw_rate_radps), (0.0, 0.0, 0.0));
        // The autopilot has not seen the ground yet.
        assert!(down > 0.0 || step < 2, "{step}: {down}");
    }
}

#[test]
fn on_the_ground_it_is_told_to_sink_with_whatever_is_stale() {
    let mut above = Above::new();
    let is_at = |stage: Stage, output: &Output| output.landing.is_some_and(|landing| landing.stage == stage);
    assert!((0..1500).any(|_| is_at(Stage::Centring, &above.step(true, &[]))));
    above.state.arrival.landing.put_down(above.now);
    above.is_blind = true;
    for step in 0..200 {
        let output = above.step(true, &[]);
        assert_eq!(output.outcome, Outcome::Landed, "{step}");
        let Ned { north, east, down } = output.setpoint.velocity_ned_mps;
        assert!((north, east) == (0.0, 0.0) && (down > 0.0 || step < 2), "{step}: {:?}", output.setpoint);
    }
}

#[test]
fn what_was_given_up_is_not_begun_again_by_what_looks_like_a_reflection_later() {
    let mut above = Above::new();
    above.state.mission.give_up();
    assert_eq!(above.step(false, &[]).outcome, Outcome::GoalUnreachable);
    above.state.belief.suppose_reflections();
    for _ in 0..100 {
        assert_eq!(above.step(false, &[]).outcome, Outcome::GoalUnreachable);
    }
}

#[test]
fn what_was_given_up_is_not_begun_again_when_the_pad_comes_into_view() {
    let mut above = Above::new();
    // Nothing answers its requests for plans, so that it gives up where it is.
    above.state.mission.give_up();
    for _ in 0..500 {
        let output = above.step(true, &[]);
        assert_eq!((output.outcome, output.landing.map(|landing| landing.stage)), (Outcome::GoalUnreachable, None));
    }
}
