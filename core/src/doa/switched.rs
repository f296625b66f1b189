//! Bearings from an antenna array behind a switch. After [`crate::signal::switched`] and [`crate::doa::beam`].
//!
//! Written after what recorded Bluetooth packets of a ring of eight showed: the phases miss a plane wave by far more than
//! noise turns them, and the bearings of one place and transmitter scatter by much less than they are off all together. So a
//! packet's noise says little about its error, and many packets say little more than one.
//!
//! 1. **Offset.** Visits leave it open which of [`Reader::cells`] offsets it is. For each transmitter the offsets of the last
//!    [`MEMORY`] packets have a median, from which no packet may be far, and each cell a score: how well a plane wave fits, mean over the packets,
//!    less how badly the steps inside the slots do. Cells whose steps fit so badly that no plane wave could make up for it are not tried. While
//!    one cell leads clearly, packets try no other; when its lead shrinks, all are tried ([`Emitter::searches`]).
//! 2. **Gate.** A packet whose steps or offset are not those of its transmitter has no clean tone: it has no bearing.
//! 3. **Direction**: the beam's maximum over the sum of the packets' covariances. It is not valid while another direction fits
//!    nearly as well, or fewer than two thirds of the packets are clean and unambiguous.
//! 4. **Sigma**: `floor^2 + noise^2 / K + (misfit / 2)^2`; only the noise is divided by the number of packets.
//!
//! The image of `cargo xtask flash --iq` flies by bearings of single packets. Their bench row is `cte_packet`. `docs/results/radios.md` has what
//! it comes to on the recording.

use core::f32::consts::{PI, TAU};

use crate::base::error::{ConfigError, check};
use crate::base::math::sqrt;
use crate::base::sort::nth;
use crate::base::time::Instant;
use crate::base::units::{nearest, wrap_pi};
use crate::doa::beam::{self, Arrival, Beam, Covariance, Peak, Scan, Vector};
use crate::doa::bearing::{Bearing, Flags, Quality, SIGMA_USELESS_RAD};
use crate::signal::phase::Complex;
use crate::signal::switched::{self, CELLS_MAX, Outcome, Packet, Reader};

/// Packets of a transmitter that are remembered.
pub const MEMORY: usize = 15;
/// Packets over which the score of a cell is averaged. It is no sum: at one place all packets share one error.
const SCORES: f32 = 32.0;
/// Packets over which it is learned of a transmitter how its phases scatter about a plane wave.
const LEARNING: f32 = 8.0;
/// And the least that is learned: 5 deg.
const LEARNT_MIN: f32 = 0.0076;
/// Variance of a phase about a plane wave outdoors: 25 deg. Recorded.
const MODEL_VARIANCE: f32 = 0.19;
/// What is known of it before a packet is seen counts for as much as two antennas.
const MODEL_ANTENNAS: f32 = 2.0;
/// How far, in turns of a slot, the steps inside the slots may be off the offset: 2 deg a sample with slots of eight. The
/// recorded receiver was off by 2.8 deg in all packets, half of what is between two cells.
const STEP_SIGMA_TURNS: f32 = 1.0 / 22.0;
/// How far a packet's steps may be from the median of its transmitter, in turns of a slot: 0.2 is 9 deg for slots of eight
/// samples.
const STEP_GATE_TURNS: f32 = 0.2;
/// How far its offset may be, in cells: 8 deg of 45.
const OFFSET_GATE_CELLS: f32 = 0.18;
/// Packets that make a median.
const MEDIAN_MIN: usize = 3;
/// More than any angle is below zero.
const ABOVE_ZERO: f32 = 4.0;
/// Another direction is told apart when it leaves this many times the misfit.
const APART: f32 = 2.0;
/// And when it is less likely by this: the logarithm of how many times.
const SURE: f32 = 3.0;
/// By how much a cell must fit better than any other, times the antennas beyond the two that always fit: the fewer there are, the
/// better a wrong cell fits by chance. Of eight antennas it is 3, of four 9.
const CELL_SURE: f32 = 18.0;
/// With a lead of this more the cells are no longer all tried.
const CELL_LEAD: f32 = 6.0;
/// A misfit as large as in one of twenty recorded packets is called a reflection: 40 deg, over the degrees of freedom.
const REFLECTED: f32 = 0.487;
/// What it does to a bearing, rms.
const REFLECTED_SIGMA_RAD: f32 = 5.0 / 57.295_78;
/// Share of a group's packets that must be clean and unambiguous, in thirds.
const GOOD_THIRDS: usize = 2;
/// What a bearing is off by in the open, whatever the packets say: the recording's. See [`Config::floor_rad`].
pub const FLOOR_RAD: f32 = 4.0 / 57.295_78;

