//! Paths on which bearings tell more: the mmWave paper's path planning among three obstacles (its section V-B, fig. 4 and
//! Table 2).
//!
//! From (0, 0) to (100, 0) m, x east and y north, in 100 steps, past three obstacles; the source at (0, 110) m, measured
//! directly or by way of the line y = 100 m. Printed: `Q = 50`, `R = 0.01`, `T = 50` or 0, `u_max = 1 m` along each axis,
//! `P = 0.1 I`, and the noise of the bearings, 0.05 rad, for the filters. Not printed, and ours: the process noise, a
//! variance of [`PROCESS_NOISE_M2`] a step on the vehicle's place, the obstacles, and `n_std = 1`.
//!
//! A hundred steps of 1 m just reach 100 m along the x axis; no detour is possible but sideways. The printed ratio is not
//! reached with them for any process noise that was tried, nor for any other noise of the bearings; with longer steps it is. So each row is
//! there with 1 m and with [`FREE_STEP_M`].
//!
//! `Xi` is the sum over the steps of the trace of the position's covariance; two rows of 0.1 make the printed 20 before
//! the first measurement.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use foxhound_core::base::ned::Horizontal as Core;
use foxhound_core::base::obstacle::Obstacle;
use foxhound_core::mapping::walls::Wall;
use foxhound_core::planning::ilqr::{Bound, Config, Guess, Outcome, Problem, Solution, Workspace};
use foxhound_papers::filters::reflected;
use plotters::prelude::RGBColor;
use plotters::style::text_anchor::{HPos, VPos};
use serde::Serialize;

use crate::record::sheet::{FAINT_INK, FRAME, GROUND, INK, Map, PAPER, fill, line, text, write_svg};
use crate::scenario::input::InputError;
use crate::world::{Horizontal, from_core};

/// Variance that a step adds to the place.
pub const PROCESS_NOISE_M2: f32 = 0.01;
/// Longest step along an axis that leaves space for a detour.
pub const FREE_STEP_M: f32 = 2.5;
/// The paper's.
pub const PRINTED_STEP_M: f32 = 1.0;
const STEPS: usize = 100;
/// Centres (x, y) and radii.
const OBSTACLES: [([f32; 2], f32); 3] = [([25.0, 4.0], 8.0), ([50.0, -6.0], 8.0), ([75.0, 3.0], 8.0)];
const ROBOT_RADIUS_M: f32 = 0.5;
const GOAL: Core = Core { north: 0.0, east: 100.0 };
const SOURCE: Core = Core { north: 110.0, east: 0.0 };
/// Where the iterations begin: bows to both sides (to the right, south, if positive).
const SWINGS_M: [f32; 4] = [10.0, -10.0, -30.0, -60.0];

/// The experiment's result.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// `localize-paths`.
    pub experiment: &'static str,
    /// What a step adds to the variance of the place.
    pub process_noise_m2: f32,
    /// Noise of the bearings.
    pub bearing_sigma_rad: f32,
    /// One case with one weight each.
    pub rows: Vec<Row>,
}

/// A case with a weight.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// `line_of_sight` or `reflected`.
    pub case: &'static str,
    /// `T`.
    pub weight: f32,
    /// Longest step along an axis.
    pub step_max_m: f32,
    /// Sum of the traces of the position's covariance.
    pub xi_m2: f64,
    /// The paper's.
    pub printed_xi_m2: f64,
    /// Length of the path.
    pub length_m: f64,
    /// Distance left at its end.
    pub left_m: f64,
    /// Least distance between the hulls of the robot and of an obstacle, anywhere on the path.
    pub clearance_m: f64,
    /// How the solver ended.
    pub outcome: Outcome,
    /// Its iterations.
    pub iterations: u16,
    #[serde(skip)]
    path: Vec<(Horizontal, [f64; 3])>,
}

fn obstacles() -> [Obstacle; 3] {
    OBSTACLES.map(|([x, y], radius_m)| Obstacle {
        center_ned_m: Core { north: y, east: x },
        reach_m: radius_m + ROBOT_RADIUS_M,
    })
}

