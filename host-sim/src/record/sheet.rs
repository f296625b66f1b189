//! Sheets of the pictures: lengths in points, north up, an SVG file.
//!
//! The drawing library has whole pixels only: a sheet is drawn [`OVERSIZE`] times as large and shown at its size.

use std::fmt;
use std::io;
use std::path::Path;

use plotters::coord::Shift;
use plotters::drawing::DrawingAreaErrorKind;
use plotters::prelude::{
    Circle, DrawingArea, DrawingBackend, FontStyle, IntoDrawingArea as _, IntoFont as _, PathElement, RGBColor,
    Rectangle, SVGBackend, Text, TextStyle,
};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, ShapeStyle, register_font};

use crate::scenario::input::InputError;
use crate::scenario::output;
use crate::world::Horizontal;

/// Pixels of a point.
pub(crate) const OVERSIZE: u32 = 4;

pub(crate) const PAPER: RGBColor = RGBColor(255, 255, 255);
pub(crate) const GROUND: RGBColor = RGBColor(247, 248, 250);
pub(crate) const GRID: RGBColor = RGBColor(228, 231, 236);
pub(crate) const FRAME: RGBColor = RGBColor(176, 184, 196);
pub(crate) const INK: RGBColor = RGBColor(31, 41, 55);
pub(crate) const FAINT_INK: RGBColor = RGBColor(107, 114, 128);

pub(crate) type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// Position of the anchor in a text.
pub(crate) type Anchor = (HPos, VPos);

/// Prepares a picture: loads the font.
pub(crate) fn prepare() -> Result<(), InputError> {
    register_font("sans-serif", FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)
        .map_err(|_| InputError::new("the built-in font cannot be read"))
}

/// An error about a picture's file.
pub(crate) fn failed(path: &Path, error: &dyn fmt::Display) -> InputError {
    InputError::new(error.to_string()).in_file(path)
}

/// Draws a sheet of this size, in points, into an SVG file.
///
/// # Errors
/// The file cannot be written.
pub(crate) fn write_svg(
    path: &Path,
    page: [f64; 2],
    draw: impl FnOnce(&DrawingArea<SVGBackend<'_>, Shift>) -> Result<(), DrawingAreaErrorKind<io::Error>>,
) -> Result<(), InputError> {
    prepare()?;
    let size = page.map(|points| pixels(points) as u32);
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, size.into()).into_drawing_area();
    area.fill(&PAPER).and_then(|()| draw(&area)).and_then(|()| area.present()).map_err(|error| failed(path, &error))?;
    drop(area);
    let svg = svg.replacen(&format!("width=\"{}\"", size[0]), &format!("width=\"{}\"", page[0]), 1).replacen(
        &format!("height=\"{}\"", size[1]),
        &format!("height=\"{}\"", page[1]),
        1,
    );
    output::write(path, svg.as_bytes())
}

pub(crate) fn pixels(points: f64) -> i32 {
    libm::rint(points * f64::from(OVERSIZE)) as i32
}

pub(crate) fn fill(color: RGBColor, opacity: f64) -> ShapeStyle {
    color.mix(opacity).filled()
}

pub(crate) fn line(color: RGBColor, opacity: f64, width: f64) -> ShapeStyle {
    color.mix(opacity).stroke_width(pixels(width).max(1) as u32)
}

/// Writes a text of this size at a place.
pub(crate) fn text<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    what: &str,
    [x, y]: [f64; 2],
    size: f64,
    color: RGBColor,
    (horizontal, vertical): Anchor,
) -> Drawn<B> {
    let style = TextStyle::from(("sans-serif", size * f64::from(OVERSIZE)).into_font())
        .color(&color)
        .pos(Pos::new(horizontal, vertical));
    area.draw(&Text::new(what.to_owned(), (pixels(x), pixels(y)), style))
}

/// Draws a path through places.
pub(crate) fn path<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    points: impl IntoIterator<Item = [f64; 2]>,
    style: ShapeStyle,
) -> Drawn<B> {
    let points: Vec<(i32, i32)> = points.into_iter().map(|[x, y]| (pixels(x), pixels(y))).collect();
    area.draw(&PathElement::new(points, style))
}

/// A map on a sheet, which takes places.
pub(crate) struct Map<'a, B: DrawingBackend> {
    pub(crate) area: &'a DrawingArea<B, Shift>,
    /// West, south, east, north, in metres.
    pub(crate) bounds: [f64; 4],
    /// Its upper left corner, in points.
    pub(crate) corner: [f64; 2],
    /// Points a metre.
    pub(crate) scale: f64,
}

impl<'a, B: DrawingBackend> Map<'a, B> {
    /// As large as fits into a square of this side.
    pub(crate) fn within(area: &'a DrawingArea<B, Shift>, bounds: [f64; 4], corner: [f64; 2], side: f64) -> Self {
        let [west, south, east, north] = bounds;
        Self { area, bounds, corner, scale: side / (east - west).max(north - south) }
    }

    /// Its lower right corner, in points.
    pub(crate) fn end(&self) -> [f64; 2] {
        let ([west, south, east, north], [left, top]) = (self.bounds, self.corner);
        [left + (east - west) * self.scale, top + (north - south) * self.scale]
    }

    /// A place in points.
    pub(crate) fn points(&self, place: Horizontal) -> [f64; 2] {
        let ((x, y), [west, south, ..], [_, bottom]) = (place.xy(), self.bounds, self.end());
        [self.corner[0] + (x - west) * self.scale, bottom - (y - south) * self.scale]
    }

    /// A place in pixels.
    pub(crate) fn at(&self, place: Horizontal) -> (i32, i32) {
        self.points(place).map(pixels).into()
    }

    /// A circle of this radius in metres.
    pub(crate) fn circle(&self, center: Horizontal, radius_m: f64, style: ShapeStyle) -> Drawn<B> {
        self.dot(center, radius_m * self.scale, style)
    }

    /// A circle of this radius in points.
    pub(crate) fn dot(&self, center: Horizontal, radius: f64, style: ShapeStyle) -> Drawn<B> {
        self.area.draw(&Circle::new(self.at(center), pixels(radius), style))
    }

    pub(crate) fn path(&self, places: impl IntoIterator<Item = Horizontal>, style: ShapeStyle) -> Drawn<B> {
        path(self.area, places.into_iter().map(|place| self.points(place)), style)
    }

    /// A rectangle from west, south to east, north, in metres.
    pub(crate) fn rectangle(&self, [west, south, east, north]: [f64; 4], style: ShapeStyle) -> Drawn<B> {
        let corners = [[west, north], [east, south]].map(|corner| self.at(Horizontal::from_xy(corner)));
        self.area.draw(&Rectangle::new(corners, style))
    }
}
