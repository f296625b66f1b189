//! The whole companion, guidance and link, with both modelled autopilots and a vehicle that moves: faults, the
//! vehicle's reaction, and that it continues afterwards.
//!
//! The assertions are about the true state of the vehicle and of the autopilot, and the bytes on the line; never
//! about the companion's own reports.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod age;
mod jumps;
mod rows;
mod soak;
mod stand;
