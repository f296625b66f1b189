//! How well those who walk are followed: the tracks of a flight beside the people as they are.

use std::collections::BTreeMap;

use foxhound_core::doa::bearing::Estimator;
use foxhound_core::planning::planner;
use foxhound_sim::drive::computer::HostComputer;
use foxhound_sim::drive::flight::{self, Mission, Moment};
use foxhound_sim::scenario::Scenario;
use foxhound_sim::world::Pillar;

/// A track no farther from somebody than this is of him.
const NEAR_M: f64 = 0.6;
/// The speed is compared so long after somebody was first followed.
pub(super) const AFTER_S: [f64; 3] = [0.2, 0.5, 1.0];

/// What is counted of some flights.
#[derive(Default)]
pub(super) struct Following {
    /// Errors of the velocity after each of [`AFTER_S`].
    speed_errors_mps: [Vec<f64>; 3],
    /// Normalised squared errors of place and velocity, of tracks that move and were just seen, where nobody walks through another,
    /// as bodies cannot; 1 is what they say of themselves.
    nees: Vec<f64>,
    /// Tracks that were just seen, and are said to move; those of them where nobody is.
    moving: usize,
    ghosts: usize,
}

impl Following {
    /// Flies past people.
    pub(super) fn fly(&mut self, scenario: Scenario, seed: u64) {
        let mission =
            Mission { scenario, seed, planner: planner::Config::default(), estimator: Estimator::CrossSpectrum };
        let mut computer = HostComputer::new(&mission.guidance()).unwrap();
        let mut first_s = BTreeMap::new();
        flight::fly(&mission, &mut computer, None, |moment| {
            self.compare(moment, &mut first_s);
        })
        .unwrap();
    }

    fn compare(&mut self, moment: &Moment<'_>, first_s: &mut BTreeMap<usize, f64>) {
        let time_s = moment.sample.time_s;
        let tracks = moment.computer.inside().map_or(&[][..], |one| one.state().tracks().all());
        let mut is_somebody = vec![false; tracks.len()];
        let people: Vec<Pillar> = moment.world.pillars_at(time_s).collect();
        for (index, person) in people.iter().enumerate() {
            let (place, velocity) = (person.center, person.velocity_mps);
            let errors = tracks.iter().map(|track| {
                [f64::from(track.center_ned_m.north) - place.north, f64::from(track.center_ned_m.east) - place.east]
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
                f64::from(track.velocity_ned_mps.north) - velocity.north,
                f64::from(track.velocity_ned_mps.east) - velocity.east,
            ];
            let known_s = time_s - *first_s.entry(index).or_insert(time_s);
            for (errors, after_s) in self.speed_errors_mps.iter_mut().zip(AFTER_S) {
                if (known_s - after_s).abs() < 0.05 {
                    errors.push(norm(speed_mps));
                }
            }
            let is_apart = |(at, other): (usize, &Pillar)| at == index || !overlap(person, other);
            if track.moves() && people.iter().enumerate().all(is_apart) {
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

    /// Prints what it came to; the median errors of the velocity, the share of moving tracks that are nobody, and the mean
    /// normalised squared error.
    pub(super) fn told(mut self, name: &str) -> ([f64; 3], f64, f64) {
        let medians_mps = self.speed_errors_mps.each_mut().map(|errors| median(errors));
        let nees = self.nees.iter().sum::<f64>() / self.nees.len() as f64;
        eprintln!(
            "{name}: velocity wrong by {medians_mps:.2?} m/s after {AFTER_S:?} s; NEES {nees:.2}, median {:.2}; {} of {} moving tracks \
             are nobody",
            median(&mut self.nees),
            self.ghosts,
            self.moving
        );
        (medians_mps, self.ghosts as f64 / self.moving as f64, nees)
    }
}

/// Whether they are nearer than two bodies can be.
fn overlap(a: &Pillar, b: &Pillar) -> bool {
    a.center.minus(b.center).norm() < a.radius_m + b.radius_m
}

fn norm([a, b]: [f64; 2]) -> f64 {
    a.hypot(b)
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
