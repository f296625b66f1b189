//! Spectrum: where power stands in the band, in fixed point. After [`crate::adc`], before [`crate::phase`].
//!
//! Two instruments over the same four rows of 12-bit codes:
//!
//! - [`Spectrum`], the Hann periodogram of all channels, to find the tone and the noise floor. Two real channels share
//!   one complex transform of i16 words with a shared exponent (block floating point); the window is applied to the
//!   packed transform as `X[k]/2 - (X[k-1] + X[k+1])/4`, which is linear, so one pass serves both channels.
//!   Powers are `|X_m[k]|^2` of the windowed sum, `X_m[k] = sum_n (1 - cos(2 pi n / N))/2 x_m[n] e^{-j 2 pi k n / N}`:
//!   white noise of variance `s^2` gives `3 N s^2 / 8` on average.
//! - [`tone::Reference`], a lock-in at one frequency for the phasors ([`tone`]).
//!
//! Cost on a Cortex-M4F, four channels of 256 samples: see the table in [`crate::phase`]. Everything here but the
//! floating-point twin ([`Backend::Microfft`]) is integer arithmetic.

pub mod tone;
pub mod trig;

mod fft;
mod twin;

pub mod kernel;

use crate::adc::CHANNELS;

/// Which transform computes the [`Spectrum`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Backend {
    /// Our block floating point transform of i16 words.
    #[default]
    Fixed,
    /// The `microfft` crate in f32: the reference, and the choice for signals of more than 60 dB.
    Microfft,
}

/// The Hann periodogram of four channels, and the memory it is computed in.
#[derive(Clone, Debug)]
pub struct Spectrum<const N: usize> {
    /// A pair of channels each: the transform, then in its place the powers of the first channel at bin `k` and of the
    /// second at `N - k`.
    pairs: [[u32; N]; CHANNELS / 2],
    /// Powers are the stored words times two to this.
    exponents: [i32; CHANNELS],
}

impl<const N: usize> Default for Spectrum<N> {
    fn default() -> Self {
        Self { pairs: [[0; N]; CHANNELS / 2], exponents: [0; CHANNELS] }
    }
}

impl<const N: usize> Spectrum<N> {
    /// The lengths there are transforms for.
    const LENGTH_IS_SUPPORTED: () = assert!(N.is_power_of_two() && N >= 64 && N <= 1024, "N is 64, 128, 256, 512 or 1024");

    /// Measures all channels. The mean of each channel is taken off first. `scratch` is the twin's.
    pub fn measure(&mut self, backend: Backend, codes: &[[i16; N]; CHANNELS], scratch: &mut [f32; N]) {
        const { Self::LENGTH_IS_SUPPORTED };
        let [[a, b], [c, d]] = [[&codes[0], &codes[1]], [&codes[2], &codes[3]]];
        let [first, second] = &mut self.pairs;
        match backend {
            Backend::Fixed => {
                let exponent = fft::pair_powers(a, b, first);
                self.exponents[..2].fill(exponent);
                let exponent = fft::pair_powers(c, d, second);
                self.exponents[2..].fill(exponent);
            }
            Backend::Microfft => {
                let (low, high) = first.split_at_mut(N / 2);
                self.exponents[0] = twin::powers(a, scratch, low.iter_mut().skip(1));
                self.exponents[1] = twin::powers(b, scratch, high.iter_mut().rev());
                let (low, high) = second.split_at_mut(N / 2);
                self.exponents[2] = twin::powers(c, scratch, low.iter_mut().skip(1));
                self.exponents[3] = twin::powers(d, scratch, high.iter_mut().rev());
            }
        }
    }

    /// Powers of one channel at bins `1..N/2`; times two to [`Self::exponent`].
    pub fn powers(&self, channel: usize) -> impl Iterator<Item = u32> + '_ {
        let pair = &self.pairs[(channel / 2) % 2];
        let second = channel % 2 == 1;
        (1..N / 2).map(move |k| pair[if second { N - k } else { k }])
    }

    /// The power of one channel at one bin, `1..N/2`; times two to [`Self::exponent`].
    #[must_use]
    pub fn power(&self, channel: usize, bin: usize) -> u32 {
        let bin = bin.clamp(1, N / 2 - 1);
        self.pairs[(channel / 2) % 2][if channel % 2 == 1 { N - bin } else { bin }]
    }

    /// The power of two that the powers of a channel are to be multiplied by.
    #[must_use]
    pub fn exponent(&self, channel: usize) -> i32 {
        self.exponents[channel % CHANNELS]
    }
}
