//! The vehicle: velocity and yaw-rate commands in, motion out. NED, metres, seconds.
//!
//! - *Point*: a point mass whose velocity follows the command with a first-order lag and an acceleration limit.
//! - *Measured*: a real autopilot in simulation under velocity setpoints, ArduCopter in GUIDED or PX4 in OFFBOARD. In
//!   the plane the autopilot's own structure at its default gains (`shaping`, [`super::deviation`]), with two
//!   numbers fitted to recordings of `examples/step_response.py`: the lag of the lean, and the drag of the air, in
//!   proportion to the speed. `tests/flight/step_response.rs` flies the recordings again. Vertically a critically damped
//!   second order after a dead time, `v'' = w^2 (v_cmd - v) - 2 w v'`, measured on ArduCopter. It yaws as recorded
//!   (`yaw`), and tilts with its thrust.
//!
//! The wind moves the point mass away from its path as if that autopilot flew it.

use std::collections::VecDeque;

use super::air::Push;
use super::deviation::{Deviation, Wanted};
use super::geometry::{Horizontal, Pose, wrap_pi};
use super::shaping::Shaping;
use super::yaw::Yaw;
use crate::scenario;

/// A command to the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Velocity, NED.
    pub velocity_ned_mps: [f64; 3],
    /// Yaw rate, clockwise positive.
    pub yaw_rate_radps: f64,
    /// Whether this is the autopilot's own brake, not a setpoint.
    pub is_brake: bool,
}

/// Position and motion of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Position and attitude.
    pub pose: Pose,
    /// Velocity, NED.
    pub velocity_ned_mps: [f64; 3],
    /// Acceleration, NED, without gravity.
    pub acceleration_ned_mps2: [f64; 3],
    /// Yaw rate.
    pub yaw_rate_radps: f64,
}

impl Motion {
    /// The same motion at another position.
    #[must_use]
    pub fn displaced(mut self, by: Horizontal) -> Self {
        self.pose.position_ned_m[0] += by.north;
        self.pose.position_ned_m[1] += by.east;
        self
    }
}

/// A vehicle in flight.
#[derive(Clone, Debug)]
pub struct Vehicle {
    config: scenario::Vehicle,
    a_max_mps2: f64,
    /// Where it is now.
    pub motion: Motion,
    /// The push of the air.
    pub push: Push,
    /// Where it stands on the ground, if it does.
    touched_m: Option<[f64; 2]>,
    /// The deviation of the point mass by the push; the whole motion of the measured vehicle.
    deviation: Deviation,
    shaping: Shaping,
    yaw: Yaw,
    time_s: f64,
    /// Setpoints that have not taken effect yet, with their times.
    underway: VecDeque<(f64, Command)>,
    command: Command,
    /// The newest of them, which acts in the plane.
    latest: Command,
}

/// Delay of setpoints of the vertical velocity, and of the autopilot's own brake.
const SETPOINT_DELAY_S: f64 = 0.22;
const BRAKE_DELAY_S: f64 = 0.06;
/// Deceleration by the air, per m/s.
const DRAG_PER_S: f64 = 0.32;
const VERTICAL_RATE_RADPS: f64 = 8.0;
const POINT_YAW_LAG_S: f64 = 0.05;
const POINT_YAW_RATE_MAX_RADPS: f64 = 3.5;
const SUBSTEP_S: f64 = 0.002;
/// Commanded to climb faster than this, it leaves the ground.
const RISING_MPS: f64 = 0.02;
const GRAVITY_MPS2: f64 = 9.81;

impl Vehicle {
    /// A vehicle at rest.
    #[must_use]
    pub fn new(config: scenario::Vehicle, a_max_mps2: f64, pose: Pose) -> Self {
        Self {
            config,
            a_max_mps2,
            motion: Motion { pose, ..Motion::default() },
            push: Push::default(),
            deviation: Deviation::default(),
            shaping: Shaping::default(),
            yaw: Yaw::default(),
            touched_m: None,
            time_s: 0.0,
            underway: VecDeque::new(),
            command: Command::default(),
            latest: Command::default(),
        }
    }