fn config(weight: f32, u_max_m: f32) -> Config {
    Config {
        q_terminal: 50.0,
        r_control: 0.01,
        t_covariance: [weight, weight],
        u_max_m,
        bound: Bound::Axes,
        n_std: 1.0,
        bearing_sigma_rad: 0.05,
        near_m: 0.0,
        process_noise_m2: [PROCESS_NOISE_M2, 0.0],
        iterations_max: 200,
    }
}

fn problem<const M: usize>(
    covariance_m2: [f32; M],
    obstacles: &[Obstacle],
    seen_through: Option<Wall>,
    swing_m: f32,
) -> Problem<'_, M> {
    Problem {
        start_ned_m: Core::default(),
        source_ned_m: SOURCE,
        covariance_m2,
        goal_ned_m: GOAL,
        steps: STEPS,
        obstacles,
        seen_through,
        guess: Guess::Bow(swing_m),
    }
}

impl Row {
    fn of<const M: usize>(weight: f32, step_max_m: f32, solution: &Solution<'_, M>) -> Self {
        let mut row = Self {
            case: if M == 3 { "line_of_sight" } else { "reflected" },
            weight,
            step_max_m,
            xi_m2: 0.0,
            printed_xi_m2: match (M, weight > 0.0) {
                (3, true) => 4.4,
                (3, false) => 10.95,
                (_, true) => 10.84,
                (_, false) => 12.51,
            },
            length_m: 0.0,
            left_m: 0.0,
            clearance_m: f64::INFINITY,
            outcome: solution.outcome,
            iterations: solution.iterations,
            path: vec![],
        };
        let mut before = Core::default();
        for step in solution.path {
            let [nn, ne, ee] = [0, 1, 2].map(|index| f64::from(step.covariance_m2[index]));
            row.xi_m2 += nn + ee;
            row.length_m += f64::from(step.place_ned_m.minus(before).norm());
            for obstacle in obstacles() {
                let distance = Core::distance_to_segment(obstacle.center_ned_m, before, step.place_ned_m);
                row.clearance_m = row.clearance_m.min(f64::from(distance - obstacle.reach_m));
            }
            before = step.place_ned_m;
            row.path.push((from_core(before), [nn, ne, ee]));
        }
        row.left_m = f64::from(before.minus(GOAL).norm());
        row
    }
}

/// The cheapest of the solutions from several beginnings that keeps off the obstacles.
fn cheapest<const M: usize>(solve: impl Fn(f32) -> (f32, Row)) -> Option<Row> {
    let solved = SWINGS_M.into_iter().map(solve).filter(|(_, row)| row.outcome != Outcome::Blocked);
    solved.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, row)| row)
}

fn rows(weight: f32, step_max_m: f32) -> Option<[Row; 2]> {
    let planner = config(weight, step_max_m).build().ok()?;
    let obstacles = obstacles();
    let direct = cheapest::<3>(|swing_m| {
        let mut workspace = Box::new(Workspace::<3, STEPS>::new());
        let solution = planner.solve(&mut workspace, &problem([0.1, 0.0, 0.1], &obstacles, None, swing_m));
        (solution.cost, Row::of(weight, step_max_m, &solution))
    })?;
    let wall = reflected::of_slope_intercept([0.0, 100.0]);
    let reflected = cheapest::<10>(|swing_m| {
        let mut workspace = Box::new(Workspace::<10, STEPS>::new());
        let covariance = [0.1, 0.0, 0.1, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.1];
        let solution = planner.solve_reflected(&mut workspace, &problem(covariance, &obstacles, Some(wall), swing_m));
        (solution.cost, Row::of(weight, step_max_m, &solution))
    })?;
    Some([direct, reflected])
}

