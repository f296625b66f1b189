use std::boxed::Box;
use std::vec::Vec;

use super::clearance::{NEAREST, Near, deviation};
use super::sensor::{Sensor, at};
use super::*;
use crate::base::rng::Rng;

fn place(rng: &mut Rng, size_m: f32) -> Horizontal {
    Horizontal { north: size_m * (rng.uniform() - 0.5), east: size_m * (rng.uniform() - 0.5) }
}

/// A random covariance: a product of a matrix and its transpose, plus a diagonal matrix.
fn covariance<const L: usize, const M: usize>(rng: &mut Rng) -> [f32; M] {
    let factor: [[f32; L]; L] = core::array::from_fn(|_| core::array::from_fn(|_| rng.gaussian()));
    let mut out = [0.0; M];
    for b in 0..L {
        for a in 0..=b {
            out[at(a, b)] = (0..L).map(|k| factor[a][k] * factor[b][k]).sum::<f32>() + if a == b { 0.2 } else { 0.0 };
        }
    }
    out
}

fn sensor<const L: usize>(rng: &mut Rng, mirrored: bool) -> (Sensor<L>, Horizontal, Option<Wall>) {
    let source = place(rng, 12.0);
    let line = mirrored.then(|| Wall::between(place(rng, 12.0), place(rng, 12.0))).flatten();
    let noise = [0.02, 0.01];
    (Sensor::new(source, line.as_ref(), 0.2 * 0.2, 0.3, noise), source, line)
}

/// Eq. 16 and 17 literally, in f64: the measurement `[cos, sin]` of eq. 3, its Jacobian by finite differences of `h`.
fn literal<const L: usize, const M: usize>(
    p: &[f32; M],
    at_place: Horizontal,
    source: Horizontal,
    line: Option<&Wall>,
    variance: f64,
    noise: [f64; 2],
) -> [[f64; L]; L] {
    let direction = |x: [f64; 4]| {
        // The mirror of the source in f64.
        let mut image = [x[2], x[3]];
        if let Some(line) = line {
            let n = [f64::from(line.normal_ned.north), f64::from(line.normal_ned.east)];
            let off = 2.0 * (n[0] * x[2] + n[1] * x[3] - f64::from(line.offset_m));
            image = [x[2] - off * n[0], x[3] - off * n[1]];
        }
        let d = [x[0] - image[0], x[1] - image[1]];
        let r = d[0].hypot(d[1]);
        [d[0] / r, d[1] / r]
    };
    let x = [at_place.north, at_place.east, source.north, source.east].map(f64::from);
    let mut h = [[0.0; L]; 2];
    for a in 0..L {
        let (mut up, mut down) = (x, x);
        // Two states: of the source, whose sign does not matter.
        let index = if L == 2 { a + 2 } else { a };
        up[index] += 1e-6;
        down[index] -= 1e-6;
        let (up, down) = (direction(up), direction(down));
        for r in 0..2 {
            h[r][a] = (up[r] - down[r]) / 2e-6;
        }
    }
    let mut prior = [[0.0; L]; L];
    for a in 0..L {
        for b in 0..L {
            prior[a][b] = f64::from(p[at(a, b)]) + if a == b { noise[usize::from(a >= 2)] } else { 0.0 };
        }
    }
    let zeta: [[f64; 2]; L] = core::array::from_fn(|a| [0, 1].map(|r| (0..L).map(|b| prior[a][b] * h[r][b]).sum()));
    let mut s = [[0.0; 2]; 2];
    for r in 0..2 {
        for c in 0..2 {
            s[r][c] = (0..L).map(|a| h[r][a] * zeta[a][c]).sum::<f64>() + if r == c { variance } else { 0.0 };
        }
    }
    let determinant = s[0][0] * s[1][1] - s[0][1] * s[1][0];
    let inverse = [[s[1][1] / determinant, -s[0][1] / determinant], [-s[1][0] / determinant, s[0][0] / determinant]];
    core::array::from_fn(|a| {
        core::array::from_fn(|b| {
            let mut value = prior[a][b];
            for r in 0..2 {
                for c in 0..2 {
                    value -= zeta[a][r] * inverse[r][c] * zeta[b][c];
                }
            }
            value
        })
    })
}

