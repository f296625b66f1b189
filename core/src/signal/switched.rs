//! One receiver behind a switch: the slots of a packet become a phasor for each antenna. Before [`crate::doa::switched`].
//!
//! While a transmitter sends a tone (the constant tone extension of Bluetooth 5.1), a switch connects one antenna
//! after the other to the only receiver. Slot `s` begins at `s slot_s` and uses the antenna that the pattern names.
//!
//! 1. **Slot**: its samples, except the last quarter, are rotated back by the tone and averaged.
//! 2. **Offset** of the tone's frequency, which rotates the phase from slot to slot: the maximum over the offset of
//!    `sum_a |sum_(s of a) u_s e^(-j offset s)|^2`, with `u_s` the slots' directions. Visits of one antenna are a
//!    multiple of `g` slots apart, so the offset is known except for multiples of `2 pi / g`, which
//!    [`crate::doa::switched`] determines.
//! 3. **Antenna**: the mean of its visits, rotated back by the offset; outliers get little weight (Cauchy's weights).
//!
//! Not flown: no benchmark row counts it.

use core::f32::consts::{PI, TAU};

use crate::base::adc::ANTENNAS_MAX;
use crate::base::error::{ConfigError, Why, check};
use crate::base::math::sqrt;
use crate::base::units::{between, nearest, wrap_pi};
use crate::signal::phase::Complex;

/// Most slots of a packet: 160 us of a tone in slots of 1 us.
pub const SLOTS_MAX: usize = 160;
/// Most samples of a slot.
pub const SAMPLES_MAX: usize = 64;
/// Most slots between two visits of an antenna.
pub const CELLS_MAX: usize = 32;

/// Of three samples or more the last quarter is not used: the switch begins to move before a slot ends. In recordings
/// the last of three samples is off, and scatters more than the others.
const LEFT_OUT: usize = 4;
/// The first and the last slot of a packet are off the tone in many recorded packets: their weight is this.
const EDGE_WEIGHT: f32 = 0.25;
/// Squared chord at which a visit has half of its weight: 20 deg.
const HALF_WEIGHT: f32 = 0.122;
/// Squared chord within which a visit agrees with its antenna: 30 deg.
const AGREES: f32 = 0.268;
/// Steps of the robust mean.
const ROUNDS: usize = 4;
/// With random steps from sample to sample, the resultant squared times their number exceeds this once in 8 000
/// packets.
const STEP_POWER: f32 = 9.0;
/// The same of the seven steps of a reference period, once in 150 packets. The visits' agreement sorts out the rest.
const REFERENCE_POWER: f32 = 5.0;
/// And a tone has at least this resultant.
const STEP_RESULTANT: f32 = 0.35;
/// A packet whose visits agree less than this has no clean tone.
const AGREEMENT_MIN: f32 = 0.55;
/// An antenna this much below the strongest, in power, is dead.
const DEAD_POWER_RATIO: f32 = 0.01;
/// The largest signal-to-noise ratio reported.
const SNR_CEILING_DB: f32 = 60.0;

/// The schedule of the switch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Number of antennas, 2 to [`ANTENNAS_MAX`].
    pub antennas: usize,
    /// Rate of the samples inside a slot.
    pub sample_rate_hz: f32,
    /// Frequency of the tone in the samples without an offset; its sign matters.
    pub tone_hz: f32,
    /// From the beginning of a slot to the beginning of the next.
    pub slot_s: f32,
    /// The antenna of each slot from 1 on, 0 for a slot that is not used; repeated over the packet.
    pub pattern: [u8; SLOTS_MAX],
    /// Number of slots in the pattern.
    pub pattern_slots: usize,
}

