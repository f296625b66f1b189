//! The tasks: link, guidance and planner, the same on every board.
//!
//! Guidance and link run in an interrupt executor, the planner in another of the lowest priority: every step pre-empts
//! a replan that is under way. A plan is handed to guidance at the step after it was finished; guidance itself takes
//! it up at a fixed tick after its request, so that nothing depends on how long the replan took.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use foxhound_core::ConfigError;
use foxhound_core::frame::Horizontal;
use foxhound_core::guidance::{self, Guidance, Input, Output};
use foxhound_core::param::{Id, Values};
use foxhound_core::planner::{Plan, PlanRequest, Planner, SAMPLES, Scratch};
use foxhound_core::rollout::WAYPOINTS;
use foxhound_link::companion::{self, Companion};
use static_cell::{ConstStaticCell, StaticCell};

use crate::boards::board::{self, Pacer, Receiver, Transmitter};
use crate::boards::{Call, Done, Step};

/// Samples of one channel in one snapshot.
pub const SAMPLES_PER_CHANNEL: usize = 256;

/// Room for some whole MAVLink frames.
const TRANSMIT_BYTES: usize = 512;

/// With so many bytes on their way to the serial line, no more are sent there.
const WAITING_BYTES: usize = 128;

/// Bytes from the serial line to guidance: what arrives in a step of 20 ms at 921 600 baud.
pub type Incoming = Pipe<CriticalSectionRawMutex, 2048>;

/// Bytes from guidance to the serial line; what does not fit waits in the link, where a newer setpoint replaces it.
pub type Outgoing = Pipe<CriticalSectionRawMutex, 1024>;

/// What the planner is to do; a newer order replaces one that it has not begun.
pub type Orders = Signal<CriticalSectionRawMutex, Order>;

/// What the planner has found; a newer plan replaces one that nobody has taken.
pub type Plans = Signal<CriticalSectionRawMutex, Planned>;

/// An order to the planner.
#[derive(Clone, Debug)]
pub struct Order {
    /// With this one.
    pub planner: Planner,
    /// Answer this.
    pub request: PlanRequest,
}

/// A plan, and how it came about.
#[derive(Clone, Debug)]
pub struct Planned {
    /// The plan.
    pub plan: Plan,
    /// The sampled trajectories that it was made from.
    pub samples_ned_m: [[Horizontal; WAYPOINTS]; SAMPLES],
    /// Length of the replan, in `board::ticks`.
    pub ticks: u32,
}

/// Bytes of the autopilot, from the serial line into the pipe.
#[embassy_executor::task]
pub async fn receive(mut line: Receiver, incoming: &'static Incoming) {
    let mut bytes = [0; 256];
    loop {
        let count = line.read(&mut bytes).await;
        incoming.write_all(bytes.get(..count).unwrap_or_default()).await;
    }
}

/// Bytes to the autopilot, from the pipe onto the serial line.
#[embassy_executor::task]
pub async fn transmit(mut line: Transmitter, outgoing: &'static Outgoing) {
    let mut bytes = [0; 256];
    loop {
        let count = outgoing.read(&mut bytes).await;
        line.write(bytes.get(..count).unwrap_or_default()).await;
    }
}

/// The planner: answers orders, and may be pre-empted at any moment.
#[embassy_executor::task]
pub async fn plan(orders: &'static Orders, plans: &'static Plans) {
    static SCRATCH: ConstStaticCell<Scratch> = ConstStaticCell::new(Scratch::new());
    let scratch = SCRATCH.take();
    loop {
        let order = orders.wait().await;
        let begin = board::ticks();
        let plan = order.planner.plan(scratch, &order.request);
        let ticks = board::ticks().wrapping_sub(begin);
        plans.signal(Planned { plan, samples_ned_m: scratch.samples, ticks });
    }
}

