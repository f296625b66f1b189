//! Angle of arrival from several looks, with reflections. (A look is a frame with its yaw and position.) It extends
//! [`foxhound_core::doa::bearing`], which uses one look and one path.
//!
//! A reflection at -6 dB pulls a single bearing by several degrees, and averaging bearings hardly helps. But while the
//! antennas move by a quarter of a wavelength and more from look to look, the two paths change their relative phase and
//! keep their directions: two directions from north and one complex amplitude per path and look explain everything,
//! `z_k = A(psi_1 - yaw_k, psi_2 - yaw_k) s_k + noise`.
//!
//! **Real arithmetic.** The antennas lie in opposite pairs `a, b` with `p_b = -p_a`. With `e = (z_a + z_b) / sqrt 2`
//! and `o = (z_a - z_b) / (j sqrt 2)` the steering vector of a direction `u` becomes real, `d = [cos u.p_1, cos u.p_2,
//! sin u.p_1, sin u.p_2] / sqrt 2`, and the real and imaginary part of a look are two real looks. Their covariance is
//! the forward-backward average (Huarng and Yeh 1991), which decorrelates the paths once more. An array without this
//! symmetry, or with a dead channel, gets the plain mean of its bearings instead: [`Method::Mean`].
//!
//! **One path.** The mean of the looks' own bearings, then one step over direction *and* wavenumber: a source above or
//! below us looks like two paths to a fit that insists on our height. It is kept when noise and calibration explain
//! what it leaves over.
//!
//! **Two paths, start.** Looks of one heading share a 4 x 4 covariance. While there is one heading, [`Method::Music`]
//! (Schmidt 1986): the two lesser eigenvectors `v` (cyclic Jacobi) span the noise, the paths are the two deepest minima
//! of `sum (v . d)^2` around the circle. When the yaw changes there is no common subspace: [`Method::Projection`], the
//! two directions of a grid whose span holds most of the looks' power (Ziskind and Wax 1988, who alternate between the
//! two; trying all pairs is no dearer here and does not end in the wrong place). It also takes over what MUSIC leaves
//! unexplained.
//!
//! **Two paths, fit.** Damped Gauss-Newton steps on `sum_k |P_perp(A_k) y_k|^2`, the amplitudes projected out (Golub
//! and Pereyra 1973, with Kaufman's derivative): deterministic maximum likelihood. It mends what MUSIC, whose minima
//! merge when the paths are close, gets wrong. A last step lets each direction turn as that of a source at a finite
//! range does while we pass (5 m away and 0.6 m travelled it is 7 degrees), so that the answer holds for the last look.
//! Paths closer than about 10 degrees can explain the looks equally well from many pairs of directions; the last step
//! goes no farther than they are apart. With more than four headings every second or third takes part until that step.
//!
//! **Sigma.** The inverse of that step's normal matrix for noise. Phase errors left in the channels are the same in
//! every look and do not average: they go through the step's linear map. Both grow when more is left over than they
//! explain.
//!
//! The array is taken to be level.

use heapless::Deque;

use foxhound_core::base::adc::CHANNELS;
use foxhound_core::base::error::{ConfigError, check};
use foxhound_core::base::ned::Ned;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::{sin_cos, wrap_pi};
use foxhound_core::doa::array::Array;
use foxhound_core::doa::bearing::{Bearing, Flags};
use foxhound_core::signal::phase::{Complex, Phasors, Tone};

mod arrival;
mod bartlett;
mod fit;
mod last_step;
mod matrix;
mod model;
mod music;
mod projection;
#[cfg(test)]
mod scenes;
mod solver;
#[cfg(test)]
mod tests;

use arrival::Found;
use model::{HEADINGS, Headings, Solver, WAVENUMBER_MIN, gather};

pub use arrival::{Arrival, Reflection};

/// Most looks that are kept.
pub const LOOKS: usize = 8;

/// Positions farther than this from the origin are no positions.
const FAR_M: f32 = 1e6;
/// Noise over signal below which it no longer matters.
const NOISE_FLOOR: f32 = 1e-7;

/// How the directions were found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Forward-backward MUSIC, then the fit. With a changing yaw, `Projection` replaces it.
    Music,
    /// Projection on pairs of directions, then the fit.
    Projection,
    /// One path explains all looks.
    OnePath,
    /// Mean of the single bearings: the array has no opposite pairs, or a channel is dead.
    Mean,
}

/// Configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// No result with fewer looks, 2..=8.
    pub looks_min: u8,
    /// Older looks are dropped beyond this many, `looks_min`..=8.
    pub looks_max: u8,
    /// A look is taken when the antennas have moved this far since the last one; 0 takes all.
    pub move_min_wavelengths: f32,
    /// Looks older than this, at the newest, are dropped.
    pub age_max_s: f32,
    /// Phase error left in each channel after calibration, rms.
    pub channel_sigma_rad: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            looks_min: 4,
            looks_max: 8,
            move_min_wavelengths: 0.25,
            age_max_s: 5.0,
            channel_sigma_rad: 1.0 / 57.295_78,
        }
    }
}

