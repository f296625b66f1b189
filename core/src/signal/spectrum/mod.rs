//! Spectrum: the distribution of power over the band, in fixed point. After [`crate::base::adc`], before
//! [`crate::signal::phase`].
//!
//! Two methods for the same four rows of 12-bit samples:
//!
//! - [`Spectrum`], the Hann periodogram of all channels, to find the tone and the noise floor. Two real channels share
//!   one complex transform of i16 words with a shared exponent (block floating point); the window is applied to the
//!   packed transform as `X[k]/2 - (X[k-1] + X[k+1])/4`, which is linear, so one pass serves both channels.
//!   Powers are `|X_m[k]|^2` of the windowed sum, `X_m[k] = sum_n (1 - cos(2 pi n / N))/2 x_m[n] e^{-j 2 pi k n / N}`:
//!   white noise of variance `s^2` gives `3 N s^2 / 8` on average.
//! - [`tone::Reference`], a lock-in at one frequency for the phasors ([`tone`]).
//!
//! Cost on a Cortex-M4F, four channels of 256 samples: see the table in [`crate::signal::phase`]. Everything here but the
//! floating-point twin (`Backend::Microfft`, with the feature `microfft`) is integer arithmetic.

pub mod tone;
pub mod trig;

mod fft;
#[cfg(feature = "microfft")]
mod twin;

use crate::base::adc::CHANNELS;

/// Which transform computes the [`Spectrum`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Backend {
    /// Our block floating point transform of i16 words.
    #[default]
    Fixed,
    /// The `microfft` crate in f32: the reference, and the choice for signals of more than 60 dB.
    #[cfg(feature = "microfft")]
    Microfft,
}

impl Backend {
    /// Every transform there is.
    pub const ALL: &[Self] = &[
        Self::Fixed,
        #[cfg(feature = "microfft")]
        Self::Microfft,
    ];
}

/// Two channels that share a transform.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pair {
    /// Channels 0 and 1.
    First,
    /// Channels 2 and 3.
    Second,
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
    /// All powers zero, in place.
    pub fn clear(&mut self) {
        self.pairs.as_flattened_mut().fill(0);
        self.exponents.fill(0);
    }

    /// The lengths there are transforms for.
    const LENGTH_IS_SUPPORTED: () =
        assert!(N.is_power_of_two() && N >= 64 && N <= 1024, "N is 64, 128, 256, 512 or 1024");

    /// Measures all channels. The mean of each channel is subtracted first. `workspace` is used by
    /// `Backend::Microfft`.
    pub fn measure(&mut self, backend: Backend, codes: &[[i16; N]; CHANNELS], workspace: &mut [f32; N]) {
        self.measure_pair(backend, Pair::First, codes, workspace);
        self.measure_pair(backend, Pair::Second, codes, workspace);
    }

    /// Measures two channels; the others are unchanged.
    #[inline(never)]
    pub fn measure_pair(
        &mut self,
        backend: Backend,
        pair: Pair,
        codes: &[[i16; N]; CHANNELS],
        workspace: &mut [f32; N],
    ) {
        const { Self::LENGTH_IS_SUPPORTED };
        #[cfg(not(feature = "microfft"))]
        let _ = workspace;
        let [first, second] = &mut self.pairs;
        let (first_two, last_two) = self.exponents.split_at_mut(2);
        let (a, b, powers, exponents) = match pair {
            Pair::First => (&codes[0], &codes[1], first, first_two),
            Pair::Second => (&codes[2], &codes[3], second, last_two),
        };
        match backend {
            Backend::Fixed => exponents.fill(fft::pair_powers(a, b, powers)),
            #[cfg(feature = "microfft")]
            Backend::Microfft => {
                let (low, high) = powers.split_at_mut(N / 2);
                exponents[0] = twin::powers(a, workspace, low.iter_mut().skip(1));
                exponents[1] = twin::powers(b, workspace, high.iter_mut().rev());
            }
        }
    }

    /// Powers of one channel at bins `1..N/2`, to be multiplied by two to [`Self::exponent`].
    pub fn powers(&self, channel: usize) -> impl Iterator<Item = u32> + '_ {
        let pair = &self.pairs[(channel / 2) % 2];
        let second = channel % 2 == 1;
        (1..N / 2).map(move |k| pair[if second { N - k } else { k } % N])
    }

    /// Powers of the channels `2 pair` and `2 pair + 1`, as [`Self::powers`] has them.
    pub(crate) fn pair_powers(&self, pair: usize) -> impl Iterator<Item = (u32, u32)> + '_ {
        let (first, second) = self.pairs[pair % 2].split_at(N / 2);
        first.iter().copied().skip(1).zip(second.iter().copied().skip(1).rev())
    }

    /// The power of one channel at one bin, `1..N/2`, to be multiplied by two to [`Self::exponent`].
    #[must_use]
    pub fn power(&self, channel: usize, bin: usize) -> u32 {
        let bin = bin.clamp(1, N / 2 - 1);
        self.pairs[(channel / 2) % 2][if channel % 2 == 1 { N - bin } else { bin }]
    }

    /// The exponent of two for the powers of a channel.
    #[must_use]
    pub fn exponent(&self, channel: usize) -> i32 {
        self.exponents[channel % CHANNELS]
    }
}

