//! Turns a frame of four channels into one phasor each, with noise and interferers; and a packet received through a
//! switch into one for each antenna. It may import `base`.

pub mod phase;
pub mod spectrum;
pub mod switched;