/// Runs the experiment; nothing in it is random.
#[must_use]
pub fn run() -> Report {
    let mut all = vec![];
    for step_max_m in [FREE_STEP_M, PRINTED_STEP_M] {
        for weight in [50.0, 0.0] {
            all.extend(rows(weight, step_max_m).into_iter().flatten());
        }
    }
    all.sort_by_key(|row| row.case);
    Report {
        experiment: "localize-paths",
        process_noise_m2: PROCESS_NOISE_M2,
        bearing_sigma_rad: config(0.0, 1.0).bearing_sigma_rad,
        rows: all,
    }
}

impl Report {
    /// A row.
    #[must_use]
    pub fn row(&self, case: &str, weight: f32, step_max_m: f32) -> Option<&Row> {
        self.rows.iter().find(|row| row.case == case && row.weight == weight && row.step_max_m == step_max_m)
    }

    /// How many times lower `Xi` is with the weight than without it.
    #[must_use]
    pub fn ratio(&self, case: &str, step_max_m: f32) -> Option<f64> {
        let xi = |weight| self.row(case, weight, step_max_m).map(|row| row.xi_m2);
        Some(xi(0.0)? / xi(50.0)?)
    }

    /// The table as text.
    #[must_use]
    pub fn table(&self) -> String {
        let mut out = format!(
            "Paths of {STEPS} steps past three obstacles, bearings of {} rad, process noise {} m^2 a step (not printed)\n\n\
             {:<16}{:>7}{:>6}{:>10}{:>10}{:>10}{:>8}{:>11}{:>7}  outcome\n",
            self.bearing_sigma_rad,
            self.process_noise_m2,
            "case",
            "u_max",
            "T",
            "Xi",
            "printed",
            "length",
            "left",
            "clearance",
            "iter."
        );
        for row in &self.rows {
            let _ = writeln!(
                out,
                "{:<16}{:>5} m{:>6}{:>10.2}{:>10.2}{:>8.1} m{:>6.2} m{:>9.2} m{:>7}  {}",
                if row.case == "reflected" { "reflected" } else { "line of sight" },
                row.step_max_m,
                row.weight,
                row.xi_m2,
                row.printed_xi_m2,
                row.length_m,
                row.left_m,
                row.clearance_m,
                row.iterations,
                match row.outcome {
                    Outcome::Converged => "converged",
                    Outcome::CapReached => "cap reached",
                    Outcome::Blocked => "blocked",
                    Outcome::Refused => "refused",
                }
            );
        }
        out.push('\n');
        for (case, name, printed) in
            [("line_of_sight", "line of sight", 10.95 / 4.4), ("reflected", "reflected", 12.51 / 10.84)]
        {
            let ratio = |step| self.ratio(case, step).unwrap_or(f64::NAN);
            let _ = writeln!(
                out,
                "Xi is {:.2} times lower with T = 50 I than without, {name}, u_max {FREE_STEP_M} m; {:.2} with 1 m; printed \
                 {printed:.2}",
                ratio(FREE_STEP_M),
                ratio(PRINTED_STEP_M)
            );
        }
        out
    }

    /// Draws the paths with the longer steps, an ellipse of two deviations at every fourth step; says which file this is.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn draw(&self, folder: &Path) -> Result<Vec<PathBuf>, InputError> {
        let file = folder.join("localize-paths.svg");
        let panels: Vec<&Row> = self.rows.iter().filter(|row| row.step_max_m == FREE_STEP_M).collect();
        let page = [2.0 * EDGE + 2.0 * SIDE + GAP, TITLE + 2.0 * (SIDE + TITLE)];
        write_svg(&file, page, |area| {
            for (index, row) in panels.iter().take(4).enumerate() {
                let left = EDGE + (index % 2) as f64 * (SIDE + GAP);
                let top = TITLE + (index / 2) as f64 * (SIDE + TITLE);
                row.draw(area, [left, top])?;
            }
            Ok(())
        })?;
        Ok(vec![file])
    }
}

/// Side of a map and what is around it, in points; its bounds.
const SIDE: f64 = 420.0;
const EDGE: f64 = 40.0;
const GAP: f64 = 48.0;
const TITLE: f64 = 56.0;
const BOUNDS_M: [f64; 4] = [-28.0, -40.0, 132.0, 120.0];