fn matches_the_paper<const L: usize, const M: usize>(seed: u64) {
    let mut rng = Rng::new(seed, 21);
    for case in 0..300 {
        let source = place(&mut rng, 12.0);
        let line = (case % 2 == 1).then(|| Wall::between(place(&mut rng, 12.0), place(&mut rng, 12.0))).flatten();
        let sensor = Sensor::<L>::new(source, line.as_ref(), 0.04, 0.0, [0.02, 0.01]);
        let p = covariance::<L, M>(&mut rng);
        let from = place(&mut rng, 12.0);
        let image = line.map_or(source, |line| line.mirror(source));
        if image.minus(from).norm() < 0.5 {
            continue;
        }
        let ours = sensor.update(&p, [from.north, from.east]);
        let noise = [0.02, 0.01];
        let theirs = literal::<L, M>(&p, from, source, line.as_ref(), f64::from(0.04_f32), noise);
        for a in 0..L {
            for b in 0..L {
                let apart = (f64::from(ours[at(a, b)]) - theirs[a][b]).abs();
                assert!(apart < 2e-4, "case {case} ({a}, {b}): {} against {}", ours[at(a, b)], theirs[a][b]);
            }
        }
    }
}

#[test]
fn the_scalar_update_is_the_papers_with_cosine_and_sine_for_both_beliefs() {
    matches_the_paper::<2, 3>(1);
    matches_the_paper::<4, 10>(2);
}

fn derivatives_agree<const L: usize, const M: usize>(seed: u64) {
    let mut rng = Rng::new(seed, 22);
    for case in 0..200 {
        let (sensor, source, line) = sensor::<L>(&mut rng, case % 2 == 1);
        let p = covariance::<L, M>(&mut rng);
        let here = place(&mut rng, 12.0);
        // Nearer than that the finite differences are inaccurate, not the derivatives.
        if line.map_or(source, |line| line.mirror(source)).minus(here).norm() < 1.5 {
            continue;
        }
        let here = [here.north, here.east];
        let slopes = sensor.slopes(&p, here);
        let close = |analytic: f32, up: f32, down: f32, step: f32, what: &str| {
            let numeric = (up - down) / (2.0 * step);
            assert!((analytic - numeric).abs() < 4e-3 * (1.0 + analytic.abs()), "{case} {what}: {analytic} {numeric}");
        };

        const STEP: f32 = 4e-3;
        let by_place: [[f32; M]; 2] = slopes.by_place();
        for j in 0..2 {
            let (mut up, mut down) = (here, here);
            up[j] += STEP;
            down[j] -= STEP;
            let (up, down) = (sensor.update(&p, up), sensor.update(&p, down));
            for m in 0..M {
                close(by_place[j][m], up[m], down[m], STEP, "eq. 18");
            }
        }
        let by_covariance: [[f32; M]; M] = core::array::from_fn(|m| {
            let mut unit = [0.0; M];
            unit[m] = 1.0;
            slopes.pull(&unit)
        });
        for n in 0..M {
            let (mut up, mut down) = (p, p);
            up[n] += STEP;
            down[n] -= STEP;
            let (up, down) = (sensor.update(&up, here), sensor.update(&down, here));
            for m in 0..M {
                close(by_covariance[m][n], up[m], down[m], STEP, "eq. 19");
            }
        }

        // Second derivatives, from differences of the first ones.
        let weight: [f32; M] = core::array::from_fn(|_| rng.gaussian());
        let pull = |p: &[f32; M], here: [f32; 2]| {
            let slopes = sensor.slopes(p, here);
            let columns: [[f32; M]; 2] = slopes.by_place();
            let place = columns.map(|column| (0..M).map(|m| column[m] * weight[m]).sum::<f32>());
            (place, slopes.pull(&weight))
        };
        let curvature = slopes.curvature(&weight);
        for j in 0..2 {
            let (mut up, mut down) = (here, here);
            up[j] += STEP;
            down[j] -= STEP;
            let (up, down) = (pull(&p, up), pull(&p, down));
            for k in 0..2 {
                close(curvature.place[j + k], up.0[k], down.0[k], STEP, "place, place");
            }
            for m in 0..M {
                close(curvature.mixed[j][m], up.1[m], down.1[m], STEP, "place, covariance");
            }
        }
    }
}

