//! The whole companion computer, in simulated time, fails safe, writes logs that can be replayed, and tests itself.

mod failsafes;
mod flight_log;
mod iq;
mod selftest;
