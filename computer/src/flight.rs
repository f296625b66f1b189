//! One step of the flight computer. The firmware and the simulator both call these lines, so that their traces are equal
//! bit for bit:
//!
//! 1. the link takes in the bytes of the autopilot ([`Flight::hear`]), and the [`crate::lidar`] its own, where there is one
//!    ([`Flight::hear_lidar`]);
//! 2. what stations want of the parameters and of the receiver is done ([`Flight::serve`]);
//! 3. guidance steps, with what the link heard, the frame, and the plan that was finished in the step before; the link
//!    publishes the outcome and does what is due ([`Flight::step`]).
//!
//! A frame in which a channel [stands still](crate::frozen) is one that did not come. While the receiver is
//! [examined](crate::selftest), disarmed and outside control, frames go there, and guidance steps on without.
//!
//! Then the bytes of the link leave, and where guidance asks for a plan the planner makes one, which is handed over at the
//! next step.

use foxhound_core::ConfigError;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::array::{Entry, Table};
use foxhound_core::doa::calibration::deviation::Deviation;
use foxhound_core::doa::calibration::record::Calibration;
use foxhound_core::guidance::param::{Id, Values};
use foxhound_core::guidance::systems::Systems;
use foxhound_core::guidance::{self, FrontEnd, Guidance, Input, Measurement, Output};
use foxhound_core::landing::observation::PadObservation;
use foxhound_core::planning::planner::{Plan, Planner};
use foxhound_link::companion::{self, Companion, Exam, Examined};
use foxhound_link::params::Storage;

use crate::SAMPLES_PER_CHANNEL as N;
use crate::frozen::Watch;
use crate::lidar::{self, Lidar};
use crate::sampling::Timer;
use crate::selftest::{self, Channels, Check, Refused, SelfTest, Verdict};

/// Where parameters are kept while the power is off.
pub trait Mapper {
    /// Keeps these; false where that is not possible.
    fn save(&mut self, values: &Values) -> bool;
    /// What is kept; `None` where nothing is, or nothing that can be read.
    fn load(&mut self) -> Option<Values>;
    /// Forgets everything that was ever kept, parameters and whatever else; false where that is not possible.
    fn reset(&mut self) -> bool {
        self.save(&Values::DEFAULT)
    }
}

/// Where there is no place to keep them, there is none.
impl<K: Mapper> Mapper for Option<K> {
    fn save(&mut self, values: &Values) -> bool {
        self.as_mut().is_some_and(|mapper| mapper.save(values))
    }

    fn load(&mut self) -> Option<Values> {
        self.as_mut()?.load()
    }

    fn reset(&mut self) -> bool {
        self.as_mut().is_some_and(Mapper::reset)
    }
}

/// What one step is made of.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The time of the step: the only clock of guidance and link.
    pub now: Instant,
    /// What the antennas brought.
    pub front_end: FrontEnd<'a, N>,
    /// Obstacles that a sensor delivers as circles already.
    pub circles: Option<&'a [Circle]>,
    /// What the camera has seen.
    pub look: Option<PadObservation>,
    /// The planner's answer, once, as soon as there is one.
    pub plan: Option<&'a Plan>,
}

/// What one step came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stepped {
    /// What guidance said.
    pub output: Output,
    /// What it took from the antennas.
    pub heard: Option<Measurement>,
    /// The plan that was handed in, by its number.
    pub plan: Option<u32>,
    /// How long it took.
    pub ticks: u32,
}

/// What is known of the receiver beside its frames.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// What paces its samples, where that cannot be at any rate.
    timer: Option<Timer>,
    watch: Watch,
    test: SelfTest,
    /// The table is a new one, and has to be kept.
    is_calibrated: bool,
    /// What an examination came to has not been fetched.
    is_examined: bool,
}

impl Receiver {
    /// Nothing was heard of it yet.
    ///
    /// # Errors
    /// The field of the self-test's limits that is refused.
    pub fn new(timer: Option<Timer>, limits: &selftest::Config) -> Result<Self, ConfigError> {
        Ok(Self { timer, watch: Watch::new(), test: limits.build()?, is_calibrated: false, is_examined: false })
    }

    /// The examination that is under way or was the last.
    #[must_use]
    pub const fn test(&self) -> &SelfTest {
        &self.test
    }

    /// Frames in which a channel stood still, since the start.
    #[must_use]
    pub const fn frozen(&self) -> u32 {
        self.watch.frames()
    }

    /// Gives a configuration the sample rate that there will be in place of the one that was asked for.
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

/// Everything that a flight consists of, each where it stays.
#[derive(Debug)]
pub struct Flight<'a, S = Planner> {
    /// The configuration that holds.
    pub config: &'a mut guidance::Config,
    /// The fast loop.
    pub guidance: &'a mut Guidance<N>,
    /// What it carries from step to step.
    pub state: &'a mut guidance::State<N>,
    /// What finds bearings, and the slow loop, as it is to be ordered.
    pub systems: &'a mut S,
    /// The link.
    pub companion: &'a mut Companion,
    /// The receiver.
    pub receiver: &'a mut Receiver,
    /// The lidar on a line of our own, where obstacles are taken from it.
    pub lidar: &'a mut Option<Lidar>,
}

