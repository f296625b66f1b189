//! The pad detector: takes lines of pixels, returns a ray through the pad's centre.
//!
//! The pad is a plain red disc on the ground, perhaps with a white ring around it. The camera looks along the body's
//! down axis. A frame is processed line by line and not stored: [`State`] is below 2 KB.
//!
//! 1. `light`: selects pixels redder than the ground, whatever the lamp; in a grey frame, those darker or brighter
//!    than most. It uses the sum of three neighbours.
//! 2. `regions`: the majority of three lines, runs, and connected regions with outline, area and colours inside and
//!    outside of the edge. A cable or a hard shadow does not split them.
//! 3. `fit`: a disc, or the ellipse of a tilted one, fitted to the largest regions' outlines, of which a third may be
//!    hidden. The centre is that of the edge, not of the visible pixels.
//! 4. A region is the pad when its colour has a step at the edge, it has about the expected size (if the height is
//!    known), and the `score` of its measures is high enough: of size, edge, corners, holes and colours.
//!
//! Tangents are in the body frame: the detector does not know the vehicle's attitude. The centre of a tilted disc is
//! not quite that of its ellipse; [`Pad::straightened`] corrects that for a known attitude.
//!
//! Pixels and regions are integers; the last step, with a few dozen points per frame, is `f32`. Cost: the bench's
//! `pad_160x120`.
//!
//! The weights of the score are in [`WEIGHTS`], whose file describes their training data. `foxhound pad --render
//! --seed N` draws such a picture. `foxhound pad --train` trains others by the same recipe; the program that trained
//! these is lost, so no command reproduces them bit for bit.
#![no_std]

#[cfg(test)]
extern crate std;

mod fit;
mod light;
mod regions;
mod score;
mod weights;

use foxhound_core::base::error::{ConfigError, check};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::time::Instant;
use foxhound_core::landing::observation::{Bad, Nothing, Pad, PadObservation, Seen};

use fit::Prior;
use light::Light;
use regions::{Mask, Region, Regions, WORDS, most};
pub use score::{Candidate, MEASURES, UNITS, Weights, score};
use score::{Sight, measures};
pub use weights::WEIGHTS;

/// Widest frame, in pixels.
pub const WIDTH_MAX: u16 = 320;
/// Highest frame, in pixels.
pub const HEIGHT_MAX: u16 = 240;
/// In frames narrower or lower than this no pad is detected.
pub const SIDE_MIN: u16 = 16;
/// Smaller heights are invalid.
const HEIGHT_LEAST_M: f32 = 0.05;
/// Regions per frame that are fitted.
const FITS_MAX: usize = 3;
/// A smaller disc has no recognisable shape.
const RADIUS_MIN_PX: f32 = 4.6;
/// From higher up the pad cannot be distinguished from a leaf.
const EXPECTED_MIN_PX: f32 = 4.9;
/// Least share of a disc, cut by the border, inside the picture.
const SHARE_MIN: f32 = 0.3;
/// Least sum of the filled share of a disc and the share of its ring: with a third hidden it is 1.3.
const WHOLE_MIN: f32 = 1.2;
/// Sine of the largest lean of the vehicle.
const LEAN_SINE: f32 = 0.342;
/// A smaller region is ignored.
const AREA_MIN: u32 = 24;

/// Pixels of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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

/// Header of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// When it was exposed.
    pub time: Instant,
    /// Columns.
    pub width_px: u16,
    /// Lines.
    pub height_px: u16,
    /// Format of its pixels.
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
    /// Relative error of the height.
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

/// Stage of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Idle,
    Lines,
    Spoilt(Bad),
}

const _: () = assert!(size_of::<State>() <= 2048);

