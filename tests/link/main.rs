//! Over a real line and in real time, the companion flies with an autopilot, signs, and is understood.
//!
//! Each test shares the machine with the others, but for [`live_attacked`], which measures gaps of a tenth of a second and
//! takes it alone.

mod companion;
mod live_attacked;
mod mavlink_peers;
mod mavsdk_mavproxy;
mod radio;
mod signed_flight;
mod signing;