// The stack holds one of the large parts at a time, while it is built: hence a function for each.
impl<S: Systems> Flight<'_, S> {
    /// The next flight in the same place, with another link; the old one goes on if the configuration is refused.
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

    /// Guidance and systems with another configuration, from the start; the old one goes on if that is refused. The sample rate
    /// becomes the one that there will be.
    ///
    /// # Errors
    /// The field that is refused.
    #[inline(never)]
    fn set_up(&mut self, config: &mut guidance::Config) -> Result<(), ConfigError> {
        let systems = S::build(config)?;
        self.receiver.fit(config)?;
        match S::guidance(config) {
            Ok(guidance) => *self.guidance = guidance,
            Err(error) => return Err(error),
        }
        *self.systems = systems;
        self.guidance.restart(self.state);
        *self.config = *config;
        self.look_anew()
    }

    #[inline(never)]
    fn look_anew(&mut self) -> Result<(), ConfigError> {
        *self.lidar = lidar::build(self.config)?;
        Ok(())
    }

    #[inline(never)]
    fn listen_anew(&mut self) -> Result<(), ConfigError> {
        companion::Config::default().rebuild_with(self.companion, Values::of(self.config))
    }

    /// Starts afresh with all of these parameters, or goes on with the old ones.
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

    /// Takes in bytes of the autopilot.
    pub fn hear(&mut self, now: Instant, bytes: &[u8]) {
        self.companion.receive(now, bytes);
    }

    /// Takes in bytes of the lidar's line; true where they are of use to somebody.
    pub fn hear_lidar(&mut self, now: Instant, bytes: &[u8]) -> bool {
        let Some(lidar) = self.lidar else { return false };
        lidar.push(now, bytes);
        true
    }

    /// Does what stations want of the parameters, and what a restart of the autopilot asks for; true where guidance has
    /// started afresh, and plans that were ordered before are of no use any more.
    #[inline(never)]
    pub fn serve(&mut self, mapper: &mut impl Mapper) -> bool {
        let mut begins_anew = false;
        if let Some((id, values)) = self.companion.proposal() {
            let verdict = self.adopt(id, &values);
            self.companion.settle(verdict);
            begins_anew = verdict.is_ok();
        }
        if let Some(storage) = self.companion.take_storage() {
            let is_done = match storage {
                Storage::Save => mapper.save(self.companion.parameters()),
                Storage::Load => mapper.load().is_some_and(|values| self.run_with(values).is_ok()),
                Storage::Reset => self.run_with(Values::DEFAULT).is_ok() && mapper.reset(),
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

    /// Tries a parameter that somebody wants changed; it holds from this step on, which starts afresh.
    #[inline(never)]
    fn adopt(&mut self, id: Id, values: &Values) -> Result<(), ConfigError> {
        let mut config = *self.config;
        values.apply_one(id, &mut config);
        self.set_up(&mut config)
    }

    /// Begins to examine the receiver, or to calibrate it.
    ///
    /// # Errors
    /// It is examined already, or the vehicle is in use.
    #[inline(never)]
    pub fn examine(&mut self, exam: Exam) -> Result<(), Refused> {
        if !self.companion.may_examine() {
            return Err(Refused::InUse);
        }
        self.receiver.test.begin(exam)
    }

    /// Says what an examination came to, once, and takes a calibration over; true if guidance has started afresh with it.
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

    /// What an examination has come to since the last call.
    pub fn take_report(&mut self) -> Option<selftest::Report> {
        let is_examined = core::mem::take(&mut self.receiver.is_examined);
        self.receiver.test.report().filter(|_| is_examined).copied()
    }

    /// The calibration that was found on board since the last call, to be kept; it says nothing of the airframe's deviation.
    pub fn take_calibration(&mut self) -> Option<Calibration> {
        let table = self.config.array.calibration.filter(|_| core::mem::take(&mut self.receiver.is_calibrated))?;
        Some(Calibration { table, deviation: Deviation::default() })
    }

    /// What guidance gets of what the antennas brought: no frame that cannot be one, and none while they are examined.
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
        // It was built before.
        if let Ok(array) = self.config.array.build() {
            test.step(&array, self.config.phase.sample_rate_hz, snapshot, &phasors);
        }
        if !test.is_running() {
            self.guidance.forget_tone(self.state);
        }
    }

    /// Guidance steps; the link publishes what it came to, and does what is due. `ticks` is read before and after guidance.
    pub fn step(&mut self, step: &Step<'_>, mut ticks: impl FnMut() -> u32) -> Stepped {
        let front_end = self.admit(step.front_end);
        let begin = ticks();
        let heard = self
            .guidance
            .listen_with(self.state, front_end, |estimator, phasors| self.systems.bearing(estimator, phasors));
        let input = Input {
            now: step.now,
            front_end: heard.as_ref().map_or(FrontEnd::Nothing, FrontEnd::Measured),
            ownship: self.companion.ownship(),
            scan: match &*self.lidar {
                Some(lidar) => lidar.scan(),
                None => self.companion.scan(),
            },
            points: self.companion.points().filter(|_| self.lidar.is_none()),
            circles: step.circles,
            look: step.look,
            height_m: self.companion.height_m(step.now),
            is_landed: self.companion.landed() == Some(true),
            control: self.companion.control(step.now),
            plan: step.plan,
        };
        let output = self.guidance.step(self.state, &input);
        let taken = ticks().wrapping_sub(begin);
        self.companion.drop_obstacles();
        if let Some(lidar) = self.lidar {
            lidar.take();
        }
        self.companion.publish(step.now, &output);
        if self.companion.wants_surroundings(step.now) {
            self.companion.publish_surroundings(step.now, self.state.map().circles());
        }
        self.companion.poll(step.now);
        Stepped { output, heard, plan: step.plan.map(|plan| plan.id), ticks: taken }
    }
}
