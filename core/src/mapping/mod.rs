//! Obstacles: converts hits to circles and walls, remembers them, and records which places the sensor has seen. This
//! module may import `base`.

pub mod coverage;
pub mod lidar;
pub mod map;
pub mod scan;
pub mod tracks;
pub mod walls;
