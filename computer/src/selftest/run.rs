//! Sums over the frames, and the verdict from them.

use foxhound_core::base::adc::{AdcFrame, CHANNELS};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::DEG_PER_RAD;
use foxhound_core::doa::array::{Array, Entry};
use foxhound_core::doa::calibration::order::{self, Order};
use foxhound_core::doa::calibration::{Calibrator, Source, Taken};
use foxhound_core::signal::phase::{self, Complex, Phasors};
use foxhound_link::companion::{Exam, Tone};

use super::report::{Reading, Report};
use super::{
    CLIPPED_MAX, Channels, Check, FRAMES, GAIN_SPREAD_MAX_DB, NOISE_FLOOR_CODES, NOISE_MAX_CODES, NOISE_SPREAD_MAX_DB,
    OFFSET_MAX_CODES, PHASE_SIGMA_MAX_RAD, RATE_OFF_MAX, SNR_MIN_DB, Verdict,
};
use crate::SAMPLES_PER_CHANNEL as N;

/// The rms value of the loudest sine that fits.
const FULL_SCALE_CODES: f32 = 2048.0 * core::f32::consts::FRAC_1_SQRT_2;
/// A channel this much below the strongest, in power, is dead.
const DEAD_POWER_RATIO: f32 = 0.01;
/// The first frames are not used: the tone has to be found, and the board's own has to rise.
pub(super) const SETTLING: u16 = 8;
/// No more than one frame in so many may be missing.
const MISSED_MAX: u16 = 4;
/// Frames farther apart than this are not timed.
const GAP_MAX_US: u64 = 1_000_000;
/// All pairs of channels, in the order of the bits of `pairs`.
const PAIRS: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];

#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    pub(super) exam: Exam,
    /// Frames still to be skipped.
    pub(super) settling: u16,
    /// Frames used.
    frames: u16,
    /// Steps without a frame.
    missed: u16,
    /// Frames with a usable tone.
    heard: u16,
    calibrator: Calibrator,
    /// Phasors of the first such frame, to which phases are compared.
    first: [Complex; CHANNELS],
    /// How much each channel's phase differs from the common one.
    turned_rad: [f32; CHANNELS],
    turned_rad2: [f32; CHANNELS],
    amplitude_codes: [f32; CHANNELS],
    variance_codes2: [f32; CHANNELS],
    codes: [i32; CHANNELS],
    rails: [u16; CHANNELS],
    snr_db: f32,
    /// Over all frames: the channels that did not change, and the pairs that were identical.
    silent: Channels,
    pairs: u8,
    frozen: Channels,
    last: Instant,
    timed_s: f32,
    /// How much longer that was than its blocks.
    late_s: f32,
}

impl Run {
    pub(super) fn new(exam: Exam) -> Self {
        Self {
            exam,
            settling: SETTLING,
            frames: 0,
            missed: 0,
            heard: 0,
            calibrator: Calibrator::default(),
            first: [Complex::default(); CHANNELS],
            turned_rad: [0.0; CHANNELS],
            turned_rad2: [0.0; CHANNELS],
            amplitude_codes: [0.0; CHANNELS],
            variance_codes2: [0.0; CHANNELS],
            codes: [0; CHANNELS],
            rails: [0; CHANNELS],
            snr_db: 0.0,
            silent: Channels::which(|_| true),
            pairs: !0,
            frozen: Channels::NONE,
            last: Instant(0),
            timed_s: 0.0,
            late_s: 0.0,
        }
    }

    fn source(&self) -> Source {
        match self.exam {
            Exam::Calibrate { azimuth_rad: Some(azimuth_rad) } | Exam::SelfTest(Tone::Ahead { azimuth_rad }) => {
                Source::ahead_at(azimuth_rad)
            }
            _ => Source::Splitter,
        }
    }

    pub(super) fn entry(&self) -> Option<Entry> {
        self.calibrator.entry(None)
    }

    pub(super) fn miss(&mut self, frozen: Option<usize>) {
        self.missed = self.missed.saturating_add(1);
        if let Some(channel) = frozen {
            self.frozen = self.frozen.and(channel);
        }
    }

