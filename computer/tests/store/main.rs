//! The store on a flash in memory: whenever the power goes, all old or all new; whatever is in the flash, no panic and an end.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod cuts;
mod flash;
mod model;
mod spoilt;
mod start;
