//! Proven properties of motion, from the rotating vehicle's paper.
//!
//! The rest of that paper flies, if the vehicle has one directional antenna: power in angular bins and the antenna's
//! pattern in [`foxhound_core::doa::rotating`], rotations with their outliers in
//! [`foxhound_core::localize::pursuit`].

pub mod lemma;
