//! Angle of arrival from one set of phasors.
//!
//! A plane wave from the direction `u` (body, forward-right, `|u| = cos(elevation)`) reaches antenna `m` at position `p_m`
//! with the phase `phi_0 + k u . p_m`: the antenna nearer the source leads. (Eq. 48 of the main paper as printed is a
//! converging wave, which mirrors every bearing; the outgoing one is meant.)
//!
//! - [`Estimator::CrossSpectrum`], the default: the cross-spectra of the two pairs along each axis of the square give
//!   `u` directly and over the whole circle, `arg(z1 z4* + z2 z3*)` and so on; then one weighted least-squares step
//!   over the phases of all working channels, which also gives the covariance and the residual. It reaches the
//!   Cramer-Rao bound `sigma = lambda / (2 pi s cos(el) sqrt(N SNR))`. Any array of three or more antennas off one
//!   line works, so a dead channel only costs precision.
//! - The main paper's estimators, the baselines, are in the crate `foxhound-papers`, literal and repaired.
//!   [`Estimator::PaperSquare`] is its Algorithm 1 (eq. 2 and 30, half-plane by `theta1 > theta2`) with its flaws:
//!   the half-plane rule is wrong for half of all directions, the cotangent is singular ahead, the arcsine leaves its
//!   domain to the sides, elevation biases it.
//!
//! Cost: about 2 000 instructions.

use core::f32::consts::FRAC_PI_2;

use crate::base::adc::CHANNELS;
use crate::base::error::{ConfigError, Why, check};
use crate::base::math::sqrt;
use crate::base::time::Instant;
use crate::base::units::{asin, wrap_pi};
use crate::doa::array::Array;
use crate::signal::phase::{Complex, Phasors, Tone};

/// Chi-square with one degree of freedom that a clean frame exceeds once in a thousand.
const CLOSURE_LIMIT: f32 = 10.83;
/// The same beside another line, for the whole of [`MULTIPATH_SIGMA_RAD`]: no clean frame exceeds it. The frame is
/// flagged already, and smaller excesses widen sigma in proportion.
const CLOSURE_SURE: f32 = 30.0;
/// Allowed difference of the channels' gains: 1.3 dB. More means a reflection, or a missing calibration.
const GAIN_TOLERANCE: f32 = 0.16;
/// Effect of a reflection that shows in the closure on a bearing, rms: -10 dB gives 5 deg.
const MULTIPATH_SIGMA_RAD: f32 = 5.0 / 57.295_78;
/// A bearing with a larger sigma is useless.
pub const SIGMA_USELESS_RAD: f32 = 0.6;
/// Nearest source whose curved wavefront is not taken for a reflection.
const NEAR_FIELD_M: f32 = 2.0;
/// A wavefront counts as curved when its curvature is this many standard deviations from zero.
const CURVED_SIGMAS: f32 = 3.0;
/// Phase error of every channel, such as by the curvature of the wavefront at 10 m: below it, a channel with less
/// noise than another gets no more weight.
const MODEL_SIGMA_RAD: f32 = 0.005;
/// A channel this much below the strongest, in power, is dead.
const DEAD_POWER_RATIO: f32 = 0.01;

/// Which estimator is used. [`BearingEstimator`] is the first of them; the others are baselines, in the crate
/// `foxhound-papers`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Estimator {
    /// Ours: cross-spectra, then weighted least squares.
    #[default]
    CrossSpectrum,
    /// Algorithm 1 of the main paper, literally (eq. 29-30): square arrays only.
    PaperSquare,
    /// The same with the half-plane by `|theta1| > |theta2|`: square arrays only.
    PaperRepaired,
    /// The same with the half-plane by cross-correlation: square arrays only.
    PaperCorrelated,
    /// The arcsine of A1A2 (eq. 2), its side by cross-correlation.
    Pair,
    /// The crossing of the directions of A1A2 and A3A4 (eq. 16-17).
    TwoArray,
    /// The crossing of the directions of two pairs that share an antenna (eq. 51).
    ThreeAntenna,
    /// The least-squares crossing of the directions of all neighbours (appendix C).
    NArray,
}

