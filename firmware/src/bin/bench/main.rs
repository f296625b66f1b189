//! Instruction counts of the rooms, in QEMU: `cargo xtask bench`.
//!
//! Under `-icount shift=8` an instruction takes 256 ns of the machine's time, 6.4 ticks of its 25 MHz timer, so the
//! timer tells single instructions apart. Each row is what lies between two readings of the timer, less what lies
//! between them around a closure that does nothing. On the semihosting output, a line each:
//!
//! ```text
//! count ROW INSTRUCTIONS CEILING      ours; 0 where design, section 6, has no ceiling
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
use core::num::Wrapping;

use dsp_process::SplitProcess as _;
use foxhound_computer::frozen::Watch;
use foxhound_core::base::adc::{AdcFrame, CHANNELS};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::planning::field::{Field, Gains};

use foxhound_computer::SAMPLES_PER_CHANNEL as N;
use foxhound_computer::twin::instructions;
use foxhound_core::base::math::{armv7em, portable};
use foxhound_core::base::obstacle::{Disc, Neighbour, Obstacle};
use foxhound_core::base::pose::Pose;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::{sin_cos, wrap_pi};
use foxhound_core::control::guard::{self, GuardInput};
use foxhound_core::control::track::Demand;
use foxhound_core::control::{evade, response};
use foxhound_core::guidance;
use foxhound_core::localize::source::Sighting;
use foxhound_core::mapping::map::{self, Map};
use foxhound_core::mapping::scan::{self, RAYS_MAX, SECTORS_MAX, Scan, Sector};
use foxhound_core::mapping::tracks::{self, Tracks};
use foxhound_core::planning::planner::{self, Kind, PlanRequest, Planner, SAMPLES, Workspace};
use foxhound_core::planning::rollout::{Cost, SPACING_M, Scene, Trajectory, WAYPOINTS};
use foxhound_core::signal::phase::{self, Complex, Phasors};
use foxhound_core::signal::spectrum::tone::{Reference, Window};
use foxhound_core::signal::spectrum::{Backend, Spectrum};
use foxhound_firmware::board::Board as _;
use foxhound_firmware::boards::mps2_an386::Machine as Twin;
use foxhound_papers::multipath::{self, Frame};
use idsp::Lowpass;
use microfft::real::rfft_256;
use static_cell::ConstStaticCell;

mod belief;
mod fast_loop;
mod landing;
mod link;
mod pad;
mod source;

/// The tone, in bins, off the grid.
const TONE_BINS: f32 = 20.3;
/// Maps of the rollouts.
const FORESTS: u64 = 16;
/// Obstacles that the planner is measured with.
const OBSTACLES: usize = 64;
/// Scenes of the looks.
const SCENES: usize = 64;

