//! The picture of a flight: the world, the obstacle map, the sampled trajectories and the path flown.
//!
//! SVG or PNG, by the ending of the file. Lengths on the page are in points of a 1280 x 960 page. A PNG is
//! averaged down from the oversize page to half of it.

use std::f64::consts::TAU;
use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::{
    BitMapBackend, Circle, DrawingArea, DrawingBackend, IntoDrawingArea as _, PathElement, Polygon, RGBColor, Rectangle,
};
use plotters::style::ShapeStyle;
use plotters::style::text_anchor::{HPos, VPos};

use super::sheet::{
    self, Anchor, Drawn, FAINT_INK, FRAME, GRID, GROUND, INK, Map, OVERSIZE, PAPER, fill, line, pixels, write_svg,
};
use crate::drive::flight::{Ending, Record};
use crate::scenario::VehicleModel;
use crate::scenario::input::InputError;
use crate::scenario::output;
use crate::world::camera::picture::png_of;
use crate::world::{Horizontal, Pillar, from_core};

const PAGE: (u32, u32) = (1280, 960);
const PNG_REDUCTION: u32 = 2;

const PILLAR: RGBColor = RGBColor(198, 205, 215);
const PILLAR_EDGE: RGBColor = RGBColor(139, 150, 167);
const REMEMBERED: RGBColor = RGBColor(200, 58, 84);
const SAMPLE: RGBColor = RGBColor(71, 112, 178);
const CHOSEN: RGBColor = RGBColor(240, 140, 30);
const TARGET: RGBColor = RGBColor(240, 140, 30);
const VIEW: RGBColor = RGBColor(56, 152, 236);
const BEACON: RGBColor = RGBColor(220, 38, 38);
const START: RGBColor = RGBColor(21, 128, 61);
const GOOD: RGBColor = RGBColor(21, 128, 61);
const BAD: RGBColor = RGBColor(185, 28, 28);

/// Colours of the path, from slow to fast.
const SPEED: [RGBColor; 5] = [
    RGBColor(76, 20, 100),
    RGBColor(62, 74, 137),
    RGBColor(38, 112, 142),
    RGBColor(30, 147, 140),
    RGBColor(44, 176, 118),
];

/// Upper left corner and side of the map on the page; the rest is the legend.
const MAP: [f64; 2] = [64.0, 40.0];
const SIDE: f64 = 868.0;
const LEGEND_LEFT: f64 = 968.0;
const MARGIN_M: f64 = 0.35;
/// Time between two points of a person's path.
const WALK_STEP_S: f64 = 0.2;

/// Draws a flight into a file.
///
/// # Errors
/// The file's ending is neither `.svg` nor `.png`, or it cannot be written.
pub fn draw(record: &Record, path: &Path) -> Result<(), InputError> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("svg") => write_svg(path, [f64::from(PAGE.0), f64::from(PAGE.1)], |area| page(area, record)),
        Some("png") => {
            sheet::prepare()?;
            let (width, height) = (PAGE.0 * OVERSIZE, PAGE.1 * OVERSIZE);
            let mut pixels = vec![0; (width * height * 3) as usize];
            let area = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
            area.fill(&PAPER)
                .and_then(|()| page(&area, record))
                .and_then(|()| area.present())
                .map_err(|error| sheet::failed(path, &error))?;
            drop(area);
            let png = reduced_png(&pixels, width).map_err(|error| sheet::failed(path, &error))?;
            output::write(path, &png)
        }
        _ => Err(sheet::failed(path, &"a plot ends in .svg or .png")),
    }
}

/// Averages blocks of pixels, which smooths every edge.
fn reduced_png(pixels: &[u8], width: u32) -> Result<Vec<u8>, png::EncodingError> {
    let n = PNG_REDUCTION as usize;
    let row_bytes = width as usize * 3;
    let (out_width, out_height) = (width as usize / n, pixels.len() / row_bytes / n);
    let mut reduced = Vec::with_capacity(out_width * out_height * 3);
    for y in 0..out_height {
        for x in 0..out_width {
            for channel in 0..3 {
                let block = (0..n * n).map(|k| pixels[(y * n + k / n) * row_bytes + (x * n + k % n) * 3 + channel]);
                reduced.push((block.map(usize::from).sum::<usize>() / (n * n)) as u8);
            }
        }
    }
    png_of(&reduced, out_width, out_height)
}

