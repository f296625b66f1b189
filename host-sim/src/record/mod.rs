//! Records of a flight for people and their tools: pictures, tables, the report, files for Foxglove.
//!
//! | module | output |
//! |---|---|
//! | [`report`] | one interactive HTML page, or a live page |
//! | [`mcap`] | MCAP files |
//! | [`listening`] | the page of `foxhound listen` |
//! | [`maps`] | the picture of a suite's maps |
//! | [`plot`] | the picture of a flight |
//! | [`table`] | the flights of a suite, as CSV and Parquet |
//! | `sheet` | what all pictures share |

pub mod listening;
pub mod maps;
pub mod mcap;
pub mod plot;
pub mod report;
pub(crate) mod sheet;
pub mod table;
