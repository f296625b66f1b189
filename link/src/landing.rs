//! `LANDING_TARGET` in the form that each autopilot takes.
//!
//! | autopilot | frame | what counts |
//! |---|---|---|
//! | ArduPilot (`AC_PrecLand_Companion`) | `BODY_FRD` | x, y, z over `distance` is the line of sight; `distance` must be positive |
//! | PX4 (`mavlink_receiver`) | `LOCAL_NED` | x, y, z is the target's place in the autopilot's local frame |
//!
//! Both want `position_valid`. Without it ArduPilot takes `angle_x` and `angle_y` for image axes of a camera that looks
//! down, so we do not send that form.

use foxhound_core::frame::Ned;
use foxhound_core::kernel::sqrt;

use crate::autopilot::Software;
use crate::dialect::{LANDING_TARGET_DATA, LandingTargetType, MavFrame};

/// Where a target is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Target {
    /// From the vehicle, forward, right and down, in metres.
    pub(crate) body_frd_m: [f32; 3],
    /// In the autopilot's local frame.
    pub(crate) place_ned_m: Ned,
}

/// The message; `None` for an autopilot that takes none, a target without distance, or numbers that are not finite.
#[inline(never)]
pub(crate) fn message(time_us: u64, software: Software, target: &Target) -> Option<LANDING_TARGET_DATA> {
    let [forward, right, down] = target.body_frd_m;
    let distance_m = sqrt(forward * forward + right * right + down * down);
    // Not finite, too.
    if !(distance_m > 0.01 && distance_m < 1e4 && target.place_ned_m.is_finite()) {
        return None;
    }
    let place = target.place_ned_m;
    let (frame, x, y, z) = match software {
        Software::ArduPilot => (MavFrame::MAV_FRAME_BODY_FRD, forward, right, down),
        Software::Px4 => (MavFrame::MAV_FRAME_LOCAL_NED, place.north, place.east, place.down),
        Software::Other => return None,
    };
    Some(LANDING_TARGET_DATA {
        time_usec: time_us,
        frame: frame as u8,
        distance: distance_m,
        x,
        y,
        z,
        q: [1.0, 0.0, 0.0, 0.0],
        mavtype: LandingTargetType::LANDING_TARGET_TYPE_RADIO_BEACON as u8,
        position_valid: 1,
        ..LANDING_TARGET_DATA::DEFAULT
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TARGET: Target =
        Target { body_frd_m: [2.0, -1.0, 2.0], place_ned_m: Ned { north: 12.0, east: -4.0, down: 0.5 } };

    #[test]
    fn ardupilot_gets_the_line_of_sight_and_px4_the_place() {
        let ardupilot = message(7, Software::ArduPilot, &TARGET).unwrap();
        assert_eq!((ardupilot.frame, ardupilot.position_valid, ardupilot.mavtype, ardupilot.distance), (12, 1, 1, 3.0));
        assert_eq!([ardupilot.x, ardupilot.y, ardupilot.z], TARGET.body_frd_m);
        let px4 = message(7, Software::Px4, &TARGET).unwrap();
        assert_eq!((px4.frame, px4.position_valid, [px4.x, px4.y, px4.z]), (1, 1, [12.0, -4.0, 0.5]));
        assert_eq!(message(7, Software::Other, &TARGET), None);
    }

    #[test]
    fn no_target_is_told_whose_distance_means_nothing() {
        for body_frd_m in [[0.0; 3], [f32::NAN, 0.0, 1.0], [f32::INFINITY, 0.0, 1.0], [1e5, 0.0, 0.0]] {
            assert_eq!(message(7, Software::ArduPilot, &Target { body_frd_m, ..TARGET }), None);
        }
        let place_ned_m = Ned { north: f32::NAN, ..TARGET.place_ned_m };
        assert_eq!(message(7, Software::Px4, &Target { place_ned_m, ..TARGET }), None);
    }
}
