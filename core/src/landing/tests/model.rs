//! A simple model of a vehicle, the air, a camera and a beacon.

use std::collections::VecDeque;
use std::vec::Vec;

use super::super::observation::{Bad, Nothing, Pad, PadObservation, Seen};
use super::super::*;
use super::{Landing, Memory, TICK_US, Told, nothing};
use crate::base::history::{Axes, FullPose};
use crate::base::rng::Rng;
use crate::doa::bearing::{Bearing, Flags, Quality};

const TICK_S: f32 = 0.02;
const GRAVITY_MPS2: f32 = 9.81;
/// The gust's acceleration per metre a second, and the duration of a gust.
const DRAG_PER_S: f32 = 0.3;
const GUST_S: f32 = 2.0;
/// Filter of the autopilot's velocity controller, and the lag of the lean behind it.
const FILTER_S: f32 = 0.032;
const LEAN_S: f32 = 0.2;
/// Age of telemetry on arrival.
const HEARD_LATE_TICKS: usize = 2;

/// Response of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Answer {
    /// 0.22 s, then a critically damped second order of 3.1 rad/s.
    ArduCopter,
    /// A lag of 0.15 s.
    Fast,
}

/// What the camera delivers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Camera {
    Works,
    Bad,
    Dead,
}

/// A time span: begin and end.
pub(super) type Span = (f32, f32);
pub(super) const NEVER: Span = (1e9, 1e9);

fn inside((from_s, to_s): Span, time_s: f32) -> bool {
    time_s >= from_s && time_s < to_s
}

/// Conditions of a flight.
#[derive(Clone, Copy, Debug)]
pub(super) struct World {
    pub(super) seed: u64,
    pub(super) answer: Answer,
    pub(super) start_ned_m: Ned,
    pub(super) pad_ned_m: Option<Horizontal>,
    pub(super) beacon_ned_m: Ned,
    /// Standard deviation of the gusts along each axis, and the beacon's speed to the north.
    pub(super) gust_mps: f32,
    pub(super) beacon_mps: f32,
    pub(super) has_finder: bool,
    pub(super) look_period_ticks: u64,
    pub(super) look_late_ticks: usize,
    pub(super) tangent_sigma: f32,
    /// Shares of detections of something else, and of missing ones.
    pub(super) false_share: f32,
    pub(super) missed_share: f32,
    /// Bearings: sigma, a bias that varies with the position, outliers; whether their elevation is known.
    pub(super) bearing_sigma_rad: f32,
    pub(super) bias_rad: f32,
    pub(super) outlier_share: f32,
    pub(super) has_elevation: bool,
    pub(super) deaf_s: Span,
    /// The beacon is heard in the first so many of so many steps.
    pub(super) pulse: (u64, u64),
    /// The bank's estimate, if any.
    pub(super) believed_ned_m: Option<Horizontal>,
    /// The autopilot reports that it has landed.
    pub(super) says_landed: bool,
    pub(super) camera: Camera,
    /// When the pad is covered, the guard brakes, no ownship arrives, and its attitude is NaN.
    pub(super) covered_s: Span,
    pub(super) blocked_s: Span,
    /// The mission holds instead of landing.
    pub(super) held_s: Span,
    pub(super) silent_s: Span,
    pub(super) nan_s: Span,
    /// The pad's apparent radius is not known.
    pub(super) lacks_radius: bool,
    /// The ground is higher than the pad's position, so that the vehicle stands before it reaches it.
    pub(super) ground_down_m: f32,
}

impl World {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            seed,
            answer: Answer::ArduCopter,
            start_ned_m: Ned { north: 0.0, east: 0.0, down: -3.0 },
            pad_ned_m: None,
            beacon_ned_m: Ned::default(),
            gust_mps: 0.0,
            beacon_mps: 0.0,
            has_finder: false,
            look_period_ticks: 5,
            look_late_ticks: 4,
            tangent_sigma: 0.01,
            false_share: 0.0,
            missed_share: 0.0,
            bearing_sigma_rad: 0.03,
            bias_rad: 0.0,
            outlier_share: 0.0,
            has_elevation: true,
            deaf_s: NEVER,
            pulse: (1, 1),
            believed_ned_m: None,
            says_landed: true,
            camera: Camera::Works,
            covered_s: NEVER,
            blocked_s: NEVER,
            held_s: NEVER,
            silent_s: NEVER,
            nan_s: NEVER,
            lacks_radius: false,
            ground_down_m: 0.0,
        }
    }
}

