//! How well those who walk are followed: the tracks of a flight beside the people as they are.

use std::collections::BTreeMap;

use foxhound_core::doa::bearing::Estimator;
use foxhound_core::planning::planner;
use foxhound_sim::drive::computer::HostComputer;
use foxhound_sim::drive::flight::{self, Mission, Moment};
use foxhound_sim::scenario::Scenario;

/// A track no farther from somebody than this is of him.
const NEAR_M: f64 = 0.6;
/// The speed is compared so long after somebody was first followed.
pub(super) const AFTER_S: [f64; 3] = [0.2, 0.5, 1.0];

/// What is counted of some flights.
#[derive(Default)]
pub(super) struct Following {
    /// Errors of the velocity after each of [`AFTER_S`].
    speed_errors_mps: [Vec<f64>; 3],
    /// Normalised squared errors of place and velocity, of tracks that move and were just seen; 1 is what they say of themselves.
    nees: Vec<f64>,
    /// Tracks that were just seen, and are said to move; those of them where nobody is.
    moving: usize,
    ghosts: usize,
}

impl Following {
    /// Flies past people, each on a straight line.
    pub(super) fn fly(&mut self, scenario: Scenario, seed: u64) {
        let mission =
            Mission { scenario, seed, planner: planner::Config::default(), estimator: Estimator::CrossSpectrum };
        let mut computer = HostComputer::new(&mission.guidance()).unwrap();
        let mut first_s = BTreeMap::new();
        flight::fly(&mission, &mut computer, None, |moment| {
            self.compare(&mission.scenario, moment, &mut first_s);
        })
        .unwrap();
    }

    fn compare(&mut self, scenario: &Scenario, moment: &Moment<'_>, first_s: &mut BTreeMap<usize, f64>) {
        let time_s = moment.sample.time_s;
        let tracks = moment.computer.inside().map_or(&[][..], |one| one.state().tracks().all());
        let mut is_somebody = vec![false; tracks.len()];
        for (index, person) in scenario.obstacles.iter().enumerate() {
            let [east_m, north_m] = [person.x + person.vx * time_s, person.y + person.vy * time_s];
            let errors = tracks.iter().map(|track| {
                [f64::from(track.center_ned_m.north) - north_m, f64::from(track.center_ned_m.east) - east_m]
            });
            let nearest = errors.enumerate().min_by(|(_, a), (_, b)| norm(*a).total_cmp(&norm(*b)));
            let Some((at, place_m)) = nearest.filter(|(_, error_m)| norm(*error_m) < NEAR_M) else {
                first_s.remove(&index);
                continue;
            };
            is_somebody[at] = true;
            let track = &tracks[at];
            if track.unseen_s > 0.0 {
                continue;
            }
            let speed_mps = [
                f64::from(track.velocity_ned_mps.north) - person.vy,
                f64::from(track.velocity_ned_mps.east) - person.vx,
            ];
            let known_s = time_s - *first_s.entry(index).or_insert(time_s);
            for (errors, after_s) in self.speed_errors_mps.iter_mut().zip(AFTER_S) {
                if (known_s - after_s).abs() < 0.05 {
                    errors.push(norm(speed_mps));
                }
            }
            if track.moves() {
                let [pp, pv, vv] = track.covariance.map(f64::from);
                let squared = |p: f64, v: f64| (vv * p * p - 2.0 * pv * p * v + pp * v * v) / (pp * vv - pv * pv);
                self.nees.push((squared(place_m[0], speed_mps[0]) + squared(place_m[1], speed_mps[1])) / 4.0);
            }
        }
        for (track, is_somebody) in tracks.iter().zip(is_somebody) {
            if track.moves() && track.unseen_s == 0.0 {
                self.moving += 1;
                self.ghosts += usize::from(!is_somebody);
            }
        }
    }

    /// Prints what it came to; the median errors of the velocity, and the share of moving tracks that are nobody.
    pub(super) fn told(mut self, name: &str) -> ([f64; 3], f64) {
        let medians_mps = self.speed_errors_mps.each_mut().map(|errors| median(errors));
        let nees = self.nees.iter().sum::<f64>() / self.nees.len() as f64;
        eprintln!(
            "{name}: velocity wrong by {medians_mps:.2?} m/s after {AFTER_S:?} s; NEES {nees:.2}, median {:.2}; {} of {} moving tracks \
             are nobody",
            median(&mut self.nees),
            self.ghosts,
            self.moving
        );
        (medians_mps, self.ghosts as f64 / self.moving as f64)
    }
}

fn norm([a, b]: [f64; 2]) -> f64 {
    a.hypot(b)
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
