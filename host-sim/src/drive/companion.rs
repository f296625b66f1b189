//! The whole system as companion computer of a real or a modelled autopilot, in real time: steps of 20 ms by the
//! monotonic clock.
//!
//! ```text
//!  autopilot --bytes--> computer (in this process, or the firmware in QEMU) --bytes--> autopilot
//!      `--telemetry--> senses --samples, obstacles--^
//! ```
//!
//! The caller gives the positions of the beacon and the pillars in the autopilot's local frame; the signals and
//! obstacles that the vehicle would measure are synthesised from its telemetry. When the machine stalls, the missed
//! steps are skipped ([`Pace`]).
//!
//! The driver never steers the vehicle: it only ends the flight. It does so within [`ARRIVED_M`] of the beacon (if the
//! computer has a task on arrival, once that is [done](Config::ends)), at a collision, at a permanent hold, at the time
//! limit or when it is stopped. Then it pauses the computer, waits until the stream of setpoints has been zero for
//! [`QUIET_S`] and the vehicle is slow, and returns. If the computer does not obey, the driver sends the zeros itself.
//! The last setpoint is zero, however the flight ends.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant as WallInstant, SystemTime, UNIX_EPOCH};

use foxhound_core::ConfigError;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::time::Instant;
use foxhound_core::control::track;
use foxhound_core::doa::bearing::{Bearing, Estimator};
use foxhound_core::guidance::mission::{Behaviour, Outcome};
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_core::landing::Reason;
use foxhound_core::planning::planner;
use foxhound_link::CharArray;
use foxhound_link::companion::{Autopilot, NOTICE_BYTES};
use foxhound_link::signing::Key;

use super::computer::{BLOCK, Computer, StepReport};
use super::flight::{Ending, Mission, Moment, Report, TICK_S};
use crate::autopilot::tlog;
use crate::autopilot::transport::Line;
use crate::scenario::input::{DRONE_RADIUS_M, InputError, MAX_TIME_S, SNR_DB, V_MAX_MPS, check, check_within};
use crate::scenario::{self, Obstacle, Scenario, VehicleModel};
use crate::world::Horizontal;

mod key;
mod obstacle_file;
mod pace;
mod provider;
mod senses;
mod tally;
mod wire;

pub use key::{parse_key, signing};
pub use obstacle_file::parse_obstacles;
pub use pace::Pace;
pub use provider::{Eyes, Provider};
use senses::{Fix, Senses};
use tally::Tally;
use wire::Wire;

/// Horizontal distance to the beacon that counts as arrival.
pub const ARRIVED_M: f64 = 1.0;
/// Time for which the stream of setpoints must have been zero at the end.
pub const QUIET_S: f32 = 0.5;

/// Time from hand-over or touchdown to the end of the flight. With a request to land it is longer: the autopilot is
/// asked once per second, five times at most.
const HANDED_OVER_S: f32 = 1.0;
const ASKED_S: f32 = 6.0;
/// A vehicle slower than this is slow.
const SLOW_MPS: f64 = 0.2;
/// Largest time to wait for the vehicle to become slow.
const BRAKE_MAX_S: f32 = 5.0;
/// Interval at which a pause is repeated until the stream is zero.
const PAUSE_PERIOD_US: u64 = 200_000;
/// Time after which a computer whose setpoints are still not zero counts as not obeying.
const OBEYS_WITHIN_S: f32 = 0.5;
/// Interval between the zero setpoints that the driver sends.
const ZERO_PERIOD: Duration = Duration::from_millis(50);
/// Largest distance of a pad from the beacon, north and east.
const PAD_MAX_M: f64 = 10.0;
/// Factor on the speed limit, to allow for rounding.
const ROUNDING: f32 = 1.0 - 1e-6;

/// When a flight ends at the beacon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ends {
    /// Within [`ARRIVED_M`] of it.
    #[default]
    Near,
    /// When the computer has handed over or landed (`FH_LND_MODE`).
    HandedOver,
    /// When the computer has then asked the autopilot to land (`FH_LND_REQ`), and the autopilot has obeyed or been
    /// asked five times.
    Landing,
}