    /// Missing frames end it, too.
    pub(super) fn is_over(&self) -> bool {
        self.frames >= FRAMES || self.missed >= FRAMES
    }

    pub(super) fn take(&mut self, array: &Array, blocks_per_s: f32, snapshot: &AdcFrame<N>, phasors: &Phasors) {
        if self.settling > 0 {
            self.settling -= 1;
            self.last = snapshot.time;
            return;
        }
        self.time(blocks_per_s, snapshot.time);
        let codes = &snapshot.codes;
        for (sum, row) in self.codes.iter_mut().zip(codes) {
            *sum += row.iter().map(|code| i32::from(*code)).sum::<i32>();
        }
        for (rails, new) in self.rails.iter_mut().zip(snapshot.clip_count()) {
            *rails = rails.saturating_add(new);
        }
        let is_silent = |channel: usize| {
            codes.get(channel).is_some_and(|row| row.first().is_none_or(|first| row.iter().all(|code| code == first)))
        };
        self.silent = Channels::which(|channel| self.silent.contains(channel) && is_silent(channel));
        for (bit, (a, b)) in PAIRS.into_iter().enumerate() {
            if self.pairs & (1 << bit) != 0 && codes.get(a) != codes.get(b) {
                self.pairs &= !(1 << bit);
            }
        }
        for (variance, noise) in self.variance_codes2.iter_mut().zip(phasors.noise) {
            *variance += noise * (N as f32 / 4.0);
        }
        self.listen(array, phasors);
        self.frames += 1;
    }

    /// There are whole blocks from frame to frame, of which any number may be missing.
    fn time(&mut self, blocks_per_s: f32, time: Instant) {
        let since_us = time.micros_since(self.last);
        self.last = time;
        if (1..GAP_MAX_US).contains(&since_us) {
            let blocks = libm::roundf(since_us as f32 * 1e-6 * blocks_per_s);
            self.timed_s += since_us as f32 * 1e-6;
            self.late_s += since_us as f32 * 1e-6 - blocks / blocks_per_s;
        }
    }

    fn listen(&mut self, array: &Array, phasors: &Phasors) {
        if phasors.tone == phase::Tone::Absent
            || self.calibrator.step(array, self.source(), phasors) == Taken::OtherFrequency
        {
            return;
        }
        if self.heard == 0 {
            self.first = phasors.z;
        }
        self.heard += 1;
        self.snr_db += phasors.snr_db;
        for (sum, z) in self.amplitude_codes.iter_mut().zip(phasors.z) {
            *sum += sqrt(z.norm_squared());
        }
        let turns: [Complex; CHANNELS] = core::array::from_fn(|m| phasors.z[m].times_conj(self.first[m]));
        let common = turns.iter().fold(Complex::default(), |sum, turn| sum.plus(*turn));
        for ((sum, squares), turn) in self.turned_rad.iter_mut().zip(&mut self.turned_rad2).zip(turns) {
            let turned_rad = turn.times_conj(common).arg();
            *sum += turned_rad;
            *squares += turned_rad * turned_rad;
        }
    }

