//! The measurement of a pair of antennas (eq. 2), its side by cross-correlation, and the conversion into the paper's
//! frame.

use super::{Outcome, PAIR_MIN_RAD, azimuth, dot, length, subtract};
use foxhound_core::base::adc::CHANNELS;
use foxhound_core::base::math::sqrt;
use foxhound_core::doa::array::Array;
use foxhound_core::signal::phase::Complex;

/// The lags that decide the side of A1A2, and of A3A4.
pub(super) const ACROSS: [[usize; 2]; 2] = [[0, 3], [1, 2]];

/// The antennas and their phasors, in the paper's frame.
pub(super) struct Antennas<'a> {
    pub(super) position_m: [[f32; 2]; CHANNELS],
    pub(super) wavenumber: f32,
    pub(super) z: &'a [Complex; CHANNELS],
    pub(super) living: [bool; CHANNELS],
}

/// The measurement of one pair, eq. 2.
#[derive(Clone, Copy)]
pub(super) struct Angle {
    /// Eq. 6-7.
    pub(super) midpoint_m: [f32; 2],
    /// Unit vector from the first antenna to the second.
    pub(super) axis: [f32; 2],
    /// Sine of the angle from the normal: the arcsine itself would only be undone.
    pub(super) sine: f32,
}

impl Angle {
    /// The normal of the pair: ahead for the pairs A1A2 and A4A3 of the square.
    pub(super) fn normal(&self) -> [f32; 2] {
        [self.axis[1], -self.axis[0]]
    }

    /// Cosine of the angle, not negative, as that of an arcsine.
    pub(super) fn cosine(&self) -> f32 {
        sqrt((1.0 - self.sine) * (1.0 + self.sine))
    }
}

/// A pair's midpoint and the direction it sees the source in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) midpoint_m: [f32; 2],
    pub(super) direction: [f32; 2],
}

impl<'a> Antennas<'a> {
    /// From our frame, `[forward, right]` times the wavenumber, into the paper's.
    pub(super) fn new(array: &Array, z: &'a [Complex; CHANNELS], living: [bool; CHANNELS]) -> Self {
        let position_m = array.steering.map(|p| [p[0] / array.wavenumber, -p[1] / array.wavenumber]);
        Self { position_m, wavenumber: array.wavenumber, z, living }
    }

    /// By how many metres `j` is nearer to the source than `i`; `None` with a dead one.
    pub(super) fn lead_m(&self, i: usize, j: usize) -> Option<f32> {
        let heard = |k: usize| self.z.get(k).filter(|_| self.living.get(k).is_some_and(|lives| *lives));
        Some(heard(j)?.times_conj(*heard(i)?).arg() / self.wavenumber)
    }

    /// Eq. 2 for the pair `i j`.
    pub(super) fn angle(&self, [i, j]: [usize; 2]) -> Option<Angle> {
        let (first, second) = (self.position_m[i], self.position_m[j]);
        let between = subtract(second, first);
        let spacing_m = length(between);
        if !(spacing_m * self.wavenumber > PAIR_MIN_RAD) {
            return None;
        }
        Some(Angle {
            midpoint_m: [0.5 * (first[0] + second[0]), 0.5 * (first[1] + second[1])],
            axis: [between[0] / spacing_m, between[1] / spacing_m],
            sine: (self.lead_m(i, j)? / spacing_m).clamp(-1.0, 1.0),
        })
    }

    /// Whether the source is on the side of the pair's normal, by the lags of others; `None` without one.
    pub(super) fn is_ahead(&self, angle: &Angle, lags: &[[usize; 2]]) -> Option<bool> {
        let normal = angle.normal();
        let mut sum = None;
        for [i, j] in lags {
            let Some(lead_m) = self.lead_m(*i, *j) else { continue };
            let (Some(first), Some(second)) = (self.position_m.get(*i), self.position_m.get(*j)) else { continue };
            let baseline = subtract(*second, *first);
            // The part explained by theta is removed; the rest is cos theta times the baseline's part across the
            // pair.
            let rest = lead_m - angle.sine * dot(angle.axis, baseline);
            sum = Some(sum.unwrap_or(0.0) + dot(normal, baseline) * rest);
        }
        sum.map(|sum| sum >= 0.0)
    }

    /// The direction of a pair, on the side given by others.
    pub(super) fn ray(&self, pair: [usize; 2], lags: &[[usize; 2]]) -> Option<Ray> {
        let angle = self.angle(pair)?;
        let cosine = if self.is_ahead(&angle, lags)? { angle.cosine() } else { -angle.cosine() };
        let normal = angle.normal();
        let direction = core::array::from_fn(|n| angle.sine * angle.axis[n] + cosine * normal[n]);
        Some(Ray { midpoint_m: angle.midpoint_m, direction })
    }

    pub(super) fn pair(&self) -> Option<Outcome> {
        let azimuth_rad = azimuth(self.ray([0, 1], &ACROSS)?.direction)?;
        Some(Outcome::Solved { azimuth_rad, range_m: None })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aoa::waves::{ALL, distances, error_deg, plane_wave, solved, wave, with};
    use foxhound_core::doa::array;
    use foxhound_core::doa::bearing::Estimator;
    use std::f64::consts::PI;

    #[test]
    fn a_source_on_the_left_has_a_positive_angle_in_the_paper_and_a_negative_azimuth_here() {
        let config = array::Config::default();
        let z = wave(&config, distances(&config, -PI / 4.0, 5.0, 0.0));
        let array = config.build().unwrap();
        let antennas = Antennas::new(&array, &z, [true; 4]);
        // A2 of the paper is at (d, d), left, and nearer to this source than A1: it leads.
        assert!(antennas.position_m[1][0] > 0.0 && antennas.position_m[1][1] > 0.0);
        assert!(antennas.lead_m(0, 1).unwrap() > 0.0);
        assert!(antennas.angle([0, 1]).unwrap().sine > 0.5);
        for estimator in ALL {
            let azimuth_rad = solved(estimator, &config, z).azimuth_rad().unwrap();
            assert!(error_deg(azimuth_rad, -PI / 4.0).abs() < 1.5, "{estimator:?}: {azimuth_rad}");
        }
    }

    #[test]
    fn the_side_of_a_pair_is_right_where_the_others_lie_obliquely_behind_it() {
        // The lags across run 39 deg off the normal: for a third of the circle they have the sign of the other side.
        let config = with([[0.05, 0.02], [0.05, -0.10], [-0.05, -0.02], [-0.05, 0.10]]);
        for step in 0..360 {
            let truth = (f64::from(step) + 0.5).to_radians();
            if truth.cos().abs() > 0.1 {
                let azimuth_rad = solved(Estimator::Pair, &config, plane_wave(&config, truth)).azimuth_rad().unwrap();
                assert!(error_deg(azimuth_rad, truth).abs() < 0.01, "{step}: {azimuth_rad}");
            }
        }
    }
}
