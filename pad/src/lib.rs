//! The pad detector: lines of pixels in, a ray through the pad's centre out.
//!
//! The pad is a plain red disc on the ground, perhaps with a white ring round it. The camera looks along the body's down
//! axis. A frame comes line by line and is not kept: [`State`] is below 2 KB.
//!
//! 1. `light`: pixels redder than the ground pass, whatever the lamp; of a grey frame, what is darker or brighter than most. It is asked
//!    of the sum of three neighbours.
//! 2. `regions`: what most of three lines have, runs, connected regions with outline, area and colours inside and
//!    outside of the edge. A cable or a hard shadow does not part them.
//! 3. `fit`: a disc, or the ellipse that a tilted one is, through the largest regions' outlines, of which a third may
//!    be hidden. The centre is that of the edge, not of the pixels that are left.
//! 4. A region is the pad when its colour steps at the edge, it has about the size that a pad has from here, where the height is
//!    known, and the `score` of its measures says so: of size, edge, corners, holes and colours.
//!
//! Tangents are those of the body: nothing here knows how the vehicle leans. The centre of a tilted disc is not quite that of its
//! ellipse; [`Pad::straightened`] puts that right for who knows the lean.
//!
//! Pixels and regions are integers; the last step, of a few dozen points a frame, is `f32`. Cost: the bench's
//! `pad_160x120`.
//!
//! The weights of the score are in [`WEIGHTS`], whose file says what they were trained on. `foxhound pad --render --seed N` draws such
//! a picture. `foxhound pad --train` trains others by the same recipe; the program that trained these is lost, so no
//! command reproduces them bit for bit.
#![no_std]

#[cfg(test)]
extern crate std;

mod fit;
mod light;
mod regions;
mod score;
#[cfg(test)]
mod tests;
mod weights;

use foxhound_core::base::error::{ConfigError, check};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::time::Instant;
use foxhound_core::landing::observation::{Bad, Nothing, Pad, PadObservation, Seen};

use fit::Prior;
use light::Light;
use regions::{Mask, Region, Regions, WORDS, most};
pub use score::{Candidate, MEASURES, UNITS, Weights};
use score::{Sight, measures};
pub use weights::WEIGHTS;

/// Widest frame, in pixels.
pub const WIDTH_MAX: u16 = 320;
/// Highest frame, in pixels.
pub const HEIGHT_MAX: u16 = 240;
/// Narrower or lower frames show no pad.
pub const SIDE_MIN: u16 = 16;
/// Heights beyond are no heights.
const HEIGHT_LEAST_M: f32 = 0.05;
/// Regions that are looked at closely in a frame.
const FITS_MAX: usize = 3;
/// A smaller one has no shape.
const RADIUS_MIN_PX: f32 = 4.6;
/// From higher up the pad is too small to be told from a leaf.
const EXPECTED_MIN_PX: f32 = 4.9;
/// Of a disc that the border cuts so much must be in the picture.
const SHARE_MIN: f32 = 0.3;
/// The filled part of a disc and the part of its ring, together at least: with a third hidden they are 1.3.
const WHOLE_MIN: f32 = 1.2;
/// Sine of how far the vehicle may lean.
const LEAN_SINE: f32 = 0.342;
/// Fewer pixels are no region.
const AREA_MIN: u32 = 24;

/// Pixels of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Format {
    /// Two bytes a pixel, the low one first: red in the top five bits, green in six, blue in five.
    #[default]
    Rgb565,
    /// One byte a pixel.
    Grey,
}

impl Format {
    fn bytes(self) -> usize {
        match self {
            Self::Rgb565 => 2,
            Self::Grey => 1,
        }
    }
}

/// What a frame is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Header {
    /// When it was exposed.
    pub time: Instant,
    /// Columns.
    pub width_px: u16,
    /// Lines.
    pub height_px: u16,
    /// Of its pixels.
    pub format: Format,
}

/// The camera looks down along the body's down axis; the top line of the picture is towards the nose, columns run to the right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Focal length over the picture's width: 0.866 is 60 degrees from left to right.
    pub focal_widths: f32,
}

impl Default for Camera {
    fn default() -> Self {
        Self { focal_widths: 0.866 }
    }
}

/// Camera and pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The camera.
    pub camera: Camera,
    /// Radius of the red disc.
    pub pad_radius_m: f32,
    /// How far the height may be wrong, as a part of it.
    pub height_tolerance: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { camera: Camera::default(), pad_radius_m: 0.25, height_tolerance: 0.1 }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// Names the field that is out of range.
    pub fn build(&self) -> Result<Detector, ConfigError> {
        check("pad.camera.focal_widths", self.camera.focal_widths, 0.2, 5.0)?;
        check("pad.pad_radius_m", self.pad_radius_m, 0.02, 5.0)?;
        check("pad.height_tolerance", self.height_tolerance, 0.0, 1.0)?;
        Ok(Detector { config: *self })
    }
}

