//! Lines of reflection.

pub mod line;
pub use line::Line;