static SNAPSHOT: ConstStaticCell<AdcFrame<N>> = ConstStaticCell::new(AdcFrame::zeroed());
static SCRATCH: ConstStaticCell<Workspace> = ConstStaticCell::new(Workspace::new());

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
    several_looks(&measure);
    obstacle_looks(&measure);
    let config = guidance::Config::default();
    let (Ok(guidance), Ok(planner)) = (config.build(), config.planner.build()) else {
        Twin::halt(format_args!("the built-in configuration does not build"))
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

/// Runs the target's kernels and the portable ones over the same words, random ones and corners, and ends the program
/// when they differ. Returns how many words went in.
#[inline(never)]
fn kernels<const M: usize>(seed: u64) -> u32 {
    const ROUNDS: usize = 24;
    let mut words = Words(Rng::new(seed, 3));
    let check = |same: bool, name: &str| {
        if !same {
            Twin::halt(format_args!("kernel {name} differs from the portable one, N = {M}"));
        }
    };
    for round in 0..ROUNDS {
        let (data, twiddles): ([u32; M], [u32; M]) = ([0; M].map(|_| words.word()), [0; M].map(|_| words.word()));
        stages(&data, &twiddles, &check);
        for quad in data.as_chunks::<4>().0 {
            let [a, b, c, d] = *quad;
            check(armv7em::add(a, b) == portable::add(a, b), "add");
            check(armv7em::subtract(a, b) == portable::subtract(a, b), "subtract");
            let powers = [[a, b, c], [d, a ^ c, b ^ d]];
            let value = f32::from_bits(a);
            // Not a number has several words; which one comes out does not matter.
            let same = |one: f32, other: f32| one.to_bits() == other.to_bits() || (one.is_nan() && other.is_nan());
            check(same(armv7em::sqrt(value), portable::sqrt(value)), "sqrt");
            check(armv7em::powers(powers[0], powers[1]) == portable::powers(powers[0], powers[1]), "powers");
            let (up, mask) = (a % 16, !b);
            check(
                armv7em::first_butterfly(*quad, up, mask, c ^ d) == portable::first_butterfly(*quad, up, mask, c ^ d),
                "first_butterfly",
            );
        }
        let mut codes = Codes([0_i16; M]);
        let mut table = Codes([0_i16; M]);
        for ((code, entry), word) in codes.0.iter_mut().zip(&mut table.0).zip(data) {
            // Codes of 12 bits in every other round, or no clipped sample would be seen.
            *code = if round % 2 == 0 { portable::low(word) >> 4 } else { portable::low(word) };
            *entry = portable::high(word);
        }
        let (row, table) = (&codes.0, &table.0);
        check(armv7em::moments(row) == portable::moments(row), "moments");
        check(armv7em::moments(&row[1..]) == portable::moments(&row[1..]), "moments, unaligned");
        check(armv7em::sum_and_reach(row) == portable::sum_and_reach(row), "sum_and_reach");
        check(armv7em::lock_in(row, table) == portable::lock_in(row, table), "lock_in");
        check(armv7em::table_energies(table) == portable::table_energies(table), "table_energies");
    }
    (ROUNDS * 2 * M) as u32
}

/// Aligned as the product's own tables are.
#[repr(C, align(8))]
struct Codes<const M: usize>([i16; M]);

/// Words whose lanes are random, a third of them corners.
struct Words(Rng);

impl Words {
    fn lane(&mut self) -> i16 {
        match (self.0.uniform() * 24.0) as u32 {
            0 => 0,
            1 => 1,
            2 => -1,
            3 => i16::MAX,
            4 => i16::MIN,
            5 => 16_384,
            6 => -2048,
            7 => 2047,
            _ => (self.0.uniform() * 65_536.0) as i32 as i16,
        }
    }

    fn word(&mut self) -> u32 {
        portable::pack(self.lane(), self.lane())
    }
}

/// All stages of a transform of `M` points, both ways of scaling.
fn stages<const M: usize>(data: &[u32; M], twiddles: &[u32; M], check: &impl Fn(bool, &str)) {
    if M.trailing_zeros() % 2 == 1 {
        stage::<M, 2, 8>(data, twiddles, check);
        stage::<M, 8, 32>(data, twiddles, check);
        stage::<M, 32, 128>(data, twiddles, check);
        stage::<M, 128, 512>(data, twiddles, check);
    } else {
        stage::<M, 4, 16>(data, twiddles, check);
        stage::<M, 16, 64>(data, twiddles, check);
        stage::<M, 64, 256>(data, twiddles, check);
        stage::<M, 256, 1024>(data, twiddles, check);
    }
}

fn stage<const M: usize, const L: usize, const LEN: usize>(
    data: &[u32; M],
    twiddles: &[u32; M],
    check: &impl Fn(bool, &str),
) {
    if LEN > M {
        return;
    }
    let both = |target: &mut [u32; M], portable: &mut [u32; M], by_two: bool| {
        if by_two {
            let reach = armv7em::stage::<M, L, LEN, true>(target, twiddles);
            reach == portable::stage::<M, L, LEN, true>(portable, twiddles)
        } else {
            let reach = armv7em::stage::<M, L, LEN, false>(target, twiddles);
            reach == portable::stage::<M, L, LEN, false>(portable, twiddles)
        }
    };
    for by_two in [false, true] {
        let (mut target, mut portable) = (*data, *data);
        let same_reach = both(&mut target, &mut portable, by_two);
        check(same_reach && target == portable, "stage");
    }
}

/// A lock-in at one frequency: products in integers, then phasors.
struct LockIn {
    reference: Reference<N>,
    /// From products to codes.
    gain: [f32; 2],
}

impl LockIn {
    fn new(bins: f32) -> Self {
        let mut reference = Reference::<N>::default();
        reference.tune((bins / N as f32 * 4_294_967_296.0) as u32, Window::Flat);
        let (normal, scale) = (*reference.normal(), reference.scale() as f32);
        let gain = [normal.cos_cos, normal.sin_sin].map(|sum| 0.5 * scale / sum as f32);
        Self { reference, gain }
    }

    fn phasors(&self, codes: &[[i16; N]; CHANNELS]) -> [Complex; CHANNELS] {
        self.reference.products(codes).map(|products| Complex {
            re: self.gain[0] * (products.first_cos as f32 + products.second_cos as f32),
            im: self.gain[1] * (products.first_sin as f32 - products.second_sin as f32),
        })
    }
}

/// Phasors of four channels, and their phases; the peers find the same ones by four transforms, or by a lock-in.
#[inline(never)]
fn lock_in(measure: &impl Fn(&mut dyn FnMut()) -> u32, snapshot: &AdcFrame<N>) {
    let ours = LockIn::new(TONE_BINS);
    let mut z = [Complex::default(); CHANNELS];
    let mut phases = [0.0; CHANNELS];
    let codes = &snapshot.codes;

    row("phasors", measure(&mut || z = black_box(&ours).phasors(black_box(codes))), 1_900);
    peer("phasors", "microfft", measure(&mut || z = by_transform(black_box(codes))));
    peer("phasors", "idsp", measure(&mut || _ = black_box(by_low_pass(black_box(codes)))));
    row(
        "phasors_and_phases",
        measure(&mut || phases = black_box(&ours).phasors(black_box(codes)).map(Complex::arg)),
        0,
    );
    peer("phasors_and_phases", "microfft", measure(&mut || phases = by_transform(black_box(codes)).map(Complex::arg)));
    let in_turns = |[re, im]: [i32; 2]| idsp::atan2(im, re);
    peer("phasors_and_phases", "idsp", measure(&mut || _ = black_box(by_low_pass(black_box(codes)).map(in_turns))));
    black_box((z, phases));

    // 5/64 of the sample rate.
    let on_bin = LockIn::new(20.0);
    accuracy("phasors_at_1500_codes", &on_bin, 1500.0, 5_000);
    accuracy("phasors_at_60_codes", &on_bin, 60.0, 65_000);
}

/// Phase of each channel against the first, of a tone that is nothing but rounded: rms over 48 frames.
fn accuracy(name: &str, lock_in: &LockIn, amplitude: f32, ceiling: u32) {
    const FRAMES: usize = 48;
    let mut rng = Rng::new(7, 7);
    let mut sum = 0.0;
    for _ in 0..FRAMES {
        let phases = [0.0; CHANNELS].map(|_| TAU * rng.uniform());
        let mut codes = [[0; N]; CHANNELS];
        for (row, phase) in codes.iter_mut().zip(phases) {
            for (index, code) in row.iter_mut().enumerate() {
                // The middle of the block is between two samples.
                let turns = (20 * (2 * index + 1 + N) % (2 * N)) as f32 / (2 * N) as f32;
                let (_, cosine) = sin_cos(wrap_pi(TAU * turns + phase));
                // Rounded: what is positive is cut off.
                *code = (amplitude * cosine + 2048.5) as i16 - 2048;
            }
        }
        let found = lock_in.phasors(&codes).map(Complex::arg);
        for (found_rad, phase) in found.iter().zip(phases).skip(1) {
            let error = wrap_pi(found_rad - found[0] - (phase - phases[0]));
            sum += error * error;
        }
    }
    let microdegrees = (1e6_f32).to_degrees();
    let mean_square = f64::from(sum / (FRAMES * (CHANNELS - 1)) as f32) * f64::from(microdegrees * microdegrees);
    semihosting::println!("error {name} {} {ceiling}", (mean_square as u64).isqrt());
}

/// One bin of four transforms in f32.
#[inline(never)]
fn by_transform(codes: &[[i16; N]; CHANNELS]) -> [Complex; CHANNELS] {
    codes.each_ref().map(|row| {
        let mut samples = row.map(f32::from);
        let bin = rfft_256(&mut samples)[TONE_BINS as usize];
        Complex { re: bin.re * (2.0 / N as f32), im: bin.im * (2.0 / N as f32) }
    })
}

/// What low-passes of second order have arrived at by the end of the block, behind a mixer whose oscillator all channels
/// share.
#[inline(never)]
fn by_low_pass(codes: &[[i16; N]; CHANNELS]) -> [[i32; 2]; CHANNELS] {
    /// Six cycles a block, and Butterworth's damping: `k^2 / 2^32` and `-k sqrt 2`.
    const GAIN: f64 = core::f64::consts::PI * 2_147_483_648.0 * 6.0 / N as f64;
    const LOW_PASS: Lowpass<2> =
        Lowpass([(GAIN * GAIN / 4_294_967_296.0) as i32, (-GAIN * core::f64::consts::SQRT_2) as i32]);
    let step = Wrapping((TONE_BINS / N as f32 * 4_294_967_296.0) as u32 as i32);
    let mut angle = Wrapping(0);
    let mut states: [[_; 2]; CHANNELS] = Default::default();
    let mut out = [[0; 2]; CHANNELS];
    for index in 0..N {
        let oscillator = idsp::Complex::<i32>::from_angle(angle);
        angle += step;
        for ((row, states), out) in codes.iter().zip(&mut states).zip(&mut out) {
            let sample = i64::from(i32::from(row[index]) << 16);
            for ((state, out), part) in states.iter_mut().zip(out).zip([oscillator.re(), oscillator.im()]) {
                *out = LOW_PASS.process(state, ((sample * i64::from(part)) >> 32) as i32);
            }
        }
    }
    out
}

/// The acquisition spectrum: mean taken off, Hann's window, powers. The peer is spared the first two, and then is not.
#[inline(never)]
fn spectrum(measure: &impl Fn(&mut dyn FnMut()) -> u32, snapshot: &AdcFrame<N>) {
    let mut spectrum = Spectrum::<N>::default();
    let mut workspace = [0.0; N];
    let codes = &snapshot.codes;
    row(
        "spectrum",
        measure(&mut || black_box(&mut spectrum).measure(Backend::Fixed, black_box(codes), &mut workspace)),
        26_000,
    );
    let mut powers = [[0.0; N / 2]; CHANNELS];
    let mut plain = || {
        for (row, powers) in black_box(codes).iter().zip(&mut powers) {
            let mut samples = row.map(f32::from);
            for (power, bin) in powers.iter_mut().zip(rfft_256(&mut samples)) {
                *power = bin.re * bin.re + bin.im * bin.im;
            }
        }
    };
    peer("spectrum", "microfft", measure(&mut plain));
    black_box(powers);
    peer(
        "spectrum",
        "microfft_with_window",
        measure(&mut || black_box(&mut spectrum).measure(Backend::Microfft, black_box(codes), &mut workspace)),
    );
}

/// Phases of a wave over a square of 0.4 wavelengths, of amplitude one: front-right, front-left, back-left, back-right.
fn wave(azimuth_rad: f32) -> [Complex; CHANNELS] {
    let (east, north) = sin_cos(azimuth_rad);
    let half = TAU * 0.4 / 2.0;
    [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]].map(|[x, y]| unit(half * (x * north + y * east)))
}