    /// The first fault; the array is there where frames came.
    pub(super) fn judge(&self, array: Option<&Array>) -> Verdict {
        let measured = self.measured();
        let fail = |check, channels| Verdict::Fail { check, channels };
        let found = |check, channels: Channels| (!channels.is_none()).then_some(fail(check, channels));
        let each = |check, is_wrong: &dyn Fn(&Measured) -> bool| {
            found(check, Channels::which(|channel| measured.get(channel).is_some_and(is_wrong)))
        };
        if !self.frozen.is_none() {
            return fail(Check::Frozen, self.frozen);
        }
        if self.frames < FRAMES || MISSED_MAX * self.missed > self.frames {
            return fail(Check::Frames, Channels::NONE);
        }
        let [quietest_codes, ..] = sorted(measured.map(|channel| channel.noise_codes));
        let floor_codes = quietest_codes.max(NOISE_FLOOR_CODES);
        let noise_max_codes = (floor_codes * ratio(NOISE_SPREAD_MAX_DB)).min(NOISE_MAX_CODES);
        found(Check::Dead, self.silent)
            .or_else(|| each(Check::Clipped, &|channel| channel.clipped > CLIPPED_MAX))
            .or_else(|| found(Check::Same, self.same()))
            .or_else(|| (libm::fabsf(self.rate_off()) > RATE_OFF_MAX).then_some(fail(Check::Rate, Channels::NONE)))
            .or_else(|| each(Check::Offset, &|channel| libm::fabsf(channel.offset_codes) > OFFSET_MAX_CODES))
            .or_else(|| each(Check::Noise, &|channel| channel.noise_codes > noise_max_codes))
            .or_else(|| self.judge_tone(&measured))
            .or_else(|| found(Check::Order, array.map_or(Channels::NONE, |array| self.moved(array, &measured))))
            .unwrap_or(Verdict::Pass)
    }

    fn judge_tone(&self, measured: &[Measured; CHANNELS]) -> Option<Verdict> {
        let fail = |check, channels| Some(Verdict::Fail { check, channels });
        if 2 * self.heard < self.frames || self.snr_db < SNR_MIN_DB * f32::from(self.heard) {
            return fail(Check::Tone, Channels::NONE);
        }
        let amplitudes_codes = measured.map(|channel| channel.amplitude_codes);
        let [least, .., most] = sorted(amplitudes_codes);
        let dead = Channels::which(|m| amplitudes_codes[m] * amplitudes_codes[m] < DEAD_POWER_RATIO * most * most);
        if !dead.is_none() {
            return fail(Check::Dead, dead);
        }
        if db(most / least) > GAIN_SPREAD_MAX_DB {
            let middle = middle(amplitudes_codes);
            let away = measured.map(|channel| libm::fabsf(db(channel.amplitude_codes / middle)));
            return fail(Check::Gain, farthest(away));
        }
        let unsteady = measured.map(|channel| channel.phase_sigma_rad);
        if unsteady.iter().any(|sigma_rad| !(*sigma_rad <= PHASE_SIGMA_MAX_RAD)) {
            return fail(Check::Phase, farthest(unsteady));
        }
        None
    }

    /// Channels that are identical in all frames.
    fn same(&self) -> Channels {
        let pairs = PAIRS.into_iter().enumerate().filter(|(bit, _)| self.pairs & (1 << bit) != 0);
        pairs.fold(Channels::NONE, |channels, (_, (a, b))| channels.and(a).and(b))
    }

    /// The sample rate by the time stamps, relative to the configured one, minus one.
    fn rate_off(&self) -> f32 {
        if self.timed_s > 0.0 { -self.late_s / self.timed_s } else { 0.0 }
    }

    /// Channels whose antennas are on others; only a source in a known direction shows it, with calibrated channels.
    #[inline(never)]
    fn moved(&self, array: &Array, measured: &[Measured; CHANNELS]) -> Channels {
        let Exam::SelfTest(Tone::Ahead { .. }) = self.exam else { return Channels::NONE };
        let Some(entry) = self.entry() else { return Channels::NONE };
        if !array.depends_on_frequency() || array.at(entry.frequency_hz).is_uncalibrated() {
            return Channels::NONE;
        }
        // Of all frames: the last one may hold another tone, or none.
        let expected = self.source().phasors(array);
        let heard = Phasors {
            time: self.last,
            z: core::array::from_fn(|m| {
                Complex::at(entry.phase_rad[m]).scaled(measured[m].amplitude_codes).times(expected[m])
            }),
            noise: core::array::from_fn(|m| measured[m].noise_codes * measured[m].noise_codes * (4.0 / N as f32)),
            snr_db: 0.0,
            frequency_hz: entry.frequency_hz,
            tone: phase::Tone::Present,
            clipped: false,
            interferer: false,
        };
        let mut check = order::Check::of_calibrated();
        check.step(array, self.source(), &heard);
        match check.order() {
            Order::AsConfigured => Channels::NONE,
            Order::Swapped(a, b) => Channels::one(a).and(b),
            Order::Permuted(order) => Channels::which(|m| order.get(m) != Some(&m)),
            Order::Undecided => Channels::which(|_| true),
        }
    }