/// What the estimation needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Least sigma of a bearing, of any number of packets.
    pub floor_rad: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { floor_rad: FLOOR_RAD }
    }
}

impl Config {
    /// Joins the array with the schedule of its switch.
    ///
    /// # Errors
    /// `sigma_floor` outside 0..=1 rad; `antennas_m` when the two have different numbers of antennas.
    pub fn build(&self, beam: Beam, reader: Reader) -> Result<Estimator, ConfigError> {
        let floor_rad = check("sigma_floor", self.floor_rad, 0.0, 1.0)?;
        check_antennas(&beam, &reader)?;
        Ok(Estimator { beam, reader, floor_rad })
    }
}

/// The array and the schedule of its switch have the same number of antennas.
fn check_antennas(beam: &Beam, reader: &Reader) -> Result<(), ConfigError> {
    let antennas = reader.antennas() as f32;
    check("antennas_m", beam.antennas() as f32, antennas, antennas).map(drop)
}

/// What is remembered of a transmitter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emitter {
    offsets_rad: [f32; MEMORY],
    steps_rad: [f32; MEMORY],
    count: usize,
    next: usize,
    /// The median of the offsets; it may leave the cell around zero.
    offset_rad: Option<f32>,
    /// Of each cell, and over how many packets.
    scores: [f32; CELLS_MAX],
    scored: [f32; CELLS_MAX],
    /// The best cell, and how much better it is than any other.
    cell: usize,
    lead: f32,
    packets: u32,
    searches: u32,
    /// Variance of a phase about a plane wave, as learned of its packets.
    variance: f32,
}

impl Default for Emitter {
    fn default() -> Self {
        Self {
            offsets_rad: [0.0; MEMORY],
            steps_rad: [0.0; MEMORY],
            count: 0,
            next: 0,
            offset_rad: None,
            scores: [0.0; CELLS_MAX],
            scored: [0.0; CELLS_MAX],
            cell: 0,
            lead: 0.0,
            packets: 0,
            searches: 0,
            variance: MODEL_VARIANCE,
        }
    }
}

/// Packets of one transmitter that make one bearing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Group {
    /// Of the packets before the last one.
    covariance: Covariance,
    last: Vector,
    /// The beam's powers over all of them, and the peak if it is one packet.
    scan: Scan,
    peak: Option<Peak>,
    noise: f32,
    /// Of the transmitter's phases about a plane wave.
    variance: f32,
    packets: usize,
    damaged: usize,
    clean: usize,
    good: usize,
    offset_rad: f32,
    snr_db: f32,
    /// Most other offsets of a packet that are nearly as likely.
    open: u8,
}

impl Group {
    /// Covariance of the antennas over the usable packets.
    #[must_use]
    pub fn covariance(&self) -> Covariance {
        let mut all = self.covariance;
        if self.clean > 0 {
            all.add(&self.last, 1.0);
        }
        all
    }

    /// Whether an antenna was heard in any packet.
    fn lives(&self, antenna: usize) -> bool {
        self.covariance.lives(antenna) || self.last.get(antenna).is_some_and(|z| z.norm_squared() > 0.0)
    }
}

/// The phasors of a packet with its offset, and how many other offsets are nearly as likely.
#[derive(Default)]
struct Followed {
    z: Vector,
    scan: Scan,
    offset_rad: f32,
    cell: usize,
    value: f32,
    /// Other cells that fit nearly as well.
    open: u8,
}

/// The configured stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimator {
    beam: Beam,
    reader: Reader,
    floor_rad: f32,
}

impl Estimator {
    /// Without array and schedule, to be built.
    pub const EMPTY: Self = Self { beam: Beam::EMPTY, reader: Reader::EMPTY, floor_rad: 0.0 };

