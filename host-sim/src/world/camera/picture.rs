//! Reads and writes pictures.

use std::io::{BufRead, Seek};
use std::ops::Range;
use std::path::Path;

use foxhound_core::landing::observation::Seen;
use foxhound_pad::{Format, HEIGHT_MAX, WIDTH_MAX};

use super::frame::{Frame, Size};
use crate::scenario::input::InputError;
use crate::scenario::output;

/// Largest number of pixels of a file.
const PIXELS_MAX: u64 = 100_000_000;

/// The first bytes of a JPEG.
const JPEG: [u8; 2] = [0xff, 0xd8];

/// Red, green and blue of eight bits.
#[derive(Clone, Debug)]
pub struct Picture {
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Picture {
    /// Reads a PNG or a JPEG of any kind.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read(mut file: impl BufRead + Seek) -> Result<Self, String> {
        let is_jpeg = file.fill_buf().map_err(|error| error.to_string())?.starts_with(&JPEG);
        if is_jpeg { Self::jpeg(file) } else { Self::png(file) }
    }

    fn jpeg(file: impl BufRead + Seek) -> Result<Self, String> {
        let mut decoder = zune_jpeg::JpegDecoder::new(file);
        let failed = |error: zune_jpeg::errors::DecodeErrors| format!("no JPEG: {error}");
        decoder.decode_headers().map_err(failed)?;
        let info = decoder.info().ok_or("no JPEG: it has no size")?;
        let [width, height] = [info.width, info.height].map(usize::from);
        let bytes = decoder.decode().map_err(failed)?;
        // Grey ones have one channel.
        let rgb =
            if bytes.len() == width * height { bytes.iter().flat_map(|grey| [*grey; 3]).collect() } else { bytes };
        if rgb.len() != 3 * width * height {
            return Err("no JPEG in colour or grey".into());
        }
        Ok(Self { width, height, rgb })
    }

    fn png(file: impl BufRead + Seek) -> Result<Self, String> {
        let mut decoder = png::Decoder::new(file);
        decoder.set_transformations(png::Transformations::normalize_to_color8());
        let mut reader = decoder.read_info().map_err(|error| format!("no PNG: {error}"))?;
        let info = reader.info();
        if u64::from(info.width) * u64::from(info.height) > PIXELS_MAX {
            return Err(format!("{}x{} pixels are too many", info.width, info.height));
        }
        let mut bytes = vec![0; reader.output_buffer_size().ok_or("the picture is too large")?];
        let info = reader.next_frame(&mut bytes).map_err(|error| format!("no PNG: {error}"))?;
        let channels = info.color_type.samples();
        let rgb = bytes
            .get(..info.buffer_size())
            .unwrap_or_default()
            .chunks_exact(channels)
            .flat_map(|pixel| if channels < 3 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] })
            .collect();
        Ok(Self { width: info.width as usize, height: info.height as usize, rgb })
    }

    /// Scaled to a size: each pixel is the mean of those that it covers. Without a size, to at most 160 columns.
    #[must_use]
    pub fn frame(&self, size: Option<[u16; 2]>, format: Format) -> Frame {
        let [width_px, height_px] = size.unwrap_or_else(|| {
            let scale = (160.0 / self.width as f64).min(f64::from(HEIGHT_MAX) / self.height as f64).min(1.0);
            let side = |side: usize| ((side as f64 * scale).round() as u16).clamp(1, WIDTH_MAX);
            [side(self.width), side(self.height)]
        });
        let mut bytes = Vec::new();
        for row in 0..height_px {
            for column in 0..width_px {
                let rows = part(row, height_px, self.height);
                let [red, green, blue] = self.mean(part(column, width_px, self.width), rows);
                match format {
                    Format::Rgb565 => {
                        let code = (((red * 31 + 127) / 255) << 11)
                            | (((green * 63 + 127) / 255) << 5)
                            | ((blue * 31 + 127) / 255);
                        bytes.extend_from_slice(&(code as u16).to_le_bytes());
                    }
                    Format::Grey => bytes.push(((54 * red + 183 * green + 19 * blue) >> 8) as u8),
                }
            }
        }
        Frame { size: Size { width_px, height_px, format }, bytes }
    }

    /// Columns and lines.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The mean colour of a rectangle inside the picture.
    pub(super) fn mean(&self, columns: Range<usize>, rows: Range<usize>) -> [u32; 3] {
        let (mut sum, mut count) = ([0_u32; 3], 0);
        for y in rows {
            for x in columns.clone() {
                let at = 3 * (y * self.width + x);
                for (sum, value) in sum.iter_mut().zip(&self.rgb[at..at + 3]) {
                    *sum += u32::from(*value);
                }
                count += 1;
            }
        }
        sum.map(|sum| (sum + count / 2) / count.max(1))
    }

    /// Writes a PNG.
    ///
    /// # Errors
    /// Names the file.
    pub fn write(&self, path: &Path) -> Result<(), InputError> {
        let png = png_of(&self.rgb, self.width, self.height);
        let png = png.map_err(|error| InputError::new(error.to_string()).in_file(path))?;
        output::write(path, &png)
    }
}

/// The pixels of a side that one of `of` pixels covers.
pub(super) fn part(at: u16, of: u16, side: usize) -> Range<usize> {
    let from = usize::from(at) * side / usize::from(of);
    from..((usize::from(at) + 1) * side / usize::from(of)).max(from + 1)
}

/// A PNG of red, green and blue of eight bits.
///
/// # Errors
/// There are not as many bytes.
pub fn png_of(rgb: &[u8], width: usize, height: usize) -> Result<Vec<u8>, png::EncodingError> {
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.write_header()?.write_image_data(rgb)?;
    Ok(png)
}

/// The picture, twice as large, with a circle around the detected pad.
#[must_use]
pub fn mark(frame: &Frame, seen: Seen, focal_widths: f32) -> Picture {
    let (width, height) = (2 * usize::from(frame.size.width_px), 2 * usize::from(frame.size.height_px));
    let small = frame.rgb();
    let mut rgb = vec![0; 3 * width * height];
    for (at, pixel) in rgb.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let from = 3 * ((at / width / 2) * (width / 2) + at % width / 2);
        pixel.copy_from_slice(&small[from..from + 3]);
    }
    if let Seen::Pad(pad) = seen {
        let focal = focal_widths * width as f32;
        let (x, y) = (0.5 * width as f32 + pad.right * focal, 0.5 * height as f32 - pad.forward * focal);
        let mut dot = |x: f32, y: f32| {
            if x >= 0.0 && y >= 0.0 && (x as usize) < width && (y as usize) < height {
                let at = 3 * (y as usize * width + x as usize);
                rgb[at..at + 3].copy_from_slice(&[0, 255, 255]);
            }
        };
        for step in 0..1440 {
            let (sine, cosine) = libm::sincosf(step as f32 * std::f32::consts::TAU / 1440.0);
            dot(x + pad.radius * focal * cosine, y + pad.radius * focal * sine);
        }
        for away in -4..=4 {
            dot(x + away as f32, y);
            dot(x, y + away as f32);
        }
    }
    Picture { width, height, rgb }
}
