//! Maps of pillars with a given obstacle density, and start/goal pairs on them, as in the main paper.
//!
//! The paper compares its planners on five maps of which it prints the mean and the variance of the obstacle density
//! over the unit squares (Table I, [`TABLE_I`]), but not the maps. [`generate`] draws such maps: pillars at random,
//! without overlap, then annealed - moved and resized one at a time, accepted after Metropolis - until both numbers
//! are met. These densities need about one pillar per square metre, of 0.1 to 0.33 m. The fifth map's density changes
//! drastically in space: its pillars are denser on one side of a line than on the other.
//!
//! [`pairs`] draws starts and goals that a planner which knows the whole map can connect, with the length of its
//! path. A map depends only on its seed, on every machine: nothing of the platform's mathematics library is used, not
//! even by a Gaussian draw.

mod density;
mod parts;
mod route;
pub mod rows;
pub mod thicket;

pub(crate) use density::Cells;
pub use density::{Density, densities, density};
pub use parts::{Pair, Pillar};
pub use route::Forest;

use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

use crate::scenario::input::{InputError, check, check_within};
use crate::world::random::Random;

/// The main paper's five maps.
pub const TABLE_I: [Density; 5] = [
    Density { mean: 0.0702, variance: 0.0020 },
    Density { mean: 0.1102, variance: 0.0023 },
    Density { mean: 0.1267, variance: 0.0021 },
    Density { mean: 0.1520, variance: 0.0011 },
    Density { mean: 0.1552, variance: 0.0152 },
];
/// The row of [`TABLE_I`], from 1, whose density changes in space.
pub const STEP_ROW: u32 = 5;

/// Largest difference of mean and variance from the requested ones.
pub const TOLERANCE: f64 = 0.0005;
/// Where annealing stops: a tenth of that, so that rounding and another definition of variance do not matter.
const CLOSE: f64 = TOLERANCE / 10.0;
/// Radius of the thinnest pillar.
const THINNEST_M: f64 = 0.1;
/// Radius of a typical pillar where there is less than one a square metre.
const TYPICAL_M: f64 = 0.14;
/// The paper's densities need pillars up to 0.33 m; a step's dense side may have thicker ones.
const THICKEST_M: f64 = 0.36;
/// Farthest that a pillar is moved, and most that it is resized, at once.
const MOVE_M: f64 = 0.75;
const RESIZE_M: f64 = 0.12;
/// Temperature at the start and at the end, in units of [`CLOSE`].
const HOT: f64 = 20.0;
const COLD: f64 = 0.05;
/// Moves of one annealing, and annealings before the density counts as out of reach.
const MOVES: usize = 60_000;
const ATTEMPTS: u64 = 8;
/// Share of the standard deviation between the sides of a step; the rest is within them.
const STEP_SHARE: f64 = 0.7;
/// Coordinates and radii are whole tenths of a millimetre, so that a file holds them exactly.
const GRAINS_A_M: f64 = 10_000.0;

/// Starts and goals are at least this far apart.
pub const PAIR_APART_M: f64 = 4.0;
/// Clearance of the reference path from every pillar in addition to the vehicle's radius.
pub const REFERENCE_CLEARANCE_M: f64 = 0.05;
/// Draws a pair, or a pillar's place, before a map counts as too full.
const DRAWS: usize = 200;

/// Requirements for a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recipe {
    /// West, south, east, north.
    pub bounds: [f64; 4],
    /// Mean and variance over the unit squares.
    pub density: Density,
    /// Whether the density is high on one side of a line and low on the other.
    pub step: bool,
}

/// Range of a map's edges.
pub const EDGE_M: RangeInclusive<f64> = -1000.0..=1000.0;
/// Range of mean densities.
pub const MEAN: RangeInclusive<f64> = 0.005..=0.22;
/// Range of their variances.
pub const VARIANCE: RangeInclusive<f64> = 0.0..=0.05;

impl Default for Recipe {
    /// The main paper's first map, on 10 x 10 m.
    fn default() -> Self {
        Self { bounds: [0.0, 0.0, 10.0, 10.0], density: TABLE_I[0], step: false }
    }
}

impl Recipe {
    /// A row of [`TABLE_I`], from 1.
    #[must_use]
    pub fn of_row(row: u32) -> Option<Self> {
        let density = *TABLE_I.get((row as usize).checked_sub(1)?)?;
        Some(Self { density, step: row == STEP_ROW, ..Self::default() })
    }

