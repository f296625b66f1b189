//! What works on recorded frames, without a flight: bearings from them, and a calibration.
//!
//! | module | what it does |
//! |---|---|
//! | [`frames`] | reads recorded frames and the description of the array |
//! | [`bearings`] | `foxhound bearing` |
//! | [`calibrate`] | `foxhound calibrate` |

pub mod bearings;
pub mod calibrate;
pub mod frames;
