//! From codes to phasors and on to a bearing, beside what another crate takes for the same.

use core::f32::consts::TAU;
use core::hint::black_box;

use foxhound_computer::frozen::Watch;
use foxhound_core::base::adc::{AdcFrame, CHANNELS};
use foxhound_core::base::rng::Rng;
use foxhound_core::base::units::{sin_cos, wrap_pi};
use foxhound_core::guidance;
use foxhound_core::signal::phase::{self, Complex};
use foxhound_core::signal::spectrum::tone::{Reference, Window};
use foxhound_core::signal::spectrum::{Backend, Spectrum};
use microfft::real::rfft_256;

use crate::{N, TONE_BINS, halt, peer, row};

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

/// Phasors of four channels, and their phases; the peer finds the same ones by four transforms.
#[inline(never)]
pub(super) fn lock_in(measure: &impl Fn(&mut dyn FnMut()) -> u32, snapshot: &AdcFrame<N>) {
    let ours = LockIn::new(TONE_BINS);
    let mut z = [Complex::default(); CHANNELS];
    let mut phases = [0.0; CHANNELS];
    let codes = &snapshot.codes;

    row("phasors", measure(&mut || z = black_box(&ours).phasors(black_box(codes))), 1_900);
    peer("phasors", "microfft", measure(&mut || z = by_transform(black_box(codes))));
    row(
        "phasors_and_phases",
        measure(&mut || phases = black_box(&ours).phasors(black_box(codes)).map(Complex::arg)),
        0,
    );
    peer("phasors_and_phases", "microfft", measure(&mut || phases = by_transform(black_box(codes)).map(Complex::arg)));
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

/// The acquisition spectrum: mean taken off, Hann's window, powers. The peer is spared the first two, and then is not.
#[inline(never)]
pub(super) fn spectrum(measure: &impl Fn(&mut dyn FnMut()) -> u32, snapshot: &AdcFrame<N>) {
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
pub(super) fn wave(azimuth_rad: f32) -> [Complex; CHANNELS] {
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
pub(super) fn front_end(measure: &impl Fn(&mut dyn FnMut()) -> u32, snapshot: &AdcFrame<N>) {
    let config = guidance::Config::default();
    let (Ok(extractor), Ok(array)) = (config.phase.build::<N>(), config.array.build()) else {
        halt(format_args!("the built-in front end does not build"))
    };
    let Ok(estimator) = config.bearing.build(array) else {
        halt(format_args!("the built-in estimator does not build"))
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
            black_box(estimator.estimate(black_box(&phasors)));
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
