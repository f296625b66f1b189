//! What the looks would be: steering vectors, and one or two paths seen from each heading.

use heapless::{Deque, Vec};

use super::matrix::{Symmetric, Vector, at_least, dot, plus, scaled};
use super::{Kept, LOOKS};
use foxhound_core::base::units::sin_cos_inlined as sin_cos;

/// Looks whose yaw is this close to each other share a covariance.
const SAME_YAW_RAD: f32 = 1.0 / 57.295_78;
/// Smallest wavenumber of one path: 84 degrees of elevation.
pub(super) const WAVENUMBER_MIN: f32 = 0.1;
/// Up to this many headings all take part in the start and the fit; of more, three do. The last step takes all.
pub(super) const HEADINGS: usize = 4;
/// Power of the second path that the first cannot take, at least: 1.4 degrees between them.
const REST_MIN: f32 = 1e-3;

/// Looks of one yaw.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Heading {
    pub(super) yaw_rad: f32,
    /// Sine and cosine of it.
    pub(super) turn: (f32, f32),
    pub(super) covariance: Symmetric,
    /// How many.
    pub(super) count: f32,
}

pub(super) type Headings = Vec<Heading, LOOKS>;

/// One answer in the making.
pub(super) struct Solver<'a> {
    /// `k p` of one antenna of each pair.
    pub(super) half: [[f32; 2]; 2],
    pub(super) wavenumber: f32,
    pub(super) channel_variance: f32,
    pub(super) looks: &'a Deque<Kept, LOOKS>,
    pub(super) headings: &'a Headings,
    /// Which heading each look is of.
    pub(super) heading_of: &'a [u8; LOOKS],
    /// Every how manieth heading takes part in the start and the fit.
    pub(super) stride: usize,
}

/// A hypothesis: what the looks hold.
#[derive(Clone, Copy, Debug)]
pub(super) enum Paths {
    /// A direction from north, and a wavenumber.
    One([f32; 2]),
    /// Two directions from north, of one wavenumber.
    Two([f32; 2], f32),
}

impl Paths {
    pub(super) fn parameters(self) -> [f32; 2] {
        match self {
            Self::One(x) | Self::Two(x, _) => x,
        }
    }

    /// Sines and cosines of the directions.
    pub(super) fn azimuths(self) -> [(f32, f32); 2] {
        match self {
            Self::One([azimuth_rad, _]) => [sin_cos(azimuth_rad); 2],
            Self::Two(azimuths_rad, _) => azimuths_rad.map(sin_cos),
        }
    }

    /// The hypothesis a step further, no step longer than 0.3 rad.
    pub(super) fn moved(self, step: [f32; 2]) -> Self {
        let [a, b] = step.map(|s| s.clamp(-0.3, 0.3));
        match self {
            Self::One(x) => Self::One([x[0] + a, (x[1] + b).clamp(WAVENUMBER_MIN, 1.0)]),
            Self::Two(x, wavenumber) => Self::Two([x[0] + a, x[1] + b], wavenumber),
        }
    }
}

/// A hypothesis seen from one heading. The amplitude that parameter `i` acts on is `row_i . y`, and the model changes
/// with the parameter by `tangent_i` times it, what the amplitudes can follow taken out.
pub(super) struct Linear {
    pub(super) row: [Vector; 2],
    pub(super) tangent: [Vector; 2],
    /// The steering vector of the first path.
    pub(super) first: Vector,
    /// Its product with the second's; 0 if there is none.
    pub(super) cosine: f32,
    /// What is left of the second's unit power beside the first.
    pub(super) rest: f32,
}

/// A steering vector of unit length, its derivative by the azimuth, and the phases that it is made of, over the
/// wavenumber.
pub(super) struct Steering {
    pub(super) d: Vector,
    pub(super) by_azimuth: Vector,
    pub(super) phases: [f32; 2],
}

/// The derivative of a steering vector whose phases grow at these rates.
fn turned(d: &Vector, rates: [f32; 2]) -> Vector {
    [-d[2] * rates[0], -d[3] * rates[1], d[0] * rates[0], d[1] * rates[1]]
}