impl Ends {
    /// The end that matches the computer's configured task on arrival.
    #[must_use]
    pub fn of(guidance: &guidance::Config) -> Self {
        match guidance.landing {
            None => Self::Near,
            Some(landing) if landing.request_land => Self::Landing,
            Some(_) => Self::HandedOver,
        }
    }

    /// Time for which the computer goes on after that.
    const fn after_s(self) -> f32 {
        match self {
            Self::Near => 0.0,
            Self::HandedOver => HANDED_OVER_S,
            Self::Landing => ASKED_S,
        }
    }
}

/// Configuration of the flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The beacon, in the autopilot's local frame.
    pub source_ned_m: [f64; 3],
    /// Centre of a pad on the ground, in the same frame (north, east), that a simulated camera sees; the ground is at the
    /// frame's down of zero.
    pub pad_ne_m: Option<[f64; 2]>,
    /// Whether its position is known; if not, the distance from it is neither checked nor reported.
    pub is_source_known: bool,
    /// Who provides the obstacles; those of a file are in the same frame.
    pub obstacles: Provider,
    /// Horizontal speed of the fastest setpoint.
    pub v_max_mps: f64,
    /// When the flight ends at the beacon.
    pub ends: Ends,
    /// Radius of the vehicle.
    pub drone_radius_m: f64,
    /// The simulated obstacle sensor, where it is used.
    pub sensor: scenario::Sensor,
    /// Signal-to-noise ratio per sample of the antenna waveforms.
    pub snr_db: f64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Which planner.
    pub planner: planner::Config,
    /// Which estimator.
    pub estimator: Estimator,
    /// Time limit of the flight.
    pub max_time_s: Option<f64>,
    /// The key with which all systems on the link sign. The caller must give it to the computer, too.
    pub key: Option<Key>,
}

impl Config {
    /// Checks every number.
    ///
    /// # Errors
    /// The option out of range.
    pub fn checked(self) -> Result<Self, InputError> {
        let far = 10_000.0;
        for (axis, value) in ["N", "E", "D"].into_iter().zip(self.source_ned_m) {
            check(&format!("--source: {axis}"), value, -far, far)?;
        }
        check_within("--v-max", self.v_max_mps, &V_MAX_MPS)?;
        check_within("--drone-radius", self.drone_radius_m, &DRONE_RADIUS_M)?;
        check_within("--snr-db", self.snr_db, &SNR_DB)?;
        if let Some(max_time_s) = self.max_time_s {
            check_within("--max-time", max_time_s, &MAX_TIME_S)?;
        }
        if let Some(pad) = self.pad_ne_m {
            for (axis, at) in [("N", 0), ("E", 1)] {
                let beacon = self.source_ned_m[at];
                check(&format!("--pad: {axis}"), pad[at], beacon - PAD_MAX_M, beacon + PAD_MAX_M)?;
            }
        }
        // Everything else in it is as built.
        self.scenario().checked().map_err(|error| {
            let hint = "FH_RADIUS, FH_OBS_FOV and FH_OBS_RANGE in --params tell a larger vehicle and its sensor";
            InputError::new(format!("--drone-radius = {}: {error}; {hint}", self.drone_radius_m))
        })?;
        Ok(self)
    }

    fn scenario(&self) -> Scenario {
        let [north, east, _] = self.source_ned_m;
        // No range finder is simulated: the autopilot's height is used.
        let landing = self.pad_ne_m.map(|[pad_north, pad_east]| scenario::Landing {
            pad: [pad_east - east, pad_north - north],
            range_finder: false,
            ..scenario::Landing::default()
        });
        Scenario {
            landing,
            name: "companion".to_owned(),
            drone_radius: self.drone_radius_m,
            sensor: self.sensor,
            goal: [east, north],
            obstacles: self.obstacles.simulated().to_vec(),
            bearing: scenario::Bearing { snr_db: Some(self.snr_db), ..scenario::Bearing::default() },
            limits: scenario::Limits { v_max: self.v_max_mps, ..scenario::Limits::default() },
            vehicle: scenario::Vehicle { model: VehicleModel::Arducopter, ..scenario::Vehicle::default() },
            goal_tolerance: ARRIVED_M,
            ..Scenario::default()
        }
    }

