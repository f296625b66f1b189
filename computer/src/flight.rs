//! One step of the flight computer. The firmware and the simulator both use this code, so that their traces are equal
//! bit for bit:
//!
//! 1. the link takes the bytes of the autopilot ([`Flight::hear`]), and the [`crate::sensor`] its own, if there is one
//!    ([`Flight::hear_sensor`]);
//! 2. requests of stations about parameters and the receiver are carried out ([`Flight::serve`]);
//! 3. guidance steps, with the link's data, the frame, and the plan that was finished in the step before; the link
//!    publishes the outcome and does what is due ([`Flight::step`]).
//!
//! A frame in which a channel [stands still](crate::frozen) counts as missing. While the receiver is
//! [tested](crate::selftest), disarmed and outside control, the frames are used for the test, and guidance steps
//! without them.
//!
//! Then the bytes of the link are sent. If guidance requests a plan the planner makes one, which is passed to the
//! next step.

use foxhound_core::ConfigError;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::array::{Entry, Table};
use foxhound_core::doa::calibration::deviation::Deviation;
use foxhound_core::doa::calibration::record::Calibration;
use foxhound_core::doa::radio::Sends;
use foxhound_core::guidance::param::{Id, Values};
use foxhound_core::guidance::systems::Systems;
use foxhound_core::guidance::{self, FrontEnd, Guidance, Input, Measurement, Output};
use foxhound_core::landing::observation::PadObservation;
use foxhound_core::planning::planner::{Answer, Planner};
use foxhound_link::companion::{self, Companion, Exam, Examined};
use foxhound_link::params::Storage;

use crate::SAMPLES_PER_CHANNEL as N;
use crate::features;
use crate::frozen::Watch;
use crate::iq::Reports;
use crate::sampling::Timer;
use crate::selftest::{self, Channels, Check, Refused, SelfTest, Verdict};
use crate::sensor::{self, Sensor};

/// Non-volatile storage of parameters.
pub trait ParameterStore {
    /// Stores these; false if that is not possible.
    fn save(&mut self, values: &Values) -> bool;
    /// The stored parameters; `None` if there are none, or none that can be read.
    fn load(&mut self) -> Option<Values>;
    /// Erases everything stored, parameters and all else; false if that is not possible.
    fn reset(&mut self) -> bool;
}

/// Without a storage nothing is stored.
impl<K: ParameterStore> ParameterStore for Option<K> {
    fn save(&mut self, values: &Values) -> bool {
        self.as_mut().is_some_and(|parameter_store| parameter_store.save(values))
    }

    fn load(&mut self) -> Option<Values> {
        self.as_mut()?.load()
    }

    fn reset(&mut self) -> bool {
        self.as_mut().is_some_and(ParameterStore::reset)
    }
}

/// Input of one step.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The time of the step: the only clock of guidance and link.
    pub now: Instant,
    /// The measurement of the antennas.
    pub front_end: FrontEnd<'a, N>,
    /// Obstacles from a sensor that reports circles.
    pub circles: Option<&'a [Circle]>,
    /// The camera's latest observation.
    pub look: Option<PadObservation>,
    /// The slow loop's answer, passed once, as soon as there is one.
    pub answer: Option<&'a Answer>,
}

/// The result of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stepped {
    /// Output of guidance.
    pub output: Output,
    /// Measurement of the antennas that it used.
    pub heard: Option<Measurement>,
    /// Number of the plan that was passed in.
    pub plan: Option<u32>,
    /// How long it took.
    pub ticks: u32,
}

/// State of the receiver beside its frames.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// The timer of its samples, if not every rate is possible.
    timer: Option<Timer>,
    watch: Watch,
    test: SelfTest,
    /// The calibration is new, and has to be stored.
    is_calibrated: bool,
    /// The result of a test has not been fetched.
    is_examined: bool,
}

