//! System tests of the link, from outside: real bytes in, real bytes out.
#![expect(clippy::expect_used, clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod bench;
mod carriers;
mod core_reader;
mod entry;
mod exam;
mod failsafes;
mod jumps;
mod keys;
mod landing;
mod latching;
mod noise;
mod obstacles;
mod ownship;
mod params;
mod recorded;
mod requests;
mod setpoints;
mod signing;
mod take_off;
mod telemetry;
