//! Estimates the light from the means and a histogram of a few pixels, and selects pixels by it.
//!
//! In a colour frame a pixel passes when it and its two neighbours, together, are redder than the ground: `r >= k_g
//! g` and `r >= k_b b`. Three pixels have less noise than one; the three colours' sums are one addition of fields in
//! one word, and both inequalities one subtraction from a table. The first factor separates the ratios of red to
//! green if they form two classes (Otsu), and otherwise is above their median by their spread; the second is the
//! ground's mean. An object of the pad's size that is not the pad may have the wrong edge: the next frame's factor is
//! nearer to the middle between its colours inside and outside ([`Light::refine`]). In a grey frame two thresholds
//! separate dark, middle and bright (Otsu's method with three classes).

#![deny(clippy::float_arithmetic)]

use super::regions::{Colour, Mask};

/// Brightness classes of a grey frame.
const BINS: usize = 32;
/// One line in this many is sampled.
pub(super) const STEP: u16 = 8;
/// One of its pixels in this many is.
const STEP_PX: usize = 8;
/// Fewer samples are not used.
const SAMPLES_MIN: u32 = 24;

/// Sums of sampled pixels.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    red: u32,
    green: u32,
    blue: u32,
    count: u32,
}

/// The sums of a pixel and its two neighbours, along a line: blue below, red from bit 11 on, green from 21.
struct Three {
    pixel: u32,
    pair: u32,
}

impl Three {
    #[inline(always)]
    fn apart(pixel: [u8; 2]) -> u32 {
        let pixel = u32::from(u16::from_le_bytes(pixel));
        (pixel | pixel << 16) & 0x07e0_f81f
    }

    /// The first one also stands for the one before it.
    fn of(first: [u8; 2]) -> Self {
        let pixel = Self::apart(first);
        Self { pixel, pair: 2 * pixel }
    }

    /// The sums around a pixel, given the one after it.
    #[inline(always)]
    fn next(&mut self, behind: [u8; 2]) -> u32 {
        let behind = Self::apart(behind);
        let sums = self.pair + behind;
        (self.pair, self.pixel) = (self.pixel + behind, behind);
        sums
    }

    fn last(&self) -> u32 {
        self.pair + self.pixel
    }
}

/// Means and thresholds.
#[derive(Clone, Debug)]
pub(super) struct Light {
    /// The least ratios of red to green and of red to blue, times 256.
    green: u32,
    blue: u32,
    /// Below this value of green a pixel is ground.
    green_least: u32,
    /// For every second sum of red, the largest sums of green and blue with a guard bit above each.
    limits: [u32; 64],
    /// Grey: darker than this is dark.
    dark_below: u8,
    /// Grey: brighter than this is bright.
    bright_above: u8,
    /// Whether an earlier frame has determined the light.
    is_known: bool,
    /// Means of this frame's pixels that did not pass, and of those that did.
    sums: [Sums; 2],
    histogram: [u16; BINS],
    first: u16,
    differs: u16,
    /// The largest share of the picture that the pad can cover, times 256.
    share_most: u32,
}

impl Light {
    pub(super) const fn new() -> Self {
        Self {
            green: 460,
            blue: 360,
            green_least: 0,
            limits: [0; 64],
            dark_below: 0,
            bright_above: 0,
            is_known: false,
            sums: [Sums { red: 0, green: 0, blue: 0, count: 0 }; 2],
            histogram: [0; BINS],
            first: 0,
            differs: 0,
            share_most: 0,
        }
    }

    /// Begins a frame with the light of the one before.
    pub(super) fn begin(&mut self, share_most: u32) {
        self.share_most = share_most;
        if !self.is_known {
            self.set_limits(460, 360);
            (self.dark_below, self.bright_above) = (72, 168);
        }
        self.sums = [Sums::default(); 2];
        self.histogram = [0; BINS];
        (self.first, self.differs) = (0, 0);
    }

    /// After a line: until an earlier frame has determined the light, it is taken from this one.
    pub(super) fn after(&mut self, row: u16) {
        if !self.is_known && matches!(row, 8 | 16 | 32 | 64) {
            self.settle();
        }
    }

    /// Ends a frame. False if it has only one colour.
    pub(super) fn end(&mut self) -> bool {
        self.settle();
        self.differs != 0
    }

