//! Over a real line and against the wall clock, the companion flies beside an autopilot, signs, and is understood.

mod companion;
mod live_attacked;
mod mavlink_peers;
mod mavsdk_mavproxy;
mod signed_flight;
mod signing;
