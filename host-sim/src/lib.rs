//! # Foxhound simulator
//!
//! The world around the core: antennas, pillars, a vehicle and an autopilot that speaks MAVLink. A flight steps the same
//! two functions that the firmware steps, over the same bytes, so a simulated flight and one in QEMU agree bit for bit.
//!
//! ```text
//!  scenario -> world -> antennas --codes--> computer <--MAVLink--> autopilot -> vehicle -> world
//!                    `-> sensor --OBSTACLE_DISTANCE--^
//! ```
//!
//! Each folder imports the ones below it only; `tests/proof/floors.rs` holds that. From the top:
//!
//! | folder | what it is for | imports |
//! |---|---|---|
//! | `cli` | the command line, `foxhound` | all |
//! | [`study`] | what many flights come to: the papers' experiments, campaigns | `record`, `drive`, `world`, `scenario` |
//! | [`record`] | pictures, tables, reports of flights | `drive`, `world`, `scenario` |
//! | [`drive`] | flight computers, and the loops that fly them | `autopilot`, `world`, `scenario` |
//! | [`tools`] | bearings from recorded frames and from radios that run, calibration | `autopilot`, `world`, `scenario` |
//! | [`autopilot`] | models of ArduPilot and PX4, the line to them | `world`, `scenario` |
//! | [`world`] | what is physically there, and what sensors make of it | `scenario` |
//! | [`scenario`] | what users write down: scenario files, parameters | |

pub mod autopilot;
pub mod drive;
pub mod record;
pub mod scenario;
pub mod study;
pub mod tools;
pub mod world;
