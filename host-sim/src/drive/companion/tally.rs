//! What a flight behind an autopilot came to, counted while it is in control.

use crate::drive::flight::{Ending, Report};
use crate::world::{Horizontal, Hull, World, wrap_pi};
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::Output;
use foxhound_core::guidance::mission::Outcome;

use super::provider::Eyes;
use super::senses::Fix;

/// Longest step that counts as time in control: more is a stall of the machine.
const STEP_MAX_S: f64 = 1.0;
/// A vehicle that has not moved by more than this for so long stands still.
const STILL_M: f64 = 0.1;
const STILL_S: f32 = 3.0;

#[derive(Debug)]
pub(super) struct Tally {
    /// Where the beacon is, if that is known.
    source: Option<Horizontal>,
    radius_m: f64,
    start: Option<Horizontal>,
    last_step: Option<Instant>,
    last_place: Option<(Instant, Horizontal)>,
    /// Where it was last, in control.
    place: Option<Horizontal>,
    hull: Option<Hull>,
    collided: bool,
    /// Where it came to a stand, and when.
    still: Option<(Instant, Horizontal)>,
    time_s: f64,
    path_length_m: f64,
    min_clearance_m: f64,
    replans: u32,
    bearing_errors: (f64, u32),
    trace_hash: u64,
}

impl Tally {
    pub(super) fn new(source: Option<Horizontal>, radius_m: f64) -> Self {
        Self {
            source,
            radius_m,
            start: None,
            last_step: None,
            last_place: None,
            place: None,
            hull: None,
            collided: false,
            still: None,
            time_s: 0.0,
            path_length_m: 0.0,
            min_clearance_m: f64::INFINITY,
            replans: 0,
            bearing_errors: (0.0, 0),
            trace_hash: 0,
        }
    }

    /// A step: where the vehicle is, and whether it is ours.
    pub(super) fn step(&mut self, now: Instant, world: &World, fix: Option<&Fix>, in_control: bool) {
        if !in_control {
            (self.last_step, self.last_place, self.hull, self.still) = (None, None, None, None);
            return;
        }
        if let Some(last) = self.last_step.replace(now) {
            self.time_s += f64::from(now.seconds_since(last)).min(STEP_MAX_S);
        }
        let Some(fix) = fix else { return };
        if self.last_place.is_some_and(|(heard, _)| heard == fix.heard) {
            return;
        }
        let place = fix.heard_at;
        self.start.get_or_insert(place);
        self.place = Some(place);
        if let Some((_, last)) = self.last_place.replace((fix.heard, place)) {
            self.path_length_m += place.minus(last).norm();
        }
        let hull = self.hull.get_or_insert_with(|| Hull::new(world, self.radius_m, place));
        self.collided |= hull.collides(world, place, 0.0);
        self.min_clearance_m = self.min_clearance_m.min(hull.min_clearance_m);
        if self.still.is_none_or(|(_, stood)| place.minus(stood).norm() > STILL_M) {
            self.still = Some((now, place));
        }
    }

    /// What guidance said in a step.
    pub(super) fn hear(&mut self, output: &Output, fix: Option<&Fix>, planned: bool) {
        self.trace_hash = output.trace_hash;
        self.replans += u32::from(planned);
        if let (Some(bearing_ned_rad), Some(fix), Some(source)) = (output.bearing_ned_rad, fix, self.source) {
            let truth_rad = source.minus(fix.place()).bearing_rad();
            let error_rad = wrap_pi(f64::from(bearing_ned_rad) - truth_rad);
            self.bearing_errors = (self.bearing_errors.0 + error_rad * error_rad, self.bearing_errors.1 + 1);
        }
    }

    pub(super) const fn collided(&self) -> bool {
        self.collided
    }

    /// Whether the vehicle has stood still for a while, in control.
    pub(super) fn is_still(&self, now: Instant) -> bool {
        self.still.is_some_and(|(since, _)| now.seconds_since(since) >= STILL_S)
    }

