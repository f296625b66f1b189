//! Input of a step: frames become bearings and update the source's estimate; obstacle data updates the map and the
//! guard.

use super::systems::Systems;
use super::{FrontEnd, Guidance, Input, Measurement, State, near, turning};
use crate::base::adc::AdcFrame;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Circle;
use crate::base::ownship::Ownship;
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::doa::bearing::{Bearing, BearingEstimator};
use crate::localize::link_state::{self, Classifier, Sightline};
use crate::localize::source::Sighting;
use crate::localize::source::bank::{self, Mode, Path};
use crate::mapping::scan::{Points, Refusal, Scan, Segmentation};
use crate::signal::phase::Phasors;

/// The pose at the time of a measurement is known from positions and attitudes no farther away in time than this.
const POSE_AGE_MAX_S: f32 = 0.3;
/// The classifier of reflected and direct links, with the ratio of reflected to direct links.
const CLASSIFIER: Classifier = Classifier::TRAINED;
const REFLECTED_PRIOR: f32 = 0.25;
/// Share of the weight that the leading filter must have for its reflection to be followed.
const SURE: f32 = 0.7;

/// Deliveries of obstacle sensors that did not enter the map, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refused {
    /// [`Refusal::NoOwnship`].
    pub no_ownship: u32,
    /// [`Refusal::TimesApart`].
    pub times_apart: u32,
    /// [`Refusal::Geometry`].
    pub geometry: u32,
    /// [`Refusal::Absurd`].
    pub absurd: u32,
}

impl Refused {
    /// Their sum.
    #[must_use]
    pub fn total(&self) -> u32 {
        [self.times_apart, self.geometry, self.absurd].iter().fold(self.no_ownship, |sum, n| sum.saturating_add(*n))
    }

    fn note(&mut self, taken: Result<Pose, Refusal>) {
        let count = match taken {
            Ok(_) => return,
            Err(Refusal::NoOwnship) => &mut self.no_ownship,
            Err(Refusal::TimesApart) => &mut self.times_apart,
            Err(Refusal::Geometry) => &mut self.geometry,
            Err(Refusal::Absurd) => &mut self.absurd,
        };
        *count = count.saturating_add(1);
    }
}

impl<const N: usize> Guidance<N> {
    /// The phasors of a frame that guidance must not use, as when the receiver is tested; the step of such a frame
    /// gets [`FrontEnd::Nothing`]. The tracked tone is forgotten before and after ([`Self::forget_tone`]).
    pub fn phasors(&self, state: &mut State<N>, snapshot: &AdcFrame<N>) -> Phasors {
        self.phase.step(&mut state.phase, snapshot)
    }

    /// The bearing of a frame by itself, without the frames before it: a check of a bearing measured in flight.
    pub fn bearing(&self, state: &mut State<N>, systems: &impl Systems, snapshot: &AdcFrame<N>) -> Bearing {
        systems.bearing(&self.bearing, &self.phasors(state, snapshot))
    }

    /// Tells the extractor that the next frame does not follow the ones before.
    pub fn forget_tone(&self, state: &mut State<N>) {
        state.phase.reset();
    }

    /// Frame -> phasors -> bearing: the part of a step that needs the samples. To keep the measurement, call this
    /// before the step, which then takes [`FrontEnd::Measured`].
    pub fn listen(&self, state: &mut State<N>, front_end: FrontEnd<'_, N>) -> Option<Measurement> {
        self.listen_with(state, front_end, BearingEstimator::estimate)
    }

    /// The same with another function from phasors to a bearing, see [`Systems::bearing`].
    pub fn listen_with(
        &self,
        state: &mut State<N>,
        front_end: FrontEnd<'_, N>,
        estimate: impl FnOnce(&BearingEstimator, &Phasors) -> Bearing,
    ) -> Option<Measurement> {
        match front_end {
            FrontEnd::Frame(snapshot) => {
                let phasors = self.phase.step(&mut state.phase, snapshot);
                let bearing = estimate(&self.bearing, &phasors);
                Some(Measurement { bearing, phasors: self.turning.is_some().then_some(phasors) })
            }
            FrontEnd::Measured(heard) => Some(*heard),
            FrontEnd::Bearing(bearing) => Some(Measurement { bearing, phasors: None }),
            FrontEnd::Nothing => None,
        }
    }

