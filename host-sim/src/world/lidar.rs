//! A lidar on a serial line of its own, like the LDROBOT LD06 and LD19: 4500 points a second, ten turns of 360
//! degrees a second, in frames of twelve points ([`foxhound_computer::lidar`] reads them).
//!
//! It is mounted upright, its arrow along the nose. Each point is measured from the vehicle's position at its time,
//! by straight motion before the step. Without an object within its range it reports 0. Outside the field of view it
//! sees the vehicle itself.

use foxhound_computer::lidar::{FRAME_BYTES, POINTS, crc8};

use super::ranging::Ranging;
use super::sensor::View;
use super::vehicle::Motion;

const POINTS_PER_S: u64 = 4500;
const SPEED_DEG_PER_S: u16 = 3600;
const STEP_CDEG: u64 = 80;
const TURN_CDEG: u64 = 36_000;
/// Period of its millisecond clock.
const CLOCK_MS: u64 = 30_000;
/// Distance that it reports for the vehicle itself.
const VEHICLE_MM: u16 = 50;
const CONFIDENCE: u8 = 200;
const _: () = assert!(TURN_CDEG / STEP_CDEG * SPEED_DEG_PER_S as u64 / 360 == POINTS_PER_S);

/// A rotating lidar.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lidar {
    /// Frames since the start.
    frames: u64,
}

impl Lidar {
    /// The frames that are complete by the time of this view and were not before. A blind one sends nothing, but
    /// keeps turning.
    pub fn turn(&mut self, view: &View<'_>, motion: &Motion, ranging: &mut Ranging, is_blind: bool) -> Vec<u8> {
        let complete = (view.time_s * POINTS_PER_S as f64 + 1e-6) as u64 / POINTS as u64;
        let frames = self.frames..complete.max(self.frames);
        self.frames = frames.end;
        if is_blind {
            return Vec::new();
        }
        frames.flat_map(|frame| encode(frame, |point| see(view, motion, ranging, point))).collect()
    }
}

fn angle_cdeg(point: u64) -> u64 {
    point * STEP_CDEG % TURN_CDEG
}

/// A point, counted from the start: millimetres and confidence.
fn see(view: &View<'_>, motion: &Motion, ranging: &mut Ranging, point: u64) -> (u16, u8) {
    let ago_s = view.time_s - point as f64 / POINTS_PER_S as f64;
    let azimuth_deg = (angle_cdeg(point) as f64 / 100.0 + 180.0) % 360.0 - 180.0;
    if azimuth_deg.abs() > 0.5 * view.sensor.fov_deg {
        return (VEHICLE_MM, CONFIDENCE);
    }
    let nearest_m = view.before(ago_s, motion).nearest_m(azimuth_deg);
    match nearest_m.and_then(|nearest_m| ranging.measure(nearest_m)) {
        Some(nearest_m) => ((libm::rint(nearest_m * 1000.0) as u16).max(1), CONFIDENCE),
        None => (0, 0),
    }
}

