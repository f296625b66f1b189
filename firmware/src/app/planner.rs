//! The planner and guidance's end of it: orders one way, plans the other.

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

/// Guidance's end of the planner: one order and one answer at a time, each written and read where it lies. Guidance gives no
/// second order before the handover tick of the first; one that finds the place taken even then is dropped, and its plan
/// counts as late.
pub struct Planning<S: 'static> {
    orders: Sender<'static, Mutex, Order>,
    plans: zerocopy_channel::Receiver<'static, Mutex, Planned<S>>,
    /// An order has no answer yet that was taken.
    is_ordered: bool,
    /// The next answer is to a flight that has ended.
    is_stale: bool,
}

/// The planner's own end.
pub struct Desk<S: 'static> {
    orders: zerocopy_channel::Receiver<'static, Mutex, Order>,
    plans: Sender<'static, Mutex, Planned<S>>,
}

/// An order to the planner.
#[derive(Clone, Debug)]
struct Order {
    /// With these.
    systems: Systems,
    /// Answer this.
    request: PlanRequest,
    /// Around these.
    known: Vec<Disc, CIRCLES_MAX>,
}

/// Both ends of the planner. To be called once.
///
/// # Errors
/// The field of the built-in configuration that is refused.
pub fn planning<S: Samples>(shared: &'static Shared<S>) -> Result<(Planning<S>, Desk<S>), ConfigError> {
    let systems = Systems::build(&guidance::Config::default())?;
    let order = shared.order.init_with(|| [Order { systems, request: PlanRequest::default(), known: Vec::new() }]);
    let [Order { systems, request, .. }] = &*order;
    let planned = [Planned { plan: systems.brake(request), samples_ned_m: S::NONE, ticks: 0 }];
    let planned = shared.planned.init(planned);
    let (order_tx, order_rx) = shared.orders.init_with(|| Channel::new(order)).split();
    let (plan_tx, plan_rx) = shared.plans.init_with(|| Channel::new(planned)).split();
    let planning = Planning { orders: order_tx, plans: plan_rx, is_ordered: false, is_stale: false };
    Ok((planning, Desk { orders: order_rx, plans: plan_tx }))
}

impl<S: Samples> Planning<S> {
    /// The answer that waits, if one does.
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

    /// What was ordered before is of no use any more.
    pub(super) fn begin_anew<B: Board>(&mut self) {
        self.take::<B>();
        self.is_stale = self.is_ordered;
    }

    /// Orders a plan; false where the planner takes no order.
    #[inline(never)]
    pub(super) fn order(&mut self, flight: &Flight<'_>) -> bool {
        let Some(order) = self.orders.try_send() else { return false };
        order.systems.clone_from(flight.systems);
        order.request.clone_from(flight.state.request());
        order.known.clear();
        for disc in flight.state.map().discs() {
            // There are as many places.
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

/// The planner: answers orders, and may be pre-empted at any moment. To be called by the thread when all is set up.
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
        // In this order: the plan wakes guidance, which may go on for many steps before we do, and order the next one.
        orders.receive_done();
        plans.send_done();
    }
}

/// Answers one order.
#[inline(never)]
fn replan<B: Board>(workspace: &mut Workspace, order: &Order, planned: &mut Planned<Kept<B>>) {
    let begin = B::ticks();
    planned.plan = order.systems.plan(workspace, &order.request, &order.known);
    planned.ticks = B::ticks().wrapping_sub(begin);
    for (kept, sample) in planned.samples_ned_m.as_mut().iter_mut().zip(&workspace.samples) {
        *kept = *sample;
    }
}
