//! The whole companion computer, in simulated time, fails safe, logs what can be flown again, and tests itself.

mod failsafes;
mod flight_log;
mod selftest;
