//! The other end of the MAVLink line: models of ArduPilot Copter and PX4, the line itself, and logs of its traffic.
//!
//! | module | content |
//! |---|---|
//! | [`model`] | the autopilots, rule by rule |
//! | [`transport`] | the line in real time: TCP, UDP, a serial port |
//! | [`tlog`] | telemetry logs; not in `record`, which imports flights: flights write them |

pub mod model;
pub mod tlog;
pub mod transport;

pub use model::{Autopilot, Battery, Faults, GUIDED, Proximity, Start, Told, Wire};
