//! The whole fast loop: the median and the worst of the steps of a mission, and the worst possible input.

use core::f32::consts::{FRAC_PI_2, TAU};
use core::hint::black_box;

use crate::halt;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::ned::{Horizontal, Ned};
use foxhound_core::base::obstacle::{Circle, Disc};
use foxhound_core::base::ownship::Ownship;
use foxhound_core::base::pose::Pose;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::guidance::mission::Control;
use foxhound_core::guidance::{self, FrontEnd, Guidance, Input, Output};
use foxhound_core::mapping::map::{CIRCLES_MAX, DELIVERY_MAX};
use foxhound_core::mapping::scan::{Frame, POINTS_MAX, Points, Scan};
use foxhound_core::planning::planner::{Answer, Planner, Workspace};
use heapless::Vec;
use static_cell::{ConstStaticCell, StaticCell};

use crate::looks::{NOSE, TURN, ranges};
use crate::{N, receive, row};

/// The ceilings: of the median step of a mission, and of the worst that can be made, 950 000 of the 3 400 000 cycles of a
/// step.
const CEILING: u32 = 45_000;
const CEILING_WORST: u32 = 950_000;
/// With everything at once and a sensor all round it is above that; this ceiling keeps it where it is.
const CEILING_ALL_ROUND: u32 = 1_075_000;
/// The obstacle sensor scans at 10 Hz, the antennas deliver frames at 50 Hz.
const STEPS_PER_LOOK: usize = 5;
const STEP_US: u64 = 20_000;
const STEP_S: f32 = 0.02;
/// Steps of the flight whose median is a tracking frame, and those left out because they acquire.
const STEPS: usize = 112;
const WARM_UP: usize = 32;
/// Steps of a mission: as long as the built-in one takes.
const MISSION_STEPS: usize = 700;
/// Not on the stack, which the planner needs.
static COUNTS: ConstStaticCell<[u32; MISSION_STEPS]> = ConstStaticCell::new([0; MISSION_STEPS]);
/// The beacon is silent during these steps.
const SILENCE: core::ops::Range<usize> = 300..340;
const SOURCE_NED_M: Horizontal = Horizontal { north: 12.0, east: 3.0 };
/// Steps with the worst possible input.
const ABSURD_STEPS: usize = 400;
/// In the first of them the map is filled.
const FILLING: usize = 2;

/// The state stays in one place: a second one does not fit.
struct Loop<'a> {
    guidance: &'a Guidance<N>,
    planner: &'a Planner,
    workspace: &'a mut Workspace,
    snapshot: &'a mut AdcFrame<N>,
    state: &'a mut guidance::State<N>,
    answer: Option<Answer>,
}

/// Input of a step beside the antennas' frame.
#[derive(Default)]
struct Delivered<'a> {
    scan: Option<&'a Scan>,
    points: Option<&'a Points>,
    circles: Option<&'a [Circle]>,
}

impl Loop<'_> {
    fn restart(&mut self) {
        self.guidance.restart(self.state);
        self.answer = None;
    }

    /// One step, and its instructions.
    fn step(
        &mut self,
        measure: &impl Fn(&mut dyn FnMut()) -> u32,
        now: Instant,
        ownship: Ownship,
        azimuth_rad: Option<f32>,
        delivered: &Delivered<'_>,
    ) -> (u32, Option<Output>) {
        receive(self.snapshot, now.0 - STEP_US / 4, azimuth_rad);
        let input = Input {
            now,
            front_end: FrontEnd::Frame(self.snapshot),
            ownship: Some(ownship),
            scan: delivered.scan,
            points: delivered.points,
            circles: delivered.circles,
            look: None,
            height_m: None,
            is_landed: false,
            control: Control::Granted,
            answer: self.answer.as_ref(),
        };
        let mut output = None;
        let count = measure(&mut || output = Some(self.guidance.step(self.state, black_box(&input))));
        let requested = output.is_some_and(|output: Output| output.plan_requested);
        self.answer = requested.then(|| {
            let known: Vec<Disc, CIRCLES_MAX> = self.state.map().discs().collect();
            self.planner.answer(self.workspace, self.state.request(), &known)
        });
        (count, output)
    }
}