    /// Bearing -> direction and position of the source.
    pub(super) fn hear(&self, state: &mut State<N>, heard: &Measurement) -> Option<(Bearing, Option<f32>)> {
        let Measurement { bearing, phasors } = *heard;
        if let Some(turning) = &self.turning
            && turning.notice(&mut state.turning, &bearing)
        {
            return self.hear_by_turning(turning, state, &bearing, phasors.as_ref());
        }
        state.last_flags = bearing.flags;
        let sane =
            libm::fabsf(bearing.azimuth_rad) <= 100.0 && bearing.sigma_rad.is_finite() && bearing.sigma_rad > 0.0;
        let usable = state.ownship.filter(|_| bearing.valid && sane);
        let bearing_ned_rad = usable.map(|ownship| self.goal.observe(&mut state.goal, &bearing, &ownship));
        if let Some(ownship) = state.ownship.filter(|_| self.reflections) {
            self.classify(state, &bearing, bearing_ned_rad, &ownship);
        }
        if let (Some(ownship), Some(bearing_ned_rad)) = (usable, bearing_ned_rad) {
            self.gather(state, &bearing, bearing_ned_rad, &ownship);
        }
        Some((bearing, bearing_ned_rad))
    }

    /// Frame -> power -> rotation -> direction of the source. The link's state is unknown: it is classified from
    /// arrays only.
    fn hear_by_turning(
        &self,
        turning: &turning::Turning,
        state: &mut State<N>,
        bearing: &Bearing,
        phasors: Option<&Phasors>,
    ) -> Option<(Bearing, Option<f32>)> {
        state.reflected = 0.0;
        let ownship = state.ownship?;
        let depression_rad = state.goal.depression_rad();
        let turned = turning.step(&mut state.turning, bearing, phasors, &ownship, depression_rad)?;
        state.last_flags = turned.bearing.flags;
        let observed = Some(turned.bearing).filter(|bearing| bearing.valid);
        let bearing_ned_rad = observed.map(|bearing| self.goal.observe(&mut state.goal, &bearing, &ownship));
        if let Some(sighting) = &turned.sighting {
            self.weigh(state, sighting);
        }
        Some((turned.bearing, bearing_ned_rad))
    }

    /// Probability that the link is reflected, from the bearing or its absence.
    fn classify(&self, state: &mut State<N>, bearing: &Bearing, bearing_ned_rad: Option<f32>, ownship: &Ownship) {
        // A bearing made elsewhere has no information about its waves.
        if bearing_ned_rad.is_some() && bearing.quality.coherence.is_none() {
            state.reflected = 0.0;
            return;
        }
        let place_ned_m = ownship.position_ned_m.horizontal();
        let lines = state.active.as_ref().map_or(&[][..], |plan| &plan.lines);
        let sightline = match (lines, bearing_ned_rad) {
            ([], _) | (_, None) => Sightline::Unknown,
            (walls, Some(bearing_ned_rad)) => Sightline::among(walls, place_ned_m, bearing_ned_rad, self.slack_m),
        };
        let look = link_state::Features { place_ned_m, bearing, bearing_ned_rad, sightline };
        state.reflected = CLASSIFIER.step(&mut state.link, &look).reflected(REFLECTED_PRIOR);
    }

    /// Bearings -> sightings.
    fn gather(&self, state: &mut State<N>, bearing: &Bearing, bearing_ned_rad: f32, ownship: &Ownship) {
        let (at, place) = (bearing.time, ownship.position_ned_m.horizontal());
        let direction = Horizontal::from_bearing(bearing_ned_rad);
        let Some(sighting) = state.gathering.add(at, direction, place, bearing.sigma_rad) else { return };
        self.weigh(state, &sighting);
    }

    /// Sighting -> filters. A reflected sighting is passed on as the vehicle's mirror image would have measured it,
    /// without reflection.
    fn weigh(&self, state: &mut State<N>, sighting: &Sighting) {
        if !sighting.is_plausible() {
            return;
        }
        let lines = state.active.as_ref().map_or(&[][..], |plan| &plan.lines);
        let answer = self.source.step(&mut state.source, sighting, state.reflected, lines);
        // A reflection is worth following when its origin is known.
        let sure = |answer: &bank::Answer| answer.mode == Mode::Go && answer.share > SURE;
        let answer =
            answer.map(|answer| if sure(&answer) { answer } else { bank::Answer { path: Path::Direct, ..answer } });
        let path = answer.map_or(Path::Direct, |answer| answer.path);
        let was_direct = state.belief.is_none_or(|belief| belief.path == Path::Direct);
        // The position taken for the source was its mirror image.
        state.misled |= was_direct && path != Path::Direct;
        state.belief = answer;
        state.goal.push_sighting(path.straightened(sighting));
    }