    /// Selects the red pixels of a line of RGB565.
    pub(super) fn red(&self, pixels: &[[u8; 2]], mask: &mut Mask) {
        let Some(first) = pixels.first() else { return };
        let mut three = Three::of(*first);
        let mut ahead = pixels.get(1..).unwrap_or_default();
        for word in mask.iter_mut().take(pixels.len().div_ceil(32)) {
            let (now, later) = ahead.split_at(ahead.len().min(32));
            ahead = later;
            let mut pass = 0;
            let (fours, rest) = now.as_chunks::<4>();
            // Unrolled by hand, since the compiler undoes a loop of four.
            for [a, b, c, d] in fours {
                pass = pass << 1 | self.passes(three.next(*a));
                pass = pass << 1 | self.passes(three.next(*b));
                pass = pass << 1 | self.passes(three.next(*c));
                pass = pass << 1 | self.passes(three.next(*d));
            }
            for pixel in rest {
                pass = pass << 1 | self.passes(three.next(*pixel));
            }
            if now.len() < 32 {
                // The last one also stands for the one after it.
                pass = (pass << 1 | self.passes(three.last())) << (31 - now.len());
            }
            *word = pass;
        }
    }

    /// Sets the least ratios of red to green and of red to blue, times 256.
    fn set_limits(&mut self, green: u32, blue: u32) {
        let (green, blue) = (green.max(1), blue.max(1));
        (self.green, self.blue) = (green, blue);
        for (half, limit) in (0_u32..).zip(&mut self.limits) {
            // The middle of two sums of red; half a step of each of the three is noise.
            let margin = (512 * half + 128).saturating_sub(3 * 128);
            let (most_green, most_blue) = (2 * margin / green, margin / blue);
            *limit = (1024 + most_green.min(255)) << 21 | (2 * half + 1) << 11 | (1024 + most_blue.min(127));
        }
    }

    /// 1 where three pixels' sums are red.
    #[inline(always)]
    fn passes(&self, sums: u32) -> u32 {
        // Six bits: always one of the 64.
        let limit = self.limits.get((sums >> 12 & 0x3f) as usize).copied().unwrap_or(0);
        let left = limit.wrapping_sub(sums);
        (left & (left << 21)) >> 31
    }

    /// Uses the colours inside and outside of an object of about the pad's size that was not taken for the pad: for
    /// the next frame the factor moves half of the way to where a pixel with half of each passes.
    pub(super) fn refine(&mut self, inside: &Colour, outside: &Colour) {
        let [red, green, _] = inside.mean16();
        let [red_out, green_out, _] = outside.mean16();
        if 10 * (red + 8) * (green_out + 8) > 12 * (green + 8) * (red_out + 8) {
            let middle = 256 * (red + red_out + 16) / (green + green_out + 16);
            self.set_limits(self.green.midpoint(middle).min(760).max(self.green_least), self.blue);
        }
    }

    /// Selects the dark and the bright pixels of a grey line, each with its two neighbours.
    pub(super) fn grey(&self, pixels: &[u8], dark: &mut Mask, bright: &mut Mask) {
        let (dark_below, bright_above) = (3 * u16::from(self.dark_below), 3 * u16::from(self.bright_above));
        let mut ahead = pixels.iter().skip(1).chain(pixels.last()).map(|pixel| u16::from(*pixel));
        let mut before = pixels.first().map_or(0, |pixel| u16::from(*pixel));
        for ((dark, bright), pixels) in dark.iter_mut().zip(bright).zip(pixels.chunks(32)) {
            (*dark, *bright) = (0, 0);
            for (pixel, next) in pixels.iter().zip(&mut ahead) {
                let sum = before + u16::from(*pixel) + next;
                before = u16::from(*pixel);
                *dark = (*dark << 1) | u32::from(sum < dark_below);
                *bright = (*bright << 1) | u32::from(sum > bright_above);
            }
            let rest = (32 - pixels.len()) & 31;
            (*dark, *bright) = (*dark << rest, *bright << rest);
        }
    }

