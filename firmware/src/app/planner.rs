//! The planner task and guidance's side of it: requests in, plans out.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::{self, Channel, Sender};
use foxhound_computer::timing::Task;
use foxhound_core::ConfigError;
use foxhound_core::base::obstacle::Disc;
use foxhound_core::guidance;
use foxhound_core::guidance::systems::Systems as _;
use foxhound_core::mapping::map::CIRCLES_MAX;
use foxhound_core::planning::planner::{PlanRequest, Workspace};
use heapless::Vec;
use static_cell::{ConstStaticCell, StaticCell};

use super::{Flight, Kept, Systems};
use crate::board::{Board, Planned, Samples};
use crate::timing;

type Mutex = CriticalSectionRawMutex;

/// The memory that both ends of the planner share.
pub struct Shared<S: 'static> {
    order: StaticCell<[Order; 1]>,
    planned: StaticCell<[Planned<S>; 1]>,
    orders: StaticCell<Channel<'static, Mutex, Order>>,
    plans: StaticCell<Channel<'static, Mutex, Planned<S>>>,
}

impl<S> Shared<S> {
    /// Not in use yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            order: StaticCell::new(),
            planned: StaticCell::new(),
            orders: StaticCell::new(),
            plans: StaticCell::new(),
        }
    }
}

impl<S> Default for Shared<S> {
    fn default() -> Self {
        Self::new()
    }
}

/// Guidance's side of the planner: one request and one answer at a time, each written and read in place. Guidance
/// makes no second request before the handover tick of the first; if the place is still taken then, the request is
/// dropped, and its plan counts as late.
pub struct Planning<S: 'static> {
    orders: Sender<'static, Mutex, Order>,
    plans: zerocopy_channel::Receiver<'static, Mutex, Planned<S>>,
    /// The answer to the last request has not been taken yet.
    is_ordered: bool,
    /// The next answer belongs to a flight that has ended.
    is_stale: bool,
    /// The systems have changed since the last request.
    is_new: bool,
}

/// The planner's side.
pub struct Desk<S: 'static> {
    orders: zerocopy_channel::Receiver<'static, Mutex, Order>,
    plans: Sender<'static, Mutex, Planned<S>>,
}

/// A request to the planner.
#[derive(Clone, Debug)]
struct Order {
    /// The systems to use. There is one order, written in place: they stay from request to request.
    systems: Systems,
    /// The request.
    request: PlanRequest,
    /// The known obstacles.
    known: Vec<Disc, CIRCLES_MAX>,
}

/// Both sides of the planner. Call it once.
///
/// # Errors
/// The field of the built-in configuration that is refused.
pub fn planning<S: Samples>(shared: &'static Shared<S>) -> Result<(Planning<S>, Desk<S>), ConfigError> {
    let systems = Systems::build(&guidance::Config::default())?;
    let order = shared.order.init_with(|| [Order { systems, request: PlanRequest::default(), known: Vec::new() }]);
    let [Order { systems, request, .. }] = &*order;
    let planned = [Planned { answer: systems.brake(request), samples_ned_m: S::NONE, ticks: 0 }];
    let planned = shared.planned.init(planned);
    let (order_tx, order_rx) = shared.orders.init_with(|| Channel::new(order)).split();
    let (plan_tx, plan_rx) = shared.plans.init_with(|| Channel::new(planned)).split();
    let planning = Planning { orders: order_tx, plans: plan_rx, is_ordered: false, is_stale: false, is_new: true };
    Ok((planning, Desk { orders: order_rx, plans: plan_tx }))
}

impl<S: Samples> Planning<S> {
    /// The answer, if one waits.
    pub(super) fn answer<B: Board>(&mut self) -> Option<&Planned<S>> {
        if self.is_stale && self.plans.try_receive().is_some() {
            self.take::<B>();
        }
        self.plans.try_receive().map(|planned| &*planned)
    }

    /// The answer has been used.
    pub(super) fn take<B: Board>(&mut self) {
        if let Some(planned) = self.plans.try_receive() {
            timing::note::<B>(Task::Plan, planned.ticks);
            self.plans.receive_done();
            (self.is_ordered, self.is_stale) = (false, false);
        }
    }

    /// Earlier requests are of no use any more, and the systems may have changed.
    pub(super) fn begin_anew<B: Board>(&mut self) {
        self.take::<B>();
        (self.is_stale, self.is_new) = (self.is_ordered, true);
    }

    /// Requests a plan; false if the planner is busy.
    #[inline(never)]
    pub(super) fn order(&mut self, flight: &Flight<'_>) -> bool {
        let Some(order) = self.orders.try_send() else { return false };
        if core::mem::take(&mut self.is_new) {
            order.systems.clone_from(flight.systems);
        }
        order.request.clone_from(flight.state.request());
        order.known.clear();
        for disc in flight.state.map().discs() {
            // The capacity is the number of circles.
            let _ = order.known.push(disc);
        }
        self.orders.send_done();
        self.is_ordered = true;
        true
    }

    /// Waits until the planner is idle; its answer stays where it is.
    pub(super) async fn settle(&mut self) {
        if self.is_ordered {
            self.plans.receive().await;
        }
    }
}

/// The planner: answers requests, and may be pre-empted at any moment. The thread calls it when everything is set up.
pub fn plan<B: Board>(desk: Desk<Kept<B>>) -> ! {
    static SCRATCH: ConstStaticCell<Workspace> = ConstStaticCell::new(Workspace::new());
    let workspace = SCRATCH.take();
    let Desk { mut orders, mut plans } = desk;
    loop {
        let (Some(order), Some(planned)) = (orders.try_receive(), plans.try_send()) else {
            B::sleep_unless(|| !orders.is_empty() && !plans.is_full());
            continue;
        };
        replan::<B>(workspace, order, planned);
        // In this order: the plan wakes guidance, which may run many steps before this task, and make the next
        // request.
        orders.receive_done();
        plans.send_done();
    }
}

/// Answers one request.
#[inline(never)]
fn replan<B: Board>(workspace: &mut Workspace, order: &Order, planned: &mut Planned<Kept<B>>) {
    let begin = B::ticks();
    planned.answer = order.systems.answer(workspace, &order.request, &order.known);
    planned.ticks = B::ticks().wrapping_sub(begin);
    for (kept, sample) in planned.samples_ned_m.as_mut().iter_mut().zip(&workspace.samples) {
        *kept = *sample;
    }
}
