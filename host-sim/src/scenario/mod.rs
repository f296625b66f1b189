//! Input files of a flight: scenario files and parameters, read strictly and checked.
//!
//! | module | content |
//! |---|---|
//! | `file` | the scenario file, with its parts in `disturbed`, `landing`, `people` and `random` |
//! | `tracks` | the file of tracks of real people that a scenario may name |
//! | `schema` | JSON schemas of the files, by which they are read |
//! | [`params`] | parameters of the flight computer |
//! | [`input`] | reading any input, and errors about it |
//! | [`output`] | writing any result, complete or not at all |

mod disturbed;
mod file;
pub mod input;
mod landing;
pub mod output;
pub mod params;
mod people;
mod random;
mod schema;
mod tracks;

/// Length of one step of a flight.
pub const TICK_S: f64 = 0.02;

pub use disturbed::{OtherBeacon, Position, Pulses, Wind};
pub use file::{
    Antenna, Bearing, BearingModel, FLIGHT_DOWN_M, Faults, Limits, Obstacle, Outlier, Scenario, Sensor, SensorModel,
    Software, Vehicle, VehicleModel, Wall, inside, schema,
};
pub use landing::{Camera, Landing};
pub use people::Person;
pub use random::RandomPillars;
pub(crate) use schema::Schema;