/// A frame, counted from the start.
fn encode(frame: u64, point: impl FnMut(u64) -> (u16, u8)) -> [u8; FRAME_BYTES] {
    let points = frame * POINTS as u64..(frame + 1) * POINTS as u64;
    let mut bytes = [0; FRAME_BYTES];
    let mut put = |at: usize, word: u64| bytes[at..at + 2].copy_from_slice(&(word as u16).to_le_bytes());
    put(2, u64::from(SPEED_DEG_PER_S));
    put(4, angle_cdeg(points.start));
    put(42, angle_cdeg(points.end - 1));
    put(44, points.end * 1000 / POINTS_PER_S % CLOCK_MS);
    (bytes[0], bytes[1]) = (0x54, 0x2C);
    for (slot, (distance_mm, confidence)) in bytes[6..42].chunks_mut(3).zip(points.map(point)) {
        slot[..2].copy_from_slice(&distance_mm.to_le_bytes());
        slot[2] = confidence;
    }
    bytes[FRAME_BYTES - 1] = crc8(&bytes[..FRAME_BYTES - 1]);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Obstacle, Scenario, Sensor, SensorModel};
    use crate::world::Horizontal;
    use crate::world::random::Random;
    use foxhound_computer::lidar;
    use foxhound_core::base::time::Instant;
    use foxhound_core::mapping::scan::Sector;

    const STEP_S: f64 = 0.02;

    /// The flight computer's result after some steps in a world: its last scan.
    fn scan(obstacles: &[[f64; 3]], yaw_deg: f64, fov_deg: f64, steps: u64) -> foxhound_core::mapping::scan::Scan {
        let obstacles = obstacles.iter().map(|[x, y, r]| Obstacle { x: *x, y: *y, r: *r, ..Default::default() });
        let world = Scenario { obstacles: obstacles.collect(), ..Scenario::default() }.world();
        let sensor = Sensor { fov_deg, range_m: 5.0, model: SensorModel::Lidar, ..Sensor::default() };
        let (mut simulated, mut read) = (Lidar::default(), lidar::Config::default().build().unwrap());
        let mut exact = Ranging::new(&sensor, Random::new(1, 6));
        let mut scan = None;
        for step in 1..=steps {
            let time_s = step as f64 * STEP_S;
            let position = Horizontal { north: 0.0, east: 0.0 };
            let view = View { world: &world, time_s, position, yaw_rad: yaw_deg.to_radians(), sensor };
            let bytes = simulated.turn(&view, &Motion::default(), &mut exact, false);
            assert!((7..=8).contains(&(bytes.len() / FRAME_BYTES)), "375 frames a second");
            read.push(Instant((time_s * 1e6) as u64), &bytes);
            scan = read.scan().cloned().or(scan);
            read.take();
        }
        assert_eq!(read.counters().bad, 0);
        assert_eq!(u64::from(read.counters().frames), steps * 15 / 2);
        scan.unwrap()
    }

    fn hits_deg(scan: &foxhound_core::mapping::scan::Scan) -> Vec<(f64, f32)> {
        let hit = |(ray, sector)| match sector {
            Sector::Hit(range_m) => Some((f64::from(scan.first_azimuth_rad).to_degrees() + ray as f64, range_m)),
            _ => None,
        };
        scan.rays.iter().enumerate().filter_map(hit).collect()
    }

    #[test]
    fn what_it_says_is_read_back_where_it_is() {
        // North-east, to the right of a nose at 20 deg by 25.
        let scan = scan(&[[2.0, 2.0, 0.2]], 20.0, 360.0, 16);
        let hits = hits_deg(&scan);
        let middle_deg = hits.iter().map(|(deg, _)| deg).sum::<f64>() / hits.len() as f64;
        assert!((middle_deg - 25.0).abs() < 0.6, "{middle_deg}");
        let nearest_m = hits.iter().map(|(_, range_m)| *range_m).fold(9.0, f32::min);
        assert!((nearest_m - (8.0_f32.sqrt() - 0.2)).abs() < 0.002, "{nearest_m}");
        // Half the angle that it covers is asin(0.2 / 2.83) = 4.05 deg.
        assert!((8..=9).contains(&hits.len()), "{}", hits.len());
        assert_eq!(scan.rays.iter().filter(|sector| *sector == Sector::Clear).count(), 360 - hits.len());
    }

    #[test]
    fn out_of_its_view_is_the_vehicle_and_nothing_is_known() {
        let scan = scan(&[[0.0, 2.0, 0.3], [0.0, -2.0, 0.3]], 0.0, 180.0, 16);
        let unknown = scan.rays.iter().filter(|sector| *sector == Sector::Unknown).count();
        assert!((178..=181).contains(&unknown), "{unknown}");
        assert!(hits_deg(&scan).iter().all(|(deg, _)| *deg < 10.0 || *deg > 350.0));
    }
}