#[test]
fn the_covariance_updates_derivatives_are_those_of_finite_differences_for_both_beliefs() {
    derivatives_agree::<2, 3>(3);
    derivatives_agree::<4, 10>(4);
}

#[test]
fn the_largest_deviation_and_its_derivative_are_those_of_finite_differences() {
    let mut rng = Rng::new(5, 23);
    for _ in 0..300 {
        let p = covariance::<2, 3>(&mut rng);
        let [a, b, c] = p.map(f64::from);
        let truth = (0.5 * (a + c) + (0.25 * (a - c) * (a - c) + b * b).sqrt()).sqrt();
        let (value, slope) = deviation(p);
        assert!((f64::from(value) - truth).abs() < 1e-5 * truth, "{value} {truth}");
        for m in 0..3 {
            let (mut up, mut down) = (p, p);
            up[m] += 2e-3;
            down[m] -= 2e-3;
            let numeric = (deviation(up).0 - deviation(down).0) / 4e-3;
            assert!((slope[m] - numeric).abs() < 5e-3 * (1.0 + slope[m].abs()), "{p:?}: {slope:?} {numeric}");
        }
    }
    // Where both eigenvalues are equal it has no derivative, and the returned one is finite.
    let (value, slope) = deviation([0.25, 0.0, 0.25]);
    assert!((value - 0.5).abs() < 1e-5 && slope.iter().all(|slope| slope.is_finite()));
}

#[test]
fn the_rooms_derivative_is_that_of_finite_differences() {
    let mut rng = Rng::new(6, 24);
    for _ in 0..200 {
        let obstacles = [Obstacle { center_ned_m: place(&mut rng, 4.0), reach_m: rng.uniform() }];
        let here = place(&mut rng, 8.0);
        let near = Near::look(&obstacles, [here.north, here.east], 0.09, 0.5, None);
        let room = |here: [f32; 2]| near.room(0, &obstacles, here).unwrap();
        let (_, slope) = room([here.north, here.east]);
        if obstacles[0].center_ned_m.minus(here).norm() < 0.3 {
            continue;
        }
        for j in 0..2 {
            let (mut up, mut down) = ([here.north, here.east], [here.north, here.east]);
            up[j] += 1e-2;
            down[j] -= 1e-2;
            let numeric = (room(up).0 - room(down).0) / 2e-2;
            assert!((slope[j] - numeric).abs() < 2e-3, "{slope:?} {numeric}");
        }
    }
}

#[test]
fn the_nearest_of_three_hundred_obstacles_are_found_and_hold_as_long_as_they_say() {
    let mut rng = Rng::new(7, 25);
    let obstacles: Vec<Obstacle> = (0..300)
        .map(|_| Obstacle { center_ned_m: place(&mut rng, 40.0), reach_m: 0.2 + 0.3 * rng.uniform() })
        .collect();
    let mut before = None;
    for _ in 0..200 {
        let here = place(&mut rng, 40.0);
        let near = Near::look(&obstacles, [here.north, here.east], 0.0, 0.0, before.as_ref());
        let mut rooms: Vec<f32> = obstacles.iter().map(|obstacle| obstacle.clearance_m(here)).collect();
        rooms.sort_by(f32::total_cmp);
        for number in 0..NEAREST {
            let (room, _) = near.room(number, &obstacles, [here.north, here.east]).unwrap();
            assert!((room - rooms[number]).abs() < 1e-4, "{number}: {room} {rooms:?}");
        }
        before = Some(near);
        // Within the distance for which the list is valid, no other obstacle is touched.
        let moved = here.plus(Horizontal::from_bearing(6.0 * rng.uniform()).times(4.0));
        if near.holds([moved.north, moved.east], 1.0) {
            let least = obstacles.iter().map(|obstacle| obstacle.clearance_m(moved)).fold(f32::INFINITY, f32::min);
            let ours = (0..NEAREST)
                .filter_map(|number| near.room(number, &obstacles, [moved.north, moved.east]))
                .map(|(room, _)| room)
                .fold(f32::INFINITY, f32::min);
            assert!(ours <= least + 1e-4 || least >= 0.0, "{ours} {least}");
        }
    }
}