/// Configuration of the estimation.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// The estimator.
    pub estimator: Estimator,
    /// Phase error left in each channel after calibration, rms; added to that from noise.
    pub channel_sigma_rad: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { estimator: Estimator::CrossSpectrum, channel_sigma_rad: 0.0 }
    }
}

impl Config {
    /// Checks the configuration and joins it with the array.
    ///
    /// # Errors
    /// `bearing.channel_sigma_rad` outside 0..=1; `bearing.estimator` when it is one of the paper's, the value being its number.
    pub fn build(&self, array: Array) -> Result<BearingEstimator, ConfigError> {
        check("bearing.channel_sigma_rad", self.channel_sigma_rad, 0.0, 1.0)?;
        if self.estimator != Estimator::CrossSpectrum {
            let why = Why::Inconsistent("the paper's estimators are not part of this program");
            return Err(ConfigError { field: "bearing.estimator", value: f32::from(self.estimator as u8), why });
        }
        Ok(BearingEstimator { array, config: *self })
    }
}

/// Flags of a bearing, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Flags(pub u16);

impl Flags {
    /// Samples at a rail.
    pub const CLIP: Self = Self(1);
    /// Channel 1 of 4 is dead; the others follow in the next three bits.
    pub const DEAD_1: Self = Self(1 << 1);
    /// Another line in the spectrum.
    pub const INTERFERER: Self = Self(1 << 5);
    /// The phases do not fit one plane wave: a reflection, or a wrong calibration.
    pub const MULTIPATH: Self = Self(1 << 6);
    /// The direction is ambiguous: the source is overhead, or buried in noise.
    pub const AMBIGUOUS: Self = Self(1 << 7);
    /// A calibration is required and missing.
    pub const UNCALIBRATED: Self = Self(1 << 8);
    /// No tone above the noise.
    pub const NO_SIGNAL: Self = Self(1 << 9);

    /// Antenna 5 of more than four is dead; the others follow in the next three bits.
    pub const DEAD_5: Self = Self(1 << 10);
    /// A sample is not a finite number.
    pub const NOT_FINITE: Self = Self(1 << 14);
    /// Of a radio whose errors are those of its antennas and its site, alike from bearing to bearing.
    pub const ALIKE: Self = Self(1 << 15);

    /// The flag of a dead channel, 0..8.
    #[must_use]
    pub fn dead(channel: usize) -> Self {
        if channel < CHANNELS { Self(Self::DEAD_1.0 << channel) } else { Self(Self::DEAD_5.0 << (channel - CHANNELS)) }
    }

    /// Whether all of `other`'s bits are set.
    #[must_use]
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Their names.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        let names = [
            (Self::CLIP, "clip"),
            (Self::dead(0), "dead_1"),
            (Self::dead(1), "dead_2"),
            (Self::dead(2), "dead_3"),
            (Self::dead(3), "dead_4"),
            (Self::dead(4), "dead_5"),
            (Self::dead(5), "dead_6"),
            (Self::dead(6), "dead_7"),
            (Self::dead(7), "dead_8"),
            (Self::INTERFERER, "interferer"),
            (Self::MULTIPATH, "multipath"),
            (Self::AMBIGUOUS, "ambiguous"),
            (Self::UNCALIBRATED, "uncalibrated"),
            (Self::NO_SIGNAL, "no_signal"),
            (Self::NOT_FINITE, "not_finite"),
        ];
        names.into_iter().filter(move |(flag, _)| self.contains(*flag)).map(|(_, name)| name)
    }

    /// The flags of both.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// Quality of a bearing, beyond its sigma.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Quality {
    /// Per-sample signal-to-noise ratio, mean over the channels.
    pub snr_db: f32,
    /// Frequency of the tone.
    pub frequency_hz: f32,
    /// Squared residual of the wavefront fit over its variance; chi-square with one degree of freedom on a clean frame
    /// of four channels, 0 with three.
    pub closure_chi2: f32,
    /// Horizontal wavenumber over the free-space one: the cosine of the elevation, 1 for a source at our height.
    pub wavenumber: f32,
    /// Forward-backward coherence, 0..=1: `|sum z_m z_(m+2)| / sum |z_m|^2` over the antennas of the square, opposite
    /// ones multiplied. A plane wave rotates them by opposite angles and has 1; two waves differ, by phase or by
    /// amplitude. Off the square the `z` have the plane wave removed, which on the square cancels. `None` with a dead
    /// channel.
    pub coherence: Option<f32>,
    /// An estimate of the range of a near source, from the curvature of its wavefront: `None` when the curvature is
    /// less than three standard deviations from zero, as for every far source and along the axes of the square, and
    /// without a required calibration.
    ///
    /// A reflection bends the wavefront as well. Below 2 m, where the two cannot be distinguished, the bearing is
    /// flagged [`Flags::MULTIPATH`]; a range below a wavelength is taken for a reflection. The standard deviation of
    /// `1 / R` is that of the closure over the bend: at 40 dB, N = 256, 868 MHz and 5 m, 4 % of the range on a
    /// diagonal.
    pub range_hint_m: Option<f32>,
}

