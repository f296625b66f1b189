//! A bank of filters, each with its own hypothesis of where the source is, after section IV of the mmWave paper.
//!
//! A sighting has two possible paths: the source lies on its ray, or the ray was reflected by the nearest line that it
//! meets. A reflected sighting equals what the vehicle's mirror image would see directly ([`Wall::mirror`]). So each
//! filter tries both paths for a sighting and keeps the likelier one, given the probability that the link is reflected.
//! The paper has one filter for each line and switches between them. Here a filter goes on when the vehicle turns the
//! corner and the same source is suddenly seen directly: the filter with the true source predicts this sighting, the
//! filter that took the mirror image for the source does not.
//!
//! - A new filter is started, as the mirror image of the leading one, when a reflected link's ray meets a line that no
//!   filter uses. A filter without history is started when no filter explains the sightings.
//! - Weights are likelihoods with a limited memory. Filters that have become unlikely, or agree with a likelier one,
//!   are dropped; there are at most [`FILTERS`].
//! - The leading filter selects the [`Mode`], to learn or to go, from the mean of its innovations' Mahalanobis distance
//!   (the paper's switch) and from the uncertainty of its range.

use super::polar::{self, Resting};
use super::support::Support;
use super::{Estimate, FILTERS, Sighting, Update};
use crate::base::error::{ConfigError, check};
use crate::mapping::walls::Wall;

/// A filter whose log-weight is below this is dropped.
const OVER: f32 = -12.0;
/// Log-weight that a new filter starts with, relative to the leading one.
const NEWCOMER: f32 = -2.0;
/// Number of sightings in a row that no filter explains, after which a filter without history is started.
const UNEXPLAINED_MAX: u8 = 2;
/// A sighting is explained when the probability that it is not an outlier is greater than this.
const EXPLAINED: f32 = 0.5;
/// Log-likelihood of a sighting for which a hypothesis has no path.
const NOTHING: f32 = -5.0;
/// Largest range sigma over range at which a hypothesis can predict the bearing from the vehicle's mirror image, and
/// back.
const SWITCH_MAX: f32 = 0.1;
/// Memory of the mean innovation, in sightings.
const INNOVATION_MEMORY: f32 = 10.0;
/// One outlier among ten sightings does not make a filter wrong, two do.
const INNOVATION_MAX: f32 = 25.0;
/// Factor on the likelihood of a source that is seen directly although it lies behind a line.
const THROUGH: f32 = 0.05;
/// Probability of a reflected link from which on a filter for it is started.
pub(in crate::localize) const REFLECTED_MIN: f32 = 0.3;
/// Share of a log-weight that is kept from sighting to sighting.
const MEMORY: f32 = 0.98;
/// Mean squared Mahalanobis distance of the innovations above which a filter is considered wrong.
const DISTANCE_MAX: f32 = 4.0;
/// Range sigma over range above which the mode is to learn.
pub(in crate::localize) const RANGE_SIGMA_MAX: f32 = 0.3;

/// Configuration of the bank.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// The filters.
    pub polar: polar::Config,
    /// Distance beyond its known end within which a line may reflect.
    pub slack_m: f32,
}

impl Config {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self {
        polar: polar::Config { outlier_rate: 0.05, odometry_m2_per_s: 0.003, ..polar::Config::DEFAULT },
        slack_m: 0.5,
    };

    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<FilterBank, ConfigError> {
        check("source.slack_m", self.slack_m, 0.0, 10.0)?;
        Ok(FilterBank { config: *self, filter: self.polar.build()? })
    }
}