/// Gathers the looks of each yaw into one covariance, and says which heading each look is of.
pub(super) fn gather(looks: &Deque<Kept, LOOKS>, headings: &mut Headings) -> [u8; LOOKS] {
    let mut of = [0; LOOKS];
    for (look, of) in looks.iter().zip(&mut of) {
        let same = |heading: &Heading| {
            let apart = libm::fabsf(look.yaw_rad - heading.yaw_rad);
            // Both are wrapped: north may lie between them.
            apart < SAME_YAW_RAD || core::f32::consts::TAU - apart < SAME_YAW_RAD
        };
        let known = headings.iter().position(same);
        if known.is_none() {
            let heading = Heading { yaw_rad: look.yaw_rad, turn: look.turn, ..Heading::default() };
            let _ = headings.push(heading);
        }
        let index = known.unwrap_or(headings.len().saturating_sub(1));
        *of = index as u8;
        if let Some(heading) = headings.get_mut(index) {
            heading.count += 1.0;
            heading.covariance.add(look.weight, [&look.y.map(|c| c.re), &look.y.map(|c| c.im)]);
        }
    }
    of
}

impl Solver<'_> {
    /// The direction in the body frame of a heading.
    pub(super) fn direction(heading: &Heading, (sine, cosine): (f32, f32)) -> [f32; 2] {
        let (s, c) = heading.turn;
        [cosine * c + sine * s, sine * c - cosine * s]
    }

    /// The steering vector of a direction.
    pub(super) fn vector(&self, direction: [f32; 2], wavenumber: f32) -> Vector {
        let [(sa, ca), (sb, cb)] = self.phases(direction).map(|phase| sin_cos(wavenumber * phase));
        [ca, cb, sa, sb].map(|x| x * core::f32::consts::FRAC_1_SQRT_2)
    }

    fn phases(&self, [cosine, sine]: [f32; 2]) -> [f32; 2] {
        self.half.map(|p| p[0] * cosine + p[1] * sine)
    }

    /// The steering vector and its derivative.
    pub(super) fn steering(&self, [cosine, sine]: [f32; 2], wavenumber: f32) -> Steering {
        let d = self.vector([cosine, sine], wavenumber);
        let rates = self.phases([-sine, cosine]).map(|rate| wavenumber * rate);
        Steering { d, by_azimuth: turned(&d, rates), phases: self.phases([cosine, sine]) }
    }

    /// A hypothesis as a heading sees it.
    pub(super) fn linear(&self, heading: &Heading, paths: Paths, azimuths: [(f32, f32); 2]) -> Linear {
        match paths {
            Paths::One([_, wavenumber]) => {
                let direction = Self::direction(heading, azimuths[0]);
                let Steering { d, by_azimuth, phases } = self.steering(direction, wavenumber);
                let by_wavenumber = turned(&d, phases);
                Linear { row: [d, d], tangent: [by_azimuth, by_wavenumber], first: d, cosine: 0.0, rest: 0.0 }
            }
            Paths::Two(_, wavenumber) => {
                let [first, second] = azimuths.map(|a| self.steering(Self::direction(heading, a), wavenumber));
                let cosine = dot(&first.d, &second.d);
                let beside = plus(&second.d, -cosine, &first.d);
                let rest = at_least(REST_MIN, dot(&beside, &beside));
                let beside = scaled(&beside, 1.0 / rest);
                let row = [plus(&first.d, -cosine, &beside), beside];
                // A steering vector keeps its length, so its derivative is at right angles to it.
                let outside = |t: &Vector, other: &Vector, row: &Vector| plus(t, -dot(t, other), row);
                let tangent =
                    [outside(&first.by_azimuth, &second.d, &row[1]), outside(&second.by_azimuth, &first.d, &row[0])];
                Linear { row, tangent, first: first.d, cosine, rest }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::scenes::{array, estimator, phasors};
    use super::super::{Config, Frame, State, Taken};
    use super::*;
    use foxhound_core::signal::phase::Complex;

    #[test]
    fn looks_beside_north_share_a_heading() {
        let mut state = State::default();
        let stage = Config::default().build(&array()).unwrap();
        for (k, yaw) in [3.138, -3.138, 3.139, -1.0].iter().enumerate() {
            let phasors = phasors([Complex { re: 1.0, im: 0.0 }; 4], 1e-6, k as u64);
            let bearing = estimator().estimate(&phasors);
            let look = Frame { phasors: &phasors, bearing: &bearing, yaw_rad: *yaw, position_ned_m: None };
            assert_eq!(stage.take(&mut state, &look), Taken::Yes);
        }
        let mut headings = Headings::new();
        let of = gather(&state.looks, &mut headings);
        assert_eq!((headings.len(), &of[..4]), (2, &[0, 0, 0, 1][..]));
    }
}