    /// The mission, with a map large enough for it; the start is known when the autopilot reports it.
    #[must_use]
    pub fn mission(&self) -> Mission {
        let mut scenario = self.scenario();
        let [x, y] = scenario.goal;
        scenario.bounds = scenario.obstacles.iter().fold([x - 1.0, y - 1.0, x + 1.0, y + 1.0], |bounds, pillar| {
            let Obstacle { x, y, r, .. } = *pillar;
            let [west, south, east, north] = bounds;
            [west.min(x - r), south.min(y - r), east.max(x + r), north.max(y + r)]
        });
        Mission { scenario, seed: self.seed, planner: self.planner, estimator: self.estimator }
    }

    /// The configuration of the computer.
    #[must_use]
    pub fn guidance(&self) -> guidance::Config {
        let mut config = self.mission().guidance();
        config.guard.v_max_mps *= ROUNDING;
        config
    }

    /// The largest speed at which a plan is followed, if that is less than the requested one.
    #[must_use]
    pub fn slower_than_asked_mps(&self) -> Option<f64> {
        let fastest_mps = f64::from(track::FASTEST_MPS);
        (self.v_max_mps > fastest_mps).then_some(fastest_mps)
    }
}

/// Bearings of a radio, in place of the simulated antennas.
pub trait Bearings {
    /// The newest usable bearing since the last call, if any.
    fn poll(&mut self, now: Instant) -> Option<Bearing>;
}

/// The state of the flight, given once per step.
#[derive(Clone, Copy, Debug)]
pub struct News {
    /// Time since the start.
    pub time_s: f64,
    /// Whether the line to the autopilot is open.
    pub is_open: bool,
    /// The autopilot, once it has been received.
    pub autopilot: Option<Autopilot>,
    /// Frames were received that were not signed with the key.
    pub is_disbelieved: bool,
    /// MAVLink 1 was received, which is not accepted unless `FH_V1` is 1.
    pub hears_mavlink_1: bool,
    /// The step's outcome.
    pub outcome: Outcome,
    /// The last text that the computer sent the pilot.
    pub told: Option<CharArray<NOTICE_BYTES>>,
    /// Who provides the obstacles.
    pub eyes: Eyes,
    /// Horizontal distance to the beacon, while the autopilot reports the vehicle's position.
    pub distance_m: Option<f64>,
    /// How the flight is being ended, if it is.
    pub ending: Option<Ending>,
}

/// Result of the flight.
#[derive(Clone, Debug)]
pub struct Flown {
    /// The object that is printed.
    pub report: Report,
    /// Errors during the flight.
    pub complaints: Vec<String>,
    /// Number of steps skipped because the machine was busy.
    pub missed_steps: u32,
}

