//! Steps in real time, by the monotonic clock.

use std::thread::sleep;
use std::time::{Duration, Instant as WallInstant};

use foxhound_core::base::time::Instant;

/// A beat on a fixed grid of time. What is missed while the machine is busy is left out: the step after a stall comes at
/// once, the next one on the grid again, never two in a row to catch up.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    start: WallInstant,
    period: Duration,
    /// Number of the next beat.
    beat: u32,
    /// Beats that were left out.
    pub missed: u32,
}

impl Pace {
    /// Starts now; the first beat is due at once.
    #[must_use]
    pub fn new(period: Duration) -> Self {
        Self { start: WallInstant::now(), period, beat: 0, missed: 0 }
    }

    /// The same clock, at another beat that begins now.
    #[must_use]
    pub fn with_period(&self, period: Duration) -> Self {
        let (beat, _) = after(0, self.start.elapsed(), period);
        Self { start: self.start, period, beat, missed: 0 }
    }

    /// Waits for the next beat, and says what time it is since the start.
    pub fn wait(&mut self) -> Instant {
        let due = self.period * self.beat;
        loop {
            let now = self.start.elapsed();
            if now >= due {
                let (next, missed) = after(self.beat, now, self.period);
                (self.beat, self.missed) = (next, self.missed.saturating_add(missed));
                return Instant(now.as_micros() as u64);
            }
            sleep(due - now);
        }
    }
}

/// The beat that follows on one that was due and is served now, and how many are left out before it.
fn after(beat: u32, now: Duration, period: Duration) -> (u32, u32) {
    let passed = (now.as_nanos() / period.as_nanos().max(1)) as u32;
    let next = (beat + 1).max(passed + 1);
    (next, next - beat - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stall_leaves_beats_out_and_the_grid_stays() {
        let (ms, period) = (Duration::from_millis, Duration::from_millis(20));
        assert_eq!(after(0, ms(0), period), (1, 0));
        assert_eq!(after(3, ms(79), period), (4, 0), "late, but not by a whole period");
        assert_eq!(after(3, ms(80), period), (5, 1));
        assert_eq!(after(3, ms(1_010), period), (51, 47), "the next one comes at 1020 ms");
    }

    #[test]
    fn beats_come_no_earlier_than_they_are_due() {
        let mut pace = Pace::new(Duration::from_millis(2));
        for least_us in [0, 2_000, 4_000, 6_000] {
            assert!(pace.wait().0 >= least_us);
        }
    }
}