/// How far a gust moves the vehicle from its undisturbed path, along one axis, and the reaction of the autopilot's
/// controller: ArduCopter in GUIDED holds the position that its setpoints lead to, PX4 in OFFBOARD only the velocity.
#[derive(Clone, Copy, Debug, Default)]
struct Deviation {
    position_m: f32,
    velocity_mps: f32,
    error_mps: f32,
    derivative_mps2: f32,
    integral_mps2: f32,
    lean_mps2: f32,
}

impl Deviation {
    fn step(&mut self, answer: Answer, push_mps2: f32, dt: f32) {
        let [position, velocity, integral, derivative] = match answer {
            Answer::ArduCopter => [1.0, 2.0, 1.0, 0.5],
            Answer::Fast => [0.0, 1.8, 0.4, 0.2],
        };
        let before_mps = self.error_mps;
        let share = dt / (FILTER_S + dt);
        self.error_mps += share * (-position * self.position_m - self.velocity_mps - self.error_mps);
        self.derivative_mps2 += share * ((self.error_mps - before_mps) / dt - self.derivative_mps2);
        self.integral_mps2 += integral * self.error_mps * dt;
        let wanted = velocity * self.error_mps + self.integral_mps2 + derivative * self.derivative_mps2;
        self.lean_mps2 += dt / (LEAN_S + dt) * (wanted - self.lean_mps2);
        self.velocity_mps += dt * (push_mps2 + self.lean_mps2);
        self.position_m += dt * self.velocity_mps;
    }
}

/// A flight in progress.
pub(super) struct Flight {
    pub(super) world: World,
    rng: Rng,
    pub(super) tick: u64,
    pub(super) place_ned_m: [f32; 3],
    pub(super) velocity_ned_mps: [f32; 3],
    acceleration_mps2: [f32; 3],
    underway: VecDeque<[f32; 3]>,
    gust_mps: [f32; 2],
    deviations: [Deviation; 2],
    /// The undisturbed velocity.
    calm_ned_mps: [f32; 3],
    yaw_rad: f32,
    roll_rad: f32,
    pitch_rad: f32,
    told: VecDeque<Ownship>,
    looks: VecDeque<Option<PadObservation>>,
    /// Phases of the bias over the position.
    phases: [f32; 4],
    pub(super) lands_at: Option<Horizontal>,
    /// Error of the position that the autopilot reports.
    pub(super) reported_off_m: Horizontal,
}

impl Flight {
    pub(super) fn new(world: World) -> Self {
        let mut rng = Rng::new(world.seed, 77);
        let yaw_rad = core::f32::consts::TAU * rng.uniform() - core::f32::consts::PI;
        let gust = [rng.gaussian() * world.gust_mps, rng.gaussian() * world.gust_mps];
        let phases = core::array::from_fn(|_| core::f32::consts::TAU * rng.uniform());
        let start = world.start_ned_m;
        Self {
            world,
            rng,
            tick: 100,
            place_ned_m: [start.north, start.east, start.down],
            velocity_ned_mps: [0.0; 3],
            acceleration_mps2: [0.0; 3],
            underway: VecDeque::from(std::vec![[0.0; 3]; 11]),
            gust_mps: gust,
            deviations: [Deviation::default(); 2],
            calm_ned_mps: [0.0; 3],
            yaw_rad,
            roll_rad: 0.0,
            pitch_rad: 0.0,
            told: VecDeque::new(),
            looks: VecDeque::new(),
            phases,
            lands_at: None,
            reported_off_m: Horizontal::default(),
        }
    }

    pub(super) fn now(&self) -> Instant {
        Instant(self.tick * TICK_US)
    }

    pub(super) fn time_s(&self) -> f32 {
        (self.tick - 100) as f32 * TICK_S
    }

    pub(super) fn here(&self) -> Horizontal {
        Horizontal { north: self.place_ned_m[0], east: self.place_ned_m[1] }
    }

    pub(super) fn beacon(&self) -> Horizontal {
        let moved = self.world.beacon_mps * self.time_s();
        self.world.beacon_ned_m.horizontal().plus(Horizontal { north: moved, east: 0.0 })
    }

    fn ownship(&self) -> Ownship {
        let [north, east, down] = self.place_ned_m;
        let [vn, ve, vd] = self.velocity_ned_mps;
        Ownship {
            position_time: self.now(),
            position_ned_m: Ned {
                north: north + self.reported_off_m.north,
                east: east + self.reported_off_m.east,
                down,
            },
            velocity_ned_mps: Ned { north: vn, east: ve, down: vd },
            attitude_time: self.now(),
            roll_rad: self.roll_rad,
            pitch_rad: self.pitch_rad,
            yaw_rad: self.yaw_rad,
            yaw_rate_radps: 0.0,
        }
    }

