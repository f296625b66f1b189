//! Pads on real grounds: a red disc drawn onto pictures taken from above, lit as the ground around it is.
//!
//! A random part of a picture is scaled to 160 by 120, turned over or not, and made linear. The disc gets its paint, and
//! half of the light's changes over the ground, smoothed over three pixels: shadows fall on it, the ground's texture does
//! not. Its edge has sixteen samples per pixel; then both go through the simulated lens and sensor.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use super::light::{Colour, Lighting, linear};
use super::picture::{Picture, part};
use super::random::Draw;
use super::{Camera, Frame, PAD_RED, Size, Truth, sensor};
use crate::scenario::input::InputError;
use crate::world::random::Random;

/// Heights of the camera, uniform in their logarithm: from there the pad is 12 to 58 pixels wide.
const HEIGHT_M: [f32; 2] = [0.6, 5.7];
/// Radius of the pad.
const RADIUS_M: f32 = 0.25;
/// The light is smoothed over so many pixels before it falls on the disc.
const SHADE_PX: f32 = 3.0;
/// The harmonics of an outline that is not round. The second is an ellipse's.
const HARMONICS: std::ops::RangeInclusive<u32> = 3..=6;
/// The radius is drawn for this many directions.
const DIRECTIONS: usize = 256;

/// A disc that may have lost its shape, on ground that may be red.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// How far the outline is from the circle or ellipse, rms, over its radius.
    pub uneven: f32,
    /// The shorter axis over the longer one, which is the pad's.
    pub axes: f32,
    /// Whether the ground is coloured like brick.
    pub is_on_red: bool,
}

impl Disc {
    /// As the pad should be.
    pub const ROUND: Self = Self { uneven: 0.0, axes: 1.0, is_on_red: false };
}

/// A picture, and its truth.
#[derive(Clone, Debug)]
pub struct View {
    /// The picture.
    pub frame: Frame,
    /// The height that the detector is told.
    pub height_m: f32,
    /// Position of the pad.
    pub truth: Option<Truth>,
}

/// Pictures of the ground from above.
#[derive(Clone, Debug)]
pub struct Grounds {
    pictures: Vec<Picture>,
}

impl Grounds {
    /// Reads the PNG and JPEG files of a folder, and parts them by their names' order: the first, third, fifth to train
    /// on, and the others to examine.
    ///
    /// # Errors
    /// Names what cannot be read; there must be at least two pictures.
    pub fn read(folder: &Path) -> Result<[Self; 2], InputError> {
        let failed = |path: &Path, error: String| InputError::new(format!("{}: {error}", path.display()));
        let entries = std::fs::read_dir(folder).map_err(|error| failed(folder, error.to_string()))?;
        let is_picture = |path: &PathBuf| {
            let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
            ["png", "jpg", "jpeg"].iter().any(|known| extension.eq_ignore_ascii_case(known))
        };
        let paths: Result<Vec<PathBuf>, _> = entries.map(|entry| entry.map(|entry| entry.path())).collect();
        let mut paths = paths.map_err(|error| failed(folder, error.to_string()))?;
        paths.retain(is_picture);
        paths.sort();
        let mut halves = [Self { pictures: Vec::new() }, Self { pictures: Vec::new() }];
        for (at, path) in paths.iter().enumerate() {
            let file = File::open(path).map_err(|error| failed(path, error.to_string()))?;
            let picture = Picture::read(BufReader::new(file)).map_err(|error| failed(path, error))?;
            let [width, height] = picture.size();
            if width < usize::from(Size::USUAL.width_px) || height < usize::from(Size::USUAL.height_px) {
                return Err(failed(path, format!("{width}x{height} pixels are fewer than 160x120")));
            }
            halves[at % 2].pictures.push(picture);
        }
        if halves.iter().any(|half| half.pictures.is_empty()) {
            return Err(failed(folder, "fewer than two PNG or JPEG files".into()));
        }
        Ok(halves)
    }

