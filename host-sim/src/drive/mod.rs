//! The flight computer, and the loops that connect it with world and autopilot, for one flight or for many.
//!
//! | module | content |
//! |---|---|
//! | [`computer`] | the flight computer, in this process |
//! | [`qemu`], [`g474`] | the same as a firmware image: in QEMU, or in an instruction emulator |
//! | [`flight`] | one closed-loop flight |
//! | [`suite`], [`maps`] | many flights in parallel, and the maps that they are flown on |
//! | [`rig`] | one step of vehicle, autopilot and world, used by [`flight`] and [`trial`] |
//! | [`trial`] | the loop step by step, for callers that inject faults |
//! | [`soak`], [`campaign`] | days of the link, and hundreds of missions, with faults |
//! | [`companion`] | the loop in real time, with a real or modelled autopilot |
//! | `lines` | files by which interrupted work goes on |
//! | [`replay`] | repeats a flight from its log |

pub mod campaign;
mod child;
pub mod companion;
pub mod computer;
pub mod flight;
pub mod g474;
mod landing;
mod lines;
pub mod maps;
pub mod qemu;
pub mod replay;
pub mod rig;
pub mod soak;
pub mod suite;
pub mod trial;
