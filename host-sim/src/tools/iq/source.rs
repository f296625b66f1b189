//! One source in white noise, whatever it sends: from the covariance of its band to a bearing.
//!
//! With `n` antennas, `N` independent samples and the beam's maximum `P = a' R a`, the likeliest noise is
//! `v = (tr R - P / n) / (n - 1)` and the likeliest source `S = (P / n - v) / n`. The bearing's variance is the Cramer-Rao bound of
//! a Gaussian source, `v / (2 N S) (1 + v / (n S)) / G`, `G` the array's sensitivity ([`Peak::sensitivity`]).
//!
//! A source is there when the largest eigenvalue of the channels' coherence `R_ij / sqrt(R_ii R_jj)`, which knows nothing
//! of their gains, stands above what noise alone reaches (Johnstone 2001, Ann. Stat. 29: `(1 + sqrt(n / N))^2` and its
//! spread). When what is left beside the plane wave does as well, there is a second one: another emitter when the
//! covariance has a second large eigenvalue, a reflection of the same when it has not. Two that are near each other leave
//! nearly all of it along the derivative of the plane wave: the power there is also compared with that beside it, which
//! takes less to stand out (the ratio of two variances with `2 N` and `2 N (n - 2)` degrees of freedom).

use std::f32::consts::PI;

use foxhound_core::base::adc::ANTENNAS_MAX;
use foxhound_core::base::error::{ConfigError, check};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::beam::{Arrival, Beam, Covariance, Peak, Vector};
use foxhound_core::doa::bearing::{Bearing, Flags, Quality, SIGMA_USELESS_RAD};
use foxhound_core::signal::phase::Complex;

/// Steps of the power iteration for an eigenvalue.
const STEPS: usize = 16;
/// Another direction is told apart when it is less likely by this: the logarithm of how many times.
const APART: f32 = 5.0;
/// Amplitude that is left beside a plane wave by channels that are not quite alike, as a share of it: -30 dB.
const UNLIKE: f32 = 0.001;
/// Standard deviations of the logarithm of a ratio of variances that noise alone exceeds once in a thousand.
const SPLIT_SIGMAS: f32 = 3.09;
/// Half of the turn over which the derivative of a plane wave is taken.
const TURN_RAD: f32 = 0.01;
/// The plane wave holds at least this share of the strongest component. Less are exchanged channels, or such as are not sampled together, or
/// reflections nearly as strong.
const FIT_LEAST: f32 = 0.7;
/// What a second wave does to a bearing, rms.
const SECOND_SIGMA_RAD: f32 = 5.0 / 57.295_78;

/// What the estimation needs to know.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Source {
    /// Least sigma of a bearing.
    pub(super) floor_rad: f32,
}

impl Source {
    /// Checks the configuration.
    ///
    /// # Errors
    /// `sigma_floor` outside 0..=1 rad.
    pub(super) fn build(self) -> Result<Self, ConfigError> {
        check("sigma_floor", self.floor_rad, 0.0, 1.0)?;
        Ok(self)
    }

