//! Instruction counts of the rooms, in QEMU: `cargo xtask bench`.
//!
//! Under `-icount shift=8` an instruction takes 256 ns of the machine's time, 6.4 ticks of its 25 MHz timer, so the
//! timer tells single instructions apart. Each row is what lies between two readings of the timer, less what lies
//! between them around a closure that does nothing. A line a row on the semihosting output: name, instructions, ceiling
//! (design, section 6; 0 where there is none).
#![no_std]
#![no_main]

use core::f32::consts::{FRAC_PI_2, TAU};
use core::hint::black_box;

use foxhound_core::adc::Snapshot;
use foxhound_core::frame::{Horizontal, Ned};
use foxhound_core::guidance::{self, FrontEnd, Guidance, Input};
use foxhound_core::map::{CIRCLES_MAX, Circle};
use foxhound_core::mission::Control;
use foxhound_core::ownship::Ownship;
use foxhound_core::phase;
use foxhound_core::planner::{PlanRequest, Planner, Scratch};
use foxhound_core::rng::Rng;
use foxhound_core::spectrum::tone::{Reference, Window};
use foxhound_core::spectrum::{Backend, Spectrum};
use foxhound_core::time::Instant;
use foxhound_core::units::sin_cos;
use foxhound_firmware::app::SAMPLES_PER_CHANNEL as N;
use foxhound_firmware::boards::board;
use foxhound_link::mailbox::instructions;
use static_cell::ConstStaticCell;

/// Steps of the flight that the fast loop is measured in; the first ones acquire.
const STEPS: usize = 96;
const WARM_UP: usize = 32;
/// The tone, in bins, off the grid.
const TONE_BINS: f32 = 20.3;
const STEP_US: u64 = 20_000;

static SNAPSHOT: ConstStaticCell<Snapshot<N>> = ConstStaticCell::new(Snapshot::zeroed());

#[cortex_m_rt::entry]
fn main() -> ! {
    let _board = board::start();
    let empty = count(&mut || {});
    let measure = |task: &mut dyn FnMut()| count(task).saturating_sub(empty);

    let snapshot = SNAPSHOT.take();
    receive(snapshot, 0);
    front_end(&measure, snapshot);
    let config = guidance::Config::default();
    let (Ok(guidance), Ok(planner)) = (config.build(), config.planner.build()) else {
        board::halt(format_args!("the built-in configuration does not build"))
    };
    fast_loop(&measure, &guidance, &planner, snapshot);
    replan(&measure, &planner);
    semihosting::process::exit(0)
}

/// Instructions of a task, with the call and the two readings.
#[inline(never)]
fn count(task: &mut dyn FnMut()) -> u32 {
    let task = black_box(task);
    let begin = board::ticks();
    task();
    instructions(board::ticks().wrapping_sub(begin))
}

fn row(name: &str, instructions: u32, ceiling: u32) {
    semihosting::println!("{name} {instructions} {ceiling}");
}

fn front_end(measure: &impl Fn(&mut dyn FnMut()) -> u32, snapshot: &Snapshot<N>) {
    let mut reference = Reference::<N>::default();
    reference.tune((TONE_BINS / N as f32 * 4_294_967_296.0) as u32, Window::Flat);
    row(
        "phasors",
        measure(&mut || {
            black_box(reference.products(&black_box(snapshot).codes));
        }),
        1_900,
    );

    let mut spectrum = Spectrum::<N>::default();
    let mut scratch = [0.0; N];
    row(
        "spectrum",
        measure(&mut || black_box(&mut spectrum).measure(Backend::Fixed, &black_box(snapshot).codes, &mut scratch)),
        26_000,
    );

    let config = guidance::Config::default();
    let (Ok(extractor), Ok(array)) = (config.phase.build::<N>(), config.array.build()) else {
        board::halt(format_args!("the built-in front end does not build"))
    };
    let Ok(finder) = config.bearing.build(array) else {
        board::halt(format_args!("the built-in estimator does not build"))
    };
    let mut state = phase::State::default();
    let mut phasors = None;
    row("phase_acquiring", measure(&mut || phasors = Some(extractor.step(&mut state, black_box(snapshot)))), 0);
    row("phase_tracking", measure(&mut || phasors = Some(extractor.step(&mut state, black_box(snapshot)))), 0);
    if let Some(phasors) = phasors {
        row(
            "bearing",
            measure(&mut || {
                black_box(finder.find(black_box(&phasors)));
            }),
            4_000,
        );
    }
}

