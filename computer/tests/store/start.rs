//! The flight begins with what was kept.