    /// Builds it in place, as [`Config::build`] does: a stack may have no room for it.
    ///
    /// # Errors
    /// The field that is refused; it has no slots then.
    pub fn build_in(
        &mut self,
        config: &Config,
        beam: &beam::Config,
        switch: &switched::Config,
        slots: usize,
    ) -> Result<(), ConfigError> {
        self.reader = Reader::EMPTY;
        self.floor_rad = check("sigma_floor", config.floor_rad, 0.0, 1.0)?;
        beam.build_in(&mut self.beam)?;
        self.set_slots(switch, slots)
    }

    /// Takes packets of another number of slots of one sample from now on.
    ///
    /// # Errors
    /// The field of the schedule that is refused; it has no slots then.
    pub fn set_slots(&mut self, switch: &switched::Config, slots: usize) -> Result<(), ConfigError> {
        let built = switch.build_in(slots, 1, &mut self.reader).and_then(|()| check_antennas(&self.beam, &self.reader));
        if built.is_err() {
            self.reader = Reader::EMPTY;
        }
        built
    }

    /// The array.
    #[must_use]
    pub const fn beam(&self) -> &Beam {
        &self.beam
    }

    /// Number of slots of a packet.
    #[must_use]
    pub fn slots(&self) -> usize {
        self.reader.slots()
    }

    /// Takes a packet into the memory of its transmitter, and into the group that makes a bearing.
    pub fn take(&self, emitter: &mut Emitter, group: &mut Group, samples: &[Complex]) {
        self.take_with(emitter, group, &[], samples);
    }

    /// Counts an unusable packet.
    pub fn miss(&self, group: &mut Group) {
        group.packets += 1;
    }

    /// Takes a packet with its reference period, see [`Reader::read`].
    pub fn take_with(&self, emitter: &mut Emitter, group: &mut Group, reference: &[Complex], samples: &[Complex]) {
        let (clean, last) = (group.clean, group.last);
        self.take_in(emitter, group, reference, samples);
        if clean > 0 && group.clean > clean {
            group.covariance.add(&last, 1.0);
        }
    }

    /// The bearing of one packet with its reference period: that of a group of it alone, with less code.
    #[must_use]
    pub fn bearing_of_packet(
        &self,
        emitter: &mut Emitter,
        reference: &[Complex],
        samples: &[Complex],
        time: Instant,
    ) -> Arrival {
        let mut group = Group::default();
        self.take_in(emitter, &mut group, reference, samples);
        self.conclude(&group, group.peak, time)
    }

    /// Takes a packet, but for the covariance of the ones before.
    fn take_in(&self, emitter: &mut Emitter, group: &mut Group, reference: &[Complex], samples: &[Complex]) {
        group.packets += 1;
        let packet = self.reader.read(reference, samples);
        if packet.outcome != Outcome::Tone {
            group.damaged += usize::from(packet.outcome == Outcome::Damaged);
            return;
        }
        let mut followed = Followed::default();
        if !self.follow(emitter, &packet, &mut followed) {
            return;
        }
        let Some(peak) = self.beam.peak(&followed.scan, &followed.z) else { return };
        group.clean += 1;
        if peak.antennas > 2 {
            let antennas = peak.antennas as f32;
            emitter.variance += (peak.misfit() * antennas / (antennas - 2.0) - emitter.variance) / LEARNING;
        }
        group.variance = emitter.variance;
        group.good += usize::from(followed.open == 0 && self.rivals(&peak, group.variance) == 0);
        group.last = followed.z;
        group.open = group.open.max(followed.open);
        group.scan.add(&followed.scan);
        group.peak = (group.clean == 1).then_some(peak);
        let share = 1.0 / group.clean as f32;
        group.noise += share * (packet.variance - group.noise);
        group.snr_db += share * (packet.snr_db - group.snr_db);
        group.offset_rad = followed.offset_rad;
    }

