//! What a step may still spend on work that can wait.
//!
//! The fast loop has a ceiling for every step, whatever comes in. What a step must do is paid for first, each room by what
//! it costs at most; what is left goes to work that can be done a piece at a time over the steps that follow. A price is the
//! most instructions that a piece takes on a Cortex-M4F, counted in QEMU and rounded up; there is no clock in it, so that host
//! and target divide the work in the same way. Prices are those of blocks of 256 samples: longer ones cost more and are
//! divided in the same way.

/// Instructions that are left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Work {
    left: u32,
}

impl Work {
    /// As much as this.
    #[must_use]
    pub const fn new(instructions: u32) -> Self {
        Self { left: instructions }
    }

    /// All that there is to do.
    #[must_use]
    pub const fn unlimited() -> Self {
        Self { left: u32::MAX }
    }

    /// Pays for what has to be done.
    pub fn spend(&mut self, instructions: u32) {
        if self.left != u32::MAX {
            self.left = self.left.saturating_sub(instructions);
        }
    }

    /// What was not needed after all.
    pub fn give_back(&mut self, instructions: u32) {
        self.left = self.left.saturating_add(instructions);
    }

    /// What was spent of as much as there was.
    #[must_use]
    pub fn spent(&self, of: u32) -> u16 {
        u16::try_from(of.saturating_sub(self.left)).unwrap_or(u16::MAX)
    }

    /// Whether there is as much left as this.
    #[must_use]
    pub const fn has(&self, instructions: u32) -> bool {
        self.left >= instructions
    }

    /// Pays for a piece if there is enough left; false, and nothing paid, if there is not.
    #[must_use]
    pub fn take(&mut self, instructions: u32) -> bool {
        let is_enough = self.has(instructions);
        if is_enough {
            self.spend(instructions);
        }
        is_enough
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_piece_is_done_only_when_it_can_be_paid_for_and_debts_are_not_carried_on() {
        let mut work = Work::new(10);
        assert!(work.take(4) && !work.take(7) && work.take(6) && !work.take(1));
        work.spend(5);
        assert!(work.take(0) && !work.take(1));
        let mut work = Work::unlimited();
        assert!((0..10).all(|_| work.take(1 << 31)));
    }
}
