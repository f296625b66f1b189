//! Which places the obstacle sensor has seen: the guard allows motion only into these.
//!
//! A sensor with a narrow field of view does not see obstacles beside it, and a moving disc comes nearer to everything
//! up to 90 degrees off its path. So the places that the obstacle sensor has seen are stored in a grid of bits around
//! the vehicle, which scrolls along with it (64 x 64 cells of 5 cm; cells that scroll in are unseen). For places
//! farther away the latest scan is kept unchanged.
//!
//! The question asked is not "is this cell empty" but "could an obstacle stand here unseen": an obstacle of at least
//! [`Config::smallest_obstacle_m`] radius cannot, if a ray has passed somewhere in it. So a place counts as seen when
//! one of the four cells nearest to it has been seen, and rays need not be denser than cells.
//!
//! - [`Cover::Seen`]: a ray has passed.
//! - [`Cover::Hidden`]: in the field of view of the latest scan, but behind an obstacle. Another scan from here does
//!   not help, only flying there slowly.
//! - [`Cover::WasHidden`]: hidden in an earlier scan, from another position. Another scan helps unless an obstacle is
//!   in front of it now.
//! - [`Cover::Unseen`]: never in the field of view.
//!
//! Cost: bench rows `look_64` for a scan, `guard_64` for a step with all its queries.

use micromath::F32;

use crate::base::config::RangeSensor;
use crate::base::error::{ConfigError, check};
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Neighbour;
use crate::base::pose::Pose;
use crate::base::units::{between, wrap_pi};
use crate::mapping::scan::{Ranges, SECTORS_MAX, Scan};

/// Number of cells along a side of the grid; a power of two.
const SIDE: i32 = 64;
/// Side of a cell.
const CELL_M: f32 = 0.05;
const CELLS_PER_M: f32 = 1.0 / CELL_M;
/// Largest range to which a scan is drawn, so that it stays inside the grid.
const DRAWN_M: f32 = 1.52;
/// Largest distance between the marks along a ray, and between rays: since a query checks four cells, it leaves no gap.
const STEP_M: f32 = 0.07;
/// Largest angle between the rays assumed in the field of view of a sensor that delivers circles.
const RAY_STEP_RAD: f32 = 0.045;
/// Positions farther from the origin than this are not represented in the grid.
const PLACE_MAX_M: f32 = 1e5;
/// What was seen from an altitude that differs by this was not seen.
const ALTITUDE_M: f32 = 0.5;

/// Configuration of the coverage grid.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Radius of the smallest obstacle that must not be overlooked.
    pub smallest_obstacle_m: f32,
    /// Clearance from unseen obstacles that is assumed where the vehicle is first asked to move.
    pub start_clearance_m: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { smallest_obstacle_m: 0.075, start_clearance_m: 0.03 }
    }
}

impl Config {
    /// Checks the configuration. The sensor is one that delivers circles.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self, sensor: &RangeSensor) -> Result<Surveyor, ConfigError> {
        check("coverage.smallest_obstacle_m", self.smallest_obstacle_m, 0.05, 1.0)?;
        check("coverage.start_clearance_m", self.start_clearance_m, 0.0, 1.0)?;
        sensor.check()?;
        let rays = libm::ceilf(sensor.fov_rad / RAY_STEP_RAD) as usize;
        Ok(Surveyor { config: *self, sensor: *sensor, rays: rays.clamp(8, SECTORS_MAX) })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surveyor {
    config: Config,
    sensor: RangeSensor,
    rays: usize,
}

/// Coverage of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Cover {
    /// A ray of the sensor has passed.
    Seen,
    /// In the field of view of the latest scan, but behind an obstacle.
    Hidden,
    /// In the field of view of an earlier scan, but behind an obstacle.
    WasHidden,
    /// Never in the field of view.
    Unseen,
}

/// The latest scan: the range of each ray.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Profile {
    /// Position of the sensor.
    pub(crate) origin_ned_m: Horizontal,
    /// Azimuth of the middle of the first ray, from north.
    pub(crate) first_ned_rad: f32,
    /// Angle from one ray to the next.
    pub(crate) step_rad: f32,
    /// Number of rays, and whether they cover a full turn.
    pub(crate) rays: u8,
    /// See `rays`.
    pub(crate) closes: bool,
    /// Range assigned to a ray that hits nothing.
    pub(crate) range_m: f32,
    /// Range of each ray.
    pub(crate) ranges: Ranges,
}

