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
//! Flown by the image of `cargo xtask flash --iq`. Its bench row is `cte_packet`.

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
/// Most steps of the robust mean, and the squared chord below which it has settled: 0.2 deg.
const ROUNDS: usize = 4;
const SETTLED: f32 = 1.2e-5;
/// Visits whose mean has at least this squared length are so close together that it starts there: 10 deg rms.
const CLOSE: f32 = 0.97;
/// Newton's steps for the offset.
const NEWTON: usize = 2;
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
        let mut reader = Reader::EMPTY;
        self.build_in(slots, samples, &mut reader).map(|()| reader)
    }

    /// The same in place: a stack may have no room for it.
    ///
    /// # Errors
    /// As above; the reader is of no use then.
    pub fn build_in(&self, slots: usize, samples: usize, reader: &mut Reader) -> Result<(), ConfigError> {
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
        *reader = Reader::EMPTY;
        (reader.antennas, reader.slots, reader.samples) = (self.antennas, slots, samples);
        reader.used = if samples > 2 { samples - samples.div_ceil(LEFT_OUT) } else { samples };
        reader.is_regular = true;
        reader.sample_turn = Complex::at(-wrap_pi(TAU * fraction(self.tone_hz / rate_hz)));
        reader.slot_turn = Complex::at(-wrap_pi(TAU * fraction(self.tone_hz * slot_s)));
        (reader.slot_samples, reader.tone_hz, reader.slot_s) = (slot_s * rate_hz, self.tone_hz, slot_s);
        let mut listed = 0;
        for (end, antenna) in reader.ends.iter_mut().zip(1..=self.antennas) {
            let mut first = None;
            let named = pattern.iter().cycle().take(slots).enumerate();
            for (slot, _) in named.filter(|(_, name)| usize::from(**name) == antenna) {
                let begin = *first.get_or_insert(slot);
                reader.cells = common_divisor(reader.cells, slot - begin);
                if let (Some(visit), Some(place)) = (reader.visits.get_mut(listed), reader.places.get_mut(slot)) {
                    *place = Place { at: listed as u8, antenna: antenna as u8 };
                    (visit.slot, visit.number) = (slot as u8, (slot - begin) as u8);
                }
                listed += 1;
            }
            if first.is_none() {
                return refuse("switch.pattern", antenna, "this antenna has no slot in a packet");
            }
            *end = listed as u8;
        }
        for visit in &mut reader.visits {
            visit.number = visit.number.checked_div(reader.cells as u8).unwrap_or(visit.number);
        }
        let is_regular = |visits: &[Visit]| visits.iter().zip(0..).all(|(visit, number)| visit.number == number);
        let all_regular = reader.by_antenna(&reader.visits).all(is_regular);
        reader.is_regular = all_regular;
        if reader.cells == 0 && samples == 1 {
            let text = "no antenna is visited twice, and slots of one sample tell no frequency";
            return refuse("slots", slots, text);
        }
        if reader.cells > CELLS_MAX {
            return refuse("switch.pattern", reader.cells, "slots between two visits of an antenna: more than 32");
        }
        let cell_rad = TAU / reader.cells() as f32;
        for (k, root) in reader.roots.iter_mut().enumerate() {
            *root = Complex::at(wrap_pi(k as f32 * cell_rad));
        }
        Ok(())
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

/// The use of a slot.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    at: u8,
    /// From 1 on; 0 for a slot that is not used.
    antenna: u8,
}

impl Place {
    /// Where it is among the visits, and its antenna from 0 on.
    fn used(self) -> Option<(usize, usize)> {
        Some((usize::from(self.at), usize::from(self.antenna.checked_sub(1)?)))
    }
}

/// A slot of an antenna.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Visit {
    slot: u8,
    /// How many cells after the antenna's first.
    number: u8,
}

/// The checked schedule for packets of one size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reader {
    /// Where a slot is among the visits, and its antenna.
    places: [Place; SLOTS_MAX],
    /// The visits of the first antenna, then those of the second, ...
    visits: [Visit; SLOTS_MAX],
    /// Where those of each antenna end.
    ends: [u8; ANTENNAS_MAX],
    antennas: usize,
    slots: usize,
    samples: usize,
    /// Samples of a slot that are used.
    used: usize,
    /// Zero if no antenna is visited twice.
    cells: usize,
    /// The visits of each antenna are one cell apart.
    is_regular: bool,
    /// Rotations by multiples of a cell.
    roots: [Complex; CELLS_MAX],
    /// What rotates the tone back by a sample, and by a slot.
    sample_turn: Complex,
    slot_turn: Complex,
    slot_samples: f32,
    tone_hz: f32,
    slot_s: f32,
}

