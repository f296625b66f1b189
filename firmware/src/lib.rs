//! # Foxhound firmware
//!
//! The same two functions as in the simulator, `guidance::Guidance::step` and `planner::Planner::plan`, driven by
//! interrupts: [`app`] holds the tasks, [`boards`] everything that differs from board to board.
//!
//! ```text
//!  antennas -> board::Pacer --> app::guide --> outgoing --> app::transmit -> board::Transmitter -> autopilot
//!  autopilot -> board::Receiver -----^  |    ^
//!                                orders v    | plans
//!                                   app::plan (may be pre-empted by all of the above)
//! ```
#![no_std]

#[cfg(not(any(feature = "board-nucleo_g474re", feature = "board-mps2_an386")))]
compile_error!("choose a board: --features board-nucleo_g474re or board-mps2_an386");
#[cfg(all(feature = "board-nucleo_g474re", feature = "board-mps2_an386"))]
compile_error!("choose one board only: board-nucleo_g474re or board-mps2_an386");

#[cfg(any(feature = "board-nucleo_g474re", feature = "board-mps2_an386"))]
pub mod app;
#[cfg(any(feature = "board-nucleo_g474re", feature = "board-mps2_an386"))]
mod arm;
#[cfg(any(feature = "board-nucleo_g474re", feature = "board-mps2_an386"))]
pub mod boards;
#[cfg(any(feature = "board-nucleo_g474re", feature = "board-mps2_an386"))]
pub mod console;
#[cfg(any(feature = "board-nucleo_g474re", feature = "board-mps2_an386"))]
pub mod timing;
