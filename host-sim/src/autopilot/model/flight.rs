//! Commands to the vehicle: goals of a companion, and the autopilot's own flight.

use foxhound_link::dialect::SET_POSITION_TARGET_LOCAL_NED_DATA;

use super::Autopilot;
use crate::scenario::Software;
use crate::world::vehicle::{Command, Motion};
use crate::world::wrap_pi;

/// Higher than this it has left the ground.
const LIFTED_M: f64 = 0.3;
const GROUND_M: f64 = 0.02;
/// While it flies setpoints it takes itself for landed if they sink faster than this, and it has stood for so long.
const TOLD_MPS: f64 = 0.05;
const STANDS_US: u64 = 1_000_000;
const TOUCH_RATE: f64 = 1.5;
const TOUCH_SPEED_MPS: f64 = 0.05;
/// Speeds of its own flight. `LAND_SPEED` 0.5 m/s \[src\]; the others are of the order of both autopilots' defaults.
const LAND_SPEED_MPS: f64 = 0.5;
const CLIMB_SPEED_MPS: f64 = 1.0;
const CRUISE_SPEED_MPS: f64 = 5.0;
const HOME_M: f64 = 0.5;
const POSITION_GAIN: f64 = 1.0;
const YAW_GAIN: f64 = 2.0;
/// `ATC_SLEW_YAW`, 60 deg/s \[mem\].
const YAW_RATE_MAX_RADPS: f64 = 1.05;
/// `MAV_FRAME_LOCAL_NED`.
pub(super) const LOCAL_NED: u8 = 1;
/// The masks of velocity and yaw rate, and of velocity and yaw.
const YAW_RATE_MASK: u16 = 0x05C7;
const YAW_MASK: u16 = 0x09C7;

/// Behaviour of a mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Behaviour {
    /// Holds its position: position modes with centred sticks, empty missions.
    Hold,
    /// Follows the companion.
    Companion,
    TakeOff,
    Land,
    Return,
}

/// Where the nose turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Yaw {
    Rate(f64),
    Angle(f64),
}

impl Yaw {
    pub(super) fn is_finite(self) -> bool {
        let (Self::Rate(x) | Self::Angle(x)) = self;
        x.is_finite()
    }
}

/// A companion's request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Goal {
    pub(super) since_us: u64,
    pub(super) velocity_ned_mps: [f64; 3],
    pub(super) yaw: Yaw,
}

impl Goal {
    /// That of a setpoint, if it has one of the two forms that Foxhound sends.
    pub(super) fn of(since_us: u64, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) -> Option<Self> {
        let yaw = match (target.coordinate_frame, target.type_mask) {
            (LOCAL_NED, YAW_RATE_MASK) => Yaw::Rate(f64::from(target.yaw_rate)),
            (LOCAL_NED, YAW_MASK) => Yaw::Angle(f64::from(target.yaw)),
            _ => return None,
        };
        let velocity_ned_mps = [target.vx, target.vy, target.vz].map(f64::from);
        Some(Self { since_us, velocity_ned_mps, yaw })
    }

    /// The command to follow it with the estimated yaw.
    pub(super) fn command(&self, estimate: &Motion) -> Command {
        let yaw_rate_radps = match self.yaw {
            Yaw::Rate(rate_radps) => rate_radps,
            Yaw::Angle(angle_rad) => {
                let error_rad = wrap_pi(angle_rad - estimate.pose.yaw_rad);
                (YAW_GAIN * error_rad).clamp(-YAW_RATE_MAX_RADPS, YAW_RATE_MAX_RADPS)
            }
        };
        Command { velocity_ned_mps: self.velocity_ned_mps, yaw_rate_radps, is_brake: false }
    }
}

