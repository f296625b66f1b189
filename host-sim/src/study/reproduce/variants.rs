//! `apf-variants`: four potential fields in four scenes with local minima, as the variants paper compares them on a
//! quadrotor (its fig. 2 to 5 and Table I).
//!
//! The forces are [`foxhound_papers::apf::field`]'s, to the letter. The paper gives the force to a controller as a
//! set-point and prints neither gains nor limits; here a point flows along the force, `dx/dt = F`, with `k_a = 1`, which
//! makes the times comparable (21 m to within 5 cm take 6.05 s without an obstacle, the paper's fields take 3 to 13 s). Its
//! obstacles are points; a hull of the default radius that reaches one has collided. The dynamic obstacle's speed is not
//! printed.
//!
//! All scenes but the last are symmetric about the line from start to goal, on which a force without a sideways part never
//! leaves it. So everything is run twice: from the printed start, and from 5 cm beside it. The gains are common to the four
//! scenes, as in the paper; all of [`STRENGTHS`] by [`RANGES_M`] are tried, and the table is held against the setting that
//! comes nearest to it. The virtual force's sideways push is as strong as its greatest push back.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use foxhound_core::base::obstacle::Obstacle;
use foxhound_core::planning::field::{ForceField as _, Gains};
use foxhound_core::planning::planner::baseline::{Kind, Law};
use foxhound_papers::apf::Field;
use serde::Serialize;
use serde_json::{Value, json};

use super::beside::{empty, judged, line};
use super::potential::{Scene as Pictured, draw_heat};
use super::settings::Settings;
use crate::drive::flight::Ending;
use crate::scenario::input::InputError;
use crate::study::reproduce::{Beside, Judgement, Study, Verdict, Watch};
use crate::world::{Horizontal, from_core};

/// Repulsion constants that are tried.
pub const STRENGTHS: [f32; 6] = [0.1, 1.0, 10.0, 100.0, 300.0, 1000.0];
/// Influence ranges that are tried.
pub const RANGES_M: [f32; 3] = [1.0, 2.0, 5.0];
/// Start and goal (variants paper, section IV), x east and y north.
const START_M: [f64; 2] = [-7.0, -7.0];
const GOAL_M: [f64; 2] = [8.0, 8.0];
/// How far beside the printed start the second run starts.
const ASIDE_M: f64 = 0.05;
/// Distance to the goal that counts as reached.
const TOLERANCE_M: f64 = 0.05;
/// Distance from an obstacle's point that counts as a collision.
const HULL_M: f64 = 0.15;
/// The dynamic obstacle's velocity.
const MOVING_MPS: [f64; 2] = [-1.0, 0.0];
/// Longest step, and longest time of a step.
const STEP_M: f64 = 0.01;
const STEP_S: f64 = 1e-3;
/// When a run is given up.
const TIME_S: f64 = 30.0;
const STEPS: usize = 100_000;
/// Steps from point to point of a picture.
const PICTURED: usize = 20;

/// A field of the paper.
struct Algorithm {
    name: &'static str,
    label: &'static str,
    kind: Kind,
    /// The times of its Table I; `None` where it does not reach the goal.
    printed_s: [Option<f64>; SCENES.len()],
}

const ALGORITHMS: [Algorithm; 4] = [
    Algorithm {
        name: "khatib",
        label: "traditional",
        kind: Kind::Khatib,
        printed_s: [Some(6.370), None, None, Some(5.948)],
    },
    Algorithm {
        name: "rizqi",
        label: "modified",
        kind: Kind::Rizqi,
        printed_s: [Some(6.189), None, None, Some(5.944)],
    },
    Algorithm {
        name: "sun",
        label: "optimized",
        kind: Kind::Sun,
        printed_s: [Some(9.514), Some(12.818), Some(11.614), Some(8.962)],
    },
    Algorithm {
        name: "virtual_force",
        label: "virtual force",
        kind: Kind::VirtualForce,
        printed_s: [Some(3.523), Some(4.507), None, Some(3.249)],
    },
];

/// A scene of the paper: the obstacles that stand, and the one that moves.
struct Scene {
    name: &'static str,
    label: &'static str,
    standing_m: &'static [[f64; 2]],
    moving_m: Option<[f64; 2]>,
}

const SCENES: [Scene; 4] = [
    Scene { name: "one_obstacle", label: "one obstacle", standing_m: &[[0.0, 0.0]], moving_m: None },
    Scene { name: "two_obstacles", label: "two obstacles", standing_m: &[[-1.0, 1.0], [1.0, -1.0]], moving_m: None },
    Scene { name: "gnron", label: "obstacle near the goal", standing_m: &[[6.0, 6.0]], moving_m: None },
    Scene { name: "dynamic", label: "dynamic obstacle", standing_m: &[[0.0, -1.0]], moving_m: Some([6.0, 4.0]) },
];

