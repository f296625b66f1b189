//! The basis of every layer: units, time, vectors, frames of samples, mathematics, random numbers, the vehicle's own
//! position, errors. It imports no other layer.

pub mod adc;
pub mod config;
pub mod error;
pub mod history;
pub mod math;
pub mod ned;
pub mod obstacle;
pub mod ownship;
pub mod pose;
pub mod rng;
pub mod sort;
pub mod time;
pub mod trace;
pub mod units;
