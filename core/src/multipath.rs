//! Angle of arrival over several looks, in reflections. After [`crate::bearing`], which knows one look and one path.
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
//! alternating projection of Ziskind and Wax (1988) over all headings, also for what MUSIC leaves unexplained.
//!
//! **Two paths, fit.** Damped Gauss-Newton steps on `sum_k |P_perp(A_k) y_k|^2`, the amplitudes projected out (Golub
//! and Pereyra 1973, with Kaufman's derivative): deterministic maximum likelihood. It mends what MUSIC, whose minima
//! merge when the paths are close, gets wrong. A last step lets each direction turn as that of a source at a finite
//! range does while we pass (5 m away and 0.6 m travelled it is 7 degrees), so that the answer holds for the last look.
//! With more than three headings every second or third takes part until that step.
//!
//! **Sigma.** The inverse of that step's normal matrix for noise. Phase errors left in the channels are the same in
//! every look and do not average: they go through the step's linear map. Both grow when more is left over than they
//! explain.
//!
//! The array is taken to be level. Instructions of an answer on a Cortex-M4F, mean (worst of 300): one heading, one
//! path 10 200, two paths 25 900 (38 600); eight headings, 15 900 and 40 900 (53 000). A look costs 550.

use heapless::{Deque, Vec};

use crate::adc::CHANNELS;
use crate::array::Array;
use crate::bearing::{Bearing, Flags};
use crate::error::{ConfigError, Why, check};
use crate::frame::Ned;
use crate::phase::{Complex, Phasors, Tone};
use crate::time::Instant;
use crate::units::{sin_cos, wrap_pi};

/// Most looks that are kept.
pub const LOOKS: usize = 8;

/// Positions farther than this from the origin are no positions.
const FAR_M: f32 = 1e6;
/// Looks whose yaw is this close to each other share a covariance.
const SAME_YAW_RAD: f32 = 1.0 / 57.295_78;
/// Directions around the circle at which the scans look; opposite ones share their sines.
const GRID: usize = 16;
const HALF: usize = GRID / 2;
const GRID_STEP_RAD: f32 = core::f32::consts::TAU / GRID as f32;
/// Gauss-Newton steps of the two-path fit.
const STEPS: u8 = 4;
/// The start and these steps take the looks of at most this many headings; the last step takes all.
const HEADINGS: usize = 3;
/// One path that leaves this many times more than it may is not worth a last step.
const HOPELESS: f32 = 20.0;
/// A shorter step ends the fit: the last step is another, and the error left goes with the square.
const CLOSE_RAD: f32 = 0.01;
/// Rounds of alternating projection.
const ROUNDS: u8 = 2;
/// Rounds of Jacobi rotations: the off-diagonal is below rounding after four.
const SWEEPS: u8 = 4;
/// Phase errors of the channels give one path a residual, per look and in units of their variance, that is a chi-square
/// of two degrees of freedom; exceeded once in 400.
const CALIBRATION_GATE: f32 = 12.0;
/// Standard deviations of the mean residual by noise.
const NOISE_GATE: f32 = 4.5;
/// Standard deviation of a source's inverse range: nearer than 5 m is rare.
const INVERSE_RANGE_SIGMA_PER_M: f32 = 0.1;
/// The same when no positions are known, for looks a third of a wavelength apart: turn of a path from look to look.
const TURN_SIGMA_RAD: f32 = 0.01;
/// Smallest wavenumber of one path: 84 degrees of elevation.
const WAVENUMBER_MIN: f32 = 0.1;
/// A bearing worse than this says nothing.
const SIGMA_USELESS_RAD: f32 = 0.6;
/// Noise over signal below which it no longer matters.
const NOISE_FLOOR: f32 = 1e-7;

/// How the directions were found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Method {
    /// Forward-backward MUSIC, then the fit. Asked for with a changing yaw, `Projection` takes its place.
    #[default]
    Music,
    /// Alternating projection, then the fit.
    Projection,
    /// One path explains all looks.
    OnePath,
    /// Mean of the single bearings: asked for, or the array has no opposite pairs, or a channel is dead.
    Mean,
}

/// What the resolution needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct Config {
    /// No answer with fewer looks, 2..=8.
    pub looks_min: u8,
    /// Older looks are dropped beyond this many, `looks_min`..=8.
    pub looks_max: u8,
    /// A look is taken when the antennas have moved this far since the last one; 0 takes all.
    pub move_min_wavelengths: f32,
    /// Looks older than this, at the newest, are dropped.
    pub age_max_s: f32,
    /// Phase error left in each channel after calibration, rms.
    pub channel_sigma_rad: f32,
    /// How two paths are looked for.
    pub method: Method,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            looks_min: 4,
            looks_max: 8,
            move_min_wavelengths: 0.25,
            age_max_s: 5.0,
            channel_sigma_rad: 1.0 / 57.295_78,
            method: Method::Music,
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
        if self.method == Method::OnePath {
            let why = Why::Inconsistent("one path is an answer, not a way to look for two");
            return Err(ConfigError { field: "multipath.method", value: 0.0, why });
        }
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
pub struct Look<'a> {
    /// The phasors.
    pub phasors: &'a Phasors,
    /// The bearing of this one look.
    pub bearing: &'a Bearing,
    /// Yaw at the look, from north.
    pub yaw_rad: f32,
    /// Position at the look. Without one the look is taken whatever the movement: the caller vouches for it.
    pub position_ned_m: Option<Ned>,
}

/// Whether a look was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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

/// The weaker of two paths.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Reflection {
    /// Its direction from north, (-pi, pi].
    pub azimuth_ned_rad: f32,
    /// Its mean power over that of the stronger path, 0..=1.
    pub relative_power: f32,
}

/// What several looks tell.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Arrival {
    /// The stronger path, as seen from the last look, in the body frame. `quality.closure_chi2` is the mean residual of
    /// a look over its variance: near 1 when the model holds, thousands when it does not. Signal-to-noise ratio and
    /// frequency are the last look's; the flags are those of all looks. `MULTIPATH` says that there are two paths.
    pub bearing: Bearing,
    /// The same direction from north.
    pub azimuth_ned_rad: f32,
    /// The weaker path, if there is one. (Nothing says that the direct path is the stronger one.)
    pub reflection: Option<Reflection>,
    /// Check: the direction of most Bartlett power, or the mean of the bearings.
    pub bartlett_ned_rad: f32,
    /// How it was found.
    pub method: Method,
    /// From how many looks.
    pub looks: u8,
}

type Vector = [f32; 4];

fn dot(a: &Vector, b: &Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// The inner product's part from cosines and its part from sines.
fn halves(a: &Vector, b: &Vector) -> (f32, f32) {
    (a[0] * b[0] + a[1] * b[1], a[2] * b[2] + a[3] * b[3])
}

/// `a + factor b`.
fn plus(a: &Vector, factor: f32, b: &Vector) -> Vector {
    [a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2], a[3] + factor * b[3]]
}

fn scaled(a: &Vector, factor: f32) -> Vector {
    a.map(|x| x * factor)
}

/// The steering vector of the opposite direction.
fn reversed(d: &Vector) -> Vector {
    [d[0], d[1], -d[2], -d[3]]
}

/// A symmetric 4 x 4 matrix.
#[derive(Clone, Copy, Debug, Default)]
struct Symmetric([Vector; 4]);

impl Symmetric {
    /// Adds `weight v v'`.
    fn add(&mut self, weight: f32, v: &Vector) {
        for (row, x) in self.0.iter_mut().zip(v) {
            *row = plus(row, weight * x, v);
        }
    }

    fn times(&self, v: &Vector) -> Vector {
        let [a, b, c, d] = &self.0;
        [dot(a, v), dot(b, v), dot(c, v), dot(d, v)]
    }

