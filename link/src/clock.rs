//! When a message was made, on our clock, from its `time_boot_ms` and from `TIMESYNC`.
//!
//! With `d` the autopilot's clock minus ours, a message stamped `s` there and received at `r` here says `s <= r + d`; an
//! answer stamped `t` to a request that left at `a` and was answered by `b` says `a + d <= t <= b + d`. So every message
//! bounds `d` from below, every answer from both sides, and what all of them allow is an interval, which grows by the drift
//! of the two clocks while no message comes. Its middle is used once it is known to 5 ms; until then a message counts as made
//! when it was received.

use foxhound_core::base::time::Instant;

/// Crystals differ by less than 100 parts in a million: by a microsecond in this many.
const US_PER_DRIFT: u32 = 10_000;
/// An interval wider than this is not used.
const WIDTH_MAX_US: i64 = 10_000;
/// Stamps are whole milliseconds; a smaller age counts as zero.
const STAMP_US: i64 = 1_000;
/// An older message gets this age.
const AGE_MAX_US: i64 = 5_000_000;
/// A message older than this gets no age: its stamp is not believed.
const ABSURD_US: i64 = 60_000_000;

/// Whether it is longer ago than `limit_s`.
#[inline(never)]
pub(crate) fn is_over(now: Instant, since: Instant, limit_s: f32) -> bool {
    now.seconds_since(since) > limit_s
}

/// Whether something is due that is done every `period_us`; then it is due again a period later.
#[inline(never)]
pub(crate) fn is_due(now: Instant, due: &mut Instant, period_us: u32) -> bool {
    let is_due = now >= *due;
    if is_due {
        *due = now.plus_micros(u64::from(period_us));
    }
    is_due
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PeerClock {
    /// Bounds of the autopilot's clock minus ours, and when each was set.
    low: Option<(Instant, i64)>,
    high: Option<(Instant, i64)>,
    /// When the request that waits for its answer was sent.
    asked: Option<Instant>,
    /// Round trip of the last answered request.
    round_trip_us: Option<u64>,
    /// The stamp of the last message of each kind.
    stamped_ms: [Option<u32>; 3],
}

/// The kinds of messages whose age matters.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Stamped {
    Position,
    Angles,
    Quaternion,
}

impl PeerClock {
    pub(crate) const fn new() -> Self {
        Self { low: None, high: None, asked: None, round_trip_us: None, stamped_ms: [None; 3] }
    }

    /// A request is sent; returns its `ts1`, in nanoseconds as the protocol wants it.
    pub(crate) fn ask(&mut self, now: Instant) -> i64 {
        self.asked = Some(now);
        nanos(now)
    }

    /// An answer came; one to somebody else's request is ignored.
    pub(crate) fn answered(&mut self, now: Instant, ts1: i64, tc1: i64) {
        let Some(asked) = self.asked.filter(|asked| nanos(*asked) == ts1) else { return };
        self.asked = None;
        self.round_trip_us = Some(now.micros_since(asked));
        let theirs_us = tc1 / 1_000;
        self.bound_high(now, theirs_us.saturating_sub(micros(asked)));
        self.bound_low(now, theirs_us.saturating_sub(micros(now)));
    }

    /// A message stamped with the autopilot's time since boot came; returns when it was made. Messages of different
    /// kinds often have the same stamp.
    pub(crate) fn made(&mut self, now: Instant, kind: Stamped, time_boot_ms: u32) -> Instant {
        let stamped_us = i64::from(time_boot_ms) * 1_000;
        self.bound_low(now, stamped_us.saturating_sub(micros(now)));
        // Stamps that stand still are no clock.
        let last_ms = &mut self.stamped_ms[kind as usize];
        let is_running = last_ms.replace(time_boot_ms) != Some(time_boot_ms);
        let Some(offset_us) = self.offset_us(now).filter(|_| is_running) else { return now };
        let age_us = micros(now).saturating_add(offset_us).saturating_sub(stamped_us);
        if age_us > ABSURD_US {
            // The milliseconds wrap after 49.7 days.
            (self.low, self.high) = (None, None);
            return now;
        }
        let age_us = age_us.min(AGE_MAX_US);
        if age_us >= STAMP_US { Instant(now.0.saturating_sub(age_us as u64)) } else { now }
    }

    /// Time from the last answered request to its answer.
    pub(crate) const fn round_trip_us(&self) -> Option<u64> {
        self.round_trip_us
    }

    fn offset_us(&self, now: Instant) -> Option<i64> {
        let (low, high) = (grown(self.low?, now, -1), grown(self.high?, now, 1));
        let width_us = high.saturating_sub(low);
        (0..=WIDTH_MAX_US).contains(&width_us).then(|| low + width_us / 2)
    }

    #[inline(never)]
    fn bound_low(&mut self, now: Instant, bound_us: i64) {
        let tighter = self.low.is_none_or(|low| bound_us > grown(low, now, -1));
        if tighter {
            self.low = Some((now, bound_us));
        }
        if self.high.is_some_and(|high| grown(high, now, 1) < bound_us) {
            // One of the clocks was set.
            self.high = None;
        }
    }

