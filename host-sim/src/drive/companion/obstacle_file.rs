//! Obstacles from a file, for a simulated sensor.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::scenario::input::InputError;
use crate::scenario::{Obstacle, Scenario, Schema};

#[derive(Deserialize, JsonSchema)]
struct ObstacleFile {
    obstacles: Vec<Cylinder>,
}

#[derive(Deserialize, JsonSchema)]
struct Cylinder {
    x: f64,
    y: f64,
    r: f64,
}

/// Reads an obstacle file: `{"obstacles": [{"x", "y", "r"}]}`, vertical cylinders, x east, y north, metres.
///
/// # Errors
/// The path of the first key that is unknown, missing, of the wrong type or out of range.
pub fn parse_obstacles(text: &str) -> Result<Vec<Obstacle>, InputError> {
    let file: ObstacleFile = Schema::of::<ObstacleFile>("the file").read(text)?;
    let obstacle = |Cylinder { x, y, r }| Obstacle { x, y, r, ..Obstacle::default() };
    let obstacles = file.obstacles.into_iter().map(obstacle).collect();
    Ok(Scenario { obstacles, ..Scenario::default() }.checked()?.obstacles)
}
