//! The obstacle sensor on the nose: rays against pillars, inside a cone.
//!
//! Its range is [`Sensor::range_m`](crate::scenario::Sensor) within a field of view centred on the nose. With
//! occlusion a pillar hides others behind it. It delivers one of two forms:
//!
//! - circles: every visible pillar, exactly, including its velocity;
//! - scan: sectors that share the field of view, 72 or as many as [`Sensor::rays`](crate::scenario::Sensor), in an
//!   `OBSTACLE_DISTANCE` message for each 72 of them. A sector's distance is that of its centre ray, as a scanning
//!   lidar's; sectors wider than 1.25 deg use the nearest of several rays evenly spread, so that a wide field of view
//!   has no gaps between its rays. If a scan takes time, its rays are cast one after another, each from the vehicle's
//!   position at that time, and each message is sent when its last ray is cast.

use foxhound_core::base::obstacle::Circle;
use foxhound_core::mapping::map::DELIVERY_MAX;
use foxhound_link::dialect::{MavDistanceSensor, MavFrame, OBSTACLE_DISTANCE_DATA};

use super::geometry::Horizontal;
use super::pillar::Pillar;
use super::ranging::Ranging;
use super::truth::World;
use super::vehicle::Motion;
use crate::scenario;

/// Sectors of one message.
pub const SECTORS: usize = 72;
/// Widest sector that one ray may stand for.
const RAY_STEP_DEG: f64 = 1.25;
/// Nearest distance that a scan reports: 0 would mean "no reading" to ArduPilot.
const NEAREST_CM: u16 = 1;
const UNKNOWN_CM: u16 = u16::MAX;
/// Rays per degree by which pillars are found for the circles model.
const CIRCLE_RAYS_PER_DEG: f64 = 2.0;

/// A view of the world from a position, along a yaw.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// The pillars.
    pub world: &'a World,
    /// The time.
    pub time_s: f64,
    /// The position.
    pub position: Horizontal,
    /// Direction of the nose.
    pub yaw_rad: f64,
    /// The sensor.
    pub sensor: scenario::Sensor,
}

/// A pillar within range, with values that all rays need.
#[derive(Clone, Copy, Debug)]
struct Near {
    index: usize,
    pillar: Pillar,
    to_center: Horizontal,
    /// Squared distance to the axis minus the squared radius: zero or less from inside.
    outside_m2: f64,
}

impl Near {
    /// Distance along a ray to the surface; 0 from inside, `None` when the ray misses it.
    fn distance_m(&self, direction: Horizontal) -> Option<f64> {
        if self.outside_m2 <= 0.0 {
            return Some(0.0);
        }
        let along = self.to_center.dot(direction);
        let reach = along * along - self.outside_m2;
        (along > 0.0 && reach >= 0.0).then(|| along - libm::sqrt(reach))
    }
}