impl Config {
    /// Checks the schedule for packets with these numbers of slots and of samples per slot.
    ///
    /// # Errors
    /// `antennas_m`, `sample_rate_hz`, `tone_hz`, `switch.slot_s`, `switch.pattern`, `slots` or `samples` out of
    /// range; an antenna without a slot in a packet; a packet too short to determine the offset; visits too far
    /// apart.
    pub fn build(&self, slots: usize, samples: usize) -> Result<Reader, ConfigError> {
        let refuse =
            |field, value: usize, text| Err(ConfigError { field, value: value as f32, why: Why::Inconsistent(text) });
        check("antennas_m", self.antennas as f32, 2.0, ANTENNAS_MAX as f32)?;
        let rate_hz = check("sample_rate_hz", self.sample_rate_hz, 1e3, 1e8)?;
        check("tone_hz", self.tone_hz, -0.5 * rate_hz, 0.5 * rate_hz)?;
        let slot_s = check("switch.slot_s", self.slot_s, 1e-7, 1.0)?;
        check("switch.pattern", self.pattern_slots as f32, 1.0, SLOTS_MAX as f32)?;
        check("slots", slots as f32, 2.0, SLOTS_MAX as f32)?;
        check("samples", samples as f32, 1.0, SAMPLES_MAX as f32)?;
        if (samples - 1) as f32 >= slot_s * rate_hz * 1.001 {
            let why = Why::Inconsistent("the samples of a slot take longer than a slot");
            return Err(ConfigError { field: "switch.slot_s", value: slot_s, why });
        }
        let pattern = self.pattern.get(..self.pattern_slots).unwrap_or_default();
        for antenna in pattern {
            check("switch.pattern", f32::from(*antenna), 0.0, self.antennas as f32)?;
        }
        let mut reader = Reader {
            antenna_of: [None; SLOTS_MAX],
            first_slot: [0; ANTENNAS_MAX],
            antennas: self.antennas,
            slots,
            samples,
            used: if samples > 2 { samples - samples.div_ceil(LEFT_OUT) } else { samples },
            cells: 0,
            sample_turn_rad: wrap_pi(TAU * fraction(self.tone_hz / rate_hz)),
            slot_turn_rad: wrap_pi(TAU * fraction(self.tone_hz * slot_s)),
            slot_samples: slot_s * rate_hz,
            tone_hz: self.tone_hz,
            slot_s,
        };
        let mut seen = [None; ANTENNAS_MAX];
        let named = pattern.iter().cycle();
        for ((s, slot), antenna) in reader.antenna_of.iter_mut().enumerate().take(slots).zip(named) {
            let Some(a) = usize::from(*antenna).checked_sub(1) else { continue };
            *slot = Some(a);
            let (Some(first), Some(seen)) = (reader.first_slot.get_mut(a), seen.get_mut(a)) else { continue };
            match *seen {
                None => *first = s,
                Some(before) => reader.cells = common_divisor(reader.cells, s - before),
            }
            *seen = Some(s);
        }
        if let Some(missing) = seen.iter().take(self.antennas).position(Option::is_none) {
            let text = "this antenna has no slot in a packet";
            return refuse("switch.pattern", missing + 1, text);
        }
        if reader.cells == 0 && samples == 1 {
            let text = "too few: no antenna is visited twice, and slots of one sample have no frequency of their own";
            return refuse("slots", slots, text);
        }
        if reader.cells > CELLS_MAX {
            return refuse("switch.pattern", reader.cells, "slots between two visits of an antenna: more than 32");
        }
        Ok(reader)
    }
}

/// The fractional part of a number of turns.
fn fraction(turns: f32) -> f32 {
    if libm::fabsf(turns) < 4e6 { turns - nearest(turns) as f32 } else { 0.0 }
}

/// Euclid's greatest common divisor; that of zero and a number is the number.
fn common_divisor(a: usize, b: usize) -> usize {
    let (mut a, mut b) = (a, b);
    while let Some(rest) = a.checked_rem(b) {
        (a, b) = (b, rest);
    }
    a
}

/// The state of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It holds the tone.
    Tone,
    /// It holds no clean tone: noise, another signal, or a tone with gaps.
    NoTone,
    /// A sample is not a finite number, or the packet is not as long as it should be.
    Damaged,
}

/// The content of a packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Packet {
    /// Its state; the other fields are valid with a tone only.
    pub outcome: Outcome,
    /// A phasor of length one for each antenna, as at the same instant with the offset of [`Self::offset_rad`]; zero
    /// for a dead antenna and for an unused entry.
    pub z: [Complex; ANTENNAS_MAX],
    /// The rotation of the phase from slot to slot by the offset, within half a cell of zero.
    pub offset_rad: f32,
    /// The rotation of the phase from sample to sample of a slot beyond the tone; `None` with one sample per slot.
    pub step_rad: Option<f32>,
    /// Variance of the phase of a `z`, from the scatter of the visits.
    pub variance: f32,
    /// Signal-to-noise ratio per sample, from the scatter of the slots; at most 60 dB.
    pub snr_db: f32,
}