    /// The packet with its offset, the cell found; false when the packet does not sound like its transmitter.
    fn follow(&self, emitter: &mut Emitter, packet: &Packet, best: &mut Followed) -> bool {
        let cells = self.reader.cells();
        let cell_rad = TAU / cells as f32;
        let within_cell = |rad: f32| rad - cell_rad * nearest(rad / cell_rad) as f32;
        let slot_samples = self.reader.slot_samples();
        let is_same = |step_rad: f32, median_rad: f32| {
            libm::fabsf(wrap_pi(step_rad - median_rad)) * slot_samples < STEP_GATE_TURNS * TAU
        };
        emitter.remember(packet);
        let step_rad = packet.step_rad.map(|_| emitter.step_rad());
        let step_fits = match (packet.step_rad, step_rad) {
            (Some(own), Some(median)) if emitter.count >= MEDIAN_MIN => is_same(own, median),
            _ => true,
        };
        let reach_rad = if emitter.count < MEDIAN_MIN { PI } else { OFFSET_GATE_CELLS * cell_rad };
        let mut median_rad = emitter.offset_rad(cell_rad, false);
        if libm::fabsf(within_cell(packet.offset_rad - median_rad)) > reach_rad {
            median_rad = emitter.offset_rad(cell_rad, true);
        }
        let away_rad = within_cell(packet.offset_rad - median_rad);
        if !step_fits || libm::fabsf(away_rad) > reach_rad {
            return false;
        }

        // What the steps say against each cell. Offsets a turn of a slot apart are the same.
        let mut costs = [0.0_f32; CELLS_MAX];
        let offset_of = |cell: usize| median_rad + (cell as f32 - (cells / 2) as f32) * cell_rad;
        if let Some(step_rad) = step_rad {
            let mut off_rad = wrap_pi(step_rad * slot_samples - offset_of(0));
            for cost in costs.iter_mut().take(cells) {
                let off = off_rad / (STEP_SIGMA_TURNS * TAU);
                *cost = 0.5 * off * off;
                off_rad -= if off_rad - cell_rad < -PI { cell_rad - TAU } else { cell_rad };
            }
        }
        let attempt = |emitter: &mut Emitter, (cell, cost): (usize, f32), tried: &mut Followed| {
            let offset_rad = offset_of(cell) + away_rad;
            tried.z = self.reader.moved(&packet.z, nearest((offset_rad - packet.offset_rad) / cell_rad));
            self.beam.scan(&tried.z, &mut tried.scan);
            let fit = self.beam.strongest(&tried.scan) / (self.reader.antennas() as f32 * MODEL_VARIANCE);
            (tried.offset_rad, tried.cell, tried.value) = (offset_rad, cell, emitter.score(cell, fit) - cost);
        };
        let sure = CELL_SURE / (self.reader.antennas() as f32 - 2.0).max(1.0);
        let leads = emitter.lead > sure + CELL_LEAD;
        emitter.packets = emitter.packets.saturating_add(1);
        emitter.searches = emitter.searches.saturating_add(u32::from(!leads));
        let costs = || costs.iter().copied().enumerate().take(cells);
        let mut first = costs().fold((0, f32::MAX), |least, own| if own.1 < least.1 { own } else { least });
        if emitter.packets > 1 {
            first = costs().nth(emitter.cell).unwrap_or(first);
        }
        attempt(emitter, first, best);
        // No plane wave could fit better than all antennas.
        let most = self.reader.antennas() as f32 / MODEL_VARIANCE;
        if !leads {
            let mut other = Followed::default();
            for (cell, cost) in costs() {
                if cell == first.0 || most - cost < best.value - sure - CELL_LEAD {
                    continue;
                }
                attempt(emitter, (cell, cost), &mut other);
                if other.value > best.value {
                    core::mem::swap(best, &mut other);
                }
            }
        }
        best.open = 0;
        let mut second = f32::MIN;
        for (cell, cost) in costs().filter(|(cell, _)| *cell != best.cell) {
            let value = emitter.scored(cell).unwrap_or(most) - cost;
            second = if value > second { value } else { second };
            best.open += u8::from(value > best.value - sure);
        }
        (emitter.cell, emitter.lead) = (best.cell, best.value - second);
        best.offset_rad = wrap_pi(best.offset_rad);
        true
    }