    fn axes(&self) -> Axes {
        FullPose { roll_rad: self.roll_rad, pitch_rad: self.pitch_rad, yaw_rad: self.yaw_rad, ..FullPose::default() }
            .axes()
    }

    /// A vector in the body frame.
    fn to_body(&self, v: [f32; 3]) -> [f32; 3] {
        let axes = self.axes();
        [axes.forward, axes.right, axes.down].map(|a| a.north * v[0] + a.east * v[1] + a.down * v[2])
    }

    /// The detector's result at this moment.
    fn look(&mut self) -> PadObservation {
        let time = self.now();
        let world = self.world;
        if world.camera == Camera::Bad {
            return PadObservation { time, seen: Seen::Bad(Bad::Flat) };
        }
        let empty = PadObservation { time, seen: Seen::Nothing(Nothing::NoRegion) };
        if self.rng.uniform() < world.false_share {
            let (forward, right) = (self.rng.gaussian() * 0.4, self.rng.gaussian() * 0.3);
            let radius = 0.05 + 0.2 * self.rng.uniform();
            return PadObservation {
                time,
                seen: Seen::Pad(Pad { forward, right, radius, confidence: 0.5, is_cut: false }),
            };
        }
        let is_covered = inside(world.covered_s, self.time_s()) || self.rng.uniform() < world.missed_share;
        let Some(pad) = world.pad_ned_m.filter(|_| !is_covered) else { return empty };
        let [north, east, down] = self.place_ned_m;
        let [forward, right, below] = self.to_body([pad.north - north, pad.east - east, -down]);
        // The camera is 0.1 m above the ground when the vehicle stands there.
        let below = below + 0.1;
        let radius = 0.25 / below;
        let (f, r) = (forward / below, right / below);
        // 60 degrees across, three quarters of that along.
        let (half_r, half_f) = (0.577, 0.433);
        if libm::fabsf(f) - radius > half_f || libm::fabsf(r) - radius > half_r || radius > 1.2 {
            return empty;
        }
        let is_cut = libm::fabsf(f) + radius > half_f || libm::fabsf(r) + radius > half_r;
        // A cut disc has its centre shifted to the inside.
        let (f, r) = if is_cut { (0.8 * f, 0.8 * r) } else { (f, r) };
        let sigma = world.tangent_sigma;
        let pad = Pad {
            forward: f + sigma * self.rng.gaussian(),
            right: r + sigma * self.rng.gaussian(),
            radius: if world.lacks_radius { f32::NAN } else { radius * (1.0 + 0.05 * self.rng.gaussian()) },
            confidence: 0.9,
            is_cut,
        };
        PadObservation { time, seen: Seen::Pad(pad) }
    }

    /// The array's bearing at this moment.
    fn bearing(&mut self) -> Bearing {
        let world = self.world;
        let beacon = self.beacon();
        let [north, east, down] = self.place_ned_m;
        let to = [beacon.north - north, beacon.east - east, world.beacon_ned_m.down - down];
        let range = libm::sqrtf(to.iter().map(|x| x * x).sum());
        let [mut forward, mut right, _] = self.to_body(to.map(|x| x / range));
        // Reflections add an error that varies with the position, over half a metre or so.
        let [a, b, c, d] = self.phases;
        forward += world.bias_rad * (libm::sinf(9.0 * north + a) + libm::sinf(11.0 * east + b)) * 0.7;
        right += world.bias_rad * (libm::sinf(10.0 * north + c) + libm::sinf(8.0 * east + d)) * 0.7;
        let sigma = world.bearing_sigma_rad;
        forward += sigma * self.rng.gaussian();
        right += sigma * self.rng.gaussian();
        if self.rng.uniform() < world.outlier_share {
            let angle = core::f32::consts::TAU * self.rng.uniform();
            let k = libm::sqrtf(self.rng.uniform());
            (forward, right) = (k * libm::cosf(angle), k * libm::sinf(angle));
        }
        let time = self.now();
        let quality = Quality { snr_db: 20.0 - 20.0 * libm::log10f(range / 5.0), ..Quality::default() };
        if !world.has_elevation {
            // As the simulator's noise model: the bearing in the horizontal plane, with its sigma.
            let bearing = Horizontal { north: to[0], east: to[1] }.bearing_rad() - self.yaw_rad;
            let outlier = self.rng.uniform() < world.outlier_share;
            let off = if outlier { core::f32::consts::TAU * self.rng.uniform() } else { sigma * self.rng.gaussian() };
            let quality = Quality { wavenumber: 1.0, ..quality };
            return Bearing {
                valid: true,
                azimuth_rad: crate::base::units::wrap_pi(bearing + off + world.bias_rad * libm::sinf(9.0 * north + a)),
                sigma_rad: if sigma > 1e-3 { sigma } else { 1e-3 },
                ..Bearing::without(time, quality, Flags::default())
            };
        }
        let k = libm::sqrtf(forward * forward + right * right);
        let w = libm::sqrtf((1.0 - k * k).max(0.0));
        let sigma_rad = (sigma / k.max(1e-3)).min(core::f32::consts::PI);
        let is_useless = sigma_rad > 0.6;
        Bearing {
            time,
            valid: !is_useless,
            azimuth_rad: libm::atan2f(right, forward),
            sigma_rad,
            elevation_rad: libm::acosf(k.min(1.0)),
            elevation_sigma_rad: sigma / w.max(libm::sqrtf(2.0 * sigma)),
            quality: Quality { wavenumber: k, ..quality },
            flags: if is_useless { Flags::AMBIGUOUS } else { Flags::default() },
        }
    }