/// The state of the flight.
#[derive(Clone, Debug)]
pub(super) struct Flight {
    /// Its estimate, which is also reported.
    pub(super) landed: bool,
    landed_us: Option<u64>,
    /// Since when it has stood on the ground while it was told to sink.
    stood_us: Option<u64>,
    has_flown: bool,
    /// The companion's last request, which is obeyed; `None` makes it stop.
    pub(super) goal: Option<Goal>,
    /// When the last acceptable setpoint came, obeyed or not (PX4).
    pub(super) stream_us: Option<u64>,
    /// Whether another mode is flown instead of OFFBOARD, which has lost its stream (PX4).
    pub(super) is_in_failsafe: bool,
    pub(super) takeoff_down_m: Option<f64>,
    /// The mode of all this.
    pub(super) mode: Option<u32>,
    home_ned_m: Option<[f64; 3]>,
    pub(super) truth: Motion,
    /// Errors of the estimator.
    pub(super) offset_ned_m: [f64; 3],
    pub(super) yaw_offset_rad: f64,
    pub(super) resets: u8,
    pub(super) origin_moves: i32,
}

impl Flight {
    pub(super) fn new(landed: bool) -> Self {
        Self {
            landed,
            landed_us: None,
            stood_us: None,
            has_flown: false,
            goal: None,
            stream_us: None,
            is_in_failsafe: false,
            takeoff_down_m: None,
            mode: None,
            home_ned_m: None,
            truth: Motion::default(),
            offset_ned_m: [0.0; 3],
            yaw_offset_rad: 0.0,
            resets: 0,
            origin_moves: 0,
        }
    }

    /// The estimated position.
    pub(super) fn estimate(&self) -> Motion {
        let mut motion = self.truth;
        for (place, offset) in motion.pose.position_ned_m.iter_mut().zip(self.offset_ned_m) {
            // Adding zero may still change the sign of a zero.
            if offset != 0.0 {
                *place += offset;
            }
        }
        if self.yaw_offset_rad != 0.0 {
            motion.pose.yaw_rad = wrap_pi(motion.pose.yaw_rad + self.yaw_offset_rad);
        }
        motion
    }

    /// The ground is at zero.
    fn height_m(&self) -> f64 {
        -self.truth.pose.position_ned_m[2]
    }
}

impl Autopilot {
    /// Follows the vehicle and the clock.
    pub(super) fn advance(&mut self, now_us: u64, motion: &Motion) {
        self.is_booting = now_us < self.awake_us;
        let flight = &mut self.flight;
        flight.truth = *motion;
        flight.home_ned_m.get_or_insert(motion.pose.position_ned_m);
        if flight.mode.is_some_and(|mode| mode != self.custom_mode) {
            flight.goal = None;
        }
        flight.mode = Some(self.custom_mode);
        self.watch_the_ground(now_us);
        self.finish_takeoff();
        if self.software == Software::Px4 {
            self.px4_watch_the_stream(now_us);
        }
    }

    fn watch_the_ground(&mut self, now_us: u64) {
        let (is_told, wait_us) = self.is_told_to_sink(now_us);
        let flight = &mut self.flight;
        let stands = is_told && flight.height_m() < GROUND_M;
        let stood_us = flight.stood_us.filter(|_| stands).or(stands.then_some(now_us));
        flight.stood_us = stood_us;
        let has_stood = stood_us.is_some_and(|since_us| now_us >= since_us + wait_us);
        if flight.height_m() > LIFTED_M {
            // A vehicle in the air that reports that it has landed is an injected fault, which stays.
            flight.landed &= !self.armed || flight.has_flown;
            flight.has_flown = true;
        } else if has_stood && !flight.landed {
            flight.landed = true;
            flight.has_flown = false;
            flight.takeoff_down_m = None;
            flight.landed_us = Some(now_us);
        }
        // ArduCopter disarms when LAND is done [run], PX4 after COM_DISARM_LAND, 2 s [src].
        let wait_us = if self.software == Software::Px4 { 2_000_000 } else { 0 };
        let is_down_us = self.flight.landed_us.filter(|_| self.flight.landed);
        if is_down_us.is_some_and(|since_us| now_us >= since_us + wait_us) {
            self.flight.landed_us = None;
            if self.behaviour() != Behaviour::Companion {
                self.armed = false;
            }
        }
    }

