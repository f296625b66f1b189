//! The last step of the fit, in which the directions may turn, and what it says about its own errors.

use super::Kept;
use super::matrix::{Symmetric, dot, plus};
use super::model::{Linear, Paths, Solver};
use foxhound_core::base::adc::CHANNELS;
use foxhound_core::base::ned::Ned;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::signal::phase::Complex;

/// Standard deviation of a source's inverse range: nearer than 5 m is rare.
const INVERSE_RANGE_SIGMA_PER_M: f32 = 0.1;
/// The same when no positions are known, for looks a third of a wavelength apart: turn of a path from look to look.
const TURN_SIGMA_RAD: f32 = 0.01;
/// Two paths are at least this far from each other for the last step.
const APART_MIN_RAD: f32 = 0.01;

/// The last step's yield.
pub(super) struct Fit {
    /// The parameters, for the last look.
    pub(super) x: [f32; 2],
    pub(super) variance: [f32; 2],
    /// Mean power of each path.
    pub(super) power: [f32; 2],
    /// Mean residual of a look over its variance.
    pub(super) chi2: f32,
}

impl Solver<'_> {
    /// How far, in units of the turn parameter, the directions have turned at a look. With positions the parameter is
    /// the inverse range and this the way to the left of the path; without, it is the turn from look to look.
    pub(super) fn levers(&self, centre: Option<Ned>, azimuths: [(f32, f32); 2], look: &Kept, index: usize) -> [f32; 2] {
        let (Some(centre), Some(position)) = (centre, look.position_ned_m) else {
            return [index as f32 - 0.5 * (self.looks.len() as f32 - 1.0); 2];
        };
        let (north, east) = (position.north - centre.north, position.east - centre.east);
        azimuths.map(|(sine, cosine)| north * sine - east * cosine)
    }

    /// Mean position, if all are known.
    pub(super) fn centre(&self) -> Option<Ned> {
        let scale = 1.0 / self.looks.len() as f32;
        self.looks.iter().try_fold(Ned::default(), |sum, look| {
            let p = look.position_ned_m?;
            Some(Ned { north: sum.north + scale * p.north, east: sum.east + scale * p.east, down: 0.0 })
        })
    }

    /// One last step over four parameters: the two of `paths` and the turn of each direction.
    pub(super) fn finish(&self, paths: Paths) -> Fit {
        let count = self.looks.len() as f32;
        let centre = self.centre();
        let sigma = if centre.is_some() { INVERSE_RANGE_SIGMA_PER_M } else { TURN_SIGMA_RAD };
        // Noise is half in the real and half in the imaginary part: information is twice the normal matrix.
        let precision = 0.5 / (sigma * sigma);
        let one = matches!(paths, Paths::One(_));
        let mut h = Symmetric::default();
        h.0[2][2] = precision;
        if let Paths::Two([a, b], _) = paths {
            // Where the looks hardly tell the paths from each other, no step takes either farther than they are apart.
            let apart = wrap_pi(a - b);
            let hold = 0.5 / (apart * apart + APART_MIN_RAD * APART_MIN_RAD);
            (h.0[0][0], h.0[1][1]) = (hold, hold);
        }
        h.0[3][3] = if one { 1e9 } else { precision };
        let mut b = [0.0; 4];
        let mut channels = [[0.0; 4]; CHANNELS];
        let (mut power, mut residual, mut noise) = ([0.0; 2], 0.0, 0.0);
        let azimuths = paths.azimuths();
        let mut seen_from = None;
        for (index, (look, number)) in self.looks.iter().zip(self.heading_of).enumerate() {
            let (_, Linear { row, tangent, cosine, rest, .. }, tt) = match &seen_from {
                Some(known @ (of, _, _)) if of == number => known,
                _ => {
                    let Some(heading) = self.headings.get(usize::from(*number)) else { continue };
                    let linear = self.linear(heading, paths, azimuths);
                    let [p, q] = &linear.tangent;
                    let tt = [dot(p, p), dot(p, q), dot(q, q)];
                    seen_from.insert((*number, linear, tt))
                }
            };
            let w = look.weight;
            let (re, im) = (look.y.map(|c| c.re), look.y.map(|c| c.im));
            let s = row.map(|row| Complex { re: dot(&row, &re), im: dot(&row, &im) });
            let e = tangent.map(|t| Complex { re: dot(&t, &re), im: dot(&t, &im) });
            let lever = self.levers(centre, azimuths, look, index);
            let lever = if one { [lever[0], 0.0] } else { lever };

            let own = [s[0].norm_squared(), s[1].norm_squared()];
            let both = s[0].re * s[1].re + s[0].im * s[1].im;
            let [a, c, d] = [w * tt[0] * own[0], w * tt[1] * both, w * tt[2] * own[1]];
            let ([i, j], [k, l]) = (lever, [lever[0] * c, lever[1] * c]);
            h.0[0] = plus(&h.0[0], 1.0, &[a, c, i * a, l]);
            h.0[1] = plus(&h.0[1], 1.0, &[0.0, d, k, j * d]);
            h.0[2] = plus(&h.0[2], 1.0, &[0.0, 0.0, i * i * a, j * k]);
            h.0[3][3] += j * j * d;
            for i in 0..2 {
                let gain = w * (s[i].re * e[i].re + s[i].im * e[i].im);
                b[i] += gain;
                b[i + 2] += lever[i] * gain;
                power[i] += own[i];
                // A phase error in one channel turns that channel's phasor.
                for pair in 0..2 {
                    let (even, odd) = (look.y[pair], look.y[pair + 2]);
                    let a = Complex { re: even.re - odd.im, im: even.im + odd.re }.times_conj(s[i]);
                    let c = Complex { re: even.re + odd.im, im: even.im - odd.re }.times_conj(s[i]);
                    let (te, to) = (0.5 * w * tangent[i][pair], 0.5 * w * tangent[i][pair + 2]);
                    let (a, c) = (to * a.re - te * a.im, -to * c.re - te * c.im);
                    channels[pair][i] += a;
                    channels[pair][i + 2] += lever[i] * a;
                    channels[pair + 2][i] += c;
                    channels[pair + 2][i + 2] += lever[i] * c;
                }
            }
            noise += w * look.noise;
            let total = dot(&re, &re) + dot(&im, &im);
            let first = Complex { re: s[0].re + cosine * s[1].re, im: s[0].im + cosine * s[1].im };
            residual += w * (total - first.norm_squared() - rest * own[1]);
        }
        for i in 1..4 {
            for j in 0..i {
                h.0[i][j] = h.0[j][i];
            }
        }
        let inverse = h.inverse();
        let step = inverse.times(&b);
        let lever = match self.looks.back() {
            Some(last) => self.levers(centre, azimuths, last, self.looks.len() - 1),
            None => [0.0; 2],
        };
        let x = paths.parameters();
        let mut fit = Fit { x, variance: [0.0; 2], power, chi2: (residual - dot(&step, &b)).max(0.0) / count };
        for i in 0..2 {
            let at_last = plus(&inverse.0[i], lever[i], &inverse.0[i + 2]);
            let information = at_last[i] + lever[i] * at_last[i + 2];
            let calibration = channels.iter().map(|c| dot(&at_last, c)).map(|s| s * s).sum::<f32>();
            fit.variance[i] = 0.5 * noise / count * information + self.channel_variance * calibration;
            fit.x[i] += (step[i] + lever[i] * step[i + 2]).clamp(-0.3, 0.3);
        }
        fit
    }
}
