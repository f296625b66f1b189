//! The rotating vehicle's paper: proven properties of motion ([`lemma`]).
//!
//! What flies, if the vehicle has one directional antenna: power in angular bins and the antenna's pattern in
//! [`foxhound_core::doa::rotating`], and the filter bank of [`foxhound_core::localize::source::bank`], which takes each
//! rotation as a sighting.

pub mod lemma;
