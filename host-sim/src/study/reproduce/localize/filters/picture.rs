//! Fig. 2 and 3 of the mmWave paper, with both filters: where they take the robot to be from the transponder, and how far
//! they are off.

use std::path::Path;

use foxhound_core::localize::source::{Estimate, Sighting};

use super::super::super::chart::{Axis, Chart, Panel, Series};
use super::Report;
use super::trial::{Course, Gathered};
use crate::scenario::input::InputError;
use crate::world::{Horizontal, from_core};

/// Half of the sides of the maps.
const MAPS_M: [f64; 2] = [80.0, 40.0];

/// One run of an experiment, and the medians of all.
#[derive(Clone, Debug, Default)]
pub(super) struct Figure {
    pub(super) title: String,
    /// Positions from the transponder, x east and y north: the truth, the paper's filter, ours.
    places: [Vec<(f64, f64)>; 3],
    /// Medians of the error at each sighting: the paper's filter, ours.
    medians_m: [Vec<(f64, f64)>; 2],
}

impl Figure {
    pub(super) fn new(
        course: &Course,
        sightings: &[Sighting],
        paper: &[Option<Estimate>],
        ours: &[Option<Estimate>],
    ) -> Self {
        let truth = course.robot.iter().zip(&course.source).map(|(robot, source)| robot.minus(*source).xy());
        let places = |estimates: &[Option<Estimate>]| {
            let both = estimates.iter().zip(sightings);
            both.filter_map(|(estimate, sighting)| {
                let place = from_core(sighting.place_ned_m).minus(from_core((*estimate)?.place_ned_m));
                Some(Horizontal::xy(place))
            })
            .collect()
        };
        Self { places: [truth.collect(), places(paper), places(ours)], ..Self::default() }
    }

    pub(super) fn medians(&mut self, paper: &Gathered, ours: &Gathered) {
        self.medians_m = [paper, ours].map(|gathered| {
            let medians = gathered.over_time_m.iter().enumerate().map(|(k, errors)| {
                let mut sorted = errors.clone();
                sorted.sort_by(f64::total_cmp);
                (k as f64, sorted.get(sorted.len() / 2).copied().unwrap_or(0.0))
            });
            medians.collect()
        });
    }

    fn panels(&self, map_m: f64, level: (f64, &str)) -> [Panel; 2] {
        let series = |label: &str, points: &[(f64, f64)]| Series {
            label: label.to_owned(),
            dashed: false,
            points: points.to_vec(),
        };
        let [truth, paper, ours] = &self.places;
        let map = Panel {
            title: format!("{}: one run", self.title),
            x: Axis::linear("robot from transponder, east, m", -map_m, map_m, 20.0),
            y: Axis::linear("north, m", -map_m, map_m, 20.0),
            series: vec![series("the paper's filter", paper), series("Foxhound", ours), series("truth", truth)],
            bars: Vec::new(),
            level: None,
        };
        let [paper, ours] = &self.medians_m;
        let last = ours.len().saturating_sub(1) as f64;
        let errors = Panel {
            title: format!("{}: median of all runs", self.title),
            x: Axis::linear("sightings", 0.0, last.max(1.0), 50.0),
            y: Axis::decades("error of the transponder's place, m", 0.1, 100.0),
            series: vec![series("the paper's filter", paper), series("Foxhound", ours)],
            bars: Vec::new(),
            level: Some((level.0, level.1.to_owned())),
        };
        [map, errors]
    }
}

impl Report {
    /// Draws fig. 2 and 3: one run each, and the error over time.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn draw(&self, path: &Path) -> Result<(), InputError> {
        let [direct, reflected] = &self.figures;
        let panels = direct
            .panels(MAPS_M[0], (1.0, "the paper ends here"))
            .into_iter()
            .chain(reflected.panels(MAPS_M[1], (super::PAPER_FIG_3_M, "the paper ends here")));
        let title = "Localizing with bearings of 0.05 rad and random motions".to_owned();
        Chart { title, panels: panels.collect() }.draw(path)
    }
}