    fn trace(&self) -> f32 {
        self.0[0][0] + self.0[1][1] + self.0[2][2] + self.0[3][3]
    }

    /// The eigenvectors of the two smallest eigenvalues, by cyclic Jacobi rotations.
    fn lesser_eigenvectors(&self) -> [Vector; 2] {
        let mut a = self.0;
        let mut v = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let negligible = 1e-14 * self.trace() * self.trace();
        for _ in 0..SWEEPS {
            for (p, q) in [(0, 1), (2, 3), (0, 2), (1, 3), (0, 3), (1, 2)] {
                let off = a[p][q];
                if off * off <= negligible {
                    continue;
                }
                let ratio = (a[q][q] - a[p][p]) / (2.0 * off);
                let t = 1.0 / (libm::fabsf(ratio) + libm::sqrtf(ratio * ratio + 1.0));
                let t = if ratio < 0.0 { -t } else { t };
                let c = 1.0 / libm::sqrtf(t * t + 1.0);
                let s = t * c;
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                for rows in [&mut a, &mut v] {
                    let (x, y) = (rows[p], rows[q]);
                    rows[p] = plus(&scaled(&x, c), -s, &y);
                    rows[q] = plus(&scaled(&x, s), c, &y);
                }
            }
        }
        let mut order = [0, 1, 2, 3];
        order.sort_unstable_by(|i: &usize, j| a[*i][*i].total_cmp(&a[*j][*j]));
        [v[order[0]], v[order[1]]]
    }

    /// The inverse of a positive definite matrix, by Gauss-Jordan on the diagonal; a pivot that is too small is raised.
    fn inverse(&self) -> Self {
        let mut a = self.0;
        for k in 0..4 {
            let least = 1e-6 * self.0[k][k] + 1e-12;
            let pivot = 1.0 / if a[k][k] > least { a[k][k] } else { least };
            let row = a[k];
            for (_, other) in a.iter_mut().enumerate().filter(|(i, _)| *i != k) {
                let factor = other[k] * pivot;
                *other = plus(other, -factor, &row);
                other[k] = -factor;
            }
            a[k] = scaled(&row, pivot);
            a[k][k] = pivot;
        }
        Self(a)
    }
}

/// Looks of one yaw.
#[derive(Clone, Copy, Debug, Default)]
struct Heading {
    yaw_rad: f32,
    /// Sine and cosine of it.
    turn: (f32, f32),
    covariance: Symmetric,
    /// How many.
    count: f32,
}

type Headings = Vec<Heading, LOOKS>;

/// A hypothesis: what the looks hold.
#[derive(Clone, Copy, Debug)]
enum Paths {
    /// A direction from north, and a wavenumber.
    One([f32; 2]),
    /// Two directions from north, of one wavenumber.
    Two([f32; 2], f32),
}

impl Paths {
    fn parameters(self) -> [f32; 2] {
        match self {
            Self::One(x) | Self::Two(x, _) => x,
        }
    }

    /// Sines and cosines of the directions.
    fn azimuths(self) -> [(f32, f32); 2] {
        match self {
            Self::One([azimuth_rad, _]) => [sin_cos(azimuth_rad); 2],
            Self::Two(azimuths_rad, _) => azimuths_rad.map(sin_cos),
        }
    }

    /// The hypothesis a step further, no step longer than 0.3 rad.
    fn moved(self, step: [f32; 2]) -> Self {
        let [a, b] = step.map(|s| s.clamp(-0.3, 0.3));
        match self {
            Self::One(x) => Self::One([x[0] + a, (x[1] + b).clamp(WAVENUMBER_MIN, 1.0)]),
            Self::Two(x, wavenumber) => Self::Two([x[0] + a, x[1] + b], wavenumber),
        }
    }
}

/// A hypothesis seen from one heading. The amplitude that parameter `i` acts on is `row_i . y`, and the model changes
/// with the parameter by `tangent_i` times it, what the amplitudes can follow taken out.
struct Linear {
    row: [Vector; 2],
    tangent: [Vector; 2],
}

/// A steering vector of unit length and its derivatives.
struct Steering {
    d: Vector,
    by_azimuth: Vector,
    by_wavenumber: Vector,
}

/// Normal equations, and the power explained.
#[derive(Clone, Copy, Debug, Default)]
struct Normal {
    h: [f32; 3],
    b: [f32; 2],
    explained: f32,
}

/// The last step's yield.
struct Fit {
    /// The parameters, for the last look.
    x: [f32; 2],
    variance: [f32; 2],
    /// Mean power of each path.
    power: [f32; 2],
    /// Mean residual of a look over its variance.
    chi2: f32,
}

impl Looks {
    /// Offers a look.
    pub fn take(&self, state: &mut State, look: &Look<'_>) -> Taken {
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
        let (headings, heading_of) = headings(&state.looks);
        let solver = Solver {
            half,
            wavenumber: if cos_elevation > WAVENUMBER_MIN && cos_elevation <= 1.0 { cos_elevation } else { 1.0 },
            channel_variance: self.config.channel_sigma_rad * self.config.channel_sigma_rad,
            looks: &state.looks,
            stride: headings.len().div_ceil(HEADINGS),
            headings,
            heading_of,
        };
        Some(solver.solve(self.config.method, last))
    }

    /// One antenna of each opposite pair; `None` when there are no pairs, a channel is dead, or the mean is wanted.
    fn half(&self, state: &State) -> Option<[[f32; 2]; 2]> {
        let [[a, _], [b, _]] = self.pairs?;
        let dead = |m: usize| {
            let flagged = state.looks.iter().filter(|look| look.bearing.flags.contains(Flags::dead(m))).count();
            let power = state.looks.iter().map(|look| look.powers[m]).sum::<f32>();
            // Fading takes a channel down in some looks, not in all.
            flagged == state.looks.len() || power < 0.01 * state.looks.len() as f32
        };
        let wanted = self.config.method != Method::Mean && !(0..CHANNELS).any(dead);
        wanted.then_some([self.array.steering[a], self.array.steering[b]])
    }

    /// The mean direction of the looks' own bearings.
    fn mean(&self, state: &State, last: &Kept) -> Arrival {
        let count = state.looks.len() as f32;
        let (mut north, mut east, mut variance) = (0.0, 0.0, 0.0);
        for look in &state.looks {
            let (s, c) = sin_cos(look.bearing.azimuth_rad + look.yaw_rad);
            north += c / count;
            east += s / count;
            variance += look.bearing.sigma_rad * look.bearing.sigma_rad / count;
        }
        // What the channels do to one bearing they do to all; only the spread averages.
        let length = libm::sqrtf(north * north + east * east).max(1e-3);
        let spread = -2.0 * libm::logf(length.min(1.0)) / count;
        let azimuth_ned_rad = libm::atan2f(east, north);
        let found = Found { azimuth_ned_rad, variance: variance + spread, chi2: 0.0, reflection: None };
        let wavenumber = last.bearing.quality.wavenumber;
        let arrival = found.arrival(&state.looks, last, Method::Mean, azimuth_ned_rad, wavenumber);
        let elevation_rad = last.bearing.elevation_rad;
        Arrival { bearing: Bearing { elevation_rad, ..arrival.bearing }, ..arrival }
    }
}

/// What becomes an [`Arrival`].
struct Found {
    azimuth_ned_rad: f32,
    variance: f32,
    chi2: f32,
    reflection: Option<Reflection>,
}

