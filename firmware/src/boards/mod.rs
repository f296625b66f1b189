//! The boards, a file each, with the folder of the same name for its memory map and what else is long. The build takes in the
//! one that is chosen (`build.rs`), as [`Chosen`]: its file has a `Machine`, which is the [`Board`](crate::board::Board).
//!
//! Everything `unsafe` of the firmware is in the boards, and in `arm`, which they share.

include!(concat!(env!("OUT_DIR"), "/chosen.rs"));