impl Default for Config {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// The configured filter bank.
///
/// ```
/// # use foxhound_core::ConfigError;
/// use foxhound_core::base::ned::Horizontal;
/// use foxhound_core::localize::source::Sighting;
/// use foxhound_core::localize::source::bank::{Config, State};
///
/// let bank = Config::default().build()?;
/// let mut state = State::new();
/// let mut found = None;
/// // Past a source 8 m north, and not at it.
/// for step in 0..60 {
///     let east = 0.1 * step as f32 - 3.0;
///     let range_m = libm::hypotf(8.0, east);
///     let sighting = Sighting {
///         place_ned_m: Horizontal { north: 0.0, east },
///         direction_ned: Horizontal { north: 8.0 / range_m, east: -east / range_m },
///         sigma_rad: 0.02,
///         since_s: 0.2,
///     };
///     found = bank.step(&mut state, &sighting, 0.0, &[]);
/// }
/// let place = found.map(|answer| answer.estimate.place_ned_m).unwrap_or_default();
/// assert!(place.minus(Horizontal { north: 8.0, east: 0.0 }).norm() < 1.0, "{place:?}");
/// # Ok::<(), ConfigError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterBank {
    config: Config,
    filter: polar::Filter,
}

/// The path by which a sighting was received.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Path {
    /// Directly from the source.
    #[default]
    Direct,
    /// By one reflection.
    Reflected(Wall),
}

impl Path {
    /// Whether two paths are the same, within the accuracy of two fits of a wall.
    fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Direct, Self::Direct) => true,
            (Self::Reflected(a), Self::Reflected(b)) => is_same(a, b),
            _ => false,
        }
    }

    /// The sighting as it would be without the reflection.
    #[must_use]
    pub fn straightened(&self, sighting: &Sighting) -> Sighting {
        match self {
            Self::Direct => *sighting,
            Self::Reflected(line) => Sighting {
                place_ned_m: line.mirror(sighting.place_ned_m),
                direction_ned: line.mirror_direction(sighting.direction_ned),
                ..*sighting
            },
        }
    }
}

/// What the vehicle should do to improve the estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Mode {
    /// Move so that the range becomes known.
    #[default]
    Learn,
    /// Fly to the source.
    Go,
}

/// The bank's result after a sighting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// The estimate of the leading filter.
    pub estimate: Estimate,
    /// The path by which it explains the sighting.
    pub path: Path,
    /// Whether it explains it at all.
    pub explained: bool,
    /// Its share of the weight.
    pub share: f32,
    /// Its normalised innovation squared, averaged over the last sightings: about one for a consistent filter.
    pub nis: f32,
    /// Recommended mode.
    pub mode: Mode,
}

/// One hypothesis: where the source is, and by which path it is received.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Hypothesis {
    filter: Resting,
    path: Path,
    log_weight: f32,
    distance: f32,
    alive: bool,
}

impl Hypothesis {
    /// Its weight, relative to another's.
    fn relative_to(&self, other: &Self) -> f32 {
        libm::expf(self.log_weight - other.log_weight)
    }
}

/// The hypotheses.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    hypotheses: [Hypothesis; FILTERS],
    unexplained: u8,
}

impl Default for State {
    fn default() -> Self {
        Self::new()
    }
}

impl State {
    /// No sighting yet.
    #[must_use]
    pub const fn new() -> Self {
        const NONE: Hypothesis =
            Hypothesis { filter: Resting::new(), path: Path::Direct, log_weight: 0.0, distance: 0.0, alive: false };
        Self { hypotheses: [NONE; FILTERS], unexplained: 0 }
    }

    /// Filters in use.
    #[must_use]
    pub fn count(&self) -> usize {
        self.alive().count()
    }

    /// Whether one of them explains what is received by a reflection.
    #[must_use]
    pub fn has_reflected(&self) -> bool {
        self.alive().any(|hypothesis| hypothesis.path != Path::Direct)
    }

    /// Gathers the places where the source may be, of all filters.
    pub fn support(&self, support: &mut Support) {
        support.clear();
        let Some(leading) = self.leading() else { return };
        let total = self.total(leading);
        for hypothesis in self.alive() {
            support.add(&hypothesis.filter, hypothesis.relative_to(leading) / total);
        }
    }