/// An angle of arrival in the body frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Bearing {
    /// The middle of the block that it was measured in.
    pub time: Instant,
    /// Whether it is valid.
    pub valid: bool,
    /// Azimuth from the nose, clockwise positive, (-pi, pi].
    pub azimuth_rad: f32,
    /// Standard deviation of the azimuth, > 0, at most pi.
    pub sigma_rad: f32,
    /// Magnitude of the elevation (a flat array cannot tell up from down), 0..pi/2.
    pub elevation_rad: f32,
    /// Standard deviation of the elevation; large near the horizon, where the array is blind to it.
    pub elevation_sigma_rad: f32,
    /// Quality fields.
    pub quality: Quality,
    /// Flags.
    pub flags: Flags,
}

impl Bearing {
    /// The part of the standard deviation that is alike from bearing to bearing: by other paths of the wave, or all of it.
    #[must_use]
    pub fn alike_rad(&self) -> f32 {
        if self.flags.contains(Flags::ALIKE) {
            return self.sigma_rad;
        }
        match self.flags.contains(Flags::MULTIPATH) {
            true if self.sigma_rad > MULTIPATH_SIGMA_RAD => MULTIPATH_SIGMA_RAD,
            true => self.sigma_rad,
            false => 0.0,
        }
    }

    /// A bearing without a direction.
    #[must_use]
    pub const fn without(time: Instant, quality: Quality, flags: Flags) -> Self {
        Self {
            time,
            valid: false,
            azimuth_rad: 0.0,
            sigma_rad: core::f32::consts::PI,
            elevation_rad: 0.0,
            elevation_sigma_rad: FRAC_PI_2,
            quality,
            flags,
        }
    }
}

/// The result of another estimator for a set of phasors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Azimuth from the nose, clockwise positive; `None` without one.
    pub azimuth_rad: Option<f32>,
    /// Whether it is valid.
    pub is_usable: bool,
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BearingEstimator {
    array: Array,
    config: Config,
}

/// A symmetric 2 x 2 matrix `[[a, b], [b, c]]`.
#[derive(Clone, Copy, Default)]
struct Symmetric {
    a: f32,
    b: f32,
    c: f32,
}

impl Symmetric {
    /// The inverse; `None` if it is singular.
    fn inverse(self) -> Option<Self> {
        let determinant = self.a * self.c - self.b * self.b;
        let scale = self.a + self.c;
        if !(determinant > 1e-6 * scale * scale) {
            return None;
        }
        Some(Self { a: self.c / determinant, b: -self.b / determinant, c: self.a / determinant })
    }

    /// Adds `w v v'`.
    fn add(&mut self, w: f32, x: f32, y: f32) {
        self.a += w * x * x;
        self.b += w * x * y;
        self.c += w * y * y;
    }

    /// `O M O`, with another symmetric matrix on both sides.
    fn between(self, o: Self) -> Self {
        let row = |x: f32, y: f32| [self.a * x + self.b * y, self.b * x + self.c * y];
        let (left, right) = (row(o.a, o.b), row(o.b, o.c));
        Self { a: o.a * left[0] + o.b * left[1], b: o.b * left[0] + o.c * left[1], c: o.b * right[0] + o.c * right[1] }
    }