    /// The bearing that a covariance tells. Its weight is the number of independent samples in it; the frequency is passed on.
    pub(super) fn bearing(&self, beam: &Beam, covariance: &Covariance, frequency_hz: f32, time: Instant) -> Arrival {
        let quality = Quality { frequency_hz, ..Quality::default() };
        let mut bearing = Bearing::without(time, quality, Flags::NO_SIGNAL);
        if !covariance.trace().is_finite() {
            bearing.flags = bearing.flags.with(Flags::NOT_FINITE);
            return bearing.into();
        }
        // Only ratios count. Squared, sums of loud codes would be too large for a number.
        let covariance = &covariance.of_the_living().of_mean_one();
        let samples = covariance.weight();
        let (Some(peak), true) = (beam.find(covariance), samples >= 1.0) else { return bearing.into() };
        let antennas = peak.antennas as f32;
        let total = covariance.trace() / samples;
        let power = peak.share * total;
        let noise = ((total - power) / (antennas - 1.0)).max(1e-9 * total);
        let source = (power - noise) / antennas;
        let start = beam.toward(peak.azimuth_rad);
        // Of the coherence, whose mean is one: channels that are not equally loud are no source.
        let scale = coherence_scale(covariance);
        let scaled = |z: &Vector| {
            std::array::from_fn(|k| z.get(k).zip(scale.get(k)).map_or(Complex::default(), |(z, s)| z.scaled(*s)))
        };
        let alike = Dominant::of(|z| scaled(&covariance.times(&scaled(z))), &start);
        if alike.value < ceiling(antennas, samples) || !(source > 0.0) {
            return bearing.into();
        }
        let first = Dominant::of(|z| covariance.times(z), &start);
        // Share of the strongest component that the plane wave holds, whatever the channels' gains.
        let fit = covariance.power(&scaled(&start)) / (antennas * alike.value);

        let mut flags = Flags::default();
        for antenna in (0..beam.antennas()).filter(|antenna| !covariance.lives(*antenna)) {
            flags = flags.with(Flags::dead(antenna));
        }
        let ratio = noise / source;
        let variance = ratio / (2.0 * samples) * (1.0 + ratio / antennas) / peak.sensitivity.max(1e-12);
        let mut sigma_rad = sqrt(variance + self.floor_rad * self.floor_rad);
        let second = second(beam, covariance, &peak, &first, noise * samples);
        let is_alone = second.is_none();
        if let Some(second) = second {
            flags = flags.with(second);
            // What the strongest component holds beside the plane wave bends its phases by so much.
            let misfit = (1.0 - fit).max(0.0) / peak.sensitivity.max(1e-12);
            sigma_rad = sqrt(sigma_rad * sigma_rad + SECOND_SIGMA_RAD * SECOND_SIGMA_RAD + misfit);
        }
        let rivals = rivals(&peak, samples);
        let mirror_rad = peak.mirror_rad;
        // An array that has become a line by its dead antennas was not meant as one.
        let is_lame = mirror_rad.is_some() && peak.antennas < beam.antennas();
        let is_clear = rivals == 0 && !is_lame && sigma_rad < SIGMA_USELESS_RAD;
        if !is_clear || mirror_rad.is_some() {
            flags = flags.with(Flags::AMBIGUOUS);
        }
        bearing.valid = is_clear && (is_alone || fit >= FIT_LEAST);
        bearing.flags = flags;
        bearing.azimuth_rad = peak.azimuth_rad;
        bearing.sigma_rad = if sigma_rad < PI { sigma_rad } else { PI };
        bearing.quality.snr_db = -10.0 * libm::log10f(ratio);
        Arrival { bearing, mirror_rad, ambiguities: rivals.saturating_add(u8::from(mirror_rad.is_some())) }
    }
}

/// Whether so many independent samples can tell a source, however strong, from noise alone.
pub(super) fn can_tell(antennas: usize, samples: f32) -> bool {
    ceiling(antennas as f32, samples) < antennas as f32
}

/// One over the root of each antenna's power; zero of one that hears nothing.
fn coherence_scale(covariance: &Covariance) -> [f32; ANTENNAS_MAX] {
    let mut scale = [0.0; ANTENNAS_MAX];
    for (scale, power) in scale.iter_mut().zip(covariance.diagonal()) {
        *scale = if power > 0.0 { 1.0 / sqrt(power) } else { 0.0 };
    }
    scale
}

/// How large the largest eigenvalue of the covariance of noise alone is, over its mean, in one of a thousand.
fn ceiling(antennas: f32, samples: f32) -> f32 {
    let (n, m) = (sqrt(antennas), sqrt(samples));
    let spread = (n + m) * libm::cbrtf(1.0 / n + 1.0 / m);
    ((n + m) * (n + m) + spread) / samples
}

