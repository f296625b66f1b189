//! The autopilot's own proximity sensor, and the forms in which it is reported to a companion.
//!
//! `ArduPilot` keeps the least distance of each 45 degrees around the vehicle and reports it as eight
//! `DISTANCE_SENSOR` messages, with ids from 10 on; a sector in which nothing is seen has the sensor's
//! `max_distance`. Since about 4.6 a sector is not reported until something has been seen in it \[src: `GCS_MAVLink`,
//! `send_proximity`\], and nothing at all is where nothing is seen in any of them \[src: `AP_Proximity_Boundary_3D`,
//! `get_layer_distances`\]. `OBSTACLE_DISTANCE` from another component is forwarded.

use std::f64::consts::FRAC_PI_8;

use foxhound_link::dialect::DISTANCE_SENSOR_DATA;

use super::{AUTOPILOT, Autopilot, SENSOR};
use crate::scenario;
use crate::world::sensor::View;
use crate::world::vehicle::Motion;
use crate::world::{Horizontal, World};

const FIRST_ID: u8 = 10;
const DIRECTIONS: usize = 8;
const NEAREST_CM: u16 = 5;

/// The form of the reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Told {
    /// Eight `DISTANCE_SENSOR`.
    Directions,
    /// The same, each from the first obstacle in it on.
    DirectionsOnceSeen,
    /// `OBSTACLE_DISTANCE` of 72 sectors.
    Sectors,
}

/// A sensor that covers all directions, and the world that only it sees.
#[derive(Clone, Debug)]
pub struct Proximity {
    world: World,
    told: Told,
    range_m: f64,
    period_us: u64,
    due_us: u64,
    /// Directions in which something was seen, a bit each.
    seen: u8,
}

impl Proximity {
    /// A sensor that reports a world `rate_hz` times a second.
    #[must_use]
    pub fn new(world: World, told: Told, range_m: f64, rate_hz: f64) -> Self {
        Self { world, told, range_m, period_us: (1e6 / rate_hz) as u64, due_us: 0, seen: 0 }
    }

    fn view(&self, motion: &Motion, aside_rad: f64, rays: u32) -> View<'_> {
        let [north, east, _] = motion.pose.position_ned_m;
        let sensor = scenario::Sensor { fov_deg: 360.0, range_m: self.range_m, rays, ..scenario::Sensor::default() };
        let (position, yaw_rad) = (Horizontal { north, east }, motion.pose.yaw_rad + aside_rad);
        View { world: &self.world, time_s: 0.0, position, yaw_rad, sensor }
    }

    /// The least distance in each direction, from the nose on clockwise; `None` without an obstacle.
    fn directions(&self, motion: &Motion) -> [Option<u16>; DIRECTIONS] {
        let mut directions = [None; DIRECTIONS];
        // A turn of sectors begins behind the vehicle; turned by half a sector the fourth is the nose's.
        for message in self.view(motion, FRAC_PI_8, DIRECTIONS as u32).scan(0) {
            for (sector, distance_cm) in message.distances.iter().take(DIRECTIONS).enumerate() {
                let is_seen = *distance_cm <= message.max_distance;
                directions[(sector + 5) % DIRECTIONS] = is_seen.then_some(*distance_cm);
            }
        }
        directions
    }
}

impl Autopilot {
    /// Reports the measurements of its own sensor, when they are due.
    pub(super) fn tell_proximity(&mut self, now_us: u64, motion: &Motion) {
        let Some(mut sensor) = self.proximity.take_if(|sensor| now_us >= sensor.due_us) else { return };
        sensor.due_us = (sensor.due_us + sensor.period_us).max(now_us + sensor.period_us / 2);
        if sensor.told == Told::Sectors {
            for message in sensor.view(motion, 0.0, 72).scan(now_us) {
                self.send(SENSOR, &message);
            }
        } else {
            let max_distance = (sensor.range_m * 100.0) as u16;
            let directions = sensor.directions(motion);
            let sees = directions.iter().any(Option::is_some);
            for (orientation, distance_cm) in (0_u8..).zip(directions).filter(|_| sees) {
                sensor.seen |= u8::from(distance_cm.is_some()) << orientation;
                if sensor.told == Told::DirectionsOnceSeen && sensor.seen >> orientation & 1 == 0 {
                    continue;
                }
                let message = DISTANCE_SENSOR_DATA {
                    time_boot_ms: self.boot_ms(now_us),
                    id: FIRST_ID + orientation,
                    orientation,
                    min_distance: NEAREST_CM,
                    max_distance,
                    current_distance: distance_cm.unwrap_or(max_distance),
                    ..DISTANCE_SENSOR_DATA::DEFAULT
                };
                self.send(AUTOPILOT, &message);
            }
        }
        self.proximity = Some(sensor);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Obstacle, Scenario};

    #[test]
    fn each_direction_has_the_least_distance_of_45_degrees_around_it() {
        let post = |azimuth_deg: f64, away_m: f64| {
            let (east, north) = azimuth_deg.to_radians().sin_cos();
            Obstacle { x: away_m * east, y: away_m * north, r: 0.1, ..Obstacle::default() }
        };
        let obstacles = vec![post(15.0, 2.0), post(5.0, 3.0), post(90.0, 4.0), post(-95.0, 1.0), post(180.0, 7.0)];
        let world = Scenario { obstacles, ..Scenario::default() }.world();
        let sensor = Proximity::new(world, Told::Directions, 6.0, 10.0);
        let near = |cm: Option<u16>, expected: u16| cm.is_some_and(|cm| cm.abs_diff(expected) <= 1);
        let seen = sensor.directions(&Motion::default());
        assert!(near(seen[0], 190) && near(seen[2], 390) && near(seen[6], 90), "{seen:?}");
        assert!([1, 3, 4, 5, 7].iter().all(|direction| seen[*direction].is_none()), "{seen:?}");
    }
}
