//! JSON Schemas of the messages: Foxglove's own messages, as far as they are used, and ours.
//!
//! Foxglove identifies its messages by name. The fields are those of <https://docs.foxglove.dev/docs/sdk/schemas>;
//! `tests/cli/logs.rs` compares each with the definitions that Foxglove publishes. A schema is exact: it has all
//! fields, with optional ones marked, and no others.

use serde_json::{Map, Value, json};

/// A schema of an object; a name that ends in `?` is that of an optional field.
fn object(title: &str, fields: &[(&str, Value)]) -> Value {
    let properties: Map<String, Value> =
        fields.iter().map(|(name, of)| (name.trim_end_matches('?').to_owned(), of.clone())).collect();
    let required: Vec<&str> = fields.iter().map(|(name, _)| *name).filter(|name| !name.ends_with('?')).collect();
    json!({
        "title": title,
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    })
}

fn number(what: &str) -> Value {
    json!({ "type": "number", "description": what })
}

fn whole(what: &str) -> Value {
    json!({ "type": "integer", "description": what })
}

fn text(what: &str) -> Value {
    json!({ "type": "string", "description": what })
}

fn flag(what: &str) -> Value {
    json!({ "type": "boolean", "description": what })
}

fn list(of: &Value) -> Value {
    json!({ "type": "array", "items": of })
}

/// An array that is always empty.
fn none() -> Value {
    json!({ "type": "array", "items": { "type": "object" }, "maxItems": 0 })
}

/// A time, or a duration.
fn time(title: &str) -> Value {
    let nsec = json!({ "type": "integer", "minimum": 0, "maximum": 999_999_999 });
    let sec = json!({ "type": "integer", "minimum": 0 });
    json!({ "type": "object", "title": title, "properties": { "sec": sec, "nsec": nsec }, "required": ["sec", "nsec"] })
}

fn vector(title: &str, axes: &[&str]) -> Value {
    let fields: Vec<(&str, Value)> = axes.iter().map(|axis| (*axis, number(""))).collect();
    object(title, &fields)
}

fn vector3() -> Value {
    vector("foxglove.Vector3", &["x", "y", "z"])
}

fn quaternion() -> Value {
    vector("foxglove.Quaternion", &["x", "y", "z", "w"])
}

fn color() -> Value {
    vector("foxglove.Color", &["r", "g", "b", "a"])
}

fn pose() -> Value {
    object("foxglove.Pose", &[("position", vector3()), ("orientation", quaternion())])
}

pub(super) fn frame_transform() -> Value {
    object(
        "foxglove.FrameTransform",
        &[
            ("timestamp", time("time")),
            ("parent_frame_id", text("The frame of the map.")),
            ("child_frame_id", text("The frame of the vehicle.")),
            ("translation", vector3()),
            ("rotation", quaternion()),
        ],
    )
}

pub(super) fn pose_in_frame() -> Value {
    object("foxglove.PoseInFrame", &[("timestamp", time("time")), ("frame_id", text("")), ("pose", pose())])
}

pub(super) fn log() -> Value {
    object(
        "foxglove.Log",
        &[
            ("timestamp", time("time")),
            ("level", whole("2: information; 3: a warning; 4: an error.")),
            ("message", text("In words.")),
            ("name", text("Name of the source.")),
            ("file", text("")),
            ("line", whole("")),
        ],
    )
}

pub(super) fn grid() -> Value {
    let field = object(
        "foxglove.PackedElementField",
        &[("name", text("")), ("offset", whole("")), ("type", whole("7: single precision."))],
    );
    let data = json!({ "type": "string", "contentEncoding": "base64" });
    object(
        "foxglove.Grid",
        &[
            ("timestamp", time("time")),
            ("frame_id", text("")),
            ("pose", pose()),
            ("column_count", whole("")),
            ("cell_size", vector("foxglove.Vector2", &["x", "y"])),
            ("row_stride", whole("")),
            ("cell_stride", whole("")),
            ("fields", list(&field)),
            ("data", data),
        ],
    )
}

pub(super) fn scene_update() -> Value {
    let arrow = object(
        "foxglove.ArrowPrimitive",
        &[
            ("pose", pose()),
            ("shaft_length", number("")),
            ("shaft_diameter", number("")),
            ("head_length", number("")),
            ("head_diameter", number("")),
            ("color", color()),
        ],
    );
    let sphere = object("foxglove.SpherePrimitive", &[("pose", pose()), ("size", vector3()), ("color", color())]);
    let cylinder = object(
        "foxglove.CylinderPrimitive",
        &[
            ("pose", pose()),
            ("size", vector3()),
            ("bottom_scale", number("")),
            ("top_scale", number("")),
            ("color", color()),
        ],
    );
    let line = object(
        "foxglove.LinePrimitive",
        &[
            ("type", whole("0: a strip; 2: pairs of points.")),
            ("pose", pose()),
            ("thickness", number("")),
            ("scale_invariant", flag("")),
            ("points", list(&vector("foxglove.Point3", &["x", "y", "z"]))),
            ("color", color()),
            ("colors", list(&color())),
            ("indices", list(&whole(""))),
        ],
    );
    let pair = object("foxglove.KeyValuePair", &[("key", text("")), ("value", text(""))]);
    let entity = object(
        "foxglove.SceneEntity",
        &[
            ("timestamp", time("time")),
            ("frame_id", text("")),
            ("id", text("A later one with the same name replaces it.")),
            ("lifetime", time("duration")),
            ("frame_locked", flag("")),
            ("metadata", list(&pair)),
            ("arrows", list(&arrow)),
            ("cubes", none()),
            ("spheres", list(&sphere)),
            ("cylinders", list(&cylinder)),
            ("lines", list(&line)),
            ("triangles", none()),
            ("texts", none()),
            ("models", none()),
        ],
    );
    object("foxglove.SceneUpdate", &[("deletions", none()), ("entities", list(&entity))])
}