    fn check(&self) -> Result<(), InputError> {
        for (index, value) in self.bounds.iter().enumerate() {
            check_within(&format!("bounds[{index}]"), *value, &EDGE_M)?;
        }
        check("bounds[2]", self.bounds[2], self.bounds[0] + 2.0, self.bounds[0] + 50.0)?;
        check("bounds[3]", self.bounds[3], self.bounds[1] + 2.0, self.bounds[1] + 50.0)?;
        check_within("mean", self.density.mean, &MEAN)?;
        check_within("variance", self.density.variance, &VARIANCE)
    }
}

/// Draws a map.
///
/// # Errors
/// The field out of range; or annealing did not reach mean and variance.
pub fn generate(recipe: &Recipe, seed: u64) -> Result<Vec<Pillar>, InputError> {
    recipe.check()?;
    let mut nearest: Option<(f64, Density)> = None;
    for attempt in 0..ATTEMPTS {
        let mut annealing = Annealing::start(recipe, Random::new(seed, 2 * attempt));
        annealing.run();
        let pillars = annealing.pillars;
        let reached = density(recipe.bounds, &pillars);
        let miss = (reached.mean - recipe.density.mean).abs().max((reached.variance - recipe.density.variance).abs());
        if miss <= TOLERANCE / 2.0 {
            return Ok(pillars);
        }
        if nearest.is_none_or(|(least, _)| miss < least) {
            nearest = Some((miss, reached));
        }
    }
    let Density { mean, variance } = recipe.density;
    let found = nearest.map_or_else(String::new, |(_, reached)| {
        format!("; the nearest map has {:.4} and {:.4}", reached.mean, reached.variance)
    });
    Err(InputError::new(format!("no map of mean = {mean} and variance = {variance} was found{found}")))
}

/// A map during annealing.
struct Annealing<'a> {
    recipe: &'a Recipe,
    random: Random,
    cells: Cells,
    shares: Vec<f64>,
    pillars: Vec<Pillar>,
    /// Per cell: +1 on the dense side of the step, -1 on the other, 0 without a step or on it.
    side: Vec<f64>,
}

impl<'a> Annealing<'a> {
    fn start(recipe: &'a Recipe, random: Random) -> Self {
        let cells = Cells::new(recipe.bounds);
        let mut annealing = Self {
            recipe,
            random,
            cells,
            shares: vec![0.0; cells.count()],
            pillars: Vec::new(),
            side: vec![0.0; cells.count()],
        };
        if recipe.step {
            annealing.draw_step();
        }
        annealing.plant();
        annealing
    }

    /// A line through the middle of the map, in any direction.
    fn draw_step(&mut self) {
        let [west, south, east, north] = self.recipe.bounds;
        let angle_rad = TAU * self.random.uniform();
        let (across_x, across_y) = (libm::cos(angle_rad), libm::sin(angle_rad));
        for row in 0..self.cells.rows {
            for column in 0..self.cells.columns {
                let square = self.cells.square(column, row);
                let (x, y) =
                    ((square[0] + square[2] - west - east) / 2.0, (square[1] + square[3] - south - north) / 2.0);
                let beyond = x * across_x + y * across_y;
                self.side[row * self.cells.columns + column] = if beyond > 0.0 { 1.0 } else { -1.0 };
            }
        }
    }

    /// Pillars at random places, with radii whose mean area gives the mean density.
    fn plant(&mut self) {
        let [west, south, east, north] = self.recipe.bounds;
        let area_m2 = (east - west) * (north - south);
        let covered_m2 = self.recipe.density.mean * area_m2;
        let count = libm::rint(area_m2.min(covered_m2 / (PI * TYPICAL_M * TYPICAL_M))).max(1.0);
        // Radii uniform in [a, b]: the mean square is (a^2 + a b + b^2) / 3.
        let mean_square = covered_m2 / count / PI;
        let a = THINNEST_M.min(libm::sqrt(mean_square));
        let b = (libm::sqrt((12.0 * mean_square - 3.0 * a * a).max(0.0)) - a) / 2.0;
        // Thick ones first, while there is space for them.
        let mut radii: Vec<f64> = (0..count as usize).map(|_| a + (b - a) * self.random.uniform()).collect();
        radii.sort_by(|a, b| b.total_cmp(a));
        for radius in radii {
            for _ in 0..DRAWS {
                let (x, y) =
                    (west + (east - west) * self.random.uniform(), south + (north - south) * self.random.uniform());
                let pillar = grained([x, y, radius]);
                if self.has_room(pillar, usize::MAX) {
                    self.cover(pillar, 1.0);
                    self.pillars.push(pillar);
                    break;
                }
            }
        }
    }

