//! What happens to received data as time passes: it expires, and it must not look fresh when the clock runs backwards.

use foxhound_core::base::ownship::Ownship;
use foxhound_core::base::time::Instant;

use super::{Companion, Noise, UNSETTLED_US, count};
use crate::clock::{PeerClock, is_over};

/// Ownship older than this is of no use.
const OWNSHIP_AGE_MAX_S: f32 = 0.5;
/// A scan, or points, that were not fetched for this long are dropped.
const OBSTACLE_AGE_MAX_S: f32 = 0.5;
/// A setpoint that waits for the wire longer than this is counted as late.
const LATE_US: u64 = 200_000;
/// Damaged frames are counted over this long, and there must be some frames at all.
const NOISE_WINDOW_US: u64 = 2_000_000;
const NOISE_FRAMES_MIN: u32 = 20;

impl Companion {
    /// Drops what is too old, and records what is still usable.
    #[inline(never)]
    pub(super) fn age(&mut self) {
        let now = self.now;
        self.turns.age(now, OBSTACLE_AGE_MAX_S);
        if self.points.as_ref().is_some_and(|points| is_over(now, points.time, OBSTACLE_AGE_MAX_S)) {
            self.points = None;
        }
        let is_young = |ownship: &Ownship| {
            !is_over(now, ownship.position_time, OWNSHIP_AGE_MAX_S)
                && !is_over(now, ownship.attitude_time, OWNSHIP_AGE_MAX_S)
        };
        if self.ownship().as_ref().is_some_and(is_young) {
            self.usable_at = Some(now);
        }
        if now.micros_since(self.noise.since) >= NOISE_WINDOW_US {
            let counters = self.framer.counters();
            let good = counters.frames.saturating_add(counters.unknown);
            let (new_good, new_bad) = (good - self.noise.good, counters.bad_crc - self.noise.bad);
            let all = new_good.saturating_add(new_bad);
            let percent = if all < NOISE_FRAMES_MIN { 0 } else { (u64::from(new_bad) * 100 / u64::from(all)) as u32 };
            self.noise = Noise { since: now, good, bad: counters.bad_crc, percent };
        }
        let is_late = self.outbox.waiting_since().is_some_and(|since| now.micros_since(since) > LATE_US);
        if is_late && !self.was_late {
            count(&mut self.counters.setpoints_late);
        }
        self.was_late = is_late;
    }

    /// A clock that runs backwards must not make old things look fresh.
    pub(super) fn follow_clock(&mut self, now: Instant) {
        if now < self.now {
            self.published = None;
            self.insane_since = None;
            self.turns.clear();
            self.points = None;
            self.clock = PeerClock::new();
            self.settled_at = self.settled_at.min(now.plus_micros(UNSETTLED_US));
            self.usable_at = self.usable_at.map(|at| at.min(now));
            self.noise.since = now;
            self.heartbeat_due = now;
            self.timesync_due = now;
            self.telemetry.restart(now);
            self.requests.restart(now);
            self.health.follow_clock(now);
            self.sources.follow_clock(now);
            self.advice.follow_clock(now);
            self.params.follow_clock(now);
            self.landing.follow_clock(now);
            if let Some(position) = &mut self.position {
                position.time = position.time.min(now);
            }
            if let Some(attitude) = &mut self.attitude {
                attitude.time = attitude.time.min(now);
            }
            if let Some(autopilot) = &mut self.autopilot {
                autopilot.heard = autopilot.heard.min(now);
            }
        }
        self.now = now;
    }
}