    /// `v' M v`.
    fn quadratic(self, v: [f32; 2]) -> f32 {
        self.a * v[0] * v[0] + 2.0 * self.b * v[0] * v[1] + self.c * v[1] * v[1]
    }
}

/// Result of the wavefront fit: direction `u`, its covariance, the remaining phases.
struct Wavefront {
    u: [f32; 2],
    covariance: Symmetric,
    residual: Option<Residual>,
    coherence: Option<f32>,
}

/// The one residual of a plane wave in four phases.
///
/// A source at the range `R` delays an antenna that lies `q` off its line of sight by a further `q^2 / 2R`, with
/// `q^2 = |p|^2 - (u . p)^2`. On the square this does not turn the bearing, but 5 m off it shows here, by
/// `k s^2 cos^2(el) sin(2 azimuth) / 2R`.
#[derive(Clone, Copy)]
struct Residual {
    closure_rad: f32,
    variance: f32,
    /// Contribution of a source at 1 m to the closure; inversely proportional to the range.
    bend_rad_m: f32,
}

impl Residual {
    /// The squared closure over its variance, minus the part explained by the curvature of a near wavefront, which
    /// may be anything from zero to that of [`NEAR_FIELD_M`].
    fn chi2(self) -> f32 {
        let (closure, near) = (self.closure_rad, self.bend_rad_m / NEAR_FIELD_M);
        // The part of the bend with the closure's sign, up to that of the nearest source.
        let explained = if closure * near <= 0.0 {
            0.0
        } else if libm::fabsf(closure) < libm::fabsf(near) {
            closure
        } else {
            near
        };
        (closure - explained) * (closure - explained) / self.variance
    }

    /// The range whose curvature explains the closure, if that is [`CURVED_SIGMAS`] from zero and of the right sign.
    fn range_m(self) -> Option<f32> {
        let curved = self.closure_rad * self.closure_rad > CURVED_SIGMAS * CURVED_SIGMAS * self.variance;
        (curved && self.closure_rad * self.bend_rad_m > 0.0).then(|| self.bend_rad_m / self.closure_rad)
    }
}

impl BearingEstimator {
    /// The array of this estimator.
    #[must_use]
    pub fn array(&self) -> &Array {
        &self.array
    }

    /// The bearing for a set of phasors; never NaN, `valid` only when it may be used.
    #[must_use]
    pub fn estimate(&self, phasors: &Phasors) -> Bearing {
        self.tuned(phasors).as_ref().unwrap_or(self).find_here(phasors, |_, _, _| None)
    }

    /// The same with the azimuth of another estimator. It gets the array, the phasors corrected for their channels,
    /// and which channels work, and is called if there is a wavefront; standard deviations, quality and flags are the
    /// wavefront's.
    #[must_use]
    pub fn find_with(
        &self,
        phasors: &Phasors,
        estimate: impl FnOnce(&Array, &[Complex; CHANNELS], [bool; CHANNELS]) -> Direction,
    ) -> Bearing {
        let estimate = |array: &Array, z: &[Complex; CHANNELS], living| Some(estimate(array, z, living));
        self.tuned(phasors).as_ref().unwrap_or(self).find_here(phasors, estimate)
    }

