//! The averaged direction of the source, along which the temporary target lies (main paper, section III-A).
//!
//! A beacon usually lies below the vehicle, and a tilted array then measures a wrong azimuth. The depression angle is
//! estimated from the wavenumber, whose square is one minus the square of the direction's vertical component, while the
//! array is not tilted towards the source. (A flat array cannot distinguish below from above; a source above is not
//! expected.)
//!
//! Bearings are averaged as unit vectors in the NED frame, weighted by their precision. The noisier they are, the
//! longer the memory of the average: a tenth of a second for good ones, a second or two for bearings of 10 or 20
//! degrees.

use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::ownship::Ownship;
use crate::base::time::Instant;
use crate::base::units::asin;
use crate::doa::bearing::Bearing;

/// The array counts as level towards the source when the angle between its plane and the horizon there is less than
/// this.
const LEVEL_RAD: f32 = 0.03;
/// Averaging time of the depression.
const DEPRESSION_MEMORY_S: f32 = 1.0;
/// Averaging time of perfect bearings, and that added per radian of the bearings' sigma.
const MEMORY_MIN_S: f32 = 0.1;
const MEMORY_S_PER_RAD: f32 = 6.0;

/// The averaged direction of the source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    sum: Horizontal,
    updated: Option<Instant>,
    /// Weighted sum of the squared vertical component of the direction, and sum of the weights.
    sunk: f32,
    sunk_weight: f32,
}

impl State {
    /// Bearing of the source from north, clockwise; `None` before the first valid bearing.
    #[must_use]
    pub fn source_bearing_ned_rad(&self) -> Option<f32> {
        self.updated.map(|_| self.sum.bearing_rad())
    }

    /// Angle by which the source lies below the horizon.
    #[must_use]
    pub fn depression_rad(&self) -> f32 {
        let squared = if self.sunk_weight > 0.0 { self.sunk / self.sunk_weight } else { 0.0 };
        asin(sqrt(squared.clamp(0.0, 1.0)))
    }

    /// When the last valid bearing was measured.
    #[must_use]
    pub fn updated(&self) -> Option<Instant> {
        self.updated
    }

    /// Processes a valid bearing and returns its direction, from north, clockwise.
    pub fn observe(&mut self, bearing: &Bearing, ownship: &Ownship) -> f32 {
        let at = bearing.time;
        let bearing_ned_rad = ownship.bearing_ned_rad(bearing.azimuth_rad, self.depression_rad(), at);
        let [_, _, tilt] = ownship.to_body(bearing_ned_rad - ownship.yaw_at(at), 0.0);
        let since_s = self.updated.map_or(0.0, |updated| at.seconds_since(updated));
        let fades = 1.0 / (1.0 + since_s / DEPRESSION_MEMORY_S);
        // Their ratio stays while nothing is added. They do not fade to where only rounding is left of it.
        if self.sunk_weight > 1.0 {
            (self.sunk, self.sunk_weight) = (self.sunk * fades, self.sunk_weight * fades);
        }
        if libm::fabsf(tilt) < LEVEL_RAD && bearing.quality.wavenumber > 0.0 {
            let weight = 1.0 / (bearing.sigma_rad * bearing.sigma_rad + 1e-6);
            let wavenumber = bearing.quality.wavenumber;
            self.sunk += weight * (1.0 - wavenumber * wavenumber);
            self.sunk_weight += weight;
        }
        let direction = Horizontal::from_bearing(bearing_ned_rad);
        let sigma_rad = if bearing.sigma_rad > 1e-3 { bearing.sigma_rad } else { 1e-3 };
        let weight = 1.0 / (sigma_rad * sigma_rad);
        let kept = match self.updated {
            None => 0.0,
            Some(updated) => {
                let memory_s = MEMORY_MIN_S + MEMORY_S_PER_RAD * sigma_rad;
                let age = at.seconds_since(updated) / if memory_s > 1e-3 { memory_s } else { 1e-3 };
                // exp(-age), by the first terms of its series: accurate enough for a weight.
                1.0 / (1.0 + age + 0.5 * age * age)
            }
        };
        self.sum = self.sum.times(kept).plus(direction.times(weight));
        self.updated = Some(at);
        bearing_ned_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::base::units::wrap_pi;
    use crate::doa::bearing::{Flags, Quality};

    fn bearing(time_us: u64, sigma_rad: f32) -> Bearing {
        Bearing { valid: true, sigma_rad, ..Bearing::without(Instant(time_us), Quality::default(), Flags::default()) }
    }

    #[test]
    fn a_source_below_is_found_through_a_tilt_once_its_depression_is_known() {
        let mut state = State::default();
        let (depression, psi) = (0.5_f32, 0.8_f32);
        let mut worst = 0.0_f32;
        for k in 0..200_u64 {
            let time = k * 20_000;
            // Level for two seconds, then rocking.
            let tilt = if k < 100 { 0.0 } else { 0.15 };
            let ownship =
                Ownship { attitude_time: Instant(time), roll_rad: tilt, pitch_rad: -tilt, ..Ownship::default() };
            let [forward, right, _] = ownship.to_body(psi, depression);
            let mut heard = bearing(time, 0.0025);
            heard.azimuth_rad = libm::atan2f(right, forward);
            heard.quality.wavenumber = libm::sqrtf(forward * forward + right * right);
            let error = wrap_pi(state.observe(&heard, &ownship) - psi);
            worst = if k > 0 && libm::fabsf(error) > worst { libm::fabsf(error) } else { worst };
        }
        assert!((state.depression_rad() - depression).abs() < 0.01, "{}", state.depression_rad());
        assert!(worst < 0.002, "{worst}");
    }

    #[test]
    fn a_depression_stays_however_long_the_vehicle_leans() {
        let mut state = State::default();
        let (depression, psi) = (0.1_f32, 0.4_f32);
        for k in 0..20_000_u64 {
            let time = k * 20_000;
            let tilt = if k < 50 { 0.0 } else { 0.12 };
            let ownship = Ownship { attitude_time: Instant(time), pitch_rad: -tilt, ..Ownship::default() };
            let [forward, right, _] = ownship.to_body(psi, depression);
            let mut heard = bearing(time, 0.01);
            heard.azimuth_rad = libm::atan2f(right, forward);
            heard.quality.wavenumber = libm::sqrtf(forward * forward + right * right);
            let error = wrap_pi(state.observe(&heard, &ownship) - psi);
            assert!(libm::fabsf(error) < 0.01 || k == 0, "{k}: {error}");
            assert!((state.depression_rad() - depression).abs() < 0.01, "{k}: {}", state.depression_rad());
        }
    }

    #[test]
    fn noisy_bearings_are_averaged_longer_than_good_ones_and_across_the_wrap() {
        for (sigma, expected) in [(0.0025_f32, 0.002), (0.35, 0.10)] {
            let (mut state, mut rng) = (State::default(), Rng::new(5, 0));
            let mut squares = 0.0;
            for k in 0..2000_u64 {
                let heard = wrap_pi(core::f32::consts::PI + sigma * rng.gaussian());
                let turned = Ownship { yaw_rad: heard, ..Ownship::default() };
                state.observe(&bearing(k * 20_000, sigma), &turned);
                if k >= 1000 {
                    let error = wrap_pi(state.source_bearing_ned_rad().unwrap() - core::f32::consts::PI);
                    squares += error * error;
                }
            }
            let rms = libm::sqrtf(squares / 1000.0);
            assert!(rms < expected, "sigma {sigma}: {rms}");
        }
    }
}
