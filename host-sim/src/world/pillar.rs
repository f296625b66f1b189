//! A vertical pillar, standing or moving.

use super::geometry::Horizontal;

/// A vertical pillar at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pillar {
    /// Its axis.
    pub center: Horizontal,
    /// Its radius.
    pub radius_m: f64,
    /// Its velocity.
    pub velocity_mps: Horizontal,
    /// It reverses after this many seconds, again and again; zero: never.
    pub turns_s: f64,
}

impl Pillar {
    /// The same pillar later.
    pub(super) fn after(self, time_s: f64) -> Self {
        if self.turns_s <= 0.0 {
            return Self { center: self.center.along(self.velocity_mps, time_s), ..self };
        }
        let legs = libm::floor(time_s / self.turns_s);
        let since_s = time_s - legs * self.turns_s;
        if legs % 2.0 == 0.0 {
            Self { center: self.center.along(self.velocity_mps, since_s), ..self }
        } else {
            let center = self.center.along(self.velocity_mps, self.turns_s - since_s);
            Self { center, velocity_mps: Horizontal::default().minus(self.velocity_mps), ..self }
        }
    }
}
