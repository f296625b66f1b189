//! The tasks, the same on every board.
//!
//! | task | runs in | may be pre-empted by |
//! |---|---|---|
//! | frames, bytes, time | interrupts of the board | each other, by their priorities |
//! | [`guide`]: link and guidance, a step for every frame | the guidance executor, an interrupt | the above |
//! | [`transmit`]: bytes from the link to the serial line | the link executor, an interrupt | the above |
//! | [`listen`](crate::console::listen), [`speak`](crate::console::speak): the maintenance port | the link executor, too | the above |
//! | [`plan`] | the thread | everything |
//!
//! The thread runs no executor: it has only one task and sleeps by `wfi` when there is nothing to do. So it wakes in
//! the same way on the twin, where QEMU treats `wfe`, by which embassy's own thread executor sleeps, as a `nop`.
//!
//! A plan is passed to guidance in the step after it was finished; guidance uses it at a fixed tick after its
//! request, so that nothing depends on how long the replan took.
//!
//! [`foxhound_computer::store`] is the non-volatile storage. It is written in the steps of guidance, only outside
//! control.
//!
//! [`foxhound_computer::deadline`] decides whether a step is in time, and what a late one means for the vehicle. The
//! watchdog is fed here (`Feeder`) by a step that was in time; the only other place is the wait for a simulator's
//! frame.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embedded_storage::nor_flash::NorFlash;
use foxhound_computer::SAMPLES_PER_CHANNEL;
use foxhound_computer::camera::{self, Detector};
use foxhound_computer::deadline::{self, Monitor};
use foxhound_computer::flight::{self, Stepped};
use foxhound_computer::iq::Reports;
use foxhound_computer::log::Log;
use foxhound_computer::port::{self, Command, HELP, SensorCounters, SensorStatus, Status, Waiting};
use foxhound_computer::restart::{Cause, Restart};
use foxhound_computer::selftest::Refused;
use foxhound_computer::sensor::{self, Sensor};
use foxhound_computer::store::Store;
use foxhound_computer::timing::{Feeds, Task};
use foxhound_core::ConfigError;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::param::Values;
use foxhound_core::guidance::systems::Systems as _;
use foxhound_core::guidance::{self, Guidance};
use foxhound_core::landing::observation::PadObservation;
use foxhound_link::companion::{self, Companion, Exam, Pace, Tone};
use static_cell::{ConstStaticCell, StaticCell};

use crate::board::{Board, Call, Done, Pacer, Planned, Receiver, Step, Watchdog, Write as _};
use crate::console::Console;
use crate::timing::{self, measured};

mod planner;

pub use planner::{Desk, Planning, Shared, plan, planning};

/// Bytes that are taken from the link at a time; a frame that does not fit is continued.
const TRANSMIT_BYTES: usize = 256;

/// Bytes that are moved at a time.
const PIECE_BYTES: usize = 128;

/// With this many bytes in the pipe to the serial line, no more are sent there.
const WAITING_BYTES: usize = 128;

const OUTGOING_BYTES: usize = 512;

/// Bytes from guidance to the serial line; what does not fit waits in the link, where a newer setpoint replaces it.
pub type Outgoing = Pipe<CriticalSectionRawMutex, OUTGOING_BYTES>;

/// The bearing estimator and the planner. A vehicle has only the core's own.
#[cfg(not(feature = "papers"))]
type Systems = foxhound_core::planning::planner::Planner;
#[cfg(feature = "papers")]
type Systems = foxhound_papers::AllSystems;

type Flight<'a> = flight::Flight<'a, Systems>;

/// The state of guidance.
pub type State = guidance::State<SAMPLES_PER_CHANNEL>;

/// The samples of a plan that a board stores.
pub type Kept<B> = <<B as Board>::Pacer as Pacer>::Samples;

/// Bytes to the autopilot, from the pipe onto the serial line.
pub async fn transmit<B: Board>(mut line: B::Transmitter, outgoing: &'static Outgoing) {
    measured::<B, _>(Task::Transmit, async {
        let mut bytes = [0; PIECE_BYTES];
        loop {
            let count = outgoing.read(&mut bytes).await;
            line.write(bytes.get(..count).unwrap_or_default()).await;
        }
    })
    .await;
}