    fn find_here(
        &self,
        phasors: &Phasors,
        estimate: impl FnOnce(&Array, &[Complex; CHANNELS], [bool; CHANNELS]) -> Option<Direction>,
    ) -> Bearing {
        let mut flags = Flags::default();
        if phasors.clipped {
            flags = flags.with(Flags::CLIP);
        }
        if phasors.interferer {
            flags = flags.with(Flags::INTERFERER);
        }
        if self.array.is_uncalibrated() {
            flags = flags.with(Flags::UNCALIBRATED);
        }
        let quality = Quality { snr_db: phasors.snr_db, frequency_hz: phasors.frequency_hz, ..Quality::default() };
        let silent = Bearing::without(phasors.time, quality, flags);
        if phasors.tone == Tone::Absent {
            return Bearing { flags: flags.with(Flags::NO_SIGNAL), ..silent };
        }

        let z = self.array.correct(&phasors.z);
        let variances = self.variances(&z, phasors);
        for (m, variance) in variances.iter().enumerate() {
            if variance.is_none() {
                flags = flags.with(Flags::dead(m));
            }
        }
        let Some(fit) = self.wavefront(&z, &variances) else {
            return Bearing { flags: flags.with(Flags::AMBIGUOUS), ..silent };
        };

        let wavenumber = sqrt(fit.u[0] * fit.u[0] + fit.u[1] * fit.u[1]);
        // Overhead the direction of u is noise, and any is as good.
        let (length, along) = if wavenumber > 1e-3 {
            (wavenumber, [fit.u[0] / wavenumber, fit.u[1] / wavenumber])
        } else {
            (1e-3, [1.0, 0.0])
        };
        let across = [-along[1], along[0]];
        let mut sigma_rad = sqrt(fit.covariance.quadratic(across)) / length;
        let wavenumber_sigma = sqrt(fit.covariance.quadratic(along));

        // A wavenumber above that of free space is as impossible as a residual that does not close.
        let chi2 = fit.residual.map_or(0.0, Residual::chi2);
        let impossible = wavenumber > 1.03 + 4.0 * wavenumber_sigma;
        let sure = if phasors.interferer { CLOSURE_SURE } else { CLOSURE_LIMIT };
        if chi2 > sure || impossible || self.is_uneven(&z, phasors) {
            flags = flags.with(Flags::MULTIPATH);
            sigma_rad = sqrt(sigma_rad * sigma_rad + MULTIPATH_SIGMA_RAD * MULTIPATH_SIGMA_RAD);
        } else if chi2 > CLOSURE_LIMIT {
            flags = flags.with(Flags::MULTIPATH);
            sigma_rad *= sqrt(chi2 / CLOSURE_LIMIT);
        }
        // A variance that is NaN means no information.
        let sigma_rad = if sigma_rad.is_finite() { sigma_rad } else { core::f32::consts::PI };
        let sigma_rad = sigma_rad.clamp(1e-6, core::f32::consts::PI);
        if sigma_rad > SIGMA_USELESS_RAD {
            flags = flags.with(Flags::AMBIGUOUS);
        }

        let azimuth_rad = match estimate(&self.array, &z, variances.map(|variance| variance.is_some())) {
            None => libm::atan2f(fit.u[1], fit.u[0]),
            Some(direction) => {
                if !direction.is_usable {
                    flags = flags.with(Flags::AMBIGUOUS);
                }
                let Some(azimuth_rad) = direction.azimuth_rad else { return Bearing { flags, ..silent } };
                azimuth_rad
            }
        };
        let (elevation_rad, elevation_sigma_rad) = elevation(wavenumber, wavenumber_sigma);
        let useless = Flags(Flags::AMBIGUOUS.0 | Flags::UNCALIBRATED.0);
        Bearing {
            valid: flags.0 & useless.0 == 0,
            azimuth_rad: wrap_pi(azimuth_rad),
            sigma_rad,
            elevation_rad,
            elevation_sigma_rad,
            quality: Quality {
                closure_chi2: chi2,
                wavenumber,
                coherence: fit.coherence,
                range_hint_m: fit.residual.and_then(|residual| self.range_hint_m(residual)),
                ..silent.quality
            },
            flags,
            ..silent
        }
    }

    /// The range from a residual, unless the channels are not calibrated or the range is too short.
    fn range_hint_m(&self, residual: Residual) -> Option<f32> {
        let far_enough = |range_m: &f32| *range_m * self.array.wavenumber > core::f32::consts::TAU;
        residual.range_m().filter(far_enough).filter(|_| !self.array.is_uncalibrated())
    }

    /// Whether the amplitudes of four working channels differ by more than noise and [`GAIN_TOLERANCE`] explain: a
    /// plane wave is equally strong everywhere, two waves make fringes.
    fn is_uneven(&self, z: &[Complex; CHANNELS], phasors: &Phasors) -> bool {
        let (mut least, mut most, mut noise) = (f32::MAX, 0.0_f32, 0.0_f32);
        for (m, channel) in z.iter().enumerate() {
            let power = channel.norm_squared();
            least = if power < least { power } else { least };
            most = if power > most { power } else { most };
            let own = phasors.noise[m] * self.array.correction_power(m);
            noise = if own > noise { own } else { noise };
        }
        if least < DEAD_POWER_RATIO * most || least < 2.0 * noise {
            return false;
        }
        sqrt(most / least) > 1.0 + GAIN_TOLERANCE + 4.0 * sqrt(noise / least)
    }