/// Two to a power, within the range of f32.
pub(super) fn power_of_two(exponent: i32) -> f32 {
    f32::from_bits(((127 + exponent).clamp(1, 254) as u32) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use std::f64::consts::TAU;
    use std::vec::Vec;

    /// Powers of the windowed transform of one channel without its mean, bins 1 to N/2 - 1, in f64.
    fn oracle<const N: usize>(row: &[i16; N]) -> Vec<f64> {
        let mean = row.iter().map(|code| f64::from(*code)).sum::<f64>() / N as f64;
        let window = |n: usize| 0.5 - 0.5 * (TAU * n as f64 / N as f64).cos();
        let turns: Vec<_> = (0..N).map(|k| (TAU * k as f64 / N as f64).sin_cos()).collect();
        (1..N / 2)
            .map(|k| {
                let (mut re, mut im) = (0.0, 0.0);
                for (n, code) in row.iter().enumerate() {
                    let (s, c) = turns[k * n % N];
                    let x = window(n) * (f64::from(*code) - mean);
                    (re, im) = (re + x * c, im - x * s);
                }
                re * re + im * im
            })
            .collect()
    }

    fn measured<const N: usize>(spectrum: &Spectrum<N>, channel: usize) -> Vec<f64> {
        let scale = 2_f64.powi(spectrum.exponent(channel));
        spectrum.powers(channel).map(|power| f64::from(power) * scale).collect()
    }

    /// Signals that use the range in different ways; four channels each.
    fn signals<const N: usize>() -> Vec<[[i16; N]; CHANNELS]> {
        let mut rng = Rng::new(1, N as u64);
        let mut signals = Vec::new();
        let mut add = |signal: &mut dyn FnMut(usize, usize) -> f64| {
            let mut codes = [[0; N]; CHANNELS];
            for (m, row) in codes.iter_mut().enumerate() {
                for (n, code) in row.iter_mut().enumerate() {
                    *code = signal(m, n).round().clamp(-2048.0, 2047.0) as i16;
                }
            }
            signals.push(codes);
        };
        for sigma in [0.7, 20.0, 500.0] {
            add(&mut |m, _| 100.0 * m as f64 + sigma * f64::from(rng.gaussian()));
        }
        for (bins, amplitude) in
            [(2.0, 2047.0), (5.5, 60.0), (N as f64 / 8.0 + 0.3, 1500.0), (N as f64 / 2.0 - 2.0, 3.0)]
        {
            add(&mut |m, n| 614.0 + amplitude * (TAU * bins * n as f64 / N as f64 + m as f64).cos());
        }
        // A loud channel beside a quiet one, the rails, an impulse, a square wave over the whole range.
        add(&mut |m, n| if m % 2 == 0 { 2000.0 * (n as f64).cos() } else { 5.0 * (0.7 * n as f64).sin() });
        add(&mut |m, _| if m % 2 == 0 { -2048.0 } else { 2047.0 });
        add(&mut |m, n| if n == 17 * m { 2047.0 } else { 0.0 });
        add(&mut |m, n| if (n >> m) % 2 == 0 { 2047.0 } else { -2048.0 });
        add(&mut |_, _| 0.0);
        signals
    }

    fn assert_agrees_with_f64<const N: usize>() {
        let mut spectrum = Spectrum::<N>::default();
        let mut workspace = [0.0; N];
        for (index, codes) in signals::<N>().iter().enumerate() {
            for &backend in Backend::ALL {
                spectrum.measure(backend, codes, &mut workspace);
                for (channel, row) in codes.iter().enumerate() {
                    // Of the amplitude: units of the last place of the block, or single precision and the truncation of
                    // powers whose largest has 30 bits.
                    let unit = 2_f64.powf(f64::from(spectrum.exponent(channel)) / 2.0);
                    let truth = oracle(row);
                    let largest = truth.iter().copied().fold(1.0, f64::max).sqrt();
                    let (worst_allowed, rms_allowed) = match backend {
                        Backend::Fixed => (6.0 * unit, 1.5 * unit),
                        #[cfg(feature = "microfft")]
                        Backend::Microfft => (6e-5 * largest, 6e-5 * largest),
                    };
                    let powers = measured(&spectrum, channel);
                    assert_eq!(powers.len(), N / 2 - 1);
                    let (mut worst, mut sum) = (0.0_f64, 0.0);
                    for (k, (power, truth)) in powers.iter().zip(&truth).enumerate() {
                        let scale = 2_f64.powi(spectrum.exponent(channel));
                        assert_eq!(f64::from(spectrum.power(channel, k + 1)) * scale, *power);
                        let error = (power.sqrt() - truth.sqrt()).abs();
                        worst = worst.max(error);
                        sum += error * error;
                    }
                    let rms = (sum / (N / 2) as f64).sqrt();
                    let what = std::format!("N {N} signal {index} {backend:?} channel {channel}");
                    assert!(
                        worst <= worst_allowed,
                        "{what}: worst {} units, {} of the largest",
                        worst / unit,
                        worst / largest
                    );
                    assert!(rms <= rms_allowed, "{what}: rms {} units", rms / unit);
                }
            }
        }
    }

    #[test]
    fn both_transforms_agree_with_f64_at_every_length() {
        assert_agrees_with_f64::<64>();
        assert_agrees_with_f64::<128>();
        assert_agrees_with_f64::<256>();
        assert_agrees_with_f64::<512>();
        assert_agrees_with_f64::<1024>();
    }

    #[test]
    fn the_block_exponent_wastes_at_most_three_bits_on_noise() {
        // Loud or quiet, the noise keeps several units of the last place, or its floor would be the transform's.
        for sigma in [0.6, 3.0, 20.0, 300.0] {
            let mut rng = Rng::new(2, 0);
            let mut codes = [[0; 256]; CHANNELS];
            for code in codes.as_flattened_mut() {
                *code = (sigma * rng.gaussian()).round() as i16;
            }
            let mut spectrum = Spectrum::<256>::default();
            spectrum.measure(Backend::Fixed, &codes, &mut [0.0; 256]);
            for channel in 0..CHANNELS {
                let mean = spectrum.powers(channel).map(f64::from).sum::<f64>() / 127.0;
                assert!(mean > 100.0 * 100.0, "sigma {sigma}: mean power {mean}");
            }
        }
    }

    #[test]
    fn any_codes_at_all_are_transformed_without_a_panic() {
        let mut rng = Rng::new(3, 0);
        let mut spectrum = Spectrum::<128>::default();
        for _ in 0..300 {
            let mut codes = [[0; 128]; CHANNELS];
            for code in codes.as_flattened_mut() {
                *code = (rng.uniform() * 65_536.0) as i32 as i16;
            }
            for &backend in Backend::ALL {
                spectrum.measure(backend, &codes, &mut [0.0; 128]);
            }
        }
    }
}
