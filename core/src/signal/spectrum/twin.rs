//! The floating-point twin of the transform: `microfft` in f32, one channel at a time.

use microfft::Complex32;
use microfft::real::{rfft_64, rfft_128, rfft_256, rfft_512, rfft_1024};

/// Writes the powers of the windowed transform of one channel to `out`, bins `1..N/2`. Returns their exponent.
pub(super) fn powers<'a, const N: usize>(
    row: &[i16; N],
    workspace: &mut [f32; N],
    out: impl Iterator<Item = &'a mut u32>,
) -> i32 {
    let sum = row.iter().fold(0_i32, |sum, code| sum.wrapping_add(i32::from(*code)));
    let mean = sum as f32 / N as f32;
    for (value, code) in workspace.iter_mut().zip(row) {
        *value = f32::from(*code) - mean;
    }
    let bins = transform(workspace);
    // The last bin before Nyquist misses one neighbour, which microfft keeps in the first bin's imaginary part.
    let mut before = Complex32::new(0.0, 0.0);
    let nyquist = bins.first().map_or(0.0, |bin| bin.im);
    let mut largest = 0.0_f32;
    if let Some(zero) = bins.first_mut() {
        *zero = before;
    }
    let count = bins.len();
    for k in 1..count {
        let here = bins[k];
        let after = if k + 1 < count { bins[k + 1] } else { Complex32::new(nyquist, 0.0) };
        let re = 0.5 * here.re - 0.25 * (before.re + after.re);
        let im = 0.5 * here.im - 0.25 * (before.im + after.im);
        let power = re * re + im * im;
        largest = if power > largest { power } else { largest };
        bins[k].re = power;
        before = here;
    }
    // The largest power gets 30 bits.
    let exponent = (largest.to_bits() >> 23) as i32 - 127 - 29;
    let exponent = exponent.max(-100);
    let scale = f32::from_bits(((127 - exponent).clamp(1, 254) as u32) << 23);
    for (word, bin) in out.zip(bins.iter().skip(1)) {
        *word = (bin.re * scale) as u32;
    }
    exponent
}

/// The transform, in place.
fn transform<const N: usize>(samples: &mut [f32; N]) -> &mut [Complex32] {
    let samples = samples.as_mut_slice();
    match N {
        64 => <&mut [f32; 64]>::try_from(samples).map_or(&mut [], |samples| rfft_64(samples)),
        128 => <&mut [f32; 128]>::try_from(samples).map_or(&mut [], |samples| rfft_128(samples)),
        256 => <&mut [f32; 256]>::try_from(samples).map_or(&mut [], |samples| rfft_256(samples)),
        512 => <&mut [f32; 512]>::try_from(samples).map_or(&mut [], |samples| rfft_512(samples)),
        _ => <&mut [f32; 1024]>::try_from(samples).map_or(&mut [], |samples| rfft_1024(samples)),
    }
}