    /// Data of obstacle sensors -> map -> near obstacles; and the coverage -> guard. The scan comes last, since it
    /// overrules the others.
    pub(super) fn look(&self, state: &mut State<N>, input: &Input<'_, N>) {
        let (now, ownship) = (input.now, state.ownship);
        let pose = |time: Instant| pose_at(ownship.as_ref(), time);
        self.map.advance(&mut state.map, now);
        self.tracks.advance(&mut state.tracks, now);
        let circles =
            input.circles.map(|circles| pose(now).and_then(|pose| self.take_circles(state, now, circles, pose)));
        let points =
            input.points.map(|points| pose(points.time).and_then(|pose| self.take_points(state, now, points, pose)));
        let scan = input.scan.map(|scan| pose(scan.time).and_then(|pose| self.take_scan(state, now, scan, pose)));
        for taken in [circles, points, scan].into_iter().flatten() {
            state.refused.note(taken);
        }
        if let Some(ownship) = &state.ownship {
            near::gather(&self.guard, &state.map, ownship.position_ned_m.horizontal(), &mut state.near);
        }
        if let Some(Ok(pose)) = circles {
            self.guard.note_circles(&mut state.guard, &state.near, &pose);
        }
        if let (Some(scan), Some(Ok(pose))) = (input.scan, scan) {
            self.guard.note_scan(&mut state.guard, scan, &pose);
        }
    }

    /// Circles -> map; returns the pose from which they were seen.
    #[inline(never)]
    fn take_circles(
        &self,
        state: &mut State<N>,
        now: Instant,
        circles: &[Circle],
        pose: Pose,
    ) -> Result<Pose, Refusal> {
        self.map.observe_circles(&mut state.map, now, pose.position_ned_m, circles)?;
        Ok(pose)
    }

    /// Scan -> circles -> map; returns the pose from which it was made.
    #[inline(never)]
    fn take_scan(&self, state: &mut State<N>, now: Instant, scan: &Scan, pose: Pose) -> Result<Pose, Refusal> {
        if scan.is_fine() {
            self.tracks.observe_rays(&mut state.tracks, scan, &pose);
        }
        self.map_scan(state, now, scan, pose)
    }

    #[inline(never)]
    fn map_scan(&self, state: &mut State<N>, now: Instant, scan: &Scan, pose: Pose) -> Result<Pose, Refusal> {
        let mut look = Segmentation::default();
        self.scan.fit_into(&mut look, scan, &pose)?;
        if !scan.is_fine() {
            self.tracks.observe(&mut state.tracks, scan, &pose, &look.points_m);
        }
        let (centers_ned_m, radius_m) = self.tracks.left_by(&state.tracks);
        self.map.vacate(&mut state.map, &centers_ned_m, radius_m);
        self.map.observe_scan(&mut state.map, now, scan, &pose, &look);
        Ok(pose)
    }

    /// Single points -> circles -> map; returns the pose from which they were seen. They do not update the coverage.
    #[inline(never)]
    fn take_points(&self, state: &mut State<N>, now: Instant, points: &Points, pose: Pose) -> Result<Pose, Refusal> {
        let mut look = Segmentation::default();
        self.scan.fit_points_into(&mut look, points, &pose)?;
        self.map.observe_points(&mut state.map, now, &look);
        Ok(pose)
    }
}

/// The pose at the time of a measurement, extrapolated from the last ownship.
///
/// # Errors
/// The pose is not known.
fn pose_at(ownship: Option<&Ownship>, time: Instant) -> Result<Pose, Refusal> {
    let ownship = ownship.ok_or(Refusal::NoOwnship)?;
    let is_apart =
        |heard: Instant| time.seconds_since(heard) > POSE_AGE_MAX_S || heard.seconds_since(time) > POSE_AGE_MAX_S;
    if is_apart(ownship.position_time) || is_apart(ownship.attitude_time) {
        return Err(Refusal::TimesApart);
    }
    let since_s = time.seconds_since(ownship.position_time);
    let moved = ownship.velocity_ned_mps.horizontal().times(since_s.clamp(0.0, 0.1));
    Ok(Pose { position_ned_m: ownship.position_ned_m.horizontal().plus(moved), yaw_rad: ownship.yaw_at(time) })
}
