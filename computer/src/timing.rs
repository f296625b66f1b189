//! Durations of the tasks: smallest, mean and largest number of cycles of each, and a histogram by powers of two.
//!
//! A duration is from the begin of an activation to its end, including interrupts and more urgent tasks in between.

use core::array;

/// Cycles per microsecond of the NUCLEO-G474RE.
pub const CYCLES_PER_US: u32 = 170;
/// Bins of a histogram: below 2^8 cycles, below 2^9 and so on, and from 2^23, 49 ms, on.
pub const BINS: usize = 17;
/// The exponent of the first bin's bound.
pub const FIRST_EXPONENT: u32 = 8;

/// The tasks that are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Task {
    /// The autopilot's bytes of a step, passed to the link.
    Receive,
    /// A step of guidance and link.
    Step,
    /// A plan, from its begin to its end.
    Plan,
    /// Bytes to the autopilot: an activation.
    Transmit,
    /// Bytes from the maintenance port, camera frames among them: an activation.
    Listen,
    /// Bytes to the maintenance port: an activation.
    Speak,
}

impl Task {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 6] = [Self::Receive, Self::Step, Self::Plan, Self::Transmit, Self::Listen, Self::Speak];

    /// Its name in `status`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Receive => "receive",
            Self::Step => "step",
            Self::Plan => "plan",
            Self::Transmit => "transmit",
            Self::Listen => "listen",
            Self::Speak => "speak",
        }
    }
}

/// The durations of one task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Times {
    runs: u32,
    sum: u64,
    min: u32,
    max: u32,
    bins: [u32; BINS],
}

impl Times {
    /// None yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { runs: 0, sum: 0, min: u32::MAX, max: 0, bins: [0; BINS] }
    }

    /// Adds a run of that many cycles.
    pub fn add(&mut self, cycles: u32) {
        self.runs = self.runs.saturating_add(1);
        self.sum = self.sum.saturating_add(u64::from(cycles));
        self.min = self.min.min(cycles);
        self.max = self.max.max(cycles);
        let exponent = u32::BITS - cycles.leading_zeros();
        let bin = exponent.saturating_sub(FIRST_EXPONENT).min(BINS as u32 - 1) as usize;
        if let Some(count) = self.bins.get_mut(bin) {
            *count = count.saturating_add(1);
        }
    }

    /// Number of runs.
    #[must_use]
    pub const fn runs(&self) -> u32 {
        self.runs
    }

    /// Smallest, mean and largest; zeros before the first run.
    #[must_use]
    pub fn range(&self) -> [u32; 3] {
        let mean = self.sum.checked_div(u64::from(self.runs)).unwrap_or(0);
        [self.min.min(self.max), mean as u32, self.max]
    }

    /// The bins that are not empty: their exponent, `None` for the last bin, and their count.
    pub fn bins(&self) -> impl Iterator<Item = (Option<u32>, u32)> + '_ {
        (FIRST_EXPONENT..).zip(&self.bins).filter(|(_, count)| **count > 0).map(|(exponent, count)| {
            (Some(exponent).filter(|exponent| *exponent < FIRST_EXPONENT + BINS as u32 - 1), *count)
        })
    }
}

impl Default for Times {
    fn default() -> Self {
        Self::new()
    }
}

/// The durations of all tasks.
pub type Table = [Times; Task::ALL.len()];

/// An empty table.
#[must_use]
pub fn table() -> Table {
    array::from_fn(|_| Times::new())
}

/// Longest time from one feeding of the watchdog to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Feeds {
    last_us: Option<u64>,
    longest_us: u32,
}

impl Feeds {
    /// It is fed, at this time since the start.
    pub fn feed(&mut self, now_us: u64) {
        let since_us = now_us.saturating_sub(self.last_us.unwrap_or(now_us));
        self.longest_us = self.longest_us.max(u32::try_from(since_us).unwrap_or(u32::MAX));
        self.last_us = Some(now_us);
    }

    /// The longest time.
    #[must_use]
    pub const fn longest_us(&self) -> u32 {
        self.longest_us
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn the_bins_are_powers_of_two_and_lose_nothing() {
        let mut times = Times::new();
        assert_eq!(times.range(), [0; 3]);
        assert_eq!(times.bins().count(), 0);
        for cycles in [0, 255, 256, 511, 512, (1 << 23) - 1, 1 << 23, u32::MAX] {
            times.add(cycles);
        }
        let bins: Vec<_> = times.bins().collect();
        assert_eq!(bins, [(Some(8), 2), (Some(9), 2), (Some(10), 1), (Some(23), 1), (None, 2)]);
        assert_eq!(times.runs(), 8);
    }

    #[test]
    fn smallest_mean_and_largest_are_those_of_what_was_added() {
        let mut times = Times::new();
        [10, 20, 60].into_iter().for_each(|cycles| times.add(cycles));
        assert_eq!((times.runs(), times.range()), (3, [10, 30, 60]));
        let mut longest = Times::new();
        (0..3).for_each(|_| longest.add(u32::MAX));
        assert_eq!(longest.range(), [u32::MAX; 3]);
    }

    #[test]
    fn the_longest_time_without_food_counts_from_the_first_feeding_on() {
        let mut feeds = Feeds::default();
        for now_us in [900_000, 920_000, 985_000, 990_000] {
            feeds.feed(now_us);
        }
        assert_eq!(feeds.longest_us(), 65_000);
    }
}