    /// Samples pixels of a coloured line; `mask` has those that passed.
    pub(super) fn look_red(&mut self, pixels: &[[u8; 2]], mask: &[u32]) {
        for (at, pixel) in pixels.iter().enumerate().step_by(STEP_PX) {
            let pixel = u16::from_le_bytes(*pixel);
            self.note(pixel);
            let word = mask.get(at / 32).copied().unwrap_or(0);
            let has_passed = word >> (31 - at % 32) & 1 != 0;
            let [out, passed] = &mut self.sums;
            let sums = if has_passed { passed } else { out };
            let (red, green) = (u32::from(pixel >> 11), u32::from(pixel >> 5 & 63));
            sums.red += red;
            sums.green += green;
            sums.blue += u32::from(pixel & 31);
            sums.count += 1;
            let ratio = (16 * red + 12) / (green + 1);
            if let Some(count) = self.histogram.get_mut((ratio as usize).min(BINS - 1)) {
                *count += 1;
            }
        }
    }

    /// Samples pixels of a grey line.
    pub(super) fn look_grey(&mut self, pixels: &[u8]) {
        for pixel in pixels.iter().step_by(STEP_PX) {
            self.note(u16::from(*pixel));
            if let Some(count) = self.histogram.get_mut(usize::from(pixel >> 3)) {
                *count += 1;
            }
            self.sums[0].count += 1;
        }
    }

    fn note(&mut self, pixel: u16) {
        if self.sums[0].count + self.sums[1].count == 0 {
            self.first = pixel;
        }
        self.differs |= pixel ^ self.first;
    }

    /// Determines the light from the samples so far.
    fn settle(&mut self) {
        let [out, passed] = self.sums;
        let all = out.count + passed.count;
        if all < SAMPLES_MIN {
            return;
        }
        self.is_known |= all >= 4 * SAMPLES_MIN;
        if out.green == 0 && passed.green == 0 {
            self.part();
            return;
        }
        // If nearly everything passes, the light is red.
        let with = if 4 * out.count < all { passed } else { Sums::default() };
        let half = all / 2;
        let blue = (256 * (out.red + with.red + half)) / (out.blue + with.blue + half).max(1);
        // Blue only excludes pixels that are not red at all: green separates the pad from the ground.
        let (green, least) = self.redness(all);
        self.green_least = least;
        self.set_limits(green, blue.clamp(320, 640));
    }

    /// The ratio of red to green, times 256, that separates the pad from the ground: if the samples fall into two
    /// classes of which one is redder by half, between them; otherwise above the median by an eighth and twice the
    /// spread, at most by half. And the least possible value: above the median by the spread.
    fn redness(&self, all: u32) -> (u32, u32) {
        let weighted = |from: usize, to: usize| {
            let bins = (0_u32..).zip(&self.histogram).skip(from).take(to - from);
            bins.fold((0, 0), |(count, sum), (bin, n)| (count + u32::from(*n), sum + u32::from(*n) * (2 * bin + 1)))
        };
        let (count, sum) = weighted(0, BINS);
        // Of a mean in half bins of an eighth.
        let ratio = |sum: u32, count: u32| 16 * sum / count.max(1);
        // The pad's samples are few, and above: the ground's own spread is that below the median.
        let quantile = |sixths: u32| {
            let mut below = 0;
            for (bin, n) in (0_u32..).zip(&self.histogram) {
                let n = u32::from(*n);
                if 6 * (below + n) >= sixths * count {
                    return 32 * bin + 32 * (sixths * count / 6).saturating_sub(below) / n.max(1);
                }
                below += n;
            }
            0
        };
        let (low, middle) = (quantile(1), quantile(3));
        let mut best = (0, (middle * 9 / 8 + 2 * middle.saturating_sub(low)).min(middle * 3 / 2));
        let (mut low_count, mut low_sum) = weighted(0, 6);
        for (bin, n) in (0_u32..).zip(&self.histogram).skip(6).take(BINS - 7) {
            low_count += u32::from(*n);
            low_sum += u32::from(*n) * (2 * bin + 1);
            let (high_count, high_sum) = (count - low_count, sum - low_sum);
            if low_count == 0 || 256 * high_count < all || 256 * high_count > self.share_most * all {
                continue;
            }
            let (low, high) = (ratio(low_sum, low_count), ratio(high_sum, high_count));
            let apart = (high - low) / 8;
            let score = u64::from(low_count) * u64::from(high_count) * u64::from(apart * apart);
            if 20 * high > 29 * low && score > best.0 {
                best = (score, (3 * low + 2 * high) / 5);
            }
        }
        let least = (middle * 17 / 16 + middle.saturating_sub(low)).min(middle * 3 / 2).max(340);
        (best.1.clamp(400, 760), least)
    }

