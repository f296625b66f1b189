//! `OBSTACLE_DISTANCE` to a scan in the body frame.
//!
//! Element `j` is the middle of the sector at `angle_offset + j * increment`, clockwise positive; `increment_f`
//! replaces `increment` unless it is 0 and may be negative. Elements past a full turn mean nothing. After the message
//! definition and ArduPilot's reading of it (`AP_Proximity_MAV`).
//!
//! | distance | means |
//! |---|---|
//! | 65535 | unknown |
//! | `max_distance + 1` | nothing as far as the sensor reaches |
//! | more | outside the definition: unknown |
//! | 0 | touching, says the definition; ArduPilot takes it for *no reading*, and who feeds ArduPilot relies on that |
//! | else | the nearest obstacle, centimetres |
//!
//! So 0 is unknown on ArduPilot's link and otherwise a hit at `min_distance`, at least 1 cm.

use core::f32::consts::PI;

use foxhound_core::scan::{SECTORS_MAX, Scan, Sector};
use foxhound_core::time::Instant;
use foxhound_core::units::wrap_pi;

use crate::dialect::OBSTACLE_DISTANCE_DATA;

const UNKNOWN_CM: u16 = u16::MAX;
const FULL_TURN_DEG: f32 = 360.0;

/// What the angles of a message count from, and what its zeros mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reading {
    /// Subtracted from the angles: 0 for angles from the nose, our yaw for angles from north.
    pub(crate) yaw_rad: f32,
    /// Whether distance 0 is an obstacle that touches us.
    pub(crate) zero_touches: bool,
}

/// The scan that a message brings; `None` for a message that means nothing.
pub(crate) fn scan(message: &OBSTACLE_DISTANCE_DATA, time: Instant, reading: Reading) -> Option<Scan> {
    let step_deg = if message.increment_f == 0.0 { f32::from(message.increment) } else { message.increment_f };
    let width_deg = libm::fabsf(step_deg);
    // Narrower than any sensor's, and still a number in radians.
    let sane = (0.01..=FULL_TURN_DEG).contains(&width_deg)
        && libm::fabsf(message.angle_offset) <= 2.0 * FULL_TURN_DEG
        && message.max_distance > 0
        && message.min_distance <= message.max_distance;
    if !sane {
        return None;
    }
    // A float to integer cast saturates.
    let count = ((FULL_TURN_DEG / width_deg + 0.5) as usize).min(SECTORS_MAX);
    let touching_m = f32::from(message.min_distance.max(1)) / 100.0;
    let mut sectors = [Sector::Unknown; SECTORS_MAX];
    for (sector, &distance_cm) in sectors.iter_mut().zip(&message.distances).take(count) {
        *sector = match distance_cm {
            UNKNOWN_CM => Sector::Unknown,
            0 if reading.zero_touches => Sector::Hit(touching_m),
            0 => Sector::Unknown,
            _ if distance_cm <= message.max_distance => Sector::Hit(f32::from(distance_cm) / 100.0),
            _ if message.max_distance.checked_add(1) == Some(distance_cm) => Sector::Clear,
            _ => Sector::Unknown,
        };
    }
    Some(Scan {
        time,
        first_azimuth_rad: wrap_pi(message.angle_offset * (PI / 180.0) - reading.yaw_rad),
        step_rad: step_deg * (PI / 180.0),
        range_max_m: f32::from(message.max_distance) / 100.0,
        sectors,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOSE: Reading = Reading { yaw_rad: 0.0, zero_touches: false };

    fn message() -> OBSTACLE_DISTANCE_DATA {
        OBSTACLE_DISTANCE_DATA {
            distances: core::array::from_fn(|index| 100 + index as u16),
            increment: 5,
            min_distance: 30,
            max_distance: 800,
            ..OBSTACLE_DISTANCE_DATA::DEFAULT
        }
    }

    fn read(message: &OBSTACLE_DISTANCE_DATA) -> Option<Scan> {
        scan(message, Instant(7), NOSE)
    }

    fn known(scan: &Scan) -> usize {
        scan.sectors.iter().filter(|sector| **sector != Sector::Unknown).count()
    }

    #[test]
    fn distances_mean_what_the_table_says() {
        let mut message = message();
        message.distances[..8].copy_from_slice(&[u16::MAX, 801, 802, 65534, 0, 1, 29, 800]);
        let expected = |zero| {
            let unknown = Sector::Unknown;
            [unknown, Sector::Clear, unknown, unknown, zero, Sector::Hit(0.01), Sector::Hit(0.29), Sector::Hit(8.0)]
        };
        assert_eq!(read(&message).unwrap().sectors[..8], expected(Sector::Unknown));
        let touching = Reading { zero_touches: true, ..NOSE };
        assert_eq!(scan(&message, Instant(7), touching).unwrap().sectors[..8], expected(Sector::Hit(0.3)));
        message.min_distance = 0;
        assert_eq!(scan(&message, Instant(7), touching).unwrap().sectors[4], Sector::Hit(0.01));
    }

    #[test]
    fn at_the_end_of_the_number_range_unknown_wins_over_clear() {
        let mut message = OBSTACLE_DISTANCE_DATA { max_distance: 65534, ..message() };
        message.distances[0] = u16::MAX;
        assert_eq!(read(&message).unwrap().sectors[0], Sector::Unknown);
        message.max_distance = u16::MAX;
        assert_eq!(read(&message).unwrap().sectors[0], Sector::Unknown);
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
            let reading = Reading { yaw_rad: yaw_deg.to_radians(), ..NOSE };
            let azimuth_rad = scan(&message, Instant(7), reading).unwrap().first_azimuth_rad;
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
}