/// Where a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Idle,
    Lines,
    Spoilt(Bad),
}

/// One frame, and the light of those before.
#[derive(Clone, Debug)]
pub struct State {
    stage: Stage,
    header: Header,
    /// Not a number where it is not known.
    height_m: Option<f32>,
    row: u16,
    /// Whether the light was refined after the frame before.
    is_refined: bool,
    light: Light,
    /// Which pixels passed in the last three lines, for each class; a line's place is its number modulo three.
    masks: [[Mask; 3]; 2],
    regions: Regions,
}

impl State {
    /// Before the first frame.
    #[must_use]
    pub const fn new() -> Self {
        let header = Header { time: Instant(0), width_px: 0, height_px: 0, format: Format::Rgb565 };
        Self {
            stage: Stage::Idle,
            header,
            height_m: None,
            row: 0,
            is_refined: false,
            light: Light::new(),
            masks: [[[0; WORDS]; 3]; 2],
            regions: Regions::new(),
        }
    }
}

impl Default for State {
    fn default() -> Self {
        Self::new()
    }
}

/// The detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detector {
    config: Config,
}

impl Detector {
    /// Begins a frame, whatever became of the one before. `height_m` is that of the camera above the pad.
    ///
    /// # Errors
    /// [`Bad::Size`].
    pub fn begin(&self, state: &mut State, header: &Header, height_m: Option<f32>) -> Result<(), Bad> {
        let is_new = state.header.format != header.format || state.header.width_px != header.width_px;
        if is_new {
            (state.light, state.is_refined) = (Light::new(), false);
        }
        state.header = *header;
        state.row = 0;
        let sides = SIDE_MIN..=WIDTH_MAX;
        if !sides.contains(&header.width_px) || !(SIDE_MIN..=HEIGHT_MAX).contains(&header.height_px) {
            state.stage = Stage::Spoilt(Bad::Size);
            return Err(Bad::Size);
        }
        state.height_m = height_m.filter(|height_m| *height_m >= HEIGHT_LEAST_M && *height_m < 1e4);
        state.stage = Stage::Lines;
        // At least a twentieth; from above nobody knows where, a half.
        let share_most = state.height_m.map_or(128, |height_m| {
            let radius = self.config.camera.focal_widths * self.config.pad_radius_m / height_m;
            let ratio = f32::from(header.width_px) / f32::from(header.height_px);
            (12.0 + 256.0 * (6.0 * radius * radius * ratio).min(0.9)) as u32
        });
        state.light.begin(share_most);
        state.regions.begin(header.width_px);
        Ok(())
    }

    /// Takes in a line of the frame.
    ///
    /// # Errors
    /// What is wrong with it, or with one before: the frame is spoilt until the next one begins.
    pub fn line(&self, state: &mut State, row: u16, bytes: &[u8]) -> Result<(), Bad> {
        let wrong = match state.stage {
            Stage::Spoilt(bad) => return Err(bad),
            Stage::Idle => Some(Bad::NotBegun),
            Stage::Lines if row != state.row || row >= state.header.height_px => Some(Bad::Order),
            Stage::Lines if bytes.len() != usize::from(state.header.width_px) * state.header.format.bytes() => {
                Some(Bad::Line)
            }
            Stage::Lines => None,
        };
        if let Some(bad) = wrong {
            state.stage = Stage::Spoilt(bad);
            return Err(bad);
        }
        let State { header, light, masks, regions, .. } = state;
        let place = usize::from(row % 3);
        let [Some(first), Some(second)] = masks.each_mut().map(|lines| lines.get_mut(place)) else { return Ok(()) };
        let classes = match header.format {
            Format::Rgb565 => {
                let pixels = bytes.as_chunks::<2>().0;
                light.red(pixels, first);
                if row.is_multiple_of(light::STEP) {
                    light.look_red(pixels, first);
                }
                1
            }
            Format::Grey => {
                light.grey(bytes, first, second);
                if row.is_multiple_of(light::STEP) {
                    light.look_grey(bytes);
                }
                2
            }
        };
        light.after(row);
        for (class, [zero, one, two]) in (0_u8..).zip(&*masks).take(classes) {
            let (above, last, mask) = match place {
                0 => (one, two, zero),
                1 => (two, zero, one),
                _ => (zero, one, two),
            };
            if row > 0 {
                // The line above the first is the first.
                let above = if row == 1 { last } else { above };
                settle(regions, header, row - 1, class, [above, last, mask], bytes);
            }
            if row + 1 == header.height_px {
                // The one below the last is the last.
                settle(regions, header, row, class, [last, mask, mask], bytes);
            }
        }
        state.row = row + 1;
        Ok(())
    }