    /// This estimator with the channels corrected for the tone's frequency, if a calibration depends on it.
    fn tuned(&self, phasors: &Phasors) -> Option<Self> {
        let depends = phasors.tone == Tone::Present && self.array.depends_on_frequency();
        depends.then(|| Self { array: self.array.at(phasors.frequency_hz), config: self.config })
    }

    /// The phase variance of each channel; `None` for a dead one.
    fn variances(&self, z: &[Complex; CHANNELS], phasors: &Phasors) -> [Option<f32>; CHANNELS] {
        let powers = z.map(Complex::norm_squared);
        let strongest = powers.iter().fold(0.0_f32, |a, b| if *b > a { *b } else { a });
        let residual = self.array.residual_rad();
        let extra = self.config.channel_sigma_rad * self.config.channel_sigma_rad + residual * residual;
        core::array::from_fn(|m| {
            let noise = phasors.noise[m] * self.array.correction_power(m);
            let lives = powers[m] > DEAD_POWER_RATIO * strongest && powers[m] > 2.0 * noise;
            // Half of the noise is in the direction that turns the phase.
            lives.then(|| 0.5 * noise / powers[m] + extra + 1e-12)
        })
    }

    /// Fits one plane wave to the phases; `None` when fewer than three channels work or the fit is singular.
    fn wavefront(&self, z: &[Complex; CHANNELS], variances: &[Option<f32>; CHANNELS]) -> Option<Wavefront> {
        let weights = &variances.map(|v| v.map_or(0.0, |v| 1.0 / (v + MODEL_SIGMA_RAD * MODEL_SIGMA_RAD)));
        let mut u = self.cross_spectrum(z, weights)?;
        let p = &self.array.steering;

        // One Gauss-Newton step from there: exact but for the wrapping, which the start has resolved.
        let rotated: [Complex; CHANNELS] =
            core::array::from_fn(|m| z[m].times_conj(Complex::at(u[0] * p[m][0] + u[1] * p[m][1])));
        let common = rotated.iter().zip(weights).fold(Complex::default(), |sum, (y, w)| {
            let magnitude = sqrt(y.norm_squared());
            let scale = if magnitude > 0.0 { w / magnitude } else { 0.0 };
            sum.plus(y.scaled(scale))
        });
        let phase: [f32; CHANNELS] = core::array::from_fn(|m| rotated[m].times_conj(common).arg());

        let total: f32 = weights.iter().sum();
        let mean =
            |value: &dyn Fn(usize) -> f32| weights.iter().enumerate().map(|(m, w)| w * value(m)).sum::<f32>() / total;
        let (x0, y0, phase0) = (mean(&|m| p[m][0]), mean(&|m| p[m][1]), mean(&|m| phase[m]));
        let mut normal = Symmetric::default();
        let mut spread = Symmetric::default();
        let mut right = [0.0_f32; 2];
        for m in 0..CHANNELS {
            let (x, y) = (p[m][0] - x0, p[m][1] - y0);
            normal.add(weights[m], x, y);
            // The effect of noise on a fit whose weights are not exactly its inverse variances.
            spread.add(weights[m] * weights[m] * variances[m].unwrap_or(0.0), x, y);
            right[0] += weights[m] * x * (phase[m] - phase0);
            right[1] += weights[m] * y * (phase[m] - phase0);
        }
        let inverse = normal.inverse()?;
        u[0] += inverse.a * right[0] + inverse.b * right[1];
        u[1] += inverse.b * right[0] + inverse.c * right[1];
        let covariance = spread.between(inverse);
        let residual = self.residual(&u, &phase, variances);
        let coherence = if weights.iter().all(|w| *w > 0.0) { coherence(&rotated) } else { None };
        (u[0].is_finite() && u[1].is_finite()).then_some(Wavefront { u, covariance, residual, coherence })
    }