    /// The bearing of a group: of all its packets so far.
    #[must_use]
    pub fn bearing(&self, group: &Group, time: Instant) -> Arrival {
        let of_all = || self.beam.peak_of_all(&group.scan, &group.covariance());
        let peak = if group.clean > 1 { of_all() } else { group.peak };
        self.conclude(group, peak, time)
    }

    fn conclude(&self, group: &Group, peak: Option<Peak>, time: Instant) -> Arrival {
        let mut flags = if group.damaged > 0 { Flags::NOT_FINITE } else { Flags::default() };
        let frequency_hz = self.reader.frequency_hz(group.offset_rad);
        let quality = Quality { snr_db: group.snr_db, frequency_hz, ..Quality::default() };
        let mut bearing = Bearing::without(time, quality, flags.with(Flags::NO_SIGNAL));
        let is_enough = |count: usize| 3 * count >= GOOD_THIRDS * group.packets;
        if group.clean == 0 || !is_enough(group.clean) {
            return bearing.into();
        }
        let Some(peak) = peak else { return bearing.into() };
        for antenna in (0..self.beam.antennas()).filter(|antenna| !group.lives(*antenna)) {
            flags = flags.with(Flags::dead(antenna));
        }
        let mirror_rad = peak.mirror_rad;
        let is_lame = mirror_rad.is_some() && peak.antennas < self.beam.antennas();
        let rivals = self.rivals(&peak, group.variance);
        let is_sure = is_enough(group.good);
        let others = rivals.saturating_add(if is_sure { 0 } else { group.open });
        bearing.azimuth_rad = peak.azimuth_rad;
        bearing.sigma_rad = self.sigma_rad(&peak, group);
        bearing.valid = rivals == 0 && !is_lame && is_sure && bearing.sigma_rad < SIGMA_USELESS_RAD;
        if !bearing.valid || mirror_rad.is_some() {
            flags = flags.with(Flags::AMBIGUOUS);
        }
        if self.is_reflected(&peak) {
            flags = flags.with(Flags::MULTIPATH);
            bearing.sigma_rad = length(bearing.sigma_rad, REFLECTED_SIGMA_RAD).min(PI);
        }
        bearing.flags = flags;
        Arrival { bearing, mirror_rad, ambiguities: others.saturating_add(u8::from(mirror_rad.is_some())) }
    }

    fn sigma_rad(&self, peak: &Peak, group: &Group) -> f32 {
        // Along a line nothing is seen of the azimuth: a half turn.
        if !(peak.sensitivity > 1e-6) {
            return PI;
        }
        let antennas = peak.antennas as f32;
        // The misfit has lost two degrees of freedom, and gets as many back as it was before anything was seen.
        let misfit = peak.misfit() + MODEL_ANTENNAS * MODEL_VARIANCE / antennas;
        let noise = group.noise / group.clean.max(1) as f32;
        length(self.floor_rad, sqrt((0.25 * misfit + noise) / peak.sensitivity)).min(PI)
    }

    /// How many other directions the antennas cannot tell from the peak.
    fn rivals(&self, peak: &Peak, variance: f32) -> u8 {
        let margin = 2.0 * SURE * variance.max(LEARNT_MIN) / peak.antennas as f32;
        peak.ambiguities((APART * peak.misfit()).max(peak.misfit() + margin))
    }

    /// Whether the antennas miss a plane wave by more than nearly all recorded ones did; two always fit.
    fn is_reflected(&self, peak: &Peak) -> bool {
        let antennas = peak.antennas as f32;
        antennas > 2.0 && peak.misfit() * antennas / (antennas - 2.0) > REFLECTED
    }
}

impl Emitter {
    fn remember(&mut self, packet: &Packet) {
        if let (Some(offset), Some(step)) = (self.offsets_rad.get_mut(self.next), self.steps_rad.get_mut(self.next)) {
            *offset = packet.offset_rad;
            *step = packet.step_rad.unwrap_or(0.0);
        }
        self.next = if self.next + 1 < MEMORY { self.next + 1 } else { 0 };
        self.count = (self.count + 1).min(MEMORY);
    }

    /// Median of the steps.
    fn step_rad(&self) -> f32 {
        median(self.steps_rad, self.count, |step_rad| step_rad)
    }