    fn alive(&self) -> impl Iterator<Item = &Hypothesis> {
        self.hypotheses.iter().filter(|hypothesis| hypothesis.alive)
    }

    /// The weight of all, relative to the leading one.
    fn total(&self, leading: &Hypothesis) -> f32 {
        self.alive().map(|hypothesis| hypothesis.relative_to(leading)).sum()
    }

    fn leading(&self) -> Option<&Hypothesis> {
        let mut leading: Option<&Hypothesis> = None;
        for hypothesis in self.alive() {
            if leading.is_none_or(|other| hypothesis.log_weight > other.log_weight) {
                leading = Some(hypothesis);
            }
        }
        leading
    }

    /// The place for a new hypothesis: an empty one, or that of the least likely.
    fn vacancy(&mut self) -> &mut Hypothesis {
        let mut at = 0;
        for (index, hypothesis) in self.hypotheses.iter().enumerate() {
            let other = &self.hypotheses[at];
            if other.alive && (!hypothesis.alive || hypothesis.log_weight < other.log_weight) {
                at = index;
            }
        }
        &mut self.hypotheses[at]
    }
}

impl FilterBank {
    /// Processes a sighting. `reflected` is the probability that the link is reflected, `lines` are the known walls.
    /// `None` when the sighting is refused, or no hypothesis is left.
    pub fn step(&self, state: &mut State, sighting: &Sighting, reflected: f32, lines: &[Wall]) -> Option<Answer> {
        if !sighting.is_plausible() {
            return None;
        }
        let reflected = if reflected > 0.0 && reflected <= 1.0 { reflected } else { 0.0 };
        let wall = self.nearest(sighting, lines);
        let mut explained = false;
        for hypothesis in state.hypotheses.iter_mut().filter(|hypothesis| hypothesis.alive) {
            explained |= self.weigh(hypothesis, sighting, reflected, wall);
        }
        self.conclude(state, sighting, explained, reflected, wall)
    }

    /// The result after all hypotheses have been updated with a sighting.
    #[inline(never)]
    fn conclude(
        &self,
        state: &mut State,
        sighting: &Sighting,
        explained: bool,
        reflected: f32,
        wall: Option<(Wall, f32)>,
    ) -> Option<Answer> {
        state.unexplained = if explained { 0 } else { state.unexplained.saturating_add(1) };
        if state.count() == 0 || state.unexplained >= UNEXPLAINED_MAX {
            self.begin_afresh(state, sighting);
        }
        if let Some((line, _)) = wall
            && reflected >= REFLECTED_MIN
        {
            Self::reflect(state, line);
        }
        settle(state);
        let leading = state.leading()?;
        let total = state.total(leading);
        let known = knows_range(&leading.filter, RANGE_SIGMA_MAX);
        let mut here = leading.filter;
        if leading.path != Path::Direct && !self.filter.predict(&mut here, sighting.place_ned_m, 0.0) {
            return None;
        }
        let estimate = here.estimate()?;
        let mode = if known && leading.distance < DISTANCE_MAX { Mode::Go } else { Mode::Learn };
        Some(Answer { estimate, path: leading.path, explained, share: 1.0 / total, nis: leading.distance, mode })
    }

    /// The nearest line that a sighting's ray meets, and its distance along the ray.
    fn nearest(&self, sighting: &Sighting, lines: &[Wall]) -> Option<(Wall, f32)> {
        let mut nearest: Option<(Wall, f32)> = None;
        for line in lines.iter().filter(|line| line.is_valid()) {
            let range_m = line.range_along_m(sighting.place_ned_m, sighting.direction_ned, self.config.slack_m);
            if let Some(range_m) = range_m.filter(|range_m| nearest.is_none_or(|(_, other)| *range_m < other)) {
                nearest = Some((*line, range_m));
            }
        }
        nearest
    }

