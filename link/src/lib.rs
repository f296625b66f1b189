//! # Foxhound link
//!
//! How Foxhound talks to an autopilot: MAVLink 2, as a companion computer. No heap, no clock, no IO: bytes and the time
//! go in as arguments, bytes come out, so that the firmware's UART, the simulator and a test drive the same code.
//!
//! ```text
//!  bytes in  -> framer -> companion -> ownship, scan, control  -> guidance
//!  bytes out <- outbox <- companion <- setpoint, what happened <- guidance
//! ```
//!
//! [`companion`] is the entry for a flight computer. [`framer`] and [`dialect`] serve both ends of a link: the
//! simulator plays the autopilot with them. [`radio`] reads what direction finders send over a serial line.
//!
//! ## Size
//!
//! `cargo xtask size` prints what all this takes of the flash. The crate is compiled for size; `#[inline(never)]`
//! stands where a function would otherwise be inlined into fast code, or twice. Of the dialect only the messages that
//! are read or written are linked ([`framer::Content`]).
//!
//! ## Sources
//!
//! The MAVLink guide (<https://mavlink.io/en/guide/serialization.html>) for the frame, the public message definitions
//! for [`dialect`], ArduPilot's and PX4's documentation of GUIDED and OFFBOARD for the behaviour.
#![no_std]

#[cfg(test)]
extern crate std;

#[expect(clippy::allow_attributes, reason = "generated code")]
#[allow(
    clippy::all,
    clippy::doc_markdown,
    clippy::panic,
    clippy::use_self,
    deprecated,
    missing_docs,
    non_camel_case_types,
    non_snake_case,
    rustdoc::bare_urls,
    unreachable_pub,
    unused_imports,
    reason = "generated code"
)]
pub mod dialect {
    //! The messages and names that we use, generated from `dialect/foxhound.xml`.
    include!(concat!(env!("OUT_DIR"), "/dialect.rs"));
}

pub mod companion;
pub mod failsafe;
pub mod framer;
pub mod params;
pub mod radio;
pub mod signing;

mod advice;
mod autopilot;
mod beams;
mod clock;
mod continuity;
mod health;
mod landing;
mod obstacles;
mod outbox;
mod requests;
mod sources;
mod surroundings;
mod turns;

pub use mavlink_core::types::CharArray;
pub use mavlink_core::{Message, MessageData};
