//! Requirements for every change: equal traces, imports in one direction, bad input refused, a correct manual.

mod bad_input;
mod comments;
mod core_purity;
mod floors;
// Public, for the properties are a library's: `fuzz/src/lib.rs`.
pub mod fuzz_properties;
mod golden;
mod manual;
