//! The rays of a scan, two bytes each, and the same scan in sectors for stages that use fewer.

use super::{RAY_MAX_M, RAY_STEP_MAX_RAD, RAYS_MAX, SECTORS_MAX, Scan, Sector};
use crate::base::units::between;

const UNKNOWN: u16 = u16::MAX;
const CLEAR: u16 = u16::MAX - 1;
/// Marks a measurement that is impossible; it is refused where it is read.
const ABSURD: u16 = 0;
/// So many sectors beside a clear one tell whether its ray may have been lost.
const BESIDE: usize = 2;

/// Range of each ray of a scan, to the millimetre.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rays {
    ranges_mm: [u16; RAYS_MAX],
    count: u16,
}

impl Rays {
    /// Empty.
    #[must_use]
    pub const fn new() -> Self {
        Self { ranges_mm: [UNKNOWN; RAYS_MAX], count: 0 }
    }

    /// Sets the number of rays, [`RAYS_MAX`] at most; new ones are unknown.
    pub fn resize(&mut self, count: usize) {
        let old = self.len();
        self.count = count.min(RAYS_MAX) as u16;
        for index in old..self.len() {
            self.set(index, Sector::Unknown);
        }
    }

    /// Number of rays.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.count as usize
    }

    /// Whether it is empty.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Adds a ray; without effect when it is full.
    pub fn push(&mut self, sector: Sector) {
        if self.len() < RAYS_MAX {
            self.count += 1;
            self.set(self.len() - 1, sector);
        }
    }

    /// Sets a ray; without effect if it does not exist.
    pub fn set(&mut self, index: usize, sector: Sector) {
        if let Some(slot) = self.ranges_mm.get_mut(index).filter(|_| index < usize::from(self.count)) {
            *slot = match sector {
                Sector::Unknown => UNKNOWN,
                Sector::Clear => CLEAR,
                Sector::Hit(range_m) if range_m > 0.0 && range_m <= RAY_MAX_M => {
                    between(1000.0 * range_m + 0.5, 1.0, 1000.0 * RAY_MAX_M) as u16
                }
                Sector::Hit(_) => ABSURD,
            };
        }
    }

    /// Those that exist: behind them are those of an earlier scan.
    fn measured(&self) -> &[u16] {
        self.ranges_mm.get(..self.len()).unwrap_or_default()
    }

    /// A ray's measurement; unknown if it does not exist. A hit at 0 m stands for a measurement that was not valid.
    #[must_use]
    pub fn get(&self, index: usize) -> Sector {
        match self.measured().get(index).copied().unwrap_or(UNKNOWN) {
            UNKNOWN => Sector::Unknown,
            CLEAR => Sector::Clear,
            // A division, not a product with the inverse: so whole centimetres are restored bit for bit.
            range_mm => Sector::Hit(f32::from(range_mm) / 1000.0),
        }
    }

    /// Of every three rays the middle one, where the others hit at the same range, less than `near_m`, `alike_m` apart at most: how many
    /// see nothing, and how many something.
    pub(super) fn between_alike(&self, near_m: f32, alike_m: f32) -> (u32, u32) {
        let [near_mm, alike_mm] = [near_m, alike_m].map(|range_m| between(1000.0 * range_m, 0.0, 60_000.0) as u16);
        let (mut clear, mut hit) = (0, 0);
        for three in self.measured().chunks_exact(3) {
            let &[first, middle, last] = three else { continue };
            if first < near_mm && first.abs_diff(last) < alike_mm && first != ABSURD && last < CLEAR {
                clear += u32::from(middle == CLEAR);
                hit += u32::from(middle < CLEAR);
            }
        }
        (clear, hit)
    }

    /// Their measurements, in order.
    pub fn iter(&self) -> impl Iterator<Item = Sector> + '_ {
        (0..self.len()).map(|index| self.get(index))
    }
}

impl Default for Rays {
    fn default() -> Self {
        Self::new()
    }
}

impl FromIterator<Sector> for Rays {
    fn from_iter<I: IntoIterator<Item = Sector>>(sectors: I) -> Self {
        let mut rays = Self::new();
        sectors.into_iter().take(RAYS_MAX).for_each(|sector| rays.push(sector));
        rays
    }
}

/// A scan in sectors. Neighbouring rays are combined so that the number of sectors stays within a maximum. A sector's
/// hit is the nearest of its rays'; without a hit it is clear if more than half of its rays are. If the rays are few
/// enough, each is a sector.
#[derive(Clone, Copy, Debug)]
pub struct Sectors<'a> {
    scan: &'a Scan,
    rays_each: usize,
    /// Azimuth of the middle of sector 0, from the nose, clockwise positive.
    pub first_azimuth_rad: f32,
    /// Azimuth step from a sector to the next.
    pub step_rad: f32,
}

impl<'a> Sectors<'a> {
    #[inline(never)]
    pub(super) fn new(scan: &'a Scan, sectors_max: usize) -> Self {
        let rays_each = pieces(scan.rays.len(), sectors_max).max(1);
        Self {
            scan,
            rays_each,
            first_azimuth_rad: scan.first_azimuth_rad + 0.5 * (rays_each - 1) as f32 * scan.step_rad,
            step_rad: rays_each as f32 * scan.step_rad,
        }
    }

