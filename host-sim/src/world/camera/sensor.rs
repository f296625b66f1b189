//! From light to bytes: vignette, flare, blur, noise, gamma, bits.

use foxhound_pad::Format;

use super::frame::{Frame, Size};
use super::light::{Colour, Lighting, each, linear};
use crate::world::random::Random;

/// Makes a frame from the light of each pixel.
pub(super) fn expose(image: &mut Vec<Colour>, lighting: &Lighting, size: Size, seed: u64) -> Frame {
    let (width, height) = (usize::from(size.width_px), usize::from(size.height_px));
    if lighting.motion_px.iter().any(|motion| motion.abs() > 0.2) {
        move_by(image, width, height, lighting.motion_px);
    }
    if lighting.blur_px > 0.2 {
        blur(image, width, height, lighting.blur_px);
    }
    let mut mean = [0.0_f64; 3];
    for pixel in image.iter() {
        for (mean, value) in mean.iter_mut().zip(pixel) {
            *mean += f64::from(*value) / (width * height) as f64;
        }
    }
    let flare = mean.map(|mean| lighting.flare * mean as f32);
    let [five_bits, six_bits, eight_bits] = [31, 63, 255].map(steps);
    let mut random = Random::new(seed, 41);
    let mut draws = vec![0.0; 3 * width];
    let mut bytes = Vec::with_capacity(2 * width * height);
    for (row, line) in image.chunks(width).enumerate() {
        random.fill_gaussian(1.0, &mut draws);
        for (column, pixel) in line.iter().enumerate() {
            let x = (column as f32 + 0.5) / width as f32 - 0.5;
            let y = (row as f32 + 0.5) / width as f32 - 0.5 * height as f32 / width as f32;
            let corner = 1.0 - lighting.vignette * (x * x + y * y) / 0.39;
            let slope = 1.0 + lighting.gradient[0] * x + lighting.gradient[1] * y;
            let gain = lighting.exposure * corner * slope.max(0.1);
            let mut value = each(|k| {
                let light = (gain * lighting.gains[k] * (pixel[k] + flare[k])).max(0.0);
                let sigma = (light / lighting.full_well + lighting.read_noise * lighting.read_noise).sqrt();
                (light + sigma * draws[3 * column + k] as f32).clamp(0.0, 1.0)
            });
            if lighting.dead_ppm > 0.0 && random.uniform() * 1e6 < f64::from(lighting.dead_ppm) {
                let stuck = random.uniform();
                value = if stuck < 0.3 {
                    [0.0; 3]
                } else if stuck < 0.6 {
                    [1.0; 3]
                } else {
                    [1.0, 0.0, 0.0]
                };
            }
            match size.format {
                Format::Rgb565 => {
                    let [red, green, blue] = value;
                    let code = coded(&five_bits, red) << 11 | coded(&six_bits, green) << 5 | coded(&five_bits, blue);
                    bytes.extend_from_slice(&code.to_le_bytes());
                }
                Format::Grey => {
                    bytes.push(coded(&eight_bits, 0.2126 * value[0] + 0.7152 * value[1] + 0.0722 * value[2]) as u8);
                }
            }
        }
    }
    Frame { size, bytes }
}

/// The least light of each code above zero, rounded to the nearest on the sensor's curve, that of sRGB.
fn steps(most: u16) -> Vec<f32> {
    (1..=most).map(|code| linear((f32::from(code) - 0.5) / f32::from(most))).collect()
}

fn coded(steps: &[f32], light: f32) -> u16 {
    steps.partition_point(|least| *least <= light) as u16
}

/// Blurs by a Gaussian.
pub(super) fn blur(image: &mut [Colour], width: usize, height: usize, sigma_px: f32) {
    let reach = (2.5 * sigma_px).ceil().min(8.0) as i16;
    let mut weights: Vec<f32> =
        (-reach..=reach).map(|at| libm::expf(-0.5 * (f32::from(at) / sigma_px) * (f32::from(at) / sigma_px))).collect();
    let sum: f32 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    let mut pass = |from: usize, step: usize, count: usize, line: &mut Vec<Colour>| {
        // Beyond either end it goes on as it ends.
        let (first, last) = (image[from], image[from + (count - 1) * step]);
        line.clear();
        line.extend((0..reach).map(|_| first));
        line.extend((0..count).map(|at| image[from + at * step]));
        line.extend((0..reach).map(|_| last));
        for (at, near) in line.windows(weights.len()).enumerate() {
            let mut out = [0.0; 3];
            for (weight, other) in weights.iter().zip(near) {
                out = each(|k| out[k] + weight * other[k]);
            }
            image[from + at * step] = out;
        }
    };
    let mut line = Vec::new();
    (0..height).for_each(|row| pass(row * width, 1, width, &mut line));
    (0..width).for_each(|column| pass(column, width, height, &mut line));
}

/// Smears along a line.
fn move_by(image: &mut Vec<Colour>, width: usize, height: usize, motion_px: [f32; 2]) {
    let length = motion_px[0].abs().max(motion_px[1].abs());
    let taps = (length.ceil() as usize + 1).clamp(2, 12);
    let mut out = vec![[0.0_f32; 3]; image.len()];
    for tap in 0..taps {
        let part = tap as f32 / (taps - 1) as f32 - 0.5;
        let (dx, dy) = (part * motion_px[0], part * motion_px[1]);
        let (fx, fy) = (dx - dx.floor(), dy - dy.floor());
        let (ix, iy) = (dx.floor() as isize, dy.floor() as isize);
        for y in 0..height {
            let clamp_y = |y: isize| y.clamp(0, height as isize - 1) as usize * width;
            let (above, below) = (clamp_y(y as isize + iy), clamp_y(y as isize + iy + 1));
            for x in 0..width {
                let clamp_x = |x: isize| x.clamp(0, width as isize - 1) as usize;
                let (left, right) = (clamp_x(x as isize + ix), clamp_x(x as isize + ix + 1));
                let sum = &mut out[y * width + x];
                for (k, value) in sum.iter_mut().enumerate() {
                    let top = image[above + left][k] * (1.0 - fx) + image[above + right][k] * fx;
                    let bottom = image[below + left][k] * (1.0 - fx) + image[below + right][k] * fx;
                    *value += (top + fy * (bottom - top)) / taps as f32;
                }
            }
        }
    }
    *image = out;
}