impl<B: DrawingBackend> Map<'_, B> {
    fn dashed_circle(&self, center: Horizontal, radius_m: f64, style: ShapeStyle) -> Drawn<B> {
        let dashes = libm::rint((radius_m * self.scale * TAU / 11.0).max(6.0)) as usize;
        for dash in 0..dashes {
            let arc = (0..=4).map(|k| TAU * (dash as f64 + 0.6 * f64::from(k) / 4.0) / dashes as f64);
            self.path(arc.map(|angle| center.along(Horizontal::from_bearing(angle), radius_m)), style)?;
        }
        Ok(())
    }

    fn wedge(&self, from: Horizontal, yaw_rad: f64, fov_rad: f64, range_m: f64, style: ShapeStyle) -> Drawn<B> {
        let rim = (0..=32).map(|k| {
            let bearing = yaw_rad + fov_rad * (f64::from(k) / 32.0 - 0.5);
            from.along(Horizontal::from_bearing(bearing), range_m)
        });
        let points: Vec<(i32, i32)> = std::iter::once(from).chain(rim).map(|place| self.at(place)).collect();
        self.area.draw(&Polygon::new(points, style))
    }

    fn text(&self, text: &str, at: (f64, f64), size: f64, color: RGBColor, anchor: Anchor) -> Drawn<B> {
        sheet::text(self.area, text, [at.0, at.1], size, color, anchor)
    }

    /// A rectangle in points: left, top, width, height.
    fn cover(&self, [left, top, width, height]: [f64; 4], style: ShapeStyle) -> Drawn<B> {
        let corners = [(pixels(left), pixels(top)), (pixels(left + width), pixels(top + height))];
        self.area.draw(&Rectangle::new(corners, style))
    }
}

fn page<B: DrawingBackend>(area: &DrawingArea<B, Shift>, record: &Record) -> Drawn<B> {
    let page = framed(area, record);
    let [left, top] = page.corner;
    let [right, bottom] = page.end();
    let map = [left, top, right - left, bottom - top];
    page.cover(map, fill(GROUND, 1.0))?;
    grid(&page)?;
    views(&page, record)?;
    pillars(&page, record)?;
    trajectories(&page, record)?;
    ends(&page, record)?;
    flown(&page, record)?;
    // Drawings beyond the map are covered again.
    for cover in [
        [0.0, 0.0, f64::from(PAGE.0), map[1]],
        [0.0, map[1] + map[3], f64::from(PAGE.0), f64::from(PAGE.1) - map[1] - map[3]],
        [0.0, 0.0, map[0], f64::from(PAGE.1)],
        [map[0] + map[2], 0.0, f64::from(PAGE.0) - map[0] - map[2], f64::from(PAGE.1)],
    ] {
        page.cover(cover, fill(PAPER, 1.0))?;
    }
    page.cover(map, line(FRAME, 1.0, 1.0))?;
    axes(&page, map)?;
    legend(&page, record)
}

/// The page whose map shows the bounds and the whole path.
fn framed<'a, B: DrawingBackend>(area: &'a DrawingArea<B, Shift>, record: &Record) -> Map<'a, B> {
    let [mut west, mut south, mut east, mut north] = record.scenario.bounds;
    let places = record.path.iter().map(|sample| sample.position.xy());
    for (x, y) in places.chain([record.scenario.goal.into(), record.scenario.start.into()]) {
        west = west.min(x - MARGIN_M);
        east = east.max(x + MARGIN_M);
        south = south.min(y - MARGIN_M);
        north = north.max(y + MARGIN_M);
    }
    Map::within(area, [west, south, east, north], MAP, SIDE)
}

impl<B: DrawingBackend> Map<'_, B> {
    /// Distance of the grid lines: 1, 2 or 5 times a power of ten, at most 12 of them.
    fn grid_m(&self) -> f64 {
        let [west, south, east, north] = self.bounds;
        let extent_m = (east - west).max(north - south);
        let decade = libm::pow(10.0, libm::floor(libm::log10(extent_m / 12.0)));
        [1.0, 2.0, 5.0, 10.0].map(|m| m * decade).into_iter().find(|m| extent_m / m <= 12.0).unwrap_or(extent_m)
    }
}

/// Grid values inside an interval.
fn marks(from: f64, to: f64, step: f64) -> impl Iterator<Item = f64> {
    let (first, last) = (libm::ceil(from / step - 1e-9) as i64, libm::floor(to / step + 1e-9) as i64);
    (first..=last).map(move |k| k as f64 * step)
}