impl Profile {
    /// Range of a ray; -1 where nothing is known.
    fn seen_m(&self, index: usize) -> f32 {
        self.ranges.sees_m(index, self.range_m)
    }
}

/// The bits of the grid, two words for each row.
type Bits = [[u32; 2]; SIDE as usize];

/// Which places have been seen so far.
#[derive(Clone, Debug)]
pub struct Coverage {
    seen: Bits,
    hidden: Bits,
    /// The cell at the south-west corner of the grid, counted from the origin.
    corner: (i32, i32),
    /// Position of the vehicle when it was first asked to move.
    home_ned_m: Option<Horizontal>,
    /// The vehicle's cell, if the area under the vehicle is marked.
    stood: Option<(i32, i32)>,
    /// The altitude at which it was seen, if it may change.
    down_m: Option<f32>,
    latest: Profile,
}

impl Default for Coverage {
    fn default() -> Self {
        Self {
            seen: [[0; 2]; SIDE as usize],
            hidden: [[0; 2]; SIDE as usize],
            corner: (0, 0),
            home_ned_m: None,
            stood: None,
            down_m: None,
            latest: Profile {
                origin_ned_m: Horizontal::default(),
                first_ned_rad: 0.0,
                step_rad: RAY_STEP_RAD,
                rays: 0,
                closes: false,
                range_m: 0.0,
                ranges: Ranges::new(),
            },
        }
    }
}

/// Row, word and bit of a cell; indices wrap around.
fn bit(north: i32, east: i32) -> (usize, usize, u32) {
    let column = east & (SIDE - 1);
    ((north & (SIDE - 1)) as usize, (column / 32) as usize, 1 << (column % 32))
}

/// Whether one of four cells is marked: this one, its neighbours to the north and to the east, and the one to the
/// north-east.
fn is_one_marked(bits: &Bits, north: i32, east: i32) -> bool {
    let row = |north: i32| bits[(north & (SIDE - 1)) as usize];
    let (at, above) = (row(north), row(north + 1));
    let [low, high] = [0, 1].map(|word| u64::from(at[word] | above[word]));
    (low | high << 32).rotate_right(east as u32 % SIDE as u32) & 0b11 != 0
}

impl Coverage {
    /// Whether there has been any scan.
    #[must_use]
    pub fn has_scanned(&self) -> bool {
        self.latest.rays > 0
    }

    /// The latest scan.
    #[cfg(test)]
    pub(crate) fn latest(&self) -> &Profile {
        &self.latest
    }

    /// Whether any place counts as seen.
    #[cfg(test)]
    pub(crate) fn has_seen(&self) -> bool {
        self.seen != [[0; 2]; SIDE as usize]
    }

    /// Someone else flies the vehicle: the position where it is next asked to move is a new start.
    pub fn leave(&mut self) {
        self.home_ned_m = None;
    }

    /// The vehicle's altitude: at another one nothing has been seen.
    pub fn level(&mut self, down_m: Option<f32>) {
        let Some(down_m) = down_m.filter(|down_m| down_m.is_finite()) else { return };
        if libm::fabsf(down_m - *self.down_m.get_or_insert(down_m)) >= ALTITUDE_M {
            self.forget();
            self.down_m = Some(down_m);
        }
    }

    /// Nothing has been seen; that there is a sensor is still known.
    #[inline(never)]
    pub(crate) fn forget(&mut self) {
        (self.seen, self.hidden) = ([[0; 2]; SIDE as usize], [[0; 2]; SIDE as usize]);
        self.stood = None;
        self.latest.ranges = Ranges::new();
    }

    fn contains(&self, north: i32, east: i32) -> bool {
        let inside = |at: i32, corner: i32| at > corner && at < corner + SIDE - 1;
        inside(north, self.corner.0) && inside(east, self.corner.1)
    }

