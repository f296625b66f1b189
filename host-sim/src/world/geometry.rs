//! Positions, directions and attitudes: NED and body forward-right-down, metres, radians, in `f64`.

/// A horizontal vector of the NED frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Horizontal {
    /// To the north.
    pub north: f64,
    /// To the east.
    pub east: f64,
}

impl Horizontal {
    /// From a map's x (east) and y (north).
    #[must_use]
    pub fn from_xy([x, y]: [f64; 2]) -> Self {
        Self { north: y, east: x }
    }

    /// To a map's x (east) and y (north).
    #[must_use]
    pub fn xy(self) -> (f64, f64) {
        (self.east, self.north)
    }

    /// The unit vector along a bearing (from north, clockwise).
    #[must_use]
    pub fn from_bearing(bearing_rad: f64) -> Self {
        Self { north: libm::cos(bearing_rad), east: libm::sin(bearing_rad) }
    }

    /// The bearing of this vector, from north, clockwise.
    #[must_use]
    pub fn bearing_rad(self) -> f64 {
        libm::atan2(self.east, self.north)
    }

    /// `self + direction * length`.
    #[must_use]
    pub fn along(self, direction: Self, length: f64) -> Self {
        Self { north: self.north + direction.north * length, east: self.east + direction.east * length }
    }

    /// Difference.
    #[must_use]
    pub fn minus(self, other: Self) -> Self {
        Self { north: self.north - other.north, east: self.east - other.east }
    }

    /// Inner product.
    #[must_use]
    pub fn dot(self, other: Self) -> f64 {
        self.north * other.north + self.east * other.east
    }

    /// Length.
    #[must_use]
    pub fn norm(self) -> f64 {
        libm::hypot(self.north, self.east)
    }

    /// Into the core's single precision.
    #[must_use]
    pub fn to_core(self) -> foxhound_core::base::ned::Horizontal {
        foxhound_core::base::ned::Horizontal { north: self.north as f32, east: self.east as f32 }
    }
}

/// Wraps an angle to (-pi, pi].
#[must_use]
pub fn wrap_pi(angle_rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let wrapped = libm::remainder(angle_rad, TAU);
    if wrapped <= -PI { wrapped + TAU } else { wrapped }
}

/// Horizontal position of a pose.
#[must_use]
pub fn horizontal(pose: &Pose) -> Horizontal {
    Horizontal { north: pose.position_ned_m[0], east: pose.position_ned_m[1] }
}

/// From the core's single precision.
#[must_use]
pub fn from_core(vector: foxhound_core::base::ned::Horizontal) -> Horizontal {
    Horizontal { north: f64::from(vector.north), east: f64::from(vector.east) }
}

/// Position and attitude of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position, NED, metres.
    pub position_ned_m: [f64; 3],
    /// Roll, right side down positive.
    pub roll_rad: f64,
    /// Pitch, nose up positive.
    pub pitch_rad: f64,
    /// Yaw from north, clockwise positive.
    pub yaw_rad: f64,
}

impl Pose {
    /// Rotates a body vector (forward, right, down) into NED: yaw, pitch, roll in the order of aviation (ZYX).
    #[must_use]
    pub fn to_ned(&self, body: [f64; 3]) -> [f64; 3] {
        let [ned] = self.all_to_ned([body]);
        ned
    }

    /// The same for many: the sines are computed once.
    #[must_use]
    pub fn all_to_ned<const COUNT: usize>(&self, body: [[f64; 3]; COUNT]) -> [[f64; 3]; COUNT] {
        let (sr, cr) = (libm::sin(self.roll_rad), libm::cos(self.roll_rad));
        let (sp, cp) = (libm::sin(self.pitch_rad), libm::cos(self.pitch_rad));
        let (sy, cy) = (libm::sin(self.yaw_rad), libm::cos(self.yaw_rad));
        body.map(|[x, y, z]| {
            let (y, z) = (cr * y - sr * z, sr * y + cr * z);
            let (x, z) = (cp * x + sp * z, cp * z - sp * x);
            [cy * x - sy * y, sy * x + cy * y, z]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn map_axes_are_east_and_north() {
        let point = Horizontal::from_xy([3.0, 4.0]);
        assert_eq!((point.east, point.north), (3.0, 4.0));
        assert!((Horizontal::from_xy([1.0, 0.0]).bearing_rad().to_degrees() - 90.0).abs() < 1e-12);
    }

    #[test]
    fn wrapping_is_half_open() {
        use std::f64::consts::PI;
        assert_eq!(wrap_pi(-PI), PI);
        assert!((wrap_pi(3.5 * PI) + 0.5 * PI).abs() < 1e-12);
    }
}