pub(super) fn vehicle() -> Value {
    object(
        "foxhound.Vehicle",
        &[
            ("east_m", number("True position; with a real autopilot, the reported one.")),
            ("north_m", number("")),
            ("up_m", number("")),
            ("roll_deg", number("Right side down positive.")),
            ("pitch_deg", number("Nose up positive.")),
            ("yaw_deg", number("From north, clockwise.")),
            ("east_mps", number("True velocity.")),
            ("north_mps", number("")),
            ("up_mps", number("")),
            ("clearance_m?", number("From the hull to the nearest pillar; missing in a world without pillars.")),
        ],
    )
}

pub(super) fn beacon() -> Value {
    object(
        "foxhound.Beacon",
        &[
            ("bearing_deg", number("True bearing from the vehicle: from north, clockwise.")),
            ("range_m", number("True distance.")),
        ],
    )
}

pub(super) fn bearing() -> Value {
    object(
        "foxhound.Bearing",
        &[
            ("valid", flag("Whether it may be used.")),
            ("bearing_deg?", number("From north, clockwise; missing without a valid attitude.")),
            (
                "error_deg?",
                number("The bearing minus the true one, within half a turn; missing where that is unknown."),
            ),
            ("sigma_deg", number("Its estimated standard deviation.")),
            ("snr_db?", number("Signal-to-noise ratio; missing from a radio that does not tell it.")),
            ("flags", list(&text("Its flags."))),
        ],
    )
}

pub(super) fn setpoint() -> Value {
    object(
        "foxhound.Setpoint",
        &[
            ("east_mps", number("Commanded velocity.")),
            ("north_mps", number("")),
            ("speed_mps", number("")),
            ("yaw_rate_degps", number("Clockwise.")),
        ],
    )
}

pub(super) fn outcome() -> Value {
    object(
        "foxhound.Outcome",
        &[("outcome", text("Outcome of the step; core/src/guidance/mission.rs lists the behaviour."))],
    )
}

pub(super) fn guard() -> Value {
    object("foxhound.Guard", &[("action", text("passed, limited, looking or braked."))])
}

pub(super) fn evader() -> Value {
    object(
        "foxhound.Evader",
        &[
            ("evades", flag("Whether it gives way to moving obstacles.")),
            ("east_mps?", number("The velocity for that, before the guard; missing if it does not.")),
            ("north_mps?", number("")),
        ],
    )
}

pub(super) fn source() -> Value {
    object(
        "foxhound.Source",
        &[
            ("followed_deg?", number("The bearing that is followed: from north, clockwise.")),
            ("east_m?", number("Estimated position of the source.")),
            ("north_m?", number("")),
            ("sigma_m?", number("Its standard deviation.")),
            ("error_m?", number("Distance from the estimate to the true position, if that is known.")),
        ],
    )
}

pub(super) fn remembered() -> Value {
    object("foxhound.Remembered", &[("circles", list(&circle()))])
}

pub(super) fn tracks() -> Value {
    let track = object(
        "foxhound.Track",
        &[
            ("east_m", number("Estimated position.")),
            ("north_m", number("")),
            ("east_mps", number("Estimated velocity.")),
            ("north_mps", number("")),
            ("place_m2", number("Covariance of position and position, the same along both axes.")),
            ("place_velocity_m2ps", number("Of position and velocity.")),
            ("velocity_m2ps2", number("Of velocity and velocity.")),
            ("unseen_s", number("Time since it was last seen.")),
        ],
    );
    object("foxhound.Tracks", &[("tracks", list(&track))])
}

pub(super) fn plan() -> Value {
    let sample = object(
        "foxhound.Sample",
        &[
            ("cost", number("Its cost (eq. 41).")),
            ("feasible", flag("Whether it may be chosen.")),
            ("gains", gains()),
            ("waypoints", list(&place())),
        ],
    );
    object(
        "foxhound.Plan",
        &[
            ("id", whole("Counts the requests.")),
            ("origin", text("How it was made: sampled, straight, bent, initial or brake.")),
            ("searches", flag("Whether it searches for the signal.")),
            ("start", place()),
            ("target", place()),
            ("waypoints", list(&place())),
            ("cost?", number("Its cost (eq. 41).")),
            ("gains", gains()),
            ("samples", list(&sample)),
            ("chosen?", whole("Which of them is followed.")),
            ("obstacles", list(&circle())),
            ("trace", text("Hash over everything so far.")),
        ],
    )
}

fn place() -> Value {
    object("foxhound.Place", &[("east_m", number("")), ("north_m", number(""))])
}

fn circle() -> Value {
    object("foxhound.Circle", &[("east_m", number("")), ("north_m", number("")), ("radius_m", number(""))])
}

fn gains() -> Value {
    object(
        "foxhound.Gains",
        &[
            ("k_att", number("Attraction.")),
            ("k_rep", number("Repulsion.")),
            ("influence_m", number("Influence range.")),
            ("swirl", number("Share of the repulsion that acts sideways.")),
        ],
    )
}