impl Receiver {
    /// Before the first frame.
    #[must_use]
    pub fn new(timer: Option<Timer>) -> Self {
        Self { timer, watch: Watch::new(), test: SelfTest::default(), is_calibrated: false, is_examined: false }
    }

    /// The present test, or the last one.
    #[must_use]
    pub const fn test(&self) -> &SelfTest {
        &self.test
    }

    /// Frames in which a channel stood still, since the start.
    #[must_use]
    pub const fn frozen(&self) -> u32 {
        self.watch.frames()
    }

    /// Replaces the sample rate of a configuration by the nearest possible one.
    ///
    /// # Errors
    /// The field that is refused.
    pub fn fit(&self, config: &mut guidance::Config) -> Result<(), ConfigError> {
        if let Some(timer) = &self.timer {
            config.phase.sample_rate_hz = timer.sampling(config)?.rate_hz;
        }
        Ok(())
    }
}

/// The parts of a flight, by reference.
#[derive(Debug)]
pub struct Flight<'a, S = Planner> {
    /// The configuration in use.
    pub config: &'a mut guidance::Config,
    /// The fast loop.
    pub guidance: &'a mut Guidance<N>,
    /// Its state.
    pub state: &'a mut guidance::State<N>,
    /// The bearing estimator and the planner.
    pub systems: &'a mut S,
    /// The link.
    pub companion: &'a mut Companion,
    /// The receiver.
    pub receiver: &'a mut Receiver,
    /// The sensor on a serial line of our own, if there is one.
    pub sensor: &'a mut Option<Sensor>,
    /// The reader of that sensor's IQ reports.
    pub reports: &'a mut Reports,
}

