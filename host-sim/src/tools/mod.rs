//! What works on recorded frames, without a flight: bearings from them, and a calibration.
//!
//! | module | what it does |
//! |---|---|
//! | [`frames`] | reads recorded frames and the description of the array |
//! | [`bearings`] | `foxhound bearing` |
//! | [`radio_array`] | the description of an array heard by another receiver: behind a switch, or complex samples |
//! | [`switched`] | `foxhound bearing --switched` |
//! | [`iq`] | `foxhound bearing --iq` |
//! | [`sigmf`], `wav`, `hci` | read SigMF and WAV recordings, and Bluetooth IQ reports |
//! | [`calibrate`] | `foxhound calibrate` |

pub mod bearings;
pub mod calibrate;
pub mod frames;
pub(crate) mod hci;
pub mod iq;
pub mod radio_array;
pub mod sigmf;
pub mod switched;
mod wav;
