//! The obstacle map as one `OBSTACLE_DISTANCE`, for other components of the vehicle.
//!
//! 72 sectors of 5 degrees from the nose, `BODY_FRD`; a sector holds the nearest circle that reaches into it. A sector
//! without a circle is unknown, not free: the map does not say where the sensor has not looked.

use core::f32::consts::PI;

use foxhound_core::base::math::sqrt;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::ownship::Ownship;
use foxhound_core::base::units::wrap_pi;

use crate::dialect::{MavDistanceSensor, MavFrame, OBSTACLE_DISTANCE_DATA};

const SECTORS: usize = 72;
const STEP_RAD: f32 = 2.0 * PI / SECTORS as f32;
const RANGE_CM: u16 = 2_000;

/// The message, from circles in the frame of the vehicle's own position.
#[inline(never)]
pub(crate) fn message(
    time_us: u64,
    ownship: &Ownship,
    circles: &mut dyn Iterator<Item = Circle>,
) -> OBSTACLE_DISTANCE_DATA {
    let mut distances = [u16::MAX; SECTORS];
    let here = ownship.position_ned_m.horizontal();
    for circle in circles {
        let off = circle.center_ned_m.minus(here);
        let range_m = off.norm();
        let azimuth_rad = wrap_pi(libm::atan2f(off.east, off.north) - ownship.yaw_rad);
        // Half of the angle that it covers; all round for one that the vehicle is in.
        let half_rad = if range_m > circle.radius_m {
            libm::atan2f(circle.radius_m, sqrt(range_m * range_m - circle.radius_m * circle.radius_m))
        } else {
            PI
        };
        // To its boundary. A cast from float to integer saturates. ArduPilot ignores a distance of 0.
        let distance_cm = (((range_m - circle.radius_m) * 100.0) as u16).max(1);
        if distance_cm > RANGE_CM {
            continue;
        }
        for (sector, distance) in distances.iter_mut().enumerate() {
            let off_rad = libm::fabsf(wrap_pi(sector as f32 * STEP_RAD - azimuth_rad));
            if off_rad <= half_rad + 0.5 * STEP_RAD {
                *distance = (*distance).min(distance_cm);
            }
        }
    }
    OBSTACLE_DISTANCE_DATA {
        time_usec: time_us,
        distances,
        min_distance: 0,
        max_distance: RANGE_CM,
        sensor_type: MavDistanceSensor::MAV_DISTANCE_SENSOR_UNKNOWN as u8,
        increment: 5,
        frame: MavFrame::MAV_FRAME_BODY_FRD as u8,
        ..OBSTACLE_DISTANCE_DATA::DEFAULT
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::base::ned::{Horizontal, Ned};

    fn circle(north: f32, east: f32, radius_m: f32) -> Circle {
        Circle { center_ned_m: Horizontal { north, east }, radius_m, velocity_ned_mps: Horizontal::default() }
    }

    #[test]
    fn circles_are_seen_from_the_nose_clockwise_and_what_nobody_saw_is_unknown() {
        let ownship = Ownship {
            position_ned_m: Ned { north: 10.0, east: 5.0, down: -3.0 },
            yaw_rad: PI / 2.0,
            ..Ownship::default()
        };
        // Ahead (east) at 4 m, right (south) at 2 m behind a nearer one, and one that is too far.
        let circles = [circle(10.0, 10.0, 1.0), circle(7.0, 5.0, 0.5), circle(8.0, 5.0, 0.5), circle(10.0, -30.0, 1.0)];
        let message = message(3, &ownship, &mut circles.into_iter());
        assert_eq!((message.frame, message.increment, message.angle_offset), (12, 5, 0.0));
        let near = |sector: usize, cm: u16| message.distances[sector].abs_diff(cm) <= 1;
        assert!(near(0, 400) && near(71, 400) && near(2, 400), "{:?}", message.distances);
        assert!(near(18, 150), "the nearer one");
        assert_eq!(message.distances[36], u16::MAX);
        assert_eq!(message.distances.iter().filter(|cm| **cm != u16::MAX).count(), 5 + 7);
    }

    #[test]
    fn who_stands_in_a_circle_is_touched_all_round() {
        let message = message(3, &Ownship::default(), &mut [circle(0.1, 0.0, 1.0)].into_iter());
        assert!(message.distances.iter().all(|cm| *cm == 1));
    }
}