    /// Scrolls the grid so that the given cell is in its middle.
    fn center(&mut self, north: i32, east: i32) {
        let corner = (north - SIDE / 2, east - SIDE / 2);
        let (rows, columns) = (corner.0 - self.corner.0, corner.1 - self.corner.1);
        if rows.abs() >= SIDE || columns.abs() >= SIDE {
            self.seen = [[0; 2]; SIDE as usize];
            self.hidden = [[0; 2]; SIDE as usize];
        } else {
            // When scrolling forwards, the new rows are those past the old end; backwards, those before the old
            // beginning.
            let first = if rows > 0 { self.corner.0 } else { corner.0 };
            for row in first..first + rows.abs() {
                let (row, ..) = bit(row, 0);
                (self.seen[row], self.hidden[row]) = ([0; 2], [0; 2]);
            }
            let first = if columns > 0 { self.corner.1 } else { corner.1 };
            let mut stay = [u32::MAX; 2];
            for column in first..first + columns.abs() {
                let (_, word, mask) = bit(0, column);
                stay[word] &= !mask;
            }
            if columns != 0 {
                for row in self.seen.iter_mut().chain(&mut self.hidden) {
                    *row = [row[0] & stay[0], row[1] & stay[1]];
                }
            }
        }
        self.corner = corner;
    }
}

/// The cell of a place; `None` too far from the origin.
fn cell(place: Horizontal) -> Option<(i32, i32)> {
    let sane = libm::fabsf(place.north) < PLACE_MAX_M && libm::fabsf(place.east) < PLACE_MAX_M;
    // Rounded down, in fewer instructions than `floorf`.
    let index = |x: f32| {
        let cells = x * CELLS_PER_M;
        cells as i32 - i32::from(cells < (cells as i32) as f32)
    };
    sane.then(|| (index(place.north), index(place.east)))
}

/// The bearing of a direction within 0.003 rad, a sixth of a ray of the default scan: obstacles 1 cm wider or narrower
/// at three metres.
fn bearing_rad(away: Horizontal) -> f32 {
    F32(away.east).atan2(F32(away.north)).0
}

impl Surveyor {
    /// Radius of the smallest obstacle that must not be overlooked.
    #[must_use]
    pub fn smallest_obstacle_m(&self) -> f32 {
        self.config.smallest_obstacle_m
    }

    /// Processes a scan. With `loses_rays`, what a ray beside a hit sees through may be an obstacle.
    pub fn note_scan(&self, coverage: &mut Coverage, scan: &Scan, pose: &Pose, loses_rays: bool) {
        if !scan.is_plausible() {
            return;
        }
        let (latest, sectors) = (&mut coverage.latest, scan.in_sectors(SECTORS_MAX));
        latest.step_rad = sectors.step_rad;
        latest.first_ned_rad = wrap_pi(pose.yaw_rad + sectors.first_azimuth_rad);
        latest.rays = sectors.turn().unwrap_or(sectors.count()) as u8;
        latest.closes = sectors.turn().is_some();
        latest.range_m = scan.range_max_m;
        latest.ranges.take(scan);
        if loses_rays {
            latest.ranges.close_gaps(usize::from(latest.rays));
        }
        coverage.latest.origin_ned_m = pose.position_ned_m;
        self.draw(coverage);
    }

    /// Processes a delivery of circles: the sensor saw its whole field of view, up to the known obstacles.
    /// `vehicle_radius_m` is the part of their reach that belongs to the vehicle.
    pub fn note_circles(&self, coverage: &mut Coverage, obstacles: &[Neighbour], vehicle_radius_m: f32, pose: &Pose) {
        let latest = &mut coverage.latest;
        latest.rays = self.rays as u8;
        latest.closes = self.sensor.fov_rad > 6.2;
        latest.step_rad = self.sensor.fov_rad / self.rays as f32;
        let first_rad = 0.5 * (latest.step_rad - self.sensor.fov_rad);
        latest.first_ned_rad = wrap_pi(pose.yaw_rad + first_rad);
        let mut seen_m = [self.sensor.range_m; SECTORS_MAX];
        for obstacle in obstacles {
            let away = obstacle.center_ned_m.minus(pose.position_ned_m);
            let radius_m = obstacle.reach_m - vehicle_radius_m;
            let (squared, reach_m) = (away.norm_squared(), self.sensor.range_m);
            // Up to where a ray would touch it: places nearer than that, but behind its face, are inside it.
            let tangent = squared - radius_m * radius_m;
            if !(tangent > 1e-4) || tangent > reach_m * reach_m {
                continue;
            }
            let tangent_m = sqrt(tangent);
            let middle = wrap_pi(bearing_rad(away) - latest.first_ned_rad) / latest.step_rad;
            let half = F32(radius_m).atan2(F32(tangent_m)).0 / latest.step_rad;
            let (low, high) = (libm::ceilf(middle - half) as i32, libm::floorf(middle + half) as i32);
            let turn = libm::roundf(core::f32::consts::TAU / latest.step_rad) as i32;
            for index in low..=high {
                let index = if index < 0 {
                    index + turn
                } else if index >= turn {
                    index - turn
                } else {
                    index
                };
                if let Some(seen_m) = usize::try_from(index).ok().and_then(|index| seen_m.get_mut(index))
                    && tangent_m < *seen_m
                {
                    *seen_m = tangent_m;
                }
            }
        }
        latest.range_m = self.sensor.range_m;
        for (index, seen_m) in seen_m.into_iter().enumerate() {
            latest.ranges.set_m(index, seen_m);
        }
        coverage.latest.origin_ned_m = pose.position_ned_m;
        self.draw(coverage);
    }