fn unit(angle_rad: f32) -> Complex {
    let (im, re) = sin_cos(wrap_pi(angle_rad));
    Complex { re, im }
}

/// One snapshot, from codes to phasors and to a bearing.
#[inline(never)]
fn front_end(measure: &impl Fn(&mut dyn FnMut()) -> u32, snapshot: &AdcFrame<N>) {
    let config = guidance::Config::default();
    let (Ok(extractor), Ok(array)) = (config.phase.build::<N>(), config.array.build()) else {
        Twin::halt(format_args!("the built-in front end does not build"))
    };
    let Ok(finder) = config.bearing.build(array) else {
        Twin::halt(format_args!("the built-in estimator does not build"))
    };
    let mut state = phase::State::default();
    let mut phasors = None;
    // Nothing is known, then the tone is followed; every eighth frame the floor is measured anew.
    let (mut first, mut tracking, mut renewing) = (0, u32::MAX, 0);
    for frame in 0..24 {
        let count = measure(&mut || phasors = Some(extractor.step(&mut state, black_box(snapshot))));
        match frame {
            0 => first = count,
            _ => (tracking, renewing) = (tracking.min(count), renewing.max(count)),
        }
    }
    row("phase_first", first, 0);
    row("phase_tracking", tracking, 7_600);
    row("phase_renewing", renewing, 0);
    let Some(mut phasors) = phasors else { return };
    let mut rng = Rng::new(5, 5);
    let mut worst = 0;
    for direction in 0..64 {
        phasors.z = noisy(wave(TAU / 64.0 * direction as f32), 1000.0, 10.0, &mut rng);
        if direction % 8 == 7 {
            phasors.z[direction / 8 % CHANNELS] = Complex::default();
        }
        let instructions = measure(&mut || {
            black_box(finder.find(black_box(&phasors)));
        });
        worst = worst.max(instructions);
    }
    row("bearing", worst, 4_000);
    let mut watch = Watch::new();
    row("frozen_watch", measure(&mut || _ = black_box(watch.look(black_box(snapshot)))), 1_000);
}

