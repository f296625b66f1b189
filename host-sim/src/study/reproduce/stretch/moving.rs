//! A source that moves: how far behind it the vehicle is.
//!
//! Once at constant velocity, and once as in fig. 7 of the paper: the source waits until the vehicle is near, moves north,
//! waits, moves on. The paper prints tracks and no numbers. Outliers at the rate of its fig. 5 (613 of 2671 errors beyond 60
//! degrees) and at 0.4.

use std::fmt::Write as _;
use std::path::Path;

use rayon::prelude::{IntoParallelIterator as _, ParallelIterator as _};
use serde::Serialize;

use super::walk::{Model, REACHED_M, Rule, STEP_M, Walk};
use crate::scenario::input::InputError;
use crate::study::reproduce::chart::{Axis, Chart, Panel, Series};
use crate::world::Horizontal;
use crate::world::random::Random;

/// Rates of outliers.
const RATES: [f64; 2] = [613.0 / 2671.0, 0.4];
/// Standard deviation of the noise.
const SIGMA_DEG: f64 = 20.0;
/// Steps of a walk.
const STEPS: u32 = 2400;
/// Purpose of the random numbers.
const DRAWS: u64 = 23;
/// Names of the rules in the reports.
const RULES: [&str; 2] = ["greedy", "filtered"];

/// How a source moves: from corner to corner, with a wait at each.
struct Course {
    name: &'static str,
    start_m: [f64; 2],
    corners_m: &'static [[f64; 2]],
    step_m: f64,
    wait_steps: u32,
}

const COURSES: [Course; 2] = [
    Course {
        name: "constant_velocity",
        start_m: [-20.0, -20.0],
        corners_m: &[[0.0, 0.0], [-120.0, 0.0]],
        step_m: 0.04,
        wait_steps: 0,
    },
    Course {
        name: "stop_and_go",
        start_m: [6.0, -14.0],
        corners_m: &[[7.0, -23.0], [7.0, -4.0], [-9.0, -4.0], [-9.0, 12.0]],
        step_m: 0.05,
        wait_steps: 200,
    },
];

impl Course {
    /// Where the source is after `steps` steps.
    fn at(&self, steps: u32) -> Horizontal {
        let mut left = steps;
        let mut here = Horizontal::from_xy(self.corners_m[0]);
        for corner in &self.corners_m[1..] {
            if left <= self.wait_steps {
                return here;
            }
            left -= self.wait_steps;
            let next = Horizontal::from_xy(*corner);
            let way = next.minus(here);
            let share = f64::from(left) * self.step_m / way.norm();
            if share < 1.0 {
                return here.along(way, share);
            }
            left -= libm::ceil(way.norm() / self.step_m) as u32;
            here = next;
        }
        here
    }
}

/// The pursuits.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Walks of each row.
    pub walks: u32,
    /// Steps of a walk.
    pub steps: u32,
    /// A course, a rate and a rule each.
    pub rows: Vec<Row>,
    #[serde(skip)]
    tracks: Vec<[Vec<(f64, f64)>; 3]>,
}

/// A rule behind a source.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// How the source moves.
    pub source: &'static str,
    /// Rate of outliers.
    pub p: f64,
    /// Standard deviation of the noise.
    pub sigma_deg: f64,
    /// Who says where to fly.
    pub rule: &'static str,
    /// Walks that came within 1 m of the source.
    pub reaching: u32,
    /// Steps until then, on average.
    pub steps_to_reach: f64,
    /// Distance from the source after that, rms over all steps of all walks.
    pub rms_m: f64,
    /// Distance that 95 % of these steps stay within.
    pub within_95_m: f64,
}

fn pursue(rule: &Rule, course: &Course, model: Model, random: Random, mut track: impl FnMut(Horizontal)) -> Vec<f64> {
    let mut walk = Walk::new(rule, model, Horizontal::from_xy(course.start_m), random);
    (0..STEPS)
        .map(|step| {
            track(walk.place);
            walk.step(course.at(step))
        })
        .collect()
}