    /// Draws the latest scan into the grid.
    fn draw(&self, coverage: &mut Coverage) {
        let Some((north, east)) = cell(coverage.latest.origin_ned_m) else { return };
        coverage.center(north, east);
        let Coverage { seen, hidden, corner, latest, .. } = coverage;

        // A wide field of view is drawn less far, so that every scan costs the same, and only as far as its rays are
        // dense enough.
        let step_rad = libm::fabsf(latest.step_rad);
        let angle_rad = step_rad * f32::from(latest.rays);
        let by_cost = if angle_rad > 1.65 { DRAWN_M * sqrt(1.65 / angle_rad) } else { DRAWN_M };
        let by_gaps = 0.14 / step_rad;
        let drawn_m = if by_cost < by_gaps { by_cost } else { by_gaps };

        // In cells from the corner, so that it is never negative.
        let from_north = latest.origin_ned_m.north * CELLS_PER_M - corner.0 as f32;
        let from_east = latest.origin_ned_m.east * CELLS_PER_M - corner.1 as f32;
        for index in 0..usize::from(latest.rays) {
            // Near the sensor the rays are denser than needed: there only every second, fourth, eighth is drawn.
            let stride = if index == 0 { 8 } else { 1 << index.trailing_zeros().min(3) };
            let mut at_m = if stride == 8 { STEP_M } else { STEP_M / (step_rad * (2 * stride) as f32) };
            let seen_m = latest.seen_m(index);
            if !(seen_m >= 0.0) {
                continue;
            }
            let direction = Horizontal::from_bearing(latest.first_ned_rad + latest.step_rad * index as f32);
            while at_m < drawn_m {
                let row = (from_north + at_m * CELLS_PER_M * direction.north) as i32 + corner.0;
                let column = (from_east + at_m * CELLS_PER_M * direction.east) as i32 + corner.1;
                let (row, word, mask) = bit(row, column);
                if at_m <= seen_m + CELL_M {
                    seen[row][word] |= mask;
                } else {
                    hidden[row][word] |= mask;
                }
                at_m += STEP_M;
            }
        }
    }

    /// Marks the area under the vehicle as free: the vehicle fits there.
    pub fn stand(&self, coverage: &mut Coverage, position_ned_m: Horizontal, vehicle_radius_m: f32) {
        let Some((north, east)) = cell(position_ned_m) else { return };
        if coverage.has_scanned() {
            coverage.home_ned_m.get_or_insert(position_ned_m);
        }
        if coverage.stood.replace((north, east)) == Some((north, east)) {
            return;
        }
        if !coverage.contains(north, east) {
            coverage.center(north, east);
        }
        let span = (libm::floorf(vehicle_radius_m * CELLS_PER_M) as i32).clamp(0, 6);
        for row in -span..=span {
            for column in -span..=span {
                if row * row + column * column <= span * span && coverage.contains(north + row, east + column) {
                    let (row, word, mask) = bit(north + row, east + column);
                    coverage.seen[row][word] |= mask;
                }
            }
        }
    }