    /// Tries both paths of a sighting on a hypothesis and keeps the likelier; returns whether that explains the
    /// sighting.
    #[inline(never)]
    fn weigh(
        &self,
        hypothesis: &mut Hypothesis,
        sighting: &Sighting,
        reflected: f32,
        wall: Option<(Wall, f32)>,
    ) -> bool {
        let direct = self.read(hypothesis, sighting, Path::Direct).map(|reading| {
            let behind = wall.is_some_and(|(_, range_m)| reading.filter.inverse_range_per_m() * range_m < 0.9);
            reading.times((1.0 - reflected) * if behind { THROUGH } else { 1.0 })
        });
        let mirrored = wall.filter(|_| reflected > 0.0).and_then(|(line, range_m)| {
            let reading = self.read(hypothesis, sighting, Path::Reflected(line))?;
            // A source that is seen by reflection cannot be nearer than the wall.
            (reading.filter.inverse_range_per_m() * range_m < 1.0).then(|| reading.times(reflected))
        });
        let (best, other) = match (direct, mirrored) {
            (Some(direct), Some(mirrored)) if mirrored.likelihood > direct.likelihood => (mirrored, direct.likelihood),
            (Some(direct), mirrored) => (direct, mirrored.map_or(0.0, |reading| reading.likelihood)),
            (None, Some(mirrored)) => (mirrored, 0.0),
            (None, None) => {
                // The sighting fits neither path: an outlier.
                hypothesis.log_weight = MEMORY * hypothesis.log_weight + NOTHING;
                return false;
            }
        };
        // The filter stays at the vehicle's mirror image as long as the sightings are reflected: a jump there and back
        // at every sighting, with an unknown range, would be too nonlinear for it.
        hypothesis.filter = best.filter;
        hypothesis.path = best.path;
        hypothesis.log_weight = MEMORY * hypothesis.log_weight + libm::logf(best.likelihood + other + 1e-30);
        let nis = if best.nis < INNOVATION_MAX { best.nis } else { INNOVATION_MAX };
        hypothesis.distance += (nis - hypothesis.distance) / INNOVATION_MEMORY;
        best.inlier > EXPLAINED
    }

    /// The hypothesis after the sighting, if it was received by this path.
    fn read(&self, hypothesis: &Hypothesis, sighting: &Sighting, path: Path) -> Option<Reading> {
        // The vehicle's mirror image is far from the vehicle. A hypothesis with an unknown range cannot predict the
        // bearing from there.
        if !knows_range(&hypothesis.filter, SWITCH_MAX) && !hypothesis.path.is_same(&path) {
            return None;
        }
        let mut filter = hypothesis.filter;
        let straight = path.straightened(sighting);
        match self.filter.step(&mut filter, &straight) {
            Update::Fused { nis, weight, likelihood } => {
                Some(Reading { filter, path, likelihood, nis, inlier: weight })
            }
            _ => None,
        }
    }

    /// Adds a hypothesis from this sighting only.
    fn begin_afresh(&self, state: &mut State, sighting: &Sighting) {
        state.unexplained = 0;
        let log_weight = state.leading().map_or(0.0, |leading| leading.log_weight + NEWCOMER);
        let mut filter = Resting::new();
        self.filter.step(&mut filter, sighting);
        *state.vacancy() = Hypothesis { filter, path: Path::Direct, log_weight, distance: 0.0, alive: true };
    }

    /// Adds the hypothesis that the leading one's source is a mirror image in this line, unless the line has one
    /// already.
    fn reflect(state: &mut State, line: Wall) {
        let used = state.alive().any(|hypothesis| hypothesis.path.is_same(&Path::Reflected(line)));
        let Some(leading) = state.leading().copied() else { return };
        if used || leading.path != Path::Direct {
            return;
        }
        let filter = leading.filter.mirrored(&line);
        let log_weight = leading.log_weight + NEWCOMER;
        *state.vacancy() =
            Hypothesis { filter, path: Path::Reflected(line), log_weight, distance: leading.distance, alive: true };
    }
}

