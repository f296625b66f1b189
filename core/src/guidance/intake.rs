//! Input of a step: frames become bearings and update the source's estimate; obstacle data updates the map and the
//! guard.

use super::systems::Systems;
use super::turning::Turned;
use super::{FrontEnd, Guidance, Input, Measurement, State, near, turning};
use crate::base::adc::AdcFrame;
use crate::base::obstacle::Circle;
use crate::base::ownship::{Ownship, YAW_BACK_MAX_S, YAW_FORTH_MAX_S};
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::doa::bearing::{Bearing, BearingEstimator};
use crate::mapping::scan::{self, Points, Refusal, Scan, Segmentation};
use crate::signal::phase::Phasors;

/// The position at the time of a measurement is known from one no farther away in time than this.
const POSITION_AGE_MAX_S: f32 = 0.3;

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
        let walls = &state.plans.walls;
        let ownship = state.vehicle.ownship.as_ref();
        let bearing_ned_rad = self.localizer.observe(&mut state.belief, &bearing, ownship, walls);
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
        state.belief.assume_direct();
        let ownship = state.vehicle.ownship?;
        let (bearing, bearing_ned_rad) = match turning.step(&mut state.turning, bearing, phasors, &ownship)? {
            Turned::Nothing(flags) => (Bearing::without(bearing.time, bearing.quality, flags), None),
            Turned::Direction(rotation, sighting) => {
                let (belief, walls) = (&mut state.belief, &state.plans.walls);
                self.localizer.observe_rotation(belief, &rotation, &sighting, &ownship, walls)
            }
        };
        state.last_flags = bearing.flags;
        Some((bearing, bearing_ned_rad))
    }

    /// Data of obstacle sensors -> map -> near obstacles; and the coverage -> guard. The scan comes last, since it
    /// overrules the others.
    pub(super) fn look(&self, state: &mut State<N>, input: &Input<'_, N>) {
        let (now, ownship) = (input.now, state.vehicle.ownship);
        let pose = |time: Instant| pose_at(ownship.as_ref(), time);
        state.surroundings.map.advance(now);
        state.surroundings.tracks.advance(now);
        let circles =
            input.circles.map(|circles| pose(now).and_then(|pose| Self::take_circles(state, now, circles, pose)));
        if let Some(points) = input.points {
            // What is refused is as if it had not come.
            let _ = pose(points.time).and_then(|pose| Self::take_points(state, now, points, pose));
        }
        let scan = input.scan.map(|scan| pose(scan.time).and_then(|pose| Self::take_scan(state, now, scan, pose)));
        if let Some(ownship) = &state.vehicle.ownship {
            near::gather(
                &self.guard,
                self.near_m,
                &state.surroundings.map,
                ownship.position_ned_m.horizontal(),
                &mut state.surroundings.near,
            );
        }
        if let Some(Ok(pose)) = circles {
            self.guard.note_circles(&mut state.control.guard, &state.surroundings.near, &pose);
        }
        if let (Some(scan), Some(Ok(pose))) = (input.scan, scan) {
            self.guard.note_scan(&mut state.control.guard, scan, &pose);
        }
    }

    /// Circles -> map; returns the pose from which they were seen.
    #[inline(never)]
    fn take_circles(state: &mut State<N>, now: Instant, circles: &[Circle], pose: Pose) -> Result<Pose, Refusal> {
        state.surroundings.map.observe_circles(now, pose.position_ned_m, circles)?;
        Ok(pose)
    }

    /// Scan -> circles -> map; returns the pose from which it was made.
    #[inline(never)]
    fn take_scan(state: &mut State<N>, now: Instant, scan: &Scan, pose: Pose) -> Result<Pose, Refusal> {
        if scan.is_blind() {
            return Err(Refusal::Blind);
        }
        if scan.is_fine() {
            state.surroundings.tracks.observe_rays(scan, &pose);
        }
        Self::map_scan(state, now, scan, pose)
    }

    #[inline(never)]
    fn map_scan(state: &mut State<N>, now: Instant, scan: &Scan, pose: Pose) -> Result<Pose, Refusal> {
        let mut look = Segmentation::default();
        scan::fit_into(&mut look, scan, &pose)?;
        if !scan.is_fine() {
            state.surroundings.tracks.observe(scan, &pose, &look.points_m);
        }
        let (centers_ned_m, radius_m) = state.surroundings.tracks.left_by();
        state.surroundings.map.vacate(now, &centers_ned_m, radius_m);
        state.surroundings.map.observe_scan(now, scan, &pose, &look);
        Ok(pose)
    }

    /// Single points -> circles -> map. They do not update the coverage.
    #[inline(never)]
    fn take_points(state: &mut State<N>, now: Instant, points: &Points, pose: Pose) -> Result<(), Refusal> {
        let mut look = Segmentation::default();
        scan::fit_points_into(&mut look, points, &pose)?;
        state.surroundings.map.observe_points(now, &look);
        Ok(())
    }
}

/// The pose at the time of a measurement, extrapolated from the last ownship.
///
/// # Errors
/// The pose is not known.
fn pose_at(ownship: Option<&Ownship>, time: Instant) -> Result<Pose, Refusal> {
    let ownship = ownship.ok_or(Refusal::NoOwnship)?;
    // A scan that took a turn is older than the newest position.
    let since_s = |heard: Instant| time.seconds_since(heard) - heard.seconds_since(time);
    let position_s = since_s(ownship.position_time);
    let attitude_s = since_s(ownship.attitude_time);
    if libm::fabsf(position_s) > POSITION_AGE_MAX_S || !(-YAW_BACK_MAX_S..=YAW_FORTH_MAX_S).contains(&attitude_s) {
        return Err(Refusal::TimesApart);
    }
    let moved = ownship.velocity_ned_mps.horizontal().times(position_s);
    Ok(Pose { position_ned_m: ownship.position_ned_m.horizontal().plus(moved), yaw_rad: ownship.yaw_at(time) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ned::{Horizontal, Ned};

    #[test]
    fn a_measurement_is_placed_where_the_vehicle_was_before_and_after_its_newest_position() {
        let ownship = Ownship {
            position_time: Instant(1_000_000),
            velocity_ned_mps: Ned { north: 2.0, east: -1.0, down: 0.0 },
            attitude_time: Instant(1_000_000),
            yaw_rate_radps: 1.0,
            ..Ownship::default()
        };
        for (time_us, since_s) in [(1_000_000, 0.0), (1_140_000, 0.14), (950_000, -0.05), (710_000, -0.29)] {
            let pose = pose_at(Some(&ownship), Instant(time_us)).unwrap();
            let apart = pose.position_ned_m.minus(Horizontal { north: 2.0, east: -1.0 }.times(since_s));
            assert!(apart.norm() < 1e-6 && (pose.yaw_rad - since_s).abs() < 1e-6, "{since_s}: {pose:?}");
        }
        assert_eq!(pose_at(Some(&ownship), Instant(650_000)), Err(Refusal::TimesApart));
        assert_eq!(pose_at(Some(&ownship), Instant(1_160_000)), Err(Refusal::TimesApart), "it may have turned on");
        let newer = Ownship { attitude_time: Instant(1_200_000), ..ownship };
        assert!(pose_at(Some(&newer), Instant(1_250_000)).is_ok());
        assert_eq!(pose_at(None, Instant(650_000)), Err(Refusal::NoOwnship));
    }
}