    #[inline(never)]
    fn bound_high(&mut self, now: Instant, bound_us: i64) {
        let tighter = self.high.is_none_or(|high| bound_us < grown(high, now, 1));
        if tighter {
            self.high = Some((now, bound_us));
        }
        if self.low.is_some_and(|low| grown(low, now, -1) > bound_us) {
            self.low = None;
        }
    }
}

/// A bound, widened by the drift since it was set.
#[inline(never)]
fn grown((since, bound_us): (Instant, i64), now: Instant, sign: i64) -> i64 {
    let since_us = now.micros_since(since);
    // Mostly it is short: the core divides 32 bits in one instruction and 64 in some two hundred.
    let drift_us = match u32::try_from(since_us) {
        Ok(short_us) => u64::from(short_us / US_PER_DRIFT),
        Err(_) => since_us / u64::from(US_PER_DRIFT),
    };
    bound_us.saturating_add(sign * i64::try_from(drift_us).unwrap_or(i64::MAX))
}

fn micros(instant: Instant) -> i64 {
    i64::try_from(instant.0).unwrap_or(i64::MAX)
}

/// Never 0, which would be a request's `tc1`.
#[inline(never)]
pub(crate) fn nanos(instant: Instant) -> i64 {
    micros(instant).saturating_mul(1_000).max(1)
}

#[cfg(test)]
mod tests {
    use super::Stamped::{Angles, Position};
    use super::*;

    /// The autopilot booted 7 s before us; a message takes `there_us` one way and `back_us` the other.
    fn exchange(clock: &mut PeerClock, at_us: u64, there_us: u64, back_us: u64) {
        let ts1 = clock.ask(Instant(at_us));
        let theirs_us = at_us + there_us + 7_000_000;
        clock.answered(Instant(at_us + there_us + back_us), ts1, (theirs_us * 1_000) as i64);
    }

    #[test]
    fn the_moment_a_message_was_made_is_known_to_half_the_interval() {
        let mut clock = PeerClock::new();
        assert_eq!(clock.made(Instant(1_000_000), Position, 7_995), Instant(1_000_000), "nothing is known yet");
        exchange(&mut clock, 1_100_000, 3_000, 5_000);
        let made = clock.made(Instant(1_220_000), Position, 8_200);
        assert!(made.0.abs_diff(1_200_000) <= 5_000, "{made:?}");
        assert_eq!(clock.round_trip_us(), Some(8_000));
        // A faster exchange narrows it, a slower one says nothing new.
        exchange(&mut clock, 1_300_000, 500, 700);
        exchange(&mut clock, 1_400_000, 9_000, 40_000);
        let made = clock.made(Instant(1_520_000), Position, 8_500);
        assert!(made.0.abs_diff(1_500_000) <= 700, "{made:?}");
    }

    #[test]
    fn a_backlog_is_as_old_as_it_is_and_a_stamp_that_stands_still_says_nothing() {
        let mut clock = PeerClock::new();
        exchange(&mut clock, 11_000_000, 500, 500);
        for late_us in [500_000, 2_000_000, 5_000_000] {
            let stamp_ms = ((12_000_000 - late_us + 7_000_000) / 1_000) as u32;
            let made = clock.made(Instant(12_000_000), Position, stamp_ms);
            assert!(made.0.abs_diff(12_000_000 - late_us) <= 1_000, "{made:?}");
            assert_eq!(clock.made(Instant(12_000_000), Angles, stamp_ms), made, "another message with the same stamp");
            assert_eq!(clock.made(Instant(12_000_000), Position, stamp_ms), Instant(12_000_000));
        }
    }

    #[test]
    fn slow_exchanges_alone_are_not_believed() {
        let mut clock = PeerClock::new();
        exchange(&mut clock, 1_000_000, 10_000, 10_000);
        assert_eq!(clock.made(Instant(2_000_000), Position, 8_970), Instant(2_000_000));
    }

    #[test]
    fn bounds_grow_with_the_drift_and_are_given_up_when_they_contradict() {
        let mut clock = PeerClock::new();
        exchange(&mut clock, 1_000_000, 1_000, 1_000);
        assert_ne!(clock.made(Instant(2_000_000), Position, 8_990), Instant(2_000_000));
        // 100 seconds later each bound may be off by 10 ms.
        assert_eq!(clock.made(Instant(102_000_000), Position, 108_950), Instant(102_000_000));
        // The autopilot's clock starts over.
        exchange(&mut clock, 103_000_000, 1_000, 1_000);
        let ts1 = clock.ask(Instant(104_000_000));
        clock.answered(Instant(104_002_000), ts1, 501_000_000);
        let made = clock.made(Instant(104_020_000), Position, 510);
        assert!(made.0.abs_diff(104_010_000) <= 1_000, "{made:?}");
    }

    #[test]
    fn answers_to_nobody_and_absurd_ones_change_nothing() {
        let mut clock = PeerClock::new();
        clock.answered(Instant(1_000), 5, i64::MAX);
        let ts1 = clock.ask(Instant(1_000_000));
        clock.answered(Instant(1_001_000), ts1 + 1, 3);
        assert_eq!(clock.round_trip_us(), None);
        clock.answered(Instant(1_001_000), ts1, i64::MIN);
        clock.answered(Instant(1_002_000), ts1, i64::MAX);
        assert_eq!(clock.made(Instant(2_000_000), Position, u32::MAX), Instant(2_000_000));
    }
}
