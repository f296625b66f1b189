//! What the light is like: means and histogram of a few pixels, and which pixels they let pass.
//!
//! Of a coloured frame a pixel passes when it is redder than the ground: `r >= k_g g` and `r >= k_b b`. The first factor parts the
//! ratios of red to green where they fall into two classes (Otsu), and lies above their middle by their spread where they do not; the second
//! is above the ground's mean. Both inequalities are one subtraction: for each of the 32
//! values of red a table has the largest green and blue, with a guard bit above each. Of a grey frame two thresholds
//! part dark, middle and bright (Otsu's method with three classes).

#![deny(clippy::float_arithmetic)]

/// Brightness classes of a grey frame.
const BINS: usize = 32;
/// Of every so many lines one is looked at.
pub(super) const STEP: u16 = 8;
/// Of every so many of its pixels one is.
const STEP_PX: usize = 8;
/// Fewer looked at tell nothing.
const SAMPLES_MIN: u32 = 24;

/// Sums of pixels looked at.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    red: u32,
    green: u32,
    blue: u32,
    count: u32,
}

/// Means and thresholds.
#[derive(Clone, Debug)]
pub(super) struct Light {
    /// For each red, the largest green and blue with their guards.
    limits: [u16; 32],
    /// Grey: darker than this is dark.
    dark_below: u8,
    /// Grey: brighter than this is bright.
    bright_above: u8,
    /// Whether a frame before told the light.
    is_known: bool,
    /// Means of this frame's pixels that did not pass, and of those that did.
    sums: [Sums; 2],
    histogram: [u16; BINS],
    first: u16,
    differs: u16,
    /// The largest part of the picture that the pad can be, times 256.
    share_most: u32,
}

