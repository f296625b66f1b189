//! Bearings become what is believed of where the source is, over reflecting walls too. It may import `base`, `doa` and
//! `mapping`.

pub mod goal;
pub mod link_state;
pub mod pursuit;
pub mod source;
