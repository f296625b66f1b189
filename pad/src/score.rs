//! A score for the similarity of a region to the pad, from some measures of it.
//!
//! Each measure is a visible feature, scaled from about zero to one. None of them decides alone: a pad of six pixels
//! with an edge hidden by a leaf and a half disc differ a little in several of them. A network of twelve units
//! weights them.

use foxhound_core::base::math::sqrt;
use foxhound_core::base::units::between;
use foxhound_core::landing::observation::Pad;

use super::Format;
use super::fit::{Fit, SECTORS};
use super::regions::{Colour, Region};

/// Measures of a region.
pub const MEASURES: usize = 21;
/// Units of the network.
pub const UNITS: usize = 12;

/// A region to be scored, which is like the pad in all other respects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Input of the score.
    pub measures: [f32; MEASURES],
    /// The pad that the region would be, without its confidence.
    pub pad: Pad,
}

/// A network of rectified units that computes the score.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Each measure's mean over the regions, and one over its standard deviation.
    pub scales: [[f32; 2]; MEASURES],
    /// Of each unit: the weights of the measures and the bias, and the weight of the unit.
    pub units: [([i8; MEASURES], i8, i8); UNITS],
    /// Scale of the weights.
    pub worth: f32,
    /// Bias of the score.
    pub none: f32,
}

impl Weights {
    /// Above 0 means the pad.
    #[must_use]
    pub fn score(&self, measures: &[f32; MEASURES]) -> f32 {
        let mut scaled = *measures;
        for (measure, [mean, inverse]) in scaled.iter_mut().zip(&self.scales) {
            *measure = (*measure - mean) * inverse;
        }
        self.units.iter().fold(self.none, |sum, (weights, bias, count)| {
            let unit =
                weights.iter().zip(scaled).fold(f32::from(*bias), |unit, (weight, x)| unit + f32::from(*weight) * x);
            sum + self.worth * f32::from(*count) * unit.max(0.0)
        })
    }
}

/// The largest score of some networks.
#[must_use]
pub fn score(networks: &[Weights], measures: &[f32; MEASURES]) -> f32 {
    networks.iter().fold(f32::NEG_INFINITY, |most, weights| most.max(weights.score(measures)))
}

/// Other inputs of the measures beside the fit.
pub(super) struct Sight {
    /// The expected radius of the pad, or the disc's own.
    pub(super) expected_px: f32,
    /// The tangent from the camera's axis to the disc.
    pub(super) off_axis: f32,
    /// The share of the disc inside the picture.
    pub(super) share: f32,
    /// Columns per column of an outline.
    pub(super) narrow: u8,
    pub(super) format: Format,
}

/// The measures, in the order of the weights.
pub(super) fn measures(region: &Region, fit: &Fit, sight: &Sight) -> [f32; MEASURES] {
    let (disc, radius) = (&fit.disc, fit.disc.radius);
    let (hole, round) = hole(region, fit, sight.narrow);
    let corners = fit.corners.map(|corner| (corner / (0.25 + 0.03 * radius)).min(3.0));
    let [red, green_blue, red_step, green_blue_step, step] = colours(region, sight.format);
    [
        4.0 * (radius - sight.expected_px) / (radius + sight.expected_px),
        sight.off_axis,
        (region.area as f32 / (disc.area() * sight.share)).min(1.3),
        (fit.seen as f32 / fit.sectors.max(1) as f32).min(1.0),
        fit.on_edge,
        fit.outside,
        corners[0],
        corners[1],
        sqrt(disc.p * disc.p + disc.q * disc.q),
        hole,
        round,
        if hole > 0.1 { hole * likeness(region) } else { 0.0 },
        red,
        green_blue,
        red_step,
        green_blue_step,
        step,
        (6.0 / radius).min(1.4),
        (fit.rough / (0.3 + 0.02 * radius)).min(3.0),
        sight.share,
        fit.sectors as f32 / SECTORS as f32,
    ]
}

/// The share of the disc that is missing between a region and its outline, and how much of that is a round piece in
/// the middle. Such a piece of mass `m`, relative to the disc's, has the mean square distance `m / 2` relative to the
/// squared radius; any other has more.
fn hole(region: &Region, fit: &Fit, narrow: u8) -> (f32, f32) {
    let (x, y, radius) = (fit.disc.x - 0.5, fit.disc.y - 0.5, fit.disc.radius);
    let scale = (1_u16 << narrow) as f32;
    let step = region.outline.step() as f32;
    let (mut area, mut square) = (0.0, 0.0);
    for (row, [from, to]) in region.outline.lines() {
        let length = (f32::from(to) - f32::from(from)) * scale;
        let dx = 0.5 * (f32::from(from) + f32::from(to)) * scale - 0.5 - x;
        let dy = f32::from(row) - y;
        area += length * step;
        square += length * step * (dx * dx + dy * dy + length * length / 12.0);
    }
    let pixels = region.area as f32;
    let (mx, my) = (region.column_sum as f32 / pixels, region.row_sum as f32 / pixels);
    let of_pixels = region.square_sum as f32 / pixels - 2.0 * (x * mx + y * my) + x * x + y * y;
    let gone = area - pixels;
    let part = between(gone / fit.disc.area(), 0.0, 1.0);
    if part <= 0.1 {
        return (part, 0.0);
    }
    let spread = (square - pixels * of_pixels) / (gone * radius * radius);
    (part, part * between(1.0 - spread / ((0.53 + 1.3 / radius) * part), -1.0, 1.0))
}

/// How similar the colour in a hole is to that beside the disc: through a ring one sees the ground, a leaf has its
/// own colour.
fn likeness(region: &Region) -> f32 {
    if region.gap.count == 0 {
        return 0.0;
    }
    let (gap, outside) = (mean(&region.gap), mean(&region.outside));
    let apart = gap.iter().zip(outside).fold(0.0, |sum, (a, b)| sum + libm::fabsf(over(*a, b)));
    (1.0 - 2.0 * apart).max(0.0)
}

/// Red over green and green over blue inside, how much larger both are than outside, and how much brighter it is
/// inside.
fn colours(region: &Region, format: Format) -> [f32; 5] {
    if format == Format::Grey {
        return GREY;
    }
    let inside = mean(&region.inside);
    // A disc from border to border has no surroundings.
    let outside = if region.outside.count >= 3 { mean(&region.outside) } else { [31.0; 3] };
    let [[red, green_blue], [red_out, green_blue_out]] =
        [inside, outside].map(|[red, green, blue]| [over(red, green), over(green, blue)]);
    let bright = |colour: [f32; 3]| colour[0] + colour[1] + colour[2];
    [red, green_blue, red - red_out, green_blue - green_blue_out, over(bright(inside), bright(outside))]
}

/// Those of a pad in daylight, for a grey picture, which has none.
const GREY: [f32; 5] = [0.5, 0.0, 0.5, -0.05, -0.2];

/// -1 to 1: the difference of two values relative to their sum. One step is noise.
fn over(a: f32, b: f32) -> f32 {
    (a - b) / (a + b + 2.0)
}

fn mean(colour: &Colour) -> [f32; 3] {
    colour.sums.map(|sum| f32::from(sum) / f32::from(colour.count.max(1)))
}
