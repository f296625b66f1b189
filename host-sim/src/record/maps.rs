//! The picture of a suite: its maps side by side, one line per row of the table, every unit square shaded by its
//! density.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::{Circle, DrawingArea, DrawingBackend, PathElement, RGBColor, Rectangle};
use plotters::style::Color as _;
use plotters::style::text_anchor::{HPos, VPos};

use super::sheet::{self, Drawn, FAINT_INK, FRAME, INK, line, pixels, write_svg};
use crate::drive::maps::{Cells, Density, Pair, Pillar, densities};
use crate::drive::suite::{Map, Suite};
use crate::scenario::input::InputError;

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
        let [west, south, east, north] = suite.bounds;
        let scale = MAP / (east - west).max(north - south);
        let tile = Tile { area, left, bottom: top + (north - south) * scale, west, south, scale };
        tile.draw(suite.bounds, map)?;
    }
    Ok(())
}

/// One map on the sheet.
struct Tile<'a, B: DrawingBackend> {
    area: &'a DrawingArea<B, Shift>,
    left: f64,
    bottom: f64,
    west: f64,
    south: f64,
    scale: f64,
}

impl<B: DrawingBackend> Tile<'_, B> {
    fn at(&self, x: f64, y: f64) -> (i32, i32) {
        (pixels(self.left + (x - self.west) * self.scale), pixels(self.bottom - (y - self.south) * self.scale))
    }

    fn draw(&self, bounds: [f64; 4], map: &Map) -> Drawn<B> {
        let shares = densities(bounds, &map.obstacles);
        self.squares(bounds, &shares)?;
        for pair in &map.pairs {
            self.pair(pair)?;
        }
        for pillar in &map.obstacles {
            self.pillar(pillar)?;
        }
        let [west, south, east, north] = bounds;
        self.area.draw(&Rectangle::new([self.at(west, north), self.at(east, south)], line(FRAME, 1.0, 1.0)))?;
        let Density { mean, variance } = Density::of(&shares);
        let top = self.bottom - (north - south) * self.scale;
        let title = format!("row {}, map {}", map.row, map.instance);
        self.text(&title, [self.left, top - 8.0], INK, HPos::Left)?;
        let numbers = format!("mean {mean:.4}, variance {variance:.4}");
        self.text(&numbers, [self.left + (east - west) * self.scale, top - 8.0], FAINT_INK, HPos::Right)
    }

    fn squares(&self, bounds: [f64; 4], shares: &[f64]) -> Drawn<B> {
        let cells = Cells::new(bounds);
        for (index, share) in shares.iter().enumerate() {
            let [west, south, east, north] = cells.square(index % cells.columns, index / cells.columns);
            let shade = SHADE.mix(0.6 * (share / DARKEST).min(1.0)).filled();
            self.area.draw(&Rectangle::new([self.at(west, north), self.at(east, south)], shade))?;
        }
        Ok(())
    }

    fn pair(&self, [x0, y0, x1, y1, _]: &Pair) -> Drawn<B> {
        let (start, goal) = (self.at(*x0, *y0), self.at(*x1, *y1));
        self.area.draw(&PathElement::new(vec![start, goal], line(WAY, 0.12, 0.75)))?;
        self.area.draw(&Circle::new(start, pixels(1.8), WAY.mix(0.7).filled()))?;
        self.area.draw(&Circle::new(goal, pixels(1.8), GOAL.mix(0.7).filled()))
    }

    fn pillar(&self, [x, y, r]: &Pillar) -> Drawn<B> {
        self.area.draw(&Circle::new(self.at(*x, *y), pixels(r * self.scale), PILLAR.filled()))
    }

    fn text(&self, what: &str, at: [f64; 2], color: RGBColor, anchor: HPos) -> Drawn<B> {
        sheet::text(self.area, what, at, 13.0, color, (anchor, VPos::Bottom))
    }
}