#[inline(never)]
pub(crate) fn rows(
    measure: &impl Fn(&mut dyn FnMut()) -> u32,
    guidance: &Guidance<N>,
    planner: &Planner,
    workspace: &mut Workspace,
    snapshot: &mut AdcFrame<N>,
) {
    let mut fast_loop = Loop { guidance, planner, workspace, snapshot, state: first_state(), answer: None };
    past_circles(measure, &mut fast_loop);
    mission(measure, &mut fast_loop);
    absurd(measure, &mut fast_loop);
}

/// In a function of its own: it is made on the stack.
#[inline(never)]
fn first_state() -> &'static mut guidance::State<N> {
    static STATE: StaticCell<guidance::State<N>> = StaticCell::new();
    STATE.init_with(guidance::State::default)
}

/// Past circles towards the source: the median of the steps, and of those with a scan.
#[inline(never)]
fn past_circles(measure: &impl Fn(&mut dyn FnMut()) -> u32, fast_loop: &mut Loop<'_>) {
    fast_loop.restart();
    let mut counts = [0_u32; STEPS - WARM_UP];
    let mut looks = [0_u32; (STEPS - WARM_UP) / STEPS_PER_LOOK];
    let circles: [Circle; 8] = core::array::from_fn(|k| Circle {
        center_ned_m: Horizontal { north: 1.5 * k as f32, east: if k % 2 == 0 { 2.0 } else { -2.0 } },
        radius_m: 0.4,
        ..Circle::default()
    });
    for step in 0..STEPS {
        let now = Instant((step as u64 + 1) * STEP_US);
        let ownship =
            at(now, Horizontal { north: 0.02 * step as f32, east: 0.0 }, Horizontal { north: 1.0, east: 0.0 }, 0.0);
        let circles = step.is_multiple_of(STEPS_PER_LOOK).then_some(&circles[..]);
        let delivered = Delivered { circles, ..Delivered::default() };
        let (count, _) = fast_loop.step(measure, now, ownship, Some(FRAC_PI_2 / 3.0), &delivered);
        let Some(step) = step.checked_sub(WARM_UP) else { continue };
        if let Some(slot) = counts.get_mut(step) {
            *slot = count;
        }
        if circles.is_some()
            && let Some(slot) = looks.get_mut(step / STEPS_PER_LOOK)
        {
            *slot = count;
        }
    }
    row("fast_loop_tracking", median(&mut counts), CEILING);
    row("fast_loop_looking", median(&mut looks), CEILING_WORST);
}

/// A mission from the first frame on, through pillars seen by a scanning sensor, to a beacon that is silent once.
#[inline(never)]
fn mission(measure: &impl Fn(&mut dyn FnMut()) -> u32, fast_loop: &mut Loop<'_>) {
    fast_loop.restart();
    let mut rng = Rng::new(8, 8);
    let pillars: [[f32; 3]; 24] = core::array::from_fn(|k| {
        let (row, column) = (k / 4, k % 4);
        [
            1.8 + 1.7 * row as f32 + 0.3 * rng.uniform(),
            1.6 * column as f32 - 2.0 + 0.8 * (row % 2) as f32 + 0.3 * rng.uniform(),
            0.10 + 0.2 * rng.uniform(),
        ]
    });
    let (mut place, mut velocity, mut yaw_rad) = (Horizontal::default(), Horizontal::default(), 0.2_f32);
    let (counts, mut heard) = (COUNTS.take(), 0_u32);
    for (step, slot) in counts.iter_mut().enumerate() {
        let now = Instant((step as u64 + 1) * STEP_US);
        let towards = SOURCE_NED_M.minus(place);
        let azimuth_rad = (!SILENCE.contains(&step)).then(|| wrap_pi(towards.bearing_rad() - yaw_rad));
        let pose = Pose { position_ned_m: place, yaw_rad };
        let looks = step.is_multiple_of(STEPS_PER_LOOK);
        let scan = looks.then(|| Scan { time: now, ..ranges(&pillars, &pose, NOSE, 0.005, &mut rng) });
        let delivered = Delivered { scan: scan.as_ref(), ..Delivered::default() };
        let ownship = at(now, place, velocity, yaw_rad);
        let (count, output) = fast_loop.step(measure, now, ownship, azimuth_rad, &delivered);
        *slot = count;
        let Some(output) = output else { return };
        heard += u32::from(output.bearing.is_some_and(|bearing| bearing.valid));
        let wanted = output.setpoint.velocity_ned_mps.horizontal();
        velocity = velocity.plus(wanted.minus(velocity).times(STEP_S / 0.15));
        place = place.plus(velocity.times(STEP_S));
        yaw_rad = wrap_pi(yaw_rad + output.setpoint.yaw_rate_radps * STEP_S);
    }
    let mostly = (MISSION_STEPS - SILENCE.len() - 40) as u32;
    if heard < mostly || place.norm() < 5.0 {
        halt(format_args!("the mission heard {heard} bearings and went {} cm", (100.0 * place.norm()) as i32));
    }
    row("fast_loop_mission", median(counts), CEILING);
    row("fast_loop_mission_worst", counts.last().copied().unwrap_or(0), CEILING_WORST);
}