impl Light {
    pub(super) const fn new() -> Self {
        Self {
            limits: [0; 32],
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

    /// Begins a frame with what the one before told.
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

    /// After a line: while no frame before has told the light, what was seen of this one has to do.
    pub(super) fn after(&mut self, row: u16) {
        if !self.is_known && matches!(row, 8 | 16 | 32 | 64) {
            self.settle();
        }
    }

    /// Ends a frame. False: it has one colour only.
    pub(super) fn end(&mut self) -> bool {
        self.settle();
        self.differs != 0
    }

    /// Sets the least ratios of red to green and of red to blue, times 256.
    fn set_limits(&mut self, green: u32, blue: u32) {
        for (red, limit) in (0_u32..).zip(&mut self.limits) {
            // In the dark the codes are noise.
            let margin = (red * 256).saturating_sub(128);
            let (most_green, most_blue) = if red < 4 { (0, 0) } else { (1 + 2 * margin / green, 1 + margin / blue) };
            let guarded = ((64 + most_green.min(64) - 1) << 6) | (32 + most_blue.min(32) - 1);
            *limit = guarded.wrapping_add(red << 11) as u16;
        }
    }

    /// Which of up to 32 pixels of RGB565 pass, the first one in the highest bit.
    pub(super) fn red(&self, pixels: &[[u8; 2]]) -> u32 {
        let (eights, rest) = pixels.as_chunks::<8>();
        let mut mask = 0;
        // By hand, since the compiler rolls a loop of eight up again.
        for [a, b, c, d, e, f, g, h] in eights {
            let first = self.passes(*a) << 7 | self.passes(*b) << 6 | self.passes(*c) << 5 | self.passes(*d) << 4;
            let last = self.passes(*e) << 3 | self.passes(*f) << 2 | self.passes(*g) << 1 | self.passes(*h);
            mask = mask << 8 | first | last;
        }
        for pixel in rest {
            mask = mask << 1 | self.passes(*pixel);
        }
        mask << ((32 - pixels.len()) & 31)
    }

    #[inline(always)]
    fn passes(&self, pixel: [u8; 2]) -> u32 {
        let pixel = u32::from(u16::from_le_bytes(pixel));
        // Blue below, a guard's place, green, a guard's place; the red on top goes away with the limit's.
        let apart = pixel + (pixel & 0x7e0);
        // Five bits of red: always one of the 32.
        let limit = self.limits.get((pixel >> 11) as usize).copied().unwrap_or(0);
        let left = u32::from(limit).wrapping_sub(apart);
        (left & (left << 7)) >> 12 & 1
    }

    /// Which of up to 32 grey pixels are dark, and which bright.
    pub(super) fn grey(&self, pixels: &[u8]) -> [u32; 2] {
        let (mut dark, mut bright) = (0, 0);
        for pixel in pixels {
            dark = (dark << 1) | u32::from(*pixel < self.dark_below);
            bright = (bright << 1) | u32::from(*pixel > self.bright_above);
        }
        let rest = (32 - pixels.len()) & 31;
        [dark << rest, bright << rest]
    }

    /// Looks at some pixels of a coloured line; `mask` says which passed.
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

    /// Looks at some pixels of a grey line.
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

    /// Takes the light from what was seen so far.
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
        // Where nearly everything passes, it is the light that is red.
        let with = if 4 * out.count < all { passed } else { Sums::default() };
        let half = all / 2;
        let blue = (256 * (out.red + with.red + half)) / (out.blue + with.blue + half).max(1);
        // Blue is for what is no red at all: green tells the pad from the ground.
        self.set_limits(self.redness(all), (blue * 9 / 8).clamp(320, 800));
    }

    /// The ratio of red to green, times 256, that parts the pad from the ground: where the samples fall into two classes of which
    /// one is redder by half, between them; else above the middle by an eighth and twice the spread, at most by half.
    fn redness(&self, all: u32) -> u32 {
        let weighted = |from: usize, to: usize| {
            let bins = (0_u32..).zip(&self.histogram).skip(from).take(to - from);
            bins.fold((0, 0), |(count, sum), (bin, n)| (count + u32::from(*n), sum + u32::from(*n) * (2 * bin + 1)))
        };
        let (count, sum) = weighted(0, BINS);
        // Of a mean in half bins of an eighth.
        let ratio = |sum: u32, count: u32| 16 * sum / count.max(1);
        // The pad's samples are few, and above: the ground's own spread is that below the middle.
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
        best.1.clamp(400, 760)
    }

    /// Parts the histogram in three so that the classes' means lie apart as far as possible.
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
    use super::*;

    fn code(red: u16, green: u16, blue: u16) -> [u8; 2] {
        (red << 11 | green << 5 | blue).to_le_bytes()
    }

    #[test]
    fn the_subtraction_is_the_two_inequalities() {
        let mut light = Light::new();
        for (green_limit, blue_limit) in [(400, 320), (500, 330), (760, 800)] {
            light.set_limits(green_limit, blue_limit);
            for code in 0..=u16::MAX {
                let (red, green, blue) = (u32::from(code >> 11), u32::from(code >> 5 & 63), u32::from(code & 31));
                let margin = (red * 256).saturating_sub(128);
                let passes = red >= 4 && green * green_limit <= 2 * margin && blue * blue_limit <= margin;
                assert_eq!(light.red(&[code.to_le_bytes()]) >> 31, u32::from(passes), "{red} {green} {blue}");
            }
        }
    }

    #[test]
    fn a_grey_ground_under_any_lamp_does_not_pass_and_a_red_pad_does() {
        for (red, green, blue) in [(12, 24, 12), (20, 26, 7), (11, 25, 14), (4, 8, 4), (26, 54, 27)] {
            let mut light = Light::new();
            let ground = [code(red, green, blue); 64];
            for _ in 0..2 {
                light.begin(150);
                for row in 0..40 {
                    let mask = [light.red(&ground[..32]), light.red(&ground[32..])];
                    light.look_red(&ground, &mask);
                    light.after(row);
                }
                assert!(!light.end(), "one colour");
            }
            assert_eq!(light.red(&ground[..32]), 0, "{red} {green} {blue}");
            let pad = code((red * 5 / 4).clamp(6, 31), green * 2 / 5, blue * 2 / 5);
            assert_eq!(light.red(&[pad; 32]), u32::MAX, "{red} {green} {blue}");
        }
    }
}
