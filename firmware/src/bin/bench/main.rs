//! Instruction counts of the stages, in QEMU: `cargo xtask bench`.
//!
//! Under `-icount shift=8` an instruction takes 256 ns of the machine's time, 6.4 ticks of its 25 MHz timer, so the
//! timer resolves single instructions. Each row is the difference between two readings of the timer, minus that
//! around a closure that does nothing. On the semihosting output, a line each:
//!
//! ```text
//! count ROW INSTRUCTIONS CEILING      ours; 0 where there is no ceiling
//! peer ROW CRATE INSTRUCTIONS         a crate doing the same work on the same codes
//! error ROW MICRODEGREES CEILING      rms of what a row computes
//! equal WORDS                         the target's kernels agree with the portable ones on so many words
//! ```
//!
//! When the kernels disagree, the image ends with an error.
#![no_std]
#![no_main]

use core::f32::consts::{FRAC_PI_2, TAU};
use core::hint::black_box;

use foxhound_computer::SAMPLES_PER_CHANNEL as N;
use foxhound_computer::twin::instructions;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::config::{RangeSensor, Vehicle};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::{Neighbour, Obstacle};
use foxhound_core::base::pose::Pose;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::{sin_cos, wrap_pi};
use foxhound_core::control::guard::{self, GuardInput};
use foxhound_core::control::track::Demand;
use foxhound_core::control::{evade, vehicle_model};
use foxhound_core::guidance;
use foxhound_core::planning::planner::Workspace;
use foxhound_core::signal::phase::Complex;
use foxhound_firmware::board::Board as _;
use foxhound_firmware::boards::mps2_an386::Machine as Twin;
use static_cell::ConstStaticCell;

mod belief;
mod fast_loop;
mod kernels;
mod landing;
mod link;
mod looks;
mod pad;
mod radios;
mod receiver;
mod rollouts;
mod source;

use kernels::kernels;
use looks::obstacle_looks;
use receiver::{front_end, lock_in, spectrum, wave};
use rollouts::{replan, rollouts};

/// The tone, in bins, off the grid.
const TONE_BINS: f32 = 20.3;
/// Maps of the rollouts.
const FORESTS: u64 = 16;
/// Obstacles that the planner is measured with.
const OBSTACLES: usize = 64;
static SNAPSHOT: ConstStaticCell<AdcFrame<N>> = ConstStaticCell::new(AdcFrame::zeroed());
static SCRATCH: ConstStaticCell<Workspace> = ConstStaticCell::new(Workspace::new());

/// Says why it cannot go on, and ends.
fn halt(why: core::fmt::Arguments<'_>) -> ! {
    semihosting::eprintln!("{why}");
    Twin::halt("the bench")
}

#[cortex_m_rt::entry]
fn main() -> ! {
    Twin::start().watchdog.stop();
    let empty = count(&mut || {});
    let measure = |task: &mut dyn FnMut()| count(task).saturating_sub(empty);

    let words = kernels::<64>(1) + kernels::<128>(2) + kernels::<256>(3) + kernels::<512>(4) + kernels::<1024>(5);
    semihosting::println!("equal {words}");

    let snapshot = SNAPSHOT.take();
    receive(snapshot, 0, Some(FRAC_PI_2 / 3.0));
    lock_in(&measure, snapshot);
    spectrum(&measure, snapshot);
    front_end(&measure, snapshot);
    obstacle_looks(&measure);
    let config = guidance::Config::default();
    let (Ok(guidance), Ok(planner)) = (config.build(), config.build_planner()) else {
        halt(format_args!("the built-in configuration does not build"))
    };
    let workspace = SCRATCH.take();
    fast_loop::rows(&measure, &guidance, &planner, workspace, snapshot);
    guard_among_obstacles(&measure);
    evader_in_a_crowd(&measure);
    rollouts(&measure);
    replan(&measure, &planner, workspace);
    belief::rows(&measure);
    source::rows(&measure);
    link::rows(&measure);
    landing::rows(&measure);
    pad::rows(&measure);
    radios::rows(&measure);
    semihosting::process::exit(0)
}

/// Instructions of a task, with the call and the two readings.
#[inline(never)]
fn count(task: &mut dyn FnMut()) -> u32 {
    let task = black_box(task);
    let begin = Twin::ticks();
    task();
    instructions(Twin::ticks().wrapping_sub(begin))
}

fn row(name: &str, instructions: u32, ceiling: u32) {
    semihosting::println!("count {name} {instructions} {ceiling}");
}

fn peer(name: &str, whose: &str, instructions: u32) {
    semihosting::println!("peer {name} {whose} {instructions}");
}

