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
pub mod bearings;
pub mod calibrate;
pub mod drive;
pub mod frames;
pub mod gusts;
pub mod landings;
pub mod link_state;
pub mod matrix;
pub mod mcap;
pub mod plot;
pub mod report;
pub mod reproduce;
pub mod scenario;
pub mod seeds;
mod sheet;
pub mod table;
pub mod world;