/// A path of twelve metres past a source, in steps of at most half a metre.
fn passing(obstacles: &[Obstacle]) -> Problem<'_, 3> {
    Problem {
        start_ned_m: Horizontal { north: 0.0, east: 0.0 },
        source_ned_m: Horizontal { north: 6.0, east: 5.0 },
        covariance_m2: [1.0, 0.3, 2.0],
        goal_ned_m: Horizontal { north: 0.0, east: 12.0 },
        steps: 30,
        obstacles,
        seen_through: None,
        guess: Guess::Bow(0.5),
    }
}

fn config() -> Config {
    Config { u_max_m: 0.5, r_control: 1.0, t_covariance: [5.0, 5.0], ..Config::default() }
}

fn circle(north: f32, east: f32, reach_m: f32) -> Obstacle {
    Obstacle { center_ned_m: Horizontal { north, east }, reach_m }
}

/// `n` circles around the path, one per square metre.
fn forest(rng: &mut Rng, n: usize) -> Vec<Obstacle> {
    let side = (n as f32).sqrt();
    (0..n)
        .map(|_| {
            let mut circle = circle(0.0, 0.0, 0.1 + 0.2 * rng.uniform());
            while circle.center_ned_m.norm() < 0.5
                || circle.center_ned_m.minus(Horizontal { north: 0.0, east: 12.0 }).norm() < 0.5
            {
                circle.center_ned_m = place(rng, side).plus(Horizontal { north: 0.0, east: 6.0 });
            }
            circle
        })
        .collect()
}

#[test]
fn without_a_weight_on_the_covariance_the_way_is_straight_and_evenly_paced() {
    let planner = Config { t_covariance: [0.0; 2], ..config() }.build().unwrap();
    let mut workspace = Workspace::<3, 30>::new();
    let solution = planner.solve(&mut workspace, &passing(&[]));
    assert_eq!(solution.outcome, Outcome::Converged);
    // A line of 30 steps with R = 1, Q = 50: the last one is short of the goal by 12 / (30 Q / R + 1).
    let short = 12.0 / (30.0 * 50.0 + 1.0);
    for (index, step) in solution.path.iter().enumerate() {
        let wanted = (12.0 - short) * (index + 1) as f32 / 30.0;
        let apart = step.place_ned_m.minus(Horizontal { north: 0.0, east: wanted }).norm();
        assert!(apart < 0.05, "{index}: {step:?}, wanted {wanted}");
    }
}

#[test]
fn a_solution_is_a_minimum_its_controls_keep_their_bound_and_its_covariances_are_the_filters() {
    let obstacles = [circle(0.5, 3.0, 1.0), circle(2.5, 7.0, 1.2)];
    for bound in [Bound::Norm, Bound::Axes] {
        let planner = Config { n_std: 1.0, process_noise_m2: [1e-3, 0.0], bound, ..config() }.build().unwrap();
        let mut workspace = Workspace::<3, 30>::new();
        let problem = passing(&obstacles);
        let solution = planner.solve(&mut workspace, &problem);
        assert_eq!(solution.outcome, Outcome::Converged, "{bound:?}");
        assert!(solution.clearance_m >= 0.0, "{}", solution.clearance_m);
        let (variance, noise) = (0.05 * 0.05, [1e-3, 0.0]);
        let sensor = Sensor::<2>::new(problem.source_ned_m, None, variance, planner.config().near_m, noise);
        let (mut place, mut covariance) = ([0.0; 2], problem.covariance_m2);
        let replay = |controls: &[[f32; 2]]| {
            let (mut place, mut covariance, mut cost, mut room) = ([0.0; 2], problem.covariance_m2, 0.0, 1e9_f32);
            for control in controls {
                place = [place[0] + control[0], place[1] + control[1]];
                covariance = sensor.update(&covariance, place);
                cost += control[0] * control[0] + control[1] * control[1] + 5.0 * (covariance[0] + covariance[2]);
                let (width, _) = deviation(covariance);
                for obstacle in &obstacles {
                    let at = Horizontal { north: place[0], east: place[1] };
                    let reach = (obstacle.reach_m * obstacle.reach_m + planner.half_step_m2).sqrt();
                    room = room.min(at.minus(obstacle.center_ned_m).norm() - reach - width);
                }
                let rooms = planner.rooms(*control);
                room = room.min(rooms[0]).min(rooms[1]);
            }
            let away = [place[0] - problem.goal_ned_m.north, place[1] - problem.goal_ned_m.east];
            (cost + 50.0 * (away[0] * away[0] + away[1] * away[1]), room)
        };
        for step in solution.path {
            assert!(planner.rooms(step.control_m).iter().all(|room| *room > 0.0), "{step:?}");
            place = [place[0] + step.control_m[0], place[1] + step.control_m[1]];
            covariance = sensor.update(&covariance, place);
            assert_eq!([step.place_ned_m.north, step.place_ned_m.east], place);
            assert_eq!(step.covariance_m2, covariance);
        }
        let controls: Vec<[f32; 2]> = solution.path.iter().map(|step| step.control_m).collect();
        let (least, room) = replay(&controls);
        assert!((least - solution.cost).abs() < 1e-3 * least && room > 0.0, "{least} {} {room}", solution.cost);
        // No neighbour that keeps the constraints is cheaper by more than the barrier costs.
        let mut rng = Rng::new(8, 26);
        let mut tried = 0;
        for case in 0..4000 {
            let size = [0.1, 0.03, 0.01, 0.003][case % 4];
            let centre = 30.0 * rng.uniform();
            let push = [rng.gaussian(), rng.gaussian()];
            let moved: Vec<[f32; 2]> = controls
                .iter()
                .enumerate()
                .map(|(index, control)| {
                    // A bump of the path: its derivative.
                    let x = (index as f32 - centre) / 4.0;
                    let slope = -x * (-0.5 * x * x).exp();
                    [control[0] + size * push[0] * slope, control[1] + size * push[1] * slope]
                })
                .collect();
            let (cost, room) = replay(&moved);
            if room > 0.0 {
                tried += 1;
                assert!(cost > least * (1.0 - 5e-3), "{bound:?} {case}: {cost} below {least}");
            }
        }
        assert!(tried > 500, "{tried}");
    }
}