/// Cells of the table.
const CELLS: usize = ALGORITHMS.len() * SCENES.len();

/// The experiment's result.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// `apf-variants`.
    pub experiment: &'static str,
    /// Settings of the gains that were tried.
    pub settings: usize,
    /// From the printed start.
    pub printed_start: Outcome,
    /// From beside it.
    pub beside: Outcome,
}

/// The table from one start.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// How far beside the printed start.
    pub aside_m: f64,
    /// Common gains that come nearest to the printed table.
    pub k_rep: f32,
    /// Their influence range.
    pub influence_m: f32,
    /// Cells of these gains that agree with the printed table about who reaches the goal.
    pub agreeing: usize,
    /// Settings of the gains with which all of them agree.
    pub reproducing_settings: usize,
    /// A field in a scene each, with these gains.
    pub cells: Vec<Cell>,
}

/// A field in a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Cell {
    /// The scene.
    pub scene: &'static str,
    /// The field.
    pub algorithm: &'static str,
    /// How it ended.
    pub result: Ending,
    /// When it reached the goal.
    pub time_s: Option<f64>,
    /// Length of the path.
    pub path_length_m: f64,
    /// Least distance from an obstacle.
    pub min_distance_m: f64,
    /// The printed time; `None` where the paper does not reach the goal.
    pub printed_time_s: Option<f64>,
    /// Whether both reach the goal, or both do not.
    pub agrees: bool,
    /// Of all settings of the gains, those with which it reaches the goal.
    pub reaching_settings: usize,
    #[serde(skip)]
    path: Vec<Horizontal>,
}

/// One run.
struct Run {
    result: Ending,
    time_s: f64,
    length_m: f64,
    min_distance_m: f64,
    path: Vec<Horizontal>,
}

fn law(kind: Kind, gains: &Gains) -> Law {
    Law { k_virtual: 0.25 * gains.k_rep * gains.influence_m, ..Law::of(kind) }
}

impl Scene {
    fn obstacles_at(&self, time_s: f64) -> impl Iterator<Item = Horizontal> {
        let moved = self.moving_m.map(|[x, y]| [x + MOVING_MPS[0] * time_s, y + MOVING_MPS[1] * time_s]);
        self.standing_m.iter().copied().chain(moved).map(Horizontal::from_xy)
    }

    fn poles_at(&self, time_s: f64) -> Vec<Obstacle> {
        let pole = |center: Horizontal| Obstacle { center_ned_m: center.to_core(), ..Obstacle::default() };
        self.obstacles_at(time_s).map(pole).collect()
    }

    fn run(&self, field: &Field, start: Horizontal) -> Run {
        let goal = Horizontal::from_xy(GOAL_M);
        let (mut position, mut time_s) = (start, 0.0);
        let mut run =
            Run { result: Ending::Timeout, time_s: 0.0, length_m: 0.0, min_distance_m: f64::INFINITY, path: vec![] };
        for step in 0..STEPS {
            if step % PICTURED == 0 {
                run.path.push(position);
            }
            let distances = self.obstacles_at(time_s).map(|center| position.minus(center).norm());
            run.min_distance_m = distances.fold(run.min_distance_m, f64::min);
            if run.min_distance_m < HULL_M {
                run.result = Ending::Collision;
            } else if goal.minus(position).norm() <= TOLERANCE_M {
                run.result = Ending::Reached;
            }
            if run.result != Ending::Timeout || time_s > TIME_S {
                break;
            }
            let force = from_core(field.force(position.to_core(), goal.to_core(), &self.poles_at(time_s)));
            let step_s = STEP_S.min(STEP_M / force.norm().max(1e-9));
            position = position.along(force, step_s);
            run.length_m += force.norm() * step_s;
            time_s += step_s;
        }
        run.path.push(position);
        run.time_s = time_s;
        run
    }
}

/// All cells of the table with one setting, scene by scene.
fn table(gains: Gains, start: Horizontal) -> Vec<Cell> {
    let mut cells = Vec::with_capacity(CELLS);
    for (index, scene) in SCENES.iter().enumerate() {
        for algorithm in &ALGORITHMS {
            let run = scene.run(&Field { law: law(algorithm.kind, &gains), gains }, start);
            let printed_time_s = algorithm.printed_s[index];
            let reached = run.result == Ending::Reached;
            cells.push(Cell {
                scene: scene.name,
                algorithm: algorithm.name,
                result: run.result,
                time_s: reached.then_some(run.time_s),
                path_length_m: run.length_m,
                min_distance_m: run.min_distance_m,
                printed_time_s,
                agrees: reached == printed_time_s.is_some(),
                reaching_settings: 0,
                path: run.path,
            });
        }
    }
    cells
}