/// The rotation of the phase from sample to sample beyond the tone.
#[derive(Default)]
struct Steps {
    sum: Complex,
    /// Length of the sum if all steps were equal; their number.
    most: f32,
    count: f32,
}

impl Steps {
    fn add(&mut self, samples: &[Complex]) {
        for (before, sample) in samples.iter().zip(samples.iter().skip(1)) {
            let step = sample.times_conj(*before);
            self.sum = self.sum.plus(step);
            self.most += sqrt(step.norm_squared());
            self.count += 1.0;
        }
    }

    /// Length of the sum relative to that of equal steps.
    fn resultant(&self) -> f32 {
        if self.most > 0.0 { sqrt(self.sum.norm_squared()) / self.most } else { 0.0 }
    }
}

/// What was heard.
struct Heard {
    /// The direction of each visit, of length one.
    units: [Complex; SLOTS_MAX],
    /// Sum of the powers of each antenna's visits.
    powers: [f32; ANTENNAS_MAX],
}

impl Reader {
    /// Of no packets, to be built.
    pub const EMPTY: Self = {
        const ZERO: Complex = Complex { re: 0.0, im: 0.0 };
        Self {
            places: [Place { at: 0, antenna: 0 }; SLOTS_MAX],
            visits: [Visit { slot: 0, number: 0 }; SLOTS_MAX],
            ends: [0; ANTENNAS_MAX],
            antennas: 0,
            slots: 0,
            samples: 0,
            used: 0,
            cells: 0,
            is_regular: false,
            roots: [ZERO; CELLS_MAX],
            sample_turn: ZERO,
            slot_turn: ZERO,
            slot_samples: 0.0,
            tone_hz: 0.0,
            slot_s: 0.0,
        }
    };

    /// Number of antennas.
    #[must_use]
    pub fn antennas(&self) -> usize {
        self.antennas
    }

