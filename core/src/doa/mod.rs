//! Turns phasors into a bearing with a standard deviation: the array, its calibration, the estimators, and the
//! turning antenna. It may import `base` and `signal`.

pub mod array;
pub mod beam;
pub mod bearing;
pub mod calibration;
pub mod radio;
pub mod rotating;
pub mod switched;