    /// Moves the median of the offsets on to what it is now, by less than a cell. Without a median before, or where the
    /// offsets have moved away from it, it is taken about their mean.
    fn offset_rad(&mut self, cell_rad: f32, moved_away: bool) -> f32 {
        let within_cell = |rad: f32| rad - cell_rad * nearest(rad / cell_rad) as f32;
        let middle_rad = self.offset_rad.filter(|_| !moved_away).unwrap_or_else(|| {
            let offsets = self.offsets_rad.iter().take(self.count);
            let sum = offsets.fold(Complex::default(), |sum, offset| sum.plus(Complex::at(offset * TAU / cell_rad)));
            sum.arg() * cell_rad / TAU
        });
        let median_rad = middle_rad + median(self.offsets_rad, self.count, |offset| within_cell(offset - middle_rad));
        let before_rad = self.offset_rad.unwrap_or(median_rad);
        let now_rad = before_rad + within_cell(median_rad - before_rad);
        self.offset_rad = Some(now_rad);
        now_rad
    }

    /// How well a cell fits, on average: with one more packet.
    fn score(&mut self, cell: usize, fit: f32) -> f32 {
        let (Some(score), Some(count)) = (self.scores.get_mut(cell), self.scored.get_mut(cell)) else { return fit };
        *count = (*count + 1.0).min(SCORES);
        *score += (fit - *score) / *count;
        *score
    }

    /// The same without one; `None` of a cell that was never tried.
    fn scored(&self, cell: usize) -> Option<f32> {
        let (score, count) = self.scores.get(cell).zip(self.scored.get(cell))?;
        (*count > 0.0).then_some(*score)
    }

    /// Packets whose offset was looked for.
    #[must_use]
    pub fn packets(&self) -> u32 {
        self.packets
    }

    /// For how many of them no cell led clearly, so that all that could be were tried.
    #[must_use]
    pub fn searches(&self) -> u32 {
        self.searches
    }
}

/// The middle one of the first few values, which are angles.
fn median(values: [f32; MEMORY], count: usize, value: impl Fn(f32) -> f32) -> f32 {
    // None may be negative.
    let mut all = values.map(|own| value(own) + ABOVE_ZERO);
    nth(all.get_mut(..count).unwrap_or_default(), count / 2).map_or(0.0, |middle| middle - ABOVE_ZERO)
}

