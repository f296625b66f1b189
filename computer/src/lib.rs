//! # The flight computer, without its hardware
//!
//! The parts of the firmware around guidance and link that need no registers; they run on the desktop, too, and are
//! tested there. Like `core` and `link` this crate has no heap, no clock, no IO and no globals.
//!
//! | module | content |
//! |---|---|
//! | [`flight`] | one step: link, guidance, link; the same code in the firmware and in the simulator |
//! | [`camera`] | frames of a camera that looks down, and the pad detector's results; with the feature `pad`, which is on by default |
//! | [`features`] | what an image may have been built without |
//! | [`circular`] | reading a ring that DMA writes |
//! | [`deadline`] | checks whether steps are in time, and whether the watchdog is to be fed |
//! | [`log`] | records every input of a flight, so that the host can fly it again |
//! | [`part`] | what the chip refuses: obeyed by the drivers, checked by the twin |
//! | [`port`] | the maintenance port: commands in, text out |
//! | [`frozen`] | detects converters that have stopped |
//! | [`sampling`] | sample rates that a timer can have |
//! | [`lidar`] | a lidar on a line of its own: its frames to scans |
//! | [`radio`] | a radio on the same line: its angles, or its IQ reports, to bearings |
//! | [`iq`] | IQ reports to bearings; with the feature `iq` |
//! | [`sensor`] | which of the two there is |
//! | [`selftest`] | the receiver tested and calibrated on board |
//! | [`timing`] | how long the tasks take |
//! | [`tone`] | the test tone of a board that can make one |
//! | [`restart`] | why the computer has restarted: a record that survives a reset |
//! | [`store`] | non-volatile storage |
//! | [`twin`] | the memory that the twin in QEMU shares with the simulator: frames in, reports out |
#![no_std]

#[cfg(test)]
extern crate std;

mod came;
#[cfg_attr(not(feature = "pad"), path = "no_camera.rs")]
pub mod camera;
pub mod circular;
pub mod deadline;
pub mod features;
pub mod flight;
pub mod frozen;
#[cfg_attr(not(feature = "iq"), path = "no_iq.rs")]
pub mod iq;
pub mod lidar;
pub mod log;
pub mod part;
pub mod port;
pub mod radio;
pub mod restart;
pub mod sampling;
pub mod selftest;
pub mod sensor;
pub mod store;
pub mod timing;
pub mod tone;
pub mod twin;

/// Samples of one channel in one frame.
pub const SAMPLES_PER_CHANNEL: usize = 256;
