//! From the looks to one answer: which hypothesis is tried when, and which is kept.

use super::arrival::{Arrival, Found, Reflection};
use super::bartlett::Scan;
use super::model::{Heading, Paths, Solver, WAVENUMBER_MIN};
use super::{Kept, Method};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::units::wrap_pi;

/// One path of which even a step leaves this many times more than it may is not worth a last step.
const HOPELESS: f32 = 5.0;
/// Phase errors of the channels give one path a residual, per look and in units of their variance, that is a chi-square
/// of two degrees of freedom; exceeded once in 400.
const CALIBRATION_GATE: f32 = 12.0;
/// Standard deviations of the mean residual by noise.
const NOISE_GATE: f32 = 4.5;

impl Solver<'_> {
    /// One path if it is enough, else two.
    pub(super) fn solve(&self, last: &Kept) -> Arrival {
        let one = self.mean();
        let gate = self.gate();
        let normal = self.normal(one, self.stride);
        if self.left_over(normal.explained + normal.gain(), self.stride) < HOPELESS * gate {
            let fit = self.finish(one);
            if fit.chi2 < gate {
                // Of three degrees of freedom for the channels' errors a look, one path takes one.
                let variance = fit.variance[0] * (fit.chi2 / 3.0).max(1.0);
                let found = Found { azimuth_ned_rad: fit.x[0], variance, chi2: fit.chi2, reflection: None };
                return found.arrival(self.looks, last, Method::OnePath, fit.x[1]);
            }
        }

        let mut scan = Scan::EMPTY;
        self.scan(&mut scan);
        let resolve = |start: [f32; 2]| self.fit(Paths::Two(start, self.wavenumber));
        let (paths, method) = match self.music(&scan).map(resolve) {
            Some((paths, left)) if left < gate => (paths, Method::Music),
            other => {
                let (paths, left) = resolve(self.projection(&scan));
                match other {
                    Some((first, less)) if less <= left => (first, Method::Music),
                    _ => (paths, Method::Projection),
                }
            }
        };
        let fit = self.finish(paths);
        let strong = usize::from(fit.power[1] > fit.power[0]);
        let weak = 1 - strong;
        let ratio = fit.power[weak] / fit.power[strong];
        let reflection = Reflection {
            azimuth_ned_rad: wrap_pi(fit.x[weak]),
            relative_power: if ratio <= 1.0 { ratio } else { 1.0 },
        };
        // Of three degrees of freedom for the channels' errors a look, two paths take two.
        let variance = fit.variance[strong] * (fit.chi2 / 2.0).max(1.0);
        let reflection = fit.x[weak].is_finite().then_some(reflection);
        let found = Found { azimuth_ned_rad: fit.x[strong], variance, chi2: fit.chi2, reflection };
        found.arrival(self.looks, last, method, self.wavenumber)
    }

    /// The residual that a model may leave: noise gives one path three per look, and the channels' errors theirs.
    pub(super) fn gate(&self) -> f32 {
        let count = self.looks.len() as f32;
        let calibration = self.looks.iter().map(|look| self.channel_variance * look.weight).sum::<f32>() / count;
        (1.0 - calibration) * (3.0 + NOISE_GATE * sqrt(3.0 / count)) + calibration * CALIBRATION_GATE
    }

    /// One path: the mean of the looks' own bearings and wavenumbers.
    pub(super) fn mean(&self) -> Paths {
        let (mut north, mut east, mut wavenumber) = (0.0, 0.0, 0.0);
        for look in self.looks {
            north += look.toward.1;
            east += look.toward.0;
            let own = look.bearing.quality.wavenumber;
            wavenumber += if own > 0.0 && own < 1.0 { own } else { 1.0 };
        }
        let wavenumber = (wavenumber / self.looks.len() as f32).clamp(WAVENUMBER_MIN, 1.0);
        Paths::One([libm::atan2f(east, north), wavenumber])
    }

    /// The headings that take part.
    pub(super) fn some_headings(&self, stride: usize) -> impl Iterator<Item = &Heading> {
        self.headings.iter().step_by(stride)
    }

    /// What a look has left over, on average over those that take part, when `explained` is explained.
    pub(super) fn left_over(&self, explained: f32, stride: usize) -> f32 {
        let (total, count) = self
            .some_headings(stride)
            .fold((0.0, 0.0), |(total, count), heading| (total + heading.covariance.trace(), count + heading.count));
        (total - explained) / count
    }
}
