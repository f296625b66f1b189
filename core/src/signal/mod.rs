//! A frame of four channels becomes a phasor each, with noise and interferers; a packet heard through a switch, one for each
//! antenna. It may import `base`.

pub mod phase;
pub mod spectrum;
pub mod switched;
