//! People who do more than to walk straight on, by a seed.

use foxhound_sim::study::seeds;
use foxhound_sim::world::random::Random;
use serde_json::{Value, json};

/// Flights of a scene.
pub(super) const FLIGHTS: u64 = 20;
const PURPOSE: u64 = 25;

/// A scene: its name, and who walks in it.
pub(super) type Scene = (&'static str, fn(&mut Random) -> Vec<Value>);

pub(super) const SCENES: [Scene; 8] = [
    ("crossing", crossing),
    ("swaying", swaying),
    ("stopping", stopping),
    ("turning", turning),
    ("in groups", groups),
    ("overtaking", overtaking),
    (CORRIDOR, streams),
    ("stepping aside", stepping_aside),
];

/// The scene between two rows of pillars that leave no gap.
const CORRIDOR: &str = "two streams in a corridor of 4 m";

/// The flights of a scene: 13 m to the east.
pub(super) fn worlds((name, scene): Scene) -> Vec<Value> {
    let walls = |x: i32| [-2.2, 2.2].map(|y| json!({"x": 0.4 * f64::from(x), "y": y, "r": 0.2}));
    let obstacles: Vec<Value> = if name == CORRIDOR { (-4..=38).flat_map(walls).collect() } else { Vec::new() };
    let world = |seed: u64| {
        let people = scene(&mut Random::new(seed, PURPOSE));
        json!({"start": [0, 0], "goal": [13, 0], "bounds": [-3, -5, 16, 5], "people": people, "obstacles": obstacles,
            "max_time_s": 60})
    };
    seeds::test(FLIGHTS).map(world).collect()
}

/// As fast as people at a station: median 1.67 m/s, a tenth above 1.82 m/s.
fn speed(random: &mut Random) -> f64 {
    (1.67 + 0.12 * random.gaussian()).clamp(1.2, 2.2)
}

fn between(random: &mut Random, low: f64, high: f64) -> f64 {
    low + (high - low) * random.uniform()
}

/// Somebody who heads there and would meet a vehicle that flies straight on after so long; `None` where he would start beside it.
fn who_meets(random: &mut Random, met_s: f64, heading_deg: f64, more: &Value) -> Option<Value> {
    let (speed, heading_rad) = (speed(random), heading_deg.to_radians());
    let met_x = met_s + between(random, -0.5, 0.5);
    let place = [met_x - speed * met_s * heading_rad.sin(), -speed * met_s * heading_rad.cos()];
    let mut person = json!({"route": [place], "heading_deg": heading_deg, "speed": speed});
    let more = more.as_object()?.clone();
    person.as_object_mut()?.extend(more);
    // Farther than where a group of four reaches to.
    (place[0].hypot(place[1]) > 3.0).then_some(person)
}

/// Ten, a second apart; they head anywhere, or up to so far off north and south.
fn ten(random: &mut Random, off_deg: f64, more: impl Fn(&mut Random) -> Value) -> Vec<Value> {
    let one = |k| {
        let side_deg = if random.uniform() < 0.5 { 0.0 } else { 180.0 };
        let heading_deg = side_deg + between(random, -off_deg, off_deg);
        let more = more(random);
        who_meets(random, 2.0 + f64::from(k), heading_deg, &more)
    };
    (0..10).filter_map(one).collect()
}

fn crossing(random: &mut Random) -> Vec<Value> {
    ten(random, 30.0, |_| json!({}))
}

fn swaying(random: &mut Random) -> Vec<Value> {
    ten(random, 90.0, |random| json!({"sway_m": 0.3, "sway_s": between(random, 3.0, 6.0)}))
}

fn stopping(random: &mut Random) -> Vec<Value> {
    ten(random, 90.0, |_| json!({"stop_every_s": 4, "stop_s": 2}))
}

fn turning(random: &mut Random) -> Vec<Value> {
    ten(random, 90.0, |_| json!({"turn_every_s": 4, "turn_deg": 60}))
}

fn groups(random: &mut Random) -> Vec<Value> {
    let one = |k| {
        let (heading_deg, group) = (360.0 * random.uniform(), 2 + (3.0 * random.uniform()) as u32);
        who_meets(random, 3.0 + 2.0 * f64::from(k), heading_deg, &json!({"group": group}))
    };
    (0..5).filter_map(one).collect()
}

/// Eight come from behind, faster.
fn overtaking(random: &mut Random) -> Vec<Value> {
    let one = |k| {
        let heading_deg = 90.0 + between(random, -20.0, 20.0);
        who_meets(random, 5.0 + f64::from(k), heading_deg, &json!({}))
    };
    (0..8).filter_map(one).collect()
}

/// Six to the east on the right, six to the west on the left.
fn streams(random: &mut Random) -> Vec<Value> {
    let one = |k| {
        let (is_east, behind_m) = (k % 2 == 0, between(random, 2.0, 4.0) * f64::from(k / 2));
        let y = between(random, 0.2, 1.8);
        let (place, heading_deg) = if is_east { ([-3.0 - behind_m, -y], 90.0) } else { ([8.0 + behind_m, y], -90.0) };
        json!({"route": [place], "heading_deg": heading_deg, "speed": speed(random), "sway_m": 0.05, "sway_s": 1.2})
    };
    (0..12).map(one).collect()
}

fn stepping_aside(random: &mut Random) -> Vec<Value> {
    ten(random, 90.0, |_| json!({"steps_aside": true}))
}

/// Five pillars that swing to and fro across the way, each as far as it swings: who goes straight on meets some.
pub(super) fn swinging() -> Vec<Value> {
    let world = |seed: u64| {
        let mut random = Random::new(seed, PURPOSE);
        let pillar = |k: u32| {
            let (speed, turns_s) = (between(&mut random, 0.3, 0.6), between(&mut random, 3.0, 6.0));
            let toward = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            let middle = between(&mut random, -0.5, 0.5);
            json!({"x": 2.5 + 2.0 * f64::from(k), "y": middle - 0.5 * toward * speed * turns_s, "r": 0.3, "vx": 0,
                "vy": toward * speed, "turns_s": turns_s})
        };
        let pillars: Vec<Value> = (0..5).map(pillar).collect();
        json!({"start": [0, 0], "goal": [13, 0], "bounds": [-3, -5, 16, 5], "obstacles": pillars, "max_time_s": 90})
    };
    seeds::test(FLIGHTS).map(world).collect()
}

/// Six pillars that cross the way slowly, from either side.
pub(super) fn slow() -> Vec<Value> {
    let world = |seed: u64| {
        let mut random = Random::new(seed, PURPOSE);
        let pillar = |k: u32| {
            let side = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            let (x, y) = (between(&mut random, 2.0, 11.0), side * between(&mut random, 1.0, 4.0));
            let (along, across) = (between(&mut random, -1.5, 1.5), between(&mut random, -1.0, 1.0) - y);
            let by = between(&mut random, 0.2, 0.6) / along.hypot(across);
            json!({"x": x, "y": y, "r": 0.3, "vx": by * along, "vy": by * across})
        };
        let pillars: Vec<Value> = (0..6).map(pillar).collect();
        json!({"start": [0, 0], "goal": [13, 0], "bounds": [-5, -8, 18, 8], "obstacles": pillars, "max_time_s": 90})
    };
    seeds::test(FLIGHTS).map(world).collect()
}