/// A sighting interpreted as received by one path.
#[derive(Clone, Copy)]
struct Reading {
    filter: Resting,
    path: Path,
    likelihood: f32,
    nis: f32,
    inlier: f32,
}

impl Reading {
    fn times(self, prior: f32) -> Self {
        Self { likelihood: self.likelihood * prior, ..self }
    }
}

/// Whether the range's standard deviation is less than this share of the range.
fn knows_range(filter: &Resting, ratio_max: f32) -> bool {
    let sigma = ratio_max * filter.inverse_range_per_m();
    filter.covariance(1, 1) < sigma * sigma
}

/// Whether two lines are the same wall, within the accuracy of two fits.
fn is_same(a: &Wall, b: &Wall) -> bool {
    let [from, to] = b.ends_ned_m();
    libm::fabsf(a.normal_ned.dot(b.normal_ned)) > 0.9
        && libm::fabsf(a.distance_m(from)) < 0.7
        && libm::fabsf(a.distance_m(to)) < 0.7
}

/// Makes the weights relative to the leading one; drops filters that are unlikely, or agree with a likelier one.
fn settle(state: &mut State) {
    let Some(most) = state.leading().map(|leading| leading.log_weight) else { return };
    for hypothesis in state.hypotheses.iter_mut().filter(|hypothesis| hypothesis.alive) {
        hypothesis.log_weight -= most;
        hypothesis.alive = hypothesis.log_weight > OVER;
    }
    for one in 0..FILTERS {
        for other in 0..FILTERS {
            let [a, b] = [&state.hypotheses[one], &state.hypotheses[other]];
            let likelier = a.log_weight > b.log_weight || (a.log_weight == b.log_weight && one < other);
            if one != other && a.alive && b.alive && likelier && agree(&a.filter, &b.filter) {
                state.hypotheses[other].alive = false;
            }
        }
    }
}

