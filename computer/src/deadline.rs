//! Checks whether the fast loop is in time.
//!
//! A step begins when its frame is handed over and ends when its setpoint is on its way to the serial line. A step that
//! takes longer than [`BUDGET_US`] is late. What that means for the vehicle:
//!
//! | event | what the vehicle does |
//! |---|---|
//! | a step is late | nothing else changes: the newest setpoint was at most that much older. It is counted and reported |
//! | no step in time for the watchdog's timeout | the computer restarts, and comes up in standby: without setpoints the autopilot stops by itself; the pilot enters the mode again |
//! | the planner gets no time | it misses its handover tick: the old plan is followed to its end, then the guard brakes (`PlanLate`) |
//!
//! The watchdog is fed only after a step that was in time or excused. A step is excused if the flash was written in it,
//! which stops the processor; the link allows that only outside control.

/// How long a step may take, from the frame's hand-over to the setpoint, microseconds. It is half of the 20 ms from frame
/// to frame. The worst step of the bench takes two thirds of it at one cycle for an instruction, nearly all at one and a half;
/// at 1.75, and with a scan of 360 rays in it, it is late.
pub const BUDGET_US: u32 = 10_000;

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// All steps.
    pub steps: u32,
    /// Those that were late.
    pub late: u32,
    /// The longest step without an excuse, microseconds.
    pub longest_us: u32,
}

/// Monitors the steps.
#[derive(Clone, Copy, Debug, Default)]
pub struct Monitor {
    counts: Counts,
}

impl Monitor {
    /// Records a step of that duration; `is_excused` if it had to do something slow. Whether the watchdog may be fed.
    pub fn step(&mut self, taken_us: u32, is_excused: bool) -> bool {
        let counts = &mut self.counts;
        counts.steps = counts.steps.saturating_add(1);
        if is_excused {
            return true;
        }
        counts.longest_us = counts.longest_us.max(taken_us);
        let is_met = taken_us <= BUDGET_US;
        counts.late = counts.late.saturating_add(u32::from(!is_met));
        is_met
    }

    /// The counts so far.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_step_is_counted_and_does_not_feed_the_watchdog() {
        let mut monitor = Monitor::default();
        assert!(monitor.step(BUDGET_US, false));
        assert!(!monitor.step(BUDGET_US + 1, false));
        assert_eq!(monitor.counts(), Counts { steps: 2, late: 1, longest_us: BUDGET_US + 1 });
    }

    #[test]
    fn a_step_that_wrote_the_flash_is_neither_late_nor_the_longest() {
        let mut monitor = Monitor::default();
        assert!(monitor.step(1_000_000, true));
        assert_eq!(monitor.counts(), Counts { steps: 1, late: 0, longest_us: 0 });
    }

    #[test]
    fn the_counters_stay_at_their_ends() {
        let mut monitor = Monitor { counts: Counts { steps: u32::MAX, late: u32::MAX, longest_us: 0 } };
        assert!(!monitor.step(u32::MAX, false));
        assert_eq!(monitor.counts(), Counts { steps: u32::MAX, late: u32::MAX, longest_us: u32::MAX });
    }
}
