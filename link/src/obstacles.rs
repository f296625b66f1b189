//! Reads `OBSTACLE_DISTANCE` as a scan in the body frame, `OBSTACLE_DISTANCE_3D` and single `DISTANCE_SENSOR` beams as
//! points in it.
//!
//! ## Scans
//!
//! Element `j` is the middle of the sector at `angle_offset + j * increment`, clockwise positive; `increment_f`
//! replaces `increment` unless it is 0, and may be negative. Elements past a full turn are ignored. This follows the
//! message definition and ArduPilot's reading of it (`AP_Proximity_MAV`).
//!
//! | distance | means |
//! |---|---|
//! | 65535 | unknown |
//! | `max_distance + 1` | nothing within the sensor's range |
//! | more | outside the definition: unknown |
//! | 0 | touching, by the definition; ArduPilot takes it for *no reading*, and senders made for ArduPilot rely on that |
//! | else | the nearest obstacle, centimetres |
//!
//! So 0 is unknown on ArduPilot's link and otherwise a hit at `min_distance`, at least 1 cm. A distance over 65.5 m
//! counts as nothing within the sensor's range, which is then limited to that. Messages of one turn make one scan
//! ([`crate::turns`]).
//!
//! ## Points
//!
//! A `DISTANCE_SENSOR` looks along its orientation: 0 to 7 are steps of 45 degrees, clockwise (the text of the message
//! definition has left and right swapped, its rotations do not), and 100 is given by its quaternion. One that looks up
//! or down is not about obstacles; 25, which looks down, measures the distance to the ground. The obstacle may be
//! anywhere in the width of the beam (45 degrees where it is not given), and points fill that width. Sensors that cover
//! all directions are in [`crate::beams`]. A distance below the sensor's range, or of signal quality 1, is no reading;
//! one above the range says that the sensor works and sees nothing. An `OBSTACLE_DISTANCE_3D` is a point forward, right
//! and down of the vehicle. Points more than a metre above or below the vehicle are ignored. Points and beams never
//! remove an obstacle that is already in the map.

use core::f32::consts::FRAC_PI_4;

use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::units::sin_cos;
use foxhound_core::mapping::scan::{RAY_MAX_M, Sector};

use crate::dialect::{DISTANCE_SENSOR_DATA, MavFrame, OBSTACLE_DISTANCE_3D_DATA, OBSTACLE_DISTANCE_DATA};

const UNKNOWN_CM: u16 = u16::MAX;
/// Obstacles farther than this are ignored.
const RAY_MAX_CM: u16 = (100.0 * RAY_MAX_M) as u16;
pub(crate) const FULL_TURN_DEG: f32 = 360.0;
/// Points farther above or below than this are not in the way.
const LEVEL_M: f32 = 1.0;
/// The orientation of a beam whose quaternion says where it points.
const CUSTOM: u8 = 100;
pub(crate) const BAD_SIGNAL: u8 = 1;

/// What the angles of a message count from, and what its zeros mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reading {
    /// Our yaw, subtracted from angles that count from north; `None` for angles from the nose.
    pub(crate) yaw_rad: Option<f32>,
    /// Whether distance 0 is an obstacle that touches us.
    pub(crate) zero_touches: bool,
    /// Directions ([`crate::beams`]) that are clear where no message of a turn reports them, a bit each.
    pub(crate) untold: u8,
}

/// The part of a scan in one message.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part<'a> {
    message: &'a OBSTACLE_DISTANCE_DATA,
    zero_touches: bool,
    /// Angle of the first sector's middle, as the message counts it, and from one sector to the next.
    pub(crate) first_deg: f32,
    pub(crate) step_deg: f32,
    /// See [`Reading`].
    pub(crate) yaw_rad: Option<f32>,
    /// See [`Reading`].
    pub(crate) untold: u8,
    /// Sectors.
    pub(crate) count: usize,
    pub(crate) range_max_m: f32,
}

