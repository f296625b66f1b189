//! From bearings to an estimate of the source's position, also when the signal is reflected by walls. This module may
//! import `base`, `doa` and `mapping`.

pub mod belief;
pub mod goal;
pub mod link_state;
pub mod source;