const PILLAR: RGBColor = RGBColor(75, 85, 99);
const WALL: RGBColor = RGBColor(148, 163, 184);
const WAY: RGBColor = RGBColor(62, 74, 137);
const ELLIPSE: RGBColor = RGBColor(220, 38, 38);
const BEACON: RGBColor = RGBColor(240, 140, 30);
const ARRIVAL: RGBColor = RGBColor(21, 128, 61);

impl Row {
    fn draw<B: plotters::prelude::DrawingBackend>(
        &self,
        area: &plotters::prelude::DrawingArea<B, plotters::coord::Shift>,
        [left, top]: [f64; 2],
    ) -> crate::record::sheet::Drawn<B> {
        let map = Map::within(area, BOUNDS_M, [left, top], SIDE);
        map.rectangle(BOUNDS_M, fill(GROUND, 1.0))?;
        let reflected = self.case == "reflected";
        let title = format!(
            "{}, T = {}: \u{39e} = {:.1} m\u{b2}",
            if reflected { "reflected" } else { "line of sight" },
            self.weight,
            self.xi_m2
        );
        text(area, &title, [left, top - 14.0], 16.0, INK, (HPos::Left, VPos::Bottom))?;
        if reflected {
            let [west, _, east, _] = BOUNDS_M;
            map.path([west, east].map(|x| Horizontal::from_xy([x, 100.0])), line(WALL, 1.0, 3.0))?;
        }
        for ([x, y], radius_m) in OBSTACLES {
            let center = Horizontal::from_xy([f64::from(x), f64::from(y)]);
            map.circle(center, f64::from(radius_m), fill(PILLAR, 0.85))?;
        }
        for (place, covariance) in self.path.iter().step_by(4) {
            map.path(ellipse(*place, *covariance), line(ELLIPSE, 0.8, 0.9))?;
        }
        let start = Horizontal::from_xy([0.0, 0.0]);
        map.path(std::iter::once(start).chain(self.path.iter().map(|(place, _)| *place)), line(WAY, 1.0, 1.8))?;
        for (place, color) in [(start, WAY), (from_core(GOAL), ARRIVAL), (from_core(SOURCE), BEACON)] {
            map.dot(place, 5.4, fill(PAPER, 1.0))?;
            map.dot(place, 4.0, fill(color, 1.0))?;
        }
        let beside = map.points(from_core(SOURCE));
        text(area, "source", [beside[0] + 10.0, beside[1]], 12.0, FAINT_INK, (HPos::Left, VPos::Center))?;
        map.rectangle(BOUNDS_M, line(FRAME, 1.0, 1.0))
    }
}

/// Two deviations around a place.
fn ellipse(center: Horizontal, [nn, ne, ee]: [f64; 3]) -> impl Iterator<Item = Horizontal> {
    let (mean, half) = (0.5 * (nn + ee), 0.5 * (nn - ee));
    let root = libm::hypot(half, ne);
    let turn = 0.5 * libm::atan2(ne, half);
    let axes = [mean + root, mean - root].map(|variance| 2.0 * libm::sqrt(variance.max(0.0)));
    (0..=36).map(move |k| {
        let (sine, cosine) = libm::sincos(std::f64::consts::TAU * f64::from(k) / 36.0);
        let long = Horizontal::from_bearing(turn);
        let short = Horizontal { north: -long.east, east: long.north };
        center.along(long, axes[0] * cosine).along(short, axes[1] * sine)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ellipse_has_the_directions_of_its_covariance() {
        // Long to the north-east.
        let farthest = ellipse(Horizontal { north: 0.0, east: 0.0 }, [2.5, 1.5, 2.5])
            .max_by(|a, b| a.norm().total_cmp(&b.norm()))
            .unwrap();
        assert!((farthest.norm() - 4.0).abs() < 1e-9);
        assert!((farthest.north - farthest.east).abs() < 1e-9);
    }
}
