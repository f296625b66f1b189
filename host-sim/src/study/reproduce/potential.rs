//! Pictures of a potential field: heat maps with what was flown in them.
//!
//! The potential is shown up to a ceiling, in bands; what is above it has the colour of the highest band.

use std::path::Path;

use foxhound_core::base::obstacle::Obstacle;
use foxhound_papers::apf::Field;
use plotters::coord::Shift;
use plotters::prelude::{DrawingArea, DrawingBackend, RGBColor, Rectangle};
use plotters::style::text_anchor::{HPos, VPos};

use crate::record::sheet::{Drawn, FAINT_INK, FRAME, INK, Map, PAPER, fill, line, path, text, write_svg};
use crate::scenario::input::InputError;
use crate::world::Horizontal;

/// Side of a map and what is around it, in points.
const MAP: f64 = 420.0;
const EDGE: f64 = 48.0;
const GAP: f64 = 56.0;
const TITLE: f64 = 64.0;
const LEGEND: f64 = 64.0;
/// Maps side by side.
const COLUMNS: usize = 2;
/// Cells of a map's side.
const CELLS: usize = 120;
const BANDS: usize = 28;

const PILLAR: RGBColor = RGBColor(75, 85, 99);
const START: RGBColor = RGBColor(21, 128, 61);
const GOAL: RGBColor = RGBColor(220, 38, 38);
/// Colours of the paths.
pub(super) const PATHS: [RGBColor; 4] =
    [RGBColor(255, 255, 255), RGBColor(240, 140, 30), RGBColor(220, 38, 38), RGBColor(96, 200, 255)];
/// Colours of the potential, from low to high.
const HEAT: [RGBColor; 6] = [
    RGBColor(48, 18, 92),
    RGBColor(62, 74, 137),
    RGBColor(38, 112, 142),
    RGBColor(30, 147, 140),
    RGBColor(94, 201, 98),
    RGBColor(240, 229, 80),
];

/// A field, the obstacles in it, and what was flown there.
pub(super) struct Scene {
    pub(super) title: String,
    /// West, south, east, north.
    pub(super) bounds: [f64; 4],
    pub(super) field: Field,
    pub(super) obstacles: Vec<Obstacle>,
    /// What is drawn of the obstacles: centres and radii.
    pub(super) pillars: Vec<(Horizontal, f64)>,
    pub(super) start: Horizontal,
    pub(super) goal: Horizontal,
    /// Names and places; each takes its colour of [`PATHS`].
    pub(super) paths: Vec<(&'static str, Vec<Horizontal>)>,
}

type Sheet<'a, B> = DrawingArea<B, Shift>;

impl Scene {
    fn potential(&self, x: f64, y: f64) -> f64 {
        let place = Horizontal::from_xy([x, y]).to_core();
        f64::from(self.field.potential(place, self.goal.to_core(), &self.obstacles))
    }

    /// What the potential is shown up to: that of the attraction in the farthest corner.
    fn ceiling(&self) -> f64 {
        let [west, south, east, north] = self.bounds;
        let far = [[west, south], [west, north], [east, south], [east, north]]
            .map(|corner| self.goal.minus(Horizontal::from_xy(corner)).norm());
        let farthest_m = far.into_iter().fold(0.0, f64::max);
        0.5 * f64::from(self.field.gains.k_att) * farthest_m * farthest_m
    }

    /// Width of a path: those drawn first show on both sides of those drawn over them.
    fn width(&self, index: usize) -> f64 {
        1.8 + 1.5 * self.paths.len().saturating_sub(1 + index) as f64
    }