    /// Whether a pillar in place of the one with this index is inside the bounds and touches no other.
    fn has_room(&self, [x, y, r]: Pillar, index: usize) -> bool {
        let [west, south, east, north] = self.recipe.bounds;
        let is_apart = |other: &Pillar| {
            let (dx, dy, reach) = (other[0] - x, other[1] - y, other[2] + r);
            dx * dx + dy * dy > reach * reach
        };
        x - r >= west
            && x + r <= east
            && y - r >= south
            && y + r <= north
            && self.pillars.iter().enumerate().all(|(k, other)| k == index || is_apart(other))
    }

    fn cover(&mut self, pillar: Pillar, sign: f64) {
        for (cell, share) in self.cells.covered(pillar) {
            self.shares[cell] += sign * share;
        }
    }

    /// Difference of mean, variance and step from the requested ones, in units of [`CLOSE`].
    fn miss(&self) -> f64 {
        let reached = Density::of(&self.shares);
        let asked = self.recipe.density;
        let mut miss = (reached.mean - asked.mean).abs() + (reached.variance - asked.variance).abs();
        if self.recipe.step {
            let rise: f64 = self.shares.iter().zip(&self.side).map(|(share, side)| share * side).sum();
            let rise = rise / self.shares.len() as f64;
            // A step need not be met as closely.
            miss += 0.5 * (rise - STEP_SHARE * libm::sqrt(asked.variance)).abs();
        }
        miss / CLOSE
    }

    fn run(&mut self) {
        let mut miss = self.miss();
        for step in 0..MOVES {
            if miss < 0.2 || self.pillars.is_empty() {
                break;
            }
            let progress = step as f64 / MOVES as f64;
            let temperature = HOT * libm::pow(COLD / HOT, progress);
            let index = (self.random.uniform() * self.pillars.len() as f64) as usize;
            let old = self.pillars[index];
            let new = self.neighbour(old, 1.0 - 0.9 * progress);
            if !self.has_room(new, index) {
                continue;
            }
            self.cover(old, -1.0);
            self.cover(new, 1.0);
            let new_miss = self.miss();
            if new_miss <= miss || self.random.uniform() < libm::exp((miss - new_miss) / temperature) {
                self.pillars[index] = new;
                miss = new_miss;
            } else {
                self.cover(new, -1.0);
                self.cover(old, 1.0);
            }
        }
    }

    /// A change: another place, or another radius.
    fn neighbour(&mut self, [x, y, r]: Pillar, reach: f64) -> Pillar {
        let mut draw = || self.random.uniform() - self.random.uniform();
        let (by_x, by_y, by_r) = (draw(), draw(), draw());
        if self.random.uniform() < 0.5 {
            grained([x + MOVE_M * reach * by_x, y + MOVE_M * reach * by_y, r])
        } else {
            grained([x, y, (r + RESIZE_M * reach * by_r).clamp(THINNEST_M, THICKEST_M.max(r))])
        }
    }
}

/// Rounded to the grain of files.
fn grained<const N: usize>(values: [f64; N]) -> [f64; N] {
    values.map(|value| libm::rint(value * GRAINS_A_M) / GRAINS_A_M)
}

/// The pairs of a map, and how hard they were to find.
#[derive(Clone, Debug, PartialEq)]
pub struct Pairs {
    /// Start, goal and length of the shortest path.
    pub pairs: Vec<Pair>,
    /// Share of the pairs, clear and far enough apart, that are connected by a path.
    pub reachable_share: f64,
}