fn noisy(z: [Complex; CHANNELS], amplitude: f32, sigma: f32, rng: &mut Rng) -> [Complex; CHANNELS] {
    z.map(|z| Complex { re: amplitude * z.re + sigma * rng.gaussian(), im: amplitude * z.im + sigma * rng.gaussian() })
}

/// The eighth look at a source and its reflection at -6 dB, taken and solved for: of one heading, and turning by 90 degrees.
#[inline(never)]
fn several_looks(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    for (turn_rad, mean, worst) in
        [(0.0, "look_solve", "look_solve_worst"), (FRAC_PI_2, "look_solve_turning", "look_solve_turning_worst")]
    {
        let mut rng = Rng::new(9, 9);
        let counts = [0; SCENES].map(|_| scene(measure, turn_rad, &mut rng));
        row(mean, counts.iter().sum::<u32>() / SCENES as u32, 45_000);
        row(worst, counts.into_iter().max().unwrap_or(0), 45_000);
    }
}

fn scene(measure: &impl Fn(&mut dyn FnMut()) -> u32, turn_rad: f32, rng: &mut Rng) -> u32 {
    const LOOKS: usize = multipath::LOOKS;
    let config = guidance::Config::default();
    let (Ok(extractor), Ok(array)) = (config.phase.build::<64>(), config.array.build()) else {
        Twin::halt(format_args!("the built-in front end does not build"))
    };
    let (Ok(finder), Ok(looks)) = (config.bearing.build(array), multipath::Config::default().build(&array)) else {
        Twin::halt(format_args!("the built-in estimator does not build"))
    };
    // Of a silent snapshot, for the parts that no look here changes.
    let silence = extractor.step(&mut phase::State::default(), &AdcFrame::zeroed());
    let mut state = multipath::State::default();
    let paths = [(); 2].map(|()| TAU * rng.uniform());
    let mut turns = [(); 2].map(|()| TAU * rng.uniform());
    let speeds = [(); 2].map(|()| TAU * (0.6 * rng.uniform() - 0.3));
    let yaw = TAU * rng.uniform() - TAU / 2.0;
    let channels = [(); CHANNELS].map(|()| unit(rng.gaussian() / 57.3));
    let mut last = 0;
    for index in 0..LOOKS {
        let yaw_rad = wrap_pi(yaw + turn_rad * index as f32 / (LOOKS - 1) as f32);
        let [direct, reflected] = paths.map(|path| wave(wrap_pi(path - yaw_rad)));
        let (direct_turn, reflected_turn) = (unit(turns[0]), unit(turns[1]));
        let sum: [Complex; CHANNELS] = core::array::from_fn(|m| {
            let reflection = reflected[m].times(reflected_turn);
            let half = Complex { re: 0.5 * reflection.re, im: 0.5 * reflection.im };
            direct[m].times(direct_turn).plus(half).times(channels[m])
        });
        let phasors = Phasors {
            time: Instant(100_000 * index as u64),
            z: noisy(sum, 1000.0, 4.5, rng),
            noise: [2.0 * 4.5 * 4.5; CHANNELS],
            tone: phase::Tone::Present,
            ..silence
        };
        let bearing = finder.find(&phasors);
        let look = Frame { phasors: &phasors, bearing: &bearing, yaw_rad, position_ned_m: None };
        last = measure(&mut || {
            let _ = black_box(looks.take(&mut state, black_box(&look)));
            black_box(looks.solve(&state, 1.0));
        });
        for (turn, speed) in turns.iter_mut().zip(speeds) {
            *turn = wrap_pi(*turn + speed);
        }
    }
    last
}