    /// One step: input to the lander, and its demand, or the planner's, to the vehicle.
    pub(super) fn step(
        &mut self,
        lander: &Landing,
        state: &mut Memory,
        planner: impl Fn(&Self) -> Horizontal,
    ) -> Output {
        self.told.push_back(self.ownship());
        if self.told.len() > HEARD_LATE_TICKS {
            self.told.pop_front();
        }
        let world = self.world;
        let time_s = self.time_s();
        let mut told = self.told.front().copied().filter(|_| !inside(world.silent_s, time_s));
        if let Some(ownship) = told.as_mut().filter(|_| inside(world.nan_s, time_s)) {
            ownship.roll_rad = f32::NAN;
        }
        let is_due = self.world.camera != Camera::Dead && self.tick.is_multiple_of(self.world.look_period_ticks);
        let look = is_due.then(|| self.look());
        self.looks.push_back(look);
        let look = if self.looks.len() > self.world.look_late_ticks { self.looks.pop_front().flatten() } else { None };
        let (sounds, of) = self.world.pulse;
        let is_heard = self.tick % of < sounds && !inside(self.world.deaf_s, self.time_s());
        let bearing = is_heard.then(|| self.bearing());
        let believed = |place_ned_m| Estimate {
            place_ned_m,
            covariance_m2: [0.3, 0.0, 0.3],
            range_sigma_ratio: 0.5,
            ..Estimate::default()
        };
        let estimate = self.world.believed_ned_m.map(believed);
        let is_down = self.lands_at.is_some() && self.place_ned_m[2] >= self.world.ground_down_m - 1e-3;
        let finder = self.world.has_finder.then(|| 0.1 - self.place_ned_m[2] + 0.02 * self.rng.gaussian());
        let input = Told {
            ownship: told.as_ref(),
            height_m: finder,
            bearing: bearing.as_ref(),
            estimate: estimate.as_ref(),
            look,
            is_landed: self.world.says_landed && is_down,
            is_blocked: inside(world.blocked_s, time_s),
            clearance_m: f32::INFINITY,
            ..nothing(self.now().0)
        };
        let before = advice_before(state);
        let output = lander.step(state, &input);
        if let Some((velocity, down_mps)) = output.demand {
            assert!(velocity.norm() <= centring::SPEED_MAX_MPS * 1.001 && velocity.is_finite(), "{output:?}");
            assert!((-centring::CLIMB_MPS..=centring::DESCENT_MAX_MPS).contains(&down_mps), "{output:?}");
            let (change, down_change) = (velocity.minus(before.0).norm(), libm::fabsf(down_mps - before.1));
            assert!(change <= centring::ACCEL_MAX_MPS2 * TICK_S * 1.01, "{output:?}");
            assert!(down_change <= centring::DOWN_ACCEL_MAX_MPS2 * TICK_S * 1.01, "{output:?}");
        }
        let (velocity, down) = output.demand.unwrap_or_else(|| (planner(self), 0.0));
        let is_held = inside(world.held_s, time_s);
        if is_held {
            state.landing.overrule(TICK_S);
        }
        let stands = is_held || inside(world.blocked_s, time_s);
        let (velocity, down) = if stands { (Horizontal::default(), 0.0) } else { (velocity, down) };
        self.fly([velocity.north, velocity.east, down]);
        output
    }