    /// The residual of the fit; `None` with a dead channel.
    fn residual(&self, u: &[f32; 2], phase: &[f32; CHANNELS], variances: &[Option<f32>; CHANNELS]) -> Option<Residual> {
        let p = &self.array.steering;
        let (mut closure_rad, mut bend, mut variance) = (0.0_f32, 0.0_f32, 0.0_f32);
        for (m, c) in self.array.closure.iter().enumerate() {
            let along = u[0] * p[m][0] + u[1] * p[m][1];
            closure_rad += c * phase[m];
            bend += c * (p[m][0] * p[m][0] + p[m][1] * p[m][1] - along * along);
            variance += c * c * variances[m]?;
        }
        // Positions are multiplied by the wavenumber; one factor of it makes a phase.
        Some(Residual { closure_rad, variance, bend_rad_m: -0.5 * bend / self.array.wavenumber })
    }

    /// The direction from the cross-spectra of neighbours around the array.
    ///
    /// On the square this is `cx = z1 z4* + z2 z3*`, `cy = z1 z2* + z4 z3*`: opposite sides, which are parallel,
    /// share one sum, so that a weak side has little weight. Pairs with a dead channel are left out.
    fn cross_spectrum(&self, z: &[Complex; CHANNELS], weights: &[f32; CHANNELS]) -> Option<[f32; 2]> {
        let p = &self.array.steering;
        let living = |m: usize| weights[m] > 0.0;
        let pair = |a: usize, b: usize| {
            let d = [p[a][0] - p[b][0], p[a][1] - p[b][1]];
            (living(a) && living(b)).then(|| (z[a].times_conj(z[b]), d))
        };
        let opposite = |first: Option<(Complex, [f32; 2])>, second: Option<(Complex, [f32; 2])>| match (first, second) {
            (Some((c1, d1)), Some((c2, d2))) => {
                let difference = (d1[0] - d2[0]) * (d1[0] - d2[0]) + (d1[1] - d2[1]) * (d1[1] - d2[1]);
                if difference < 1e-4 * (d1[0] * d1[0] + d1[1] * d1[1]) {
                    Some((c1.plus(c2), d1))
                } else {
                    Some((c1, d1))
                }
            }
            (one, other) => one.or(other),
        };
        let (c1, d1) = opposite(pair(0, 3), pair(1, 2))?;
        let (c2, d2) = opposite(pair(0, 1), pair(3, 2))?;
        let (phase1, phase2) = (c1.arg(), c2.arg());
        let determinant = d1[0] * d2[1] - d1[1] * d2[0];
        if !(determinant * determinant > 1e-9) {
            return None;
        }
        Some([(phase1 * d2[1] - phase2 * d1[1]) / determinant, (phase2 * d1[0] - phase1 * d2[0]) / determinant])
    }
}

/// Forward-backward coherence of phasors with the plane wave removed: see [`Quality::coherence`].
fn coherence(y: &[Complex; CHANNELS]) -> Option<f32> {
    let opposite = |a: usize, b: usize| y[a].times(y[b]);
    let power = y.iter().fold(0.0, |sum, y| sum + y.norm_squared());
    let gamma = 2.0 * sqrt(opposite(0, 2).plus(opposite(1, 3)).norm_squared()) / power;
    // Rounding may exceed 1. NaN gives `None`.
    (gamma >= 0.0).then_some(gamma.min(1.0))
}

/// Elevation magnitude and its sigma from the wavenumber, which is its cosine.
fn elevation(wavenumber: f32, wavenumber_sigma: f32) -> (f32, f32) {
    let cosine = wavenumber.clamp(0.0, 1.0);
    let sine = sqrt(1.0 - cosine * cosine);
    // At the horizon the cosine is flat: an error of sigma there is an elevation of sqrt(2 sigma).
    let blind = sqrt(2.0 * wavenumber_sigma);
    let slope = if sine > blind { sine } else { blind };
    let sigma = if slope > 0.0 { wavenumber_sigma / slope } else { 0.0 };
    (FRAC_PI_2 - asin(cosine), sigma.clamp(1e-6, FRAC_PI_2))
}

#[cfg(test)]
mod tests;
