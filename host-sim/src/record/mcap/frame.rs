//! Conversion from north-east-down and forward-right-down to the frames of viewers: east-north-up and
//! forward-left-up. Here and nowhere else.

use std::f64::consts::FRAC_PI_2;

use serde::Serialize;

use crate::world::Pose;

/// East, north, up, with the field names of viewers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(super) struct Enu {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) z: f64,
}

/// A rotation from forward-left-up into east-north-up, as a unit quaternion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Rotation {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

impl Rotation {
    /// No rotation.
    pub(super) const IDENTITY: Self = Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };

    /// The attitude of a body. In forward-left-up, nose up is a negative pitch; yaw is counted from the east, to the
    /// left.
    pub(super) fn of(pose: &Pose) -> Self {
        Self::by(pose.roll_rad, -pose.pitch_rad, FRAC_PI_2 - pose.yaw_rad)
    }

    /// Points x along a bearing, which is counted from the north, clockwise.
    pub(super) fn along_deg(bearing_deg: f64) -> Self {
        Self::by(0.0, 0.0, FRAC_PI_2 - bearing_deg.to_radians())
    }

    /// Yaw, pitch, roll, in this order.
    fn by(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> Self {
        let [(sr, cr), (sp, cp), (sy, cy)] = [roll_rad, pitch_rad, yaw_rad].map(|angle| libm::sincos(0.5 * angle));
        Self {
            x: sr * cp * cy - cr * sp * sy,
            y: cr * sp * cy + sr * cp * sy,
            z: cr * cp * sy - sr * sp * cy,
            w: cr * cp * cy + sr * sp * sy,
        }
    }
}

/// A vector.
pub(super) const fn enu([north, east, down]: [f64; 3]) -> Enu {
    // Zero has no sign.
    Enu { x: east, y: north, z: 0.0 - down }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Rotation {
        /// `q v q*`, written out.
        fn turn(self, [a, b, c]: [f64; 3]) -> [f64; 3] {
            let Self { x, y, z, w } = self;
            [
                (1.0 - 2.0 * (y * y + z * z)) * a + 2.0 * (x * y - w * z) * b + 2.0 * (x * z + w * y) * c,
                2.0 * (x * y + w * z) * a + (1.0 - 2.0 * (x * x + z * z)) * b + 2.0 * (y * z - w * x) * c,
                2.0 * (x * z - w * y) * a + 2.0 * (y * z + w * x) * b + (1.0 - 2.0 * (x * x + y * y)) * c,
            ]
        }
    }

    fn apart(Enu { x, y, z }: Enu, other: [f64; 3]) -> f64 {
        [x - other[0], y - other[1], z - other[2]].into_iter().map(f64::abs).fold(0.0, f64::max)
    }

    #[test]
    fn north_east_and_down_are_y_x_and_minus_z() {
        assert_eq!(enu([1.0, 2.0, -3.0]), Enu { x: 2.0, y: 1.0, z: 3.0 });
    }

    #[test]
    fn the_axes_of_a_vehicle_point_where_those_of_the_simulator_point() {
        for roll_deg in [-170.0, -20.0, 0.0, 35.0] {
            for pitch_deg in [-80.0, 0.0, 15.0] {
                for yaw_deg in [-135.0, 0.0, 90.0, 200.0] {
                    let [roll_rad, pitch_rad, yaw_rad] = [roll_deg, pitch_deg, yaw_deg].map(f64::to_radians);
                    let pose = Pose { roll_rad, pitch_rad, yaw_rad, ..Pose::default() };
                    for [forward, right, down] in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
                        let simulated = enu(pose.to_ned([forward, right, down]));
                        let drawn = Rotation::of(&pose).turn([forward, -right, -down]);
                        assert!(apart(simulated, drawn) < 1e-12, "{pose:?}: {simulated:?}, {drawn:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_bearing_is_counted_from_the_north_clockwise() {
        for (bearing_deg, [x, y]) in [(0.0, [0.0, 1.0]), (90.0, [1.0, 0.0]), (180.0, [0.0, -1.0]), (-90.0, [-1.0, 0.0])]
        {
            let drawn = Rotation::along_deg(bearing_deg).turn([1.0, 0.0, 0.0]);
            assert!(apart(Enu { x, y, z: 0.0 }, drawn) < 1e-12, "{bearing_deg}: {drawn:?}");
        }
    }
}