/// How many other directions are nearly as likely: by the likelihood of one source of unknown strength in noise of unknown
/// strength.
fn rivals(peak: &Peak, samples: f32) -> u8 {
    let antennas = peak.antennas as f32;
    let cost = |share: f32| {
        let share = share.max(1.0 / antennas).min(1.0 - 1e-6);
        libm::logf(share) + (antennas - 1.0) * libm::logf((1.0 - share) / (antennas - 1.0))
    };
    let best = cost(peak.share);
    let is_near = |share: &&f32| **share > 1.0 / antennas && samples * (cost(**share) - best) < APART;
    peak.rivals.iter().filter(is_near).count() as u8
}

/// What else there is: a flag, if anything.
fn second(beam: &Beam, covariance: &Covariance, peak: &Peak, first: &Dominant, noise: f32) -> Option<Flags> {
    let (antennas, samples) = (peak.antennas as f32, covariance.weight());
    if peak.antennas < 3 {
        return None;
    }
    let mut wave = beam.toward(peak.azimuth_rad);
    for (k, z) in wave.iter_mut().enumerate() {
        *z = if covariance.lives(k) { z.scaled(1.0 / sqrt(antennas)) } else { Complex::default() };
    }
    // Any direction that is not at right angles to the eigenvector.
    let start: Vector = std::array::from_fn(|k| Complex::at((k * k) as f32));
    let left = Dominant::of(|z| without(&covariance.times(&without(z, &wave)), &wave), &start);
    // The rest's own mean, less what stands out, is the noise.
    let rest = noise * (antennas - 1.0);
    let limit = |noise: f32| ceiling(antennas - 1.0, samples) * noise + UNLIKE * first.value;
    let beside = if antennas > 3.0 { (rest - left.value).max(0.0) / (antennas - 2.0) } else { noise };
    let is_left = left.value > limit(noise) || (antennas > 3.0 && left.value > 1.5 * limit(beside));
    let across = covariance.power(&across(beam, covariance, peak.azimuth_rad, &wave));
    let spread = libm::expf(SPLIT_SIGMAS * sqrt((1.0 + 1.0 / (antennas - 2.0)) / samples));
    let is_split = across > spread * (rest - across).max(0.0) / (antennas - 2.0) + UNLIKE * first.value;
    if !is_left && !is_split {
        return None;
    }
    let other = Dominant::of(|z| without(&covariance.times(&without(z, &first.vector)), &first.vector), &start);
    let is_emitter = other.value > 0.5 * left.value;
    Some(if is_emitter { Flags::INTERFERER } else { Flags::MULTIPATH })
}

/// How a plane wave, of length one, changes with its direction, less what lies along itself; of length one.
fn across(beam: &Beam, covariance: &Covariance, azimuth_rad: f32, wave: &Vector) -> Vector {
    let (behind, before) = (beam.toward(azimuth_rad + TURN_RAD), beam.toward(azimuth_rad - TURN_RAD));
    let change = |k: usize| match (behind.get(k), before.get(k)) {
        (Some(behind), Some(before)) if covariance.lives(k) => behind.plus(before.scaled(-1.0)),
        _ => Complex::default(),
    };
    let across = without(&std::array::from_fn(change), wave);
    let length = sqrt(across.iter().map(|z| z.norm_squared()).sum::<f32>());
    if length > 0.0 { across.map(|z| z.scaled(1.0 / length)) } else { Vector::default() }
}

/// A vector less its part along another of length one.
fn without(z: &Vector, along: &Vector) -> Vector {
    let part = z.iter().zip(along).fold(Complex::default(), |sum, (z, a)| sum.plus(z.times_conj(*a)));
    let mut rest = *z;
    for (z, a) in rest.iter_mut().zip(along) {
        let off = part.times(*a);
        *z = z.plus(off.scaled(-1.0));
    }
    rest
}