fn agreeing(cells: &[Cell]) -> usize {
    cells.iter().filter(|cell| cell.agrees).count()
}

impl Outcome {
    fn from(aside_m: f64) -> Self {
        let aside = aside_m * std::f64::consts::FRAC_1_SQRT_2;
        let start = Horizontal::from_xy([START_M[0] - aside, START_M[1] + aside]);
        let mut nearest: Option<(Gains, Vec<Cell>)> = None;
        let mut reaching = [0; CELLS];
        let mut reproducing_settings = 0;
        for k_rep in STRENGTHS {
            for influence_m in RANGES_M {
                let gains = Gains { k_att: 1.0, k_rep, influence_m, swirl: 0.0 };
                let cells = table(gains, start);
                for (count, cell) in reaching.iter_mut().zip(&cells) {
                    *count += usize::from(cell.result == Ending::Reached);
                }
                reproducing_settings += usize::from(agreeing(&cells) == CELLS);
                if nearest.as_ref().is_none_or(|(_, best)| agreeing(&cells) > agreeing(best)) {
                    nearest = Some((gains, cells));
                }
            }
        }
        let (gains, mut cells) = nearest.unwrap_or_default();
        for (cell, count) in cells.iter_mut().zip(reaching) {
            cell.reaching_settings = count;
        }
        let Gains { k_rep, influence_m, .. } = gains;
        Self { aside_m, k_rep, influence_m, agreeing: agreeing(&cells), reproducing_settings, cells }
    }
}

impl Study for Report {
    const NAME: &'static str = "apf-variants";
    const TITLE: &'static str = "Four potential fields in four scenes with local minima";
    const SOURCE: &'static str = "variants paper, Table I, fig. 2 to 5";
    const NOTE: &'static str = "\
        The paper prints no gains, and nothing of the controller that takes the force: here a point flows along it. \
        From the exact start three of the four fields never pass the first obstacle, so these are from 5 cm beside \
        it, with the common gains that come nearest to the table. No gains that were tried reproduce all of it.";

    fn chosen(_: &Settings) -> Value {
        json!({})
    }

    fn run(_: &Settings, _: Watch<'_>) -> Result<Self, InputError> {
        Ok(Self {
            experiment: "apf-variants",
            settings: STRENGTHS.len() * RANGES_M.len(),
            printed_start: Outcome::from(0.0),
            beside: Outcome::from(ASIDE_M),
        })
    }

    fn table(&self) -> String {
        let mut text = String::from(
            "Four fields in four scenes, a point that flows along the force; time to the goal and length of the path\n",
        );
        for (name, outcome) in
            [("From the printed start", &self.printed_start), ("From 0.05 m beside it", &self.beside)]
        {
            let Outcome { k_rep, influence_m, agreeing, reproducing_settings, .. } = outcome;
            let _ = writeln!(
                text,
                "\n{name}; the gains nearest to the printed table: k_r {k_rep}, rho_0 {influence_m} m, {agreeing} of \
                 {CELLS} cells\n{:<24}{:<15}{:>10}  {:<10}{:>9}{:>10}   reached with",
                "scene", "field", "printed", "here", "time", "length"
            );
            for (index, cell) in outcome.cells.iter().enumerate() {
                let seconds = |time: Option<f64>| time.map_or_else(|| "-".to_owned(), |time| format!("{time:.3} s"));
                let (scene, algorithm) = (&SCENES[index / ALGORITHMS.len()], &ALGORITHMS[index % ALGORITHMS.len()]);
                let result = match cell.result {
                    Ending::Reached => "reached",
                    Ending::Collision => "collision",
                    _ => "stalls",
                };
                let _ = writeln!(
                    text,
                    "{:<24}{:<15}{:>10}  {result:<10}{:>9}{:>8.2} m   {:>2} of {} settings{}",
                    if index % ALGORITHMS.len() == 0 { scene.label } else { "" },
                    algorithm.label,
                    seconds(cell.printed_time_s),
                    seconds(cell.time_s),
                    cell.path_length_m,
                    cell.reaching_settings,
                    self.settings,
                    if cell.agrees { "" } else { "   NOT as printed" }
                );
            }
            let verdict = match reproducing_settings {
                0 => "No common gains of those tried reproduce who reaches the goal in the printed table.".to_owned(),
                count => format!("{count} of the {} settings reproduce who reaches the goal.", self.settings),
            };
            let _ = writeln!(text, "{verdict}");
        }
        let free_s = libm::log(libm::hypot(GOAL_M[0] - START_M[0], GOAL_M[1] - START_M[1]) / TOLERANCE_M);
        let _ = writeln!(
            text,
            "\nWith k_a = 1 the way without obstacles takes {free_s:.2} s: the printed times of the virtual force need other \
             gains, which the paper does not print."
        );
        text
    }

