//! The few inner loops that are worth the target's own instructions, each with a portable twin of the same bits; and
//! a fast inverse root.
//!
//! [`portable`] is used everywhere but on the target; the target's functions are in `armv7em`, which is compiled
//! there only. The bench compares the two word for word before it measures anything.

pub mod portable;
// The instructions are those of ARMv7E-M with the single precision unit; stable Rust does not expose `target_feature
// = "dsp"`, and this core has no other bare-metal target.
#[cfg(all(target_arch = "arm", target_os = "none"))]
pub mod armv7em;

#[cfg(all(target_arch = "arm", target_os = "none"))]
pub(crate) use armv7em as active;
#[cfg(not(all(target_arch = "arm", target_os = "none")))]
pub(crate) use portable as active;

pub use active::sqrt;

mod root;
pub(crate) use root::inverse_root;
