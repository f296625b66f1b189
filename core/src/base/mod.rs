//! What every floor stands on: units, time, vectors, frames of codes, mathematics, random numbers, the vehicle's own
//! position, errors. It imports no other floor.

pub mod adc;
pub mod error;
pub mod frame;
pub mod math;
pub mod obstacle;
pub(crate) mod order;
pub mod ownship;
pub mod pose;
pub mod rng;
pub mod time;
pub mod trace;
pub mod units;