impl Found {
    fn arrival(
        &self,
        looks: &Deque<Kept, LOOKS>,
        last: &Kept,
        method: Method,
        bartlett_ned_rad: f32,
        wavenumber: f32,
    ) -> Arrival {
        let sigma_rad = libm::sqrtf(self.variance);
        // Not a number is as useless as can be.
        let sigma_rad = if sigma_rad < core::f32::consts::PI { sigma_rad.max(1e-6) } else { core::f32::consts::PI };
        let azimuth_ned_rad = wrap_pi(self.azimuth_ned_rad);
        let finite = azimuth_ned_rad.is_finite();
        let mut flags = Flags::default();
        for look in looks {
            // One look's evidence of reflections, and its doubts, are what this stage is there to resolve.
            flags = flags.with(Flags(look.bearing.flags.0 & !(Flags::MULTIPATH.0 | Flags::AMBIGUOUS.0)));
        }
        if self.reflection.is_some() || (method == Method::Mean && last.bearing.flags.contains(Flags::MULTIPATH)) {
            flags = flags.with(Flags::MULTIPATH);
        }
        if !finite || sigma_rad > SIGMA_USELESS_RAD {
            flags = flags.with(Flags::AMBIGUOUS);
        }
        let useless = Flags::AMBIGUOUS.0 | Flags::UNCALIBRATED.0 | Flags::NO_SIGNAL.0;
        let azimuth_ned_rad = if finite { azimuth_ned_rad } else { 0.0 };
        Arrival {
            bearing: Bearing {
                time: last.time,
                valid: flags.0 & useless == 0,
                azimuth_rad: wrap_pi(azimuth_ned_rad - last.yaw_rad),
                sigma_rad: if finite { sigma_rad } else { core::f32::consts::PI },
                elevation_rad: libm::acosf(wavenumber.clamp(0.0, 1.0)),
                elevation_sigma_rad: last.bearing.elevation_sigma_rad,
                quality: crate::bearing::Quality { closure_chi2: self.chi2, wavenumber, ..last.bearing.quality },
                flags,
            },
            azimuth_ned_rad,
            reflection: self.reflection,
            bartlett_ned_rad: if bartlett_ned_rad.is_finite() { wrap_pi(bartlett_ned_rad) } else { 0.0 },
            method,
            looks: looks.len() as u8,
        }
    }
}

/// Gathers the looks of each yaw into one covariance, and says which heading each look is of.
fn headings(looks: &Deque<Kept, LOOKS>) -> (Headings, [u8; LOOKS]) {
    let mut headings = Headings::new();
    let mut of = [0; LOOKS];
    for (look, of) in looks.iter().zip(&mut of) {
        let same = |heading: &Heading| {
            let apart = libm::fabsf(look.yaw_rad - heading.yaw_rad);
            // Both are wrapped: north may lie between them.
            apart.min(core::f32::consts::TAU - apart) < SAME_YAW_RAD
        };
        let known = headings.iter().position(same);
        if known.is_none() {
            let turn = sin_cos(look.yaw_rad);
            let _ = headings.push(Heading { yaw_rad: look.yaw_rad, turn, ..Heading::default() });
        }
        let index = known.unwrap_or(headings.len().saturating_sub(1));
        *of = index as u8;
        if let Some(heading) = headings.get_mut(index) {
            heading.count += 1.0;
            heading.covariance.add(look.weight, &look.y.map(|c| c.re));
            heading.covariance.add(look.weight, &look.y.map(|c| c.im));
        }
    }
    (headings, of)
}

/// One answer in the making.
struct Solver<'a> {
    /// `k p` of one antenna of each pair.
    half: [[f32; 2]; 2],
    wavenumber: f32,
    channel_variance: f32,
    looks: &'a Deque<Kept, LOOKS>,
    headings: Headings,
    /// Which heading each look is of.
    heading_of: [u8; LOOKS],
    /// Every how manieth heading takes part in the start and the fit.
    stride: usize,
}

/// Steering vectors of half the circle, and Bartlett power of all of it, for each heading that takes part.
struct Scan {
    steering: [[Vector; HALF]; HEADINGS],
    power: [[f32; GRID]; HEADINGS],
}

impl Scan {
    fn steering(&self, heading: usize, i: usize) -> Vector {
        if i < HALF { self.steering[heading][i] } else { reversed(&self.steering[heading][i - HALF]) }
    }
}