impl View<'_> {
    /// Pillars that may be visible.
    fn in_range(&self) -> Vec<Near> {
        let near = |(index, pillar): (usize, Pillar)| {
            let to_center = pillar.center.minus(self.position);
            let outside_m2 = to_center.dot(to_center) - pillar.radius_m * pillar.radius_m;
            let is_near = to_center.norm() - pillar.radius_m <= self.sensor.range_m;
            is_near.then_some(Near { index, pillar, to_center, outside_m2 })
        };
        self.world.pillars_at(self.time_s).enumerate().filter_map(near).collect()
    }

    fn hit(&self, pillars: &[Near], azimuth_deg: f64) -> Option<(usize, f64)> {
        let direction = Horizontal::from_bearing(self.yaw_rad + azimuth_deg.to_radians());
        pillars
            .iter()
            .filter_map(|near| Some((near.index, near.distance_m(direction)?)))
            .filter(|(_, distance)| *distance <= self.sensor.range_m)
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The visible pillars in the core's type: the nearest ones, as many as fit.
    #[must_use]
    pub fn circles(&self) -> Vec<Circle> {
        let pillars = self.in_range();
        let rays = (self.sensor.fov_deg * CIRCLE_RAYS_PER_DEG).ceil().max(2.0) as usize;
        let mut seen = vec![false; self.world.pillars_at(self.time_s).count()];
        for ray in 0..=rays {
            let azimuth_deg = self.sensor.fov_deg * (ray as f64 / rays as f64 - 0.5);
            if self.sensor.occlusion {
                if let Some((index, _)) = self.hit(&pillars, azimuth_deg) {
                    seen[index] = true;
                }
            } else {
                let direction = Horizontal::from_bearing(self.yaw_rad + azimuth_deg.to_radians());
                for near in &pillars {
                    let distance = near.distance_m(direction);
                    seen[near.index] |= distance.is_some_and(|distance| distance <= self.sensor.range_m);
                }
            }
        }
        let mut visible: Vec<&Pillar> =
            pillars.iter().filter(|near| seen[near.index]).map(|near| &near.pillar).collect();
        let gap = |pillar: &Pillar| pillar.center.minus(self.position).norm() - pillar.radius_m;
        visible.sort_by(|a, b| gap(a).total_cmp(&gap(b)));
        visible.truncate(DELIVERY_MAX);
        visible
            .into_iter()
            .map(|pillar| Circle {
                center_ned_m: pillar.center.to_core(),
                radius_m: pillar.radius_m as f32,
                velocity_ned_mps: pillar.velocity_mps.to_core(),
            })
            .collect()
    }

    /// One scan at once, as `OBSTACLE_DISTANCE` messages in the body frame.
    pub fn scan(&self, time_us: u64) -> impl Iterator<Item = OBSTACLE_DISTANCE_DATA> {
        (0..self.messages()).map(move |message| self.message(message, time_us, None, Some))
    }

    /// The messages of scans that begin every `period` ticks, a number of ticks after one has begun.
    pub fn scan_in_turn(
        &self,
        ticks: u64,
        period: u64,
        tick_s: f64,
        time_us: u64,
        motion: &Motion,
        ranging: &mut Ranging,
    ) -> impl Iterator<Item = OBSTACLE_DISTANCE_DATA> {
        let (messages, turn_s) = (self.messages(), self.sensor.turn_s);
        let is_due = move |message: &usize| {
            let after_s = turn_s * (message + 1) as f64 / messages as f64;
            (after_s / tick_s - 1e-6).ceil() as u64 % period == ticks % period
        };
        let motion = (turn_s > 0.0).then_some(*motion);
        (0..messages)
            .filter(is_due)
            .map(move |message| self.message(message, time_us, motion.as_ref(), |m| ranging.measure(m)))
    }

    fn sectors(&self) -> usize {
        self.sensor.rays as usize
    }

    fn messages(&self) -> usize {
        self.sectors().div_ceil(SECTORS)
    }

    /// Distance of the nearest pillar along an azimuth, if one is within range.
    pub(super) fn nearest_m(&self, azimuth_deg: f64) -> Option<f64> {
        self.hit(&self.in_range(), azimuth_deg).map(|(_, distance_m)| distance_m)
    }

    /// The same view some time ago, from a motion.
    pub(super) fn before(&self, ago_s: f64, motion: &Motion) -> Self {
        let [north_mps, east_mps, _] = motion.velocity_ned_mps;
        Self {
            time_s: self.time_s - ago_s,
            position: self.position.along(Horizontal { north: north_mps, east: east_mps }, -ago_s),
            yaw_rad: self.yaw_rad - ago_s * motion.yaw_rate_radps,
            ..*self
        }
    }

    /// One message of a scan; its last ray is cast now, the others earlier, if a motion is given.
    fn message(
        &self,
        message: usize,
        time_us: u64,
        motion: Option<&Motion>,
        mut measure: impl FnMut(f64) -> Option<f64>,
    ) -> OBSTACLE_DISTANCE_DATA {
        let pillars = self.in_range();
        let sectors = self.sectors();
        let width_deg = self.sensor.fov_deg / sectors as f64;
        let first_deg = (width_deg - self.sensor.fov_deg) / 2.0;
        let rays = (width_deg / RAY_STEP_DEG - 1e-9).ceil().max(1.0);
        let max_cm = (self.sensor.range_m * 100.0) as u16;
        let (from, to) = (message * SECTORS, sectors.min((message + 1) * SECTORS));
        let mut distances = [UNKNOWN_CM; SECTORS];
        for (sector, distance_cm) in (from..to).zip(&mut distances) {
            let ago_s = self.sensor.turn_s * (to - 1 - sector) as f64 / sectors as f64;
            let earlier = motion.map(|motion| self.before(ago_s, motion));
            let (view, pillars) = match &earlier {
                Some(earlier) => (earlier, &earlier.in_range()),
                None => (self, &pillars),
            };
            let center_deg = first_deg + sector as f64 * width_deg;
            let nearest = (0..rays as usize)
                .map(|ray| center_deg + width_deg * ((ray as f64 + 0.5) / rays - 0.5))
                .filter_map(|azimuth_deg| view.hit(pillars, azimuth_deg))
                .map(|(_, distance)| distance)
                .min_by(f64::total_cmp);
            *distance_cm = match nearest.and_then(&mut measure) {
                Some(nearest_m) => (libm::rint(nearest_m * 100.0) as u16).clamp(NEAREST_CM, max_cm),
                None => max_cm + 1,
            };
        }
        OBSTACLE_DISTANCE_DATA {
            time_usec: time_us,
            sensor_type: MavDistanceSensor::MAV_DISTANCE_SENSOR_LASER as u8,
            distances,
            increment: 0,
            min_distance: NEAREST_CM,
            max_distance: max_cm,
            increment_f: width_deg as f32,
            angle_offset: (first_deg + from as f64 * width_deg) as f32,
            frame: MavFrame::MAV_FRAME_BODY_FRD as u8,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Scenario, SensorModel};
    use crate::world::random::Random;

    fn world(pillars: &[[f64; 3]]) -> World {
        let obstacles =
            pillars.iter().map(|[x, y, r]| scenario::Obstacle { x: *x, y: *y, r: *r, ..Default::default() });
        Scenario { obstacles: obstacles.collect(), ..Scenario::default() }.world()
    }

    fn view<'a>(world: &'a World, yaw_deg: f64, fov_deg: f64, occlusion: bool) -> View<'a> {
        View {
            world,
            time_s: 0.0,
            position: Horizontal { north: 0.0, east: 0.0 },
            yaw_rad: yaw_deg.to_radians(),
            sensor: scenario::Sensor {
                fov_deg,
                range_m: 3.0,
                occlusion,
                model: SensorModel::Scan,
                ..scenario::Sensor::default()
            },
        }
    }

    #[test]
    fn a_pillar_dead_ahead_is_seen_at_its_surface_by_the_middle_sectors_only() {
        // North is y; half the angle that r = 0.3 at 2 m covers is asin(0.15) = 8.63 deg.
        let world = world(&[[0.0, 2.0, 0.3]]);
        let scan = view(&world, 0.0, 90.0, true).scan(7).next().unwrap();
        assert_eq!(scan.time_usec, 7);
        assert_eq!((scan.increment_f, scan.angle_offset), (1.25, -44.375));
        assert_eq!((scan.max_distance, scan.frame), (300, 12));
        for (sector, distance) in scan.distances.iter().enumerate() {
            let azimuth = f64::from(scan.angle_offset) + 1.25 * sector as f64;
            if azimuth.abs() > 8.7 {
                assert_eq!(*distance, 301, "clear at {azimuth} deg");
            } else {
                // Law of cosines.
                let along = 2.0 * azimuth.to_radians().cos();
                let expected = along - (along * along - 4.0 + 0.09).sqrt();
                assert!((f64::from(*distance) / 100.0 - expected).abs() <= 0.005 + 1e-9, "at {azimuth} deg");
            }
        }
    }

    #[test]
    fn azimuth_runs_clockwise_from_the_nose() {
        let world = world(&[[2.0, 2.0, 0.2]]);
        let hit_deg = |yaw_deg: f64| {
            let scan = view(&world, yaw_deg, 90.0, true).scan(0).next().unwrap();
            let hits: Vec<f64> = (0..SECTORS).filter(|k| scan.distances[*k] <= 300).map(|k| k as f64).collect();
            f64::from(scan.angle_offset) + 1.25 * hits.iter().sum::<f64>() / hits.len() as f64
        };
        assert!((hit_deg(20.0) - 25.0).abs() < 0.7, "north-east is to the right of a nose at 20 deg");
        assert!((hit_deg(70.0) + 25.0).abs() < 0.7);
    }

    #[test]
    fn a_full_circle_of_sectors_misses_no_thin_pillar() {
        // 5 deg sectors: a ray in the middle of each would miss this 1.9 deg wide pillar between two of them.
        let bearing = 45.0_f64.to_radians();
        let world = world(&[[3.0 * bearing.sin(), 3.0 * bearing.cos(), 0.05]]);
        let scan = view(&world, 0.0, 360.0, true).scan(0).next().unwrap();
        assert!(scan.distances.iter().any(|distance| *distance <= 300));
    }

    #[test]
    fn inside_a_pillar_the_distance_is_the_smallest_that_is_not_zero() {
        let world = world(&[[0.1, 0.0, 0.5]]);
        assert!(
            view(&world, 0.0, 90.0, true)
                .scan(0)
                .next()
                .unwrap()
                .distances
                .iter()
                .all(|distance| *distance == NEAREST_CM)
        );
    }

    #[test]
    fn circles_are_exact_and_hidden_far_or_sideways_ones_are_left_out() {
        let world = world(&[[0.0, 1.5, 0.3], [0.0, 2.5, 0.2], [0.0, 4.0, 0.3], [2.0, 0.0, 0.3], [0.9, 1.9, 0.1]]);
        let seen = view(&world, 0.0, 90.0, true).circles();
        let centers: Vec<(f32, f32)> = seen.iter().map(|c| (c.center_ned_m.east, c.center_ned_m.north)).collect();
        assert_eq!(centers, [(0.0, 1.5), (0.9, 1.9)]);
        assert_eq!(seen[0].radius_m, 0.3);
        let through = view(&world, 0.0, 90.0, false).circles();
        assert_eq!(through.len(), 3, "without occlusion the one behind is seen too");
    }

    #[test]
    fn moving_pillars_are_seen_where_they_are_now() {
        let mut world = world(&[[0.0, 2.0, 0.3]]);
        world.pillars[0].velocity_mps = Horizontal { north: 0.0, east: 1.0 };
        let mut look = view(&world, 90.0, 90.0, true);
        assert!(look.circles().is_empty());
        look.time_s = 2.0;
        let seen = look.circles();
        assert_eq!((seen[0].center_ned_m.east, seen[0].velocity_ned_mps.east), (2.0, 1.0));
    }

    #[test]
    fn a_fine_scan_comes_in_messages_whose_angles_continue_each_other() {
        let world = world(&[[0.0, 2.0, 0.3]]);
        let mut look = view(&world, 0.0, 360.0, true);
        look.sensor.rays = 300;
        let messages: Vec<_> = look.scan(7).collect();
        assert_eq!(messages.len(), 5);
        for (index, message) in messages.iter().enumerate() {
            assert!((f64::from(message.angle_offset) - (-179.4 + 1.2 * 72.0 * index as f64)).abs() < 1e-4);
            assert_eq!(message.increment_f, 1.2);
        }
        let known = |message: &OBSTACLE_DISTANCE_DATA| message.distances.iter().filter(|cm| **cm != u16::MAX).count();
        assert_eq!(messages.iter().map(known).collect::<Vec<_>>(), [72, 72, 72, 72, 12]);
    }

    #[test]
    fn a_sensor_that_turns_sees_each_way_from_where_the_vehicle_is_by_then() {
        // One pillar astern, which the first and the last ray see, is enough.
        let world = world(&[[0.0, -2.0, 0.3]]);
        let mut look = view(&world, 0.0, 360.0, true);
        (look.sensor.rays, look.sensor.turn_s) = (360, 0.1);
        let mut exact = Ranging::new(&look.sensor, Random::new(1, 6));
        let motion = Motion { velocity_ned_mps: [2.0, 0.0, 0.0], yaw_rate_radps: 0.0, ..Motion::default() };
        let sent: Vec<usize> =
            (0..5).map(|tick| look.scan_in_turn(tick, 5, 0.02, 0, &motion, &mut exact).count()).collect();
        assert_eq!(sent, [1; 5], "one a tick");
        // Seen at the end of the turn, and 20 ms before its own end at the begin of the last message.
        let last = look.scan_in_turn(0, 5, 0.02, 0, &motion, &mut exact).next().unwrap();
        assert_eq!(last.distances[71], 170);
        let first = look.scan_in_turn(1, 5, 0.02, 0, &motion, &mut exact).next().unwrap();
        assert_eq!(first.distances[0], 166, "19.7 ms before at 2 m/s");
        look.sensor.turn_s = 0.0;
        let sent: Vec<usize> =
            (0..5).map(|tick| look.scan_in_turn(tick, 5, 0.02, 0, &motion, &mut exact).count()).collect();
        assert_eq!(sent, [5, 0, 0, 0, 0], "all at once");
    }
}
