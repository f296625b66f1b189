//! Cost of other receivers: a packet of an array behind a switch; a covariance and a beam in all directions, of eight channels.

use core::f32::consts::TAU;
use core::hint::black_box;

use foxhound_core::base::rng::Rng;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::{sin_cos, wrap_pi};
use foxhound_core::doa::beam::{self, Beam, Covariance};
use foxhound_core::doa::switched::{self, Emitter, Group};
use foxhound_core::signal::phase::Complex;
use foxhound_core::signal::switched::{self as slots, SLOTS_MAX};
use static_cell::ConstStaticCell;

use crate::{halt, row};

const ANTENNAS: usize = 8;
/// Slots of a packet of 160 us, and samples of a slot.
const SLOTS: usize = 37;
const SAMPLES: usize = 3;
/// Samples of a channel, and the number of different ones.
const N: usize = 256;
const KEPT: usize = 16;
/// Radius of the ring of the frames, in wavelengths; it has a table of 36 directions.
const RING: f32 = 0.61;

static PACKET: ConstStaticCell<[Complex; SLOTS * SAMPLES]> =
    ConstStaticCell::new([Complex { re: 0.0, im: 0.0 }; SLOTS * SAMPLES]);

pub(super) fn rows(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let mut rng = Rng::new(31, 8);
    packets(measure, &mut rng);
    frames(measure, &mut rng);
}

/// A ring of antennas.
fn beam(radius_m: f32) -> Beam {
    let antennas_m = core::array::from_fn(|k| {
        let z = Complex::at(wrap_pi(k as f32 * TAU / ANTENNAS as f32)).scaled(radius_m);
        [z.re, z.im]
    });
    let config = beam::Config { wavelength_m: 1.0, antennas_m, count: ANTENNAS };
    match config.build() {
        Ok(beam) => beam,
        Err(_) => halt(format_args!("the ring does not build")),
    }
}

/// The largest cost of a packet of a transmitter whose offset is known, and of hard packets: noisy, of a transmitter that was not
/// heard before, with visits that are off and steps between two cells, so that every cell is tried.
#[inline(never)]
fn packets(measure: &impl Fn(&mut dyn FnMut()) -> u32, rng: &mut Rng) {
    let mut pattern = [0; SLOTS_MAX];
    for (slot, antenna) in pattern.iter_mut().zip(1..=ANTENNAS as u8) {
        *slot = antenna;
    }
    let (sample_rate_hz, tone_hz, slot_s, pattern_slots) = (2e6, 250e3, 4e-6, ANTENNAS);
    let schedule = slots::Config { antennas: ANTENNAS, sample_rate_hz, tone_hz, slot_s, pattern, pattern_slots };
    let built = schedule.build(SLOTS, SAMPLES).and_then(|reader| switched::Config::default().build(beam(0.5), reader));
    let Ok(estimator) = built else { halt(format_args!("the switched array does not build")) };
    let packet = PACKET.take();
    let (mut emitter, mut typical, mut hard) = (Emitter::default(), 0, 0);
    for number in 0..40 {
        let is_hard = number >= 16;
        let (azimuth_rad, noise) = (0.5 * number as f32, if is_hard { 0.5 } else { 0.1 });
        for (at, sample) in packet.iter_mut().enumerate() {
            let (slot, k) = (at / SAMPLES, at % SAMPLES);
            let away_rad = azimuth_rad - (slot % ANTENNAS) as f32 * TAU / ANTENNAS as f32;
            let (_, cosine) = sin_cos(wrap_pi(away_rad));
            let is_off = is_hard && slot % 5 == 0;
            let step_hz = if is_hard { 15.6e3 } else { 0.0 };
            let off_turns = if is_off { 0.3 } else { 0.0 };
            let turns = 9e3 * (slot as f32 * 4e-6 + k as f32 * 0.5e-6) + step_hz * k as f32 * 0.5e-6 + off_turns;
            let z = Complex::at(wrap_pi(TAU * (turns + k as f32 / 8.0 + 0.5 * cosine)));
            *sample = Complex { re: z.re + noise * rng.gaussian(), im: z.im + noise * rng.gaussian() };
        }
        if is_hard {
            emitter = Emitter::default();
        }
        let searches = emitter.searches();
        let mut group = Group::default();
        let taken = measure(&mut || {
            estimator.take(&mut emitter, &mut group, black_box(&packet[..]));
            black_box(estimator.bearing(&group, Instant(0)));
        });
        let worst = if emitter.searches() > searches { &mut hard } else { &mut typical };
        *worst = taken.max(*worst);
    }
    row("cte_packet", typical, 0);
    row("cte_packet_worst", hard, 0);
}

#[inline(never)]
fn frames(measure: &impl Fn(&mut dyn FnMut()) -> u32, rng: &mut Rng) {
    let (beam, mut frame) = (beam(RING), [beam::Vector::default(); KEPT]);
    let wave = beam.toward(1.1);
    for z in frame.iter_mut() {
        let sent = Complex { re: rng.gaussian(), im: rng.gaussian() };
        for (z, a) in z.iter_mut().zip(wave) {
            let clean = a.times(sent);
            *z = Complex { re: clean.re + 0.3 * rng.gaussian(), im: clean.im + 0.3 * rng.gaussian() };
        }
    }
    let mut covariance = Covariance::default();
    let added = measure(&mut || {
        for _ in 0..N / KEPT {
            for z in black_box(&frame) {
                covariance.add(z, 1.0);
            }
        }
    });
    row("covariance_8x256", added, 0);
    let mut scan = beam::Scan::default();
    let turned = measure(&mut || beam.scan(black_box(&wave), black_box(&mut scan)));
    row("beam_36", turned, 0);
    black_box(covariance);
}
