//! Obstacles from a file, for a simulated sensor.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::scenario::input::{InputError, parse_strictly};
use crate::scenario::{Obstacle, Scenario};

#[derive(Default, Deserialize, Serialize)]
struct ObstacleFile {
    obstacles: Vec<Cylinder>,
}

#[derive(Deserialize, Serialize)]
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
    // A derived reader would accept a list as an object; text that is not JSON is refused below, with its position.
    if let Ok(value) = serde_json::from_str::<Value>(text) {
        let entries = value.get("obstacles").and_then(Value::as_array).into_iter().flatten().enumerate();
        let mut places = entries.map(|(index, entry)| (format!("obstacles[{index}]"), entry));
        let first = Some(("the file".to_owned(), &value));
        if let Some((path, _)) = first.into_iter().chain(&mut places).find(|(_, value)| !value.is_object()) {
            return Err(InputError::new(format!("{path}: expected an object {{...}}")));
        }
    }
    let known = ["obstacles", "obstacles[].x", "obstacles[].y", "obstacles[].r"];
    let mut document = serde_json::Deserializer::from_str(text);
    let file: ObstacleFile = parse_strictly(&mut document, &known)?;
    document.end().map_err(|error| InputError::new(error.to_string()))?;
    let obstacle = |Cylinder { x, y, r }| Obstacle { x, y, r, ..Obstacle::default() };
    let obstacles = file.obstacles.into_iter().map(obstacle).collect();
    Ok(Scenario { obstacles, ..Scenario::default() }.checked()?.obstacles)
}
