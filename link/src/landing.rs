//! The landing messages to the autopilot: where the target is, and the request to land.
//!
//! `LANDING_TARGET` in the form that each autopilot takes:
//!
//! | autopilot | frame | fields used |
//! |---|---|---|
//! | ArduPilot (`AC_PrecLand_Companion`) | `BODY_FRD` | x, y, z over `distance` is the line of sight; `distance` must be positive |
//! | PX4 (`mavlink_receiver`) | `LOCAL_NED` | x, y, z is the target's place in the autopilot's local frame |
//!
//! Both want `position_valid`. Without it ArduPilot takes `angle_x` and `angle_y` for image axes of a camera that looks
//! down, so that form is not sent. The pad seen by a camera has the type `VISION_OTHER`, the beacon `RADIO_BEACON`.
//!
//! `MAV_CMD_NAV_LAND` is sent where the user allows it (`FH_LND_REQ`) and the landing asks for it, a few times, right after
//! a heartbeat that says that the vehicle is in our mode. The autopilot then changes its mode by itself, lands, and disarms; it is never commanded
//! to change a mode.

use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::Ned;
use foxhound_core::base::time::Instant;

use crate::autopilot::Software;
use crate::clock::is_over;
use crate::dialect::{COMMAND_LONG_DATA, LANDING_TARGET_DATA, LandingTargetType, MavCmd, MavFrame};

/// The autopilot's heartbeat, once a second, sets the pace.
const REQUEST_PERIOD_US: u64 = 900_000;
const HEARTBEAT_AGE_MAX_S: f32 = 0.2;
const REQUESTS_MAX: u8 = 5;

/// Asks the autopilot to land.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Request {
    tries: u8,
    due: Instant,
}

impl Request {
    /// Nothing has been requested.
    pub(crate) const fn new() -> Self {
        Self { tries: 0, due: Instant(0) }
    }

    /// The clock may have been set back.
    pub(crate) fn follow_clock(&mut self, now: Instant) {
        self.due = self.due.min(now);
    }

    /// The command, when it is due. Once the autopilot has left our mode or is disarmed, the same landing asks for no other.
    #[inline(never)]
    pub(crate) fn poll(
        &mut self,
        now: Instant,
        wants: bool,
        obeys: bool,
        heard: Instant,
        target: (u8, u8),
    ) -> Option<COMMAND_LONG_DATA> {
        if !wants {
            *self = Self::new();
            return None;
        }
        if !obeys {
            self.tries = REQUESTS_MAX;
            return None;
        }
        // Right after a heartbeat: since an older one the pilot may have taken over, and the command would overrule that.
        if self.tries >= REQUESTS_MAX || now < self.due || is_over(now, heard, HEARTBEAT_AGE_MAX_S) {
            return None;
        }
        let confirmation = self.tries;
        (self.tries, self.due) = (self.tries + 1, now.plus_micros(REQUEST_PERIOD_US));
        Some(COMMAND_LONG_DATA {
            target_system: target.0,
            target_component: target.1,
            command: MavCmd::MAV_CMD_NAV_LAND as u16,
            confirmation,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    }
}

/// Where a target is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Target {
    /// From the vehicle, forward, right and down, in metres.
    pub(crate) body_frd_m: [f32; 3],
    /// In the autopilot's local frame.
    pub(crate) place_ned_m: Ned,
    /// Whether it is the pad, currently seen; else the beacon, currently received.
    pub(crate) is_pad: bool,
}

/// The message; `None` for an autopilot that takes none, a target without distance, or numbers that are not finite.
#[inline(never)]
pub(crate) fn message(time_us: u64, software: Software, target: &Target) -> Option<LANDING_TARGET_DATA> {
    let [forward, right, down] = target.body_frd_m;
    let distance_m = sqrt(forward * forward + right * right + down * down);
    // False also for what is not finite.
    if !(distance_m > 0.01 && distance_m < 1e4 && target.place_ned_m.is_finite()) {
        return None;
    }
    let place = target.place_ned_m;
    let (frame, x, y, z) = match software {
        Software::ArduPilot => (MavFrame::MAV_FRAME_BODY_FRD, forward, right, down),
        Software::Px4 => (MavFrame::MAV_FRAME_LOCAL_NED, place.north, place.east, place.down),
        Software::Other => return None,
    };
    let kind = if target.is_pad {
        LandingTargetType::LANDING_TARGET_TYPE_VISION_OTHER
    } else {
        LandingTargetType::LANDING_TARGET_TYPE_RADIO_BEACON
    };
    Some(LANDING_TARGET_DATA {
        time_usec: time_us,
        frame: frame as u8,
        distance: distance_m,
        x,
        y,
        z,
        q: [1.0, 0.0, 0.0, 0.0],
        mavtype: kind as u8,
        position_valid: 1,
        ..LANDING_TARGET_DATA::DEFAULT
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TARGET: Target =
        Target { body_frd_m: [2.0, -1.0, 2.0], place_ned_m: Ned { north: 12.0, east: -4.0, down: 0.5 }, is_pad: false };

    #[test]
    fn it_is_asked_to_land_five_times_a_second_apart_and_anew_when_it_is_wanted_anew() {
        let mut request = Request::new();
        let mut asked = |from_s: u64, wants: bool| {
            (0..500)
                .filter_map(|k| {
                    let now = Instant(from_s * 1_000_000 + k * 20_000);
                    // A heartbeat a second.
                    request.poll(now, wants, true, Instant(now.0 / 1_000_000 * 1_000_000), (1, 1))
                })
                .map(|command| (command.command, command.confirmation))
                .collect::<std::vec::Vec<_>>()
        };
        assert_eq!(asked(1, false), []);
        let all: std::vec::Vec<_> = (0..5).map(|try_| (21, try_)).collect();
        assert_eq!(asked(11, true), all);
        assert_eq!(asked(21, true), [], "enough is enough");
        assert_eq!(asked(31, false), []);
        assert_eq!(asked(41, true), all);
        // Some time after a heartbeat the pilot may have taken over.
        let (mut request, heard) = (Request::new(), Instant(50_000_000));
        assert_eq!(request.poll(Instant(50_210_000), true, true, heard, (1, 1)), None);
        assert!(request.poll(Instant(50_190_000), true, true, heard, (1, 1)).is_some());
    }

    #[test]
    fn a_pad_is_seen_and_a_beacon_is_heard() {
        for (is_pad, kind) in [(true, 3), (false, 1)] {
            assert_eq!(message(7, Software::Px4, &Target { is_pad, ..TARGET }).unwrap().mavtype, kind);
        }
    }

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