    /// The object that is printed.
    pub(super) fn report(&self, seed: u64, result: Ending, reason: Outcome, eyes: Eyes) -> Report {
        let (squares, bearings) = self.bearing_errors;
        let from = |place: Option<Horizontal>| Some(self.source?.minus(place?).norm());
        Report {
            name: "companion".to_owned(),
            seed,
            result,
            reason: reason.name(),
            time_s: self.time_s,
            path_length_m: self.path_length_m,
            to_beacon_m: from(self.place),
            straight_line_m: from(self.start),
            min_clearance_m: Some(self.min_clearance_m).filter(|clearance| clearance.is_finite()),
            collisions: eyes.is_simulated().then_some(u32::from(self.collided)),
            obstacles: Some(eyes.name()),
            replans: self.replans,
            bearing_rms_deg: (bearings > 0).then(|| libm::sqrt(squares / f64::from(bearings)).to_degrees()),
            trace_hash: format!("{:016x}", self.trace_hash),
            landing: None,
            expect: None,
            reference_length_m: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Obstacle, Scenario};
    use crate::world::Pose;

    fn fix(time_us: u64, north: f64) -> Fix {
        let pose = Pose { position_ned_m: [north, 0.0, -2.0], ..Pose::default() };
        Fix {
            heard: Instant(time_us),
            heard_at: Horizontal { north, east: 0.0 },
            pose,
            velocity_ned_mps: [0.0; 3],
            speed_mps: 0.0,
        }
    }

    #[test]
    fn only_what_is_flown_in_control_counts() {
        let world =
            Scenario { obstacles: vec![Obstacle { y: 5.0, r: 0.5, ..Obstacle::default() }], ..Default::default() };
        let world = world.world();
        let mut tally = Tally::new(Some(Horizontal { north: 8.0, east: 0.0 }), 0.15);
        for step in 0..=100_u64 {
            let (time_us, north) = (step * 100_000, step as f64 * 0.05);
            // Control is taken away from 3 s to 6 s.
            let in_control = !(30..60).contains(&step);
            tally.step(Instant(time_us), &world, Some(&fix(time_us, north)), in_control);
        }
        let report = tally.report(1, Ending::Collision, Outcome::Nominal, Eyes::File);
        assert!((report.time_s - 6.9).abs() < 1e-3 && (report.path_length_m - 3.45).abs() < 1e-9, "{report:?}");
        assert_eq!((report.straight_line_m, report.collisions, report.obstacles), (Some(8.0), Some(1), Some("file")));
        assert!((report.min_clearance_m.unwrap() + 0.65).abs() < 1e-9);
        let report = tally.report(1, Ending::Reached, Outcome::Nominal, Eyes::Autopilot);
        assert_eq!((report.collisions, report.obstacles), (None, Some("autopilot")), "nobody can know");
    }

    #[test]
    fn a_distance_of_which_one_end_is_unknown_is_not_told() {
        let world = Scenario::default().world();
        let known = Some(Horizontal { north: 8.0, east: 0.0 });
        for (source, flies, expected) in [(known, false, None), (None, true, None), (known, true, Some(7.0))] {
            let mut tally = Tally::new(source, 0.15);
            tally.step(Instant(0), &world, Some(&fix(0, 1.0)), flies);
            let report = tally.report(1, Ending::Timeout, Outcome::Nominal, Eyes::Autopilot);
            assert_eq!((report.to_beacon_m, report.straight_line_m), (expected, expected), "{source:?}, {flies}");
        }
    }

    #[test]
    fn a_vehicle_that_has_moved_little_for_three_seconds_stands_still() {
        let world = Scenario::default().world();
        let mut tally = Tally::new(Some(Horizontal::default()), 0.15);
        for step in 0..=30_u64 {
            assert!(!tally.is_still(Instant(step * 99_000)));
            tally.step(Instant(step * 100_000), &world, Some(&fix(step * 100_000, 0.002 * step as f64)), true);
        }
        assert!(tally.is_still(Instant(3_000_000)));
        tally.step(Instant(3_100_000), &world, Some(&fix(3_100_000, 0.2)), true);
        assert!(!tally.is_still(Instant(3_100_000)));
    }
}