/// The watchdog, and how it is fed.
struct Feeder<B: Board> {
    watchdog: B::Watchdog,
    feeds: Feeds,
    /// The watchdog is not fed, as a test of its restart.
    is_starved: bool,
}

impl<B: Board> Feeder<B> {
    /// Feeds it, unless its restart is tested.
    fn feed(&mut self) {
        if !self.is_starved {
            self.watchdog.feed();
            self.feeds.feed(B::uptime_us());
        }
    }
}

/// The fast loop: executes the calls of the board's pacer, a step at a time.
pub async fn guide<B: Board>(
    mut pacer: B::Pacer,
    watchdog: B::Watchdog,
    restart: Restart,
    begun: Begun<B>,
    mut line: Line<B>,
    mut console: Console,
    mut planning: Planning<Kept<B>>,
) {
    let Begun { mut flight, mut store, start } = begun;
    let mut feeder = Feeder::<B> { watchdog, feeds: Feeds::default(), is_starved: false };
    // Whatever the cause of the reset: a vehicle that is flying in the mode now stays under its pilot's control until
    // the mode is left and entered again.
    flight.companion.require_entry();
    if restart.is_crash() {
        flight.companion.note_crash();
    }
    tell(&mut flight, &restart, start);
    console.log.begin(&restart.words(start), true, &flight);
    let mut monitor = Monitor::default();
    loop {
        pacer.follow(flight.config);
        pacer.sound(flight.receiver.test().wants_tone());
        // A pending notice must not be replaced.
        if !flight.companion.has_notice()
            && let Some(trouble) = pacer.trouble()
        {
            flight.companion.notify(trouble.chars().collect());
        }
        match pacer.next().await {
            Call::Setup { config, needs_entry } => {
                planning.settle().await;
                let begun = flight.begin_anew(config);
                if begun.is_ok() {
                    planning.begin_anew::<B>();
                    // A simulator that sets up a board for the first time may begin in the mode.
                    let needs_entry = needs_entry || restart.cause != Cause::Power;
                    if needs_entry {
                        flight.companion.require_entry();
                    }
                    tell(&mut flight, &restart, start);
                    look_for_pad(&mut console, flight.config);
                    store.overrule();
                    console.drain().await;
                    console.log.begin("set up", needs_entry, &flight);
                    console.drain().await;
                }
                pacer.accept(begun, line.tx_total).await;
                feeder.feed();
            }
            Call::Step(step) => {
                let lock_step = step.lock_step.is_some();
                let mut begin = B::ticks();
                line.read(&mut flight, &mut console.log, &step).await;
                timing::note::<B>(Task::Receive, B::ticks().wrapping_sub(begin));
                let look = console.look(&step, || feeder.feed()).await;
                if let Some(lock_step) = &step.lock_step {
                    // Waiting for the simulator does not count.
                    begin = (lock_step.begin)();
                }
                if flight.serve(&mut console.log.parameter_store(&mut store)) {
                    planning.begin_anew::<B>();
                    look_for_pad(&mut console, flight.config);
                }
                store.keep_up(step.now, flight.companion);
                let is_starved = step.lock_step.is_some_and(|lock_step| lock_step.holds_plan);
                let stepped = fly::<B>(&mut flight, &step, look, planning.answer::<B>().filter(|_| !is_starved));
                if !is_starved {
                    planning.take::<B>();
                }
                timing::note::<B>(Task::Step, stepped.ticks);
                let mut end = B::ticks();
                line.write(flight.companion, lock_step).await;
                if !lock_step {
                    end = B::ticks();
                }
                let taken_us = end.wrapping_sub(begin) / B::TICKS_PER_US;
                if monitor.step(taken_us, store.take_written()) {
                    feeder.feed();
                }
                let deadline::Counts { late, longest_us, .. } = monitor.counts();
                let ordered = stepped.output.plan_requested && planning.order(&flight);
                console.log.step(step.front_end, step.circles, look.as_ref(), &stepped, ordered);
                console.log.deadlines(monitor.counts());
                console.set_height(flight.state.height_m());
                let lost = pacer.lost().saturating_add(flight.receiver.frozen());
                let (mut lidar_bad, mut radio_bad) = (None, None);
                match &*flight.sensor {
                    Some(Sensor::Lidar(lidar)) => lidar_bad = Some(lidar.counters().bad),
                    Some(Sensor::Radio(radio)) => radio_bad = Some(radio.counters().refused),
                    None => {}
                }
                flight.companion.note_pace(Pace { longest_us, late, lost, lidar_bad, radio_bad });
                let Stepped { output, ticks: fast_ticks, .. } = stepped;
                if lock_step {
                    planning.settle().await;
                    console.drain().await;
                }
                let plan = planning.answer::<B>();
                pacer.done(Done { output, fast_ticks, late, tx_total: line.tx_total, plan }).await;
                if let Some(command) = console.command(flight.companion.control(output.time)) {
                    feeder.is_starved |= command == Command::Watchdog { is_sure: true };
                    if carry_out(command, &mut flight, &mut store, &mut console) {
                        console.drain().await;
                        B::restart();
                    }
                }
                if console.is_telling() {
                    console.tell(&Status {
                        board: B::NAME,
                        uptime_s: B::uptime_s(),
                        restart: &restart,
                        clock: pacer.clock(),
                        deadlines: monitor.counts(),
                        stack_bytes: pacer.stack_bytes(),
                        outcome: Some(output.outcome),
                        link: flight.companion.counters(),
                        line_errors: line.receiver.errors(),
                        received: line.receiver.waiting(),
                        sensor: flight.sensor.as_ref().map(|sensor| line.sensor_status(sensor)),
                        sent: Waiting { most: line.most_waiting, room: OUTGOING_BYTES as u32, lost: 0 },
                        log: console.waiting(),
                        starts: start,
                        feeds: feeder.feeds,
                        watchdog_us: <B::Watchdog as Watchdog>::PERIOD_US,
                    });
                }
                report(&mut flight, &mut store, &mut console.log);
                console.flush();
            }
        }
    }
}