impl Solver<'_> {
    fn solve(&self, method: Method, last: &Kept) -> Arrival {
        let one = self.mean();
        let gate = self.gate();
        if self.left_over(self.normal(one, self.stride).explained, self.stride) < HOPELESS * gate {
            let fit = self.finish(one);
            if fit.chi2 < gate {
                // Of three degrees of freedom for the channels' errors a look, one path takes one.
                let variance = fit.variance[0] * (fit.chi2 / 3.0).max(1.0);
                let found = Found { azimuth_ned_rad: fit.x[0], variance, chi2: fit.chi2, reflection: None };
                return found.arrival(self.looks, last, Method::OnePath, fit.x[0], fit.x[1]);
            }
        }

        let scan = self.scan();
        let bartlett_ned_rad = self.strongest(&scan);
        let resolve = |start: [f32; 2]| self.fit(Paths::Two(start, self.wavenumber));
        let music = if method == Method::Music { self.music(&scan).map(resolve) } else { None };
        let (paths, method) = match music {
            Some((paths, left)) if left < gate => (paths, Method::Music),
            other => {
                let (paths, left) = resolve(self.projection(&scan, bartlett_ned_rad));
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
        found.arrival(self.looks, last, method, bartlett_ned_rad, self.wavenumber)
    }

    /// The residual that a model may leave: noise gives one path three per look, and the channels' errors theirs.
    fn gate(&self) -> f32 {
        let count = self.looks.len() as f32;
        let calibration = self.looks.iter().map(|look| self.channel_variance * look.weight).sum::<f32>() / count;
        (1.0 - calibration) * (3.0 + NOISE_GATE * libm::sqrtf(3.0 / count)) + calibration * CALIBRATION_GATE
    }

    /// One path: the mean of the looks' own bearings and wavenumbers.
    fn mean(&self) -> Paths {
        let (mut north, mut east, mut wavenumber) = (0.0, 0.0, 0.0);
        for look in self.looks {
            let (s, c) = sin_cos(look.bearing.azimuth_rad + look.yaw_rad);
            north += c;
            east += s;
            let own = look.bearing.quality.wavenumber;
            wavenumber += if own > 0.0 { own.min(1.0) } else { 1.0 };
        }
        let wavenumber = (wavenumber / self.looks.len() as f32).clamp(WAVENUMBER_MIN, 1.0);
        Paths::One([libm::atan2f(east, north), wavenumber])
    }

    /// The headings that take part.
    fn some_headings(&self, stride: usize) -> impl Iterator<Item = &Heading> {
        self.headings.iter().step_by(stride)
    }

    /// What a look has left over, on average over those that take part, when `explained` is explained.
    fn left_over(&self, explained: f32, stride: usize) -> f32 {
        let (total, count) = self
            .some_headings(stride)
            .fold((0.0, 0.0), |(total, count), heading| (total + heading.covariance.trace(), count + heading.count));
        (total - explained) / count
    }

    fn direction(&self, heading: &Heading, (sine, cosine): (f32, f32)) -> [f32; 2] {
        let (s, c) = heading.turn;
        [cosine * c + sine * s, sine * c - cosine * s]
    }

    fn steering(&self, [cosine, sine]: [f32; 2], wavenumber: f32) -> Steering {
        let [p, q] = self.half;
        let (a, b) = (p[0] * cosine + p[1] * sine, q[0] * cosine + q[1] * sine);
        let (turned_a, turned_b) =
            (wavenumber * (p[1] * cosine - p[0] * sine), wavenumber * (q[1] * cosine - q[0] * sine));
        let ((sa, ca), (sb, cb)) = (sin_cos(wavenumber * a), sin_cos(wavenumber * b));
        let [sa, sb, ca, cb] = [sa, sb, ca, cb].map(|x| x * core::f32::consts::FRAC_1_SQRT_2);
        Steering {
            d: [ca, cb, sa, sb],
            by_azimuth: [-sa * turned_a, -sb * turned_b, ca * turned_a, cb * turned_b],
            by_wavenumber: [-sa * a, -sb * b, ca * a, cb * b],
        }
    }

    fn scan(&self) -> Scan {
        let mut scan = Scan { steering: [[[0.0; 4]; HALF]; HEADINGS], power: [[0.0; GRID]; HEADINGS] };
        for i in 0..HALF {
            let azimuth = sin_cos(i as f32 * GRID_STEP_RAD);
            for (g, heading) in self.some_headings(self.stride).enumerate().take(HEADINGS) {
                let d = self.steering(self.direction(heading, azimuth), self.wavenumber).d;
                let opposite = reversed(&d);
                scan.steering[g][i] = d;
                scan.power[g][i] = dot(&d, &heading.covariance.times(&d));
                scan.power[g][i + HALF] = dot(&opposite, &heading.covariance.times(&opposite));
            }
        }
        scan
    }

    /// The direction of most Bartlett power: the best of the grid, and the parabola through it and its neighbours.
    fn strongest(&self, scan: &Scan) -> f32 {
        let mut sum = [0.0; GRID];
        for power in &scan.power {
            for (sum, power) in sum.iter_mut().zip(power) {
                *sum += power;
            }
        }
        let best = largest(&sum);
        let (before, after) = (sum[(best + GRID - 1) % GRID], sum[(best + 1) % GRID]);
        let bend = before - 2.0 * sum[best] + after;
        let offset = if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
        (best as f32 + offset) * GRID_STEP_RAD
    }

    /// The two deepest minima of the noise subspace's spectrum; `None` with more headings than one, or one minimum.
    fn music(&self, scan: &Scan) -> Option<[f32; 2]> {
        let [heading] = self.headings.as_slice() else {
            return None;
        };
        let noise = heading.covariance.lesser_eigenvectors();
        let spectrum = |d: &Vector| {
            let (a, b) = (dot(d, &noise[0]), dot(d, &noise[1]));
            a * a + b * b
        };
        let values: [f32; GRID] = core::array::from_fn(|i| spectrum(&scan.steering(0, i)));
        let mut deepest = [(f32::MAX, 0.0); 2];
        for i in 0..GRID {
            let (before, after) = (values[(i + GRID - 1) % GRID], values[(i + 1) % GRID]);
            if !(values[i] < before && values[i] <= after) {
                continue;
            }
            let mut azimuth_rad = i as f32 * GRID_STEP_RAD;
            let mut depth = values[i];
            for _ in 0..3 {
                let steering = self.steering(self.direction(heading, sin_cos(azimuth_rad)), self.wavenumber);
                depth = spectrum(&steering.d);
                let (mut slope, mut curvature) = (0.0, 1e-6);
                for v in &noise {
                    let turn = dot(&steering.by_azimuth, v);
                    slope += turn * dot(&steering.d, v);
                    curvature += turn * turn;
                }
                azimuth_rad -= (slope / curvature).clamp(-0.5 * GRID_STEP_RAD, 0.5 * GRID_STEP_RAD);
            }
            if depth < deepest[0].0 {
                deepest = [(depth, azimuth_rad), deepest[0]];
            } else if depth < deepest[1].0 {
                deepest[1] = (depth, azimuth_rad);
            }
        }
        let found = deepest.iter().all(|(depth, _)| *depth < f32::MAX);
        found.then_some(deepest.map(|(_, azimuth_rad)| azimuth_rad))
    }

    /// From the strongest direction: the best second one beside it, then the best first one beside that, and again.
    fn projection(&self, scan: &Scan, strongest_rad: f32) -> [f32; 2] {
        let mut fixed_rad = strongest_rad;
        let (mut pair, mut most) = ([strongest_rad; 2], -1.0);
        for _ in 0..ROUNDS {
            let mut explained = [0.0; GRID];
            let azimuth = sin_cos(fixed_rad);
            for (g, heading) in self.some_headings(self.stride).enumerate().take(HEADINGS) {
                let fixed = self.steering(self.direction(heading, azimuth), self.wavenumber).d;
                let seen = heading.covariance.times(&fixed);
                let power = dot(&fixed, &seen);
                let gain = |own: f32, cosine: f32, seen: f32| {
                    power + (own + cosine * (cosine * power - 2.0 * seen)) / (1.0 - cosine * cosine).max(0.02)
                };
                for (i, d) in scan.steering[g].iter().enumerate() {
                    // Opposite directions differ in the sign of the sines.
                    let (c, s) = halves(&fixed, d);
                    let (seen_c, seen_s) = halves(&seen, d);
                    explained[i] += gain(scan.power[g][i], c + s, seen_c + seen_s);
                    explained[i + HALF] += gain(scan.power[g][i + HALF], c - s, seen_c - seen_s);
                }
            }
            let best = largest(&explained);
            let best_rad = best as f32 * GRID_STEP_RAD;
            if explained[best] > most {
                most = explained[best];
                pair = [fixed_rad, best_rad];
            }
            fixed_rad = best_rad;
        }
        pair
    }

    fn linear(&self, heading: &Heading, paths: Paths, azimuths: [(f32, f32); 2]) -> Linear {
        match paths {
            Paths::One([_, wavenumber]) => {
                let direction = self.direction(heading, azimuths[0]);
                let Steering { d, by_azimuth, by_wavenumber } = self.steering(direction, wavenumber);
                Linear { row: [d, d], tangent: [by_azimuth, by_wavenumber] }
            }
            Paths::Two(_, wavenumber) => {
                let [first, second] = azimuths.map(|a| self.steering(self.direction(heading, a), wavenumber));
                let cosine = dot(&first.d, &second.d);
                let scale = 1.0 / (1.0 - cosine * cosine).max(1e-3);
                let row = [
                    scaled(&plus(&first.d, -cosine, &second.d), scale),
                    scaled(&plus(&second.d, -cosine, &first.d), scale),
                ];
                let outside = |t: &Vector| plus(&plus(t, -dot(t, &row[0]), &first.d), -dot(t, &row[1]), &second.d);
                Linear { tangent: [outside(&first.by_azimuth), outside(&second.by_azimuth)], row }
            }
        }
    }

    fn normal(&self, paths: Paths, stride: usize) -> Normal {
        let mut sum = Normal::default();
        let azimuths = paths.azimuths();
        for heading in self.some_headings(stride) {
            let Linear { row, tangent } = self.linear(heading, paths, azimuths);
            let seen = row.map(|row| heading.covariance.times(&row));
            let (aa, ab, cc) = (dot(&row[0], &seen[0]), dot(&row[0], &seen[1]), dot(&row[1], &seen[1]));
            sum.h[0] += dot(&tangent[0], &tangent[0]) * aa;
            sum.h[1] += dot(&tangent[0], &tangent[1]) * ab;
            sum.h[2] += dot(&tangent[1], &tangent[1]) * cc;
            sum.b[0] += dot(&tangent[0], &seen[0]);
            sum.b[1] += dot(&tangent[1], &seen[1]);
            sum.explained += Gram::new(paths, &row).in_span([aa, ab, cc]);
        }
        sum
    }

    /// Damped Gauss-Newton steps (Levenberg 1944); a step that explains less is taken back and shortened. With what the
    /// result leaves over per look.
    fn fit(&self, start: Paths) -> (Paths, f32) {
        let (mut best, mut normal) = (start, self.normal(start, self.stride));
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            let [aa, ab, cc] = normal.h;
            let (aa, cc) = (aa * (1.0 + damping) + 1e-3, cc * (1.0 + damping) + 1e-3);
            let determinant = (aa * cc - ab * ab).max(1e-6);
            let [a, b] = normal.b;
            let step = [(cc * a - ab * b) / determinant, (aa * b - ab * a) / determinant];
            let trial = best.moved(step);
            let there = self.normal(trial, self.stride);
            if there.explained > normal.explained {
                (best, normal) = (trial, there);
                damping *= 0.1;
                if step[0] * step[0] + step[1] * step[1] < CLOSE_RAD * CLOSE_RAD {
                    break;
                }
            } else {
                damping = (30.0 * damping).max(0.03);
            }
        }
        (best, self.left_over(normal.explained, self.stride))
    }
}