    /// How many pictures these are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.pictures.len()
    }

    /// Draws a view of one of them, with a disc or without.
    #[must_use]
    pub fn view(&self, disc: Option<&Disc>, camera: &Camera, seed: u64) -> View {
        let size = Size::USUAL;
        let mut draw = Draw(Random::new(seed, 42));
        let height_m = draw.scale(HEIGHT_M[0], HEIGHT_M[1]);
        let mut image = self.ground(&mut draw, size);
        let lighting = Lighting {
            blur_px: draw.between(0.0, 0.8),
            read_noise: draw.scale(0.002, 0.008),
            full_well: draw.scale(2000.0, 8000.0),
            ..Lighting::default()
        };
        if disc.is_some_and(|disc| disc.is_on_red) {
            redden(&mut draw, &mut image);
        }
        let truth = disc.map(|disc| paste(&mut draw, &mut image, disc, camera, height_m, size));
        View { frame: sensor::expose(&mut image, &lighting, size, seed), height_m, truth }
    }

    /// A part of one of the pictures.
    fn ground(&self, draw: &mut Draw, size: Size) -> Vec<Colour> {
        let Size { width_px, height_px, .. } = size;
        let picture = &self.pictures[draw.one_of(self.pictures.len())];
        let [width, height] = picture.size();
        let [most_wide, most_high] = [width as f32 / f32::from(width_px), height as f32 / f32::from(height_px)];
        let scale = draw.between(1.0, most_wide.min(most_high).min(2.0));
        let [wide, high] = [width_px, height_px].map(|side| (f32::from(side) * scale) as usize);
        let (left, top) = (draw.one_of(width - wide + 1), draw.one_of(height - high + 1));
        let (is_turned, is_upside_down) = (draw.chance(0.5), draw.chance(0.5));
        let mut image = Vec::with_capacity(usize::from(width_px) * usize::from(height_px));
        for row in 0..height_px {
            let rows = part(if is_upside_down { height_px - 1 - row } else { row }, height_px, high);
            for column in 0..width_px {
                let columns = part(if is_turned { width_px - 1 - column } else { column }, width_px, wide);
                let mean = picture.mean(left + columns.start..left + columns.end, top + rows.start..top + rows.end);
                image.push(mean.map(|value| linear(value as f32 / 255.0)));
            }
        }
        image
    }
}

fn brightness(colour: &Colour) -> f32 {
    0.2126 * colour[0] + 0.7152 * colour[1] + 0.0722 * colour[2]
}

/// The mean brightness of a picture; never quite black.
fn mean_of(image: &[Colour]) -> f32 {
    (image.iter().map(brightness).sum::<f32>() / image.len().max(1) as f32).max(0.01)
}

/// Colours the ground like bricks, from those that are brown to those that are nearly as red as the pad.
fn redden(draw: &mut Draw, image: &mut [Colour]) {
    let (red, blue) = (draw.scale(2.0, 5.0), draw.between(0.6, 1.0));
    let tint = [red, 1.0, blue];
    let scale = 1.0 / brightness(&tint);
    for pixel in image {
        let light = brightness(pixel);
        *pixel = [0, 1, 2].map(|k| 0.2 * pixel[k].min(light) + 0.8 * light * scale * tint[k]);
    }
}