    /// Flies on for `step_s` under a command.
    pub fn step(&mut self, command: Command, step_s: f64) {
        self.accept(command);
        let end_s = self.time_s + step_s;
        let substeps = libm::ceil(step_s / SUBSTEP_S - 1e-9).max(1.0);
        let dt = step_s / substeps;
        for _ in 0..substeps as usize {
            while let Some((_, command)) = self.underway.pop_front_if(|(at_s, _)| *at_s <= self.time_s) {
                self.command = command;
            }
            match self.config.model {
                scenario::VehicleModel::Point => self.point(dt),
                scenario::VehicleModel::Arducopter => self.measured(dt),
            }
            self.time_s += dt;
        }
        self.time_s = end_s;
    }

    /// The ground at height zero is hard, and the vehicle does not slide on it. Returns the speed of a touchdown, if
    /// there is one.
    pub fn touch_ground(&mut self) -> Option<f64> {
        let motion = &mut self.motion;
        let [north_m, east_m, down_m] = motion.pose.position_ned_m;
        let [.., down_mps] = motion.velocity_ned_mps;
        let is_told_to_rise = self.command.velocity_ned_mps[2] < -RISING_MPS;
        if is_told_to_rise || (down_m < 0.0 && self.touched_m.is_none()) {
            self.touched_m = None;
            return None;
        }
        let [north_m, east_m] = *self.touched_m.get_or_insert([north_m, east_m]);
        motion.pose.position_ned_m = [north_m, east_m, 0.0];
        motion.velocity_ned_mps = [0.0; 3];
        motion.acceleration_ned_mps2 = [0.0; 3];
        if self.config.model == scenario::VehicleModel::Arducopter {
            (self.deviation, self.shaping) = (Deviation::default(), Shaping::default());
        }
        Some(down_mps)
    }

    fn accept(&mut self, command: Command) {
        self.latest = command;
        let delay_s = match (self.config.model, command.is_brake) {
            (scenario::VehicleModel::Point, _) => {
                self.command = command;
                return;
            }
            (scenario::VehicleModel::Arducopter, false) => SETPOINT_DELAY_S,
            (scenario::VehicleModel::Arducopter, true) => BRAKE_DELAY_S,
        };
        self.yaw.accept(self.config.autopilot, command.yaw_rate_radps, self.time_s);
        let latest = self.underway.back().map_or(self.command, |(_, latest)| *latest);
        if command != latest {
            self.underway.push_back((self.time_s + delay_s, command));
        }
    }

    fn point(&mut self, dt: f64) {
        let calm_ned_mps = self.calm_ned_mps();
        let motion = &mut self.motion;
        let lag_s = self.config.lag_s.max(dt);
        for (axis, calm_mps) in calm_ned_mps.into_iter().enumerate() {
            let wanted = (self.command.velocity_ned_mps[axis] - calm_mps) / lag_s;
            motion.acceleration_ned_mps2[axis] = wanted;
        }
        limit(&mut motion.acceleration_ned_mps2, self.a_max_mps2);
        let [north, east, down] = motion.acceleration_ned_mps2;
        let blown = self.deviation.step(self.config.autopilot, Wanted::default(), self.push.gust, dt);
        self.advance([north + blown.north, east + blown.east, down], dt);
        let most_radps = POINT_YAW_RATE_MAX_RADPS;
        let wanted_radps = self.command.yaw_rate_radps.clamp(-most_radps, most_radps);
        let rate_radps = self.motion.yaw_rate_radps;
        self.turn(rate_radps + dt / POINT_YAW_LAG_S * (wanted_radps - rate_radps), dt);
    }