/// Finds the power in the span of the paths' steering vectors from quadratic forms with the rows of their
/// pseudo-inverse: the Gram matrix of the vectors is the inverse of that of the rows.
struct Gram([f32; 3]);

impl Gram {
    fn new(paths: Paths, row: &[Vector; 2]) -> Self {
        if matches!(paths, Paths::One(_)) {
            return Self([1.0, 0.0, 0.0]);
        }
        let [aa, ab, cc] = [dot(&row[0], &row[0]), dot(&row[0], &row[1]), dot(&row[1], &row[1])];
        let scale = 1.0 / (aa * cc - ab * ab);
        Self([cc * scale, -2.0 * ab * scale, aa * scale])
    }

    fn in_span(&self, form: [f32; 3]) -> f32 {
        self.0[0] * form[0] + self.0[1] * form[1] + self.0[2] * form[2]
    }
}

fn largest(values: &[f32; GRID]) -> usize {
    let mut best = 0;
    for (i, value) in values.iter().enumerate() {
        if *value > values[best] {
            best = i;
        }
    }
    best
}

impl Solver<'_> {
    /// How far, in units of the turn parameter, the directions have turned at a look. With positions the parameter is
    /// the inverse range and this the way to the left of the path; without, it is the turn from look to look.
    fn levers(&self, centre: Option<Ned>, azimuths: [(f32, f32); 2], look: &Kept, index: usize) -> [f32; 2] {
        let (Some(centre), Some(position)) = (centre, look.position_ned_m) else {
            return [index as f32 - 0.5 * (self.looks.len() as f32 - 1.0); 2];
        };
        let (north, east) = (position.north - centre.north, position.east - centre.east);
        azimuths.map(|(sine, cosine)| north * sine - east * cosine)
    }

    /// Mean position, if all are known.
    fn centre(&self) -> Option<Ned> {
        let scale = 1.0 / self.looks.len() as f32;
        self.looks.iter().try_fold(Ned::default(), |sum, look| {
            let p = look.position_ned_m?;
            Some(Ned { north: sum.north + scale * p.north, east: sum.east + scale * p.east, down: 0.0 })
        })
    }

    /// One last step over four parameters: the two of `paths` and the turn of each direction.
    fn finish(&self, paths: Paths) -> Fit {
        let count = self.looks.len() as f32;
        let centre = self.centre();
        let sigma = if centre.is_some() { INVERSE_RANGE_SIGMA_PER_M } else { TURN_SIGMA_RAD };
        // Noise is half in the real and half in the imaginary part: information is twice the normal matrix.
        let precision = 0.5 / (sigma * sigma);
        let one = matches!(paths, Paths::One(_));
        let mut h = Symmetric::default();
        h.0[2][2] = precision;
        h.0[3][3] = if one { 1e9 } else { precision };
        let mut b = [0.0; 4];
        let mut channels = [[0.0; 4]; CHANNELS];
        let (mut power, mut residual, mut noise) = ([0.0; 2], 0.0, 0.0);
        let azimuths = paths.azimuths();
        for (number, heading) in self.headings.iter().enumerate() {
            let Linear { row, tangent } = self.linear(heading, paths, azimuths);
            let gram = Gram::new(paths, &row);
            let tt = [dot(&tangent[0], &tangent[0]), dot(&tangent[0], &tangent[1]), dot(&tangent[1], &tangent[1])];
            for (index, look) in self.looks.iter().enumerate() {
                if usize::from(self.heading_of[index]) != number {
                    continue;
                }
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
                residual += w * (total - gram.in_span([own[0], both, own[1]])).max(0.0);
            }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use crate::{array, bearing};
    use std::f64::consts::TAU;
    use std::vec::Vec as List;

    const WAVELENGTH: f64 = 0.345;

    /// Two-path scenes, made in f64: spherical waves from the source and from its image behind a wall.
    #[derive(Clone, Copy)]
    struct Scenes {
        reflection_db: f64,
        looks: usize,
        turn_deg: f64,
        height_deg: f64,
        snr_db: f64,
        known_positions: bool,
        /// Stretches all distances: 1000 leaves plane waves.
        scale: f64,
    }

    const SCENES: Scenes = Scenes {
        reflection_db: -6.0,
        looks: 8,
        turn_deg: 0.0,
        height_deg: 0.0,
        snr_db: 44.0,
        known_positions: false,
        scale: 1.0,
    };

    struct Scene {
        looks: List<(Phasors, f64, [f64; 2])>,
        /// True bearings from north at the last look and from the middle of the looks, and of the image at the last.
        direct: f64,
        direct_from_middle: f64,
        image: f64,
    }

    impl Scenes {
        fn draw(&self, rng: &mut Rng) -> Scene {
            let mut uniform = |low: f64, high: f64| low + (high - low) * f64::from(rng.uniform());
            let range = self.scale * uniform(5.0, 30.0);
            let azimuth = uniform(0.0, TAU);
            let source = [range * azimuth.cos(), range * azimuth.sin()];
            // A wall 1 to 15 m off, with both of us on one side of it.
            let (normal, behind) = loop {
                let (angle, distance) = (uniform(0.0, TAU), self.scale * uniform(1.0, 15.0));
                let normal = [angle.cos(), angle.sin()];
                let behind = distance - normal[0] * source[0] - normal[1] * source[1];
                if behind > 0.5 {
                    break (normal, behind);
                }
            };
            let image = [source[0] + 2.0 * behind * normal[0], source[1] + 2.0 * behind * normal[1]];
            let (course, start_yaw) = (uniform(0.0, TAU), uniform(0.0, TAU));
            let channels = [0; 4].map(|_| 1_f64.to_radians() * f64::from(rng.gaussian()));
            let sigma = (10_f64.powf(-self.snr_db / 10.0) / 2.0).sqrt();
            let amplitudes = [1.0, 10_f64.powf(self.reflection_db / 20.0)];
            let wavenumber = TAU / WAVELENGTH * self.height_deg.to_radians().cos();
            let half = 0.2 * WAVELENGTH;
            let mut position = [0.0, 0.0];
            let mut looks = List::new();
            for k in 0..self.looks {
                if k > 0 {
                    let step = WAVELENGTH * (0.25 + 0.15 * f64::from(rng.uniform()));
                    let course = course + 0.3 * f64::from(rng.gaussian());
                    position = [position[0] + step * course.cos(), position[1] + step * course.sin()];
                }
                let yaw = start_yaw + self.turn_deg.to_radians() * k as f64 / (self.looks - 1) as f64;
                let common = TAU * f64::from(rng.uniform());
                let mut z = [Complex::default(); 4];
                for ((z, channel), [forward, right]) in
                    z.iter_mut().zip(channels).zip([[half, half], [half, -half], [-half, -half], [-half, half]])
                {
                    let antenna = [
                        position[0] + forward * yaw.cos() - right * yaw.sin(),
                        position[1] + forward * yaw.sin() + right * yaw.cos(),
                    ];
                    let (mut re, mut im) = (0.0, 0.0);
                    for (from, amplitude) in [source, image].iter().zip(amplitudes) {
                        let way = ((from[0] - antenna[0]).powi(2) + (from[1] - antenna[1]).powi(2)).sqrt() - range;
                        let phase = common + channel - wavenumber * way;
                        re += amplitude * phase.cos();
                        im += amplitude * phase.sin();
                    }
                    re += sigma * f64::from(rng.gaussian());
                    im += sigma * f64::from(rng.gaussian());
                    *z = Complex { re: (1000.0 * re) as f32, im: (1000.0 * im) as f32 };
                }
                let noise = (2e6 * sigma * sigma) as f32;
                looks.push((phasors(z, noise, k as u64 * 100_000), yaw, position));
            }
            let count = looks.len() as f64;
            let middle = [0, 1].map(|axis| looks.iter().map(|look| look.2[axis]).sum::<f64>() / count);
            let from = |here: [f64; 2], to: [f64; 2]| (to[1] - here[1]).atan2(to[0] - here[0]);
            Scene {
                looks,
                direct: from(position, source),
                direct_from_middle: from(middle, source),
                image: from(position, image),
            }
        }

        /// Errors of many scenes, sorted, in degrees.
        fn run(&self, config: Config, count: usize) -> Run {
            let stage = Config { move_min_wavelengths: 0.2, ..config }.build(&array()).unwrap();
            let mut rng = Rng::new(11, 5);
            let mut run = Run::default();
            for _ in 0..count {
                let scene = self.draw(&mut rng);
                let mut state = State::default();
                let (mut north, mut east) = (0.0, 0.0);
                for (phasors, yaw, position) in &scene.looks {
                    let bearing = finder().find(phasors);
                    let azimuth = f64::from(bearing.azimuth_rad) + yaw;
                    north += azimuth.cos();
                    east += azimuth.sin();
                    let ned = Ned { north: position[0] as f32, east: position[1] as f32, down: 0.0 };
                    let look = Look {
                        phasors,
                        bearing: &bearing,
                        yaw_rad: *yaw as f32,
                        position_ned_m: self.known_positions.then_some(ned),
                    };
                    assert_eq!(stage.take(&mut state, &look), Taken::Yes);
                }
                let cosine = self.height_deg.to_radians().cos() as f32;
                let arrival = stage.solve(&state, cosine).unwrap();
                let error = degrees_apart(f64::from(arrival.azimuth_ned_rad), scene.direct);
                let last_yaw = scene.looks.last().unwrap().1;
                let body = degrees_apart(f64::from(arrival.bearing.azimuth_rad) + last_yaw, scene.direct);
                assert!((body - error).abs() < 1e-3, "{body} {error}");
                run.errors.push(error);
                run.of_the_mean.push(degrees_apart(east.atan2(north), scene.direct_from_middle));
                run.nees.push((error / f64::from(arrival.bearing.sigma_rad).to_degrees()).powi(2));
                run.alone += usize::from(arrival.reflection.is_none());
                if let Some(reflection) = arrival.reflection.filter(|_| degrees_apart(scene.direct, scene.image) > 30.0)
                {
                    run.of_the_image.push(degrees_apart(f64::from(reflection.azimuth_ned_rad), scene.image));
                    run.power_db.push(10.0 * f64::from(reflection.relative_power).log10());
                }
                run.methods.push(arrival.method);
            }
            for list in [&mut run.errors, &mut run.of_the_mean, &mut run.nees, &mut run.of_the_image, &mut run.power_db]
            {
                list.sort_by(f64::total_cmp);
            }
            run
        }
    }

    #[derive(Default)]
    struct Run {
        errors: List<f64>,
        of_the_mean: List<f64>,
        of_the_image: List<f64>,
        power_db: List<f64>,
        nees: List<f64>,
        alone: usize,
        methods: List<Method>,
    }

    impl Run {
        /// Mean of the normalised squared errors, without the largest twentieth.
        fn trimmed_nees(&self) -> f64 {
            let count = self.nees.len() * 19 / 20;
            self.nees[..count].iter().sum::<f64>() / count as f64
        }

        fn assert_sigma_is_honest(&self) {
            let nees = self.trimmed_nees();
            assert!((0.3..3.0).contains(&nees), "{nees}");
        }
    }

    fn quantile(sorted: &[f64], share: f64) -> f64 {
        sorted[((sorted.len() - 1) as f64 * share) as usize]
    }

    fn rms(values: &[f64]) -> f64 {
        (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
    }

    fn degrees_apart(a: f64, b: f64) -> f64 {
        (a - b).sin().atan2((a - b).cos()).to_degrees().abs()
    }

    fn array() -> Array {
        array::Config::default().build().unwrap()
    }

    fn finder() -> bearing::Finder {
        bearing::Config::default().build(array()).unwrap()
    }

    fn phasors(z: [Complex; 4], noise: f32, micros: u64) -> Phasors {
        Phasors {
            time: Instant(micros),
            z,
            noise: [noise; 4],
            snr_db: 20.0,
            frequency_hz: 20_000.0,
            tone: Tone::Present,
            clipped: false,
            interferer: false,
        }
    }

    /// A look at a plane wave from the nose, at time and place.
    fn offer(stage: &Looks, state: &mut State, micros: u64, position_ned_m: Option<Ned>) -> Taken {
        let z = array().steering.map(|p| {
            let (im, re) = sin_cos(p[0]);
            Complex { re, im }
        });
        let phasors = phasors(z, 1e-6, micros);
        let bearing = finder().find(&phasors);
        stage.take(state, &Look { phasors: &phasors, bearing: &bearing, yaw_rad: 0.5, position_ned_m })
    }

    #[test]
    fn a_reflection_at_minus_6_db_leaves_half_a_degree_where_averaging_leaves_two() {
        for known_positions in [false, true] {
            let run = Scenes { known_positions, ..SCENES }.run(Config::default(), 250);
            assert!(quantile(&run.errors, 0.5) <= 0.5, "{}", quantile(&run.errors, 0.5));
            assert!(quantile(&run.errors, 0.9) <= 1.8, "{}", quantile(&run.errors, 0.9));
            assert!(quantile(&run.of_the_mean, 0.5) > 3.0 * quantile(&run.errors, 0.5));
            assert!(quantile(&run.of_the_mean, 0.9) > 2.0 * quantile(&run.errors, 0.9));
            assert!(run.methods.iter().filter(|method| **method == Method::Music).count() > 200);
            run.assert_sigma_is_honest();
        }
    }

    #[test]
    fn plane_waves_four_looks_and_stronger_reflections_are_resolved_too() {
        let far = Scenes { scale: 1000.0, ..SCENES };
        let few = Scenes { looks: 4, ..SCENES };
        let strong = Scenes { reflection_db: -3.0, ..SCENES };
        let weak = Scenes { reflection_db: -20.0, ..SCENES };
        for scenes in [far, few, strong, weak] {
            let run = scenes.run(Config::default(), 250);
            assert!(quantile(&run.errors, 0.5) <= 0.6, "{}", quantile(&run.errors, 0.5));
            assert!(quantile(&run.errors, 0.9) <= 2.2, "{}", quantile(&run.errors, 0.9));
            run.assert_sigma_is_honest();
        }
    }

    #[test]
    fn the_yaw_may_turn_by_a_quarter_between_the_looks() {
        for turn_deg in [20.0, 90.0] {
            let run = Scenes { turn_deg, ..SCENES }.run(Config::default(), 250);
            assert!(quantile(&run.errors, 0.5) <= 0.6, "{}", quantile(&run.errors, 0.5));
            assert!(quantile(&run.errors, 0.9) <= 2.0, "{}", quantile(&run.errors, 0.9));
            assert!(run.methods.iter().all(|method| matches!(method, Method::Projection | Method::OnePath)));
            run.assert_sigma_is_honest();
        }
    }

    #[test]
    fn without_a_reflection_it_is_no_worse_than_averaging() {
        for (turn_deg, bound) in [(0.0, 1.2), (90.0, 1.5)] {
            let run = Scenes { reflection_db: -200.0, turn_deg, ..SCENES }.run(Config::default(), 500);
            assert!(rms(&run.errors) <= bound * rms(&run.of_the_mean), "{}", rms(&run.errors) / rms(&run.of_the_mean));
            assert!(run.alone >= 490, "{}", run.alone);
            run.assert_sigma_is_honest();
        }
    }

    #[test]
    fn a_source_above_is_one_path_and_known_height_resolves_two() {
        let above = Scenes { reflection_db: -200.0, height_deg: 30.0, ..SCENES }.run(Config::default(), 250);
        assert!(above.alone >= 245, "{}", above.alone);
        assert!(rms(&above.errors) < 0.8, "{}", rms(&above.errors));
        let reflected = Scenes { height_deg: 30.0, ..SCENES }.run(Config::default(), 250);
        assert!(quantile(&reflected.errors, 0.5) <= 0.7 && quantile(&reflected.errors, 0.9) <= 2.5);
    }

    #[test]
    fn noise_alone_may_limit_it_and_sigma_says_so() {
        for snr_db in [14.0, 24.0] {
            let run = Scenes { snr_db, ..SCENES }.run(Config::default(), 250);
            assert!(quantile(&run.errors, 0.5) < quantile(&run.of_the_mean, 0.5));
            run.assert_sigma_is_honest();
        }
    }

    #[test]
    fn the_reflection_is_reported_where_it_comes_from_and_as_strong_as_it_is() {
        let run = SCENES.run(Config::default(), 250);
        assert!(run.of_the_image.len() > 100);
        assert!(quantile(&run.of_the_image, 0.5) < 1.5, "{}", quantile(&run.of_the_image, 0.5));
        assert!((quantile(&run.power_db, 0.5) + 6.0).abs() < 0.3, "{}", quantile(&run.power_db, 0.5));
        assert!((quantile(&run.power_db, 0.1) + 6.0).abs() < 1.0 && (quantile(&run.power_db, 0.9) + 6.0).abs() < 1.0);
    }

    #[test]
    fn asked_for_projection_or_the_mean_it_does_that() {
        let projection = SCENES.run(Config { method: Method::Projection, ..Config::default() }, 250);
        assert!(projection.methods.iter().all(|method| *method != Method::Music));
        assert!(quantile(&projection.errors, 0.9) < 2.0);
        let mean = SCENES.run(Config { method: Method::Mean, ..Config::default() }, 250);
        assert!(mean.methods.iter().all(|method| *method == Method::Mean));
        assert!(quantile(&mean.errors, 0.5) > 3.0 * quantile(&projection.errors, 0.5));
    }

    #[test]
    fn an_array_without_opposite_pairs_or_with_a_dead_channel_gets_the_mean() {
        let mut odd = array::Config::default();
        odd.antennas_m[0][0] += 0.02;
        let arrays = [(odd.build().unwrap(), false), (array(), true)];
        for (array, dead) in arrays {
            let stage = Config::default().build(&array).unwrap();
            let finder = bearing::Config::default().build(array).unwrap();
            let mut state = State::default();
            for k in 0..8 {
                let (s, c) = sin_cos(0.7);
                let mut z = array.steering.map(|p| {
                    let (im, re) = sin_cos(p[0] * c + p[1] * s);
                    Complex { re, im }
                });
                if dead {
                    z[2] = Complex { re: 1e-3, im: 0.0 };
                }
                let phasors = phasors(z, 1e-6, k);
                let bearing = finder.find(&phasors);
                let look = Look { phasors: &phasors, bearing: &bearing, yaw_rad: 0.1, position_ned_m: None };
                assert_eq!(stage.take(&mut state, &look), Taken::Yes);
            }
            let arrival = stage.solve(&state, 1.0).unwrap();
            assert_eq!(arrival.method, Method::Mean);
            assert_eq!(arrival.bearing.flags.contains(Flags::dead(2)), dead);
            assert!(arrival.bearing.valid);
            assert!((arrival.bearing.azimuth_rad - 0.7).abs() < 0.01, "{arrival:?}");
            assert!((arrival.azimuth_ned_rad - 0.8).abs() < 0.01, "{arrival:?}");
        }
        // A rhombus is no square but has its pairs.
        let rhombus = array::Config { antennas_m: [[0.1, 0.0], [0.0, -0.06], [-0.1, 0.0], [0.0, 0.06]], ..odd };
        assert!(Config::default().build(&rhombus.build().unwrap()).unwrap().pairs.is_some());
    }

    #[test]
    fn a_look_is_taken_after_a_quarter_of_a_wavelength() {
        let stage = Config::default().build(&array()).unwrap();
        let mut state = State::default();
        let at = |north: f32| Some(Ned { north, ..Ned::default() });
        assert_eq!(offer(&stage, &mut state, 0, at(0.0)), Taken::Yes);
        assert_eq!(offer(&stage, &mut state, 1, at(0.080)), Taken::NotMoved);
        assert_eq!(offer(&stage, &mut state, 2, at(0.087)), Taken::Yes);
        assert_eq!(offer(&stage, &mut state, 3, at(0.080)), Taken::NotMoved);
        assert_eq!(offer(&stage, &mut state, 4, None), Taken::Yes);
        assert_eq!(state.count(), 3);
        let all = Config { move_min_wavelengths: 0.0, ..Config::default() }.build(&array()).unwrap();
        assert_eq!(offer(&all, &mut state, 5, at(0.0)), Taken::Yes);
        assert_eq!(offer(&all, &mut state, 6, at(0.0)), Taken::Yes);
    }

    #[test]
    fn an_answer_needs_enough_looks_and_old_ones_go() {
        let stage = Config { looks_max: 6, ..Config::default() }.build(&array()).unwrap();
        let mut state = State::default();
        for k in 0..10_u64 {
            assert_eq!(stage.solve(&state, 1.0).is_some(), k >= 4, "{k}");
            assert_eq!(offer(&stage, &mut state, k * 1000, None), Taken::Yes);
            assert_eq!(state.count() as u64, (k + 1).min(6));
        }
        let arrival = stage.solve(&state, 1.0).unwrap();
        assert_eq!((arrival.looks, arrival.method, arrival.bearing.time), (6, Method::OnePath, Instant(9000)));
        assert!(arrival.bearing.azimuth_rad.abs() < 1e-3 && (arrival.azimuth_ned_rad - 0.5).abs() < 1e-3);
        assert!(arrival.bearing.valid && arrival.bearing.flags == Flags::default());
        // Five seconds later only the new one is left; a clock that runs backwards empties the ring too.
        assert_eq!(offer(&stage, &mut state, 6_000_000, None), Taken::Yes);
        assert_eq!(state.count(), 1);
        assert_eq!(offer(&stage, &mut state, 5_900_000, None), Taken::Yes);
        assert_eq!(state.count(), 1);
    }

    #[test]
    fn garbage_in_is_refused_or_answered_without_nan() {
        let stage = Config { looks_min: 2, ..Config::default() }.build(&array()).unwrap();
        let mut rng = Rng::new(4, 4);
        let numbers = [0.0, 1.0, -1.0, 1e-30, 1e30, 1e9, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-4];
        let pick = |wild: f32, rng: &mut Rng| {
            if rng.uniform() < wild { numbers[(rng.uniform() * 9.99) as usize] } else { rng.gaussian() }
        };
        let (mut answers, mut refused) = (0, 0);
        for run in 0..4000 {
            let wild = [0.0, 0.02, 0.2][run % 3];
            let mut state = State::default();
            for k in 0..8 {
                let z = [0; 4].map(|_| Complex { re: pick(wild, &mut rng), im: pick(wild, &mut rng) });
                let mut phasors = phasors(z, 0.0, k);
                phasors.noise = [0; 4].map(|_| pick(wild, &mut rng));
                let phasors =
                    Phasors { noise: phasors.noise.map(|v| if wild == 0.0 { v.abs() } else { v }), ..phasors };
                let bearing = finder().find(&phasors);
                let place = Ned { north: pick(wild, &mut rng), east: pick(wild, &mut rng), down: 0.0 };
                let look = Look {
                    phasors: &phasors,
                    bearing: &bearing,
                    yaw_rad: if run % 2 == 0 { 0.3 } else { pick(wild, &mut rng) },
                    position_ned_m: (run % 5 == 0).then_some(place),
                };
                refused += usize::from(stage.take(&mut state, &look) == Taken::Unusable);
                let Some(arrival) = stage.solve(&state, pick(wild, &mut rng)) else {
                    continue;
                };
                answers += 1;
                let bearing = arrival.bearing;
                assert!(bearing.azimuth_rad.abs() <= core::f32::consts::PI, "{arrival:?}");
                assert!(arrival.azimuth_ned_rad.abs() <= core::f32::consts::PI, "{arrival:?}");
                assert!(arrival.bartlett_ned_rad.is_finite() && bearing.elevation_rad.is_finite());
                assert!(bearing.sigma_rad > 0.0 && bearing.sigma_rad <= core::f32::consts::PI, "{arrival:?}");
                if let Some(reflection) = arrival.reflection {
                    assert!(reflection.azimuth_ned_rad.is_finite());
                    assert!((0.0..=1.0).contains(&reflection.relative_power), "{arrival:?}");
                }
            }
        }
        assert!(answers > 10_000 && refused > 1000, "{answers} {refused}");
    }

    #[test]
    fn what_holds_no_tone_is_not_a_look() {
        let stage = Config::default().build(&array()).unwrap();
        let mut state = State::default();
        let silent = Phasors { tone: Tone::Absent, ..phasors([Complex { re: 1.0, im: 0.0 }; 4], 1e-6, 0) };
        let bearing = finder().find(&silent);
        let look = Look { phasors: &silent, bearing: &bearing, yaw_rad: 0.0, position_ned_m: None };
        assert_eq!(stage.take(&mut state, &look), Taken::NoTone);
        assert_eq!(state.count(), 0);
    }

    #[test]
    fn looks_beside_north_share_a_heading() {
        let mut state = State::default();
        let stage = Config::default().build(&array()).unwrap();
        for (k, yaw) in [3.138, -3.138, 3.139, -1.0].iter().enumerate() {
            let phasors = phasors([Complex { re: 1.0, im: 0.0 }; 4], 1e-6, k as u64);
            let bearing = finder().find(&phasors);
            let look = Look { phasors: &phasors, bearing: &bearing, yaw_rad: *yaw, position_ned_m: None };
            assert_eq!(stage.take(&mut state, &look), Taken::Yes);
        }
        let (headings, of) = headings(&state.looks);
        assert_eq!((headings.len(), &of[..4]), (2, &[0, 0, 0, 1][..]));
    }

    #[test]
    fn the_lesser_eigenvectors_are_those_of_a_matrix_made_from_them() {
        let mut rng = Rng::new(8, 1);
        for _ in 0..500 {
            // Gram-Schmidt in f64 on random vectors, then a matrix of known eigenvalues.
            let mut basis: List<[f64; 4]> = List::new();
            while basis.len() < 4 {
                let mut v = [0; 4].map(|_| f64::from(rng.gaussian()));
                for b in &basis {
                    let along: f64 = b.iter().zip(v).map(|(x, y)| x * y).sum();
                    v = core::array::from_fn(|i| v[i] - along * b[i]);
                }
                let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
                if length > 0.1 {
                    basis.push(v.map(|x| x / length));
                }
            }
            let small = f64::from(rng.uniform()) * 1e-3;
            let mut matrix = Symmetric::default();
            for (value, v) in [3.0, small, 0.2 + f64::from(rng.uniform()), 0.1 * small].iter().zip(&basis) {
                matrix.add(*value as f32, &v.map(|x| x as f32));
            }
            for found in matrix.lesser_eigenvectors() {
                assert!((dot(&found, &found) - 1.0).abs() < 1e-5);
                for strong in [0, 2] {
                    assert!(dot(&found, &basis[strong].map(|x| x as f32)).abs() < 1e-5, "{found:?}");
                }
            }
            let back = matrix.times(&matrix_plus_one(&matrix).inverse().times(&[1.0, 2.0, -1.0, 0.5]));
            // (M + 1)^-1 v summed with M (M + 1)^-1 v is v again.
            let sum = plus(&back, 1.0, &matrix_plus_one(&matrix).inverse().times(&[1.0, 2.0, -1.0, 0.5]));
            for (a, b) in sum.iter().zip([1.0, 2.0, -1.0, 0.5]) {
                assert!((a - b).abs() < 1e-4, "{sum:?}");
            }
        }
    }

    fn matrix_plus_one(matrix: &Symmetric) -> Symmetric {
        let mut sum = *matrix;
        for i in 0..4 {
            sum.0[i][i] += 1.0;
        }
        sum
    }

    #[test]
    fn the_normal_equations_are_the_slope_of_the_explained_power() {
        let mut rng = Rng::new(2, 9);
        let scene = Scenes { turn_deg: 60.0, ..SCENES }.draw(&mut rng);
        let stage = Config::default().build(&array()).unwrap();
        let mut state = State::default();
        for (phasors, yaw, _) in &scene.looks {
            let bearing = finder().find(phasors);
            let look = Look { phasors, bearing: &bearing, yaw_rad: *yaw as f32, position_ned_m: None };
            assert_eq!(stage.take(&mut state, &look), Taken::Yes);
        }
        let (headings, heading_of) = headings(&state.looks);
        let half = stage.half(&state).unwrap();
        let solver = Solver {
            half,
            wavenumber: 0.9,
            channel_variance: 3e-4,
            looks: &state.looks,
            headings,
            heading_of,
            stride: 1,
        };
        let step = 2e-3;
        for (a, b) in [(0.3, 2.0), (-1.0, 0.4), (2.5, -2.5)] {
            for paths in [Paths::Two([a, b], 0.9), Paths::One([a, 0.8])] {
                let normal = solver.normal(paths, 1);
                for (i, moves) in [(0, [step, 0.0]), (1, [0.0, step])] {
                    let explained = |sign: f32| solver.normal(paths.moved(moves.map(|m| sign * m)), 1).explained;
                    // The slope of |P y|^2 is twice Kaufman's right-hand side.
                    let slope = (explained(1.0) - explained(-1.0)) / (4.0 * step);
                    let scale = 1e-3 * normal.explained;
                    assert!((slope - normal.b[i]).abs() < scale, "{paths:?} {i}: {slope} {}", normal.b[i]);
                }
            }
        }
    }

    #[test]
    fn the_configuration_is_checked_by_name() {
        let refused = |config: Config| config.build(&array()).unwrap_err().field;
        let good = Config::default();
        assert_eq!(refused(Config { looks_min: 1, ..good }), "multipath.looks_min");
        assert_eq!(refused(Config { looks_max: 9, ..good }), "multipath.looks_max");
        assert_eq!(refused(Config { looks_min: 6, looks_max: 5, ..good }), "multipath.looks_max");
        assert_eq!(refused(Config { move_min_wavelengths: f32::NAN, ..good }), "multipath.move_min_wavelengths");
        assert_eq!(refused(Config { age_max_s: 0.0, ..good }), "multipath.age_max_s");
        assert_eq!(refused(Config { channel_sigma_rad: 1.0, ..good }), "multipath.channel_sigma_rad");
        assert_eq!(refused(Config { method: Method::OnePath, ..good }), "multipath.method");
    }
}
