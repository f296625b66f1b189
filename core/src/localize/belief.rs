//! The belief about the source: everything that the bearings have shown, and the only place where later stages ask.
//!
//! Bearings are averaged ([`goal`]) and gathered into sightings ([`gathering`]); the link is classified as direct or
//! reflected ([`link_state`]); a bank of filters estimates the source's position from the sightings ([`bank`]), and in
//! the last metres one filter from the bearings ([`near`]).
//!
//! [`goal`]: crate::localize::goal
//! [`gathering`]: crate::localize::source::gather

use crate::base::error::ConfigError;
use crate::base::history::FullPose;
use crate::base::ned::Horizontal;
use crate::base::ownship::Ownship;
use crate::base::time::Instant;
use crate::doa::bearing::Bearing;
use crate::doa::rotating::Rotation;
use crate::localize::goal;
use crate::localize::link_state::{self, Classifier, Sightline};
use crate::localize::source::bank::{self, Answer, Mode, Path};
use crate::localize::source::gather::Gathering;
use crate::localize::source::near::{self, Fix};
use crate::localize::source::support::Support;
use crate::localize::source::{Estimate, Sighting};
use crate::mapping::walls::Wall;

/// The classifier of reflected and direct links, with the ratio of reflected to direct links.
const CLASSIFIER: Classifier = Classifier::TRAINED;
const REFLECTED_PRIOR: f32 = 0.25;
/// Share of the weight that the leading filter must have for its reflection to be followed.
const SURE: f32 = 0.7;

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Localizer {
    bank: bank::FilterBank,
    /// Whether the last metres matter.
    near: bool,
    reflections: bool,
    slack_m: f32,
}

/// What reflections have been good for since control was given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Reflections {
    /// None was supposed so far.
    #[default]
    None,
    /// The source of a reflection was among the hypotheses at least once.
    Supposed,
    /// That led nowhere: every link counts as direct.
    Doubted,
}

/// The belief, kept from bearing to bearing.
#[derive(Clone, Debug, Default)]
pub struct State {
    average: goal::State,
    gathering: Gathering,
    link: link_state::State,
    /// Probability that the link is reflected, as of the last bearing.
    reflected: f32,
    /// Probability that it is reflected once or more often.
    indirect: f32,
    reflections: Reflections,
    bank: bank::State,
    /// The bank's last answer.
    answer: Option<Answer>,
    near: near::State,
}

impl Localizer {
    /// The stage of its filters' configurations; `near` is whether the last metres are estimated,
    /// `reflections` whether reflections are considered.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(bank: &bank::Config, near: bool, reflections: bool) -> Result<Self, ConfigError> {
        Ok(Self { bank: bank.build()?, near, reflections, slack_m: bank.slack_m })
    }

    /// Processes an array's bearing, usable or not; returns its direction from north, clockwise, if it is usable.
    /// `walls` are those known.
    pub fn observe(
        &self,
        state: &mut State,
        bearing: &Bearing,
        ownship: Option<&Ownship>,
        walls: &[Wall],
    ) -> Option<f32> {
        let sane =
            libm::fabsf(bearing.azimuth_rad) <= 100.0 && bearing.sigma_rad.is_finite() && bearing.sigma_rad > 0.0;
        let ownship = ownship?;
        let bearing_ned_rad = (bearing.valid && sane).then(|| state.average.observe(bearing, ownship));
        if self.reflections {
            self.classify(state, bearing, bearing_ned_rad, ownship, walls);
        }
        if let Some(bearing_ned_rad) = bearing_ned_rad {
            let place_ned_m = ownship.position_ned_m.horizontal();
            let direction_ned = Horizontal::from_bearing(bearing_ned_rad);
            if let Some(sighting) =
                state.gathering.add(bearing, direction_ned, place_ned_m, state.reflections == Reflections::Supposed)
            {
                self.add(state, &sighting, walls);
            }
        }
        bearing_ned_rad
    }

    /// Processes the rotation of an antenna that turns with the vehicle: `sighting` is its direction, from the middle
    /// of the rotation. It says nothing about reflections. Returns the source's bearing as of now, and its direction
    /// from north, clockwise, if it is usable: by the filter that explains the rotation, or else by the rotation alone.
    pub fn observe_rotation(
        &self,
        state: &mut State,
        rotation: &Rotation,
        sighting: &Sighting,
        ownship: &Ownship,
        walls: &[Wall],
    ) -> (Bearing, Option<f32>) {
        self.add(state, sighting, walls);
        let explaining = state.answer.filter(|answer| answer.explained);
        let from_here = |answer: Answer| answer.estimate.bearing_from(ownship.position_ned_m.horizontal());
        let (bearing_ned_rad, sigma_rad) =
            explaining.and_then(from_here).unwrap_or((rotation.bearing_ned_rad, sighting.sigma_rad));
        let joined = Rotation { bearing_ned_rad, sigma_rad, retained: 0.0, ..*rotation };
        let bearing = joined.bearing(ownship, state.average.depression_rad());
        let usable = bearing.valid.then(|| state.average.observe(&bearing, ownship));
        (bearing, usable)
    }

    /// The source's position in the last metres, with a bearing and the pose in which it was measured, if there is one.
    /// `pose` is the vehicle's present one, `height_m` its height over the ground.
    pub fn observe_near(
        &self,
        state: &mut State,
        now: Instant,
        bearing: Option<(&Bearing, FullPose)>,
        pose: &FullPose,
        height_m: Option<f32>,
    ) -> Option<Fix> {
        if !self.near {
            return None;
        }
        if let Some((bearing, pose)) = bearing.filter(|_| !state.is_reflected()) {
            state.near.hear(bearing, &pose, height_m);
        }
        if let Some(estimate) = state.direct() {
            state.near.suggest(&estimate, pose, height_m);
        }
        state.near.fix(now, pose.place_ned_m)
    }

    /// Probability that the link is reflected, from a bearing or its absence.
    fn classify(
        &self,
        state: &mut State,
        bearing: &Bearing,
        bearing_ned_rad: Option<f32>,
        ownship: &Ownship,
        walls: &[Wall],
    ) {
        // A bearing made elsewhere has no information about its waves.
        let is_made_elsewhere = bearing_ned_rad.is_some() && bearing.quality.coherence.is_none();
        if is_made_elsewhere || state.reflections == Reflections::Doubted {
            return state.assume_direct();
        }
        let place_ned_m = ownship.position_ned_m.horizontal();
        let sightline = match (walls, bearing_ned_rad) {
            ([], _) | (_, None) => Sightline::Unknown,
            (walls, Some(bearing_ned_rad)) => Sightline::among(walls, place_ned_m, bearing_ned_rad, self.slack_m),
        };
        let features = link_state::Features { place_ned_m, bearing, bearing_ned_rad, sightline };
        let estimate = CLASSIFIER.step(&mut state.link, &features);
        state.reflected = estimate.reflected(REFLECTED_PRIOR);
        state.indirect = estimate.indirect(REFLECTED_PRIOR);
    }

    /// Sighting -> filters.
    fn add(&self, state: &mut State, sighting: &Sighting, walls: &[Wall]) {
        if !sighting.is_plausible() {
            return;
        }
        let answer = self.bank.step(&mut state.bank, sighting, state.reflected, walls);
        // A reflection is worth following when its origin is known.
        let sure = |answer: &Answer| answer.mode == Mode::Go && answer.share > SURE;
        state.answer =
            answer.map(|answer| if sure(&answer) { answer } else { Answer { path: Path::Direct, ..answer } });
        if state.bank.has_reflected() {
            state.reflections = Reflections::Supposed;
        }
    }
}

