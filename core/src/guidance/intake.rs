//! Input of a step: frames become bearings and update the source's estimate; obstacle data updates the map and the
//! guard.

use super::state::VehicleState;
use super::systems::Systems;
use super::turning::Turned;
use super::{FrontEnd, Guidance, Input, Measurement, State, near, turning};
use crate::base::adc::AdcFrame;
use crate::base::history::{FullPose, Poses};
use crate::base::ned::Horizontal;
use crate::base::obstacle::Circle;
use crate::base::ownship::{Ownship, YAW_BACK_MAX_S, YAW_FORTH_MAX_S};
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::base::units::wrap_pi;
use crate::doa::bearing::{Bearing, BearingEstimator};
use crate::landing::Stage;
use crate::mapping::scan::{self, Doubts, Points, Refusal, Scan, Segmentation};
use crate::signal::phase::Phasors;

/// The position at the time of a measurement is known from one no farther away in time than this.
const POSITION_AGE_MAX_S: f32 = 0.3;
/// A bearing later than this, as those of a radio with a computer of its own, has been measured where the vehicle was by then. For a
/// shorter delay the yaw rate is enough.
const LATE_S: f32 = 0.05;

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
        let ownship = ownship_at(&state.vehicle, bearing.time);
        let bearing_ned_rad = self.localizer.observe(&mut state.belief, &bearing, ownship.as_ref(), walls);
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
        let now = input.now;
        let vehicle = &state.vehicle;
        let pose = |time: Instant| pose_at(vehicle, time);
        let measured = |told: Instant| Instant(told.0.saturating_sub(self.lag_us.into()));
        let scan = input.scan.and_then(|scan| {
            let scan = Scan { time: measured(scan.time), ..scan.clone() };
            straightened(vehicle, scan.lasting(self.turn_s))
        });
        let from_circles = input.circles.map(|circles| (circles, pose(now)));
        let from_points = input.points.map(|points| (points, pose(measured(points.time))));
        let from_scan = scan.as_ref().map(|scan| (scan, pose(scan.time)));
        state.surroundings.map.advance(now);
        state.surroundings.tracks.advance(now);
        let circles =
            from_circles.map(|(circles, pose)| pose.and_then(|pose| Self::take_circles(state, now, circles, pose)));
        if let Some((points, pose)) = from_points {
            // What is refused is as if it had not come.
            let _ = pose.and_then(|pose| Self::take_points(state, now, points, pose));
        }
        let seen = from_scan.map(|(scan, pose)| pose.and_then(|pose| Self::take_scan(state, now, scan, pose)));
        if let Some(ownship) = &state.vehicle.ownship {
            // On the way down onto a pad it does not look around anew.
            let stage = state.arrival.landing.stage();
            if !matches!(stage, Stage::Centring | Stage::Descending | Stage::Committed | Stage::Landed) {
                state.control.guard.level(ownship.position_ned_m.down);
            }
            near::gather(
                &self.guard,
                self.stop_m + self.wind.margin_m(&state.vehicle.wind),
                &state.surroundings.map,
                ownship.position_ned_m.horizontal(),
                &mut state.surroundings.near,
            );
        }
        if let Some(Ok(pose)) = circles {
            self.guard.note_circles(&mut state.control.guard, &state.surroundings.near, &pose);
        }
        if let (Some(scan), Some(Ok(pose))) = (&scan, seen) {
            let loses_rays = state.surroundings.lost_rays.are_many();
            self.guard.note_scan(&mut state.control.guard, scan, &pose, loses_rays);
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
        state.surroundings.lost_rays.note(scan);
        if scan.is_fine() {
            let (velocity_ned_mps, doubts) = (velocity(state), doubts(state));
            state.surroundings.tracks.observe_rays(scan, &pose, velocity_ned_mps, doubts);
        }
        Self::map_scan(state, now, scan, pose)
    }

    #[inline(never)]
    fn map_scan(state: &mut State<N>, now: Instant, scan: &Scan, pose: Pose) -> Result<Pose, Refusal> {
        let mut look = Segmentation::default();
        let velocity_ned_mps = velocity(state);
        scan::fit_into(&mut look, scan, &pose, velocity_ned_mps)?;
        let doubts = doubts(state);
        if !scan.is_fine() {
            state.surroundings.tracks.observe(scan, &pose, velocity_ned_mps, &look.points_m, doubts);
        }
        let (centers_ned_m, radius_m) = state.surroundings.tracks.left_by();
        state.surroundings.map.vacate(now, &centers_ned_m, radius_m);
        state.surroundings.map.observe_scan(now, scan, &pose, &look, doubts.loses_rays);
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

/// The vehicle's velocity over the ground.
fn velocity<const N: usize>(state: &State<N>) -> Horizontal {
    state.vehicle.ownship.map_or_else(Horizontal::default, |own| own.velocity_ned_mps.horizontal())
}

/// What speaks against what the present scan shows.
fn doubts<const N: usize>(state: &State<N>) -> Doubts {
    Doubts { loses_rays: state.surroundings.lost_rays.are_many(), apart_m: state.vehicle.agreement.apart_m() }
}

/// A scan as it would be if the vehicle had not yawed while the sensor turned; `None` without an attitude.
fn straightened(vehicle: &VehicleState, scan: Scan) -> Option<Scan> {
    let ownship = vehicle.ownship.as_ref()?;
    let half_us = (0.5e6 * libm::fabsf(scan.turn_s)) as u64;
    let (begin, end) = (Instant(scan.time.0.saturating_sub(half_us)), scan.time.plus_micros(half_us));
    let yawed_rad = wrap_pi(yaw_at(ownship, &vehicle.poses, end) - yaw_at(ownship, &vehicle.poses, begin));
    scan.straightened(yawed_rad)
}

/// The pose at the time of a measurement, extrapolated from the last ownship.
///
/// # Errors
/// The pose is not known.
pub(super) fn pose_at(vehicle: &VehicleState, time: Instant) -> Result<Pose, Refusal> {
    let ownship = vehicle.ownship.as_ref().ok_or(Refusal::NoOwnship)?;
    // A scan that took a turn is older than the newest position.
    let since_s = |heard: Instant| time.seconds_since(heard) - heard.seconds_since(time);
    let position_s = since_s(ownship.position_time);
    let attitude_s = since_s(ownship.attitude_time);
    if libm::fabsf(position_s) > POSITION_AGE_MAX_S || !(-YAW_BACK_MAX_S..=YAW_FORTH_MAX_S).contains(&attitude_s) {
        return Err(Refusal::TimesApart);
    }
    let moved = ownship.velocity_ned_mps.horizontal().times(position_s);
    let yaw_rad = yaw_at(ownship, &vehicle.poses, time);
    Ok(Pose { position_ned_m: ownship.position_ned_m.horizontal().plus(moved), yaw_rad })
}

/// The vehicle when a bearing was measured; `None` where its place or its heading is not known.
#[inline(never)]
pub(super) fn ownship_at(vehicle: &VehicleState, time: Instant) -> Option<Ownship> {
    let ownship = vehicle.ownship?;
    if ownship.attitude_time.seconds_since(time) <= LATE_S {
        let is_known = pose_at(vehicle, time).is_ok();
        return is_known.then_some(ownship);
    }
    let FullPose { place_ned_m: position_ned_m, roll_rad, pitch_rad, yaw_rad } = vehicle.poses.at(time)?;
    Some(Ownship { position_ned_m, attitude_time: time, roll_rad, pitch_rad, yaw_rad, ..ownship })
}

/// The yaw between those that were heard, or beyond them by the yaw rate.
fn yaw_at(ownship: &Ownship, poses: &Poses, time: Instant) -> f32 {
    let heard = if time < ownship.attitude_time { poses.at(time) } else { None };
    heard.map_or_else(|| ownship.yaw_at(time), |pose| pose.yaw_rad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ned::Ned;

    fn of(ownship: Option<Ownship>) -> VehicleState {
        VehicleState { ownship, ..VehicleState::default() }
    }

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
            let pose = pose_at(&of(Some(ownship)), Instant(time_us)).unwrap();
            let apart = pose.position_ned_m.minus(Horizontal { north: 2.0, east: -1.0 }.times(since_s));
            assert!(apart.norm() < 1e-6 && (pose.yaw_rad - since_s).abs() < 1e-6, "{since_s}: {pose:?}");
        }
        assert_eq!(pose_at(&of(Some(ownship)), Instant(650_000)), Err(Refusal::TimesApart));
        assert_eq!(pose_at(&of(Some(ownship)), Instant(1_160_000)), Err(Refusal::TimesApart), "it may have turned on");
        let newer = Ownship { attitude_time: Instant(1_200_000), ..ownship };
        assert!(pose_at(&of(Some(newer)), Instant(1_250_000)).is_ok());
        assert_eq!(pose_at(&of(None), Instant(650_000)), Err(Refusal::NoOwnship));
    }

    #[test]
    fn a_late_bearing_belongs_to_where_the_vehicle_was_and_one_without_an_attitude_to_nowhere() {
        // It turned to the right by 0.2 rad in 0.1 s, and then stopped.
        let mut vehicle = of(None);
        for step in 0..8 {
            let time = Instant(1_000_000 + 20_000 * step);
            let position_ned_m = Ned { north: 0.02 * step as f32, ..Ned::default() };
            let yaw_rad = 0.04 * step.min(5) as f32;
            let ownship =
                Ownship { position_time: time, position_ned_m, attitude_time: time, yaw_rad, ..Ownship::default() };
            let _ = vehicle.poses.note(&ownship);
            vehicle.ownship = Some(ownship);
        }
        for (time_us, north_m, yaw_rad) in [(1_130_000, 0.14, 0.2), (1_050_000, 0.05, 0.1), (1_010_000, 0.01, 0.02)] {
            let then = ownship_at(&vehicle, Instant(time_us)).unwrap();
            let off = (then.position_ned_m.north - north_m).abs() + (then.yaw_at(Instant(time_us)) - yaw_rad).abs();
            assert!(off < 1e-5, "{time_us}: {then:?}");
        }
        for time_us in [900_000, 1_300_000] {
            assert_eq!(ownship_at(&vehicle, Instant(time_us)), None, "{time_us}");
        }
    }

    #[test]
    fn a_yaw_that_was_heard_before_counts_and_a_scan_is_straightened_by_how_it_changed() {
        // It turned to the right by 0.2 rad in 0.1 s, and then stopped: its last yaw rate does not tell.
        let mut vehicle = of(None);
        for step in 0..8 {
            let time = Instant(1_000_000 + 20_000 * step);
            let yaw_rad = 0.04 * step.min(5) as f32 + 3.0;
            let ownship = Ownship { position_time: time, attitude_time: time, yaw_rad, ..Ownship::default() };
            let _ = vehicle.poses.note(&ownship);
            vehicle.ownship = Some(ownship);
        }
        for (time_us, yaw_rad) in [(1_140_000, 3.2), (1_110_000, 3.2), (1_090_000, 3.18), (1_050_000, 3.1)] {
            let pose = pose_at(&vehicle, Instant(time_us)).unwrap();
            assert!(libm::fabsf(wrap_pi(pose.yaw_rad - yaw_rad)) < 1e-5, "{time_us}: {}", pose.yaw_rad);
        }
        let rays = (0..360).map(|_| crate::mapping::scan::Sector::Clear).collect();
        let step_rad = core::f32::consts::TAU / 360.0;
        let scan =
            Scan { time: Instant(1_050_000), turn_s: 0.1, first_azimuth_rad: -3.0, step_rad, range_max_m: 5.0, rays };
        let straight = straightened(&vehicle, scan.clone()).unwrap();
        // The first ray was measured 0.1 rad left of the heading in the middle, the last 0.1 rad right of it.
        assert!(libm::fabsf(straight.first_azimuth_rad + 3.1) < 1e-3, "{}", straight.first_azimuth_rad);
        assert!(libm::fabsf(360.0 * (straight.step_rad - step_rad) - 0.2) < 1e-4);
        let at_once = Scan { turn_s: 0.0, ..scan.clone() };
        assert_eq!(straightened(&vehicle, at_once.clone()), Some(at_once));
        assert_eq!(straightened(&of(None), scan), None);
    }
}