/// A scan's way into the map, the worst of many looks: past pillars, and at what has no end of circles.
#[inline(never)]
fn obstacle_looks(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let (Ok(segmenter), Ok(mapper)) = (scan::Config::default().build(), map::Config::default().build()) else {
        Twin::halt(format_args!("the built-in obstacle memory does not build"))
    };
    let Ok(tracker) = tracks::Config::default().build() else {
        Twin::halt(format_args!("the built-in tracks do not build"))
    };
    let mut rng = Rng::new(13, 13);
    let mut flight = |world: &[[f32; 3]], view: View, noise_m: f32, looks: u64| {
        let (mut map, mut tracks) = (Map::default(), Tracks::default());
        let (mut worst, mut worst_fit, mut worst_follow) = (0, 0, 0);
        for look in 0..looks {
            let pose = Pose {
                position_ned_m: Horizontal { north: 0.05 * (look % 20) as f32, east: 0.02 * (look % 20) as f32 },
                yaw_rad: 0.3 * (rng.uniform() - 0.5),
            };
            let scan = ranges(world, &pose, view, noise_m, &mut rng);
            let now = Instant(100_000 * look);
            let mut seen = None;
            let fit = measure(&mut || seen = segmenter.fit(black_box(&scan), &pose).ok());
            let Some(seen) = seen else { return (0, 0, 0) };
            worst_fit = worst_fit.max(fit);
            let take = measure(&mut || mapper.observe_scan(&mut map, now, &scan, &pose, black_box(&seen)));
            tracker.advance(&mut tracks, now);
            let follow = measure(&mut || {
                if scan.is_fine() {
                    tracker.observe_rays(&mut tracks, black_box(&scan), &pose);
                } else {
                    tracker.observe(&mut tracks, &scan, &pose, black_box(&seen.points_m));
                }
            });
            (worst, worst_follow) = (worst.max(fit + take), worst_follow.max(follow));
        }
        (worst_fit, worst, worst_follow)
    };
    let pillars: [[f32; 3]; 10] = core::array::from_fn(|k| {
        let side = [-1.1, -0.4, 0.3, 0.9, 1.5][k % 5];
        [2.0 + 0.7 * (k / 5) as f32, side + 0.25 * (k / 5) as f32, 0.10 + 0.02 * (k % 5) as f32]
    });
    let chain: [[f32; 3]; 28] = core::array::from_fn(|k| [2.5, 0.15 * k as f32 - 2.0, 0.1]);
    let walls: [[f32; 3]; 40] = core::array::from_fn(|k| {
        let away = Horizontal::from_bearing(wrap_pi(0.16 * k as f32)).times(1.6 + 0.4 * (k % 3) as f32);
        [away.north, away.east, 0.12]
    });
    let rows = [
        ("pillars_4", flight(&pillars[..4], NOSE, 0.005, 40)),
        ("pillars_10", flight(&pillars, NOSE, 0.005, 40)),
        ("wall", flight(&[[32.0, 0.0, 30.0]], NOSE, 0.005, 40)),
        ("wall_rough", flight(&[[32.0, 0.0, 30.0]], NOSE, 0.05, 80)),
        ("chain", flight(&chain, NOSE, 0.01, 40)),
        ("random", flight(&[], NOSE, 0.0, 80)),
        ("turn_pillars_10", flight(&pillars, TURN, 0.005, 40)),
        ("turn_pillars_40", flight(&walls, TURN, 0.005, 40)),
        ("turn_wall_rough", flight(&[[32.0, 0.0, 30.0]], TURN, 0.05, 80)),
        ("turn_random", flight(&[], TURN, 0.0, 80)),
    ];
    for (name, (fit, all, _)) in rows {
        semihosting::println!("count fit_{name} {fit} 0");
        semihosting::println!("count look_{name} {all} 0");
    }
    let worst = |rows: &[(&str, (u32, u32, u32))], of: fn(&(u32, u32, u32)) -> u32| {
        rows.iter().map(|(_, counts)| of(counts)).max().unwrap_or(0)
    };
    let (narrow, turns) = rows.split_at(6);
    row("tracks_72", worst(narrow, |counts| counts.2), 0);
    row("tracks_360", worst(turns, |counts| counts.2), 0);
    row("look_pillars", worst(&rows[..2], |counts| counts.1), 0);
    row("look_worst", worst(narrow, |counts| counts.1), 0);
    row("look_360", worst(turns, |counts| counts.1), 0);
}