/// A flight past obstacles towards the source: the middle and the worst of its steps.
fn fast_loop(
    measure: &impl Fn(&mut dyn FnMut()) -> u32,
    guidance: &Guidance<N>,
    planner: &Planner,
    snapshot: &mut Snapshot<N>,
) {
    let mut state = guidance.start();
    let mut scratch = Scratch::default();
    let mut plan = None;
    let mut counts = [0_u32; STEPS - WARM_UP];
    let circles: [Circle; 8] = core::array::from_fn(|k| {
        let side = if k % 2 == 0 { 2.0 } else { -2.0 };
        Circle {
            center_ned_m: Horizontal { north: 1.5 * k as f32, east: side },
            radius_m: 0.4,
            velocity_ned_mps: Horizontal::default(),
        }
    });
    for step in 0..STEPS {
        let now = Instant((step as u64 + 1) * STEP_US);
        receive(snapshot, now.0 - STEP_US / 4);
        let ownship = Ownship {
            position_time: now,
            position_ned_m: Ned { north: 0.02 * step as f32, east: 0.0, down: -2.0 },
            velocity_ned_mps: Ned { north: 1.0, east: 0.0, down: 0.0 },
            attitude_time: now,
            ..Ownship::default()
        };
        let input = Input {
            now,
            front_end: FrontEnd::Snapshot(snapshot),
            ownship: Some(ownship),
            scan: None,
            circles: Some(&circles),
            control: Control::Granted,
            plan: plan.as_ref(),
        };
        let mut requested = false;
        let instructions = measure(&mut || requested = guidance.step(&mut state, black_box(&input)).plan_requested);
        plan = requested.then(|| planner.plan(&mut scratch, state.request()));
        if let Some(count) = step.checked_sub(WARM_UP).and_then(|step| counts.get_mut(step)) {
            *count = instructions;
        }
    }
    counts.sort_unstable();
    row("fast_loop_tracking", counts.get(counts.len() / 2).copied().unwrap_or(0), 45_000);
    row("fast_loop_worst", counts.last().copied().unwrap_or(0), 0);
}

/// Sixty-four obstacles between the start and the target and around them.
fn replan(measure: &impl Fn(&mut dyn FnMut()) -> u32, planner: &Planner) {
    let mut rng = Rng::new(1, 1);
    let mut request =
        PlanRequest { id: 1, target_ned_m: Horizontal { north: 2.0, east: 0.0 }, ..PlanRequest::default() };
    for _ in 0..CIRCLES_MAX {
        let circle = Circle {
            center_ned_m: Horizontal { north: 8.0 * rng.uniform() - 3.0, east: 8.0 * rng.uniform() - 4.0 },
            radius_m: 0.1 + 0.2 * rng.uniform(),
            velocity_ned_mps: Horizontal::default(),
        };
        // There are as many places.
        let _ = request.circles.push(circle);
    }
    let mut scratch = Scratch::default();
    row(
        "replan_64",
        measure(&mut || {
            black_box(planner.plan(&mut scratch, black_box(&request)));
        }),
        1_700_000,
    );
}

/// A tone from 30 degrees to the right, and noise, into a snapshot.
fn receive(snapshot: &mut Snapshot<N>, time_us: u64) {
    snapshot.time = Instant(time_us);
    let mut rng = Rng::new(time_us, 2);
    // Phases of a wave over a square of 0.4 wavelengths: front-right, front-left, back-left, back-right.
    let (east, north) = sin_cos(FRAC_PI_2 / 3.0);
    let half = TAU * 0.4 / 2.0;
    let phases = [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]].map(|[x, y]| half * (x * north + y * east));
    for (row, phase) in snapshot.codes.iter_mut().zip(phases) {
        for (index, code) in row.iter_mut().enumerate() {
            let (_, cosine) = sin_cos(TAU * TONE_BINS / N as f32 * index as f32 + phase);
            *code = (1000.0 * cosine + 50.0 * rng.gaussian()) as i16;
        }
    }
}