fn grid<B: DrawingBackend>(page: &Map<'_, B>) -> Drawn<B> {
    let ([west, south, east, north], step) = (page.bounds, page.grid_m());
    for x in marks(west, east, step) {
        page.path([[x, south], [x, north]].map(Horizontal::from_xy), line(GRID, 1.0, 0.75))?;
    }
    for y in marks(south, north, step) {
        page.path([[west, y], [east, y]].map(Horizontal::from_xy), line(GRID, 1.0, 0.75))?;
    }
    Ok(())
}

fn axes<B: DrawingBackend>(page: &Map<'_, B>, [left, top, width, height]: [f64; 4]) -> Drawn<B> {
    let ([west, south, east, north], step) = (page.bounds, page.grid_m());
    for x in marks(west, east, step) {
        let at = (page.points(Horizontal::from_xy([x, south]))[0], top + height + 8.0);
        page.text(&format!("{x}"), at, 13.0, FAINT_INK, (HPos::Center, VPos::Top))?;
    }
    for y in marks(south, north, step) {
        let at = (left - 9.0, page.points(Horizontal::from_xy([west, y]))[1]);
        page.text(&format!("{y}"), at, 13.0, FAINT_INK, (HPos::Right, VPos::Center))?;
    }
    page.text("x east, m", (left + width, top + height + 27.0), 13.0, FAINT_INK, (HPos::Right, VPos::Top))?;
    page.text("y north, m", (left - 9.0, top - 12.0), 13.0, FAINT_INK, (HPos::Left, VPos::Bottom))
}

/// The sensor's field of view at the start and twice later.
fn views<B: DrawingBackend>(page: &Map<'_, B>, record: &Record) -> Drawn<B> {
    let sensor = &record.scenario.sensor;
    for share in [0.0, 1.0 / 3.0, 2.0 / 3.0] {
        if let Some(sample) = record.path.get((share * record.path.len() as f64) as usize) {
            let fov_rad = sensor.fov_deg.to_radians();
            page.wedge(sample.position, sample.yaw_rad, fov_rad, sensor.range_m, fill(VIEW, 0.10))?;
        }
    }
    Ok(())
}

fn pillars<B: DrawingBackend>(page: &Map<'_, B>, record: &Record) -> Drawn<B> {
    let (world, end_s) = (&record.world, record.report.time_s);
    for person in &world.people {
        let times_s = (0..=(end_s / WALK_STEP_S) as u32).map(|step| f64::from(step) * WALK_STEP_S);
        page.path(times_s.filter_map(|time_s| Some(person.at(time_s)?.center)), line(PILLAR_EDGE, 0.8, 1.0))?;
    }
    let begun: Vec<Option<Pillar>> = world.all_at(0.0).collect();
    for (index, (then, now)) in begun.into_iter().zip(world.all_at(end_s)).enumerate() {
        if let Some(then) = then.filter(|then| then.velocity_mps.norm() > 0.0) {
            page.circle(then.center, then.radius_m, fill(PILLAR, 0.35))?;
            if let Some(now) = now.filter(|_| index < world.pillars.len()) {
                page.path([then.center, now.center], line(PILLAR_EDGE, 0.8, 1.0))?;
            }
        }
        let Some(now) = now else { continue };
        page.circle(now.center, now.radius_m, fill(PILLAR, 1.0))?;
        page.circle(now.center, now.radius_m, line(PILLAR_EDGE, 1.0, 1.25))?;
    }
    for circle in &record.remembered {
        let radius_m = f64::from(circle.radius_m).max(0.02);
        page.dashed_circle(from_core(circle.center_ned_m), radius_m, line(REMEMBERED, 0.9, 1.5))?;
    }
    Ok(())
}

fn trajectories<B: DrawingBackend>(page: &Map<'_, B>, record: &Record) -> Drawn<B> {
    for replan in &record.replans {
        for sample in &replan.plan.samples_ned_m {
            page.path(sample.iter().map(|point| from_core(*point)), line(SAMPLE, 0.16, 0.9))?;
        }
    }
    for replan in &record.replans {
        page.path(replan.plan.waypoints_ned_m.iter().map(|point| from_core(*point)), line(CHOSEN, 0.65, 1.2))?;
    }
    for target in record.replans.iter().filter_map(|replan| replan.target) {
        page.dot(target, 2.6, fill(PAPER, 1.0))?;
        page.dot(target, 2.6, line(TARGET, 1.0, 1.2))?;
    }
    Ok(())
}

