//! Which seeds are for what. Constants are chosen by flights on [`DEVELOPMENT`] seeds; tests and published numbers are flown on
//! [`TEST`] seeds, on which nothing is ever tuned.

use std::ops::Range;

/// For choosing constants and for trying things out.
pub const DEVELOPMENT: Range<u64> = 0..1_000_000;

/// Held out: for tests and for the numbers in the documentation.
pub const TEST: Range<u64> = 1_000_000..2_000_000;

/// The first `count` development seeds.
#[must_use]
pub fn development(count: u64) -> Range<u64> {
    DEVELOPMENT.start..DEVELOPMENT.start + count
}

/// The first `count` held-out seeds.
#[must_use]
pub fn test(count: u64) -> Range<u64> {
    TEST.start..TEST.start + count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_seed_is_in_both() {
        assert!(DEVELOPMENT.end <= TEST.start && TEST.contains(&(test(1000).end - 1)));
    }
}
