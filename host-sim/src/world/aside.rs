//! How a person steps aside for the vehicle: a social force after Helbing and Molnar (1995), from the predicted
//! closest approach, and a pull back to the route.

use super::course::Course;
use super::geometry::Horizontal;

/// Prediction time of a person.
const AHEAD_S: f64 = 3.0;
/// The distance that a person keeps from the vehicle's hull.
const ROOM_M: f64 = 0.5;
/// The force at zero distance.
const PUSH_MPS2: f64 = 4.0;
/// Time to return to the route, approximately.
const BACK_S: f64 = 1.0;
/// Largest speed of stepping aside.
const ASIDE_MPS: f64 = 1.2;

/// A person's offset from the route, up to now.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Aside {
    offsets: Course,
    velocity_mps: Horizontal,
}

/// The vehicle relative to the person: the vector from the vehicle, its rate of change, and the sum of the radii.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meeting {
    pub(super) apart_m: Horizontal,
    pub(super) closing_mps: Horizontal,
    pub(super) reach_m: f64,
}

impl Aside {
    /// On the route, at time zero.
    pub(super) fn new() -> Self {
        let mut offsets = Course::default();
        offsets.push(0.0, Horizontal::default());
        Self { offsets, velocity_mps: Horizontal::default() }
    }

    /// The offset at a time, and its rate of change. After the last step it is constant.
    pub(super) fn at(&self, time_s: f64) -> (Horizontal, Horizontal) {
        let now = || (self.offsets.last().unwrap_or_default(), Horizontal::default());
        self.offsets.at(time_s).unwrap_or_else(now)
    }

    /// Simulates to a time.
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

/// Away from the point where the vehicle will be nearest; stronger for a smaller distance and a shorter time.
fn push_mps2(Meeting { apart_m, closing_mps, reach_m }: Meeting) -> Horizontal {
    let square = closing_mps.dot(closing_mps);
    let nearest_s = if square > 1e-9 { (-apart_m.dot(closing_mps) / square).clamp(0.0, AHEAD_S) } else { 0.0 };
    let nearest = apart_m.along(closing_mps, nearest_s);
    let room_m = nearest.norm() - reach_m;
    if room_m >= ROOM_M {
        return Horizontal::default();
    }
    // Head on: to the person's right.
    let away =
        if nearest.norm() > 1e-3 { nearest } else { Horizontal { north: -closing_mps.east, east: closing_mps.north } };
    let norm = away.norm().max(1e-9);
    let strength_mps2 = PUSH_MPS2 * (1.0 - room_m.max(0.0) / ROOM_M) / (1.0 + nearest_s);
    Horizontal::default().along(away, strength_mps2 / norm)
}
