//! Seeking with one directional antenna that turns with the vehicle.
//!
//! The received power is averaged in angular bins as the antenna sweeps past them ([`bins`], eq. 1). At the end of
//! each rotation ([`turn`]) the paper takes the loudest bin as the direction of the source; ours is where the
//! antenna's known pattern fits best ([`pattern`]), between the bins and with a standard deviation. Each rotation is a
//! sighting like any other. Filters without a position, and proven properties of the greedy rule, are in the crate
//! `foxhound-papers`.
//!
//! Power is in dB: fading multiplies, so that its errors are additive and equal in every bin; the range is an offset
//! instead of a factor; a burst has the weight of one reading, not of a thousand. Receivers report dB already.
//!
//! Source (its equation numbers in this module): the paper on RF source seeking with a single-wing rotating micro air vehicle
//! and its directional antenna. Cost, counted on the host: about 400 instructions a reading; some 14 000 a rotation, and 7 000 to
//! 9 000 for what joins it to those before.

use crate::base::error::{ConfigError, check};
use crate::base::math::sqrt;
use crate::base::ownship::Ownship;
use crate::base::time::Instant;
use crate::base::units::wrap_pi;
use crate::doa::bearing::{Bearing, Flags, Quality};

pub mod bins;
pub mod pattern;
pub mod turn;

use bins::{BINS, Bins};
use pattern::{Fit, Pattern};
use turn::{Turn, Turned};

/// Significance above which a rotation has a direction: noise alone exceeds it in at most one of a thousand
/// rotations.
const SIGNIFICANT: f32 = 20.0;
/// The same for a shape other than the pattern's, which is more likely to occur by chance.
const ROUGH: f32 = 30.0;
/// A second maximum that stands out by this share of the whole range makes the first one ambiguous.
const SECOND_MAX: f32 = 0.3;
/// Bins without a reading, in a row, that are bridged: an eighth of a turn.
const GAP_MAX: usize = BINS / 8;
/// A larger power is not a valid reading.
const POWER_MAX_DB: f32 = 300.0;
/// A larger yaw is not a valid reading.
const YAW_MAX_RAD: f32 = 1e3;
/// Largest turn from reading to reading.
const LEAP_MAX_RAD: f32 = core::f32::consts::FRAC_PI_2;
/// Power of silence: lower readings, or no packet at all, are replaced by it.
const SILENCE_DB: f32 = -110.0;
/// A rotation that takes longer is discarded.
pub(crate) const ROTATION_MAX_S: f32 = 20.0;

/// Configuration of the seeking.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// The antenna's pattern.
    pub pattern: pattern::Config,
    /// `a` of eq. 1, a reading.
    pub memory: f32,
    /// Standard deviation of a bearing that no averaging removes: magnetometer, pattern, frame.
    pub sigma_min_rad: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { pattern: pattern::Config::default(), memory: 0.7, sigma_min_rad: 2.0 / 57.295_78 }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Seeker, ConfigError> {
        check("rotating.memory", self.memory, 0.0, 0.99)?;
        check("rotating.sigma_min_rad", self.sigma_min_rad, 1e-3, 1.0)?;
        let pattern = self.pattern.build()?;
        let log_memory = if self.memory > 0.0 { libm::logf(self.memory) } else { -100.0 };
        Ok(Seeker { config: *self, pattern, log_memory })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seeker {
    config: Config,
    pattern: Pattern,
    log_memory: f32,
}

/// State: the rotation so far, and the averages.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    turn: Turn,
    bins: Bins,
}

impl State {
    /// Without a measurement. All bits are zero.
    #[must_use]
    pub const fn new() -> Self {
        Self { turn: Turn::new(), bins: Bins::new() }
    }

    /// The averages.
    #[must_use]
    pub fn bins(&self) -> &Bins {
        &self.bins
    }
}

/// The result of a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// A direction was found.
    Rotation(Rotation),
    /// No direction is louder than the others by more than noise explains.
    NoSignal,
    /// Too few readings for this turn rate: too many bins in a row had none.
    Sparse,
    /// The antenna does not complete a turn in `ROTATION_MAX_S`, or its yaw jumps.
    NotTurning,
}

/// A direction from one rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Rotation {
    /// The middle of the rotation.
    pub time: Instant,
    /// Direction of the source from north, clockwise, (-pi, pi].
    pub bearing_ned_rad: f32,
    /// Standard deviation of this rotation's bearing.
    pub sigma_rad: f32,
    /// From the lowest to the highest value of the fitted pattern.
    pub contrast_db: f32,
    /// Whether a second maximum is too high to distinguish them.
    pub ambiguous: bool,
    /// Share of the averages that is left from earlier rotations: how strongly this bearing depends on the one
    /// before.
    pub retained: f32,
}

impl Rotation {
    /// Standard deviation for filters that assume independent rotations: errors with a correlation of `r` from one to
    /// the next average as slowly as independent ones of `sqrt((1 + r) / (1 - r))` times the size.
    #[must_use]
    pub fn independent_sigma_rad(&self) -> f32 {
        let retained = crate::base::units::between(self.retained, 0.0, 0.99);
        self.sigma_rad * sqrt((1.0 + retained) / (1.0 - retained))
    }