/// Field of view, rad, and rays over it.
type View = (f32, usize);
/// A sensor on the nose, and a lidar.
const NOSE: View = (FRAC_PI_2, SECTORS_MAX);
const TURN: View = (TAU, RAYS_MAX);

/// The length of the side of a square.
fn root(area: f32) -> f32 {
    let mut side = 0.5 * area + 0.5;
    for _ in 0..20 {
        side = 0.5 * (side + area / side);
    }
    side
}

/// What a sensor of 3 m sees of circles (north, east, radius), to the centimetre; anything, if there are none.
fn ranges(world: &[[f32; 3]], pose: &Pose, (fov_rad, rays): View, noise_m: f32, rng: &mut Rng) -> Scan {
    let step_rad = fov_rad / rays as f32;
    let first_azimuth_rad = 0.5 * (step_rad - fov_rad);
    let ray = |index: usize| {
        let sight = Horizontal::from_bearing(wrap_pi(pose.yaw_rad + first_azimuth_rad + step_rad * index as f32));
        let mut range_m = if world.is_empty() { 0.3 + 2.7 * rng.uniform() } else { 4.0 };
        for [north, east, radius] in world {
            let away = Horizontal { north: *north, east: *east }.minus(pose.position_ned_m);
            let across = sight.north * away.east - sight.east * away.north;
            let along = sight.dot(away);
            if along > 0.0 && across * across < radius * radius {
                range_m = range_m.min(along - root(radius * radius - across * across));
            }
        }
        let centimetres = (100.0 * (range_m + noise_m * rng.gaussian())) as i32;
        if centimetres > 300 { Sector::Clear } else { Sector::Hit(0.01 * centimetres.max(1) as f32) }
    };
    let rays = (0..rays).map(ray).collect();
    Scan { time: Instant(0), first_azimuth_rad, step_rad, range_max_m: 3.0, rays }
}