/// Uses the configured pad from now on; if there is no detector for it, an error is logged.
#[inline(never)]
fn look_for_pad(console: &mut Console, config: &guidance::Config) {
    if let Err(error) = console.set_detector(config) {
        console.log.text("error: pad refused, the previous one is kept:");
        console.log.text(error.field);
    }
}

/// Reports why the computer has started, if the pilot should know.
fn tell(flight: &mut Flight<'_>, restart: &Restart, start: u32) {
    if restart.is_news() {
        flight.companion.notify(restart.words(start));
    }
}

/// The built-in configuration is invalid.
pub fn refuse<B: Board>(error: ConfigError) -> ! {
    // Without value and range: the formatting of numbers takes 17 KB of flash.
    B::halt(error.field)
}

/// Carries out a command of the maintenance port; true if it is a restart.
#[inline(never)]
fn carry_out<F: NorFlash>(
    command: Command,
    flight: &mut Flight<'_>,
    store: &mut Store<F>,
    console: &mut Console,
) -> bool {
    let log = &mut console.log;
    let mut examine = |exam| match flight.examine(exam) {
        Ok(()) => log.text("listens"),
        Err(Refused::Busy) => log.text("error: a test is running"),
        Err(Refused::InUse) => log.text("error: armed or in control"),
    };
    match command {
        Command::Help => HELP.iter().for_each(|line| log.text(line)),
        Command::Status => console.begin_status(),
        Command::FactoryReset { is_sure: false } => log.text("erases everything stored: type `factory-reset yes`"),
        Command::FactoryReset { is_sure: true } if store.factory_reset() => {
            log.text("forgotten; `restart` begins anew");
        }
        Command::FactoryReset { is_sure: true } => log.text("error: the flash cannot be erased"),
        Command::SelfTest { own_tone: false } => examine(Exam::SelfTest(Tone::Splitter)),
        Command::SelfTest { own_tone: true } => examine(Exam::SelfTest(Tone::Board)),
        Command::Calibrate => examine(Exam::Calibrate { azimuth_rad: None }),
        Command::Dump { frames } => {
            log.text("the samples follow");
            log.dump(frames);
        }
        Command::Watchdog { is_sure: false } => log.text("restarts by the watchdog: type `watchdog yes`"),
        Command::Watchdog { is_sure: true } => log.text("the watchdog is no longer fed"),
        Command::Restart => log.text("restarts"),
    }
    command == Command::Restart
}