/// Runs the pursuits, a tenth as many as there are trials.
pub(super) fn run(seed: u64, trials: u32) -> Result<Report, InputError> {
    let walks = (trials / 10).max(10);
    let rules = Rule::all()?;
    let random = |trial: u32| Random::new(seed, DRAWS + (u64::from(trial) << 8));
    let mut rows = Vec::new();
    for course in &COURSES {
        for p in RATES {
            let model = Model { outlier_rate: p, sigma_rad: SIGMA_DEG.to_radians() };
            for (rule, name) in rules.iter().zip(RULES) {
                let all: Vec<Vec<f64>> = (0..walks)
                    .into_par_iter()
                    .map(|trial| pursue(rule, course, model, random(trial), |_| ()))
                    .collect();
                let reached = |walk: &Vec<f64>| walk.iter().position(|distance_m| *distance_m <= REACHED_M);
                let arrivals: Vec<usize> = all.iter().filter_map(reached).collect();
                let mut after: Vec<f64> =
                    all.iter().filter_map(|walk| Some(&walk[reached(walk)?..])).flatten().copied().collect();
                after.sort_by(f64::total_cmp);
                let count = after.len().max(1) as f64;
                rows.push(Row {
                    source: course.name,
                    p,
                    sigma_deg: SIGMA_DEG,
                    rule: name,
                    reaching: arrivals.len() as u32,
                    steps_to_reach: arrivals.iter().sum::<usize>() as f64 / arrivals.len().max(1) as f64,
                    rms_m: libm::sqrt(after.iter().map(|distance_m| distance_m * distance_m).sum::<f64>() / count),
                    within_95_m: after.get(after.len() * 95 / 100).copied().unwrap_or(0.0),
                });
            }
        }
    }
    let model = Model { outlier_rate: RATES[1], sigma_rad: SIGMA_DEG.to_radians() };
    let tracks = COURSES.iter().map(|course| {
        let track = |rule: &Rule| {
            let mut places = Vec::new();
            pursue(rule, course, model, random(0), |place| places.push(place.xy()));
            places
        };
        let source = (0..STEPS).map(|step| course.at(step).xy()).collect();
        [source, track(&rules[0]), track(&rules[1])]
    });
    Ok(Report { walks, steps: STEPS, rows, tracks: tracks.collect() })
}

impl Report {
    pub(super) fn table(&self) -> String {
        let mut text = format!(
            "\nBehind a source that moves at 0.4 and 0.5 of our {STEP_M} m a rotation: {} walks of {} rotations\n\
             {:<20}{:>6}  {:<16}{:>14}{:>10}{:>16}{:>12}\n",
            self.walks, self.steps, "source", "p", "rule", "reaching it", "after", "distance rms", "95 %"
        );
        for row in &self.rows {
            let _ = writeln!(
                text,
                "{:<20}{:>6.3}  {:<16}{:>14}{:>10.0}{:>14.2} m{:>10.2} m",
                row.source,
                row.p,
                row.rule,
                format!("{} of {}", row.reaching, self.walks),
                row.steps_to_reach,
                row.rms_m,
                row.within_95_m
            );
        }
        text
    }

    pub(super) fn draw(&self, path: &Path) -> Result<(), InputError> {
        let axes = [
            (Axis::linear("east, m", -120.0, 10.0, 20.0), Axis::linear("north, m", -65.0, 65.0, 20.0)),
            (Axis::linear("east, m", -24.0, 24.0, 8.0), Axis::linear("north, m", -28.0, 20.0, 8.0)),
        ];
        let panels = COURSES.iter().zip(&self.tracks).zip(axes).map(|((course, tracks), (x, y))| Panel {
            title: course.name.replace('_', " "),
            x,
            y,
            series: ["source", "greedy", "filtered"]
                .into_iter()
                .zip(tracks)
                .map(|(label, track)| Series { label: label.to_owned(), dashed: false, points: track.clone() })
                .collect(),
            bars: Vec::new(),
            level: None,
        });
        let title = "Behind a source that moves: p = 0.4, sigma = 20 deg (fig. 7)".to_owned();
        Chart { title, panels: panels.collect() }.draw(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_source_waits_and_moves_at_its_pace() {
        let course = &COURSES[1];
        assert_eq!(course.at(0), course.at(200));
        for steps in 0..STEPS {
            assert!(course.at(steps + 1).minus(course.at(steps)).norm() < course.step_m + 1e-9, "{steps}");
        }
        assert!(course.at(STEPS).minus(Horizontal::from_xy([-9.0, 12.0])).norm() < 1e-9);
        assert!((COURSES[0].at(1000).minus(COURSES[0].at(0)).norm() - 40.0).abs() < 1e-9);
    }
}
