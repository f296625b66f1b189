//! Drawings of the 3-D panel: pillars, the obstacle map, plans, the path, and the state of the moment.
//!
//! An entity replaces the earlier one with its name, and every message of a topic is complete: so the picture is
//! right at any time of the replay.

use base64::prelude::{BASE64_STANDARD, Engine as _};
use serde_json::{Value, json};

use super::frame::{Enu, Rotation};
use crate::record::report::record::{Field, Plan, Step, Tracks, Xy};

/// The frame of the map.
pub(super) const MAP: &str = "map";
/// The frame of the vehicle.
pub(super) const VEHICLE: &str = "vehicle";

/// Red, green, blue, and opacity.
type Color = [f64; 4];

const PILLAR: Color = [0.45, 0.47, 0.50, 0.9];
const BEACON: Color = [0.85, 0.15, 0.15, 1.0];
const HULL: Color = [0.10, 0.10, 0.12, 0.8];
const REMEMBERED: Color = [0.90, 0.55, 0.10, 0.35];
const WAY: Color = [0.10, 0.10, 0.12, 1.0];
const SAMPLE: Color = [0.25, 0.45, 0.80, 0.5];
const REFUSED: Color = [0.60, 0.60, 0.60, 0.4];
const FOLLOWED: Color = [0.05, 0.55, 0.25, 1.0];
const HEARD: Color = [0.55, 0.25, 0.75, 0.9];
const TOLD: Color = [0.05, 0.55, 0.25, 0.9];
const EVADES: Color = [0.95, 0.45, 0.05, 1.0];
const MOVES: Color = [0.95, 0.75, 0.05, 0.35];
const MOVES_TO: Color = [0.95, 0.75, 0.05, 1.0];
const BELIEVED: Color = [0.85, 0.15, 0.15, 0.25];

const BEACON_M: f64 = 0.3;
const TARGET_M: f64 = 0.12;
/// Height of a drawn track, which is two standard deviations wide.
const TRACK_M: f64 = 0.05;
const TRACK_SIGMAS: f64 = 2.0;
const ARROW_M: f64 = 1.0;
const ARROW_WIDTH_M: f64 = 0.03;
const LINE_M: f64 = 0.02;
const FOLLOWED_M: f64 = 0.05;
/// A larger sigma is drawn as this one.
const SIGMA_MAX_M: f64 = 20.0;
/// The raster is a little below the flight, so that it covers nothing.
const GRID_BELOW_M: f64 = 0.3;
/// Bytes of a value of the raster, and Foxglove's name for its type.
const VALUE_BYTES: usize = 4;
const FLOAT32: u8 = 7;

/// A time in Foxglove's fields.
pub(super) fn stamp(time_ns: u64) -> Value {
    json!({ "sec": time_ns / 1_000_000_000, "nsec": time_ns % 1_000_000_000 })
}

pub(super) fn pose(position: Enu, orientation: Rotation) -> Value {
    json!({ "position": position, "orientation": orientation })
}

/// One message with one entity, the only one of its topic.
fn scene(time_ns: u64, id: &str, [arrows, spheres, cylinders, lines]: [Vec<Value>; 4]) -> Value {
    let entity = json!({
        "timestamp": stamp(time_ns), "frame_id": MAP, "id": id, "lifetime": stamp(0), "frame_locked": false,
        "metadata": [], "arrows": arrows, "cubes": [], "spheres": spheres, "cylinders": cylinders, "lines": lines,
        "triangles": [], "texts": [], "models": [],
    });
    json!({ "deletions": [], "entities": [entity] })
}

fn color([r, g, b, a]: Color) -> Value {
    json!({ "r": r, "g": g, "b": b, "a": a })
}

fn at([east_m, north_m]: Xy, up_m: f64) -> Enu {
    Enu { x: east_m, y: north_m, z: up_m }
}

fn sphere(center: Enu, diameter_m: f64, of: Color) -> Value {
    let size = Enu { x: diameter_m, y: diameter_m, z: diameter_m };
    json!({ "pose": pose(center, Rotation::IDENTITY), "size": size, "color": color(of) })
}

/// A cylinder on the ground.
fn cylinder([east_m, north_m, radius_m]: [f64; 3], height_m: f64, of: Color) -> Value {
    let size = Enu { x: 2.0 * radius_m, y: 2.0 * radius_m, z: height_m };
    json!({
        "pose": pose(at([east_m, north_m], 0.5 * height_m), Rotation::IDENTITY),
        "size": size, "bottom_scale": 1.0, "top_scale": 1.0, "color": color(of),
    })
}

fn arrow(from: Enu, bearing_deg: f64, length_m: f64, of: Color) -> Value {
    json!({
        "pose": pose(from, Rotation::along_deg(bearing_deg)),
        "shaft_length": 0.8 * length_m, "shaft_diameter": ARROW_WIDTH_M,
        "head_length": 0.2 * length_m, "head_diameter": 3.0 * ARROW_WIDTH_M, "color": color(of),
    })
}

fn line(points: impl Iterator<Item = Enu>, thickness_m: f64, of: Color) -> Value {
    json!({
        "type": 0, "pose": pose(Enu::default(), Rotation::IDENTITY), "thickness": thickness_m, "scale_invariant": false,
        "points": points.collect::<Vec<_>>(), "color": color(of), "colors": [], "indices": [],
    })
}