    /// Draws the paths from beside the printed start in the traditional potential; says which file that is.
    fn figures(&self, folder: &Path) -> Result<Vec<PathBuf>, InputError> {
        let map = folder.join("apf-variants.svg");
        let scenes: Vec<Pictured> = (0..SCENES.len()).map(|index| self.pictured(index)).collect();
        draw_heat(&scenes, &map)?;
        Ok(vec![map])
    }

    /// Times to the goal, from beside the printed start.
    fn verdict(&self) -> Vec<Beside> {
        let seconds = |time_s: Option<f64>, otherwise: &str| {
            time_s.map_or_else(|| otherwise.to_owned(), |time_s| format!("{time_s:.3} s"))
        };
        let cell = |cell: &Cell| {
            let otherwise = if cell.result == Ending::Collision { "collides" } else { "stalls" };
            let words = [seconds(cell.printed_time_s, "does not reach it"), seconds(cell.time_s, otherwise), empty()];
            let what =
                format!("time to the goal, {}: {}", cell.scene.replace('_', " "), cell.algorithm.replace('_', " "));
            line::<Self>(what, words)
        };
        let mut lines: Vec<Beside> = self.beside.cells.iter().map(cell).collect();
        let cells = self.beside.cells.len();
        let words = [format!("{cells} of {cells}"), format!("{} of {cells}", self.beside.agreeing), empty()];
        lines.push(line::<Self>("cells of the table that agree on who reaches the goal".to_owned(), words));
        lines
    }

    fn judgements(&self) -> Vec<Judgement> {
        let figure = |number: usize, scene: &Scene| {
            let cells: Vec<&Cell> = self.beside.cells.iter().filter(|cell| cell.scene == scene.name).collect();
            let agreeing = cells.iter().filter(|cell| cell.printed_time_s.is_some() == cell.time_s.is_some()).count();
            let why = format!(
                "{agreeing} of {} fields end as printed, from 5 cm beside the printed start and with gains that are ours: the \
                 paper prints none.",
                cells.len()
            );
            let verdict = Verdict::of(agreeing == cells.len(), false);
            judged::<Self>(&format!("variants paper, fig. {number}"), verdict, why)
        };
        let mut all: Vec<Judgement> = (2..).zip(&SCENES).map(|(number, scene)| figure(number, scene)).collect();
        let (agreeing, cells) = (self.beside.agreeing, self.beside.cells.len());
        let why = format!(
            "{agreeing} of {cells} cells agree on who reaches the goal; its times depend on gains and a controller that are not \
             printed, and no gains that were tried give all of them."
        );
        all.insert(0, judged::<Self>("variants paper, Table I", Verdict::of(agreeing == cells, false), why));
        all
    }
}

impl Report {
    fn pictured(&self, index: usize) -> Pictured {
        let Outcome { k_rep, influence_m, cells, .. } = &self.beside;
        let gains = Gains { k_att: 1.0, k_rep: *k_rep, influence_m: *influence_m, swirl: 0.0 };
        let scene = &SCENES[index];
        let cells = cells.iter().filter(|cell| cell.scene == scene.name);
        Pictured {
            title: format!("{}: the traditional potential", scene.label),
            bounds: [-10.0, -10.0, 14.0, 14.0],
            field: Field { law: Law::of(Kind::Khatib), gains },
            obstacles: scene.poles_at(0.0),
            pillars: scene.obstacles_at(0.0).map(|center| (center, HULL_M)).collect(),
            start: Horizontal::from_xy(START_M),
            goal: Horizontal::from_xy(GOAL_M),
            paths: ALGORITHMS.iter().zip(cells).map(|(algorithm, cell)| (algorithm.label, cell.path.clone())).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_an_obstacle_the_point_flows_to_the_goal_in_the_time_of_the_exponential() {
        let open = Scene { name: "", label: "", standing_m: &[], moving_m: None };
        let gains = Gains { k_att: 1.0, k_rep: 1.0, influence_m: 1.0, swirl: 0.0 };
        let run = open.run(&Field { law: Law::of(Kind::Khatib), gains }, Horizontal::from_xy(START_M));
        assert_eq!(run.result, Ending::Reached);
        let exact_s = (15.0 * 2.0_f64.sqrt() / TOLERANCE_M).ln();
        assert!((run.time_s - exact_s).abs() < 0.02, "{} {exact_s}", run.time_s);
        assert!((run.length_m - (15.0 * 2.0_f64.sqrt() - TOLERANCE_M)).abs() < 0.01, "{}", run.length_m);
    }
}