impl Packet {
    const fn without(outcome: Outcome) -> Self {
        const ZERO: Complex = Complex { re: 0.0, im: 0.0 };
        Self { outcome, z: [ZERO; ANTENNAS_MAX], offset_rad: 0.0, step_rad: None, variance: 0.0, snr_db: 0.0 }
    }
}

/// The checked schedule for packets of one size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reader {
    /// The antenna of each slot, from 0.
    antenna_of: [Option<usize>; SLOTS_MAX],
    first_slot: [usize; ANTENNAS_MAX],
    antennas: usize,
    slots: usize,
    samples: usize,
    /// Samples of a slot that are used.
    used: usize,
    /// Zero if no antenna is visited twice.
    cells: usize,
    sample_turn_rad: f32,
    slot_turn_rad: f32,
    slot_samples: f32,
    tone_hz: f32,
    slot_s: f32,
}

/// The rotation of the phase from sample to sample beyond the tone.
struct Steps {
    sum: Complex,
    /// Length of the sum relative to that of equal steps; their number.
    resultant: f32,
    count: f32,
}

impl Reader {
    /// Number of antennas.
    #[must_use]
    pub fn antennas(&self) -> usize {
        self.antennas
    }

    /// How many offsets, `2 pi / cells` apart, are indistinguishable by the visits; at least one.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.cells.max(1)
    }

    /// The phasors of the antennas with an offset larger by this, a multiple of the cell.
    #[must_use]
    pub fn moved(&self, z: &[Complex; ANTENNAS_MAX], offset_rad: f32) -> [Complex; ANTENNAS_MAX] {
        let mut moved = *z;
        for (z, first) in moved.iter_mut().zip(self.first_slot) {
            *z = z.times(Complex::at(-wrap_pi(offset_rad * first as f32)));
        }
        moved
    }

    /// Samples per slot: how much farther the offset rotates the phase from slot to slot than from sample to sample.
    #[must_use]
    pub fn slot_samples(&self) -> f32 {
        self.slot_samples
    }

    /// Frequency of the tone with an offset.
    #[must_use]
    pub fn frequency_hz(&self, offset_rad: f32) -> f32 {
        self.tone_hz + offset_rad / (TAU * self.slot_s)
    }

    /// Reads the samples of a packet, slot after slot, and those of the reference period before it, if there are any: of one
    /// antenna, at the rate of the samples. They tell the tone's frequency where slots have one sample.
    #[must_use]
    pub fn read(&self, reference: &[Complex], packet: &[Complex]) -> Packet {
        let is_number = |x: &Complex| x.re.is_finite() && x.im.is_finite() && x.norm_squared() < 1e30;
        let finite = packet.iter().chain(reference).all(is_number);
        if !finite || packet.len() != self.slots * self.samples {
            return Packet::without(Outcome::Damaged);
        }
        let has_reference = reference.len() > 1;
        let steps = if has_reference { self.reference_steps(reference) } else { self.steps(packet) };
        let step_rad = (has_reference || self.samples > 1).then(|| steps.sum.arg());
        if step_rad.is_some() {
            let power = if has_reference { REFERENCE_POWER } else { STEP_POWER };
            let is_tone = steps.resultant > STEP_RESULTANT
                && steps.resultant * steps.resultant * steps.count > power
                && libm::fabsf(steps.sum.arg()) * self.slot_samples < PI;
            if !is_tone {
                return Packet::without(Outcome::NoTone);
            }
        }
        let mut slots = self.slot_means(packet);
        let offset_rad = if self.cells == 0 { steps.sum.arg() * self.slot_samples } else { self.offset(&slots) };
        for (s, slot) in slots.iter_mut().enumerate().take(self.slots) {
            *slot = slot.times(Complex::at(-wrap_pi(offset_rad * s as f32)));
        }
        self.antenna_means(&slots, &steps, offset_rad, step_rad)
    }

    /// The steps between the samples that are used.
    fn steps(&self, packet: &[Complex]) -> Steps {
        let (mut sum, mut most, mut count) = (Complex::default(), 0.0, 0.0);
        for (slot, antenna) in packet.chunks_exact(self.samples.max(1)).zip(&self.antenna_of) {
            let used = slot.get(..self.used).unwrap_or_default();
            for (before, sample) in used.iter().zip(used.iter().skip(1)).filter(|_| antenna.is_some()) {
                let step = sample.times_conj(*before);
                (sum, most, count) = (sum.plus(step), most + sqrt(step.norm_squared()), count + 1.0);
            }
        }
        let resultant = if most > 0.0 { sqrt(sum.norm_squared()) / most } else { 0.0 };
        Steps { sum: sum.times(Complex::at(-self.sample_turn_rad)), resultant, count }
    }

    /// The steps of the reference period.
    fn reference_steps(&self, reference: &[Complex]) -> Steps {
        let (mut sum, mut most, mut count) = (Complex::default(), 0.0, 0.0);
        for (before, sample) in reference.iter().zip(reference.iter().skip(1)) {
            let step = sample.times_conj(*before);
            (sum, most, count) = (sum.plus(step), most + sqrt(step.norm_squared()), count + 1.0);
        }
        let resultant = if most > 0.0 { sqrt(sum.norm_squared()) / most } else { 0.0 };
        Steps { sum: sum.times(Complex::at(-self.sample_turn_rad)), resultant, count }
    }

    /// The mean of each slot, rotated back by the tone; zero for an unused one.
    fn slot_means(&self, packet: &[Complex]) -> [Complex; SLOTS_MAX] {
        let mut slots = [Complex::default(); SLOTS_MAX];
        let share = 1.0 / self.used as f32;
        let packet = packet.chunks_exact(self.samples.max(1));
        for (s, ((mean, samples), antenna)) in slots.iter_mut().zip(packet).zip(&self.antenna_of).enumerate() {
            if antenna.is_none() {
                continue;
            }
            let begin_rad = self.slot_turn_rad * s as f32;
            for (k, sample) in samples.iter().enumerate().take(self.used) {
                let turn_rad = wrap_pi(begin_rad + self.sample_turn_rad * k as f32);
                *mean = mean.plus(sample.times(Complex::at(-turn_rad)).scaled(share));
            }
        }
        slots
    }

    /// The offset with the best agreement of the visits of each antenna, within half a cell of zero.
    fn offset(&self, slots: &[Complex; SLOTS_MAX]) -> f32 {
        // Sums over pairs of visits by their distance in cells: the maximum of their spectrum is that of the sums of the
        // visits' squared magnitudes.
        let mut lags = [Complex::default(); SLOTS_MAX];
        let mut longest = 0;
        let units = slots.iter().map(|slot| slot.unit()).zip(&self.antenna_of).take(self.slots);
        for (s, (slot, antenna)) in units.clone().enumerate() {
            for (lag, sum) in (1..).zip(lags.iter_mut()) {
                let Some((later, its)) = units.clone().nth(s + lag * self.cells) else { break };
                if antenna.is_some() && its == antenna {
                    *sum = sum.plus(later.times_conj(slot));
                    longest = longest.max(lag);
                }
            }
        }
        let cell_rad = TAU / self.cells() as f32;
        let score = |part: f32| {
            let lags = lags.iter().take(longest).zip(1..);
            lags.map(|(sum, lag)| sum.times(Complex::at(-wrap_pi(TAU * part * lag as f32))).re).sum::<f32>()
        };
        let parts = 4 * (longest + 1);
        let mut best = (f32::MIN, 0.0_f32);
        for k in 0..parts {
            let part = k as f32 / parts as f32;
            let value = score(part);
            best = if value > best.0 { (value, part) } else { best };
        }
        let mut part = best.1;
        // Twice a parabola through three points, the second time a tenth as far apart.
        for reach in [0.5 / parts as f32, 0.05 / parts as f32] {
            part += reach * vertex(score(part - reach), score(part), score(part + reach));
        }
        cell_rad * fraction(part)
    }

    /// The robust mean of each antenna's visits.
    fn antenna_means(
        &self,
        slots: &[Complex; SLOTS_MAX],
        steps: &Steps,
        offset_rad: f32,
        step_rad: Option<f32>,
    ) -> Packet {
        let mut z = [Complex::default(); ANTENNAS_MAX];
        let mut powers = [0.0_f32; ANTENNAS_MAX];
        let (mut visits, mut agreeing, mut scatter, mut freedom) = (0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32);
        for (a, (z, power)) in z.iter_mut().zip(powers.iter_mut()).enumerate().take(self.antennas) {
            let its = || {
                let slots = slots.iter().zip(&self.antenna_of).take(self.slots).enumerate();
                slots.filter(move |(_, (_, antenna))| **antenna == Some(a)).map(|(s, (slot, _))| {
                    let is_edge = s == 0 || s + 1 == self.slots;
                    (slot.unit(), if is_edge { EDGE_WEIGHT } else { 1.0 }, slot.norm_squared())
                })
            };
            // Starts at the visit that is closest to most others.
            let mut mean = Complex::default();
            let mut most = 0.0;
            for (candidate, _, _) in its() {
                let support = its().map(|(visit, weight, _)| weight * nearness(visit, candidate)).sum::<f32>();
                if support > most {
                    (most, mean) = (support, candidate);
                }
            }
            for _ in 0..ROUNDS {
                let weighted = |(visit, weight, _): (Complex, f32, f32)| visit.scaled(weight * nearness(visit, mean));
                mean = its().map(weighted).fold(Complex::default(), Complex::plus).unit();
            }
            let count = its().count() as f32;
            for (visit, _, own) in its() {
                let away = chord_squared(visit, mean);
                agreeing += if away < AGREES { 1.0 } else { 0.0 };
                scatter += away.min(AGREES);
                *power += own / count;
            }
            visits += count;
            freedom += count - 1.0;
            *z = mean;
        }
        let strongest = powers.iter().copied().fold(0.0_f32, f32::max);
        for (z, power) in z.iter_mut().zip(powers) {
            if !(power > DEAD_POWER_RATIO * strongest) {
                *z = Complex::default();
            }
        }
        let used = self.used as f32;
        // With one visit each, the scatter of the steps inside the slots: by two samples' noise.
        let variance = if freedom > 0.0 { scatter / freedom } else { (1.0 - steps.resultant) / used } + 1e-7;
        let snr_db = (-10.0 * libm::log10f(2.0 * used * variance)).min(SNR_CEILING_DB);
        let outcome = if agreeing > AGREEMENT_MIN * visits { Outcome::Tone } else { Outcome::NoTone };
        Packet { outcome, z, offset_rad, step_rad, variance: variance * self.antennas as f32 / visits, snr_db }
    }
}