    /// Ends the frame and says what it shows.
    pub fn end(&self, state: &mut State) -> PadObservation {
        self.end_with(state, |candidate| WEIGHTS.score(&candidate.measures))
    }

    /// The same with another score: what is above 0 is the pad. So other weights are trained and compared.
    pub fn end_with(&self, state: &mut State, score: impl FnMut(&Candidate) -> f32) -> PadObservation {
        let seen = self.judge(state, score);
        state.stage = Stage::Idle;
        PadObservation { time: state.header.time, seen }
    }

    fn judge(&self, state: &mut State, mut score: impl FnMut(&Candidate) -> f32) -> Seen {
        match state.stage {
            Stage::Spoilt(bad) => return Seen::Bad(bad),
            Stage::Idle => return Seen::Bad(Bad::NotBegun),
            Stage::Lines if state.row != state.header.height_px => return Seen::Bad(Bad::Cut),
            Stage::Lines => {}
        }
        if !state.light.end() {
            return Seen::Bad(Bad::Flat);
        }
        let size_px = [state.header.width_px, state.header.height_px];
        let focal_px = self.config.camera.focal_widths * f32::from(size_px[0]);
        let expected_px = state.height_m.map(|height_m| focal_px * self.config.pad_radius_m / height_m);
        let narrow = state.regions.narrow();
        let mut best: Option<Pad> = None;
        let mut nothing = Nothing::NoRegion;
        let regions = &mut state.regions;
        regions.end();
        // Those that are nearest to the pad's area, or the largest; at last, where the first two are no pads, both as one.
        let whole = expected_px.map_or(1 << 20, |radius| (2.7 * radius * radius) as u32).clamp(1, 1 << 20);
        let off = |area: u32| 256 * area.max(whole) / area.min(whole).max(1);
        let mut looked = 0_u32;
        let mut parts: [Option<Region>; FITS_MAX - 1] = [None; FITS_MAX - 1];
        for turn in 0..FITS_MAX {
            let both = match (turn, best, expected_px, &parts) {
                (2, None, Some(radius), [Some(first), Some(second)]) => first.with(second, (3.0 * radius) as u32),
                _ => None,
            };
            let left =
                (0_u32..).zip(regions.all()).filter(|(at, region)| looked >> at & 1 == 0 && region.area >= AREA_MIN);
            let region = match (&both, left.min_by_key(|(_, region)| off(region.area))) {
                (Some(both), _) => both,
                (None, Some((at, region))) => {
                    looked |= 1 << at;
                    region
                }
                (None, None) => break,
            };
            if let Some(slot) = parts.get_mut(turn) {
                *slot = Some(*region);
            }
            let format = state.header.format;
            match self.look(region, narrow, size_px, expected_px, format, &mut score) {
                Ok(pad) => {
                    if best.is_none_or(|best| pad.confidence > best.confidence) {
                        best = Some(pad);
                    }
                }
                Err(why) => nothing = nothing.max(why),
            }
        }
        // What is about as large as the pad and yet is none may have the wrong edge; so would a pad that such a threshold found.
        let refines = (best.is_none() || state.is_refined) && state.header.format == Format::Rgb565;
        state.is_refined = false;
        if let (true, Some(radius), [Some(first), ..]) = (refines, expected_px, &parts)
            && (radius * radius..7.0 * radius * radius).contains(&(first.area as f32))
            && first.inside.count.min(first.outside.count) > 4
        {
            state.light.refine(&first.inside, &first.outside);
            state.is_refined = true;
        }
        best.map_or(Seen::Nothing(nothing), Seen::Pad)
    }