/// Sorts counts and returns the median.
fn median(counts: &mut [u32]) -> u32 {
    counts.sort_unstable();
    counts.get(counts.len() / 2).copied().unwrap_or(0)
}

/// Random ranges in every ray with a full map, at 10 Hz; and all possible input at once, in every step: a random
/// scan, random points, as many new circles as a delivery holds, a full map, and a tone that is alternately lost and
/// found again.
#[inline(never)]
fn absurd(measure: &impl Fn(&mut dyn FnMut()) -> u32, fast_loop: &mut Loop<'_>) {
    let mut rng = Rng::new(14, 14);
    for (name, everything, view, ceiling) in [
        ("fast_loop_random_full_store", false, NOSE, CEILING_WORST),
        ("fast_loop_everything", true, NOSE, CEILING_WORST),
        ("fast_loop_everything_360", true, TURN, CEILING_ALL_ROUND),
    ] {
        fast_loop.restart();
        let mut worst = 0;
        for step in 0..ABSURD_STEPS {
            let now = Instant((step as u64 + 1) * STEP_US);
            let yaw_rad = wrap_pi(0.02 * step as f32);
            let place = Horizontal { north: 0.005 * step as f32, east: 0.0 };
            let pose = Pose { position_ned_m: place, yaw_rad };
            let looks = everything || step.is_multiple_of(STEPS_PER_LOOK);
            let scan = looks.then(|| Scan { time: now, ..ranges(&[], &pose, view, 0.0, &mut rng) });
            let points = everything.then(|| scatter(now, &mut rng));
            let circles = (everything || step < FILLING).then(|| crowd(place, &mut rng));
            let delivered = Delivered {
                scan: scan.as_ref(),
                points: points.as_ref(),
                circles: circles.as_ref().map(|circles| &circles[..]),
            };
            let ownship = at(now, place, Horizontal { north: 0.25, east: 0.0 }, yaw_rad);
            let sounds = !everything || step % 4 < 2;
            let azimuth_rad = sounds.then(|| wrap_pi(0.5 - yaw_rad));
            let (count, _) = fast_loop.step(measure, now, ownship, azimuth_rad, &delivered);
            worst = worst.max(if step < FILLING { 0 } else { count });
        }
        row(name, worst, ceiling);
    }
}

fn scatter(now: Instant, rng: &mut Rng) -> Points {
    let mut points = Points { time: now, frame: Frame::Body, ..Points::default() };
    for _ in 0..POINTS_MAX {
        let range_m = 0.3 + 3.0 * rng.uniform();
        // The capacity is as large.
        let _ = points.points_m.push(Horizontal::from_bearing(wrap_pi(TAU * rng.uniform())).times(range_m));
    }
    points
}

fn crowd(place: Horizontal, rng: &mut Rng) -> [Circle; DELIVERY_MAX] {
    core::array::from_fn(|_| {
        let away = Horizontal::from_bearing(wrap_pi(TAU * rng.uniform())).times(0.5 + 3.0 * rng.uniform());
        Circle {
            center_ned_m: place.plus(away),
            radius_m: 0.05 + 0.2 * rng.uniform(),
            velocity_ned_mps: Horizontal::default(),
        }
    })
}

fn at(now: Instant, place: Horizontal, velocity: Horizontal, yaw_rad: f32) -> Ownship {
    Ownship {
        position_time: now,
        position_ned_m: Ned { north: place.north, east: place.east, down: -2.0 },
        velocity_ned_mps: Ned { north: velocity.north, east: velocity.east, down: 0.0 },
        attitude_time: now,
        yaw_rad,
        ..Ownship::default()
    }
}