/// Start and goal.
fn ends<B: DrawingBackend>(page: &Map<'_, B>, record: &Record) -> Drawn<B> {
    let world = &record.world;
    let goal = world.source_at(record.report.time_s);
    page.circle(goal, record.scenario.goal_tolerance, fill(BEACON, 0.08))?;
    page.dashed_circle(goal, record.scenario.goal_tolerance, line(BEACON, 0.7, 1.2))?;
    if world.source_velocity_mps.norm() > 0.0 {
        page.path([world.source, goal], line(BEACON, 0.5, 1.0))?;
    }
    for radius in [15.0, 10.5] {
        page.dot(goal, radius, line(BEACON, 0.55, 1.2))?;
    }
    page.dot(goal, 5.0, fill(BEACON, 1.0))?;
    let start = Horizontal::from_xy(record.scenario.start);
    page.dot(start, 7.0, fill(PAPER, 1.0))?;
    page.dot(start, 7.0, line(START, 1.0, 2.5))
}

/// The path, coloured by speed, and the hull at its end.
fn flown<B: DrawingBackend>(page: &Map<'_, B>, record: &Record) -> Drawn<B> {
    /// Steps of one coloured piece.
    const PIECE: usize = 4;
    let fastest = record.scenario.limits.v_max;
    let places: Vec<Horizontal> = record.path.iter().map(|sample| sample.position).collect();
    page.path(places, line(PAPER, 0.9, 6.0))?;
    for from in (0..record.path.len().saturating_sub(1)).step_by(PIECE) {
        let piece = &record.path[from..(from + PIECE + 1).min(record.path.len())];
        let speed = piece.iter().map(|sample| sample.speed_mps).sum::<f64>() / piece.len() as f64;
        page.path(piece.iter().map(|sample| sample.position), line(speed_color(speed / fastest), 1.0, 3.4))?;
    }
    let Some(last) = record.path.last() else { return Ok(()) };
    let hull_m = record.scenario.drone_radius;
    page.circle(last.position, hull_m, fill(PAPER, 0.85))?;
    page.circle(last.position, hull_m, line(INK, 1.0, 1.6))?;
    page.path([last.position, last.position.along(Horizontal::from_bearing(last.yaw_rad), hull_m)], line(INK, 1.0, 1.6))
}

fn speed_color(share: f64) -> RGBColor {
    let at = share.clamp(0.0, 1.0) * (SPEED.len() - 1) as f64;
    let index = (at as usize).min(SPEED.len() - 2);
    let (low, high, t) = (SPEED[index], SPEED[index + 1], at - index as f64);
    let mix = |a: u8, b: u8| libm::rint(f64::from(a) + t * (f64::from(b) - f64::from(a))) as u8;
    RGBColor(mix(low.0, high.0), mix(low.1, high.1), mix(low.2, high.2))
}

