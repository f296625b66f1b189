//! # Foxhound firmware
//!
//! The same two functions as in the simulator, `guidance::Guidance::step` and `planner::Planner::plan`, driven by
//! interrupts.
//!
//! | module | content | imports |
//! |---|---|---|
//! | [`board`] | the interface to a board: [`board::Board`] | |
//! | [`timing`] | how long the tasks take | `board` |
//! | [`console`] | the maintenance port | `board`, `timing` |
//! | [`app`] | the tasks | `board`, `timing`, `console` |
//! | `arm` | code that the boards with an Arm Cortex-M share | `board`, `register_values` |
//! | [`register_values`] | calculations of register values | |
//! | [`boards`] | everything that differs from board to board | `board`, `arm`, `register_values` |
//!
//! So a board does not know the application, nor the application a board; `program` combines them.
//! `tests/proof/floors.rs` checks that.
//!
//! ```text
//!  antennas -> Pacer --> app::guide --> outgoing --> app::transmit -> Transmitter -> autopilot
//!  autopilot -> Receiver ----^  |    ^
//!                        orders v    | plans
//!                           app::plan (may be pre-empted by all of the above)
//! ```
#![cfg_attr(target_os = "none", no_std)]

pub mod app;
#[cfg(target_os = "none")]
mod arm;
pub mod board;
pub mod boards;
pub mod console;
#[cfg(target_os = "none")]
pub mod program;
pub mod register_values;
pub mod timing;
