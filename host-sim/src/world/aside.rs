//! How a person steps aside for the vehicle: a social force after Helbing and Molnar (1995), of where the two will be nearest,
//! and a pull back to his own way.

use super::course::Course;
use super::geometry::Horizontal;

/// How far ahead he looks.
const AHEAD_S: f64 = 3.0;
/// The distance that a person wants to the vehicle's hull.
const ROOM_M: f64 = 0.5;
/// The force at no distance at all.
const PUSH_MPS2: f64 = 4.0;
/// He is back on his way after about so long.
const BACK_S: f64 = 1.0;
/// Largest speed of stepping aside.
const ASIDE_MPS: f64 = 1.2;

/// How far off his own way he is, up to now.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Aside {
    offsets: Course,
    velocity_mps: Horizontal,
}

/// What he sees of the vehicle: from there to him, how that changes, and the two radii.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meeting {
    pub(super) apart_m: Horizontal,
    pub(super) closing_mps: Horizontal,
    pub(super) reach_m: f64,
}

impl Aside {
    /// On his own way, at time zero.
    pub(super) fn new() -> Self {
        let mut offsets = Course::default();
        offsets.push(0.0, Horizontal::default());
        Self { offsets, velocity_mps: Horizontal::default() }
    }

    /// How far off he is at a time, and how that changes. After the last step he stands where that has taken him.
    pub(super) fn at(&self, time_s: f64) -> (Horizontal, Horizontal) {
        let now = || (self.offsets.last().unwrap_or_default(), Horizontal::default());
        self.offsets.at(time_s).unwrap_or_else(now)
    }

    /// Goes on to a time.
    pub(super) fn step(&mut self, meeting: Option<Meeting>, from_s: f64, until_s: f64) {
        let (dt_s, offset) = (until_s - from_s, self.offsets.last().unwrap_or_default());
        if dt_s <= 0.0 {
            return;
        }
        let push = meeting.map_or(Horizontal::default(), push_mps2);
        // Critically damped.
        let pull =
            Horizontal::default().along(offset, -1.0 / (BACK_S * BACK_S)).along(self.velocity_mps, -2.0 / BACK_S);
        let velocity = self.velocity_mps.along(push, dt_s).along(pull, dt_s);
        let share = (ASIDE_MPS / velocity.norm()).min(1.0);
        self.velocity_mps = Horizontal::default().along(velocity, share);
        self.offsets.push(until_s, offset.along(self.velocity_mps, dt_s));
    }
}

/// Away from where the vehicle will be when it is nearest; stronger the smaller the distance will be, and the sooner.
fn push_mps2(Meeting { apart_m, closing_mps, reach_m }: Meeting) -> Horizontal {
    let square = closing_mps.dot(closing_mps);
    let nearest_s = if square > 1e-9 { (-apart_m.dot(closing_mps) / square).clamp(0.0, AHEAD_S) } else { 0.0 };
    let nearest = apart_m.along(closing_mps, nearest_s);
    let room_m = nearest.norm() - reach_m;
    if room_m >= ROOM_M {
        return Horizontal::default();
    }
    // Head on: to his right.
    let away =
        if nearest.norm() > 1e-3 { nearest } else { Horizontal { north: -closing_mps.east, east: closing_mps.north } };
    let norm = away.norm().max(1e-9);
    let strength_mps2 = PUSH_MPS2 * (1.0 - room_m.max(0.0) / ROOM_M) / (1.0 + nearest_s);
    Horizontal::default().along(away, strength_mps2 / norm)
}
