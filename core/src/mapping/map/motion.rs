//! Whether a pillar moves, and how fast: an alpha-beta filter with a memory that grows from scan to scan.
//!
//! With `k` evenly spaced scans so far the gains `alpha = 2 (2 k - 1) / (k (k + 1))`, `beta = 6 / (k (k + 1))` make the
//! filter equal to the least-squares straight line through all of them, whose slope has
//! `sigma_v = sqrt(12) sigma / (dt k^1.5)`. From the tenth scan on `k` is constant, and older scans are gradually
//! forgotten.

use crate::base::math::sqrt;
use crate::base::ned::Horizontal;

/// Memory of the filter, in scans.
const SCANS_MAX: u8 = 10;
/// A pause longer than this restarts the line.
const PAUSE_S: f32 = 0.5;
/// Centres with a larger sigma than this are not used for motion.
const SIGMA_MAX_M: f32 = 0.06;
/// Smallest sigma of a centre here: the change of view shifts a centre slowly by this much, whatever its sigma.
const SIGMA_FLOOR_M: f32 = 0.015;
/// Number of sigmas by which a speed must differ from zero to be significant.
const SIGMAS: f32 = 4.0;
/// Number of significant scans in a row after which the pillar counts as moving; as many insignificant ones and it
/// counts as standing.
const STEADY: u8 = 3;
/// A circle slower than this counts as standing.
const MOVING_MIN_MPS: f32 = 0.10;
/// Upper limit of the speed.
const SPEED_MAX_MPS: f32 = 20.0;

/// State of the filter, except the slope of its line, which is stored separately to save memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    scans: u8,
    /// Counter of significant scans, up to twice [`STEADY`]; an insignificant one decreases it.
    steady: u8,
}

/// One more measurement of a pillar.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    pub(super) center: Horizontal,
    pub(super) sigma_m: f32,
    /// Weight from its precision.
    pub(super) share: f32,
    /// Time since the last measurement.
    pub(super) dt_s: f32,
}

impl Motion {
    /// The state for a velocity reported by a sensor.
    pub(super) fn of(velocity_ned_mps: Horizontal) -> Self {
        Self { scans: SCANS_MAX, steady: if velocity_ned_mps.norm_squared() > 0.0 { 2 * STEADY } else { 0 } }
    }

    /// Whether the pillar moves, so that the slope of the line is its velocity.
    pub(super) fn moves(self) -> bool {
        self.steady >= STEADY
    }

    /// Whether the memory is full of a pillar that stands.
    pub(super) fn rests(self) -> bool {
        self.scans == SCANS_MAX && self.steady == 0
    }

    /// The centre after one more measurement.
    pub(super) fn step(&mut self, slope_mps: &mut Horizontal, center: Horizontal, seen: &Sighting) -> Horizontal {
        if seen.sigma_m > SIGMA_MAX_M || seen.dt_s > PAUSE_S || !(seen.dt_s > 0.0) {
            if !self.moves() {
                *self = Self { scans: 1, steady: 0 };
                *slope_mps = Horizontal::default();
            }
            return center.plus(seen.center.minus(center).times(seen.share));
        }
        // The centre of a moving pillar has been predicted already.
        let ahead = if self.moves() { center } else { center.plus(slope_mps.times(seen.dt_s)) };
        self.scans = (self.scans + 1).min(SCANS_MAX);
        let k = f32::from(self.scans);
        let (alpha, beta) = (2.0 * (2.0 * k - 1.0) / (k * (k + 1.0)), 6.0 / (k * (k + 1.0)));
        let innovation = seen.center.minus(ahead);
        *slope_mps = slope_mps.plus(innovation.times(beta / seen.dt_s)).clamped(SPEED_MAX_MPS);

        let sigma_m = if seen.sigma_m > SIGMA_FLOOR_M { seen.sigma_m } else { SIGMA_FLOOR_M };
        let doubt_mps = SIGMAS * 3.464 * sigma_m / (seen.dt_s * k * sqrt(k));
        let least = if doubt_mps > MOVING_MIN_MPS { doubt_mps } else { MOVING_MIN_MPS };
        self.steady = if slope_mps.norm_squared() > least * least {
            (self.steady + 1).min(2 * STEADY)
        } else {
            self.steady.saturating_sub(1)
        };
        ahead.plus(innovation.times(alpha))
    }
}
