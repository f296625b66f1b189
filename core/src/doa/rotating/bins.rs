//! The angular bins and their averages (eq. 1).
//!
//! ```text
//!     Q[b] <- a Q[b] + (1 - a) P
//! ```
//!
//! for every reading `P` while the antenna points into bin `b`. The first reading of a bin is used as it is: an
//! average that started at 0 dB would be biased for as long as its memory lasts. A bin without a reading in a
//! rotation keeps its average for `KEPT` rotations, then it is empty again.
//!
//! Of several readings in one bin the last has the largest weight, so that the averages belong to a direction ahead
//! of the bin's middle in the sense of the turn, by degrees. This offset is averaged too ([`Bins::ahead_rad`]).

use core::f32::consts::TAU;

use crate::base::units::wrap_pi;

/// Bins around the circle.
pub const BINS: usize = 48;
/// Width of a bin.
pub const BIN_RAD: f32 = TAU / BINS as f32;
/// Rotations after which a bin without a reading is empty.
const KEPT: u8 = 2;

/// The bin of a direction.
#[must_use]
pub fn index(direction_rad: f32) -> usize {
    let wrapped = wrap_pi(direction_rad);
    let positive = if wrapped < 0.0 { wrapped + TAU } else { wrapped };
    // The conversion maps NaN to 0; a sum that rounds up to a full turn is in the last bin.
    ((positive / BIN_RAD) as usize).min(BINS - 1)
}

/// The direction of a bin's middle, (-pi, pi].
///
/// The paper uses `2 pi b / B` for the bin that spans `2 pi (b - 1) / B` to `2 pi b / B`: its edge, which is off by
/// half a bin on average.
#[must_use]
pub fn middle_rad(bin: usize) -> f32 {
    wrap_pi((bin as f32 + 0.5) * BIN_RAD)
}

/// Average power per bin.
#[derive(Clone, Debug, PartialEq)]
pub struct Bins {
    average_db: [f32; BINS],
    /// Rotations for which the average is kept; 0 for an empty bin.
    fresh: [u8; BINS],
    /// Readings in this rotation.
    readings: u16,
    /// Bins entered in this rotation, the bin of the last reading, and how far ahead of its middle its average is.
    entered: u16,
    bin: u16,
    offset_rad: f32,
    /// Sum of that over the completed bins, and its mean in the rotation before.
    offsets_rad: f32,
    before_rad: f32,
}

impl Default for Bins {
    fn default() -> Self {
        Self::new()
    }
}

impl Bins {
    /// All empty.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            average_db: [0.0; BINS],
            fresh: [0; BINS],
            readings: 0,
            entered: 0,
            bin: 0,
            offset_rad: 0.0,
            offsets_rad: 0.0,
            before_rad: 0.0,
        }
    }

    /// Adds a reading.
    pub fn add(&mut self, direction_rad: f32, power_db: f32, memory: f32) {
        let bin = index(direction_rad);
        let (Some(average), Some(fresh)) = (self.average_db.get_mut(bin), self.fresh.get_mut(bin)) else { return };
        let offset_rad = wrap_pi(direction_rad - middle_rad(bin));
        let entering = self.entered == 0 || usize::from(self.bin) != bin;
        if entering {
            self.offsets_rad += self.offset_rad;
            self.entered = self.entered.saturating_add(1);
            self.bin = bin as u16;
            self.offset_rad = self.before_rad;
        }
        let first = *fresh == 0;
        self.offset_rad = if first { offset_rad } else { memory * self.offset_rad + (1.0 - memory) * offset_rad };
        *average = if first { power_db } else { memory * *average + (1.0 - memory) * power_db };
        *fresh = KEPT;
        self.readings = self.readings.saturating_add(1);
    }

    /// Readings in this rotation.
    #[must_use]
    pub fn readings(&self) -> u16 {
        self.readings
    }

    /// Mean distance of the averages ahead of the bins' middles, clockwise.
    #[must_use]
    pub fn ahead_rad(&self) -> f32 {
        if self.entered > 0 { (self.offsets_rad + self.offset_rad) / f32::from(self.entered) } else { 0.0 }
    }

    /// The averages, in the order of [`middle_rad`].
    pub fn iter(&self) -> impl Iterator<Item = Option<f32>> {
        self.average_db.iter().zip(&self.fresh).map(|(average, fresh)| (*fresh > 0).then_some(*average))
    }

    /// Ends a rotation.
    pub fn turn_over(&mut self) {
        for fresh in &mut self.fresh {
            *fresh = fresh.saturating_sub(1);
        }
        self.before_rad = self.ahead_rad();
        (self.readings, self.entered, self.offset_rad, self.offsets_rad) = (0, 0, 0.0, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// The averages of the bins that have one.
    fn heard(bins: &Bins) -> Vec<f32> {
        bins.iter().flatten().collect()
    }

    #[test]
    fn each_direction_is_in_the_bin_whose_middle_is_nearest() {
        for k in 0..7200 {
            let direction = wrap_pi(k as f32 * 0.001_745 - 6.0);
            let off = wrap_pi(middle_rad(index(direction)) - direction);
            assert!(off.abs() <= 0.5 * BIN_RAD + 1e-5, "{direction} {off}");
        }
        for odd in [-1e-9, core::f32::consts::PI, -core::f32::consts::PI, f32::NAN, f32::INFINITY] {
            assert!(index(odd) < BINS);
        }
    }

    #[test]
    fn the_average_is_that_of_the_paper_and_starts_with_the_first_reading() {
        let mut bins = Bins::new();
        bins.add(0.01, -60.0, 0.75);
        assert_eq!(heard(&bins), [-60.0]);
        bins.add(0.02, -40.0, 0.75);
        bins.add(0.03, -50.0, 0.75);
        // 0.75 (0.75 (-60) + 0.25 (-40)) + 0.25 (-50).
        assert_eq!(heard(&bins), [-53.75]);
        assert_eq!(bins.readings(), 3);
    }

    #[test]
    fn the_averages_are_ahead_by_what_the_memory_prefers() {
        // Ten readings a bin, either way round; the mean of the weighted places, by hand.
        for (memory, sense) in [(0.0_f32, 1.0_f32), (0.5, 1.0), (0.5, -1.0), (0.9, -1.0)] {
            let mut bins = Bins::new();
            let weights: Vec<f64> = (0..400).map(|age| libm::pow(f64::from(memory), f64::from(age))).collect();
            let ahead = |age: usize| f64::from(BIN_RAD) * (0.45 - 0.1 * (age % 10) as f64);
            let sum: f64 = weights.iter().enumerate().map(|(age, weight)| weight * ahead(age)).sum();
            let expected = f64::from(sense) * sum / weights.iter().sum::<f64>();
            for rotation in 0..40 {
                if rotation > 0 {
                    bins.turn_over();
                }
                for step in 0..10 * BINS {
                    bins.add(sense * (step as f32 + 0.5) * 0.1 * BIN_RAD, -50.0, memory);
                }
            }
            assert!((f64::from(bins.ahead_rad()) - expected).abs() < 1e-3, "{memory}: {} {expected}", bins.ahead_rad());
        }
    }

    #[test]
    fn a_bin_that_gets_no_reading_is_kept_for_a_rotation_and_then_empty() {
        let mut bins = Bins::new();
        bins.add(1.0, -50.0, 0.5);
        bins.turn_over();
        assert_eq!(heard(&bins), [-50.0]);
        bins.turn_over();
        assert!(heard(&bins).is_empty());
        bins.add(1.0, -70.0, 0.5);
        assert_eq!(heard(&bins), [-70.0], "an empty bin starts again");
    }
}