/// Sum of the traces of the covariances along a path.
fn traces(path: &[Step<3>]) -> f32 {
    path.iter().map(|step| step.covariance_m2[0] + step.covariance_m2[2]).sum()
}

#[test]
fn a_way_bends_towards_the_source_and_knows_more_at_its_end() {
    let mut workspace = Workspace::<3, 30>::new();
    let mut sums = [0.0; 2];
    for (sum, weight) in sums.iter_mut().zip([0.0, 5.0]) {
        let planner = Config { t_covariance: [weight; 2], ..config() }.build().unwrap();
        let solution = planner.solve(&mut workspace, &passing(&[]));
        assert_eq!(solution.outcome, Outcome::Converged);
        *sum = traces(solution.path);
        let highest = solution.path.iter().map(|step| step.place_ned_m.north).fold(0.0, f32::max);
        assert!(if weight > 0.0 { highest > 1.0 } else { highest < 0.1 }, "{weight}: {highest}");
    }
    assert!(sums[1] < 0.85 * sums[0], "{sums:?}");
}

#[test]
fn on_the_way_to_the_source_itself_nothing_says_to_which_side_and_a_bow_does() {
    let planner = Config { t_covariance: [50.0; 2], bearing_sigma_rad: 0.1, ..config() }.build().unwrap();
    let mut workspace = Workspace::<3, 30>::new();
    let mut sums = [0.0; 3];
    for (sum, swing_m) in sums.iter_mut().zip([0.0, 0.3, -0.3]) {
        let problem = Problem {
            source_ned_m: Horizontal { north: 0.0, east: 16.0 },
            covariance_m2: [1.0, 0.0, 25.0],
            guess: Guess::Bow(swing_m),
            ..passing(&[])
        };
        let solution = planner.solve(&mut workspace, &problem);
        *sum = traces(solution.path);
        let middle = solution.path[15].place_ned_m.north;
        // To the right of east is south.
        assert!(if swing_m == 0.0 { middle.abs() < 1e-3 } else { middle * swing_m < -0.05 }, "{swing_m}: {middle}");
    }
    assert!(sums[1] < 0.8 * sums[0] && (sums[1] - sums[2]).abs() < 0.02 * sums[1], "{sums:?}");
}