fn legend<B: DrawingBackend>(page: &Map<'_, B>, record: &Record) -> Drawn<B> {
    let report = &record.report;
    let left = LEGEND_LEFT;
    let here = (HPos::Left, VPos::Center);
    page.text("Foxhound", (left, 58.0), 36.0, INK, here)?;
    page.text(&record.scenario.name, (left, 92.0), 18.0, FAINT_INK, here)?;

    let (color, word) = match report.result {
        Ending::Reached => (GOOD, "reached"),
        Ending::Hold => (BAD, "hold"),
        Ending::Collision => (BAD, "collision"),
        Ending::Timeout => (BAD, "timeout"),
        Ending::Interrupted => (BAD, "interrupted"),
    };
    page.cover([left, 116.0, 280.0, 34.0], fill(color, 0.12))?;
    page.cover([left, 116.0, 4.0, 34.0], fill(color, 1.0))?;
    let title = if report.result == Ending::Reached {
        format!("{word} after {:.1} s", report.time_s)
    } else {
        format!("{word} after {:.1} s: {}", report.time_s, report.reason)
    };
    page.text(&title, (left + 16.0, 133.0), 18.0, color, here)?;

    let in_metres = |metres: Option<f64>| metres.map_or_else(|| "-".to_owned(), |metres| format!("{metres:.2} m"));
    let clearance = in_metres(report.min_clearance_m);
    let error = report.bearing_rms_deg.map_or_else(|| "-".to_owned(), |degrees| format!("{degrees:.2} deg rms"));
    let vehicle = match record.scenario.vehicle.model {
        VehicleModel::Point => "point mass",
        VehicleModel::Arducopter => "ArduCopter",
    };
    let facts = [
        ("path", format!("{:.2} m", report.path_length_m)),
        ("straight line", in_metres(report.straight_line_m)),
        ("least clearance", clearance),
        ("bearing error", error),
        ("plans", report.replans.to_string()),
        ("vehicle", vehicle.to_owned()),
        ("seed", report.seed.to_string()),
        ("trace", report.trace_hash.clone()),
    ];
    let mut y = 182.0;
    for (name, value) in facts {
        page.text(name, (left, y), 15.0, FAINT_INK, here)?;
        page.text(&value, (left + 280.0, y), 15.0, INK, (HPos::Right, VPos::Center))?;
        y += 24.0;
    }

    y += 26.0;
    page.text("speed", (left, y), 15.0, FAINT_INK, here)?;
    y += 18.0;
    let strips = 140;
    for strip in 0..strips {
        let share = f64::from(strip) / f64::from(strips);
        let x = left + 280.0 * share;
        page.cover([x, y, 280.0 / f64::from(strips) + 0.25, 10.0], fill(speed_color(share), 1.0))?;
    }
    y += 24.0;
    page.text("0", (left, y), 13.0, FAINT_INK, here)?;
    let fastest = format!("{} m/s", record.scenario.limits.v_max);
    page.text(&fastest, (left + 280.0, y), 13.0, FAINT_INK, (HPos::Right, VPos::Center))?;

    y += 40.0;
    keys(page, left, y)?;
    let foot = "antenna waveforms -> bearing -> temporary target";
    page.text(foot, (left, 890.0), 13.0, FAINT_INK, here)?;
    page.text("-> sampled potential fields -> guard -> MAVLink", (left, 908.0), 13.0, FAINT_INK, here)
}

/// The symbols and their names.
fn keys<B: DrawingBackend>(page: &Map<'_, B>, left: f64, mut y: f64) -> Drawn<B> {
    let stroke = |y: f64, style: ShapeStyle| {
        let points = vec![(pixels(left), pixels(y)), (pixels(left + 30.0), pixels(y))];
        page.area.draw(&PathElement::new(points, style))
    };
    let dot = |y: f64, radius: f64, style: ShapeStyle| {
        page.area.draw(&Circle::new((pixels(left + 15.0), pixels(y)), pixels(radius), style))
    };
    let names = [
        "start",
        "radio beacon and goal tolerance",
        "pillar, true",
        "pillar, in the map",
        "field of view during the flight",
        "temporary target",
        "sampled trajectories",
        "chosen trajectories",
    ];
    for (row, name) in names.into_iter().enumerate() {
        match row {
            0 => dot(y, 6.5, line(START, 1.0, 2.5))?,
            1 => {
                dot(y, 10.0, line(BEACON, 0.55, 1.2))?;
                dot(y, 5.0, fill(BEACON, 1.0))?;
            }
            2 => {
                dot(y, 9.5, fill(PILLAR, 1.0))?;
                dot(y, 9.5, line(PILLAR_EDGE, 1.0, 1.25))?;
            }
            3 => {
                for dash in 0..7 {
                    let arc = (0..=4).map(|k| TAU * (f64::from(dash) + 0.6 * f64::from(k) / 4.0) / 7.0);
                    let points: Vec<(i32, i32)> = arc
                        .map(|a| (pixels(left + 15.0 + 9.5 * libm::sin(a)), pixels(y - 9.5 * libm::cos(a))))
                        .collect();
                    page.area.draw(&PathElement::new(points, line(REMEMBERED, 0.9, 1.5)))?;
                }
            }
            4 => page.cover([left, y - 8.0, 30.0, 16.0], fill(VIEW, 0.16))?,
            5 => dot(y, 3.2, line(TARGET, 1.0, 1.2))?,
            6 => {
                for offset in [-4.0, 0.0, 4.0] {
                    stroke(y + offset, line(SAMPLE, 0.4, 0.9))?;
                }
            }
            _ => stroke(y, line(CHOSEN, 0.9, 1.6))?,
        }
        page.text(name, (left + 46.0, y), 15.0, INK, (HPos::Left, VPos::Center))?;
        y += 28.0;
    }
    Ok(())
}
