//! # Foxhound papers
//!
//! The systems of the published papers that Foxhound is built on, as printed and repaired, where the vehicle does not fly
//! them. The simulator, the benchmark and the twin of the firmware in QEMU compare them with what flies, which is in
//! [`foxhound_core`]; the image for the vehicle links none of them. Like the core this crate has no heap, no clock and no IO.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod aoa;
pub mod apf;
pub mod filters;
pub mod mixture;
pub mod multipath;
pub mod rotating;
mod systems;

pub use systems::AllSystems;