/// The vertex of the parabola through three points, one apart, relative to the middle one; at most one away.
fn vertex(before: f32, here: f32, behind: f32) -> f32 {
    let bend = before - 2.0 * here + behind;
    if bend < 0.0 { between(0.5 * (before - behind) / bend, -1.0, 1.0) } else { 0.0 }
}

/// Squared distance of two numbers of length one: the square of a small angle between them.
fn chord_squared(a: Complex, b: Complex) -> f32 {
    (2.0 - 2.0 * a.times_conj(b).re).max(0.0)
}

/// Cauchy's weight.
fn nearness(a: Complex, b: Complex) -> f32 {
    HALF_WEIGHT / (HALF_WEIGHT + chord_squared(a, b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use std::vec::Vec;

    fn config(pattern: &[u8]) -> Config {
        let mut slots = [0; SLOTS_MAX];
        slots[..pattern.len()].copy_from_slice(pattern);
        let antennas = usize::from(*pattern.iter().max().unwrap());
        Config {
            antennas,
            sample_rate_hz: 2e6,
            tone_hz: 250e3,
            slot_s: 4e-6,
            pattern: slots,
            pattern_slots: pattern.len(),
        }
    }

    /// A packet of antennas with these phases.
    fn packet(config: &Config, phases: &[f32], offset_hz: f32, noise: f32, rng: &mut Rng) -> Vec<Complex> {
        let mut samples = Vec::new();
        for slot in 0..37 {
            let antenna = config.pattern[slot % config.pattern_slots];
            for k in 0..3 {
                let time_s = slot as f32 * config.slot_s + k as f32 / config.sample_rate_hz;
                let phase = 0.4 + TAU * fraction((config.tone_hz + offset_hz) * time_s);
                let phase = phase + antenna.checked_sub(1).map_or(0.0, |a| phases[usize::from(a)]);
                let z = Complex::at(wrap_pi(phase));
                samples.push(Complex { re: z.re + noise * rng.gaussian(), im: z.im + noise * rng.gaussian() });
            }
        }
        samples
    }

    #[test]
    fn antennas_have_their_phases_whatever_the_offset_and_the_pattern() {
        let phases = [0.0, 1.0, -2.0, 0.5];
        let mut rng = Rng::new(1, 0);
        for pattern in [&[1, 2, 3, 4][..], &[1, 2, 1, 3, 1, 4], &[1, 1, 2, 2, 3, 3, 4, 4], &[4, 0, 3, 0, 2, 0, 1, 0]] {
            let config = config(pattern);
            let reader = config.build(37, 3).unwrap();
            for offset_hz in [0.0, 9_000.0, -41_000.0, 80_000.0] {
                let read = reader.read(&[], &packet(&config, &phases, offset_hz, 0.03, &mut rng));
                assert_eq!(read.outcome, Outcome::Tone);
                // The offset is known but for the cell.
                let offset_rad = TAU * offset_hz * config.slot_s;
                let cells = wrap_pi((offset_rad - read.offset_rad) * reader.cells() as f32);
                assert!(libm::fabsf(cells) < 0.1, "{pattern:?} {offset_hz}: {cells}");
                let z = reader.moved(&read.z, offset_rad - read.offset_rad);
                for (own, phase) in z.iter().zip(phases) {
                    let off = wrap_pi(own.times_conj(z[0]).arg() - phase);
                    assert!(libm::fabsf(off) < 0.1, "{pattern:?} {offset_hz}: {off}");
                }
                assert!((20.0..36.0).contains(&read.snr_db), "{}", read.snr_db);
            }
        }
    }

    #[test]
    fn noise_gaps_and_damage_are_named() {
        let config = config(&[1, 2, 3, 4]);
        let reader = config.build(37, 3).unwrap();
        let mut rng = Rng::new(2, 0);
        for _ in 0..500 {
            let noise: Vec<Complex> = (0..111).map(|_| Complex { re: rng.gaussian(), im: rng.gaussian() }).collect();
            assert_eq!(reader.read(&[], &noise).outcome, Outcome::NoTone);
        }
        assert_eq!(reader.read(&[], &[Complex::default(); 111]).outcome, Outcome::NoTone);
        let mut good = packet(&config, &[0.0; 4], 0.0, 0.0, &mut rng);
        assert_eq!(reader.read(&[], &good[1..]).outcome, Outcome::Damaged);
        good[50].im = f32::NAN;
        assert_eq!(reader.read(&[], &good).outcome, Outcome::Damaged);
    }

    #[test]
    fn a_visit_that_is_off_and_a_dead_antenna_do_not_turn_the_others() {
        let config = config(&[1, 2, 3, 4]);
        let reader = config.build(37, 3).unwrap();
        let mut rng = Rng::new(3, 0);
        let mut samples = packet(&config, &[0.0, 1.0, -2.0, 0.5], 0.0, 0.01, &mut rng);
        for sample in &mut samples[3 * 13..3 * 14] {
            *sample = sample.times(Complex::at(2.5));
        }
        for sample in samples.chunks_exact_mut(3).skip(2).step_by(4).flatten() {
            *sample = sample.scaled(0.01);
        }
        let read = reader.read(&[], &samples);
        assert_eq!((read.outcome, read.z[2]), (Outcome::Tone, Complex::default()));
        assert!(libm::fabsf(read.z[1].times_conj(read.z[0]).arg() - 1.0) < 0.03, "{:?}", read.z);
    }

    #[test]
    fn a_schedule_is_refused_by_name() {
        let good = config(&[1, 2, 3, 4]);
        let refused = |config: Config, slots, samples| config.build(slots, samples).unwrap_err().field;
        assert_eq!(refused(Config { antennas: 1, ..good }, 37, 3), "antennas_m");
        assert_eq!(refused(Config { antennas: 5, ..good }, 37, 3), "switch.pattern");
        assert_eq!(refused(Config { antennas: 3, ..good }, 37, 3), "switch.pattern");
        assert_eq!(refused(Config { tone_hz: 1.1e6, ..good }, 37, 3), "tone_hz");
        assert_eq!(refused(Config { slot_s: f32::NAN, ..good }, 37, 3), "switch.slot_s");
        assert_eq!(refused(good, 3, 3), "switch.pattern");
        assert_eq!(refused(good, 4, 1), "slots");
        assert_eq!(refused(good, 161, 3), "slots");
        assert_eq!(refused(good, 37, 65), "samples");
    }
}
