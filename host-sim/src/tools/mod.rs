//! Tools for recorded frames, without a flight: bearings from them, and a calibration.
//!
//! | module | what it does |
//! |---|---|
//! | [`frames`] | reads recorded frames and the description of the array |
//! | [`bearings`] | `foxhound bearing` |
//! | [`radio_array`] | the description of the array of another receiver: behind a switch, or with complex samples |
//! | [`switched`] | `foxhound bearing --switched` |
//! | [`iq`] | `foxhound bearing --iq` |
//! | [`sigmf`] | reads SigMF recordings |
//! | [`calibrate`] | `foxhound calibrate` |

pub mod bearings;
pub mod calibrate;
pub mod frames;
pub mod iq;
pub mod radio_array;
pub mod sigmf;
pub mod switched;