/// A command through the guard among 64 obstacles while the nose turns, and the guard's update from a delivery of
/// them: the worst over the forests.
#[inline(never)]
fn guard_among_obstacles(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let Ok(guard) = guard::Config::default().build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT) else {
        halt(format_args!("the built-in guard does not build"))
    };
    let (mut worst, mut worst_look) = (0, 0);
    for seed in 0..FORESTS {
        let mut rng = Rng::new(seed, 11);
        let obstacles = forest(&mut rng).map(|Obstacle { center_ned_m, reach_m }| Neighbour {
            center_ned_m,
            reach_m,
            velocity_ned_mps: Horizontal::default(),
        });
        let (mut state, yaw_rad) = (guard::State::default(), wrap_pi(TAU * rng.uniform()));
        let rest_ned_m = Horizontal::from_bearing(yaw_rad).times(0.1);
        for step in 0..25 {
            let yaw_rad = wrap_pi(yaw_rad + 0.1 * step as f32);
            if step % 5 == 0 {
                let pose = Pose { position_ned_m: Horizontal::default(), yaw_rad };
                let look = measure(&mut || guard.note_circles(&mut state, black_box(&obstacles), black_box(&pose)));
                worst_look = worst_look.max(look);
            }
            let situation = GuardInput { rest_ned_m, yaw_rad, ..GuardInput::default() };
            let demand = Demand { velocity_ned_mps: Horizontal::from_bearing(yaw_rad), ..Demand::default() };
            let step = measure(&mut || {
                black_box(guard.step(
                    &mut state,
                    black_box(&demand),
                    black_box(&situation),
                    black_box(&obstacles),
                    0.02,
                ));
            });
            worst = worst.max(step);
        }
    }
    row("guard_64", worst, 11_000);
    row("look_64", worst_look, 0);
}

/// What gets out of the way of 4 and of 16 people among 64 obstacles: the worst of some crowds.
#[inline(never)]
fn evader_in_a_crowd(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let Ok(response) = vehicle_model::Config::default().build(0.02) else {
        halt(format_args!("the built-in vehicle model does not build"))
    };
    let evader = evade::Evader::new(&response, 1.0, 1.0, 2.0);
    let underway = vehicle_model::State::default();
    for (name, people) in [("evade_4", 4), ("evade_16", 16)] {
        let mut worst = 0;
        for seed in 0..FORESTS {
            let mut rng = Rng::new(seed, 24);
            let standing = forest(&mut rng).map(|Obstacle { center_ned_m, reach_m }| Neighbour {
                center_ned_m,
                reach_m,
                velocity_ned_mps: Horizontal::default(),
            });
            let moving: [Neighbour; 16] = core::array::from_fn(|_| {
                let mut draw =
                    |most: f32| Horizontal::from_bearing(wrap_pi(TAU * rng.uniform())).times(most * rng.uniform());
                Neighbour { center_ned_m: draw(4.0), reach_m: 0.45, velocity_ned_mps: draw(2.0) }
            });
            let input = evade::Input {
                position_ned_m: Horizontal::default(),
                velocity_ned_mps: Horizontal::default(),
                command_ned_mps: Horizontal::default(),
                halfway_ned_mps: Horizontal::default(),
                underway: &underway,
                standing: &standing,
                fence: None,
                moving: [&[], &moving[..people]],
            };
            let (mut state, asked) = (evade::State::default(), Horizontal { north: 1.0, east: 0.0 });
            let step = measure(&mut || {
                black_box(evader.step(&mut state, black_box(asked), black_box(&input)));
            });
            worst = worst.max(step);
        }
        row(name, worst, 0);
    }
}

/// A circle in every square metre of eight by eight, none of them at the origin.
fn forest(rng: &mut Rng) -> [Obstacle; OBSTACLES] {
    core::array::from_fn(|k| {
        let center_ned_m = Horizontal {
            north: (k / 8) as f32 - 3.5 + 0.8 * (rng.uniform() - 0.5),
            east: (k % 8) as f32 - 3.5 + 0.8 * (rng.uniform() - 0.5),
        };
        let room = center_ned_m.norm() - 0.05;
        Obstacle { center_ned_m, reach_m: (0.25 + 0.23 * rng.uniform()).min(room) }
    })
}

/// A tone from an azimuth, or silence, and noise, into a snapshot.
fn receive(snapshot: &mut AdcFrame<N>, time_us: u64, azimuth_rad: Option<f32>) {
    snapshot.time = Instant(time_us);
    let mut rng = Rng::new(time_us, 2);
    let phases = wave(azimuth_rad.unwrap_or(0.0)).map(Complex::arg);
    let amplitude = if azimuth_rad.is_some() { 1000.0 } else { 0.0 };
    for (row, phase) in snapshot.codes.iter_mut().zip(phases) {
        for (index, code) in row.iter_mut().enumerate() {
            let (_, cosine) = sin_cos(TAU * TONE_BINS / N as f32 * index as f32 + phase);
            *code = (amplitude * cosine + 50.0 * rng.gaussian()) as i16;
        }
    }
}
