//! The pictures of the camera that looks down, reduced for the report.

use base64::prelude::{BASE64_STANDARD, Engine as _};
use foxhound_computer::camera;
use foxhound_core::guidance;
use foxhound_core::landing::observation::Seen;
use foxhound_pad::Detector;

use super::record::{Picture, milli, rounded};
use crate::drive::flight;
use crate::world::camera::picture::png_of;
use crate::world::camera::watch;

/// Reduces pictures, and has the detector look at each.
#[derive(Debug)]
pub(super) struct Pictures {
    detector: Option<Detector>,
    /// The focal length over a picture's width.
    focal_widths: f64,
}

impl Pictures {
    pub(super) fn new(config: &guidance::Config) -> Self {
        let focal_widths = config.landing.unwrap_or_default().focal_widths.into();
        Self { detector: camera::detector(config).ok(), focal_widths }
    }

    /// A picture; `None` if it has no pixels.
    pub(super) fn picture(&self, time_s: f64, shown: &flight::Picture) -> Option<Picture> {
        let flight::Picture { height_m, ref frame, .. } = *shown;
        let (width, height) = (usize::from(frame.size.width_px), usize::from(frame.size.height_px));
        let look = |detector| watch::alone(detector, frame, Some(height_m as f32), 2).seen;
        let seen = self.detector.as_ref().map(look);
        let rgb = frame.rgb();
        let (columns, rows) = (width.div_ceil(2), height.div_ceil(2));
        let reduced = (0..height).step_by(2).flat_map(|row| (0..width).step_by(2).map(move |column| (row, column)));
        let pixels: Vec<u8> = reduced
            .flat_map(|(row, column)| {
                let at = 3 * (row * width + column);
                rgb.get(at..at + 3).unwrap_or(&[0; 3])
            })
            .map(|value| (value >> 4) * 17)
            .collect();
        // The detector's tangents, in pixels of the reduced picture.
        let focal_px = 0.5 * self.focal_widths * width as f64;
        let pad = match seen {
            Some(Seen::Pad(pad)) => Some([
                rounded(0.25 * width as f64 + focal_px * f64::from(pad.right), 1),
                rounded(0.25 * height as f64 - focal_px * f64::from(pad.forward), 1),
                rounded(focal_px * f64::from(pad.radius), 1),
            ]),
            _ => None,
        };
        let words = match seen {
            Some(Seen::Pad(_)) => "the pad",
            Some(Seen::Nothing(_)) => "no pad",
            Some(Seen::Bad(_)) => "no good frame",
            None => "",
        };
        let png = BASE64_STANDARD.encode(&png_of(&pixels, columns, rows).ok()?);
        Some(Picture { time_s, height_m: milli(height_m), columns, rows, png, seen: words, pad })
    }
}