impl Config {
    /// Checks the configuration and looks for the array's opposite pairs.
    ///
    /// # Errors
    /// Names the field that is not finite or out of range.
    pub fn build(&self, array: &Array) -> Result<Looks, ConfigError> {
        check("multipath.looks_min", f32::from(self.looks_min), 2.0, LOOKS as f32)?;
        check("multipath.looks_max", f32::from(self.looks_max), f32::from(self.looks_min), LOOKS as f32)?;
        check("multipath.move_min_wavelengths", self.move_min_wavelengths, 0.0, 100.0)?;
        check("multipath.age_max_s", self.age_max_s, 1e-3, 3600.0)?;
        check("multipath.channel_sigma_rad", self.channel_sigma_rad, 0.002, 0.3)?;
        Ok(Looks { config: *self, array: *array, pairs: opposite_pairs(&array.steering) })
    }
}

/// The opposite pairs of an array; `None` where an antenna has no counterpart within 0.1 degree of phase.
fn opposite_pairs(steering: &[[f32; 2]; CHANNELS]) -> Option<[[usize; 2]; 2]> {
    let opposite = |[a, b]: [usize; 2]| {
        let sum = [steering[a][0] + steering[b][0], steering[a][1] + steering[b][1]];
        sum[0] * sum[0] + sum[1] * sum[1] < 3e-6
    };
    [[[0, 2], [1, 3]], [[0, 1], [2, 3]], [[0, 3], [1, 2]]]
        .into_iter()
        .find(|pairs| pairs.iter().all(|pair| opposite(*pair)))
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Looks {
    config: Config,
    array: Array,
    pairs: Option<[[usize; 2]; 2]>,
}

/// One look around: a frame's phasors, the bearing found in them, and where the vehicle was.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The phasors.
    pub phasors: &'a Phasors,
    /// The bearing of this one look.
    pub bearing: &'a Bearing,
    /// Yaw at the look, from north.
    pub yaw_rad: f32,
    /// Position at the look. Without one the look is used regardless of the movement, on the caller's responsibility.
    pub position_ned_m: Option<Ned>,
}

/// Whether a look was used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It is among the looks.
    Yes,
    /// The antennas have not moved enough since the last one.
    NotMoved,
    /// The frame holds no tone.
    NoTone,
    /// A number is not finite, or there is no power in it.
    Unusable,
}

/// A look as it is kept.
#[derive(Clone, Copy, Debug)]
struct Kept {
    /// `[e_1, e_2, o_1, o_2]` of the opposite pairs, unit power per channel.
    y: [Complex; 4],
    /// Power of each channel.
    powers: [f32; CHANNELS],
    /// Noise variance of a channel over the power.
    noise: f32,
    /// One over the variance of a channel's error, noise and calibration.
    weight: f32,
    time: Instant,
    yaw_rad: f32,
    /// Sine and cosine of the yaw.
    turn: (f32, f32),
    /// Sine and cosine of the bearing from north.
    toward: (f32, f32),
    position_ned_m: Option<Ned>,
    bearing: Bearing,
}

/// The looks so far.
#[derive(Clone, Debug, Default)]
pub struct State {
    looks: Deque<Kept, LOOKS>,
}

impl State {
    /// How many looks there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.looks.len()
    }

    /// Forgets all looks.
    pub fn clear(&mut self) {
        self.looks.clear();
    }
}

