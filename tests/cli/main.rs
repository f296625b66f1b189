//! The commands, and the files and pages that they write, are as the manual describes them.
//!
//! Browsers and a Ray cluster start many processes: their tests take the machine one after the other.

mod command_line;
mod hands;
mod interrupted;
mod live;
mod logs;
mod maps_and_suites;
mod packed;
mod parameters;
mod port;
mod python;
mod report;
mod shards;