    /// Coverage of a place.
    #[must_use]
    pub fn cover(&self, coverage: &Coverage, place: Horizontal) -> Cover {
        let mut was_hidden = false;
        // The first of the four cells whose common corner is nearest.
        let first = place.minus(Horizontal { north: 0.5 * CELL_M, east: 0.5 * CELL_M });
        if let Some((north, east)) = cell(first)
            && coverage.contains(north, east)
        {
            if is_one_marked(&coverage.seen, north, east) {
                return Cover::Seen;
            }
            was_hidden = is_one_marked(&coverage.hidden, north, east);
        }
        match self.in_latest(&coverage.latest, place) {
            Cover::Unseen if was_hidden => Cover::WasHidden,
            cover => cover,
        }
    }

    /// Whether a place is so close to the start that an unknown obstacle there is excluded by `start_clearance_m`.
    #[must_use]
    pub fn is_at_home(&self, coverage: &Coverage, place: Horizontal, vehicle_radius_m: f32) -> bool {
        let reach_m = vehicle_radius_m + self.config.smallest_obstacle_m + self.config.start_clearance_m;
        coverage.home_ned_m.is_none_or(|home| place.minus(home).norm_squared() < reach_m * reach_m)
    }

    /// Coverage of a place by the latest scan.
    fn in_latest(&self, latest: &Profile, place: Horizontal) -> Cover {
        let away = place.minus(latest.origin_ned_m);
        let squared = away.norm_squared();
        let size_m = 0.7 * self.config.smallest_obstacle_m;
        if latest.rays == 0 || squared < size_m * size_m {
            return Cover::Unseen;
        }
        let distance_m = sqrt(squared);
        // Relative to the middle ray, so that a direction left of the first ray is not wrapped by a full turn.
        let middle = 0.5 * f32::from(latest.rays - 1);
        let off_rad = wrap_pi(bearing_rad(away) - latest.first_ned_rad - middle * latest.step_rad);
        let index = off_rad / latest.step_rad + middle;
        // The view is extended by the resolution of the grid.
        let slack = 0.5 * CELL_M / (distance_m * libm::fabsf(latest.step_rad));
        let last = f32::from(latest.rays - 1);
        if !latest.closes && (index < -slack || index > last + slack) {
            return Cover::Unseen;
        }
        let nearest = (between(index, 0.0, last) + 0.5) as usize;
        match latest.seen_m(nearest) {
            seen_m if !(seen_m >= 0.0) => Cover::Unseen,
            seen_m if seen_m + size_m >= distance_m => Cover::Seen,
            _ => Cover::Hidden,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::scan::Sector;

    fn at(north: f32, east: f32) -> Horizontal {
        Horizontal { north, east }
    }

    fn surveyor() -> Surveyor {
        Config::default().build(&RangeSensor::DEFAULT).unwrap()
    }

    fn pose(north: f32, east: f32, yaw_rad: f32) -> Pose {
        Pose { position_ned_m: at(north, east), yaw_rad }
    }

    fn scan(sectors: [Sector; SECTORS_MAX]) -> Scan {
        let step_rad = core::f32::consts::FRAC_PI_2 / SECTORS_MAX as f32;
        Scan {
            time: crate::base::time::Instant(0),
            turn_s: 0.0,
            first_azimuth_rad: 0.5 * (step_rad - core::f32::consts::FRAC_PI_2),
            step_rad,
            range_max_m: 3.0,
            rays: sectors.into_iter().collect(),
        }
    }

    #[test]
    fn a_ray_lost_on_a_wall_shows_nothing_behind_it() {
        let (surveyor, mut coverage) = (surveyor(), Coverage::default());
        let mut rng = crate::base::rng::Rng::new(31, 0);
        for _ in 0..40 {
            let sectors = core::array::from_fn(|k| match k {
                0..36 => Sector::Clear,
                _ if rng.uniform() < 0.1 => Sector::Clear,
                _ => Sector::Hit(0.8),
            });
            surveyor.note_scan(&mut coverage, &scan(sectors), &pose(0.0, 0.0, 0.0), true);
            for tenth_deg in -420..420 {
                let azimuth_deg = 0.1 * tenth_deg as f32;
                for distance_m in [1.0, 1.3, 2.0] {
                    let place = Horizontal::from_bearing(azimuth_deg.to_radians()).times(distance_m);
                    let cover = surveyor.cover(&coverage, place);
                    if azimuth_deg < -8.0 {
                        assert_eq!(cover, Cover::Seen, "{azimuth_deg} {distance_m}");
                    } else if azimuth_deg > 4.0 {
                        assert_ne!(cover, Cover::Seen, "{azimuth_deg} {distance_m}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_view_is_seen_its_shadows_are_hidden_and_the_rest_is_unseen() {
        let (surveyor, mut coverage) = (surveyor(), Coverage::default());
        assert!(!coverage.has_scanned());
        // A wall on the right half, one metre away.
        let sectors = core::array::from_fn(|k| if k < 36 { Sector::Clear } else { Sector::Hit(1.0) });
        surveyor.note_scan(&mut coverage, &scan(sectors), &pose(20.0, -7.0, 0.3), false);
        assert!(coverage.has_scanned());
        let cover = |azimuth_deg: f32, distance_m: f32| {
            let place = Horizontal::from_bearing(0.3 + azimuth_deg.to_radians()).times(distance_m);
            surveyor.cover(&coverage, at(20.0, -7.0).plus(place))
        };
        for distance_m in [0.2, 0.5, 0.9, 1.4, 2.0, 2.9] {
            assert_eq!(cover(-20.0, distance_m), Cover::Seen, "{distance_m}");
            assert_eq!(cover(180.0, distance_m), Cover::Unseen, "{distance_m}");
            assert_eq!(cover(-90.0, distance_m), Cover::Unseen, "{distance_m}");
        }
        assert_eq!(cover(30.0, 0.9), Cover::Seen);
        assert_eq!(cover(25.0, 1.3), Cover::Hidden);
        assert_eq!(cover(25.0, 2.5), Cover::Hidden);
        assert_eq!(cover(-20.0, 3.5), Cover::Hidden, "out of range, though in view");
    }

    #[test]
    fn a_smallest_obstacle_that_counts_as_seen_is_met_by_a_ray() {
        // The guarantee of this module, over many places, yaws and positions relative to the cells.
        let surveyor = surveyor();
        let mut rng = crate::base::rng::Rng::new(5, 8);
        let (mut seen, mut unseen) = (0, 0);
        for _ in 0..300 {
            let mut coverage = Coverage::default();
            let here = pose(10.0 * rng.uniform(), 10.0 * rng.uniform(), 6.0 * rng.uniform());
            surveyor.note_scan(&mut coverage, &scan([Sector::Clear; SECTORS_MAX]), &here, false);
            for _ in 0..100 {
                let azimuth = core::f32::consts::TAU * rng.uniform() - core::f32::consts::PI;
                let distance = 0.25 + 1.2 * rng.uniform();
                let place = here.position_ned_m.plus(Horizontal::from_bearing(here.yaw_rad + azimuth).times(distance));
                // Distance of the nearer edge of the view from its centre, in f64.
                let off = (f64::from(azimuth).abs() - core::f64::consts::FRAC_PI_4).max(0.0);
                let misses_m = f64::from(distance) * if off < 1.57 { off.sin() } else { 1.0 };
                match surveyor.cover(&coverage, place) {
                    Cover::Seen => {
                        assert!(misses_m < 0.12, "{azimuth} {distance}: {misses_m}");
                        seen += 1;
                    }
                    _ => {
                        assert!(misses_m > 0.0, "{azimuth} {distance}: in plain view");
                        unseen += 1;
                    }
                }
            }
        }
        assert!(seen > 3000 && unseen > 3000);
    }

    #[test]
    fn the_cheap_bearing_is_within_a_sixth_of_a_ray() {
        for k in 0..100_000 {
            let away = Horizontal::from_bearing(k as f32 * 1e-4 - 5.0).times(0.1 + 3e-5 * k as f32);
            let error_rad = wrap_pi(bearing_rad(away) - away.bearing_rad());
            assert!(error_rad.abs() < 0.003, "{away:?}: {error_rad}");
        }
    }

    #[test]
    fn what_was_seen_is_remembered_while_it_is_near_and_forgotten_far_away() {
        let (surveyor, mut coverage) = (surveyor(), Coverage::default());
        let clear = scan([Sector::Clear; SECTORS_MAX]);
        surveyor.note_scan(&mut coverage, &clear, &pose(0.0, 0.0, 0.0), false);
        surveyor.note_scan(&mut coverage, &clear, &pose(0.0, 0.0, 3.0), false);
        assert_eq!(surveyor.cover(&coverage, at(0.8, 0.1)), Cover::Seen);
        // To the south and west and back: cells that were scrolled out are unseen again, and none wraps around.
        for step in 0..=60 {
            surveyor.stand(&mut coverage, at(-0.1 * step as f32, -0.07 * step as f32), 0.15);
        }
        assert_eq!(surveyor.cover(&coverage, at(-6.0, -4.2)), Cover::Seen, "where it is there is room");
        assert_eq!(surveyor.cover(&coverage, at(-6.0 + 0.8, -4.2)), Cover::Unseen);
        for step in (0..=60).rev() {
            surveyor.stand(&mut coverage, at(-0.1 * step as f32, -0.07 * step as f32), 0.15);
        }
        assert_eq!(surveyor.cover(&coverage, at(1.2, 0.0)), Cover::Unseen);
    }

    #[test]
    fn what_was_seen_from_another_altitude_is_unseen_and_the_sensor_is_still_known() {
        let (surveyor, mut coverage) = (surveyor(), Coverage::default());
        let clear = scan([Sector::Clear; SECTORS_MAX]);
        let cover = |coverage: &Coverage| [0.8, 2.5].map(|north| surveyor.cover(coverage, at(north, 0.1)));
        for (down_m, expected) in
            [(-15.0, Cover::Seen), (-14.8, Cover::Seen), (-14.4, Cover::Unseen), (-2.0, Cover::Unseen)]
        {
            coverage.level(Some(-15.0));
            surveyor.note_scan(&mut coverage, &clear, &pose(0.0, 0.0, 0.0), false);
            coverage.level(Some(down_m));
            coverage.level(None);
            assert_eq!(cover(&coverage), [expected; 2], "{down_m}");
            assert!(coverage.has_scanned());
        }
    }

    #[test]
    fn circles_throw_shadows() {
        let (surveyor, mut coverage) = (surveyor(), Coverage::default());
        let post = Neighbour { center_ned_m: at(1.0, 0.0), reach_m: 0.35, ..Neighbour::default() };
        surveyor.note_circles(&mut coverage, &[post], 0.15, &pose(0.0, 0.0, 0.0));
        assert_eq!(surveyor.cover(&coverage, at(0.6, 0.0)), Cover::Seen);
        assert_eq!(surveyor.cover(&coverage, at(1.4, 0.0)), Cover::Hidden);
        assert_eq!(surveyor.cover(&coverage, at(2.5, 0.0)), Cover::Hidden);
        assert_eq!(surveyor.cover(&coverage, at(1.4, 0.6)), Cover::Seen);
    }

    #[test]
    fn a_sensor_that_sees_all_round_leaves_nothing_unseen() {
        let surveyor =
            Config::default().build(&RangeSensor { fov_rad: core::f32::consts::TAU, ..RangeSensor::DEFAULT }).unwrap();
        let mut coverage = Coverage::default();
        surveyor.note_circles(&mut coverage, &[], 0.15, &pose(3.0, 3.0, 1.0));
        for degree in 0..360 {
            for distance_m in [0.3, 1.0, 2.0, 2.9] {
                let place = at(3.0, 3.0).plus(Horizontal::from_bearing((degree as f32).to_radians()).times(distance_m));
                assert_eq!(surveyor.cover(&coverage, place), Cover::Seen, "{degree} {distance_m}");
            }
        }
    }

    #[test]
    fn absurd_places_scans_and_circles_do_no_harm() {
        let (surveyor, mut coverage) = (surveyor(), Coverage::default());
        let wild = [f32::NAN, f32::INFINITY, -1e30, 1e9, -0.0];
        for north in wild {
            for east in wild {
                let mut absurd = scan([Sector::Hit(north); SECTORS_MAX]);
                absurd.first_azimuth_rad = east;
                surveyor.note_scan(&mut coverage, &absurd, &pose(north, east, north), false);
                let circle = Neighbour { center_ned_m: at(north, east), reach_m: east, ..Neighbour::default() };
                surveyor.note_circles(&mut coverage, &[circle], 0.15, &pose(east, 0.0, 0.0));
                surveyor.stand(&mut coverage, at(north, east), 0.15);
                let _ = surveyor.cover(&coverage, at(north, east));
            }
        }
        let no_range = RangeSensor { range_m: f32::NAN, ..RangeSensor::DEFAULT };
        assert_eq!(Config::default().build(&no_range).unwrap_err().field, "sensor.range_m");
    }
}
