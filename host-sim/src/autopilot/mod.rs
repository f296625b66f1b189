//! The other end of the MAVLink line: models of ArduPilot Copter and PX4, the line itself, and logs of its traffic.
//!
//! | module | content |
//! |---|---|
//! | [`model`] | the autopilots, rule by rule |
//! | [`transport`] | the line in real time: TCP, UDP, a serial port |
//! | [`tlog`] | telemetry logs; not in `record`, which imports flights: flights write them |

use foxhound_link::dialect::STATUSTEXT_DATA;

pub mod model;
pub mod tlog;
pub mod transport;

pub use model::{Autopilot, Battery, Faults, GUIDED, Proximity, Start, Told, Wire};

/// The times after which the autopilots stop without setpoints, as `docs/hardware/autopilot.md` has them set.
pub const TIMEOUTS_S: [(&str, f64); 2] = [("GUID_TIMEOUT", 1.0), ("COM_OF_LOSS_T", 0.5)];

/// Whether a companion asks its pilot to leave the mode and enter it again.
#[must_use]
pub fn asks_for_entry(text: &STATUSTEXT_DATA) -> bool {
    text.text.to_str().is_ok_and(|text| text.contains("enter it again"))
}