/// Whether two filters at the same position agree: within one standard deviation of the more certain one.
fn agree(a: &Resting, b: &Resting) -> bool {
    if a.place_ned_m() != b.place_ned_m() {
        return false;
    }
    // The chord approximates the arc.
    let bearing2 = a.direction_ned().minus(b.direction_ned()).norm_squared();
    let inverse_range = a.inverse_range_per_m() - b.inverse_range_per_m();
    let least = |i: usize| {
        let [of_a, of_b] = [a.covariance(i, i), b.covariance(i, i)];
        if of_a < of_b { of_a } else { of_b }
    };
    bearing2 < least(0) && inverse_range * inverse_range < least(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ned::Horizontal;
    use crate::base::rng::Rng;

    const SIGMA_RAD: f32 = 0.03;

    fn at(north: f32, east: f32) -> Horizontal {
        Horizontal { north, east }
    }

    fn sighting(from: Horizontal, towards: Horizontal, rng: &mut Rng) -> Sighting {
        let bearing_rad = towards.minus(from).bearing_rad() + SIGMA_RAD * rng.gaussian();
        Sighting {
            place_ned_m: from,
            direction_ned: Horizontal::from_bearing(bearing_rad),
            sigma_rad: SIGMA_RAD,
            since_s: 0.1,
        }
    }

    /// Around a corner: the source is hidden, its mirror image in the wall is not; later it is seen directly.
    fn corner(seed: u64, reflected: f32) -> (Answer, Answer, Horizontal) {
        let bank = Config::DEFAULT.build().unwrap();
        let wall = Wall::between(at(8.0, -3.0), at(8.0, 14.0)).unwrap();
        let source = at(2.0, 9.0);
        let image = wall.mirror(source);
        let (mut state, mut rng) = (State::new(), Rng::new(seed, 1));
        let mut hidden = None;
        let mut seen = None;
        for k in 0..140 {
            let from = at(0.05 * k as f32 * 0.8, 0.02 * k as f32 + 0.6 * libm::fabsf(((k % 40) as f32 - 20.0) / 20.0));
            if k < 100 {
                hidden = bank.step(&mut state, &sighting(from, image, &mut rng), reflected, &[wall]);
            } else {
                seen = bank.step(&mut state, &sighting(from, source, &mut rng), 0.1, &[wall]);
            }
        }
        (hidden.unwrap(), seen.unwrap(), source)
    }

    #[test]
    fn around_the_corner_the_source_is_found_and_expected_there_when_it_comes_into_view() {
        for seed in 0..20 {
            let (hidden, seen, source) = corner(seed, 0.8);
            assert!(matches!(hidden.path, Path::Reflected(_)), "seed {seed}: {hidden:?}");
            let off = hidden.estimate.place_ned_m.minus(source);
            let [nn, ne, ee] = hidden.estimate.covariance_m2;
            let squares = ee * off.north * off.north - 2.0 * ne * off.north * off.east + nn * off.east * off.east;
            assert!(squares / (nn * ee - ne * ne) < 12.0 && off.norm() < 5.0, "seed {seed}: {hidden:?}");
            assert_eq!(seen.path, Path::Direct);
            assert!(seen.estimate.place_ned_m.minus(source).norm() < 1.5, "seed {seed}: {seen:?}");
            assert!(seen.share > 0.9, "seed {seed}: {seen:?}");
        }
    }

    #[test]
    fn told_that_the_link_is_direct_it_believes_in_the_image_until_it_sees_better() {
        let (hidden, seen, source) = corner(1, 0.0);
        assert_eq!(hidden.path, Path::Direct);
        assert!(hidden.estimate.place_ned_m.minus(at(14.0, 9.0)).norm() < 4.0, "{hidden:?}");
        assert!(seen.estimate.bearing_ned_rad - source.minus(at(5.56, 2.78)).bearing_rad() < 0.1, "{seen:?}");
    }

    #[test]
    fn outliers_are_outlived_and_there_are_never_too_many_filters() {
        let bank = Config { polar: polar::Config { outlier_rate: 0.4, ..Config::DEFAULT.polar }, ..Config::DEFAULT };
        let bank = bank.build().unwrap();
        let lines =
            [Wall::between(at(9.0, -5.0), at(9.0, 5.0)).unwrap(), Wall::between(at(-5.0, 6.0), at(9.0, 6.0)).unwrap()];
        let source = at(6.0, 3.0);
        let (mut state, mut rng) = (State::new(), Rng::new(3, 1));
        let mut answer = None;
        for k in 0..300 {
            let from = at(0.01 * k as f32, libm::fabsf((k % 60) as f32 - 30.0) / 30.0);
            let towards = if rng.uniform() < 0.4 {
                from.plus(Horizontal::from_bearing(core::f32::consts::TAU * rng.uniform()))
            } else {
                source
            };
            answer = bank.step(&mut state, &sighting(from, towards, &mut rng), 0.4, &lines);
            assert!(state.count() >= 1 && state.count() <= FILTERS);
        }
        let estimate = answer.unwrap().estimate;
        assert!(estimate.place_ned_m.minus(source).norm() < 0.7, "{estimate:?}");
    }

    #[test]
    fn the_switch_says_learn_on_a_straight_run_and_go_after_a_turn_aside() {
        let bank = Config::DEFAULT.build().unwrap();
        let source = at(12.0, 0.0);
        let run = |aside: f32| {
            let (mut state, mut rng) = (State::new(), Rng::new(4, 1));
            let steps = (0..60).map(|k| at(0.1 * k as f32, aside * libm::fabsf((k % 30) as f32 - 15.0) / 15.0));
            let answers = steps.map(|from| bank.step(&mut state, &sighting(from, source, &mut rng), 0.0, &[]));
            answers.last().flatten().unwrap().mode
        };
        assert_eq!(run(0.0), Mode::Learn);
        assert_eq!(run(1.5), Mode::Go);
    }
}