#[test]
fn a_start_through_obstacles_also_through_their_middles_ends_beside_them() {
    let obstacles = [circle(0.0, 3.0, 0.8), circle(0.0, 6.0, 0.6), circle(0.0, 9.0, 0.8)];
    let planner = Config { t_covariance: [0.0; 2], u_max_m: 0.6, ..config() }.build().unwrap();
    let mut workspace = Workspace::<3, 30>::new();
    for swing_m in [0.1, -0.1, 1.5] {
        let solution = planner.solve(&mut workspace, &Problem { guess: Guess::Bow(swing_m), ..passing(&obstacles) });
        assert_eq!(solution.outcome, Outcome::Converged, "{swing_m}");
        assert!(solution.clearance_m > 0.0);
        let end = solution.path[29].place_ned_m;
        assert!(end.minus(Horizontal { north: 0.0, east: 12.0 }).norm() < 0.1, "{end:?}");
    }
}

#[test]
fn a_warm_start_is_taken_up_where_it_was() {
    let obstacles = [circle(0.5, 3.0, 1.0), circle(2.5, 7.0, 1.2)];
    let planner = config().build().unwrap();
    let mut workspace = Workspace::<3, 30>::new();
    let cold = planner.solve(&mut workspace, &passing(&obstacles));
    let (cost, places): (f32, Vec<Horizontal>) = (cold.cost, cold.path.iter().map(|step| step.place_ned_m).collect());
    let warm = planner.solve(&mut workspace, &Problem { guess: Guess::Path(&places), ..passing(&obstacles) });
    assert_eq!(warm.outcome, Outcome::Converged);
    assert!((warm.cost / cost - 1.0).abs() < 0.01, "{} {cost}", warm.cost);
}

#[test]
fn among_three_hundred_obstacles_no_path_goes_through_one_unseen() {
    let planner = Config { n_std: 0.1, u_max_m: 0.5, iterations_max: 100, ..config() }.build().unwrap();
    let mut workspace = Box::new(Workspace::<3, 50>::new());
    let mut found = 0;
    for seed in 0..40 {
        let mut rng = Rng::new(seed, 27);
        let obstacles = forest(&mut rng, 300);
        let problem = Problem { steps: 40, covariance_m2: [0.3, 0.0, 0.3], ..passing(&obstacles) };
        let solution = planner.solve(&mut workspace, &problem);
        // Checked separately: all obstacles, all segments.
        let mut before = problem.start_ned_m;
        let mut least = f32::INFINITY;
        for step in solution.path {
            for obstacle in &obstacles {
                let distance = Horizontal::distance_to_segment(obstacle.center_ned_m, before, step.place_ned_m);
                least = least.min(distance - obstacle.reach_m);
            }
            before = step.place_ned_m;
        }
        assert!(solution.clearance_m <= least + 1e-4);
        assert_eq!(solution.outcome == Outcome::Blocked, solution.clearance_m < 0.0);
        let arrived = before.minus(problem.goal_ned_m).norm() < 0.5;
        found += usize::from(solution.outcome != Outcome::Blocked && arrived);
    }
    assert!(found >= 30, "{found} of 40");
}

#[test]
fn the_belief_of_four_states_learns_behind_a_wall_and_stays_positive() {
    let planner = Config { n_std: 0.5, process_noise_m2: [1e-3, 0.0], ..config() }.build().unwrap();
    let mut workspace = Box::new(Workspace::<10, 40>::new());
    let obstacles = [circle(0.5, 3.0, 1.0), circle(2.5, 7.0, 1.2)];
    let spot = |north, east| Horizontal { north, east };
    let problem = Problem {
        start_ned_m: spot(0.0, 0.0),
        source_ned_m: spot(-3.0, 8.0),
        covariance_m2: [0.05, 0.0, 0.05, 0.0, 0.0, 2.0, 0.0, 0.0, 0.3, 2.0],
        goal_ned_m: spot(0.0, 12.0),
        steps: 40,
        obstacles: &obstacles,
        seen_through: Wall::between(spot(6.0, -5.0), spot(6.0, 20.0)),
        guess: Guess::Bow(-0.5),
    };
    let solution = planner.solve_reflected(&mut workspace, &problem);
    assert_eq!(solution.outcome, Outcome::Converged, "{}", solution.iterations);
    let ends = solution.path.last().unwrap().covariance_m2;
    assert!(ends[at_source(0)] + ends[at_source(1)] < 2.0, "{ends:?}");
    for step in solution.path {
        // Cholesky's pivots.
        let mut square: [[f64; 4]; 4] =
            core::array::from_fn(|a| core::array::from_fn(|b| f64::from(step.covariance_m2[at(a, b)])));
        for k in 0..4 {
            assert!(square[k][k] > 0.0, "{:?}", step.covariance_m2);
            for a in k + 1..4 {
                for b in k + 1..4 {
                    square[a][b] -= square[a][k] * square[k][b] / square[k][k];
                }
            }
        }
    }
    let blind = Config { t_covariance: [0.0; 2], ..*planner.config() }.build().unwrap();
    let mut workspace = Box::new(Workspace::<10, 40>::new());
    let straight = blind.solve_reflected(&mut workspace, &problem);
    let known = |solution: &Solution<'_, 10>| {
        solution.path.iter().map(|s| s.covariance_m2[at_source(0)] + s.covariance_m2[at_source(1)]).sum::<f32>()
    };
    assert!(known(&solution) < 0.9 * known(&straight), "{} {}", known(&solution), known(&straight));
}