    /// Whether a region is the pad.
    fn look(
        &self,
        region: &Region,
        narrow: u8,
        size_px: [u16; 2],
        expected_px: Option<f32>,
        format: Format,
        score: &mut impl FnMut(&Candidate) -> f32,
    ) -> Result<Pad, Nothing> {
        // Far too small or too large for a pad: no fit is needed to see that.
        let area = region.area as f32;
        if let Some(expected) = expected_px
            && (area > 8.0 * expected * expected || expected < EXPECTED_MIN_PX)
        {
            return Err(Nothing::Size);
        }
        // A disc of which less than half is hidden fills most of a box that is not much longer than wide.
        let (high, wide) = (region.last_row() + 1 - region.first_row(), region.outline.width() << narrow);
        let box_px = f32::from(high) * f32::from(wide);
        let is_border =
            region.touches_border(size_px[0]) || region.first_row() == 0 || region.last_row() + 1 == size_px[1];
        let is_long = !is_border && (high > 2 * wide || wide > 2 * high);
        if high < 6 || wide < 6 || is_long || area < 0.35 * box_px {
            return Err(Nothing::Shape);
        }
        let prior =
            expected_px.map(|radius| Prior { radius, sigma: radius * (0.10 + 0.5 * self.config.height_tolerance) });
        let fit = fit::fit(&region.outline, narrow, size_px, prior).ok_or(Nothing::Shape)?;
        let [width, height] = size_px.map(f32::from);
        let focal_px = self.config.camera.focal_widths * width;
        let is_cut = fit.is_cut || region.first_row() == 0 || region.last_row() + 1 == size_px[1];
        let share = if is_cut { fit.disc.share_inside(width, height) } else { 1.0 };
        let is_cut = is_cut && share < 0.97;
        let radius = fit.disc.radius;
        if radius < RADIUS_MIN_PX || share < SHARE_MIN {
            return Err(Nothing::Size);
        }
        let (x, y) = (fit.disc.x - 0.5 * width, fit.disc.y - 0.5 * height);
        let off_axis = sqrt(x * x + y * y) / focal_px;
        if let Some(expected) = expected_px {
            // A pad off the axis of a leaning camera is nearer or farther than one below a level one, and seen aslant.
            let (near, far) = (1.0 + 0.5 * off_axis * off_axis, (0.93 - LEAN_SINE * off_axis).max(0.3));
            let (most, least) = (near * sqrt(near), far * sqrt(far));
            let wide = 1.0 + self.config.height_tolerance;
            // The edge of a small one is some tenths of a pixel inside or outside.
            let ratio = radius / expected;
            let slack = 0.5 / expected;
            if ratio > most * wide + slack || ratio < least / wide - slack {
                return Err(Nothing::Size);
            }
        }
        // With the size unknown half of the ring is needed.
        if is_cut && expected_px.is_none() && fit.sectors < 9 {
            return Err(Nothing::Hidden);
        }
        if !has_step(region, format) {
            return Err(Nothing::Colour);
        }
        let sight = Sight { expected_px: expected_px.unwrap_or(radius), off_axis, share, narrow, format };
        let measures = measures(region, &fit, &sight);
        // Whatever its colours: of half a disc half of the area is there and half of the ring.
        let [_, _, fill, seen, ..] = measures;
        if !is_cut && fill + seen < WHOLE_MIN {
            return Err(Nothing::Hidden);
        }
        // Up in the picture is forward.
        let pad = Pad {
            forward: (0.5 * height - fit.disc.y) / focal_px,
            right: (fit.disc.x - 0.5 * width) / focal_px,
            radius: radius / focal_px,
            confidence: 0.0,
            is_cut,
        };
        let score = score(&Candidate { measures, pad });
        if !(score > 0.0) {
            return Err(Nothing::Shape);
        }
        Ok(Pad { confidence: 0.5 + 0.5 * score / (score + 2.0), ..pad })
    }
}

/// Whether there is a step of colour at the edge, or of brightness where there is no colour.
fn has_step(region: &Region, format: Format) -> bool {
    let ([red, green, _], [red_out, green_out, _]) = (region.inside.mean16(), region.outside.mean16());
    match format {
        _ if region.inside.count < 3 => false,
        // A disc from border to border has nothing beside it.
        _ if region.outside.count < 3 => format == Format::Rgb565,
        Format::Rgb565 => 10 * (red + 16) * (green_out + 16) > 11 * (green + 16) * (red_out + 16),
        Format::Grey => 100 * red.abs_diff(red_out) > 100 * 6 * 16 + 6 * (red + red_out),
    }
}

/// Takes the line in the middle of three into the regions.
fn settle(regions: &mut Regions, header: &Header, row: u16, class: u8, masks: [&Mask; 3], bytes: &[u8]) {
    // Most lines of most pictures have nothing.
    let words = usize::from(header.width_px.div_ceil(32));
    let [above, middle, below] = masks;
    if above.iter().zip(middle).zip(below).take(words).fold(0, |all, ((a, b), c)| all | a | b | c) == 0 {
        return;
    }
    // At most 240 lines.
    regions.line(row as u8, class, most(masks, header.width_px), header.format, bytes);
}