/// Prints the result of a test of the receiver, and stores it if it is a calibration. Guidance has then started
/// afresh, and so does the log.
#[inline(never)]
fn report<F: NorFlash>(flight: &mut Flight<'_>, store: &mut Store<F>, log: &mut Log<'_>) {
    if let Some(report) = flight.take_report() {
        port::tell_report(&report, |line| log.text(line));
    }
    if let Some(calibration) = flight.take_calibration() {
        if !store.keep_calibration(&calibration) {
            log.text("error: calibration not stored");
            flight.companion.notify_text("Foxhound: calibration not stored");
        }
        log.begin("calibrated", true, flight);
    }
}

/// One step.
#[inline(never)]
fn fly<B: Board>(
    flight: &mut Flight<'_>,
    step: &Step<'_>,
    look: Option<PadObservation>,
    planned: Option<&Planned<Kept<B>>>,
) -> Stepped {
    let answer = planned.map(|planned| &planned.answer);
    let step = flight::Step { now: step.now, front_end: step.front_end, circles: step.circles, look, answer };
    flight.step(&step, B::ticks)
}

// The stack holds only one of the large parts at a time, while it is built: hence a function for each.

/// The parts of guidance at its start.
pub struct Begun<B: Board> {
    flight: Flight<'static>,
    store: Store<B::Flash>,
    /// The number of this start.
    start: u32,
}

impl<B: Board> Begun<B> {
    /// The detector for the configured pad.
    ///
    /// # Errors
    /// The field of the configuration that is refused.
    pub fn detector(&self) -> Result<Detector, ConfigError> {
        camera::detector(self.flight.config)
    }
}

/// The state at the start of the flight. Call it once, before anything else runs and while the stack is empty: it is
/// built there.
#[inline(never)]
pub fn first_state() -> &'static mut State {
    static STATE: StaticCell<State> = StaticCell::new();
    STATE.init_with(State::default)
}

/// The flight at its start, with the stored values. Call it once.
///
/// # Errors
/// The field of the built-in configuration that is refused.
#[inline(never)]
pub fn begin_with<B: Board>(state: &'static mut State, flash: B::Flash) -> Result<Begun<B>, ConfigError> {
    let mut store = Store::new(flash);
    let start = store.begin();
    let mut config = guidance::Config::default();
    store.calibrate(&mut config);
    let mut flight = begin::<B>(&config, state)?;
    store.resume(Instant(0), &mut flight);
    Ok(Begun { flight, store, start })
}

#[inline(never)]
fn begin<B: Board>(config: &guidance::Config, state: &'static mut State) -> Result<Flight<'static>, ConfigError> {
    static CONFIG: StaticCell<guidance::Config> = StaticCell::new();
    static SYSTEMS: StaticCell<Systems> = StaticCell::new();
    static RECEIVER: StaticCell<flight::Receiver> = StaticCell::new();
    let receiver = RECEIVER.init(flight::Receiver::new(B::SAMPLE_TIMER));
    let config = CONFIG.init(*config);
    receiver.fit(config)?;
    let guidance = first_guidance(config)?;
    let systems = SYSTEMS.init(Systems::build(config)?);
    let companion = first_companion(config)?;
    let (sensor, reports) = first_sensor(config)?;
    Ok(Flight { config, guidance, state, systems, companion, receiver, sensor, reports })
}

#[inline(never)]
fn first_guidance(config: &guidance::Config) -> Result<&'static mut Guidance<SAMPLES_PER_CHANNEL>, ConfigError> {
    static GUIDANCE: StaticCell<Guidance<SAMPLES_PER_CHANNEL>> = StaticCell::new();
    Ok(GUIDANCE.init(Systems::guidance(config)?))
}

#[inline(never)]
fn first_companion(config: &guidance::Config) -> Result<&'static mut Companion, ConfigError> {
    static COMPANION: StaticCell<Companion> = StaticCell::new();
    Ok(COMPANION.init(companion::Config::default().build_with(Values::of(config))?))
}

#[inline(never)]
fn first_sensor(config: &guidance::Config) -> Result<(&'static mut Option<Sensor>, &'static mut Reports), ConfigError> {
    static SENSOR: StaticCell<Option<Sensor>> = StaticCell::new();
    static REPORTS: ConstStaticCell<Reports> = ConstStaticCell::new(Reports::new());
    let reports = REPORTS.take();
    Ok((SENSOR.init(sensor::build(config, reports)?), reports))
}

