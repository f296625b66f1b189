//! One person of a world: the position at a time, with the offset of one who gives way.

use super::aside::Aside;
use super::course::Course;
use super::pillar::Pillar;

/// One person.
#[derive(Clone, Debug, PartialEq)]
pub struct Person {
    pub(super) course: Course,
    pub(super) radius_m: f64,
    pub(super) aside: Option<Aside>,
}

impl Person {
    /// The person as a pillar at a time; `None` before and after the walk.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<Pillar> {
        let (place, velocity) = self.course.at(time_s)?;
        let (offset, aside_mps) = self.aside.as_ref().map_or_else(Default::default, |aside| aside.at(time_s));
        Some(Pillar {
            center: place.along(offset, 1.0),
            radius_m: self.radius_m,
            velocity_mps: velocity.along(aside_mps, 1.0),
            turns_s: 0.0,
        })
    }
}
