//! The whole companion, guidance and link, beside both modelled autopilots, with a vehicle that moves: what goes wrong, what
//! the vehicle does about it, and that it goes on afterwards.
//!
//! What is asserted is the truth of the vehicle and of the autopilot, and the bytes that went over the wire; never what the
//! companion says about itself.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod age;
mod jumps;
mod rows;
mod soak;
mod stand;