impl Looks {
    /// Offers a look.
    pub fn take(&self, state: &mut State, look: &Frame<'_>) -> Taken {
        if look.phasors.tone == Tone::Absent {
            return Taken::NoTone;
        }
        let tuned = self.array.depends_on_frequency().then(|| self.array.at(look.phasors.frequency_hz));
        let array = tuned.as_ref().unwrap_or(&self.array);
        let z = array.correct(&look.phasors.z);
        let powers = z.map(Complex::norm_squared);
        let power = 0.25 * powers.iter().sum::<f32>();
        let noise = look.phasors.noise.iter().enumerate().map(|(m, v)| v * array.correction_power(m)).sum::<f32>();
        let noise = 0.25 * noise / power;
        let usable = power > 1e-20 && power < 1e20 && (0.0..1e6).contains(&noise);
        // Farther than any flight, squares of distances are still numbers.
        let near =
            |p: Ned| libm::fabsf(p.north) <= FAR_M && libm::fabsf(p.east) <= FAR_M && libm::fabsf(p.down) <= FAR_M;
        let position_is_finite = look.position_ned_m.is_none_or(near);
        let bearing_is_finite = look.bearing.azimuth_rad.is_finite() && look.bearing.sigma_rad.is_finite();
        let yaw_is_sane = (-100.0..100.0).contains(&look.yaw_rad);
        if !usable || !yaw_is_sane || !position_is_finite || !bearing_is_finite {
            return Taken::Unusable;
        }

        let time = look.phasors.time;
        // A clock that ran backwards makes the ages meaningless.
        if state.looks.back().is_some_and(|last| last.time > time) {
            state.clear();
        }
        while state.looks.front().is_some_and(|first| time.seconds_since(first.time) > self.config.age_max_s) {
            state.looks.pop_front();
        }
        let far = self.config.move_min_wavelengths * core::f32::consts::TAU / self.array.wavenumber;
        let before = state.looks.back().and_then(|last| last.position_ned_m);
        if let (Some(here), Some(there)) = (look.position_ned_m, before) {
            let d = [here.north - there.north, here.east - there.east, here.down - there.down];
            if d[0] * d[0] + d[1] * d[1] + d[2] * d[2] < far * far {
                return Taken::NotMoved;
            }
        }
        while state.looks.len() >= usize::from(self.config.looks_max) {
            state.looks.pop_front();
        }

        let scale = 1.0 / libm::sqrtf(power);
        let mut y = [Complex::default(); 4];
        for (i, [a, b]) in self.pairs.iter().flatten().enumerate() {
            let (a, b, scale) = (z[*a], z[*b], scale * core::f32::consts::FRAC_1_SQRT_2);
            y[i] = Complex { re: (a.re + b.re) * scale, im: (a.im + b.im) * scale };
            y[i + 2] = Complex { re: (a.im - b.im) * scale, im: (b.re - a.re) * scale };
        }
        let noise = noise + NOISE_FLOOR;
        let kept = Kept {
            y,
            powers: powers.map(|p| p / power),
            noise,
            weight: 1.0 / (noise + self.config.channel_sigma_rad * self.config.channel_sigma_rad),
            time,
            yaw_rad: wrap_pi(look.yaw_rad),
            turn: sin_cos(look.yaw_rad),
            toward: sin_cos(look.bearing.azimuth_rad + look.yaw_rad),
            position_ned_m: look.position_ned_m,
            bearing: *look.bearing,
        };
        // There is room: the oldest went above.
        let _ = state.looks.push_back(kept);
        Taken::Yes
    }

    /// The directions that the looks agree on; `None` while there are fewer than `looks_min`.
    ///
    /// `cos_elevation` is the horizontal wavenumber that the paths have, 1 for a source at our height. With two paths
    /// it must be known; where the source is 30 degrees above or below, taking it for level costs 4 degrees.
    #[must_use]
    pub fn solve(&self, state: &State, cos_elevation: f32) -> Option<Arrival> {
        let last = state.looks.back()?;
        if state.looks.len() < usize::from(self.config.looks_min) {
            return None;
        }
        let Some(half) = self.half(state) else {
            return Some(self.mean(state, last));
        };
        let mut headings = Headings::new();
        let heading_of = gather(&state.looks, &mut headings);
        let solver = Solver {
            half,
            wavenumber: if cos_elevation > WAVENUMBER_MIN && cos_elevation <= 1.0 { cos_elevation } else { 1.0 },
            channel_variance: self.config.channel_sigma_rad * self.config.channel_sigma_rad,
            looks: &state.looks,
            stride: if headings.len() <= HEADINGS { 1 } else { headings.len().div_ceil(3) },
            headings: &headings,
            heading_of: &heading_of,
        };
        Some(solver.solve(last))
    }

    /// One antenna of each opposite pair; `None` when there are no pairs, or a channel is dead.
    fn half(&self, state: &State) -> Option<[[f32; 2]; 2]> {
        let [[a, _], [b, _]] = self.pairs?;
        let dead = |m: usize| {
            let flagged = state.looks.iter().filter(|look| look.bearing.flags.contains(Flags::dead(m))).count();
            let power = state.looks.iter().map(|look| look.powers[m]).sum::<f32>();
            // Fading takes a channel down in some looks, not in all.
            flagged == state.looks.len() || power < 0.01 * state.looks.len() as f32
        };
        (!(0..CHANNELS).any(dead)).then_some([self.array.steering[a], self.array.steering[b]])
    }

    /// The mean direction of the looks' own bearings.
    fn mean(&self, state: &State, last: &Kept) -> Arrival {
        let count = state.looks.len() as f32;
        let (mut north, mut east, mut variance) = (0.0, 0.0, 0.0);
        for look in &state.looks {
            north += look.toward.1 / count;
            east += look.toward.0 / count;
            variance += look.bearing.sigma_rad * look.bearing.sigma_rad / count;
        }
        // What the channels do to one bearing they do to all; only the spread averages.
        let length = libm::sqrtf(north * north + east * east).max(1e-3);
        let spread = -2.0 * libm::logf(length.min(1.0)) / count;
        let azimuth_ned_rad = libm::atan2f(east, north);
        let found = Found { azimuth_ned_rad, variance: variance + spread, chi2: 0.0, reflection: None };
        let wavenumber = last.bearing.quality.wavenumber;
        let arrival = found.arrival(&state.looks, last, Method::Mean, wavenumber);
        let elevation_rad = last.bearing.elevation_rad;
        Arrival { bearing: Bearing { elevation_rad, ..arrival.bearing }, ..arrival }
    }
}
