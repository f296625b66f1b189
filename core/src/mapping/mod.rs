//! Obstacles: hits become circles and walls that are remembered, and which places the sensor has seen is kept. It may import
//! `base`.

pub mod coverage;
pub mod lidar;
pub mod map;
pub mod scan;
pub mod tracks;
pub mod walls;
