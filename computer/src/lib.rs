//! # The flight computer, without its hardware
//!
//! What the firmware does around guidance and link, as far as it needs no register for that; so it runs on the desktop,
//! too, and is tested there. Like `core` and `link` it has no heap, no clock, no IO and no globals.
//!
//! | module | what |
//! |---|---|
//! | [`flight`] | one step: link, guidance, link; the same lines in the firmware and in the simulator |
//! | [`camera`] | frames of a camera that looks down, and what the pad detector makes of them; with the feature `pad`, which is on unless it is turned off |
//! | [`circular`] | reading a ring that DMA writes |
//! | [`deadline`] | whether steps are in time, and whether the watchdog is to be fed |
//! | [`log`] | what goes into a flight, written down so that the host can fly it again |
//! | [`part`] | what the part refuses: kept by the drivers, checked by the twin |
//! | [`port`] | the maintenance port: lines in, words out |
//! | [`frozen`] | whether the converters still convert |
//! | [`sampling`] | sample rates that a timer can have |
//! | [`lidar`] | a lidar on a line of its own: its frames to scans |
//! | [`selftest`] | the receiver examined and calibrated on board |
//! | [`timing`] | how long the tasks take |
//! | [`tone`] | the test tone of a board that can make one |
//! | [`restart`] | why the computer has restarted: what is kept over a reset |
//! | [`store`] | what is kept while the power is off |
//! | [`twin`] | the memory that the twin in QEMU shares with the simulator: frames in, reports out |
#![no_std]

#[cfg(test)]
extern crate std;

#[cfg(feature = "pad")]
pub mod camera;
pub mod circular;
pub mod deadline;
pub mod flight;
pub mod frozen;
pub mod lidar;
pub mod log;
pub mod part;
pub mod port;
pub mod restart;
pub mod sampling;
pub mod selftest;
pub mod store;
pub mod timing;
pub mod tone;
pub mod twin;

/// Samples of one channel in one frame.
pub const SAMPLES_PER_CHANNEL: usize = 256;
