//! `DISTANCE_SENSOR` messages of a sensor that covers all directions, as parts of one scan ([`crate::turns`]).
//!
//! `ArduPilot` reports its proximity sensor as one message for each 45 degrees around the vehicle: the least distance
//! in that sector, from the autopilot's own component, with ids from 10 on (`GCS_MAVLink`, `send_proximity`). The
//! obstacle is somewhere in the sector, not necessarily in its middle, so all nine rays of 5 degrees get that distance.
//! A sector in which nothing is seen is reported with its `max_distance`; newer versions do not report it until
//! something has been seen in it. Where nothing is seen in any, no message is sent at all (`AP_Proximity_Boundary_3D`,
//! `get_layer_distances`), which cannot be told from messages that are lost or not sent here: so nobody is believed to look.
//!
//! From other senders, eight orientations make such a sensor once each has been received. Before that, and where the
//! message says that the beam is narrower, they are single points (`crate::obstacles`).

use crate::dialect::{DISTANCE_SENSOR_DATA, OBSTACLE_DISTANCE_DATA};
use crate::obstacles::BAD_SIGNAL;

/// Orientations around the vehicle, and rays that stand for each.
pub(crate) const DIRECTIONS: u8 = 8;
pub(crate) const RAYS_EACH: usize = 9;
const RAY_DEG: u8 = 5;
/// Width of a direction, and where the rays of the direction of the nose begin.
pub(crate) const EACH_DEG: f32 = 45.0;
pub(crate) const FIRST_DEG: f32 = -20.0;
/// A beam that is reported narrower than this does not fill its sector.
const SECTOR_RAD_MIN: f32 = 0.7;
/// First id of `ArduPilot`'s proximity sensor; range finders have lower ones.
const PROXIMITY_ID: u8 = 10;

/// The directions that were received, a bit each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beams {
    component_id: u8,
    heard: u8,
}

impl Beams {
    /// None yet.
    pub(crate) const fn new() -> Self {
        Self { component_id: 0, heard: 0 }
    }

    /// A beam as the rays of its sector, and the directions (a bit each) that were never reported, which means that
    /// nothing was seen in them; `None` where the beam does not belong to a sensor that covers all directions.
    #[inline(never)]
    pub(crate) fn sector(
        &mut self,
        component_id: u8,
        is_ardupilot: bool,
        beam: &DISTANCE_SENSOR_DATA,
    ) -> Option<(OBSTACLE_DISTANCE_DATA, u8)> {
        let is_narrow = beam.horizontal_fov > 0.0 && beam.horizontal_fov < SECTOR_RAD_MIN;
        let is_sane = beam.max_distance > 0 && beam.min_distance <= beam.max_distance;
        if beam.orientation >= DIRECTIONS || is_narrow || !is_sane {
            return None;
        }
        if self.component_id != component_id {
            *self = Self { component_id, heard: 0 };
        }
        self.heard |= 1 << beam.orientation;
        let is_proximity = is_ardupilot && beam.id >= PROXIMITY_ID;
        if !is_proximity && self.heard != u8::MAX {
            return None;
        }
        let its_cm = if beam.current_distance < beam.min_distance.max(1) || beam.signal_quality == BAD_SIGNAL {
            u16::MAX
        } else if beam.current_distance >= beam.max_distance {
            beam.max_distance.saturating_add(1)
        } else {
            beam.current_distance
        };
        let mut message = OBSTACLE_DISTANCE_DATA {
            distances: [u16::MAX; 72],
            min_distance: beam.min_distance,
            max_distance: beam.max_distance,
            increment: RAY_DEG,
            // Of the first of its rays.
            angle_offset: FIRST_DEG + EACH_DEG * f32::from(beam.orientation),
            ..OBSTACLE_DISTANCE_DATA::DEFAULT
        };
        message.distances.iter_mut().take(RAYS_EACH).for_each(|ray| *ray = its_cm);
        Some((message, if is_proximity { !self.heard } else { 0 }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beam(orientation: u8, current_distance: u16) -> DISTANCE_SENSOR_DATA {
        DISTANCE_SENSOR_DATA {
            id: PROXIMITY_ID + orientation,
            orientation,
            min_distance: 20,
            max_distance: 600,
            current_distance,
            ..DISTANCE_SENSOR_DATA::DEFAULT
        }
    }

    /// The distance in centimetres, if all nine rays have it and no other ray is given; `None` where they differ.
    fn alike(message: &OBSTACLE_DISTANCE_DATA) -> Option<u16> {
        let (its, others) = message.distances.split_at(RAYS_EACH);
        let are_alike = its.iter().all(|ray| *ray == its[0]) && others.iter().all(|ray| *ray == u16::MAX);
        are_alike.then_some(its[0])
    }

    #[test]
    fn an_obstacle_is_anywhere_in_its_sector_and_directions_that_were_never_told_are_named() {
        let mut beams = Beams::new();
        let (message, untold) = beams.sector(1, true, &beam(2, 250)).unwrap();
        assert_eq!((message.angle_offset, message.increment, message.max_distance), (70.0, 5, 600));
        assert_eq!((alike(&message), untold), (Some(250), 0b1111_1011));
        let (message, untold) = beams.sector(1, true, &beam(1, 600)).unwrap();
        assert_eq!((message.angle_offset, alike(&message)), (25.0, Some(601)), "the farthest is nothing");
        assert_eq!(untold, 0b1111_1001);
    }

    #[test]
    fn eight_directions_of_anybody_make_a_sensor_and_fewer_do_not() {
        let mut beams = Beams::new();
        for orientation in 0..7 {
            assert!(beams.sector(158, false, &DISTANCE_SENSOR_DATA { id: 0, ..beam(orientation, 300) }).is_none());
        }
        assert!(beams.sector(158, false, &beam(7, 300)).is_some_and(|(_, untold)| untold == 0), "whatever their ids");
        assert!(beams.sector(158, false, &beam(0, 300)).is_some());
        assert!(beams.sector(159, false, &beam(0, 300)).is_none(), "another's");
        let range_finder = DISTANCE_SENSOR_DATA { id: 0, ..beam(0, 300) };
        assert!(Beams::new().sector(1, true, &range_finder).is_none(), "ArduPilot's range finder");
    }

    #[test]
    fn what_looks_elsewhere_or_is_narrow_or_means_nothing_is_no_sector() {
        let mut beams = Beams::new();
        for other in [
            DISTANCE_SENSOR_DATA { orientation: 24, ..beam(0, 300) },
            DISTANCE_SENSOR_DATA { orientation: 25, ..beam(0, 300) },
            DISTANCE_SENSOR_DATA { horizontal_fov: 0.05, ..beam(0, 300) },
            DISTANCE_SENSOR_DATA { max_distance: 0, min_distance: 0, ..beam(0, 300) },
            DISTANCE_SENSOR_DATA { min_distance: 601, ..beam(0, 300) },
        ] {
            assert!(beams.sector(1, true, &other).is_none(), "{other:?}");
        }
        for unread in [beam(0, 19), beam(0, 0), DISTANCE_SENSOR_DATA { signal_quality: 1, ..beam(0, 300) }] {
            assert_eq!(alike(&beams.sector(1, true, &unread).unwrap().0), Some(u16::MAX), "{unread:?}");
        }
    }
}