/// Reads a message; `None` for an invalid one.
pub(crate) fn part(message: &OBSTACLE_DISTANCE_DATA, reading: Reading) -> Option<Part<'_>> {
    let step_deg = if message.increment_f == 0.0 { f32::from(message.increment) } else { message.increment_f };
    let width_deg = libm::fabsf(step_deg);
    // Narrower than any sensor's, and still a number in radians.
    let sane = (0.01..=FULL_TURN_DEG).contains(&width_deg)
        && libm::fabsf(message.angle_offset) <= 2.0 * FULL_TURN_DEG
        && message.max_distance > 0
        && message.min_distance <= message.max_distance;
    sane.then_some(Part {
        message,
        zero_touches: reading.zero_touches,
        first_deg: message.angle_offset,
        step_deg,
        yaw_rad: reading.yaw_rad,
        untold: reading.untold,
        // A float to integer cast saturates.
        count: ((FULL_TURN_DEG / width_deg + 0.5) as usize).min(message.distances.len()),
        range_max_m: f32::from(message.max_distance.min(RAY_MAX_CM)) / 100.0,
    })
}

impl Part<'_> {
    /// The content of a sector.
    pub(crate) fn sector(&self, index: usize) -> Sector {
        let message = self.message;
        match message.distances.get(index).copied().unwrap_or(UNKNOWN_CM) {
            UNKNOWN_CM => Sector::Unknown,
            0 if self.zero_touches => Sector::Hit(f32::from(message.min_distance.max(1)) / 100.0),
            0 => Sector::Unknown,
            distance_cm if distance_cm <= message.max_distance && distance_cm > RAY_MAX_CM => Sector::Clear,
            distance_cm if distance_cm <= message.max_distance => Sector::Hit(f32::from(distance_cm) / 100.0),
            distance_cm if message.max_distance.checked_add(1) == Some(distance_cm) => Sector::Clear,
            _ => Sector::Unknown,
        }
    }
}

/// The content of a message about one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Return {
    /// An obstacle, forward and right of the vehicle (in the fields for north and east).
    At(Horizontal),
    /// A measurement without an obstacle within the sensor's range.
    Free,
    /// No reading, or not in the plane of flight.
    Nothing,
    /// Not finite, contradictory, or in a frame that is not understood.
    Absurd,
}

/// Where `OBSTACLE_DISTANCE_3D` sees an obstacle.
#[inline(never)]
pub(crate) fn point(message: &OBSTACLE_DISTANCE_3D_DATA) -> Return {
    let point = Horizontal { north: message.x, east: message.y };
    let distance_m = sqrt(point.norm_squared() + message.z * message.z);
    let sane = message.frame == MavFrame::MAV_FRAME_BODY_FRD as u8
        && distance_m.is_finite()
        && message.min_distance >= 0.0
        && message.max_distance > message.min_distance
        && message.max_distance.is_finite();
    if !sane {
        return Return::Absurd;
    }
    if distance_m < message.min_distance {
        Return::Nothing
    } else if distance_m > message.max_distance || libm::fabsf(message.z) > LEVEL_M {
        Return::Free
    } else {
        Return::At(point)
    }
}

/// Whether a beam looks around, not up or down.
pub(crate) const fn is_level(message: &DISTANCE_SENSOR_DATA) -> bool {
    message.orientation <= 7 || message.orientation == CUSTOM
}

/// Half of the width of a beam; that of a whole direction where it is not given.
pub(crate) fn half_width_rad(message: &DISTANCE_SENSOR_DATA) -> f32 {
    let told_rad = message.horizontal_fov;
    if told_rad > 0.0 && told_rad < FRAC_PI_4 { 0.5 * told_rad } else { 0.5 * FRAC_PI_4 }
}

/// Where `DISTANCE_SENSOR` sees an obstacle.
#[inline(never)]
pub(crate) fn beam(message: &DISTANCE_SENSOR_DATA) -> Return {
    if message.max_distance == 0 || message.min_distance > message.max_distance {
        return Return::Absurd;
    }
    let (direction, down) = match message.orientation {
        step @ 0..=7 => {
            let (sin, cos) = sin_cos(f32::from(step) * FRAC_PI_4);
            (Horizontal { north: cos, east: sin }, 0.0)
        }
        CUSTOM => {
            // The sensor's forward axis in the body frame.
            let [w, x, y, z] = message.quaternion;
            let norm = w * w + x * x + y * y + z * z;
            if !(0.98..=1.02).contains(&norm) {
                return Return::Absurd;
            }
            let forward = Horizontal { north: 1.0 - 2.0 * (y * y + z * z), east: 2.0 * (x * y + w * z) };
            (forward, 2.0 * (x * z - w * y))
        }
        _ => return Return::Nothing,
    };
    let distance_m = f32::from(message.current_distance) / 100.0;
    let is_level = libm::fabsf(down * distance_m) <= LEVEL_M;
    let is_reading = message.current_distance >= message.min_distance.max(1) && message.signal_quality != BAD_SIGNAL;
    if !is_reading || !is_level {
        Return::Nothing
    } else if message.current_distance > message.max_distance {
        Return::Free
    } else {
        Return::At(direction.times(distance_m))
    }
}

