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
use foxhound_core::adc::{CHANNELS, Snapshot};
use foxhound_core::frame::{Horizontal, Ned};
use foxhound_core::guidance::{self, FrontEnd, Guidance, Input};
use foxhound_core::map::{CIRCLES_MAX, Circle};
use foxhound_core::mission::Control;
use foxhound_core::multipath::{self, Look};
use foxhound_core::ownship::Ownship;
use foxhound_core::phase::{self, Complex, Phasors};
use foxhound_core::planner::{PlanRequest, Planner, Scratch};
use foxhound_core::rng::Rng;
use foxhound_core::spectrum::tone::{Reference, Window};
use foxhound_core::spectrum::{Backend, Spectrum, kernel, kernel_armv7em};
use foxhound_core::time::Instant;
use foxhound_core::units::{sin_cos, wrap_pi};
use foxhound_firmware::app::SAMPLES_PER_CHANNEL as N;
use foxhound_firmware::boards::board;
use foxhound_link::mailbox::instructions;
use idsp::Lowpass;
use microfft::real::rfft_256;
use static_cell::ConstStaticCell;

/// Steps of the flight that the fast loop is measured in; the first ones acquire.
const STEPS: usize = 96;
const WARM_UP: usize = 32;
/// The tone, in bins, off the grid.
const TONE_BINS: f32 = 20.3;
const STEP_US: u64 = 20_000;
/// Scenes of the looks.
const SCENES: usize = 64;

static SNAPSHOT: ConstStaticCell<Snapshot<N>> = ConstStaticCell::new(Snapshot::zeroed());

#[cortex_m_rt::entry]
fn main() -> ! {
    let _board = board::start();
    let empty = count(&mut || {});
    let measure = |task: &mut dyn FnMut()| count(task).saturating_sub(empty);

    let words = kernels::<64>(1) + kernels::<128>(2) + kernels::<256>(3) + kernels::<512>(4) + kernels::<1024>(5);
    semihosting::println!("equal {words}");

    let snapshot = SNAPSHOT.take();
    receive(snapshot, 0);
    lock_in(&measure, snapshot);
    spectrum(&measure, snapshot);
    front_end(&measure, snapshot);
    several_looks(&measure);
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
    semihosting::println!("count {name} {instructions} {ceiling}");
}

fn peer(name: &str, whose: &str, instructions: u32) {
    semihosting::println!("peer {name} {whose} {instructions}");
}

/// Runs the target's kernels and the portable ones over the same words, random ones and corners, and ends the program
/// when they differ. Returns how many words went in.
fn kernels<const M: usize>(seed: u64) -> u32 {
    const ROUNDS: usize = 24;
    let mut words = Words(Rng::new(seed, 3));
    let check = |same: bool, name: &str| {
        if !same {
            board::halt(format_args!("kernel {name} differs from the portable one, N = {M}"));
        }
    };
    for round in 0..ROUNDS {
        let (data, twiddles): ([u32; M], [u32; M]) = ([0; M].map(|_| words.word()), [0; M].map(|_| words.word()));
        stages(&data, &twiddles, &check);
        for quad in data.as_chunks::<4>().0 {
            let [a, b, c, d] = *quad;
            check(kernel_armv7em::add(a, b) == kernel::add(a, b), "add");
            check(kernel_armv7em::subtract(a, b) == kernel::subtract(a, b), "subtract");
            let powers = [[a, b, c], [d, a ^ c, b ^ d]];
            check(kernel_armv7em::powers(powers[0], powers[1]) == kernel::powers(powers[0], powers[1]), "powers");
            let (up, mask) = (a % 16, !b);
            check(
                kernel_armv7em::first_butterfly(*quad, up, mask, c ^ d)
                    == kernel::first_butterfly(*quad, up, mask, c ^ d),
                "first_butterfly",
            );
        }
        let mut codes = Codes([0_i16; M]);
        let mut table = Codes([0_i16; M]);
        for ((code, entry), word) in codes.0.iter_mut().zip(&mut table.0).zip(data) {
            // Codes of 12 bits in every other round, or no clipped sample would be seen.
            *code = if round % 2 == 0 { kernel::low(word) >> 4 } else { kernel::low(word) };
            *entry = kernel::high(word);
        }
        let (row, table) = (&codes.0, &table.0);
        check(kernel_armv7em::moments(row) == kernel::moments(row), "moments");
        check(kernel_armv7em::moments(&row[1..]) == kernel::moments(&row[1..]), "moments, unaligned");
        check(kernel_armv7em::sum_and_reach(row) == kernel::sum_and_reach(row), "sum_and_reach");
        check(kernel_armv7em::lock_in(row, table) == kernel::lock_in(row, table), "lock_in");
        check(kernel_armv7em::table_energies(table) == kernel::table_energies(table), "table_energies");
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
        kernel::pack(self.lane(), self.lane())
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
            let reach = kernel_armv7em::stage::<M, L, LEN, true>(target, twiddles);
            reach == kernel::stage::<M, L, LEN, true>(portable, twiddles)
        } else {
            let reach = kernel_armv7em::stage::<M, L, LEN, false>(target, twiddles);
            reach == kernel::stage::<M, L, LEN, false>(portable, twiddles)
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
fn lock_in(measure: &impl Fn(&mut dyn FnMut()) -> u32, snapshot: &Snapshot<N>) {
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
fn spectrum(measure: &impl Fn(&mut dyn FnMut()) -> u32, snapshot: &Snapshot<N>) {
    let mut spectrum = Spectrum::<N>::default();
    let mut scratch = [0.0; N];
    let codes = &snapshot.codes;
    row(
        "spectrum",
        measure(&mut || black_box(&mut spectrum).measure(Backend::Fixed, black_box(codes), &mut scratch)),
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
        measure(&mut || black_box(&mut spectrum).measure(Backend::Microfft, black_box(codes), &mut scratch)),
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
fn front_end(measure: &impl Fn(&mut dyn FnMut()) -> u32, snapshot: &Snapshot<N>) {
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
}

fn noisy(z: [Complex; CHANNELS], amplitude: f32, sigma: f32, rng: &mut Rng) -> [Complex; CHANNELS] {
    z.map(|z| Complex { re: amplitude * z.re + sigma * rng.gaussian(), im: amplitude * z.im + sigma * rng.gaussian() })
}

/// The eighth look at a source and its reflection at -6 dB, taken and solved for: of one heading, and turning by 90 degrees.
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
        board::halt(format_args!("the built-in front end does not build"))
    };
    let (Ok(finder), Ok(looks)) = (config.bearing.build(array), multipath::Config::default().build(&array)) else {
        board::halt(format_args!("the built-in estimator does not build"))
    };
    // Of a silent snapshot, for the parts that no look here changes.
    let silence = extractor.step(&mut phase::State::default(), &Snapshot::zeroed());
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
        let look = Look { phasors: &phasors, bearing: &bearing, yaw_rad, position_ned_m: None };
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
    let phases = wave(FRAC_PI_2 / 3.0).map(Complex::arg);
    for (row, phase) in snapshot.codes.iter_mut().zip(phases) {
        for (index, code) in row.iter_mut().enumerate() {
            let (_, cosine) = sin_cos(TAU * TONE_BINS / N as f32 * index as f32 + phase);
            *code = (1000.0 * cosine + 50.0 * rng.gaussian()) as i16;
        }
    }
}