/// Draws the disc where all of it is in the picture.
fn paste(draw: &mut Draw, image: &mut [Colour], disc: &Disc, camera: &Camera, height_m: f32, size: Size) -> Truth {
    let (width, height) = (f32::from(size.width_px), f32::from(size.height_px));
    let focal_px = camera.focal_widths * width;
    let radius_px = focal_px * RADIUS_M / height_m;
    let reach = radius_px * (1.0 + 2.5 * disc.uneven) + 1.0;
    let (x, y) =
        (draw.between(reach, width - reach), draw.between(reach.min(0.5 * height), (height - reach).max(0.5 * height)));
    let outline = outline(draw, disc.uneven);
    let (sine, cosine) = libm::sincosf(draw.turn());
    let paint = draw.vary(PAD_RED, 0.25);
    let mean = mean_of(image);
    // The ground reflects about a fifth.
    let light = (draw.scale(0.7, 1.4) * mean / 0.2).min(1.6);
    let mut shade: Vec<Colour> = image.iter().map(|colour| [brightness(colour) / mean; 3]).collect();
    sensor::blur(&mut shade, usize::from(size.width_px), usize::from(size.height_px), SHADE_PX);
    let is_inside = |px: f32, py: f32| {
        let (dx, dy) = (px - x, py - y);
        let (along, across) = (dx * cosine + dy * sine, (dy * cosine - dx * sine) / disc.axes);
        let turn = libm::atan2f(across, along).rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU;
        let far = outline[((turn * DIRECTIONS as f32) as usize).min(DIRECTIONS - 1)] * radius_px;
        along * along + across * across < far * far
    };
    const FINE: u32 = 4;
    for (at, pixel) in image.iter_mut().enumerate() {
        let (column, row) = ((at % usize::from(size.width_px)) as f32, (at / usize::from(size.width_px)) as f32);
        if (column - x).abs() > reach + 1.0 || (row - y).abs() > reach + 1.0 {
            continue;
        }
        let samples = (0..FINE * FINE).map(|sample| {
            let fine = |k: u32| (k as f32 + 0.5) / FINE as f32;
            is_inside(column + fine(sample % FINE), row + fine(sample / FINE))
        });
        let cover = samples.filter(|is_inside| *is_inside).count() as f32 / (FINE * FINE) as f32;
        let lit = light * (0.5 + 0.5 * shade[at][0].min(3.0));
        *pixel = [0, 1, 2].map(|k| pixel[k] + cover * (lit * paint[k] - pixel[k]));
    }
    let (forward, right) = ((0.5 * height - y) / focal_px, (x - 0.5 * width) / focal_px);
    Truth { forward, right, width_px: 2.0 * radius_px * disc.axes.sqrt(), inside: 1.0, hidden: 0.0 }
}

/// The radius in each direction, over its mean.
fn outline(draw: &mut Draw, uneven: f32) -> Vec<f32> {
    let waves: Vec<[f32; 3]> = HARMONICS.map(|order| [order as f32, draw.0.gaussian() as f32, draw.turn()]).collect();
    let square = waves.iter().map(|[_, size, _]| 0.5 * size * size).sum::<f32>();
    let scale = uneven / square.sqrt().max(1e-6);
    let radius = |at: usize| {
        let turn = (at as f32 + 0.5) / DIRECTIONS as f32 * std::f32::consts::TAU;
        1.0 + waves.iter().map(|[order, size, phase]| scale * size * libm::cosf(order * turn + phase)).sum::<f32>()
    };
    (0..DIRECTIONS).map(radius).collect()
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::super::picture::png_of;
    use super::*;

    #[test]
    fn an_outline_is_as_uneven_as_is_asked_for_about_its_mean() {
        for uneven in [0.0, 0.02, 0.05] {
            let radii = outline(&mut Draw(Random::new(1, 1)), uneven);
            let mean = radii.iter().sum::<f32>() / radii.len() as f32;
            let rms = (radii.iter().map(|radius| (radius - mean) * (radius - mean)).sum::<f32>() / 256.0).sqrt();
            assert!((mean - 1.0).abs() < 1e-3 && (rms - uneven).abs() < 1e-3, "{mean} {rms}");
        }
    }

    #[test]
    fn a_disc_covers_the_area_of_its_axes_and_nothing_is_red_without_one() {
        let grey = png_of(&[128; 3 * 200 * 150], 200, 150).unwrap();
        let grounds = Grounds { pictures: vec![Picture::read(Cursor::new(grey)).unwrap()] };
        let red = |view: &View| {
            let rgb = view.frame.rgb();
            rgb.as_chunks::<3>().0.iter().filter(|[red, green, _]| *red > green.saturating_add(48)).count()
        };
        let camera = Camera::default();
        for seed in 0..10 {
            assert_eq!(red(&grounds.view(None, &camera, seed)), 0);
            for axes in [1.0, 0.7] {
                let view = grounds.view(Some(&Disc { axes, ..Disc::ROUND }), &camera, seed);
                let radius_px = camera.focal_widths * 160.0 * RADIUS_M / view.height_m;
                let area = std::f32::consts::PI * radius_px * radius_px * axes;
                // The edge is smeared over a pixel.
                let edge = std::f32::consts::TAU * radius_px;
                assert!((red(&view) as f32 - area).abs() < 0.8 * edge, "{seed} {axes}: {} {area}", red(&view));
            }
        }
    }
}