    /// This direction as a bearing in the body frame, at present: [`Ownship::bearing_ned_rad`] converts it back to
    /// the same direction from north, with the same depression of the source below the horizon.
    #[must_use]
    pub fn bearing(&self, ownship: &Ownship, depression_rad: f32) -> Bearing {
        let time = ownship.attitude_time;
        let [forward, right, _] = ownship.to_body(self.bearing_ned_rad - ownship.yaw_at(time), depression_rad);
        let sigma_rad = self.independent_sigma_rad();
        let useful = sigma_rad < core::f32::consts::FRAC_PI_2;
        // One antenna has neither closure nor coherence; a wavenumber of zero means that the elevation is unknown.
        let quality = Quality { snr_db: self.contrast_db, ..Quality::default() };
        let flags = if self.ambiguous { Flags::AMBIGUOUS } else { Flags::default() };
        Bearing {
            valid: useful && !self.ambiguous,
            azimuth_rad: wrap_pi(libm::atan2f(right, forward)),
            sigma_rad: if useful { sigma_rad } else { core::f32::consts::PI },
            ..Bearing::without(time, quality, flags)
        }
    }
}

impl Seeker {
    /// Takes a reading and the antenna's yaw at that time; returns the result of a rotation that ends with it.
    ///
    /// Readings that are NaN are ignored, as are those whose yaw is NaN.
    pub fn step(&self, state: &mut State, time: Instant, yaw_rad: f32, power_db: f32) -> Option<Outcome> {
        if !(libm::fabsf(yaw_rad) <= YAW_MAX_RAD) {
            return None;
        }
        if power_db <= POWER_MAX_DB {
            let power_db = if power_db > SILENCE_DB { power_db } else { SILENCE_DB };
            state.bins.add(yaw_rad, power_db, self.config.memory);
        }
        match state.turn.step(time, yaw_rad, LEAP_MAX_RAD, ROTATION_MAX_S) {
            Turned::Partly => None,
            Turned::TooSlow | Turned::Leapt => {
                state.bins = Bins::new();
                Some(Outcome::NotTurning)
            }
            Turned::Full(since) => {
                let outcome = self.evaluate(&state.bins, since, time);
                state.bins.turn_over();
                Some(outcome)
            }
        }
    }

    fn evaluate(&self, bins: &Bins, since: Instant, time: Instant) -> Outcome {
        let (average_db, filled, gap) = bridged(bins);
        if gap > GAP_MAX {
            return Outcome::Sparse;
        }
        let Some(fit) = self.pattern.fit(&average_db, filled).filter(is_signal) else { return Outcome::NoSignal };
        let ambiguous = fit.second > SECOND_MAX;
        // The fit between two maxima, where one pattern fits both of them least badly, is wrong.
        let direction_rad = if ambiguous { fit.hill_rad } else { fit.direction_rad };
        let least = self.config.sigma_min_rad;
        let readings_a_bin = f32::from(bins.readings()) / BINS as f32;
        Outcome::Rotation(Rotation {
            time: since.plus_micros(time.micros_since(since) / 2),
            // The fit counts from the middle of the first bin.
            bearing_ned_rad: wrap_pi(direction_rad + bins::middle_rad(0) + bins.ahead_rad()),
            sigma_rad: sqrt(fit.sigma_rad * fit.sigma_rad + least * least),
            contrast_db: fit.contrast_db,
            ambiguous,
            retained: libm::expf(self.log_memory * readings_a_bin),
        })
    }
}

/// Whether noise alone does not explain a rotation.
fn is_signal(fit: &Fit) -> bool {
    fit.significance > SIGNIFICANT || fit.second > SECOND_MAX && fit.roughness > ROUGH
}

/// The averages with straight lines over empty bins, the number of bins with a reading, and the longest row of empty
/// ones.
fn bridged(bins: &Bins) -> ([f32; BINS], usize, usize) {
    let mut average_db = [0.0; BINS];
    let first = bins.iter().enumerate().find_map(|(bin, average)| average.map(|average| (bin, average)));
    let Some((first, mut last_db)) = first else { return (average_db, 0, BINS) };
    let (mut filled, mut longest, mut gap) = (0, 0, 0);
    // Once around, from the bin after the first that has a reading to that bin itself.
    for (step, average) in bins.iter().skip(first + 1).chain(bins.iter().take(first + 1)).enumerate() {
        let Some(here_db) = average else {
            gap += 1;
            continue;
        };
        for back in 0..=gap {
            let bin = (first + 1 + step - back) % BINS;
            let share = back as f32 / (gap + 1) as f32;
            if let Some(bridged_db) = average_db.get_mut(bin) {
                *bridged_db = here_db + share * (last_db - here_db);
            }
        }
        (longest, last_db, gap, filled) = (longest.max(gap), here_db, 0, filled + 1);
    }
    (average_db, filled, longest)
}

#[cfg(test)]
mod tests;