/// A command past the guard among 64 obstacles while the nose turns, and what the guard takes in of a delivery of them: the
/// worst over the forests.
#[inline(never)]
fn guard_among_obstacles(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let Ok(guard) = guard::Config::default().build() else {
        Twin::halt(format_args!("the built-in guard does not build"))
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
                let look = measure(&mut || guard.look_circles(&mut state, black_box(&obstacles), black_box(&pose)));
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
    let built = response::Config::default()
        .build(0.02)
        .and_then(|response| evade::Config::default().build(&response, 1.0, 2.0));
    let Ok(evader) = built else { Twin::halt(format_args!("the built-in evader does not build")) };
    let underway = response::State::default();
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
                has_looked: false,
                standing: &standing,
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

/// Ten rollouts with their costs, the worst of some maps of 64 circles at one per square metre with the vehicle in the
/// middle: the planner's, and every obstacle at every waypoint with `libm`'s functions.
#[inline(never)]
fn rollouts(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    for (kind, row_name, naive_name) in [
        (Kind::Foxhound, "rollouts_64", "rollouts_64_naive"),
        (Kind::Paper, "rollouts_64_paper_gains", "rollouts_64_paper_gains_naive"),
    ] {
        let (mut worst, mut naive_worst) = (0, 0);
        for seed in 0..FORESTS {
            let mut rng = Rng::new(seed, 11);
            let obstacles = forest(&mut rng);
            let target = Horizontal::from_bearing(wrap_pi(TAU * rng.uniform())).times(2.0);
            let fields = [(); SAMPLES].map(|()| draw(&planner::Config::of(kind), &mut rng));
            let mut samples = [([Horizontal::default(); WAYPOINTS], Cost::default()); SAMPLES];
            let mut naive = samples;
            let mut scene = Scene::new();
            worst = worst.max(measure(&mut || {
                scene.gather_all(Horizontal::default(), black_box(&obstacles));
                for (sample, field) in samples.iter_mut().zip(black_box(&fields)) {
                    *sample = scene.roll(field, target);
                }
            }));
            naive_worst = naive_worst.max(measure(&mut || {
                for (sample, field) in naive.iter_mut().zip(black_box(&fields)) {
                    let trajectory = roll_naively(&field.gains, target, black_box(&obstacles));
                    *sample = (trajectory, cost_naively(&trajectory, target, black_box(&obstacles)));
                }
            }));
            for ((ours, our_cost), (theirs, their_cost)) in samples.iter().zip(&naive) {
                let apart_m = ours.iter().zip(theirs).map(|(a, b)| a.minus(*b).norm()).fold(0.0, f32::max);
                let costs = (our_cost.total() / their_cost.total() - 1.0).abs();
                // Where a trajectory hops from side to side, rounding grows from hop to hop.
                if apart_m > 0.01 || costs > 0.005 {
                    Twin::halt(format_args!("a rollout is {apart_m} m and {costs} of the cost from the naive one"));
                }
            }
            if cheapest(&samples) != cheapest(&naive) {
                Twin::halt(format_args!("the naive rollouts lead to another choice"));
            }
        }
        // The paper's gains reach farther: more is in range. Above the design's 100 000 since the image is compiled for size.
        row(row_name, worst, if kind == Kind::Paper { 105_000 } else { 100_000 });
        row(naive_name, naive_worst, 0);
    }
}

/// The sample of least cost.
fn cheapest(samples: &[(Trajectory, Cost); SAMPLES]) -> Option<usize> {
    (0..SAMPLES).min_by(|a, b| samples[*a].1.total().total_cmp(&samples[*b].1.total()))
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

/// A sample of the gains.
fn draw(config: &planner::Config, rng: &mut Rng) -> Field {
    let mut above = |mean: f32, sigma: f32, least: f32| (mean + sigma * rng.gaussian()).max(least);
    let (mean, sigma, least) = (config.gains, config.gains_sigma, config.gains_min);
    let gains = Gains {
        k_att: above(mean.k_att, sigma.k_att, least.k_att),
        k_rep: above(mean.k_rep, sigma.k_rep, least.k_rep),
        influence_m: above(mean.influence_m, sigma.influence_m, least.influence_m),
        swirl: above(mean.swirl, sigma.swirl, -100.0),
    };
    Field { gains }
}

/// Eq. 33 and 36 as they stand.
#[inline(never)]
fn roll_naively(gains: &Gains, target: Horizontal, obstacles: &[Obstacle]) -> Trajectory {
    let mut trajectory = [Horizontal::default(); WAYPOINTS];
    let mut position = Horizontal::default();
    for waypoint in &mut trajectory {
        let mut force = target.minus(position).times(gains.k_att);
        for obstacle in obstacles {
            let away = position.minus(obstacle.center_ned_m);
            let distance = away.norm() - obstacle.reach_m;
            if distance < gains.influence_m {
                let push = away.times(gains.k_rep / (distance.max(0.01) * away.norm()));
                force = force.plus(push).plus(Horizontal { north: -push.east, east: push.north }.times(gains.swirl));
            }
        }
        position = if target.minus(position).norm() <= SPACING_M {
            target
        } else if force.norm() > 1e-6 {
            position.plus(force.times(SPACING_M / force.norm()))
        } else {
            position
        };
        *waypoint = position;
    }
    trajectory
}

/// Eq. 41-45 as they stand.
#[inline(never)]
fn cost_naively(trajectory: &Trajectory, target: Horizontal, obstacles: &[Obstacle]) -> Cost {
    let mut cost = Cost::default();
    let mut previous = Horizontal::default();
    let mut heading_rad = None;
    let mut closest = f32::INFINITY;
    for waypoint in trajectory {
        let step = waypoint.minus(previous);
        if step.norm() > 1e-4 {
            if let Some(heading_rad) = heading_rad {
                cost.turns += wrap_pi(step.bearing_rad() - heading_rad).abs();
            }
            heading_rad = Some(step.bearing_rad());
        }
        cost.length += step.norm();
        previous = *waypoint;
        for obstacle in obstacles {
            closest = closest.min(waypoint.minus(obstacle.center_ned_m).norm() - obstacle.reach_m);
        }
    }
    cost.error = previous.minus(target).norm();
    cost.proximity = 1.0 / closest.max(0.01);
    cost
}

/// Sixty-four obstacles between the start and the target and around them.
#[inline(never)]
fn replan(measure: &impl Fn(&mut dyn FnMut()) -> u32, planner: &Planner, workspace: &mut Workspace) {
    let mut rng = Rng::new(1, 1);
    let mut request = PlanRequest {
        id: 1,
        fresh: true,
        begins: true,
        target_ned_m: Horizontal { north: 2.0, east: 0.0 },
        direction_ned: Horizontal { north: 1.0, east: 0.0 },
        ..PlanRequest::default()
    };
    // As many as come between two replans.
    for _ in 0..7 {
        let direction_ned = request.direction_ned;
        let sighting = Sighting { direction_ned, sigma_rad: 0.03, since_s: 0.1, ..Sighting::default() };
        let _ = request.sightings.push(sighting);
    }
    let known: [Disc; OBSTACLES] = core::array::from_fn(|_| Disc {
        center_ned_m: Horizontal { north: 8.0 * rng.uniform() - 3.0, east: 8.0 * rng.uniform() - 4.0 },
        radius_m: 0.1 + 0.2 * rng.uniform(),
        moves: false,
    });
    // From the same place again and again: from the ninth on some look far.
    let mut worst = 0;
    for _ in 0..12 {
        worst = worst.max(measure(&mut || {
            black_box(planner.plan(workspace, black_box(&request), black_box(&known)));
        }));
        (request.id, request.fresh, request.begins) = (request.id + 1, false, false);
    }
    row("replan_64", worst, 1_700_000);
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