/// The fast loop: does what the board's pacer says, a step at a time.
#[embassy_executor::task]
pub async fn guide(
    mut pacer: Pacer,
    incoming: &'static Incoming,
    outgoing: &'static Outgoing,
    orders: &'static Orders,
    plans: &'static Plans,
) {
    let mut flight = match Flight::begin(&guidance::Config::default()) {
        Ok(flight) => flight,
        // Not its value and range: to write numbers takes 17 KB of flash.
        Err(error) => board::halt(format_args!("the built-in configuration: {}", error.field)),
    };
    let mut line = Line { incoming, outgoing, rx_total: 0, tx_total: 0 };
    let mut plan = None;
    let mut last_request = None;
    loop {
        match pacer.next().await {
            Call::Setup(config) => {
                let settled = settle(plans, &mut last_request).await;
                let begun = flight.begin_anew(&config);
                plan = if begun.is_ok() { None } else { settled.or(plan) };
                pacer.accept(begun, line.tx_total).await;
            }
            Call::Step(step) => {
                let lock_step = step.lock_step.is_some();
                line.read(flight.companion, &step).await;
                if flight.serve() {
                    // It was for what guidance was before.
                    plan = None;
                    plans.reset();
                }
                if !lock_step {
                    plan = plans.try_take();
                }
                let (output, fast_ticks) = flight.step(&step, plan.as_ref());
                line.write(flight.companion, lock_step).await;
                if output.plan_requested {
                    let request = flight.state.request().clone();
                    last_request = Some(request.id);
                    orders.signal(Order { planner: flight.planner.clone(), request });
                }
                plan = if lock_step { settle(plans, &mut last_request).await } else { None };
                pacer.done(Done { output, fast_ticks, tx_total: line.tx_total, plan: plan.as_ref() }).await;
            }
        }
    }
}

/// Waits until the planner is idle; its answer to the last request, if that was still to come.
async fn settle(plans: &'static Plans, last_request: &mut Option<u32>) -> Option<Planned> {
    let id = last_request.take()?;
    loop {
        let planned = plans.wait().await;
        if planned.plan.id == id {
            return Some(planned);
        }
    }
}

/// Everything that is begun anew with a configuration, each where it stays.
struct Flight {
    config: guidance::Config,
    guidance: &'static mut Guidance<SAMPLES_PER_CHANNEL>,
    state: &'static mut guidance::State<SAMPLES_PER_CHANNEL>,
    planner: Planner,
    companion: &'static mut Companion,
}

// The stack holds one of these at a time, while it is built: hence a function for each, and none inlined into the step.
impl Flight {
    fn begin(config: &guidance::Config) -> Result<Self, ConfigError> {
        let guidance = Self::first_guidance(config)?;
        let state = Self::first_state(guidance);
        Ok(Self {
            config: *config,
            state,
            guidance,
            planner: config.planner.build()?,
            companion: Self::first_companion(config)?,
        })
    }