    fn measured(&mut self, dt: f64) {
        let [north, east, _] = self.latest.velocity_ned_mps;
        let commanded_mps = Horizontal { north, east };
        let wanted = match self.config.autopilot {
            scenario::Software::ArduCopter => self.shaping.step(commanded_mps, dt),
            scenario::Software::Px4 => Wanted { velocity_mps: commanded_mps, ..Wanted::default() },
        };
        let push_mps2 = self.push.gust.along(self.deviation.velocity_mps(), -DRAG_PER_S);
        let plane_mps2 = self.deviation.step(self.config.autopilot, wanted, push_mps2, dt);
        let motion = &mut self.motion;
        let error_mps = self.command.velocity_ned_mps[2] - motion.velocity_ned_mps[2];
        let jerk = VERTICAL_RATE_RADPS * (VERTICAL_RATE_RADPS * error_mps - 2.0 * motion.acceleration_ned_mps2[2]);
        let down_mps2 = motion.acceleration_ned_mps2[2] + jerk * dt;
        let acceleration_ned_mps2 = [plane_mps2.north, plane_mps2.east, down_mps2];
        motion.acceleration_ned_mps2 = acceleration_ned_mps2;
        self.advance(acceleration_ned_mps2, dt);
        let rate_radps = self.yaw.step(self.config.autopilot, self.motion.yaw_rate_radps, self.time_s, dt);
        self.turn(rate_radps, dt);
        self.tilt();
    }

    /// The point mass's velocity without wind.
    fn calm_ned_mps(&self) -> [f64; 3] {
        let (blown, [north, east, down]) = (self.deviation.velocity_mps(), self.motion.velocity_ned_mps);
        [north - blown.north, east - blown.east, down]
    }

    fn advance(&mut self, acceleration_ned_mps2: [f64; 3], dt: f64) {
        let motion = &mut self.motion;
        for (axis, acceleration_mps2) in acceleration_ned_mps2.into_iter().enumerate() {
            motion.pose.position_ned_m[axis] += dt * (motion.velocity_ned_mps[axis] + 0.5 * dt * acceleration_mps2);
            motion.velocity_ned_mps[axis] += dt * acceleration_mps2;
        }
    }

    fn turn(&mut self, rate_radps: f64, dt: f64) {
        let motion = &mut self.motion;
        motion.yaw_rate_radps = rate_radps;
        motion.pose.yaw_rad = wrap_pi(motion.pose.yaw_rad + dt * rate_radps);
    }

    /// Thrust leans into the acceleration, and against the air.
    fn tilt(&mut self) {
        let motion = &mut self.motion;
        // The lean against the mean is there from the beginning.
        let steady = self.push.whole.minus(self.push.gust);
        let lean_mps2 = self.deviation.lean_mps2();
        let Horizontal { north, east } = lean_mps2.minus(steady);
        let (sine, cosine) = (libm::sin(motion.pose.yaw_rad), libm::cos(motion.pose.yaw_rad));
        let (forward, right) = (north * cosine + east * sine, east * cosine - north * sine);
        motion.pose.pitch_rad = -libm::atan(forward / GRAVITY_MPS2);
        motion.pose.roll_rad = libm::atan(right / GRAVITY_MPS2);
    }
}

