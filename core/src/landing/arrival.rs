//! Whether the vehicle is above the beacon, from the belief's fix of the last metres ([`near`]).
//!
//! It has arrived when it is near the fix, the fix's sigma is small, most bearings agree with it, and they have either been
//! steep or come from two sides. So a distant reflection or outlier cannot cause an arrival.
//!
//! [`near`]: crate::localize::source::near

use crate::base::error::{ConfigError, check};
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::localize::source::Estimate;
use crate::localize::source::near::{Fix, NEAR_M};

/// Share of the bearings that agree, for an arrival.
const AGREEMENT_MIN: f32 = 0.55;
/// Largest standard deviation of the fix for an arrival; and as a share of its depth, since bearings err by an angle.
const SIGMA_MAX_M: f32 = 0.6;
const SIGMA_SHARE: f32 = 0.1;
/// How much larger sigma may be at a maximum of the strength.
const MAXIMUM_SLACK: f32 = 1.5;
/// A vehicle that moves on by this much passes by.
const PASSES_M: f32 = 2.0;
/// How long it may be near before a search.
const AMBIGUOUS_S: f32 = 5.0;

/// Configuration of the arrival.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Horizontal distance from the fix that counts as arrived.
    pub arrive_m: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { arrive_m: 1.2 }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Arrival, ConfigError> {
        check("landing.arrival.arrive_m", self.arrive_m, 0.2, 5.0)?;
        Ok(Arrival { config: *self })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    config: Config,
}

/// What follows from the fix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// There is no fix, or it is not near.
    Far,
    /// It is near, not known well enough, and not for long yet.
    Near(Fix),
    /// It is near and known well enough, and the vehicle is not there yet.
    Known(Fix),
    /// It has been near for long and is not known well enough.
    Ambiguous(Fix),
    /// The vehicle is there.
    Arrived(Fix),
}

/// State of the arrival: how long the beacon has been near, and where that began.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    near_s: f32,
    near_at_ned_m: Horizontal,
}

impl State {
    /// The position has jumped: the stored one is shifted.
    pub fn shift(&mut self, by: Horizontal) {
        self.near_at_ned_m = self.near_at_ned_m.plus(by);
    }

    /// Whether the beacon has been near for long.
    #[must_use]
    pub fn is_long_near(&self) -> bool {
        self.near_s > AMBIGUOUS_S
    }

    /// Restarts the time for which the beacon is near.
    pub fn have_patience(&mut self) {
        self.near_s = 0.0;
    }
}

impl Arrival {
    /// What follows from the fix and the bank's estimate, at the vehicle's position.
    pub fn judge(
        &self,
        state: &mut State,
        here: Horizontal,
        fix: Option<Fix>,
        estimate: Option<&Estimate>,
        tick_s: f32,
    ) -> Verdict {
        let Some(fix) = fix.filter(|fix| fix.distance_m < NEAR_M) else {
            state.near_s = 0.0;
            return Verdict::Far;
        };
        // A vehicle that passes by is not near for long; nor is it near a beacon at a flat angle with a known depth.
        let has_left = here.minus(state.near_at_ned_m).norm_squared() > PASSES_M * PASSES_M;
        if has_left || fix.is_flat {
            (state.near_s, state.near_at_ned_m) = (0.0, here);
        }
        state.near_s += tick_s;
        let by_depth_m = SIGMA_SHARE * fix.depth_m;
        let sigma_max_m = if by_depth_m > SIGMA_MAX_M { by_depth_m } else { SIGMA_MAX_M }
            * if fix.is_loudest { MAXIMUM_SLACK } else { 1.0 };
        let is_known = fix.is_heard
            && fix.sigma_m < sigma_max_m
            && fix.agreement > AGREEMENT_MIN
            && fix.heard_s > 1.0
            && fix.is_surrounded
            && !estimate.is_some_and(|estimate| contradicts(estimate, &fix, here, self.config.arrive_m));
        if is_known && fix.distance_m < self.config.arrive_m {
            Verdict::Arrived(fix)
        } else if is_known {
            Verdict::Known(fix)
        } else if state.is_long_near() {
            Verdict::Ambiguous(fix)
        } else {
            Verdict::Near(fix)
        }
    }
}

/// Whether the bank's filter puts the source elsewhere.
fn contradicts(estimate: &Estimate, fix: &Fix, here: Horizontal, arrive_m: f32) -> bool {
    let [nn, _, ee] = estimate.covariance_m2;
    let apart_m = estimate.place_ned_m.minus(fix.place_ned_m.horizontal()).norm();
    let sigma_m = sqrt(nn + ee + fix.sigma_m * fix.sigma_m);
    let range_m = estimate.place_ned_m.minus(here).norm();
    estimate.range_sigma_ratio < 0.3 && range_m > 2.0 * arrive_m && apart_m > 1.0 + 3.0 * sigma_m
}