    /// Separates the histogram into three classes with means as far apart as possible.
    fn part(&mut self) {
        let (mut weights, mut moments) = ([0_u32; BINS + 1], [0_u32; BINS + 1]);
        let (mut weight, mut moment) = (0, 0);
        for (((bin, count), w), m) in
            (0_u32..).zip(&self.histogram).zip(weights.iter_mut().skip(1)).zip(moments.iter_mut().skip(1))
        {
            weight += u32::from(*count);
            moment += u32::from(*count) * bin;
            (*w, *m) = (weight, moment);
        }
        // The square of the sum over the weight, of one class: at most 4 800 * 31^2 * 256.
        let spread = |from: (u32, u32), to: (u32, u32)| match to.0 - from.0 {
            0 => 0,
            weight => {
                let sum = u64::from(to.1 - from.1);
                ((sum * sum) << 6).checked_div(u64::from(weight)).unwrap_or(0)
            }
        };
        let (mut best, mut split) = (0, (9, 21));
        let ends = || (0_u8..).zip(weights.iter().copied().zip(moments.iter().copied()));
        for (low, first) in ends().skip(1) {
            let below = spread((0, 0), first);
            for (high, second) in ends().skip(usize::from(low) + 1) {
                let value = below + spread(first, second) + spread(second, (weight, moment));
                if value > best {
                    (best, split) = (value, (low, high));
                }
            }
        }
        self.dark_below = split.0 * 8;
        self.bright_above = (split.1.saturating_mul(8)).saturating_sub(1);
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::super::regions::WORDS;
    use super::*;

    fn code(red: u16, green: u16, blue: u16) -> [u8; 2] {
        (red << 11 | green << 5 | blue).to_le_bytes()
    }

    #[test]
    fn a_pixel_passes_by_the_two_inequalities_on_its_sums_with_its_neighbours() {
        let mut random = 1_u32;
        for width in [16, 31, 32, 33, 64, 65, 160, 320] {
            for (green_limit, blue_limit) in [(400, 320), (500, 330), (760, 640)] {
                let mut light = Light::new();
                light.set_limits(green_limit, blue_limit);
                let codes: Vec<[u32; 3]> = (0..width)
                    .map(|_| {
                        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        [random >> 27, random >> 21 & 31, random >> 16 & 15]
                    })
                    .collect();
                let pixels: Vec<[u8; 2]> =
                    codes.iter().map(|[r, g, b]| code(*r as u16, *g as u16, *b as u16)).collect();
                let mut mask = [0; WORDS];
                light.red(&pixels, &mut mask);
                for at in 0..width {
                    let near = [at.max(1) - 1, at, (at + 1).min(width - 1)];
                    let [red, green, blue] = [0, 1, 2].map(|k| near.iter().map(|at| codes[*at][k]).sum::<u32>());
                    let margin = (512 * (red / 2) + 128).saturating_sub(384);
                    let passes = green * green_limit <= 2 * margin && blue * blue_limit <= margin;
                    assert_eq!(
                        mask[at / 32] >> (31 - at % 32) & 1 == 1,
                        passes,
                        "{at} of {width}: {red} {green} {blue}"
                    );
                }
                let behind: u32 = (width..32 * WORDS).map(|at| mask[at / 32] >> (31 - at % 32) & 1).sum();
                assert_eq!(behind, 0, "{width}");
            }
        }
    }

    #[test]
    fn a_grey_ground_under_any_lamp_does_not_pass_and_a_red_pad_does() {
        for (red, green, blue) in [(12, 24, 12), (20, 26, 7), (11, 25, 14), (4, 8, 4), (26, 54, 27)] {
            let mut light = Light::new();
            let ground = [code(red, green, blue); 64];
            let mut mask = [0; WORDS];
            for _ in 0..2 {
                light.begin(150);
                for row in 0..40 {
                    light.red(&ground, &mut mask);
                    light.look_red(&ground, &mask);
                    light.after(row);
                }
                assert!(!light.end(), "one colour");
            }
            light.red(&ground, &mut mask);
            assert_eq!(mask[..2], [0; 2], "{red} {green} {blue}");
            let pad = code((red * 5 / 4).clamp(6, 31), green * 2 / 5, blue * 2 / 5);
            light.red(&[pad; 64], &mut mask);
            assert_eq!(mask[..2], [u32::MAX; 2], "{red} {green} {blue}");
        }
    }
}