/// Waits for a peer at the other end of the line; false when stopped or after `limit_s`. `meanwhile` is called again and again.
pub fn wait_for_line(
    line: &mut Line,
    stop: &AtomicBool,
    limit_s: Option<f64>,
    mut meanwhile: impl FnMut(Instant),
) -> bool {
    let begin = WallInstant::now();
    while !line.is_open() {
        // A peer may send before it can be answered: read anyway.
        line.read();
        meanwhile(Instant(begin.elapsed().as_micros() as u64));
        if stop.load(Ordering::Relaxed) || limit_s.is_some_and(|limit_s| begin.elapsed().as_secs_f64() > limit_s) {
            return false;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    true
}

/// The report of a flight that never began because no peer was at the other end.
#[must_use]
pub fn nobody_there(config: &Config) -> Report {
    let eyes = provider::Chooser::new(&config.obstacles).eyes();
    Tally::new(None, config.drone_radius_m).report(config.seed, Ending::Timeout, Outcome::LinkLost, eyes)
}

/// Flies with a computer until the flight ends; `stop` ends it at any time. `watch` is called with the state and, while
/// the autopilot reports the vehicle's position, with the step, in which that position stands for the true one. With
/// `bearings`, these replace the simulated antennas, which then deliver nothing.
///
/// # Errors
/// The field of the link's configuration that is refused.
pub fn fly(
    config: &Config,
    computer: &mut dyn Computer,
    line: &mut Line,
    log: Option<&mut tlog::Writer>,
    bearings: Option<&mut dyn Bearings>,
    stop: &AtomicBool,
    watch: impl FnMut(&News, Option<&Moment<'_>>),
) -> Result<Flown, ConfigError> {
    let [north, east, _] = config.source_ned_m;
    let source = Horizontal { north, east };
    let scenario = config.scenario();
    let sign = || config.key.as_ref().map(|key| signing(key, key::DRIVER, Instant(0)));
    let mut flight = Flight {
        config,
        line,
        log,
        bearings,
        source,
        senses: Senses::new(config.source_ned_m, config.snr_db, &scenario, config.seed, sign(), &config.obstacles)?,
        tally: Tally::new(config.is_source_known.then_some(source), config.drone_radius_m),
        wire: Wire::new(sign()),
        started_us: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_micros() as u64),
        complaints: Vec::new(),
        told: None,
        arrival: Arrival::new(config.ends),
    };
    let mut pace = Pace::new(Duration::from_micros((TICK_S * 1e6) as u64));
    let (ending, reason) = flight.fly(computer, &mut pace, stop, watch);
    let report = flight.tally.report(config.seed, ending, reason, flight.senses.eyes());
    Ok(Flown { report, complaints: flight.complaints, missed_steps: pace.missed })
}

struct Flight<'a, 'b> {
    config: &'a Config,
    line: &'a mut Line,
    log: Option<&'a mut tlog::Writer>,
    bearings: Option<&'a mut (dyn Bearings + 'b)>,
    source: Horizontal,
    senses: Senses,
    tally: Tally,
    wire: Wire,
    /// Wall time at the start.
    started_us: u64,
    complaints: Vec<String>,
    /// The last message to the pilot about the source of obstacles, since the computer got control.
    told: Option<Eyes>,
    arrival: Arrival,
}

/// Whether, and since when, the computer has finished its task on arrival.
#[derive(Clone, Copy, Debug)]
struct Arrival {
    ends: Ends,
    since: Option<Instant>,
    /// It is at the beacon or on the pad, and has not handed over for another reason.
    is_there: bool,
}

impl Arrival {
    const fn new(ends: Ends) -> Self {
        Self { ends, since: None, is_there: false }
    }

    fn step(&mut self, now: Instant, outcome: Outcome, reason: Option<Reason>) {
        match outcome {
            Outcome::HandedOver | Outcome::Landed => {
                self.since.get_or_insert(now);
                self.is_there = matches!(reason, Some(Reason::Arrived | Reason::Landed));
            }
            // The autopilot was asked to land and is landing, or the pilot took over.
            Outcome::NotInControl => {}
            _ => self.since = None,
        }
    }

    fn has_ended(&self, now: Instant, in_control: bool) -> bool {
        self.since.is_some_and(|since| !in_control || now.seconds_since(since) >= self.ends.after_s())
    }
}

/// The message to the pilot when the flight is being ended.
const fn parting(ending: Ending) -> &'static str {
    match ending {
        Ending::Reached => "Foxhound: reached the beacon, take over",
        Ending::Hold => "Foxhound: gives up and holds, take over",
        Ending::Collision => "Foxhound: simulated collision, take over",
        Ending::Timeout | Ending::Interrupted => "Foxhound: ends on the way, take over",
    }
}

/// The flight is being ended.
#[derive(Clone, Copy)]
struct Brake {
    ending: Ending,
    reason: Outcome,
    since: Instant,
    pause_due: Instant,
}

