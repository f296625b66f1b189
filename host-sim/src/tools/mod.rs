//! Tools for recorded frames and live radios: bearings from them, and a calibration.
//!
//! | module | what it does |
//! |---|---|
//! | [`frames`] | reads recorded frames and the description of the array |
//! | [`bearings`] | `foxhound bearing` |
//! | [`looks`] | one direction of several frames, a reflection kept apart |
//! | [`radio_array`] | the description of the array of another receiver: behind a switch, or with complex samples |
//! | [`switched`] | `foxhound bearing --switched` |
//! | [`iq`] | `foxhound bearing --iq` |
//! | `sigmf`, `wav`, `hci` | read SigMF and WAV recordings, and Bluetooth IQ reports |
//! | [`listen`] | bearings, spectrum and eigenvalues of a recording: `foxhound listen` |
//! | [`live`] | bearings of a live radio: `foxhound companion --bearings` |
//! | [`calibrate`] | `foxhound calibrate` |

pub mod bearings;
pub mod calibrate;
mod eigen;
pub mod frames;
pub(crate) mod hci;
pub mod iq;
pub mod listen;
pub mod live;
pub mod looks;
pub mod radio_array;
mod sigmf;
pub mod switched;
mod wav;
