//! Bends the path where no obstacle does and the range is unknown: bearings determine the range only when the vehicle
//! moves across the line of sight.
//!
//! The belief-space planner ([`crate::planning::ilqr`]) plans a path of up to six metres towards the estimated source,
//! at most a tenth longer than the straight one, that reduces the covariance of the source's position most. Its first
//! two metres are flown; where an obstacle is near it is not asked.

use super::{Learn, PlanRequest};
use crate::base::error::ConfigError;
use crate::base::obstacle::Obstacle;
use crate::planning::ilqr::{self, Guess, Outcome, Problem};
use crate::planning::rollout::{SPACING_M, Trajectory, WAYPOINTS};

/// Steps of a bent path.
const STEPS: usize = 20;
/// The bent path ends at this share of the estimated range, and at most at this distance.
const SHARE: f32 = 0.6;
const LENGTH_MAX_M: f32 = 6.0;
/// Smallest and largest estimated range at which the path is bent.
const RANGE_M: [f32; 2] = [3.0, 60.0];
/// Largest extra length, as a share of the straight path.
const STRETCH: f32 = 0.1;
/// Sideways deviation of the first guess, as a share of its length.
const SWING: f32 = 0.15;
/// Largest sum of the variances that is used: a linear filter does not represent larger ones.
const VARIANCE_MAX_M2: f32 = 25.0;

/// The belief-space planner for this use; `stride_m` is its longest step.
fn planner(stride_m: f32, bearing_sigma_rad: f32) -> Result<ilqr::Planner, ConfigError> {
    ilqr::Config {
        q_terminal: 200.0,
        r_control: 1.0,
        t_covariance: [0.5, 0.0],
        u_max_m: stride_m,
        bearing_sigma_rad,
        iterations_max: 10,
        ..ilqr::Config::default()
    }
    .build()
}

/// The first two metres of a bent path, if there is one.
#[inline(never)]
pub(super) fn bend(request: &PlanRequest, learn: &Learn, obstacles: &[Obstacle]) -> Option<Trajectory> {
    let start = request.start_ned_m;
    let to = learn.source_ned_m.minus(start);
    let range_m = to.norm();
    if !(range_m > RANGE_M[0] && range_m < RANGE_M[1]) {
        return None;
    }
    let share = SHARE * range_m;
    let length_m = if share < LENGTH_MAX_M { share } else { LENGTH_MAX_M };
    let planner = planner(length_m / STEPS as f32 * (1.0 + STRETCH), learn.sigma_rad).ok()?;
    let trace = learn.covariance_m2[0] + learn.covariance_m2[2];
    let scale = if trace > VARIANCE_MAX_M2 { VARIANCE_MAX_M2 / trace } else { 1.0 };
    let side = if request.seed & 1 == 0 { 1.0 } else { -1.0 };
    let mut workspace = ilqr::Workspace::<3, STEPS>::new();
    let solution = planner.solve(
        &mut workspace,
        &Problem {
            start_ned_m: start,
            source_ned_m: learn.source_ned_m,
            covariance_m2: learn.covariance_m2.map(|entry| entry * scale),
            goal_ned_m: start.plus(to.times(length_m / range_m)),
            steps: STEPS,
            obstacles,
            seen_through: None,
            guess: Guess::Bow(side * SWING * length_m),
        },
    );
    if !matches!(solution.outcome, Outcome::Converged | Outcome::CapReached) {
        return None;
    }
    let mut waypoints = [start; WAYPOINTS];
    let (mut at, mut left_m, mut filled) = (start, SPACING_M, 0);
    for step in solution.path {
        let mut leg = step.place_ned_m.minus(at);
        let mut leg_m = leg.norm();
        while leg_m >= left_m
            && let Some(waypoint) = waypoints.get_mut(filled)
        {
            at = at.plus(leg.times(left_m / leg_m));
            *waypoint = at;
            (filled, left_m) = (filled + 1, SPACING_M);
            leg = step.place_ned_m.minus(at);
            leg_m = leg.norm();
        }
        (at, left_m) = (step.place_ned_m, left_m - leg_m);
    }
    // A path shorter than two metres stays at its end.
    waypoints.get_mut(filled..)?.fill(at);
    (filled > WAYPOINTS / 2 && waypoints.iter().all(|place| place.is_finite())).then_some(waypoints)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ned::Horizontal;

    fn learn(sigma_m: f32) -> Learn {
        Learn {
            source_ned_m: Horizontal { north: 12.0, east: 0.0 },
            covariance_m2: [sigma_m * sigma_m, 0.0, 0.05],
            sigma_rad: 0.02,
        }
    }

    #[test]
    fn a_vague_range_bends_the_way_by_a_tenth_at_most_and_a_known_one_hardly() {
        for seed in 0..2_u64 {
            let request = PlanRequest { seed, ..PlanRequest::default() };
            let aside = |sigma_m: f32| {
                let path = bend(&request, &learn(sigma_m), &[]).unwrap();
                let mut length_m = 0.0;
                for pair in path.windows(2) {
                    length_m += pair[1].minus(pair[0]).norm();
                    assert!((pair[1].minus(pair[0]).norm() - SPACING_M).abs() < 0.02, "{path:?}");
                }
                assert!(path[14].north > 0.7 * length_m, "{path:?}");
                path[14].east
            };
            let (vague, known) = (aside(5.0), aside(0.1));
            assert!(vague.abs() > 0.3 && vague.abs() > 3.0 * known.abs(), "{vague} {known}");
            assert_eq!(vague > 0.0, seed == 0);
        }
    }

    #[test]
    fn what_is_near_far_or_no_number_is_not_bent_to() {
        for north in [1.0, 100.0, f32::NAN, f32::INFINITY] {
            let learn = Learn { source_ned_m: Horizontal { north, east: 0.0 }, ..learn(5.0) };
            assert_eq!(bend(&PlanRequest::default(), &learn, &[]), None);
        }
        for entry in [f32::NAN, f32::INFINITY] {
            let learn = Learn { covariance_m2: [entry, 0.0, 1.0], ..learn(5.0) };
            assert_eq!(bend(&PlanRequest::default(), &learn, &[]), None);
        }
    }
}
