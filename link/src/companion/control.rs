//! Whether guidance may move the vehicle, and why not.

use foxhound_core::base::time::Instant;
use foxhound_core::guidance::mission::Control;

use super::Companion;
use crate::clock::is_over;
use crate::failsafe::{Cause, Input};
use crate::health::Charge;

/// Without a usable ownship for this long, setpoints end.
const OWNSHIP_LOST_S: f32 = 2.0;
/// Setpoints that are not sane for this long, or a guidance that publishes nothing for this long, make us unfit.
const INSANE_MAX_S: f32 = 0.5;
const GUIDANCE_SILENT_MAX_S: f32 = 2.0;
/// With more damaged frames than this the vehicle is not moved.
const NOISE_HOLD_PERCENT: u32 = 20;

impl Companion {
    /// Whether guidance may move the vehicle.
    #[must_use]
    #[inline(never)]
    pub fn control(&self, now: Instant) -> Control {
        match self.cause(now) {
            Cause::None | Cause::OwnshipLost => Control::Granted,
            Cause::NoAutopilot | Cause::LinkLost | Cause::LinkQuiet => Control::LinkLost,
            _ => Control::NotInControl,
        }
    }

    /// Why guidance may not move the vehicle.
    #[must_use]
    #[inline(never)]
    pub fn cause(&self, now: Instant) -> Cause {
        let charge = self.health.charge(self.config.battery_min_percent);
        let silent = |limit_s| self.autopilot.is_none_or(|autopilot| is_over(now, autopilot.heard, limit_s));
        Input {
            unfit: self.is_unfit(now),
            has_autopilot: self.autopilot.is_some(),
            is_lost: silent(self.config.silence_after_s),
            is_quiet: silent(self.config.heartbeat_timeout_s),
            obeys: self.obeys(),
            on_ground: self.is_on_ground(),
            store_damaged: self.store_damaged,
            entry_needed: self.entry_needed,
            switched_off: self.config.switch_channel > 0 && !self.health.is_switched_on(now),
            paused: self.paused,
            battery_critical: charge == Charge::Critical,
            battery_low: charge == Charge::Low,
            seeking: self.seeking,
            fence_breached: self.health.is_fence_breached(),
            is_noisy: self.noise.percent > NOISE_HOLD_PERCENT,
            ownship_lost: self.is_ownship_lost(now),
        }
        .cause()
    }

    /// Whether there has been no usable ownship for so long that setpoints end.
    pub(super) fn is_ownship_lost(&self, now: Instant) -> bool {
        self.usable_at.is_some_and(|at| is_over(now, at, OWNSHIP_LOST_S))
    }

    /// Whether the autopilot would obey us.
    pub(super) fn obeys(&self) -> bool {
        self.autopilot.is_some_and(|autopilot| autopilot.obeys())
    }

    /// Whether it would, or may again by itself.
    pub(super) fn may_obey(&self) -> bool {
        self.autopilot.is_some_and(|autopilot| autopilot.may_obey())
    }

    #[inline(never)]
    fn is_unfit(&self, now: Instant) -> bool {
        let lasts = |since: Option<Instant>, limit_s| since.is_some_and(|since| is_over(now, since, limit_s));
        self.failed
            || lasts(self.insane_since, INSANE_MAX_S)
            || lasts(self.published.map(|published| published.time), GUIDANCE_SILENT_MAX_S)
    }
}