/// The truth: pillars, up to the drawn height, and the beacon, if it is known.
pub(super) fn world(time_ns: u64, pillars: &[[f64; 3]], beacon: Option<Enu>, height_m: f64) -> Value {
    let cylinders = pillars.iter().map(|pillar| cylinder(*pillar, height_m, PILLAR)).collect();
    let beacon = beacon.map(|beacon| sphere(beacon, BEACON_M, BEACON)).into_iter().collect();
    scene(time_ns, "world", [Vec::new(), beacon, cylinders, Vec::new()])
}

/// The circles of the obstacle map, a little lower.
pub(super) fn remembered(time_ns: u64, circles: &[[f64; 3]], height_m: f64) -> Value {
    let cylinders = circles.iter().map(|circle| cylinder(*circle, 0.9 * height_m, REMEMBERED)).collect();
    scene(time_ns, "remembered", [Vec::new(), Vec::new(), cylinders, Vec::new()])
}

/// The plan: all samples, and the trajectory that is followed.
pub(super) fn plan(time_ns: u64, plan: &Plan, up_m: f64) -> Value {
    let strip = |waypoints: &[Xy], thickness_m, of| {
        let all = std::iter::once(plan.start_m).chain(waypoints.iter().copied());
        line(all.map(|waypoint| at(waypoint, up_m)), thickness_m, of)
    };
    let samples = plan.samples.iter().map(|sample| {
        let of = if sample.feasible { SAMPLE } else { REFUSED };
        strip(&sample.waypoints_m, LINE_M, of)
    });
    let lines = samples.chain([strip(&plan.waypoints_m, FOLLOWED_M, FOLLOWED)]).collect();
    scene(time_ns, "plan", [Vec::new(), vec![sphere(at(plan.target_m, up_m), TARGET_M, FOLLOWED)], Vec::new(), lines])
}

/// The path flown so far.
pub(super) fn way(time_ns: u64, places: &[Enu]) -> Value {
    let lines = vec![line(places.iter().copied(), LINE_M, WAY)];
    scene(time_ns, "way", [Vec::new(), Vec::new(), Vec::new(), lines])
}

/// An arrow of a metre for 1 m/s; `None` for zero.
fn velocity(from: Enu, [east_mps, north_mps]: Xy, of: Color) -> Option<Value> {
    let speed_mps = libm::hypot(east_mps, north_mps);
    (speed_mps > 0.0).then(|| arrow(from, libm::atan2(east_mps, north_mps).to_degrees(), speed_mps, of))
}

/// The tracked bodies that move: the accuracy of their positions, and their velocities.
pub(super) fn tracks(time_ns: u64, tracks: &Tracks, up_m: f64) -> Value {
    let cylinders = tracks.tracks.iter().map(|track| {
        let sigmas_m = TRACK_SIGMAS * libm::sqrt(track.covariance[0].max(0.0));
        let mut flat = cylinder([track.place_m[0], track.place_m[1], sigmas_m], TRACK_M, MOVES);
        flat["pose"] = pose(at(track.place_m, up_m), Rotation::IDENTITY);
        flat
    });
    let arrows =
        tracks.tracks.iter().filter_map(|track| velocity(at(track.place_m, up_m), track.velocity_mps, MOVES_TO));
    scene(time_ns, "tracks", [arrows.collect(), Vec::new(), cylinders.collect(), Vec::new()])
}

/// The state of the moment: hull, bearing, setpoint, evasion, source, target.
pub(super) fn moment(time_ns: u64, place: Enu, step: &Step, radius_m: f64) -> Value {
    let bearing = step.heard.as_ref().filter(|heard| heard.valid).and_then(|heard| heard.bearing_deg);
    let mut arrows: Vec<Value> = bearing.map(|deg| arrow(place, deg, ARROW_M, HEARD)).into_iter().collect();
    arrows.extend(velocity(place, step.setpoint_mps, TOLD));
    arrows.extend(step.evasion_mps.and_then(|velocity_mps| velocity(place, velocity_mps, EVADES)));
    let mut spheres = vec![sphere(place, 2.0 * radius_m, HULL)];
    spheres.extend(step.target_m.map(|target| sphere(at(target, place.z), TARGET_M, TOLD)));
    if let (Some(source), Some(sigma_m)) = (step.source_m, step.source_sigma_m) {
        spheres.push(sphere(at(source, place.z), 2.0 * sigma_m.clamp(TARGET_M, SIGMA_MAX_M), BELIEVED));
    }
    scene(time_ns, "moment", [arrows, spheres, Vec::new(), Vec::new()])
}

/// The potential around the start of a plan: with the gains of the plan, and with the mean gains.
pub(super) fn potential(time_ns: u64, field: &Field, up_m: f64) -> Value {
    let bytes: Vec<u8> = field
        .followed
        .iter()
        .zip(&field.mean)
        .flat_map(|pair| [pair.0, pair.1])
        .flat_map(|value| (*value as f32).to_le_bytes())
        .collect();
    // A value belongs to the cell around its position.
    let corner = field.south_west_m.map(|metres| metres - 0.5 * field.step_m);
    let cell_stride = 2 * VALUE_BYTES;
    json!({
        "timestamp": stamp(time_ns), "frame_id": MAP,
        "pose": pose(at(corner, up_m - GRID_BELOW_M), Rotation::IDENTITY),
        "column_count": field.columns, "cell_size": { "x": field.step_m, "y": field.step_m },
        "row_stride": cell_stride * field.columns, "cell_stride": cell_stride,
        "fields": [
            { "name": "followed", "offset": 0, "type": FLOAT32 },
            { "name": "mean", "offset": VALUE_BYTES, "type": FLOAT32 },
        ],
        "data": BASE64_STANDARD.encode(&bytes),
    })
}