    /// Index of the ray in the middle of a sector, or half between two.
    #[must_use]
    pub fn middle_ray(&self, index: usize) -> f32 {
        (index * self.rays_each) as f32 + 0.5 * (self.rays_each - 1) as f32
    }

    /// Number of sectors.
    #[must_use]
    pub fn count(&self) -> usize {
        pieces(self.scan.rays.len(), self.rays_each)
    }

    /// Number of sectors if they cover a full turn: then the last is a neighbour of the first.
    #[must_use]
    pub fn turn(&self) -> Option<usize> {
        self.scan.turn().map(|rays| pieces(rays, self.rays_each))
    }

    /// Whether it is known where in a sector its hit is.
    #[must_use]
    pub const fn is_exact(&self) -> bool {
        self.rays_each > 1
    }

    /// Position of a sector's outermost rays, in sector widths from its middle: the largest distance of a hit from
    /// there. 0 if a sector is a single ray.
    #[must_use]
    pub fn outermost_ray(&self) -> f32 {
        let rays = self.rays_each as f32 * libm::ceilf(libm::fabsf(self.scan.step_rad) / RAY_STEP_MAX_RAD);
        0.5 - 0.5 / rays
    }

    /// A sector's measurement.
    #[must_use]
    pub fn get(&self, index: usize) -> Sector {
        self.nearest(index).0
    }

    /// A sector's measurement, and how far from its middle that is, in rays.
    #[must_use]
    #[inline(never)]
    pub fn nearest(&self, index: usize) -> (Sector, f32) {
        if self.rays_each == 1 {
            return (self.scan.rays.get(index), 0.0);
        }
        let (from, most_mm) = (index * self.rays_each, (1000.0 * self.scan.range_max_m + 0.5) as u16);
        let (mut least_mm, mut nearest, mut clear, mut absurd) = (CLEAR, 0, 0, None);
        let its = self.scan.rays.measured().get(from..).unwrap_or_default();
        for (ray, range_mm) in its.get(..self.rays_each).unwrap_or(its).iter().enumerate() {
            match *range_mm {
                UNKNOWN => {}
                CLEAR => clear += 1,
                range_mm if range_mm == ABSURD || range_mm > most_mm => absurd = Some(from + ray),
                range_mm if range_mm < least_mm => (least_mm, nearest) = (range_mm, ray),
                _ => {}
            }
        }
        match absurd {
            _ if least_mm < CLEAR => {
                (self.scan.rays.get(from + nearest), nearest as f32 - 0.5 * (self.rays_each - 1) as f32)
            }
            Some(ray) => (self.scan.rays.get(ray), 0.0),
            None if 2 * clear > self.rays_each => (Sector::Clear, 0.0),
            None => (Sector::Unknown, 0.0),
        }
    }
}

/// The number of pieces of `each` items that `count` items make; a division that cannot panic.
fn pieces(count: usize, each: usize) -> usize {
    (count + each.saturating_sub(1)).checked_div(each).unwrap_or(count)
}

/// Range of each sector of a scan, rounded down to the millimetre and 65 m at most, in half the memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ranges<const SECTORS: usize = SECTORS_MAX>([u16; SECTORS]);

impl<const SECTORS: usize> Ranges<SECTORS> {
    /// All sectors unknown.
    #[must_use]
    pub const fn new() -> Self {
        Self([UNKNOWN; SECTORS])
    }

    /// The ranges of a scan.
    #[inline(never)]
    pub fn take(&mut self, scan: &Scan) {
        let sectors = scan.in_sectors(SECTORS);
        for index in 0..SECTORS {
            match sectors.get(index) {
                Sector::Clear => self.put(index, CLEAR),
                Sector::Hit(range_m) if range_m > 0.0 && range_m <= scan.range_max_m => self.set_m(index, range_m),
                _ => self.put(index, UNKNOWN),
            }
        }
    }

    /// Of a sensor that loses rays: a clear sector reaches no farther than the nearest hit of the two sectors on each side, of
    /// the first `count`; at an end those on the other side stand in.
    #[inline(never)]
    pub fn close_gaps(&mut self, count: usize) {
        let measured = self.0;
        let last = count.saturating_sub(2 * BESIDE + 1);
        for (index, range) in self.0.iter_mut().take(count).enumerate().filter(|(_, range)| **range == CLEAR) {
            let first = index.saturating_sub(BESIDE).min(last);
            let beside = measured.get(first..count.min(first + 2 * BESIDE + 1)).unwrap_or_default();
            *range = beside.iter().fold(CLEAR, |least, hit| least.min(*hit));
        }
    }

    /// Sets a sector's range, that of its hit.
    pub fn set_m(&mut self, index: usize, range_m: f32) {
        self.put(index, (1000.0 * between(range_m, 0.0, RAY_MAX_M)) as u16);
    }

    /// Range of a sector; `clear_m` if it is clear, -1 if it is unknown.
    #[must_use]
    pub fn sees_m(&self, index: usize, clear_m: f32) -> f32 {
        match self.0.get(index).copied().unwrap_or(UNKNOWN) {
            UNKNOWN => -1.0,
            CLEAR => clear_m,
            range_mm => f32::from(range_mm) * 1e-3,
        }
    }

    fn put(&mut self, index: usize, value: u16) {
        if let Some(slot) = self.0.get_mut(index) {
            *slot = value;
        }
    }
}

impl<const SECTORS: usize> Default for Ranges<SECTORS> {
    fn default() -> Self {
        Self::new()
    }
}
