//! Line and bar charts, side by side: the picture of an experiment, as SVG.

use std::path::{Path, PathBuf};

use plotters::coord::Shift;
use plotters::prelude::{DrawingArea, DrawingBackend, RGBColor, Rectangle};
use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{Color as _, ShapeStyle};

use crate::record::sheet::{Drawn, FAINT_INK, FRAME, GRID, GROUND, INK, fill, line, path, pixels, text, write_svg};
use crate::scenario::input::InputError;

/// Size of a panel's frame, and what is around it, in points.
const PANEL: [f64; 2] = [420.0, 420.0];
const LEFT: f64 = 76.0;
const TOP: f64 = 104.0;
const GAP: f64 = 84.0;
const BOTTOM: f64 = 96.0;

const LEVEL: RGBColor = RGBColor(220, 38, 38);
const COLORS: [RGBColor; 5] = [
    RGBColor(240, 140, 30),
    RGBColor(200, 58, 84),
    RGBColor(62, 74, 137),
    RGBColor(30, 147, 140),
    RGBColor(21, 128, 61),
];

/// Share of the width for a number that its bars take.
const BARS: f64 = 0.84;

/// Charts under one title.
pub(super) struct Chart {
    pub(super) title: String,
    pub(super) panels: Vec<Panel>,
}

/// One chart.
pub(super) struct Panel {
    pub(super) title: String,
    pub(super) x: Axis,
    pub(super) y: Axis,
    pub(super) series: Vec<Series>,
    /// Bars beside one another at 1, 2 and so on.
    pub(super) bars: Vec<Bars>,
    /// A level to compare with, and its name.
    pub(super) level: Option<(f64, String)>,
}

/// A line. Those without a label take the colours from the first one on again.
pub(super) struct Series {
    pub(super) label: String,
    pub(super) dashed: bool,
    pub(super) points: Vec<(f64, f64)>,
}

/// Bars of one colour, at 1, 2 and so on.
pub(super) struct Bars {
    pub(super) label: String,
    pub(super) bars: Vec<Option<Bar>>,
}

/// A bar and its interval.
pub(super) struct Bar {
    pub(super) value: f64,
    pub(super) low: f64,
    pub(super) high: f64,
}

/// An axis: what it shows, and between which values.
#[derive(Clone)]
pub(super) struct Axis {
    label: &'static str,
    from: f64,
    to: f64,
    /// The first mark.
    first: f64,
    /// Between marks; `None` for one mark a decade.
    step: Option<f64>,
}

impl Axis {
    pub(super) fn linear(label: &'static str, from: f64, to: f64, step: f64) -> Self {
        Self { label, from, to, first: from, step: Some(step) }
    }

    /// For bars: space for the numbers from 1 to `count`.
    pub(super) fn counted(label: &'static str, count: u32) -> Self {
        Self { label, from: 0.5, to: f64::from(count) + 0.5, first: 1.0, step: Some(1.0) }
    }

    pub(super) fn decades(label: &'static str, from: f64, to: f64) -> Self {
        Self { label, from, to, first: from, step: None }
    }

    /// Where a value is, 0..=1; values beyond the ends are at the ends.
    fn share(&self, value: f64) -> f64 {
        let share = match self.step {
            Some(_) => (value - self.from) / (self.to - self.from),
            None => libm::log10(value.max(self.from) / self.from) / libm::log10(self.to / self.from),
        };
        share.clamp(0.0, 1.0)
    }

    fn marks(&self) -> Vec<f64> {
        match self.step {
            Some(step) => {
                let count = libm::floor((self.to - self.first) / step + 1e-9) as usize;
                (0..=count).map(|k| self.first + step * k as f64).collect()
            }
            None => {
                let decades = libm::rint(libm::log10(self.to / self.from)) as i32;
                (0..=decades).map(|k| self.from * libm::pow(10.0, f64::from(k))).collect()
            }
        }
    }
}

/// A number as a person writes it: `0.9`, not `0.8999999`.
fn written(value: f64) -> String {
    format!("{}", libm::rint(value * 1e6) / 1e6)
}

impl Chart {
    /// Draws them into a folder, as the only picture of a study.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn write(&self, folder: &Path, name: &str) -> Result<Vec<PathBuf>, InputError> {
        let path = folder.join(name);
        self.draw(&path)?;
        Ok(vec![path])
    }

    /// Draws the charts into a file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn draw(&self, path: &Path) -> Result<(), InputError> {
        let count = self.panels.len() as f64;
        let page = [LEFT + count * PANEL[0] + (count - 1.0) * GAP + 32.0, TOP + PANEL[1] + BOTTOM];
        write_svg(path, page, |area| {
            text(area, &self.title, [LEFT, 36.0], 24.0, INK, (HPos::Left, VPos::Center))?;
            for (index, panel) in self.panels.iter().enumerate() {
                panel.draw(area, [LEFT + index as f64 * (PANEL[0] + GAP), TOP])?;
            }
            Ok(())
        })
    }
}

