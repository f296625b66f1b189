//! Checks whether the fast loop is in time.
//!
//! A step begins when its frame is handed over and ends when its setpoint is on its way to the serial line. A step that
//! takes longer than [`Config::budget_us`] is late. What that means for the vehicle:
//!
//! | event | what the vehicle does |
//! |---|---|
//! | a step is late | nothing else changes: the newest setpoint was at most that much older. It is counted and reported |
//! | no step in time for the watchdog's timeout | the computer restarts, and comes up in standby: without setpoints the autopilot stops by itself; the pilot enters the mode again |
//! | the planner gets no time | it misses its handover tick: the old plan is followed to its end, then the guard brakes (`PlanLate`) |
//!
//! The watchdog is fed only after [`Verdict::Met`] and [`Verdict::Excused`]. A step is excused if the flash was
//! written in it, which stops the processor; the link allows that only outside control.

/// How long a step may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// From the frame's hand-over to the setpoint, microseconds.
    pub budget_us: u32,
}

impl Default for Config {
    /// Half of the 20 ms from frame to frame: ten times the duration of the worst step.
    fn default() -> Self {
        Self { budget_us: 10_000 }
    }
}

/// Timing of one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// In time.
    Met,
    /// Late, and the watchdog must not be fed.
    Missed,
    /// Late, for an allowed reason.
    Excused,
}

impl Verdict {
    /// Whether the watchdog may be fed.
    #[must_use]
    pub fn feeds(self) -> bool {
        self != Self::Missed
    }
}

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
    config: Config,
    counts: Counts,
}

impl Monitor {
    /// Before the first step.
    #[must_use]
    pub const fn new(config: Config) -> Self {
        Self { config, counts: Counts { steps: 0, late: 0, longest_us: 0 } }
    }

    /// Records a step of that duration; `is_excused` if it had to do something slow.
    pub fn step(&mut self, taken_us: u32, is_excused: bool) -> Verdict {
        let counts = &mut self.counts;
        counts.steps = counts.steps.saturating_add(1);
        if is_excused {
            return Verdict::Excused;
        }
        counts.longest_us = counts.longest_us.max(taken_us);
        if taken_us <= self.config.budget_us {
            return Verdict::Met;
        }
        counts.late = counts.late.saturating_add(1);
        Verdict::Missed
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
        let mut monitor = Monitor::new(Config { budget_us: 1000 });
        assert_eq!(monitor.step(1000, false), Verdict::Met);
        assert_eq!(monitor.step(1001, false), Verdict::Missed);
        assert!(!Verdict::Missed.feeds() && Verdict::Met.feeds());
        assert_eq!(monitor.counts(), Counts { steps: 2, late: 1, longest_us: 1001 });
    }

    #[test]
    fn a_step_that_wrote_the_flash_is_neither_late_nor_the_longest() {
        let mut monitor = Monitor::default();
        assert_eq!(monitor.step(1_000_000, true), Verdict::Excused);
        assert!(Verdict::Excused.feeds());
        assert_eq!(monitor.counts(), Counts { steps: 1, late: 0, longest_us: 0 });
    }

    #[test]
    fn the_counters_stay_at_their_ends() {
        let counts = Counts { steps: u32::MAX, late: u32::MAX, longest_us: 0 };
        let mut monitor = Monitor { counts, ..Monitor::default() };
        assert_eq!(monitor.step(u32::MAX, false), Verdict::Missed);
        assert_eq!(monitor.counts(), Counts { steps: u32::MAX, late: u32::MAX, longest_us: u32::MAX });
    }
}