/// The serial lines of guidance.
pub struct Line<B: Board> {
    receiver: B::Receiver,
    sensor: B::SensorReceiver,
    outgoing: &'static Outgoing,
    rx_total: u32,
    sensor_total: u32,
    /// Bytes of the sensor that were lost.
    sensor_missing: u32,
    tx_total: u32,
    /// The largest number of bytes that waited for the serial line at once.
    most_waiting: u32,
}

impl<B: Board> Line<B> {
    /// Before the first byte.
    #[must_use]
    pub const fn new(receiver: B::Receiver, sensor: B::SensorReceiver, outgoing: &'static Outgoing) -> Self {
        Self {
            receiver,
            sensor,
            outgoing,
            rx_total: 0,
            sensor_total: 0,
            sensor_missing: 0,
            tx_total: 0,
            most_waiting: 0,
        }
    }

    /// Passes received bytes on: in lock-step exactly those that belong before this step, otherwise those that wait and come
    /// meanwhile, in all no more than the buffer holds: no sender holds up the step.
    async fn read(&mut self, flight: &mut Flight<'_>, log: &mut Log<'_>, step: &Step<'_>) {
        let mut bytes = [0; PIECE_BYTES];
        let is_awaited = step.lock_step.is_some();
        let mut end = self.rx_total.wrapping_add(self.receiver.waiting().room);
        let mut sensor_end = self.sensor_total.wrapping_add(self.sensor.waiting().room);
        if let Some(lock_step) = &step.lock_step {
            (end, sensor_end) = (lock_step.rx_expected, lock_step.sensor_expected);
        }
        loop {
            let heard = take(&mut self.receiver, &mut self.rx_total, end, is_awaited, &mut bytes).await;
            if heard.is_empty() {
                break;
            }
            log.hear(heard);
            flight.hear(step.now, heard);
        }
        let mut is_torn = false;
        loop {
            let heard = take(&mut self.sensor, &mut self.sensor_total, sensor_end, is_awaited, &mut bytes).await;
            if heard.is_empty() {
                return;
            }
            // A line of angles has no checksum: where a byte was lost nothing of this step is read, and what it belongs to is no line.
            let missing = self.sensor.errors().wrapping_add(self.sensor.waiting().lost);
            is_torn |= core::mem::replace(&mut self.sensor_missing, missing) != missing;
            let heard = if is_torn && flight.hears_angles() { &[0][..] } else { heard };
            if flight.hear_sensor(step.now, heard) {
                log.hear_sensor(heard);
            }
        }
    }

    fn sensor_status(&self, sensor: &Sensor) -> SensorStatus {
        let counters = SensorCounters::of(sensor);
        SensorStatus { counters, received: self.sensor.waiting(), line_errors: self.sensor.errors() }
    }

    /// Sends the companion's bytes: in lock-step all, otherwise few at a time: a newer setpoint can replace one that
    /// waits in the companion, but not one in the pipe.
    async fn write(&mut self, companion: &mut Companion, lock_step: bool) {
        let mut bytes = [0; TRANSMIT_BYTES];
        while lock_step || self.outgoing.len() < WAITING_BYTES {
            let count = companion.transmit(&mut bytes);
            if count == 0 {
                return;
            }
            self.outgoing.write_all(bytes.get(..count).unwrap_or_default()).await;
            self.tx_total = self.tx_total.wrapping_add(count as u32);
            self.most_waiting = self.most_waiting.max(self.outgoing.len() as u32);
        }
    }
}

/// Reads bytes of a line, of which `total` have been read, up to `end`: in lock-step they are waited for, otherwise those that
/// are there.
async fn take<'a>(
    line: &mut impl Receiver,
    total: &mut u32,
    end: u32,
    is_awaited: bool,
    bytes: &'a mut [u8; PIECE_BYTES],
) -> &'a [u8] {
    let missing = (end.wrapping_sub(*total) as usize).min(bytes.len());
    let count = match bytes.get_mut(..missing) {
        Some(missing) if !missing.is_empty() => {
            if is_awaited {
                line.read(missing).await
            } else {
                line.try_read(missing)
            }
        }
        _ => 0,
    };
    *total = total.wrapping_add(count as u32);
    bytes.get(..count).unwrap_or_default()
}
