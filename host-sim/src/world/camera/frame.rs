//! Frames as a camera delivers them.

use foxhound_core::base::time::Instant;
use foxhound_pad::{Format, Header};

/// Format of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Columns.
    pub width_px: u16,
    /// Lines.
    pub height_px: u16,
    /// Of its pixels.
    pub format: Format,
}

impl Size {
    /// The default of the firmware's camera: 160 by 120 in colour.
    pub const USUAL: Self = Self { width_px: 160, height_px: 120, format: Format::Rgb565 };
}

/// A picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Its size.
    pub size: Size,
    /// Line by line.
    pub bytes: Vec<u8>,
}

impl Frame {
    /// Its header.
    #[must_use]
    pub fn header(&self, time: Instant) -> Header {
        Header { time, width_px: self.size.width_px, height_px: self.size.height_px, format: self.size.format }
    }

    /// The lines.
    pub fn lines(&self) -> impl Iterator<Item = (u16, &[u8])> {
        (0..).zip(self.bytes.chunks(self.bytes.len() / usize::from(self.size.height_px)))
    }

    /// As red, green and blue of eight bits.
    #[must_use]
    pub fn rgb(&self) -> Vec<u8> {
        match self.size.format {
            Format::Rgb565 => {
                let pixels = self.bytes.as_chunks::<2>().0.iter().map(|pixel| u16::from_le_bytes(*pixel));
                pixels
                    .flat_map(|pixel| {
                        let wide = |value: u16, most: u16| ((value * 255 + most / 2) / most) as u8;
                        [wide(pixel >> 11, 31), wide(pixel >> 5 & 63, 63), wide(pixel & 31, 31)]
                    })
                    .collect()
            }
            Format::Grey => self.bytes.iter().flat_map(|value| [*value; 3]).collect(),
        }
    }
}