fn length(a: f32, b: f32) -> f32 {
    sqrt(a * a + b * b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::doa::beam;
    use crate::signal::switched::{self, SLOTS_MAX};
    use std::vec::Vec;

    fn parts(antennas: usize, radius_m: f32) -> (Beam, Reader) {
        let at = |k: usize| Complex::at(k as f32 * TAU / antennas as f32).scaled(radius_m);
        let antennas_m = core::array::from_fn(|k| if k < antennas { [at(k).re, at(k).im] } else { [0.0; 2] });
        let mut pattern = [0; SLOTS_MAX];
        for (slot, antenna) in pattern.iter_mut().zip(1..=antennas as u8) {
            *slot = antenna;
        }
        let (sample_rate_hz, tone_hz, slot_s) = (2e6, 250e3, 4e-6);
        let schedule = switched::Config { antennas, sample_rate_hz, tone_hz, slot_s, pattern, pattern_slots: antennas };
        let beam = beam::Config { wavelength_m: 1.0, antennas_m, count: antennas };
        (beam.build().unwrap(), schedule.build(37, 3).unwrap())
    }

    fn packet(beam: &Beam, azimuth_rad: f32, offset_hz: f32, noise: f32, rng: &mut Rng) -> Vec<Complex> {
        let wave = beam.toward(azimuth_rad);
        let mut samples = Vec::new();
        for slot in 0..37 {
            for k in 0..3 {
                // The tone turns once a slot, and by 45 deg a sample.
                let turns = offset_hz * (slot as f32 * 4e-6 + k as f32 * 0.5e-6) + k as f32 / 8.0;
                let z = wave[slot % beam.antennas()].times(Complex::at(wrap_pi(TAU * turns)));
                samples.push(Complex { re: z.re + noise * rng.gaussian(), im: z.im + noise * rng.gaussian() });
            }
        }
        samples
    }

    #[test]
    fn the_noise_shrinks_with_the_packets_and_the_floor_does_not() {
        let (beam, reader) = parts(8, 0.5);
        let mut rng = Rng::new(5, 0);
        for (floor_rad, bounds) in [(0.0, 0.5..0.95), (FLOOR_RAD, 0.95..1.01)] {
            let estimator = Config { floor_rad }.build(beam.clone(), reader).unwrap();
            let mut emitter = Emitter::default();
            let mut sigma_of = |packets: usize| {
                let mut group = Group::default();
                for _ in 0..packets {
                    estimator.take(&mut emitter, &mut group, &packet(&beam, 1.2, -9e3, 0.4, &mut rng));
                }
                let bearing = estimator.bearing(&group, Instant(0)).bearing;
                assert!(bearing.valid && libm::fabsf(bearing.azimuth_rad - 1.2) < 0.05, "{bearing:?}");
                bearing.sigma_rad
            };
            let ratio = sigma_of(32) / sigma_of(1);
            assert!(bounds.contains(&ratio), "{floor_rad}: {ratio}");
        }
    }

    #[test]
    fn a_packet_that_does_not_sound_like_its_transmitter_has_no_bearing() {
        let (beam, reader) = parts(8, 0.5);
        let estimator = Config::default().build(beam.clone(), reader).unwrap();
        let (mut emitter, mut rng) = (Emitter::default(), Rng::new(6, 0));
        let mut hear = |offset_hz: f32| {
            let mut group = Group::default();
            estimator.take(&mut emitter, &mut group, &packet(&beam, -2.0, offset_hz, 0.05, &mut rng));
            estimator.bearing(&group, Instant(0)).bearing
        };
        for _ in 0..8 {
            assert!(hear(20e3).valid);
        }
        let other = hear(9e3);
        assert!(!other.valid && other.flags.contains(Flags::NO_SIGNAL), "{other:?}");
        let same = hear(20.5e3);
        assert!(same.valid && libm::fabsf(same.quality.frequency_hz - 270.5e3) < 200.0, "{same:?}");
    }

    #[test]
    fn all_offsets_are_tried_once_and_not_again_while_one_leads() {
        let (beam, reader) = parts(8, 0.5);
        let estimator = Config::default().build(beam.clone(), reader).unwrap();
        let (mut emitter, mut rng) = (Emitter::default(), Rng::new(8, 0));
        for number in 0..40 {
            let mut group = Group::default();
            // It flies past.
            let azimuth_rad = 0.1 * number as f32 - 2.0;
            estimator.take(&mut emitter, &mut group, &packet(&beam, azimuth_rad, 14e3, 0.1, &mut rng));
            let arrival = estimator.bearing(&group, Instant(0));
            assert!(arrival.bearing.valid && arrival.ambiguities == 0, "{number}: {arrival:?}");
            assert!(libm::fabsf(wrap_pi(arrival.bearing.azimuth_rad - azimuth_rad)) < 0.05, "{number}: {arrival:?}");
        }
        assert_eq!((emitter.packets(), emitter.searches()), (40, 1));
    }

    #[test]
    fn a_bad_floor_and_another_number_of_antennas_are_refused_by_name() {
        let ((beam, reader), (_, other)) = (parts(8, 0.5), parts(4, 0.2));
        assert_eq!(Config { floor_rad: -1.0 }.build(beam.clone(), reader).unwrap_err().field, "sigma_floor");
        assert_eq!(Config::default().build(beam, other).unwrap_err().field, "antennas_m");
    }

    #[test]
    fn a_group_that_heard_nothing_says_so() {
        let (beam, reader) = parts(4, 0.2);
        let estimator = Config::default().build(beam, reader).unwrap();
        let (mut emitter, mut group) = (Emitter::default(), Group::default());
        estimator.take(&mut emitter, &mut group, &[Complex { re: f32::NAN, im: 0.0 }; 111]);
        let arrival = estimator.bearing(&group, Instant(0));
        assert!(!arrival.bearing.valid && arrival.bearing.flags == Flags::NO_SIGNAL.with(Flags::NOT_FINITE));
        assert!(arrival.mirror_rad.is_none());
    }
}