fn limit(vector: &mut [f64; 3], length: f64) {
    let norm = libm::sqrt(vector.iter().map(|x| x * x).sum());
    if norm > length {
        vector.iter_mut().for_each(|x| *x *= length / norm);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::VehicleModel;

    fn vehicle(model: VehicleModel) -> Vehicle {
        Vehicle::new(scenario::Vehicle { model, ..scenario::Vehicle::default() }, 2.0, Pose::default())
    }

    fn north(speed: f64) -> Command {
        Command { velocity_ned_mps: [speed, 0.0, 0.0], ..Command::default() }
    }

    /// First time at which `reached` is true, flying under `command`.
    fn time_until(vehicle: &mut Vehicle, command: Command, reached: impl Fn(&Motion) -> bool) -> f64 {
        let start_s = vehicle.time_s;
        while !reached(&vehicle.motion) {
            vehicle.step(command, 0.002);
            assert!(vehicle.time_s < start_s + 20.0);
        }
        vehicle.time_s - start_s
    }

    #[test]
    fn arducopter_brakes_after_a_time_out_as_the_real_one() {
        // Measured from the time-out, 3.0 s after the last setpoint: 0.85 m/s at 3.38 s, 0.15 m/s at 4.05 s, 0.67 m.
        let mut vehicle = vehicle(VehicleModel::Arducopter);
        for _ in 0..200 {
            vehicle.step(north(1.0), 0.05);
        }
        let from_m = vehicle.motion.pose.position_ned_m[0];
        let brake = Command { is_brake: true, ..Command::default() };
        let t85 = time_until(&mut vehicle, brake, |motion| motion.velocity_ned_mps[0] <= 0.85);
        let t15 = t85 + time_until(&mut vehicle, brake, |motion| motion.velocity_ned_mps[0] <= 0.15);
        assert!((t85 - 0.375).abs() < 0.05, "85 % after {t85} s");
        assert!((t15 - 1.053).abs() < 0.05, "15 % after {t15} s");
        for _ in 0..100 {
            vehicle.step(brake, 0.05);
        }
        let braking_m = vehicle.motion.pose.position_ned_m[0] - from_m;
        assert!((braking_m - 0.668).abs() < 0.067, "{braking_m} m");
    }

    #[test]
    fn arducopter_climbs_as_far_as_the_real_one() {
        // -0.5 m/s for 4 s: 1.81 m, at 0.494 m/s then.
        let mut vehicle = vehicle(VehicleModel::Arducopter);
        for _ in 0..80 {
            vehicle.step(Command { velocity_ned_mps: [0.0, 0.0, -0.5], ..Command::default() }, 0.05);
        }
        assert!((vehicle.motion.pose.position_ned_m[2] + 1.81).abs() < 0.05);
        assert!((vehicle.motion.velocity_ned_mps[2] + 0.5).abs() < 0.015);
    }

    #[test]
    fn arducopter_leans_into_its_acceleration() {
        let mut vehicle = vehicle(VehicleModel::Arducopter);
        for _ in 0..25 {
            vehicle.step(north(2.0), 0.02);
        }
        assert!(vehicle.motion.pose.pitch_rad < -0.1, "nose down to accelerate forwards");
        assert!(vehicle.motion.pose.roll_rad.abs() < 1e-9);
    }

    #[test]
    fn arducopter_leans_against_the_wind_and_only_a_gust_moves_it() {
        let mut vehicle = vehicle(VehicleModel::Arducopter);
        let whole = Horizontal { north: -1.5, east: 0.0 };
        vehicle.push = Push { whole, ..Push::default() };
        vehicle.step(Command::default(), 1.0);
        let expected_rad = -(1.5_f64 / GRAVITY_MPS2).atan();
        assert!((vehicle.motion.pose.pitch_rad - expected_rad).abs() < 1e-9, "{}", vehicle.motion.pose.pitch_rad);
        assert_eq!(vehicle.motion.pose.position_ned_m[0], 0.0);
        vehicle.push.gust = whole;
        vehicle.step(Command::default(), 0.1);
        assert!(vehicle.motion.velocity_ned_mps[0] < -0.1);
        // It leans against that as well, after a while, and returns to where it was.
        for _ in 0..1500 {
            vehicle.step(Command::default(), 0.02);
        }
        assert!((vehicle.motion.pose.pitch_rad - expected_rad).abs() < 1e-3, "{}", vehicle.motion.pose.pitch_rad);
        assert!(vehicle.motion.pose.position_ned_m[0].abs() < 0.01, "{:?}", vehicle.motion.pose.position_ned_m);
    }

    #[test]
    fn the_point_mass_keeps_its_acceleration_limit_and_its_lag() {
        let mut vehicle = vehicle(VehicleModel::Point);
        let t = time_until(&mut vehicle, north(2.0), |motion| motion.velocity_ned_mps[0] >= 1.0);
        assert!((t - 0.5).abs() < 0.01, "at 2 m/s^2 1 m/s takes half a second, not {t} s");
        let mut small = self::vehicle(VehicleModel::Point);
        let t = time_until(&mut small, north(0.2), |motion| motion.velocity_ned_mps[0] >= 0.2 * 0.632_12);
        assert!((t - 0.15).abs() < 0.005, "63 % of a small step after the lag, not after {t} s");
    }

    #[test]
    fn yaw_follows_its_rate_clockwise() {
        for model in [VehicleModel::Point, VehicleModel::Arducopter] {
            let mut vehicle = vehicle(model);
            for _ in 0..100 {
                vehicle.step(Command { yaw_rate_radps: 0.5, ..Command::default() }, 0.02);
            }
            let yaw_rad = vehicle.motion.pose.yaw_rad;
            assert!(yaw_rad > 0.75 && yaw_rad < 1.0, "{yaw_rad}");
        }
    }
}