/// The orientation of a beam that looks down.
pub(crate) const DOWN: u8 = 25;

/// How far below the vehicle, along its own axis, `DISTANCE_SENSOR` sees the ground; `None` where it looks elsewhere or
/// sees nothing.
#[inline(never)]
pub(crate) fn ground_m(message: &DISTANCE_SENSOR_DATA) -> Option<f32> {
    let is_reading = message.orientation == DOWN
        && message.current_distance >= message.min_distance.max(1)
        && message.current_distance <= message.max_distance
        && message.signal_quality != BAD_SIGNAL;
    is_reading.then_some(f32::from(message.current_distance) / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::turns::Turns;
    use foxhound_core::base::time::Instant;
    use foxhound_core::mapping::scan::Scan;

    const NOSE: Reading = Reading { yaw_rad: None, zero_touches: false, untold: 0 };

    fn message() -> OBSTACLE_DISTANCE_DATA {
        OBSTACLE_DISTANCE_DATA {
            distances: core::array::from_fn(|index| 100 + index as u16),
            increment: 5,
            min_distance: 30,
            max_distance: 800,
            ..OBSTACLE_DISTANCE_DATA::DEFAULT
        }
    }

    fn scan(message: &OBSTACLE_DISTANCE_DATA, reading: Reading) -> Option<Scan> {
        let mut turns = Turns::new();
        turns.hear(Instant(7), 1, &part(message, reading)?);
        turns.scan().cloned()
    }

    fn read(message: &OBSTACLE_DISTANCE_DATA) -> Option<Scan> {
        scan(message, NOSE)
    }

    fn known(scan: &Scan) -> usize {
        scan.rays.iter().filter(|sector| *sector != Sector::Unknown).count()
    }

    #[test]
    fn distances_mean_what_the_table_says() {
        let mut message = message();
        message.distances[..8].copy_from_slice(&[u16::MAX, 801, 802, 65534, 0, 1, 29, 800]);
        let expected = |zero| {
            let unknown = Sector::Unknown;
            [unknown, Sector::Clear, unknown, unknown, zero, Sector::Hit(0.01), Sector::Hit(0.29), Sector::Hit(8.0)]
        };
        assert_eq!(
            read(&message).unwrap().rays.iter().take(8).collect::<std::vec::Vec<_>>(),
            expected(Sector::Unknown)
        );
        let touching = Reading { zero_touches: true, ..NOSE };
        assert_eq!(
            scan(&message, touching).unwrap().rays.iter().take(8).collect::<std::vec::Vec<_>>(),
            expected(Sector::Hit(0.3))
        );
        message.min_distance = 0;
        assert_eq!(scan(&message, touching).unwrap().rays.get(4), Sector::Hit(0.01));
    }

    #[test]
    fn the_ground_is_seen_by_a_beam_that_looks_down_and_reads() {
        let down = DISTANCE_SENSOR_DATA {
            orientation: DOWN,
            min_distance: 20,
            max_distance: 1200,
            current_distance: 215,
            ..DISTANCE_SENSOR_DATA::DEFAULT
        };
        assert_eq!(ground_m(&down), Some(2.15));
        assert_eq!(beam(&down), Return::Nothing, "the ground is no obstacle");
        for other in [
            DISTANCE_SENSOR_DATA { orientation: 24, ..down },
            DISTANCE_SENSOR_DATA { current_distance: 19, ..down },
            DISTANCE_SENSOR_DATA { current_distance: 0, min_distance: 0, ..down },
            DISTANCE_SENSOR_DATA { current_distance: 1201, ..down },
            DISTANCE_SENSOR_DATA { signal_quality: BAD_SIGNAL, ..down },
        ] {
            assert_eq!(ground_m(&other), None, "{other:?}");
        }
    }

    #[test]
    fn at_the_end_of_the_number_range_unknown_wins_over_clear() {
        let mut message = OBSTACLE_DISTANCE_DATA { max_distance: 65534, ..message() };
        message.distances[0] = u16::MAX;
        assert_eq!(read(&message).unwrap().rays.get(0), Sector::Unknown);
        message.max_distance = u16::MAX;
        assert_eq!(read(&message).unwrap().rays.get(0), Sector::Unknown);
    }

    #[test]
    fn the_float_increment_replaces_the_other_and_may_be_negative() {
        let scan = read(&OBSTACLE_DISTANCE_DATA { increment_f: -7.5, angle_offset: 90.0, ..message() }).unwrap();
        assert!((scan.step_rad + 7.5_f32.to_radians()).abs() < 1e-6);
        assert!((scan.first_azimuth_rad - 90.0_f32.to_radians()).abs() < 1e-6);
        assert_eq!(known(&scan), 48, "a full turn, no more");
        assert!((read(&message()).unwrap().step_rad - 5.0_f32.to_radians()).abs() < 1e-6);
    }

    #[test]
    fn elements_past_a_full_turn_are_ignored() {
        for (increment, count) in [(1, 72), (5, 72), (6, 60), (10, 36), (45, 8), (90, 4), (180, 2)] {
            assert_eq!(known(&read(&OBSTACLE_DISTANCE_DATA { increment, ..message() }).unwrap()), count, "{increment}");
        }
        let turn = OBSTACLE_DISTANCE_DATA { increment_f: 360.0, ..message() };
        assert_eq!(known(&read(&turn).unwrap()), 1);
    }

    #[test]
    fn angles_from_north_are_turned_by_our_yaw() {
        let message = OBSTACLE_DISTANCE_DATA { angle_offset: 30.0, ..message() };
        for yaw_deg in [-170.0_f32, -30.0, 0.0, 45.0, 179.0] {
            let reading = Reading { yaw_rad: Some(yaw_deg.to_radians()), ..NOSE };
            let azimuth_rad = scan(&message, reading).unwrap().first_azimuth_rad;
            let expected = (30.0 - yaw_deg + 540.0).rem_euclid(360.0) - 180.0;
            assert!((azimuth_rad.to_degrees() - expected).abs() < 1e-3, "yaw {yaw_deg}: {azimuth_rad}");
        }
    }

    #[test]
    fn a_message_without_meaning_is_refused() {
        let good = message();
        assert!(read(&good).is_some());
        let with = |change: fn(&mut OBSTACLE_DISTANCE_DATA)| {
            let mut message = message();
            change(&mut message);
            read(&message)
        };
        assert_eq!(with(|message| message.increment = 0), None);
        assert_eq!(with(|message| message.increment_f = f32::from_bits(1)), None);
        assert_eq!(with(|message| message.increment_f = f32::NAN), None);
        assert_eq!(with(|message| message.increment_f = f32::INFINITY), None);
        assert_eq!(with(|message| message.increment_f = -361.0), None);
        assert_eq!(with(|message| message.angle_offset = f32::NAN), None);
        assert_eq!(with(|message| message.angle_offset = 1e6), None);
        assert_eq!(with(|message| message.max_distance = 0), None);
        assert_eq!(with(|message| message.max_distance = 29), None);
    }

    fn sensor() -> DISTANCE_SENSOR_DATA {
        DISTANCE_SENSOR_DATA {
            min_distance: 20,
            max_distance: 800,
            current_distance: 200,
            ..DISTANCE_SENSOR_DATA::DEFAULT
        }
    }

    fn at(heard: Return) -> (f32, f32) {
        let Return::At(point) = heard else { panic!("{heard:?}") };
        (point.north, point.east)
    }

    #[test]
    fn a_beam_points_clockwise_in_steps_of_45_degrees() {
        let half = 2.0 * core::f32::consts::FRAC_1_SQRT_2;
        let expected = [
            (2.0, 0.0),
            (half, half),
            (0.0, 2.0),
            (-half, half),
            (-2.0, 0.0),
            (-half, -half),
            (0.0, -2.0),
            (half, -half),
        ];
        for (orientation, expected) in expected.iter().enumerate() {
            let (forward, right) = at(beam(&DISTANCE_SENSOR_DATA { orientation: orientation as u8, ..sensor() }));
            assert!((forward - expected.0).abs() < 1e-5 && (right - expected.1).abs() < 1e-5, "{orientation}");
        }
        // Up, down, and what nobody mounts.
        for orientation in [24, 25, 8, 40, 101, 255] {
            assert_eq!(beam(&DISTANCE_SENSOR_DATA { orientation, ..sensor() }), Return::Nothing, "{orientation}");
        }
    }

    #[test]
    fn a_beam_of_any_direction_points_where_its_quaternion_turns_the_nose() {
        let custom = |quaternion| beam(&DISTANCE_SENSOR_DATA { orientation: CUSTOM, quaternion, ..sensor() });
        let (s, c) = (30.0_f32.to_radians().sin(), 30.0_f32.to_radians().cos());
        // A yaw of 60 degrees, and a pitch of 60 degrees, which looks up by 1.7 m.
        let (forward, right) = at(custom([c, 0.0, 0.0, s]));
        assert!((forward - 1.0).abs() < 1e-5 && (right - 3.0_f32.sqrt()).abs() < 1e-5);
        assert_eq!(custom([c, 0.0, s, 0.0]), Return::Nothing);
        for bad in [[0.0; 4], [2.0, 0.0, 0.0, 0.0], [f32::NAN, 0.0, 0.0, 0.0], [f32::INFINITY; 4]] {
            assert_eq!(custom(bad), Return::Absurd);
        }
    }

    #[test]
    fn a_beam_without_a_reading_says_nothing_and_one_at_odds_with_itself_is_refused() {
        let with = |change: fn(&mut DISTANCE_SENSOR_DATA)| {
            let mut message = sensor();
            change(&mut message);
            beam(&message)
        };
        assert_eq!(with(|message| message.current_distance = 19), Return::Nothing);
        assert_eq!(with(|message| message.current_distance = 801), Return::Free);
        assert_eq!(with(|message| message.signal_quality = 1), Return::Nothing);
        assert!(matches!(with(|message| message.signal_quality = 0), Return::At(_)));
        assert_eq!(with(|message| (message.min_distance, message.current_distance) = (0, 0)), Return::Nothing);
        assert_eq!(with(|message| message.max_distance = 0), Return::Absurd);
        assert_eq!(with(|message| message.min_distance = 801), Return::Absurd);
    }

    #[test]
    fn a_point_is_taken_in_the_body_frame_at_the_vehicles_height_within_the_sensors_range() {
        let good = OBSTACLE_DISTANCE_3D_DATA {
            frame: MavFrame::MAV_FRAME_BODY_FRD as u8,
            x: 1.5,
            y: -2.0,
            z: 0.5,
            min_distance: 0.3,
            max_distance: 8.0,
            ..OBSTACLE_DISTANCE_3D_DATA::DEFAULT
        };
        assert_eq!(at(point(&good)), (1.5, -2.0));
        let with = |change: fn(&mut OBSTACLE_DISTANCE_3D_DATA)| {
            let mut message = good.clone();
            change(&mut message);
            point(&message)
        };
        assert_eq!(with(|message| message.z = 1.2), Return::Free);
        assert_eq!(with(|message| message.x = 9.0), Return::Free);
        assert_eq!(with(|message| (message.x, message.y, message.z) = (0.1, 0.1, 0.0)), Return::Nothing);
        assert_eq!(with(|message| message.frame = 0), Return::Absurd);
        assert_eq!(with(|message| message.x = f32::NAN), Return::Absurd);
        assert_eq!(with(|message| message.z = f32::INFINITY), Return::Absurd);
        assert_eq!(with(|message| message.x = 1e30), Return::Absurd);
        assert_eq!(with(|message| message.max_distance = f32::NAN), Return::Absurd);
        assert_eq!(with(|message| message.min_distance = -1.0), Return::Absurd);
    }
}