fn at_source(axis: usize) -> usize {
    at(2 + axis, 2 + axis)
}

#[test]
fn what_cannot_be_planned_has_an_outcome_of_its_own() {
    let planner = config().build().unwrap();
    let mut workspace = Workspace::<3, 30>::new();
    let nowhere = Horizontal { north: f32::NAN, east: 0.0 };
    for problem in [
        Problem { steps: 0, ..passing(&[]) },
        Problem { steps: 31, ..passing(&[]) },
        Problem { goal_ned_m: nowhere, ..passing(&[]) },
        Problem { covariance_m2: [1.0, f32::INFINITY, 1.0], ..passing(&[]) },
    ] {
        let solution = planner.solve(&mut workspace, &problem);
        assert_eq!((solution.outcome, solution.path.len()), (Outcome::Refused, 0));
    }
    let obstacles = [circle(0.0, 0.0, 0.5)];
    assert_eq!(planner.solve(&mut workspace, &passing(&obstacles)).outcome, Outcome::Blocked);
    assert!(Config { u_max_m: f32::NAN, ..config() }.build().is_err());
    assert!(Config { bearing_sigma_rad: 0.0, ..config() }.build().is_err());
}

#[test]
fn whatever_the_problem_the_path_is_finite() {
    let mut rng = Rng::new(9, 28);
    let mut workspace = Workspace::<3, 20>::new();
    for case in 0..400 {
        let obstacles: Vec<Obstacle> =
            (0..case % 20).map(|_| Obstacle { center_ned_m: place(&mut rng, 10.0), reach_m: rng.uniform() }).collect();
        let wild = |rng: &mut Rng| libm::expf(12.0 * rng.uniform() - 6.0);
        let config = Config {
            q_terminal: wild(&mut rng),
            r_control: wild(&mut rng),
            t_covariance: [wild(&mut rng); 2],
            u_max_m: 0.01 + rng.uniform(),
            n_std: 3.0 * rng.uniform(),
            near_m: if case % 3 == 0 { 0.0 } else { 0.3 },
            bearing_sigma_rad: 0.01 + 0.5 * rng.uniform(),
            iterations_max: 30,
            ..Config::default()
        };
        let size = wild(&mut rng);
        let start = place(&mut rng, 10.0);
        let problem = Problem {
            start_ned_m: start,
            source_ned_m: if case % 5 == 0 { start } else { place(&mut rng, 10.0) },
            covariance_m2: covariance::<2, 3>(&mut rng).map(|value| size * value),
            goal_ned_m: if case % 7 == 0 { start } else { place(&mut rng, 20.0) },
            steps: 1 + case % 20,
            obstacles: &obstacles,
            seen_through: None,
            guess: Guess::Bow(4.0 * rng.uniform() - 2.0),
        };
        let planner = config.build().unwrap();
        let solution = planner.solve(&mut workspace, &problem);
        assert_eq!(solution.path.len(), problem.steps);
        for step in solution.path {
            assert!(step.place_ned_m.is_finite() && step.covariance_m2.iter().all(|value| value.is_finite()), "{case}");
            assert!(planner.rooms(step.control_m).iter().all(|room| *room > 0.0), "{case}");
        }
    }
}