impl Flight<'_, '_> {
    fn fly(
        &mut self,
        computer: &mut dyn Computer,
        pace: &mut Pace,
        stop: &AtomicBool,
        mut watch: impl FnMut(&News, Option<&Moment<'_>>),
    ) -> (Ending, Outcome) {
        let mut outcome = Outcome::LinkLost;
        let mut reason = None;
        let mut brake: Option<Brake> = None;
        loop {
            let now = pace.wait();
            let mut rx = self.hear(now);
            let fix = self.senses.fix(now);
            self.arrival.step(now, outcome, reason);
            let in_control = self.senses.is_in_control(now);
            self.tally.step(now, self.senses.world(), fix.as_ref(), in_control);
            self.tell_eyes(computer, now, in_control);
            if brake.is_none() {
                brake = self.end(now, fix.as_ref(), in_control, outcome, stop);
            }
            if let (Some(brake), Some(autopilot)) = (&mut brake, self.senses.autopilot())
                && now >= brake.pause_due
            {
                brake.pause_due = now.plus_micros(PAUSE_PERIOD_US);
                if brake.since == now {
                    self.tell(computer, now, &autopilot, parting(brake.ending));
                }
                let pause = self.wire.pause(now, &autopilot);
                self.note(now, tlog::Direction::ToCompanion, &pause);
                rx.extend(pause);
            }

            let (report, snapshot) = match self.step(computer, now, fix.as_ref(), &rx) {
                Ok(stepped) => stepped,
                Err(complaint) => {
                    self.stand(pace);
                    // A stop from the terminal may have stopped the computer's process, too: then its error is not
                    // reported.
                    if !stop.load(Ordering::Relaxed) {
                        self.complaints.push(complaint);
                    }
                    let Some(brake) = brake else { return (Ending::Hold, Outcome::Fault) };
                    return (brake.ending, brake.reason);
                }
            };
            outcome = report.output.outcome;
            reason = report.output.landing.and_then(|landing| landing.reason);
            let time_s = now.0 as f64 * 1e-6;
            let news = News {
                time_s,
                is_open: self.line.is_open(),
                autopilot: self.senses.autopilot(),
                is_disbelieved: self.senses.disbelieves(),
                hears_mavlink_1: self.senses.hears_mavlink_1(),
                outcome,
                told: self.wire.told(),
                eyes: self.senses.eyes(),
                distance_m: fix
                    .filter(|_| self.config.is_source_known)
                    .map(|fix| self.source.minus(fix.place()).norm()),
                ending: brake.map(|brake| brake.ending),
            };
            let moves = fix.map(|fix| fix.moves(time_s, outcome));
            let (world, output, computer) = (self.senses.world(), &report.output, &*computer);
            let moment = moves.as_ref().map(|(motion, sample)| Moment {
                world,
                motion,
                sample,
                output,
                computer,
                frame: snapshot.as_deref(),
                picture: self.senses.picture(now),
                knows_source: self.config.is_source_known,
            });
            watch(&news, moment.as_ref());

            if let Some(brake) = brake {
                let braked_s = now.seconds_since(brake.since);
                let is_slow = !in_control || fix.is_none_or(|fix| fix.speed_mps < SLOW_MPS);
                let is_quiet = self.wire.quiet_s(now) >= QUIET_S;
                let disobeys = self.wire.moves() && (is_quiet || braked_s > OBEYS_WITHIN_S);
                if disobeys {
                    self.stand(pace);
                }
                if disobeys || is_quiet && (is_slow || braked_s > BRAKE_MAX_S) {
                    let ending = if self.tally.collided() { Ending::Collision } else { brake.ending };
                    return (ending, brake.reason);
                }
            }
        }
    }

    /// Whether the flight ends here.
    fn end(
        &self,
        now: Instant,
        fix: Option<&Fix>,
        in_control: bool,
        outcome: Outcome,
        stop: &AtomicBool,
    ) -> Option<Brake> {
        let is_known = self.config.is_source_known;
        let is_near = |fix: &Fix| is_known && self.source.minus(fix.place()).norm() <= ARRIVED_M;
        let has_ended = self.arrival.has_ended(now, in_control);
        let arrived = |fix: &Fix| if self.config.ends == Ends::Near { in_control && is_near(fix) } else { has_ended };
        let is_late = |limit_s: f64| now.0 as f64 * 1e-6 >= limit_s;
        let holds = outcome.behaviour() == Behaviour::Hold;
        let (ending, reason) = if self.tally.collided() {
            (Ending::Collision, outcome)
        } else if fix.is_some_and(arrived) {
            let is_there = self.config.ends == Ends::Near || self.arrival.is_there;
            if is_there { (Ending::Reached, Outcome::Nominal) } else { (Ending::Hold, Outcome::HandedOver) }
        } else if outcome == Outcome::GoalUnreachable && self.tally.is_still(now) {
            (Ending::Hold, outcome)
        } else if stop.load(Ordering::Relaxed) {
            (Ending::Interrupted, outcome)
        } else if self.config.max_time_s.is_some_and(is_late) {
            (if holds { Ending::Hold } else { Ending::Timeout }, outcome)
        } else {
            return None;
        };
        Some(Brake { ending, reason, since: now, pause_due: now })
    }

    /// Reports to the pilot who provides the obstacles, at every entry into the mode and when that changes.
    fn tell_eyes(&mut self, computer: &mut dyn Computer, now: Instant, in_control: bool) {
        let eyes = self.senses.eyes();
        self.told = self.told.filter(|_| in_control);
        if let (true, Some(text), Some(autopilot)) = (in_control, eyes.text(), self.senses.autopilot())
            && self.told.replace(eyes) != Some(eyes)
        {
            self.tell(computer, now, &autopilot, text);
        }
    }

    /// Sends the pilot a text through the computer, or in its name if the computer cannot be made to send it.
    fn tell(&mut self, computer: &mut dyn Computer, now: Instant, autopilot: &Autopilot, text: &'static str) {
        if !computer.tell(text) {
            let text = self.wire.text(now, autopilot, text);
            self.say(now, &text);
        }
    }

    fn hear(&mut self, now: Instant) -> Vec<u8> {
        let rx = self.line.read();
        self.senses.receive(now, &rx);
        self.note(now, tlog::Direction::ToCompanion, &rx);
        rx
    }

    fn say(&mut self, now: Instant, frames: &[u8]) {
        self.line.write(frames);
        self.note(now, tlog::Direction::ToAutopilot, frames);
    }

    /// The computer's step, and the samples that it was given.
    fn step(
        &mut self,
        computer: &mut dyn Computer,
        now: Instant,
        fix: Option<&Fix>,
        rx: &[u8],
    ) -> Result<(StepReport, Option<Box<AdcFrame<BLOCK>>>), String> {
        let heard = self.bearings.as_deref_mut().map(|bearings| bearings.poll(now));
        let snapshot = fix.filter(|_| heard.is_none()).map(|fix| self.senses.hear(now, fix));
        let front_end = match heard {
            Some(bearing) => bearing.map_or(FrontEnd::Nothing, FrontEnd::Bearing),
            None => snapshot.as_deref().map_or(FrontEnd::Nothing, FrontEnd::Frame),
        };
        let circles = fix.and_then(|fix| self.senses.look(now, fix));
        if let Some(bytes) = fix.and_then(|fix| self.senses.film(now, fix)) {
            computer.see(&bytes).map_err(|error| error.to_string())?;
        }
        let report = computer.step(now, front_end, circles.as_deref(), rx).map_err(|error| error.to_string())?;
        self.wire.watch(now, &report.tx);
        self.say(now, &report.tx);
        self.tally.hear(&report.output, fix.filter(|_| self.config.is_source_known), report.plan.is_some());
        Ok((report, snapshot))
    }

    /// Stops the vehicle without a computer.
    fn stand(&mut self, pace: &Pace) {
        let mut beat = pace.with_period(ZERO_PERIOD);
        let begin = beat.wait();
        loop {
            let now = beat.wait();
            self.hear(now);
            let Some(autopilot) = self.senses.autopilot() else { return };
            let zero = self.wire.zero(now, &autopilot);
            self.say(now, &zero);
            let is_slow = self.senses.fix(now).is_none_or(|fix| fix.speed_mps < SLOW_MPS);
            let stood_s = now.seconds_since(begin);
            let is_ours = self.senses.is_in_control(now);
            if stood_s > BRAKE_MAX_S || stood_s > QUIET_S && (is_slow || !is_ours) {
                return;
            }
        }
    }

    /// Records bytes in the log. If the log cannot be written, it is given up, but not the flight.
    fn note(&mut self, now: Instant, direction: tlog::Direction, bytes: &[u8]) {
        if let Some(log) = self.log.as_deref_mut()
            && let Err(error) = log.bytes(self.started_us + now.0, direction, bytes)
        {
            self.complaints.push(format!("--tlog {error}"));
            self.log = None;
        }
    }
}

#[cfg(test)]
mod hidden;
#[cfg(test)]
mod tests;
