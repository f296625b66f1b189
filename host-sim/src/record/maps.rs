//! The picture of a suite: its maps side by side, one line per row of the table, every unit square shaded by its
//! density.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::{DrawingArea, DrawingBackend, RGBColor};
use plotters::style::text_anchor::{HPos, VPos};

use super::sheet::{Drawn, FAINT_INK, FRAME, INK, Map, fill, line, text, write_svg};
use crate::drive::maps::{Cells, Density, densities};
use crate::drive::suite::{self, Suite};
use crate::scenario::input::InputError;
use crate::world::Horizontal;

/// Side of a map with its margin, in points.
const MAP: f64 = 300.0;
const GAP: f64 = 28.0;
const TITLE: f64 = 30.0;
const EDGE: f64 = 32.0;
/// Maps side by side.
const COLUMNS: usize = 4;
/// Density of the darkest shade.
const DARKEST: f64 = 0.45;

const SHADE: RGBColor = RGBColor(240, 140, 30);
const PILLAR: RGBColor = RGBColor(139, 150, 167);
const WAY: RGBColor = RGBColor(62, 74, 137);
const GOAL: RGBColor = RGBColor(220, 38, 38);

/// Draws the maps of a suite into an SVG file.
///
/// # Errors
/// The file cannot be written.
pub fn draw(suite: &Suite, path: &Path) -> Result<(), InputError> {
    let columns = suite.maps.len().clamp(1, COLUMNS);
    let lines = suite.maps.len().div_ceil(COLUMNS).max(1);
    let page = [2.0 * EDGE + columns as f64 * (MAP + GAP) - GAP, 2.0 * EDGE + lines as f64 * (MAP + TITLE + GAP) - GAP];
    write_svg(path, page, |area| tiles(area, suite))
}

fn tiles<B: DrawingBackend>(area: &DrawingArea<B, Shift>, suite: &Suite) -> Drawn<B> {
    for (index, map) in suite.maps.iter().enumerate() {
        let left = EDGE + (index % COLUMNS) as f64 * (MAP + GAP);
        let top = EDGE + TITLE + (index / COLUMNS) as f64 * (MAP + TITLE + GAP);
        draw_map(&Map::within(area, suite.bounds, [left, top], MAP), map)?;
    }
    Ok(())
}

fn draw_map<B: DrawingBackend>(sheet: &Map<'_, B>, map: &suite::Map) -> Drawn<B> {
    let shares = densities(sheet.bounds, &map.obstacles);
    let cells = Cells::new(sheet.bounds);
    for (index, share) in shares.iter().enumerate() {
        let square = cells.square(index % cells.columns, index / cells.columns);
        sheet.rectangle(square, fill(SHADE, 0.6 * (share / DARKEST).min(1.0)))?;
    }
    for [x0, y0, x1, y1, _] in &map.pairs {
        let [start, goal] = [[*x0, *y0], [*x1, *y1]].map(Horizontal::from_xy);
        sheet.path([start, goal], line(WAY, 0.12, 0.75))?;
        sheet.dot(start, 1.8, fill(WAY, 0.7))?;
        sheet.dot(goal, 1.8, fill(GOAL, 0.7))?;
    }
    for [x, y, radius_m] in &map.obstacles {
        sheet.circle(Horizontal::from_xy([*x, *y]), *radius_m, fill(PILLAR, 1.0))?;
    }
    sheet.rectangle(sheet.bounds, line(FRAME, 1.0, 1.0))?;
    let Density { mean, variance } = Density::of(&shares);
    let ([left, top], [right, _]) = (sheet.corner, sheet.end());
    let title = format!("row {}, map {}", map.row, map.instance);
    text(sheet.area, &title, [left, top - 8.0], 13.0, INK, (HPos::Left, VPos::Bottom))?;
    let numbers = format!("mean {mean:.4}, variance {variance:.4}");
    text(sheet.area, &numbers, [right, top - 8.0], 13.0, FAINT_INK, (HPos::Right, VPos::Bottom))
}
