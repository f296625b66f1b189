//! What is in the way: hits become circles and walls that are remembered, and where has been looked is kept. It may import
//! `base`.

pub mod lidar;
pub mod lor;
pub mod map;
pub mod scan;
pub mod sight;
pub mod tracks;