/// State: one frame, and the light of those before.
#[derive(Clone, Debug)]
pub struct State {
    stage: Stage,
    header: Header,
    /// NaN if unknown.
    height_m: Option<f32>,
    row: u16,
    /// Whether the light was refined after the previous frame.
    is_refined: bool,
    light: Light,
    /// Selected pixels of the last three lines, for each class; a line's place is its number modulo three.
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
///
/// ```
/// # use foxhound_core::ConfigError;
/// use foxhound_core::base::time::Instant;
/// use foxhound_core::landing::observation::{Bad, Seen};
/// use foxhound_pad::{Config, Format, Header, State};
///
/// let detector = Config::default().build()?;
/// let mut state = State::new();
/// let header = Header { time: Instant(0), width_px: 64, height_px: 48, format: Format::Rgb565 };
/// detector.begin(&mut state, &header, Some(2.0)).expect("a size that is allowed");
/// for row in 0..48 {
///     detector.line(&mut state, row, &[0; 128]).expect("in order, and whole");
/// }
/// assert!(!matches!(detector.end(&mut state).seen, Seen::Pad(_)), "black pixels are no pad");
/// assert_eq!(detector.line(&mut state, 0, &[0; 128]), Err(Bad::NotBegun));
/// # Ok::<(), ConfigError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detector {
    config: Config,
}

impl Detector {
    /// Begins a frame, whatever the state of the one before. `height_m` is that of the camera above the pad.
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
        // At least a twentieth; at an unknown height, a half.
        let share_most = state.height_m.map_or(128, |height_m| {
            let radius = self.config.camera.focal_widths * self.config.pad_radius_m / height_m;
            let ratio = f32::from(header.width_px) / f32::from(header.height_px);
            (12.0 + 256.0 * (6.0 * radius * radius * ratio).min(0.9)) as u32
        });
        state.light.begin(share_most);
        state.regions.begin(header.width_px);
        Ok(())
    }

    /// Processes a line of the frame.
    ///
    /// # Errors
    /// The error of the line, or of one before: the frame is lost until the next one begins.
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
                // The first line replaces the one above it.
                let above = if row == 1 { last } else { above };
                settle(regions, header, row - 1, class, [above, last, mask], bytes);
            }
            if row + 1 == header.height_px {
                // The last line replaces the one below it.
                settle(regions, header, row, class, [last, mask, mask], bytes);
            }
        }
        state.row = row + 1;
        Ok(())
    }

    /// Ends the frame and returns the observation.
    pub fn end(&self, state: &mut State) -> PadObservation {
        self.end_with(state, |candidate| score::score(&WEIGHTS, &candidate.measures))
    }

    /// The same with another score: above 0 means the pad. It is used to train and compare weights.
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
        // Those nearest to the pad's area, or the largest; finally, if the first two are not pads, both as one.
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
        // A region of about the pad's size that is not the pad may have the wrong edge; so may a pad found with such
        // a threshold.
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
        // Far too small or too large for a pad: rejected without a fit.
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
            // A pad off the axis of a leaning camera is nearer or farther than one below a level camera, and
            // foreshortened.
            let (near, far) = (1.0 + 0.5 * off_axis * off_axis, (0.93 - LEAN_SINE * off_axis).max(0.3));
            let (most, least) = (near * sqrt(near), far * sqrt(far));
            let wide = 1.0 + self.config.height_tolerance;
            // The edge of a small one is some tenths of a pixel off.
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
        // Whatever its colours: half a disc has half of the area and half of the ring.
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

/// Whether there is a step of colour at the edge, or of brightness in a grey frame.
fn has_step(region: &Region, format: Format) -> bool {
    let ([red, green, _], [red_out, green_out, _]) = (region.inside.mean16(), region.outside.mean16());
    match format {
        _ if region.inside.count < 3 => false,
        // A disc from border to border has no surroundings.
        _ if region.outside.count < 3 => format == Format::Rgb565,
        Format::Rgb565 => 10 * (red + 16) * (green_out + 16) > 11 * (green + 16) * (red_out + 16),
        Format::Grey => 100 * red.abs_diff(red_out) > 100 * 6 * 16 + 6 * (red + red_out),
    }
}

/// Adds the line in the middle of three to the regions.
fn settle(regions: &mut Regions, header: &Header, row: u16, class: u8, masks: [&Mask; 3], bytes: &[u8]) {
    // Most lines of most pictures are empty.
    let words = usize::from(header.width_px.div_ceil(32));
    let [above, middle, below] = masks;
    if above.iter().zip(middle).zip(below).take(words).fold(0, |all, ((a, b), c)| all | a | b | c) == 0 {
        return;
    }
    // At most 240 lines.
    regions.line(row as u8, class, most(masks, header.width_px), header.format, bytes);
}