impl State {
    /// Nothing has been received yet.
    #[inline(never)]
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// The averaged bearing of the source from north, clockwise; `None` before the first valid one.
    #[must_use]
    pub fn bearing_ned_rad(&self) -> Option<f32> {
        self.average.source_bearing_ned_rad()
    }

    /// When the last valid bearing was measured.
    #[must_use]
    pub fn updated(&self) -> Option<Instant> {
        self.average.updated()
    }

    /// The estimated position of a source that is received directly, as uncertain as the innovations say; `None` while
    /// the link is probably reflected, once or more often, though the filters know of no line that reflects it.
    #[must_use]
    pub fn direct(&self) -> Option<Estimate> {
        let answer = self.answer.filter(|answer| answer.path == Path::Direct && self.indirect < bank::REFLECTED_MIN)?;
        Some(answer.estimate.scaled(answer.nis))
    }

    /// The direction of the origin of a reflected signal, from a place; `None` for a direct one.
    #[must_use]
    pub fn around_the_corner(&self, from_ned_m: Horizontal) -> Option<Horizontal> {
        let answer = self.answer.filter(|answer| answer.path != Path::Direct)?;
        let towards = answer.estimate.place_ned_m.minus(from_ned_m);
        let norm = towards.norm();
        (norm > 1e-3).then(|| towards.times(1.0 / norm))
    }

    /// Weight of the leading filter, and its averaged normalised innovation squared.
    #[must_use]
    pub fn share_and_nis(&self) -> Option<(f32, f32)> {
        self.answer.map(|answer| (answer.share, answer.nis))
    }

    /// Whether the link is probably reflected.
    #[must_use]
    pub fn is_reflected(&self) -> bool {
        self.reflected >= bank::REFLECTED_MIN
    }

    /// The estimate of the source while its range is too uncertain to fly there.
    #[must_use]
    pub fn vague(&self) -> Option<&Estimate> {
        let estimate = &self.answer.as_ref()?.estimate;
        (estimate.range_sigma_ratio > bank::RANGE_SIGMA_MAX).then_some(estimate)
    }

    /// The source could not be reached. If a reflection may have misled to it, all that was concluded from reflections is
    /// forgotten, none is assumed any more, and this is true.
    pub fn doubt_reflections(&mut self) -> bool {
        let may_mislead = self.reflections == Reflections::Supposed;
        // From now on, that it does not start again by itself.
        self.reflections = Reflections::Doubted;
        if may_mislead {
            (self.bank, self.answer) = (bank::State::default(), None);
            self.assume_direct();
        }
        may_mislead
    }

    /// As a wave that comes by a wall does, where reflections are not doubted.
    #[cfg(test)]
    pub(crate) fn suppose_reflections(&mut self) {
        if self.reflections != Reflections::Doubted {
            self.reflections = Reflections::Supposed;
        }
    }

    /// Control was given back: reflections count again.
    pub fn trust_reflections(&mut self) {
        self.reflections = Reflections::None;
    }

    /// The link counts as direct: nothing is known about it, or reflections are doubted.
    pub fn assume_direct(&mut self) {
        self.reflected = 0.0;
        self.indirect = 0.0;
    }

    /// The position has jumped: the fix of the last metres is shifted.
    pub fn shift_near(&mut self, by: Horizontal) {
        self.near.shift(by);
    }

    /// The last metres are estimated anew.
    pub fn forget_near(&mut self) {
        self.near = near::State::default();
    }

    /// Gathers the places where the source may be.
    pub fn support(&self, support: &mut Support) {
        self.bank.support(support);
    }
}
