//! A path in time: positions at given times, and straight motion in between.

use super::geometry::Horizontal;

/// Positions in the order of their times.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Course {
    points: Vec<(f64, Horizontal)>,
}

impl Course {
    /// Adds a position, after all others.
    pub(super) fn push(&mut self, time_s: f64, place: Horizontal) {
        self.points.push((time_s, place));
    }

    /// The last position.
    pub(super) fn last(&self) -> Option<Horizontal> {
        self.points.last().map(|(_, place)| *place)
    }

    /// Position and velocity at a time; `None` before the first and after the last position.
    pub(super) fn at(&self, time_s: f64) -> Option<(Horizontal, Horizontal)> {
        let later = self.points.partition_point(|(at_s, _)| *at_s <= time_s);
        let is_last = self.points.last().is_some_and(|(at_s, _)| *at_s == time_s);
        let next = if is_last { later.checked_sub(1)? } else { later };
        let ((from_s, from), (to_s, to)) = (*self.points.get(next.checked_sub(1)?)?, *self.points.get(next)?);
        let way = to.minus(from);
        let velocity = Horizontal::default().along(way, 1.0 / (to_s - from_s));
        Some((from.along(way, (time_s - from_s) / (to_s - from_s)), velocity))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(east: f64, north: f64) -> Horizontal {
        Horizontal { north, east }
    }

    #[test]
    fn in_between_it_goes_straight_on_and_beyond_its_ends_it_is_nowhere() {
        let mut course = Course::default();
        assert_eq!(course.at(0.0), None);
        for (time_s, place) in [(1.0, at(0.0, 0.0)), (2.0, at(2.0, 0.0)), (4.0, at(2.0, -1.0))] {
            course.push(time_s, place);
        }
        assert_eq!(course.at(0.99), None);
        assert_eq!(course.at(1.0), Some((at(0.0, 0.0), at(2.0, 0.0))));
        assert_eq!(course.at(1.25), Some((at(0.5, 0.0), at(2.0, 0.0))));
        assert_eq!(course.at(2.0), Some((at(2.0, 0.0), at(0.0, -0.5))));
        assert_eq!(course.at(4.0), Some((at(2.0, -1.0), at(0.0, -0.5))));
        assert_eq!(course.at(4.01), None);
    }
}
