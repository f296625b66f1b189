//! The rotating vehicle's paper: proven properties of motion ([`lemma`]), and filters that join rotations of which many are
//! outliers ([`direction`], [`pursuit`]).
//!
//! What flies, if the vehicle has one directional antenna: power in angular bins and the antenna's pattern in
//! [`foxhound_core::doa::rotating`], and the filter bank of [`foxhound_core::localize::source::bank`], which takes each
//! rotation as a sighting. It is as good as [`pursuit`] up to one outlier in four; a test compares the two.

pub mod direction;
pub mod lemma;
pub mod pursuit;
