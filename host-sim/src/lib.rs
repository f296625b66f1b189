//! # Foxhound simulator
//!
//! The world around the core: antennas, pillars, a vehicle and an autopilot that speaks MAVLink. A flight steps the same
//! two functions that the firmware steps, over the same bytes, so a simulated flight and one in QEMU agree bit for bit.
//!
//! ```text
//!  scenario -> world -> antennas --codes--> computer <--MAVLink--> autopilot -> vehicle -> world
//!                    `-> sensor --OBSTACLE_DISTANCE--^
//! ```

pub mod autopilot;
pub mod drive;
pub mod record;
pub mod scenario;
pub mod study;
pub mod tools;
pub mod world;