    fn measured(&self) -> [Measured; CHANNELS] {
        let (frames, heard) = (f32::from(self.frames.max(1)), f32::from(self.heard.max(1)));
        let samples = frames * N as f32;
        core::array::from_fn(|m| {
            let mean_rad = self.turned_rad[m] / heard;
            Measured {
                offset_codes: self.codes[m] as f32 / samples,
                clipped: f32::from(self.rails[m]) / samples,
                noise_codes: sqrt(self.variance_codes2[m] / frames),
                amplitude_codes: self.amplitude_codes[m] / heard,
                phase_sigma_rad: sqrt((self.turned_rad2[m] / heard - mean_rad * mean_rad).max(0.0)),
            }
        })
    }

    pub(super) fn report(&self, verdict: Verdict) -> Report {
        let entry = self.entry().unwrap_or(Entry { gain: [1.0; CHANNELS], ..Entry::default() });
        let measured = self.measured();
        let whole = |value: f32| libm::roundf(value) as i32;
        Report {
            exam: self.exam,
            verdict,
            frames: self.frames,
            frequency_hz: whole(entry.frequency_hz),
            snr_centi_db: if self.heard > 0 { whole(100.0 * self.snr_db / f32::from(self.heard)) } else { 0 },
            rate_off_ppm: whole(1e6 * self.rate_off()),
            residual_mdeg: whole(1e3 * DEG_PER_RAD * entry.residual_rad),
            channels: core::array::from_fn(|m| Reading {
                offset_centi_codes: whole(100.0 * measured[m].offset_codes),
                clipped_ppm: whole(1e6 * measured[m].clipped),
                noise_centi_codes: whole(100.0 * measured[m].noise_codes),
                noise_centi_dbfs: whole(100.0 * db(measured[m].noise_codes / FULL_SCALE_CODES)),
                amplitude_centi_codes: whole(100.0 * measured[m].amplitude_codes),
                gain_centi_db: whole(100.0 * db(entry.gain[m])),
                phase_mdeg: whole(1e3 * DEG_PER_RAD * entry.phase_rad[m]),
                phase_sigma_mdeg: whole(1e3 * DEG_PER_RAD * measured[m].phase_sigma_rad),
            }),
        }
    }
}

/// Measurements of a channel.
#[derive(Clone, Copy, Debug)]
struct Measured {
    offset_codes: f32,
    clipped: f32,
    noise_codes: f32,
    amplitude_codes: f32,
    phase_sigma_rad: f32,
}

/// A ratio of amplitudes in dB; zero gives the smallest value.
fn db(ratio: f32) -> f32 {
    20.0 * libm::log10f(ratio.max(1e-6))
}

fn ratio(db: f32) -> f32 {
    libm::powf(10.0, 0.05 * db)
}

/// Smallest first, by a network of five comparisons.
fn sorted([a, b, c, d]: [f32; CHANNELS]) -> [f32; CHANNELS] {
    let in_order = |a: f32, b: f32| if b < a { (b, a) } else { (a, b) };
    let ((a, b), (c, d)) = (in_order(a, b), in_order(c, d));
    let ((a, c), (b, d)) = (in_order(a, c), in_order(b, d));
    let (b, c) = in_order(b, c);
    [a, b, c, d]
}

/// The mean of the middle two.
fn middle(values: [f32; CHANNELS]) -> f32 {
    let [_, low, high, _] = sorted(values);
    0.5 * (low + high)
}

/// The channel that is worst.
fn farthest(away: [f32; CHANNELS]) -> Channels {
    let worst = (1..CHANNELS).fold(0, |worst, m| if away[m] > away[worst] { m } else { worst });
    Channels::one(worst)
}