    /// Number of slots of a packet.
    #[must_use]
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// How many offsets, `2 pi / cells` apart, are indistinguishable by the visits; at least one.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.cells.max(1)
    }

    /// The phasors of the antennas with an offset larger by so many cells.
    #[must_use]
    pub fn moved(&self, z: &[Complex; ANTENNAS_MAX], cells: i32) -> [Complex; ANTENNAS_MAX] {
        let mut moved = *z;
        let all = self.cells() as i32;
        for (z, visits) in moved.iter_mut().zip(self.by_antenna(&self.visits)) {
            let first = visits.first().map_or(0, |first| i32::from(first.slot));
            let back = first.wrapping_mul(cells).checked_rem_euclid(all).unwrap_or_default();
            let turn = self.roots.get(back as usize).copied().unwrap_or_default();
            *z = z.times_conj(turn);
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

    /// The part of each antenna.
    fn by_antenna<'a, T>(&'a self, all: &'a [T]) -> impl Iterator<Item = &'a [T]> {
        let mut begin = 0;
        self.ends.iter().take(self.antennas).map(move |end| {
            let end = usize::from(*end);
            let part = all.get(begin..end).unwrap_or_default();
            begin = end;
            part
        })
    }

    /// Reads the samples of a packet, slot after slot, and those of the reference period before it, if there are any: of one
    /// antenna, at the rate of the samples. They tell the tone's frequency where slots have one sample.
    #[must_use]
    pub fn read(&self, reference: &[Complex], packet: &[Complex]) -> Packet {
        // Of a sample that is no number the sum is none, either.
        let power_of = |samples: &[Complex]| samples.iter().map(|sample| sample.norm_squared()).sum::<f32>();
        let power = power_of(packet) + power_of(reference);
        if !(power < 1e30) || packet.len() != self.slots * self.samples {
            return Packet::without(Outcome::Damaged);
        }
        let has_reference = reference.len() > 1;
        let mut steps = Steps::default();
        if has_reference {
            steps.add(reference);
        }
        let mut heard = Heard { units: [Complex::default(); SLOTS_MAX], powers: [0.0; ANTENNAS_MAX] };
        self.hear(&mut heard, packet, (!has_reference).then_some(&mut steps));
        let resultant = steps.resultant();
        let step_rad = (has_reference || self.samples > 1).then(|| steps.sum.times(self.sample_turn).arg());
        if let Some(step_rad) = step_rad {
            let power = if has_reference { REFERENCE_POWER } else { STEP_POWER };
            let is_tone = resultant > STEP_RESULTANT
                && resultant * resultant * steps.count > power
                && libm::fabsf(step_rad) * self.slot_samples < PI;
            if !is_tone {
                return Packet::without(Outcome::NoTone);
            }
        }
        let offset_rad =
            if self.cells == 0 { step_rad.unwrap_or_default() * self.slot_samples } else { self.offset(&heard.units) };
        // Rotated back by the offset.
        let step = Complex::at(-offset_rad);
        let mut turn = Complex { re: 1.0, im: 0.0 };
        for place in self.places.iter().take(self.slots) {
            if let Some(unit) = place.used().and_then(|(place, _)| heard.units.get_mut(place)) {
                *unit = unit.times(turn);
            }
            turn = turn.times(step);
        }
        let packet = Packet { offset_rad, step_rad, ..Packet::without(Outcome::NoTone) };
        self.antenna_means(&heard, resultant, packet)
    }

    /// The mean of each slot, rotated back by the tone; the steps between the samples that are used go into a sum.
    fn hear(&self, heard: &mut Heard, packet: &[Complex], mut steps: Option<&mut Steps>) {
        let share = 1.0 / self.used as f32;
        let mut turn = Complex { re: share, im: 0.0 };
        for (place, samples) in self.places.iter().zip(packet.chunks_exact(self.samples.max(1))) {
            let own_turn = turn;
            turn = turn.times(self.slot_turn);
            let Some((place, antenna)) = place.used() else { continue };
            let used = samples.get(..self.used).unwrap_or_default();
            if let Some(steps) = &mut steps {
                steps.add(used);
            }
            let back = |sum: Complex, sample: &Complex| sum.times(self.sample_turn).plus(*sample);
            let (Some(last), before) = (used.last(), used.iter().rev().skip(1)) else { continue };
            let mean = before.fold(*last, back).times(own_turn);
            let own = mean.norm_squared();
            if let (Some(unit), Some(power)) = (heard.units.get_mut(place), heard.powers.get_mut(antenna))
                && own > 0.0
            {
                *unit = mean.scaled(1.0 / sqrt(own));
                *power += own;
            }
        }
    }

    /// The offset with the best agreement of the visits of each antenna, within half a cell of zero.
    fn offset(&self, units: &[Complex; SLOTS_MAX]) -> f32 {
        // Sums over pairs of visits by their distance in cells: the maximum of their spectrum is that of the sums of the
        // visits' squared magnitudes.
        let mut lags = [Complex::default(); SLOTS_MAX];
        let mut longest = 0;
        for (units, visits) in self.by_antenna(units).zip(self.by_antenna(&self.visits)) {
            for apart in 1..units.len() {
                let pairs = units.iter().zip(units.iter().skip(apart)).map(|(before, unit)| unit.times_conj(*before));
                let (last, mut sum) = (visits.get(apart), Complex::default());
                if self.is_regular {
                    sum = pairs.fold(sum, Complex::plus);
                } else {
                    let numbers = visits.iter().zip(visits.iter().skip(apart));
                    for (pair, (from, to)) in pairs.zip(numbers) {
                        if let Some(lag) = lags.get_mut(usize::from(to.number - from.number)) {
                            *lag = lag.plus(pair);
                        }
                    }
                }
                if let Some((lag, last)) = lags.get_mut(apart).zip(last) {
                    *lag = lag.plus(sum);
                    longest = longest.max(usize::from(last.number));
                }
            }
        }
        let lags = lags.get(1..=longest).unwrap_or_default();
        let parts = 4 * (longest + 1);
        let part_rad = TAU / parts as f32;
        let step = Complex::at(-part_rad);
        let (mut turn, mut best) = (Complex { re: 1.0, im: 0.0 }, (f32::MIN, 0));
        for k in 0..parts {
            let score = lags.iter().rev().fold(Complex::default(), |sum, lag| sum.plus(*lag).times(turn)).re;
            best = if score > best.0 { (score, k) } else { best };
            turn = turn.times(step);
        }
        // Newton's steps, of a tenth of a period of the fastest part at most.
        let mut lag_rad = best.1 as f32 * part_rad;
        for _ in 0..NEWTON {
            let step = Complex::at(-wrap_pi(lag_rad));
            let (mut turn, mut slope, mut bend, mut order) = (step, 0.0, 0.0, 1.0);
            for lag in lags {
                let own = lag.times(turn);
                slope += order * own.im;
                bend -= order * order * own.re;
                turn = turn.times(step);
                order += 1.0;
            }
            if bend < 0.0 {
                lag_rad -= between(slope / bend, -0.5 * part_rad, 0.5 * part_rad);
            }
        }
        TAU / self.cells() as f32 * fraction(lag_rad / TAU)
    }

    /// The robust mean of each antenna's visits.
    fn antenna_means(&self, heard: &Heard, resultant: f32, packet: Packet) -> Packet {
        let mut z = [Complex::default(); ANTENNAS_MAX];
        let mut powers = [0.0_f32; ANTENNAS_MAX];
        let (mut visits, mut agreeing, mut scatter) = (0.0_f32, 0.0_f32, 0.0_f32);
        let parts = self.by_antenna(&heard.units).zip(self.by_antenna(&self.visits));
        for (((z, power), sum), (units, its)) in z.iter_mut().zip(&mut powers).zip(heard.powers).zip(parts) {
            *z = robust_mean(units, its, self.slots);
            for unit in units {
                let away = chord_squared(*unit, *z);
                agreeing += if away < AGREES { 1.0 } else { 0.0 };
                scatter += if away < AGREES { away } else { AGREES };
            }
            let count = units.len() as f32;
            *power = sum / count;
            visits += count;
        }
        let strongest = powers.iter().copied().fold(0.0_f32, f32::max);
        for (z, power) in z.iter_mut().zip(powers) {
            if !(power > DEAD_POWER_RATIO * strongest) {
                *z = Complex::default();
            }
        }
        let (used, antennas) = (self.used as f32, self.antennas as f32);
        // With one visit each, the scatter of the steps inside the slots: by two samples' noise.
        let variance = if visits > antennas { scatter / (visits - antennas) } else { (1.0 - resultant) / used } + 1e-7;
        let snr_db = (-10.0 * libm::log10f(2.0 * used * variance)).min(SNR_CEILING_DB);
        let outcome = if agreeing > AGREEMENT_MIN * visits { Outcome::Tone } else { Outcome::NoTone };
        Packet { outcome, z, variance: variance * antennas / visits, snr_db, ..packet }
    }
}

/// The robust mean of an antenna's visits, of length one.
fn robust_mean(units: &[Complex], visits: &[Visit], slots: usize) -> Complex {
    let is_edge = |visit: &Visit| visit.slot == 0 || usize::from(visit.slot) + 1 == slots;
    let visits =
        || units.iter().zip(visits).map(|(unit, visit)| (*unit, if is_edge(visit) { EDGE_WEIGHT } else { 1.0 }));
    let (mut sum, mut weights) = (Complex::default(), 0.0);
    for (unit, weight) in visits() {
        (sum, weights) = (sum.plus(unit.scaled(weight)), weights + weight);
    }
    let mut mean = sum.unit();
    if sum.norm_squared() < CLOSE * weights * weights {
        // Starts at the visit that is closest to most others.
        let mut most = 0.0;
        for (candidate, _) in visits() {
            let support = visits().map(|(unit, weight)| weight * nearness(unit, candidate)).sum::<f32>();
            if support > most {
                (most, mean) = (support, candidate);
            }
        }
    }
    for _ in 0..ROUNDS {
        let before = mean;
        let weighted = |(unit, weight): (Complex, f32)| unit.scaled(weight * nearness(unit, before));
        mean = visits().map(weighted).fold(Complex::default(), Complex::plus).unit();
        if chord_squared(mean, before) < SETTLED {
            break;
        }
    }
    mean
}

/// Squared distance of two numbers of length one: the square of a small angle between them.
fn chord_squared(a: Complex, b: Complex) -> f32 {
    let chord = 2.0 - 2.0 * a.times_conj(b).re;
    if chord > 0.0 { chord } else { 0.0 }
}

/// Cauchy's weight.
fn nearness(a: Complex, b: Complex) -> f32 {
    HALF_WEIGHT / (HALF_WEIGHT + chord_squared(a, b))
}

#[cfg(test)]
mod tests;