/// The largest eigenvalue of a matrix and its vector, of length one.
struct Dominant {
    value: f32,
    vector: Vector,
}

impl Dominant {
    fn of(times: impl Fn(&Vector) -> Vector, start: &Vector) -> Self {
        let mut vector = *start;
        let mut value = 0.0;
        for _ in 0..STEPS {
            let length = sqrt(vector.iter().map(|z| z.norm_squared()).sum::<f32>());
            if !(length > 0.0) || !length.is_finite() {
                return Self { value: 0.0, vector: Vector::default() };
            }
            for z in &mut vector {
                *z = z.scaled(1.0 / length);
            }
            let next = times(&vector);
            value = next.iter().zip(&vector).map(|(y, z)| y.times_conj(*z).re).sum();
            // The last one stays of length one.
            let before = vector;
            vector = next;
            if !vector.iter().any(|z| z.norm_squared() > 0.0) {
                return Self { value, vector: before };
            }
        }
        let length = sqrt(vector.iter().map(|z| z.norm_squared()).sum::<f32>());
        for z in &mut vector {
            *z = z.scaled(1.0 / length);
        }
        Self { value, vector }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::base::rng::Rng;
    use foxhound_core::doa::beam;
    use std::f32::consts::TAU;

    fn beam(antennas_m: &[[f32; 2]]) -> Beam {
        let mut all = [[0.0; 2]; ANTENNAS_MAX];
        all[..antennas_m.len()].copy_from_slice(antennas_m);
        beam::Config { wavelength_m: 1.0, antennas_m: all, count: antennas_m.len() }.build().unwrap()
    }

    fn ring(count: usize, radius_m: f32) -> Vec<[f32; 2]> {
        let at = |k: usize| (k as f32 * TAU / count as f32).sin_cos();
        (0..count).map(|k| [radius_m * at(k).1, radius_m * at(k).0]).collect()
    }

    /// Samples of sources in noise.
    fn heard(beam: &Beam, sources: &[(f32, f32, bool)], noise: f32, count: usize, rng: &mut Rng) -> Covariance {
        let mut covariance = Covariance::default();
        for _ in 0..count {
            let mut z = Vector::default();
            let mut sent = Complex::default();
            for (azimuth_rad, amplitude, is_own) in sources {
                if *is_own {
                    sent = Complex { re: rng.gaussian(), im: rng.gaussian() };
                }
                for (z, a) in z.iter_mut().zip(beam.toward(*azimuth_rad)) {
                    *z = z.plus(a.times(sent).scaled(*amplitude));
                }
            }
            for z in z.iter_mut().take(beam.antennas()) {
                *z = z.plus(Complex { re: noise * rng.gaussian(), im: noise * rng.gaussian() });
            }
            covariance.add(&z, 1.0);
        }
        covariance
    }

    #[test]
    fn one_source_is_clean_two_are_flagged_and_none_is_none() {
        let beam = beam(&ring(6, 0.45));
        let (source, mut rng) = (Source::default(), Rng::new(11, 0));
        let mut flags = |sources: &[(f32, f32, bool)]| {
            let covariance = heard(&beam, sources, 0.3, 256, &mut rng);
            source.bearing(&beam, &covariance, 0.0, Instant(0)).bearing.flags
        };
        let mut counts = [0; 4];
        for run in 0..300 {
            let azimuth_rad = run as f32 * 0.7;
            let wrong = [
                flags(&[(azimuth_rad, 1.0, true)]) != Flags::default(),
                !flags(&[(azimuth_rad, 1.0, true), (azimuth_rad + 2.0, 0.5, true)]).contains(Flags::INTERFERER),
                !flags(&[(azimuth_rad, 1.0, true), (azimuth_rad + 2.0, 0.5, false)]).contains(Flags::MULTIPATH),
                flags(&[]) != Flags::NO_SIGNAL,
            ];
            for (count, wrong) in counts.iter_mut().zip(wrong) {
                *count += i32::from(wrong);
            }
        }
        assert!(counts.iter().all(|count| *count <= 6), "{counts:?} of 300");
    }

    #[test]
    fn what_is_no_number_has_no_bearing() {
        let (beam, source) = (beam(&ring(4, 0.25)), Source::default());
        let mut covariance = Covariance::default();
        covariance.add(&[Complex { re: f32::NAN, im: 0.0 }; ANTENNAS_MAX], 1.0);
        let bearing = source.bearing(&beam, &covariance, 0.0, Instant(0)).bearing;
        assert!(!bearing.valid && bearing.flags.contains(Flags::NOT_FINITE) && bearing.sigma_rad > 3.0);
    }

    #[test]
    fn antennas_that_are_left_on_a_line_by_dead_ones_give_no_bearing() {
        let source = Source::default().build().unwrap();
        for (antennas_m, dead) in [(&ring(3, 0.25)[..], &[0][..]), (&ring(4, 0.25)[..], &[1, 2][..])] {
            let beam = beam(antennas_m);
            for degree in (-179_i32..=180).step_by(7) {
                let azimuth_rad = (degree as f32).to_radians();
                let mut covariance = Covariance::default();
                let mut rng = Rng::new(degree.unsigned_abs().into(), 3);
                for _ in 0..64 {
                    let mut z = beam.toward(azimuth_rad);
                    for (k, z) in z.iter_mut().enumerate() {
                        *z = Complex { re: z.re + 0.05 * rng.gaussian(), im: z.im + 0.05 * rng.gaussian() };
                        if k >= antennas_m.len() || dead.contains(&k) {
                            *z = Complex { re: 0.0, im: 0.0 };
                        }
                    }
                    covariance.add(&z, 1.0);
                }
                let arrival = source.bearing(&beam, &covariance, 0.0, Instant(0));
                let bearing = arrival.bearing;
                assert!(!bearing.valid && bearing.flags.contains(Flags::AMBIGUOUS), "{dead:?} {degree}: {bearing:?}");
            }
        }
    }

    #[test]
    fn noise_of_channels_that_are_not_equally_loud_is_no_source() {
        for (antennas, radius_m) in [(2, 0.2), (3, 0.15), (4, 0.28), (5, 0.4), (8, 0.5)] {
            let (beam, mut rng) = (beam(&ring(antennas, radius_m)), Rng::new(12, 0));
            // The first is louder by 2 dB, or has no antenna and hears half as much.
            for gain in [1.26, 0.71] {
                let found = |_: &i32| {
                    let mut covariance = Covariance::default();
                    for _ in 0..512 {
                        let mut z = Vector::default();
                        for (k, z) in z.iter_mut().enumerate().take(antennas) {
                            *z = Complex { re: rng.gaussian(), im: rng.gaussian() }.scaled(if k == 0 {
                                gain
                            } else {
                                1.0
                            });
                        }
                        covariance.add(&z, 1.0);
                    }
                    let bearing = Source::default().bearing(&beam, &covariance, 0.0, Instant(0)).bearing;
                    !bearing.flags.contains(Flags::NO_SIGNAL)
                };
                let count = (0..200).filter(found).count();
                assert!(count <= 2, "{antennas} antennas, {gain}: a source in {count} of 200");
            }
        }
    }

    #[test]
    fn loud_codes_are_as_good_as_others() {
        let (beam, mut rng) = (beam(&ring(5, 0.4)), Rng::new(13, 0));
        let loud = heard(&beam, &[(0.9, 1e9, true)], 1e8, 64, &mut rng);
        let bearing = Source::default().bearing(&beam, &loud, 0.0, Instant(0)).bearing;
        assert!(bearing.valid && bearing.flags == Flags::default(), "{bearing:?}");
        assert!((bearing.azimuth_rad - 0.9).abs() < 0.02, "{bearing:?}");
    }
}
