//! Which seeds are for what. Constants are chosen by flights on [`DEVELOPMENT`] seeds; tests and published numbers are flown on
//! [`TEST`] seeds, on which nothing is ever tuned.

use std::ops::Range;

/// For choosing constants and for trying things out.
pub const DEVELOPMENT: Range<u64> = 0..1_000_000;

/// Held out: for tests and for the numbers in the documentation.
pub const TEST: Range<u64> = 1_000_000..2_000_000;

// No seed is in both.
const _: () = assert!(DEVELOPMENT.end <= TEST.start);

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