    /// Coordinate at a share of the width, from one side to the other.
    fn at(&self, share_x: f64, share_y: f64) -> [f64; 2] {
        let [west, south, east, north] = self.bounds;
        [west + (east - west) * share_x, south + (north - south) * share_y]
    }
}

/// Where a potential is between nothing and the ceiling; roots, so that the ground near the goal has relief too.
fn level(potential: f64, ceiling: f64) -> f64 {
    if potential.is_finite() { libm::sqrt((potential / ceiling).clamp(0.0, 1.0)) } else { 1.0 }
}

fn band(level: f64) -> usize {
    ((level * BANDS as f64) as usize).min(BANDS - 1)
}

/// Colour of a band; `shade` 1 is as it is, less is darker.
fn color(band: usize, shade: f64) -> RGBColor {
    let at = band as f64 / (BANDS - 1) as f64 * (HEAT.len() - 1) as f64;
    let index = (at as usize).min(HEAT.len() - 2);
    let (from, to, share) = (HEAT[index], HEAT[index + 1], at - index as f64);
    let mix = |a: u8, b: u8| ((f64::from(a) + (f64::from(b) - f64::from(a)) * share) * shade).clamp(0.0, 255.0) as u8;
    RGBColor(mix(from.0, to.0), mix(from.1, to.1), mix(from.2, to.2))
}

/// Draws the fields side by side as heat maps.
///
/// # Errors
/// The file cannot be written.
pub(super) fn draw_heat(scenes: &[Scene], path: &Path) -> Result<(), InputError> {
    let columns = scenes.len().clamp(1, COLUMNS);
    let lines = scenes.len().div_ceil(COLUMNS).max(1);
    let width = 2.0 * EDGE + columns as f64 * (MAP + GAP) - GAP;
    let page = [width, EDGE + lines as f64 * (TITLE + MAP + LEGEND)];
    write_svg(path, page, |area| {
        for (index, scene) in scenes.iter().enumerate() {
            let left = EDGE + (index % COLUMNS) as f64 * (MAP + GAP);
            let top = TITLE + (index / COLUMNS) as f64 * (TITLE + MAP + LEGEND);
            heat(area, scene, [left, top])?;
        }
        Ok(())
    })
}

fn heat<B: DrawingBackend>(area: &Sheet<'_, B>, scene: &Scene, [left, top]: [f64; 2]) -> Drawn<B> {
    let [west, south, east, north] = scene.bounds;
    let map = Map::within(area, scene.bounds, [left, top], MAP);
    let [right, bottom] = map.end();
    let at = |x: f64, y: f64| map.at(Horizontal::from_xy([x, y]));
    let inside = |place: Horizontal| {
        let (x, y) = place.xy();
        Horizontal::from_xy([x.clamp(west, east), y.clamp(south, north)])
    };
    text(area, &scene.title, [left, top - 10.0], 16.0, INK, (HPos::Left, VPos::Bottom))?;

    let ceiling = scene.ceiling();
    let edge = |cell: usize| cell as f64 / CELLS as f64;
    for row in 0..CELLS {
        let of = |column: usize| {
            let [x, y] = scene.at(edge(column) + 0.5 * edge(1), edge(row) + 0.5 * edge(1));
            band(level(scene.potential(x, y), ceiling))
        };
        // Neighbours of one band make one rectangle.
        let bands: Vec<usize> = (0..CELLS).map(of).collect();
        let mut column = 0;
        for run in bands.chunk_by(|a, b| a == b) {
            let ([x0, y0], [x1, y1]) =
                (scene.at(edge(column), edge(row)), scene.at(edge(column + run.len()), edge(row + 1)));
            // A little over its neighbours to the east and north, which are drawn later: no seams.
            let ((left, top), (right, bottom)) = (at(x0, y1), at(x1, y0));
            let over = |pixel: i32, by: i32, edge: (i32, i32)| (pixel + by).clamp(edge.0, edge.1);
            let (north_west, south_east) = (at(west, north), at(east, south));
            let corners = [
                (left, over(top, -2, (north_west.1, south_east.1))),
                (over(right, 2, (north_west.0, south_east.0)), bottom),
            ];
            area.draw(&Rectangle::new(corners, fill(color(run[0], 1.0), 1.0)))?;
            column += run.len();
        }
    }
    for (center, radius_m) in &scene.pillars {
        map.dot(inside(*center), (radius_m * map.scale).max(3.0), fill(PILLAR, 0.85))?;
    }
    for (index, ((_, places), color)) in scene.paths.iter().zip(PATHS).enumerate() {
        let width = scene.width(index);
        for style in [line(INK, 0.55, width + 1.4), line(color, 1.0, width)] {
            map.path(places.iter().map(|place| inside(*place)), style)?;
        }
    }
    for (end, color) in [(scene.start, START), (scene.goal, GOAL)] {
        map.dot(inside(end), 6.0, fill(PAPER, 1.0))?;
        map.dot(inside(end), 4.4, fill(color, 1.0))?;
    }
    map.rectangle(scene.bounds, line(FRAME, 1.0, 1.0))?;
    for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let [x, y] = scene.at(share, share);
        let [x_at, y_at] = map.points(Horizontal::from_xy([x, y]));
        text(area, &format!("{x}"), [x_at, bottom + 6.0], 12.0, FAINT_INK, (HPos::Center, VPos::Top))?;
        text(area, &format!("{y}"), [left - 6.0, y_at], 12.0, FAINT_INK, (HPos::Right, VPos::Center))?;
    }
    text(area, "x east and y north, m", [right, top - 10.0], 12.0, FAINT_INK, (HPos::Right, VPos::Bottom))?;
    let mut x = left;
    for ((name, _), color) in scene.paths.iter().zip(PATHS) {
        let y = bottom + 30.0;
        for style in [line(INK, 0.55, 3.2), line(color, 1.0, 1.8)] {
            path(area, [[x, y], [x + 20.0, y]], style)?;
        }
        text(area, name, [x + 26.0, y], 12.0, INK, (HPos::Left, VPos::Center))?;
        x += 40.0 + 7.0 * name.len() as f64;
    }
    Ok(())
}