/// Draws pairs: clear, at least [`PAIR_APART_M`] apart, and connected by a path that keeps [`REFERENCE_CLEARANCE_M`].
///
/// # Errors
/// The map is too closed to find them.
pub fn pairs(
    bounds: [f64; 4],
    pillars: &[Pillar],
    vehicle_radius_m: f64,
    count: usize,
    seed: u64,
) -> Result<Pairs, InputError> {
    let [west, south, east, north] = bounds;
    let keep_m = vehicle_radius_m + REFERENCE_CLEARANCE_M;
    let forest = Forest::new(bounds, pillars, keep_m);
    let mut random = Random::new(seed, 1);
    let mut found = Vec::with_capacity(count);
    let mut tried = 0_usize;
    for _ in 0..DRAWS * count {
        if found.len() == count {
            break;
        }
        let mut place = || {
            let (x, y) = (random.uniform(), random.uniform());
            grained([
                west + keep_m + (east - west - 2.0 * keep_m) * x,
                south + keep_m + (north - south - 2.0 * keep_m) * y,
            ])
        };
        let (start, goal) = (place(), place());
        let apart_m = libm::hypot(goal[0] - start[0], goal[1] - start[1]);
        if apart_m < PAIR_APART_M || !forest.is_clear(start) || !forest.is_clear(goal) {
            continue;
        }
        tried += 1;
        if let Some(length_m) = forest.shortest_m(start, goal) {
            let length_m = libm::rint(length_m * 1e6) / 1e6;
            found.push([start[0], start[1], goal[0], goal[1], length_m]);
        }
    }
    if found.len() < count {
        return Err(InputError::new(format!(
            "drone-radius = {vehicle_radius_m}: only {} of {count} pairs were found on a map",
            found.len()
        )));
    }
    let reachable_share = if tried == 0 { 0.0 } else { found.len() as f64 / tried as f64 };
    Ok(Pairs { pairs: found, reachable_share })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(reached: Density, asked: Density) -> bool {
        (reached.mean - asked.mean).abs() <= TOLERANCE && (reached.variance - asked.variance).abs() <= TOLERANCE
    }

    #[test]
    fn every_row_of_table_i_is_reached_by_every_seed_without_overlaps() {
        for row in 1..=5 {
            let recipe = Recipe::of_row(row).unwrap();
            for seed in 0..3 {
                let pillars = generate(&recipe, seed).unwrap();
                let reached = density(recipe.bounds, &pillars);
                assert!(near(reached, recipe.density), "row {row} seed {seed}: {reached:?}");
                for (k, [x, y, r]) in pillars.iter().enumerate() {
                    assert!((THINNEST_M..=THICKEST_M).contains(r), "{r}");
                    assert!(x - r >= 0.0 && x + r <= 10.0 && y - r >= 0.0 && y + r <= 10.0);
                    for other in &pillars[..k] {
                        assert!((x - other[0]).hypot(y - other[1]) > r + other[2]);
                    }
                }
            }
        }
    }

    #[test]
    fn the_fifth_map_is_denser_on_one_side_of_a_line_and_the_others_are_not() {
        // The best straight line through the middle divides the fifth map's squares into parts with very different
        // means.
        let parted = |row: u32| {
            let recipe = Recipe::of_row(row).unwrap();
            let cells = densities(recipe.bounds, &generate(&recipe, 1).unwrap());
            let rise = |angle: f64| {
                let place = |k: usize| ((k % 10) as f64 - 4.5) * angle.cos() + ((k / 10) as f64 - 4.5) * angle.sin();
                let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
                for (k, share) in cells.iter().enumerate() {
                    let side = usize::from(place(k) > 0.0);
                    sums[side] += share;
                    counts[side] += 1.0;
                }
                sums[1] / counts[1] - sums[0] / counts[0]
            };
            (0..72).map(|k| rise(f64::from(k) * TAU / 72.0)).fold(0.0, f64::max)
        };
        assert!(parted(5) > 0.15, "{}", parted(5));
        assert!(parted(4) < 0.05, "{}", parted(4));
    }

    #[test]
    fn densities_out_of_reach_are_refused_with_what_was_found() {
        let recipe =
            |mean: f64, variance: f64| Recipe { density: Density { mean, variance }, ..Recipe::of_row(1).unwrap() };
        assert!(generate(&recipe(0.02, 0.05), 1).unwrap_err().to_string().contains("variance = 0.05"));
        assert!(generate(&recipe(0.9, 0.0), 1).unwrap_err().to_string().starts_with("mean = 0.9 is outside"));
        assert!(generate(&recipe(f64::NAN, 0.0), 1).unwrap_err().to_string().starts_with("mean"));
        assert!(generate(&recipe(0.1, -1.0), 1).unwrap_err().to_string().starts_with("variance"));
    }

    #[test]
    fn pairs_are_apart_clear_and_no_shorter_than_straight() {
        let recipe = Recipe::of_row(4).unwrap();
        let pillars = generate(&recipe, 2).unwrap();
        let Pairs { pairs: drawn, reachable_share } = pairs(recipe.bounds, &pillars, 0.15, 40, 2).unwrap();
        assert_eq!(drawn.len(), 40);
        assert!(reachable_share > 0.8 && reachable_share <= 1.0);
        for [x0, y0, x1, y1, length] in drawn {
            let straight = (x1 - x0).hypot(y1 - y0);
            assert!(straight >= PAIR_APART_M && length > straight - 1e-5 && length < 2.0 * straight);
            for [x, y, r] in &pillars {
                assert!((x - x0).hypot(y - y0) >= r + 0.2 && (x - x1).hypot(y - y1) >= r + 0.2);
            }
        }
    }

    #[test]
    fn a_map_that_is_closed_up_says_so() {
        let wall: Vec<Pillar> = (0..40).map(|k| [5.0, 0.25 * f64::from(k), 0.3]).collect();
        let narrow = [3.0, 0.0, 7.0, 10.0];
        assert!(pairs(narrow, &wall, 1.5, 5, 1).unwrap_err().to_string().contains("drone-radius = 1.5"));
    }
}