impl Panel {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, [left, top]: [f64; 2]) -> Drawn<B> {
        let [width, height] = PANEL;
        let (right, bottom) = (left + width, top + height);
        let at = |x: f64, y: f64| [left + width * self.x.share(x), bottom - height * self.y.share(y)];
        let frame = [(pixels(left), pixels(top)), (pixels(right), pixels(bottom))];
        area.draw(&Rectangle::new(frame, GROUND.filled()))?;
        text(area, &self.title, [left, top - 16.0], 16.0, INK, (HPos::Left, VPos::Bottom))?;
        for x in self.x.marks() {
            path(area, [[at(x, self.y.from)[0], top], [at(x, self.y.from)[0], bottom]], line(GRID, 1.0, 1.0))?;
            let below = [at(x, self.y.from)[0], bottom + 8.0];
            text(area, &written(x), below, 13.0, FAINT_INK, (HPos::Center, VPos::Top))?;
        }
        for y in self.y.marks() {
            path(area, [[left, at(self.x.from, y)[1]], [right, at(self.x.from, y)[1]]], line(GRID, 1.0, 1.0))?;
            let beside = [left - 9.0, at(self.x.from, y)[1]];
            text(area, &written(y), beside, 13.0, FAINT_INK, (HPos::Right, VPos::Center))?;
        }
        text(area, self.x.label, [right, bottom + 28.0], 13.0, FAINT_INK, (HPos::Right, VPos::Top))?;
        text(area, self.y.label, [left + 8.0, top + 8.0], 13.0, FAINT_INK, (HPos::Left, VPos::Top))?;

        if let Some((level, name)) = &self.level {
            let y = at(self.x.from, *level)[1];
            path(area, [[left, y], [right, y]], line(LEVEL, 1.0, 1.2))?;
            text(area, name, [right - 6.0, y - 4.0], 13.0, LEVEL, (HPos::Right, VPos::Bottom))?;
        }
        self.draw_bars(area, at)?;
        let mut color = 0;
        let mut was_dashed = false;
        for series in &self.series {
            if series.dashed != was_dashed {
                (color, was_dashed) = (0, series.dashed);
            }
            let style = line(COLORS[color % COLORS.len()], 1.0, if series.dashed { 1.0 } else { 1.8 });
            color += 1;
            let points: Vec<[f64; 2]> = series.points.iter().map(|(x, y)| at(*x, *y)).collect();
            if series.dashed {
                for pair in points.windows(2) {
                    dashes(area, [pair[0], pair[1]], style)?;
                }
            } else {
                path(area, points, style)?;
            }
        }
        self.names(area, [left, bottom + 56.0])?;
        area.draw(&Rectangle::new(frame, line(FRAME, 1.0, 1.0)))
    }

    fn draw_bars<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        at: impl Fn(f64, f64) -> [f64; 2],
    ) -> Drawn<B> {
        let width = BARS / self.bars.len().max(1) as f64;
        for (index, bars) in self.bars.iter().enumerate() {
            let color = COLORS[index % COLORS.len()];
            for (number, bar) in bars.bars.iter().enumerate() {
                let Some(bar) = bar else { continue };
                let left = (number + 1) as f64 - BARS / 2.0 + width * index as f64;
                let [middle, inset] = [left + 0.5 * width, 0.06 * width];
                let corners = [at(left + inset, bar.value), at(left + width - inset, self.y.from)];
                let corners = corners.map(|[x, y]| (pixels(x), pixels(y)));
                area.draw(&Rectangle::new(corners, fill(color, 0.75)))?;
                path(area, [at(middle, bar.low), at(middle, bar.high)], line(INK, 0.8, 1.0))?;
                for end in [bar.low, bar.high] {
                    let cap = [at(middle - 0.25 * width, end), at(middle + 0.25 * width, end)];
                    path(area, cap, line(INK, 0.8, 1.0))?;
                }
            }
        }
        Ok(())
    }

    /// The names of bars and lines below the chart, three in a row at most.
    fn names<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, [left, top]: [f64; 2]) -> Drawn<B> {
        let labels = self.bars.iter().map(|bars| &bars.label).chain(self.series.iter().map(|series| &series.label));
        let named: Vec<&String> = labels.filter(|label| !label.is_empty()).collect();
        let columns = if named.len() > 4 { 3 } else { 2 };
        for (index, label) in named.iter().enumerate() {
            let x = left + PANEL[0] / columns as f64 * (index % columns) as f64;
            let y = top + 20.0 * (index / columns) as f64;
            path(area, [[x, y], [x + 24.0, y]], line(COLORS[index % COLORS.len()], 1.0, 1.8))?;
            text(area, label, [x + 32.0, y], 13.0, INK, (HPos::Left, VPos::Center))?;
        }
        Ok(())
    }
}

fn dashes<B: DrawingBackend>(area: &DrawingArea<B, Shift>, [a, b]: [[f64; 2]; 2], style: ShapeStyle) -> Drawn<B> {
    let count = libm::rint(libm::hypot(b[0] - a[0], b[1] - a[1]) / 9.0).max(1.0) as usize;
    for dash in 0..count {
        let point = |share: f64| [0, 1].map(|axis| a[axis] + (b[axis] - a[axis]) * share);
        let (from, to) = (dash as f64 / count as f64, (dash as f64 + 0.55) / count as f64);
        path(area, [point(from), point(to)], style)?;
    }
    Ok(())
}
