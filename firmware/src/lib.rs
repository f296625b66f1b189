//! # Foxhound firmware
//!
//! The same two functions as in the simulator, `guidance::Guidance::step` and `planner::Planner::plan`, driven by
//! interrupts.
//!
//! | module | what | imports |
//! |---|---|---|
//! | [`board`] | what the application asks of a board: [`board::Board`] | |
//! | [`timing`] | how long the tasks take | `board` |
//! | [`console`] | the maintenance port | `board`, `timing` |
//! | [`app`] | the tasks | `board`, `timing`, `console` |
//! | `arm` | what the boards with an Arm Cortex-M share | `board`, `register_values` |
//! | [`register_values`] | sums behind registers | |
//! | [`boards`] | everything that differs from board to board | `board`, `arm`, `register_values` |
//!
//! So no board knows the application, nor the application a board; `program` brings them together, and
//! `tests/proof/floors.rs` holds it.
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
