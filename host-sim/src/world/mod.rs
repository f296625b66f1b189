//! The physical world: a beacon, pillars, walls and people, the vehicle in the wind, and the measurements of its
//! antennas, its obstacle sensor and its camera.
//!
//! | module | what it simulates |
//! |---|---|
//! | `geometry` | positions, directions and attitudes |
//! | `pillar`, `truth` | a pillar; the beacon, the pillars, and which clearance counts as a collision |
//! | `draw` | random pillars, by the seed |
//! | `person`, `people` | people: `walk` is the route, `aside` how a person gives way, `course` either in time |
//! | [`rays`] | radio paths among walls |
//! | [`antennas`], [`iq`] | the samples of the four channels; those that a Bluetooth controller reports |
//! | [`air`] | the wind |
//! | [`vehicle`] | the motion that follows from commands: `shaping`, `yaw` and [`deviation`] are the autopilot's part of it |
//! | [`sensor`] | the obstacle sensor |
//! | [`camera`], [`camera_line`] | the camera that looks down, and its frames on a serial line |
//! | [`random`] | seeded random numbers, one generator a purpose |

pub mod air;
pub mod antennas;
mod aside;
pub mod camera;
pub mod camera_line;
mod course;
pub mod deviation;
mod draw;
mod geometry;
pub mod iq;
pub mod lidar;
mod people;
mod person;
mod pillar;
pub mod random;
pub mod ranging;
pub mod rays;
pub mod sensor;
mod shaping;
mod truth;
pub mod vehicle;
mod walk;
mod yaw;

pub use geometry::{Horizontal, Pose, from_core, horizontal, wrap_pi};
pub use person::Person;
pub use pillar::Pillar;
pub use truth::{Hull, World};
