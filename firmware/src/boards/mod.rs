//! The boards, one file each, with a folder of the same name for its memory map and longer parts. The build includes
//! the chosen one (`build.rs`) as [`Chosen`]: its file has a `Machine`, which implements
//! [`Board`](crate::board::Board).
//!
//! All `unsafe` code of the firmware is in the boards, and in `arm`, which they share.

include!(concat!(env!("OUT_DIR"), "/chosen.rs"));