// The stack holds only one of the large parts at a time, while it is built: hence a function for each.
impl<S: Systems> Flight<'_, S> {
    /// Starts the next flight in the same memory, with another link; the old one continues if the configuration is
    /// refused.
    ///
    /// # Errors
    /// The field that is refused.
    pub fn begin_anew(&mut self, config: &guidance::Config) -> Result<(), ConfigError> {
        self.copy_and_set_up(config)?;
        self.listen_anew()
    }

    #[inline(never)]
    fn copy_and_set_up(&mut self, config: &guidance::Config) -> Result<(), ConfigError> {
        self.set_up(&mut config.clone())
    }

    /// Builds guidance and systems from another configuration, from the start; the old ones continue if that is
    /// refused. The sample rate is replaced by the nearest possible one.
    ///
    /// # Errors
    /// The field that is refused.
    #[inline(never)]
    fn set_up(&mut self, config: &mut guidance::Config) -> Result<(), ConfigError> {
        features::check(config)?;
        let systems = S::build(config)?;
        self.receiver.fit(config)?;
        self.try_sensor(config)?;
        match S::guidance(config) {
            Ok(guidance) => *self.guidance = guidance,
            Err(error) => {
                // The readers that the sensor shares with the one before.
                self.look_anew()?;
                return Err(error);
            }
        }
        *self.systems = systems;
        self.guidance.restart(self.state);
        *self.config = *config;
        self.look_anew()
    }

    #[inline(never)]
    fn try_sensor(&mut self, config: &guidance::Config) -> Result<(), ConfigError> {
        sensor::build(config, self.reports).map(drop)
    }

    #[inline(never)]
    fn look_anew(&mut self) -> Result<(), ConfigError> {
        *self.sensor = sensor::build(self.config, self.reports)?;
        Ok(())
    }

    #[inline(never)]
    fn listen_anew(&mut self) -> Result<(), ConfigError> {
        companion::Config::default().rebuild_with(self.companion, Values::of(self.config))
    }

    /// Starts afresh with all of these parameters, or continues with the old ones.
    ///
    /// # Errors
    /// The field that is refused.
    #[inline(never)]
    pub fn run_with(&mut self, values: Values) -> Result<(), ConfigError> {
        self.companion.check_parameters(&values)?;
        let mut config = *self.config;
        values.apply(&mut config);
        self.set_up(&mut config)?;
        self.companion.set_parameters(values)
    }

    /// Takes bytes of the autopilot.
    pub fn hear(&mut self, now: Instant, bytes: &[u8]) {
        self.companion.receive(now, bytes);
    }

    /// Whether the sensor is a radio that sends lines of angles.
    #[must_use]
    pub fn hears_angles(&self) -> bool {
        self.config.radio.is_some_and(|mount| mount.sends == Sends::Angles)
    }

    /// Takes bytes of the sensor's line; false if there is no sensor.
    pub fn hear_sensor(&mut self, now: Instant, bytes: &[u8]) -> bool {
        let Some(sensor) = self.sensor else { return false };
        sensor.push(now, bytes, self.reports);
        true
    }

    /// Carries out requests of stations about parameters, and handles a restart of the autopilot; true if guidance
    /// has started afresh, so that plans requested before are of no use any more.
    #[inline(never)]
    pub fn serve(&mut self, parameter_store: &mut impl ParameterStore) -> bool {
        let mut begins_anew = false;
        if let Some((id, values)) = self.companion.proposal() {
            let verdict = self.adopt(id, &values);
            self.companion.settle(verdict);
            begins_anew = verdict.is_ok();
        }
        if let Some(storage) = self.companion.take_storage() {
            let is_done = match storage {
                Storage::Save => parameter_store.save(self.companion.parameters()),
                Storage::Load => parameter_store.load().is_some_and(|values| self.run_with(values).is_ok()),
                Storage::Reset => parameter_store.reset() && self.run_with(Values::DEFAULT).is_ok(),
            };
            begins_anew |= is_done && storage != Storage::Save;
            self.companion.stored(is_done);
        }
        if let Some(exam) = self.companion.take_exam()
            && self.examine(exam).is_err()
        {
            self.companion.examined(Examined::Refused);
        }
        begins_anew |= self.conclude_exam();
        if self.companion.take_world_lost() {
            self.guidance.restart(self.state);
            begins_anew = true;
        }
        begins_anew
    }

    /// Tries a changed parameter; it is in use from this step on, which starts afresh.
    #[inline(never)]
    fn adopt(&mut self, id: Id, values: &Values) -> Result<(), ConfigError> {
        let mut config = *self.config;
        values.apply_one(id, &mut config);
        self.set_up(&mut config)
    }

    /// Begins to test the receiver, or to calibrate it.
    ///
    /// # Errors
    /// It is being tested already, or the vehicle is in use.
    #[inline(never)]
    pub fn examine(&mut self, exam: Exam) -> Result<(), Refused> {
        if !self.companion.may_examine() {
            return Err(Refused::InUse);
        }
        self.receiver.test.begin(exam)
    }

    /// Reports the result of a test, once, and adopts a calibration; true if guidance has started afresh with it.
    #[inline(never)]
    fn conclude_exam(&mut self) -> bool {
        let Some((report, entry)) = self.receiver.test.take_ended() else { return false };
        let mut verdict = report.verdict;
        let is_calibrated = entry.is_some_and(|entry| self.calibrate(&entry).is_ok());
        if entry.is_some() && !is_calibrated {
            verdict = Verdict::Fail { check: Check::Phase, channels: Channels::NONE };
        }
        self.receiver.is_calibrated |= is_calibrated;
        self.receiver.is_examined = true;
        self.companion.examined(if verdict == Verdict::Pass { Examined::Passed } else { Examined::Failed });
        self.companion.notify(selftest::words(report.exam, verdict));
        is_calibrated
    }

    #[inline(never)]
    fn calibrate(&mut self, entry: &Entry) -> Result<(), ConfigError> {
        let mut config = *self.config;
        config.array.calibration = Some(Table::new(config.array.wavelength_m, core::slice::from_ref(entry))?);
        self.set_up(&mut config)
    }

    /// The result of a test, if there is a new one since the last call.
    pub fn take_report(&mut self) -> Option<selftest::Report> {
        let is_examined = core::mem::take(&mut self.receiver.is_examined);
        self.receiver.test.report().filter(|_| is_examined).copied()
    }

    /// The calibration measured on board since the last call, to be stored; it does not contain the airframe's
    /// deviation.
    pub fn take_calibration(&mut self) -> Option<Calibration> {
        let table = self.config.array.calibration.filter(|_| core::mem::take(&mut self.receiver.is_calibrated))?;
        Some(Calibration { table, deviation: Deviation::default() })
    }

    /// The antennas' input for guidance: invalid frames are removed, and all frames during a test.
    #[inline(never)]
    fn admit<'a>(&mut self, front_end: FrontEnd<'a, N>) -> FrontEnd<'a, N> {
        let FrontEnd::Frame(snapshot) = front_end else {
            self.receiver.test.miss(None);
            return front_end;
        };
        let frozen = self.receiver.watch.look(snapshot);
        if self.receiver.test.is_running() {
            self.listen(snapshot, frozen);
            return FrontEnd::Nothing;
        }
        if frozen.is_some() { FrontEnd::Nothing } else { front_end }
    }

    #[inline(never)]
    fn listen(&mut self, snapshot: &AdcFrame<N>, frozen: Option<usize>) {
        let test = &mut self.receiver.test;
        if !self.companion.may_examine() {
            return test.interrupt();
        }
        if frozen.is_some() {
            return test.miss(frozen);
        }
        if test.is_beginning() {
            self.guidance.forget_tone(self.state);
        }
        let phasors = self.guidance.phasors(self.state, snapshot);
        // It has been built before.
        if let Ok(array) = self.config.array.build() {
            test.step(&array, self.config.phase.sample_rate_hz, snapshot, &phasors);
        }
        if !test.is_running() {
            self.guidance.forget_tone(self.state);
        }
    }

    /// Guidance steps; the link publishes the outcome, and does what is due. `ticks` is read before and after
    /// guidance.
    pub fn step(&mut self, step: &Step<'_>, mut ticks: impl FnMut() -> u32) -> Stepped {
        // With a radio the converters have no antennas.
        let radio = self.sensor.as_ref().and_then(Sensor::radio);
        let of_radio = radio.map(|radio| radio.bearing().map_or(FrontEnd::Nothing, FrontEnd::Bearing));
        let front_end = self.admit(of_radio.unwrap_or(step.front_end));
        let is_lidar = self.sensor.as_ref().is_some_and(|sensor| sensor.lidar().is_some());
        let begin = ticks();
        let heard = self
            .guidance
            .listen_with(self.state, front_end, |estimator, phasors| self.systems.bearing(estimator, phasors));
        let input = Input {
            now: step.now,
            front_end: heard.as_ref().map_or(FrontEnd::Nothing, FrontEnd::Measured),
            ownship: self.companion.ownship(),
            scan: match &*self.sensor {
                Some(Sensor::Lidar(lidar)) => lidar.scan(),
                _ => self.companion.scan(),
            },
            points: self.companion.points().filter(|_| !is_lidar),
            circles: step.circles,
            look: step.look,
            height_m: self.companion.height_m(step.now),
            is_landed: self.companion.landed() == Some(true),
            control: self.companion.control(step.now),
            answer: step.answer,
        };
        let output = self.guidance.step(self.state, &input);
        let taken = ticks().wrapping_sub(begin);
        self.companion.drop_obstacles();
        if let Some(sensor) = self.sensor {
            sensor.take();
        }
        self.reports.end_step();
        self.companion.publish(step.now, &output);
        if self.companion.wants_surroundings(step.now) {
            self.companion.publish_surroundings(step.now, self.state.map().circles());
        }
        self.companion.poll(step.now);
        Stepped { output, heard, plan: step.answer.map(|answer| answer.plan.id), ticks: taken }
    }
}
