//! Our own messages, from the recorder's data: x is east, y is north.

use serde_json::{Value, json};

use super::frame::{Enu, enu};
use crate::record::report::record::{Bearing, Gains, Plan, Step, Track, Tracks, Xy};
use crate::world::vehicle::Motion;

/// A message with the optional fields that have values.
fn with(mut message: Value, fields: &[(&str, Option<f64>)]) -> Value {
    if let Value::Object(object) = &mut message {
        for (name, value) in fields {
            object.extend(value.map(|value| ((*name).to_owned(), Value::from(value))));
        }
    }
    message
}

fn place([east_m, north_m]: Xy) -> Value {
    json!({ "east_m": east_m, "north_m": north_m })
}

fn places(all: &[Xy]) -> Vec<Value> {
    all.iter().copied().map(place).collect()
}

fn circles(all: &[[f64; 3]]) -> Vec<Value> {
    let one =
        |[east_m, north_m, radius_m]: &[f64; 3]| json!({ "east_m": east_m, "north_m": north_m, "radius_m": radius_m });
    all.iter().map(one).collect()
}

fn gains(gains: &Gains) -> Value {
    let Gains { k_att, k_rep, influence_m, swirl } = gains;
    json!({ "k_att": k_att, "k_rep": k_rep, "influence_m": influence_m, "swirl": swirl })
}

pub(super) fn vehicle(motion: &Motion, step: &Step) -> Value {
    let (place, velocity) = (enu(motion.pose.position_ned_m), enu(motion.velocity_ned_mps));
    let Enu { x: east_mps, y: north_mps, z: up_mps } = velocity;
    let message = json!({
        "east_m": place.x, "north_m": place.y, "up_m": place.z,
        "roll_deg": motion.pose.roll_rad.to_degrees(), "pitch_deg": motion.pose.pitch_rad.to_degrees(),
        "yaw_deg": step.yaw_deg, "east_mps": east_mps, "north_mps": north_mps, "up_mps": up_mps,
    });
    with(message, &[("clearance_m", step.clearance_m)])
}

/// `None` where the beacon's position is unknown.
pub(super) fn beacon(step: &Step) -> Option<Value> {
    Some(json!({ "bearing_deg": step.truth_deg?, "range_m": step.truth_m? }))
}

pub(super) fn bearing(heard: &Bearing, truth_deg: Option<f64>) -> Value {
    let Bearing { valid, bearing_deg, sigma_deg, snr_db, flags } = heard;
    let message = json!({ "valid": valid, "flags": flags, "sigma_deg": sigma_deg });
    let error_deg = bearing_deg.zip(truth_deg).map(|(deg, truth_deg)| libm::remainder(deg - truth_deg, 360.0));
    with(message, &[("bearing_deg", *bearing_deg), ("error_deg", error_deg), ("snr_db", *snr_db)])
}

pub(super) fn setpoint(step: &Step) -> Value {
    let [east_mps, north_mps] = step.setpoint_mps;
    json!({
        "east_mps": east_mps, "north_mps": north_mps, "speed_mps": libm::hypot(east_mps, north_mps),
        "yaw_rate_degps": step.yaw_rate_degps,
    })
}

/// Whether it gives way, and with which velocity.
pub(super) fn evader(step: &Step) -> Value {
    let [east_mps, north_mps] = [0, 1].map(|axis| step.evasion_mps.map(|velocity_mps| velocity_mps[axis]));
    with(json!({ "evades": step.evasion_mps.is_some() }), &[("east_mps", east_mps), ("north_mps", north_mps)])
}

pub(super) fn tracks(tracks: &Tracks) -> Value {
    let one = |Track { place_m, velocity_mps, covariance, unseen_s }: &Track| {
        json!({
            "east_m": place_m[0], "north_m": place_m[1], "east_mps": velocity_mps[0], "north_mps": velocity_mps[1],
            "place_m2": covariance[0], "place_velocity_m2ps": covariance[1], "velocity_m2ps2": covariance[2],
            "unseen_s": unseen_s,
        })
    };
    json!({ "tracks": tracks.tracks.iter().map(one).collect::<Vec<_>>() })
}

/// The estimate of the source; `truth` is its true position, if known.
pub(super) fn source(step: &Step, truth: Option<Enu>) -> Value {
    let believed = step.source_m;
    let error_m =
        believed.zip(truth).map(|([east_m, north_m], truth)| libm::hypot(east_m - truth.x, north_m - truth.y));
    let fields = [
        ("followed_deg", step.followed_deg),
        ("east_m", believed.map(|[east_m, _]| east_m)),
        ("north_m", believed.map(|[_, north_m]| north_m)),
        ("sigma_m", step.source_sigma_m),
        ("error_m", error_m),
    ];
    with(json!({}), &fields)
}

pub(super) fn remembered(all: &[[f64; 3]]) -> Value {
    json!({ "circles": circles(all) })
}

pub(super) fn plan(plan: &Plan) -> Value {
    let sample = |sample: &crate::record::report::record::Sample| {
        json!({
            "cost": sample.cost, "feasible": sample.feasible, "gains": gains(&sample.gains),
            "waypoints": places(&sample.waypoints_m),
        })
    };
    let mut message = json!({
        "id": plan.id, "origin": plan.origin, "searches": plan.searches, "start": place(plan.start_m),
        "target": place(plan.target_m), "waypoints": places(&plan.waypoints_m), "gains": gains(&plan.gains),
        "samples": plan.samples.iter().map(sample).collect::<Vec<_>>(), "obstacles": circles(&plan.circles_m),
        "trace": plan.trace,
    });
    if let (Value::Object(object), Some(chosen)) = (&mut message, plan.chosen) {
        object.insert("chosen".to_owned(), chosen.into());
    }
    with(message, &[("cost", plan.cost)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_unknown_is_left_out() {
        let heard = Bearing { valid: true, bearing_deg: Some(10.0), ..Bearing::default() };
        let message = bearing(&heard, None);
        assert_eq!(message, json!({ "valid": true, "flags": [], "sigma_deg": 0.0, "bearing_deg": 10.0 }));
        assert_eq!(bearing(&heard, Some(350.0))["error_deg"], 20.0);

        let step = Step { source_m: Some([3.0, 4.0]), ..Step::default() };
        assert_eq!((beacon(&step), source(&step, None)), (None, json!({ "east_m": 3.0, "north_m": 4.0 })));
        assert_eq!(source(&step, Some(Enu::default()))["error_m"], 5.0);
    }
}
