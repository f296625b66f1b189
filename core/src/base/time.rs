//! Instants and durations in integer microseconds. The core has no clock: the caller passes the time.

/// Microseconds since an origin that the caller chooses once (boot on the target, zero in the simulator).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Instant(pub u64);

impl Instant {
    /// Time since `earlier`, in seconds; zero when `earlier` is in the future.
    #[must_use]
    #[inline(never)]
    pub fn seconds_since(self, earlier: Self) -> f32 {
        self.micros_since(earlier) as f32 * 1e-6
    }

    /// Time since `earlier`, in microseconds; zero when `earlier` is in the future.
    #[must_use]
    pub fn micros_since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }

    /// This instant and `micros` more; stops at the end of time.
    #[must_use]
    pub fn plus_micros(self, micros: u64) -> Self {
        Self(self.0.saturating_add(micros))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_never_runs_backwards() {
        assert_eq!(Instant(5).micros_since(Instant(9)), 0);
        assert_eq!(Instant(9).micros_since(Instant(5)), 4);
        assert_eq!(Instant(u64::MAX).plus_micros(7), Instant(u64::MAX));
        assert_eq!(Instant(2_500_000).seconds_since(Instant(0)), 2.5);
    }
}