    /// Whether it may take itself for landed, and for how long it must stand before: while it flies setpoints, only if they ask it to sink
    /// (ArduCopter's `land_detector.cpp`, PX4's `MulticopterLandDetector.cpp` \[src\]).
    fn is_told_to_sink(&self, now_us: u64) -> (bool, u64) {
        match self.behaviour() {
            Behaviour::Companion => {
                let command = self.command_in_the_air(now_us);
                (command.is_some_and(|command| command.velocity_ned_mps[2] > TOLD_MPS), STANDS_US)
            }
            _ => (self.is_going_down(), 0),
        }
    }

    fn is_going_down(&self) -> bool {
        match self.behaviour() {
            Behaviour::Land | Behaviour::Return => true,
            _ => self.flight.has_flown,
        }
    }

    /// The command of the vehicle now.
    #[must_use]
    pub fn command(&self, now_us: u64) -> Command {
        let mut command = self.command_in_the_air(now_us).unwrap_or(Command { is_brake: true, ..Command::default() });
        let height_m = self.flight.height_m();
        if !self.armed && (0.0..GROUND_M).contains(&height_m) {
            // With its motors off it falls the last bit.
            return Command { velocity_ned_mps: [0.0, 0.0, TOUCH_SPEED_MPS], ..Command::default() };
        }
        if height_m < LIFTED_M && (self.flight.landed || self.is_going_down()) {
            // The ground is hard: a vehicle that lags would sink into it. A companion's request is not slowed before.
            let slowed_mps = TOUCH_RATE * height_m + TOUCH_SPEED_MPS;
            let is_slowed = self.behaviour() != Behaviour::Companion;
            let limit_mps = if height_m < GROUND_M {
                0.0
            } else if is_slowed {
                slowed_mps
            } else {
                f64::INFINITY
            };
            command.velocity_ned_mps[2] = command.velocity_ned_mps[2].min(limit_mps);
        }
        command
    }

    /// `None` if it brakes.
    fn command_in_the_air(&self, now_us: u64) -> Option<Command> {
        if !self.armed || self.flight.mode.is_some_and(|mode| mode != self.custom_mode) {
            return None;
        }
        match self.behaviour() {
            Behaviour::Hold => None,
            Behaviour::Companion if self.flight.takeoff_down_m.is_some() => self.climb(),
            Behaviour::Companion => match self.software {
                Software::ArduCopter => self.arducopter_command(now_us),
                Software::Px4 => self.px4_command(now_us),
            },
            Behaviour::TakeOff => self.climb(),
            Behaviour::Land => down(),
            Behaviour::Return => self.way_home(),
        }
    }

    fn climb(&self) -> Option<Command> {
        let up_m = self.flight.truth.pose.position_ned_m[2] - self.flight.takeoff_down_m?;
        let velocity_ned_mps = [0.0, 0.0, -(POSITION_GAIN * up_m + 0.05).clamp(0.0, CLIMB_SPEED_MPS)];
        Some(Command { velocity_ned_mps, ..Command::default() })
    }

    /// Up to the height of return, home, down.
    fn way_home(&self) -> Option<Command> {
        let (here, home) = (self.flight.truth.pose.position_ned_m, self.flight.home_ned_m?);
        let [north, east] = [home[0] - here[0], home[1] - here[1]];
        let away_m = libm::hypot(north, east);
        if away_m < HOME_M {
            return down();
        }
        if self.flight.height_m() < self.return_height_m() - LIFTED_M {
            let velocity_ned_mps = [0.0, 0.0, -CLIMB_SPEED_MPS];
            return Some(Command { velocity_ned_mps, ..Command::default() });
        }
        let speed_mps = (POSITION_GAIN * away_m).min(CRUISE_SPEED_MPS);
        let velocity_ned_mps = [north / away_m * speed_mps, east / away_m * speed_mps, 0.0];
        Some(Command { velocity_ned_mps, ..Command::default() })
    }

    /// `RTL_ALT` in centimetres, `RTL_RETURN_ALT` in metres \[src\].
    fn return_height_m(&self) -> f64 {
        match self.software {
            Software::ArduCopter => self.parameters.get("RTL_ALT") / 100.0,
            Software::Px4 => self.parameters.get("RTL_RETURN_ALT"),
        }
    }
}

fn down() -> Option<Command> {
    Some(Command { velocity_ned_mps: [0.0, 0.0, LAND_SPEED_MPS], ..Command::default() })
}