    fn fly(&mut self, command: [f32; 3]) {
        self.underway.push_back(command);
        let acting = self.underway.pop_front().unwrap();
        let stays = libm::expf(-TICK_S / GUST_S);
        let fresh = self.world.gust_mps * libm::sqrtf(1.0 - stays * stays);
        for gust in &mut self.gust_mps {
            *gust = stays * *gust + fresh * self.rng.gaussian();
        }
        let substeps = 10;
        let dt = TICK_S / substeps as f32;
        for _ in 0..substeps {
            for (deviation, gust) in self.deviations.iter_mut().zip(self.gust_mps) {
                deviation.step(self.world.answer, DRAG_PER_S * gust, dt);
            }
            let [north, east] = self.deviations.map(|deviation| deviation.velocity_mps);
            for (axis, deviation) in [north, east, 0.0].into_iter().enumerate() {
                let wanted = if self.world.answer == Answer::Fast { command[axis] } else { acting[axis] };
                let error = wanted - self.calm_ned_mps[axis];
                let rate = if axis == 2 { 8.0 } else { 3.1 };
                self.acceleration_mps2[axis] = match self.world.answer {
                    Answer::Fast => error / 0.15,
                    Answer::ArduCopter => {
                        let acceleration = self.acceleration_mps2[axis];
                        acceleration + dt * rate * (rate * error - 2.0 * acceleration)
                    }
                };
                self.calm_ned_mps[axis] += dt * self.acceleration_mps2[axis];
                self.velocity_ned_mps[axis] = self.calm_ned_mps[axis] + deviation;
                self.place_ned_m[axis] += dt * self.velocity_ned_mps[axis];
            }
            let ground_down_m = self.world.ground_down_m;
            if self.place_ned_m[2] >= ground_down_m - 1e-3 && self.velocity_ned_mps[2] > 0.0 {
                self.lands_at.get_or_insert(Horizontal { north: self.place_ned_m[0], east: self.place_ned_m[1] });
            }
            if self.lands_at.is_some() && self.place_ned_m[2] >= ground_down_m {
                self.place_ned_m[2] = ground_down_m;
                (self.velocity_ned_mps, self.acceleration_mps2) = ([0.0; 3], [0.0; 3]);
                self.calm_ned_mps = [0.0; 3];
            }
        }
        // Thrust leans into the acceleration and against the wind.
        let [north, east] = [0, 1].map(|axis| self.acceleration_mps2[axis] + self.deviations[axis].lean_mps2);
        let (sine, cosine) = (libm::sinf(self.yaw_rad), libm::cosf(self.yaw_rad));
        self.pitch_rad = -libm::atanf((north * cosine + east * sine) / GRAVITY_MPS2);
        self.roll_rad = libm::atanf((east * cosine - north * sine) / GRAVITY_MPS2);
        self.tick += 1;
    }

    /// Flies until it has handed over or landed; returns the stages in order.
    pub(super) fn run(
        &mut self,
        lander: &Landing,
        limit_s: f32,
        planner: impl Fn(&Self) -> Horizontal,
    ) -> (Output, Vec<Stage>) {
        let mut state = Memory::default();
        let mut stages = Vec::new();
        let mut output = Output::default();
        while self.time_s() < limit_s {
            output = self.step(lander, &mut state, &planner);
            if stages.last() != Some(&output.stage) {
                stages.push(output.stage);
            }
            if matches!(output.stage, Stage::Landed | Stage::HandedOver) {
                break;
            }
        }
        (output, stages)
    }
}

/// The velocity at which the demand begins.
fn advice_before(state: &Memory) -> (Horizontal, f32) {
    (state.landing.velocity_ned_mps, state.landing.down_mps)
}

/// A planner that knows where the beacon is and stops there.
pub(super) fn towards_beacon(flight: &Flight) -> Horizontal {
    flight.beacon().minus(flight.here()).times(2.0).clamped(1.0)
}

/// A planner that knows where the beacon is and does not stop.
pub(super) fn restless(flight: &Flight) -> Horizontal {
    let to = flight.beacon().minus(flight.here());
    let norm = to.norm();
    to.times(1.0 / if norm > 0.05 { norm } else { 0.05 })
}

/// A planner that stays.
pub(super) fn stay(_: &Flight) -> Horizontal {
    Horizontal::default()
}