    #[inline(never)]
    fn first_guidance(config: &guidance::Config) -> Result<&'static mut Guidance<SAMPLES_PER_CHANNEL>, ConfigError> {
        static GUIDANCE: StaticCell<Guidance<SAMPLES_PER_CHANNEL>> = StaticCell::new();
        Ok(GUIDANCE.init(config.build()?))
    }

    #[inline(never)]
    fn first_state(guidance: &Guidance<SAMPLES_PER_CHANNEL>) -> &'static mut guidance::State<SAMPLES_PER_CHANNEL> {
        static STATE: StaticCell<guidance::State<SAMPLES_PER_CHANNEL>> = StaticCell::new();
        STATE.init_with(|| guidance.start())
    }

    #[inline(never)]
    fn first_companion(config: &guidance::Config) -> Result<&'static mut Companion, ConfigError> {
        static COMPANION: StaticCell<Companion> = StaticCell::new();
        let companion = COMPANION.init(companion::Config::default().build_with(Values::of(config))?);
        // Whatever reset us: a vehicle that is flying in the mode by then is its pilot's until the mode is entered afresh.
        companion.require_entry();
        Ok(companion)
    }

    /// The next flight in the same place; the old one goes on if the configuration is refused.
    fn begin_anew(&mut self, config: &guidance::Config) -> Result<(), ConfigError> {
        self.set_up(config)?;
        self.listen_anew()
    }

    /// Guidance and planner with another configuration, from the start; the old one goes on if that is refused.
    #[inline(never)]
    fn set_up(&mut self, config: &guidance::Config) -> Result<(), ConfigError> {
        let planner = config.planner.build()?;
        *self.guidance = config.build()?;
        self.planner = planner;
        self.guidance.restart(self.state);
        self.config = *config;
        Ok(())
    }

    #[inline(never)]
    fn listen_anew(&mut self) -> Result<(), ConfigError> {
        *self.companion = companion::Config::default().build_with(Values::of(&self.config))?;
        Ok(())
    }

    /// Tries a parameter that somebody wants changed; it holds from this step on, which starts afresh.
    #[inline(never)]
    fn adopt(&mut self, id: Id, values: &Values) -> Result<(), ConfigError> {
        let mut config = self.config;
        values.apply_one(id, &mut config);
        self.set_up(&config)
    }

    /// What stations want done about the parameters; true where guidance starts afresh.
    #[inline(never)]
    fn serve(&mut self) -> bool {
        if self.companion.take_storage().is_some() {
            // There is none yet.
            self.companion.stored(false);
        }
        let mut begins_anew = false;
        if let Some((id, values)) = self.companion.proposal() {
            let verdict = self.adopt(id, &values);
            self.companion.settle(verdict);
            begins_anew = verdict.is_ok();
        }
        if self.companion.take_world_lost() {
            self.guidance.restart(self.state);
            begins_anew = true;
        }
        begins_anew
    }

    /// One step, and how long guidance took. The simulator does the same in the same order: bit for bit.
    fn step(&mut self, step: &Step<'_>, plan: Option<&Planned>) -> (Output, u32) {
        let (scan, points) = (self.companion.take_scan(), self.companion.take_points());
        let input = Input {
            now: step.now,
            front_end: step.front_end,
            ownship: self.companion.ownship(),
            scan: scan.as_ref(),
            points: points.as_ref(),
            circles: step.circles,
            control: self.companion.control(step.now),
            plan: plan.map(|planned| &planned.plan),
        };
        let begin = board::ticks();
        let output = self.guidance.step(self.state, &input);
        let ticks = board::ticks().wrapping_sub(begin);
        self.companion.publish(step.now, &output);
        if self.companion.wants_surroundings(step.now) {
            self.companion.publish_surroundings(step.now, self.state.map().circles());
        }
        self.companion.poll(step.now);
        (output, ticks)
    }
}

/// The serial line as guidance sees it.
struct Line {
    incoming: &'static Incoming,
    outgoing: &'static Outgoing,
    rx_total: u32,
    tx_total: u32,
}

impl Line {
    /// Hands over what has come: in lock-step exactly what belongs before this step, else what there is.
    async fn read(&mut self, companion: &mut Companion, step: &Step<'_>) {
        let mut bytes = [0; 256];
        loop {
            let count = match step.lock_step {
                Some(expected) => {
                    let missing = (expected.wrapping_sub(self.rx_total) as usize).min(bytes.len());
                    match bytes.get_mut(..missing) {
                        Some(missing) if !missing.is_empty() => self.incoming.read(missing).await,
                        _ => return,
                    }
                }
                None => match self.incoming.try_read(&mut bytes) {
                    Ok(count) => count,
                    Err(_) => return,
                },
            };
            self.rx_total = self.rx_total.wrapping_add(count as u32);
            companion.receive(step.now, bytes.get(..count).unwrap_or_default());
        }
    }

    /// Sends what the companion has to say: in lock-step all of it, else little at a time: what waits there a newer setpoint
    /// can replace, what waits in the pipe it cannot.
    async fn write(&mut self, companion: &mut Companion, lock_step: bool) {
        let mut bytes = [0; TRANSMIT_BYTES];
        while lock_step || self.outgoing.len() < WAITING_BYTES {
            let count = companion.transmit(&mut bytes);
            if count == 0 {
                return;
            }
            self.outgoing.write_all(bytes.get(..count).unwrap_or_default()).await;
            self.tx_total = self.tx_total.wrapping_add(count as u32);
        }
    }
}
