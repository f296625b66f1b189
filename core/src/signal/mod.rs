//! A frame of four channels becomes a phasor each, with noise and interferers. It may import `base`.

pub mod phase;
pub mod spectrum;
