//! What is known of a plan: a grid that a range sensor fills in, its points, and the shortest path on it.
//!
//! Unknown ground counts as free. The same for all agents.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::plan::Plan;
use crate::world::Horizontal;
use crate::world::random::Random;
use crate::world::rays::Wall;

/// Side of a cell.
pub(super) const CELL_M: f64 = 0.25;
/// Ground beyond the plan's walls.
const MARGIN_M: f64 = 1.0;
/// Nothing goes closer to a known point of a wall than this: the robot's radius and half a cell.
pub(super) const CLEARANCE_M: f64 = 0.3;
/// Range of the sensor.
pub(super) const RANGE_M: f64 = 5.0;
/// Rays of a scan, all around.
const RAYS: usize = 240;
/// Noise of the ranges.
const RANGE_SIGMA_M: f64 = 0.02;
/// Cost of a step along an axis, and of a diagonal one.
const STEP: [u32; 2] = [1000, 1414];

/// A cell's column (to the east) and row (to the north).
pub(super) type Index = [usize; 2];

/// The map.
#[derive(Clone, Debug)]
pub(super) struct Known {
    size: Index,
    /// Whether a ray ended in a cell.
    walls: Vec<bool>,
    /// Distance from a cell's middle to the nearest point, where it is below the clearance; infinite elsewhere.
    rooms_m: Vec<f64>,
    /// The first point of each wall cell.
    points: Vec<Horizontal>,
}

impl Known {
    /// Nothing but the extent is known.
    pub(super) fn new(plan: &Plan) -> Self {
        let size = plan.size_m.map(|side_m| libm::ceil((side_m + 2.0 * MARGIN_M) / CELL_M) as usize);
        let count = size[0] * size[1];
        Self { size, walls: vec![false; count], rooms_m: vec![f64::INFINITY; count], points: Vec::new() }
    }

    /// Everything is known.
    pub(super) fn all(plan: &Plan) -> Self {
        let mut known = Self::new(plan);
        for wall in &plan.walls {
            let along = wall.to.minus(wall.from);
            let steps = libm::ceil(along.norm() / 0.1).max(1.0) as usize;
            for k in 0..=steps {
                known.add_point(wall.from.along(along, k as f64 / steps as f64));
            }
        }
        known
    }

    /// Points of walls, one a cell, in the order of their discovery.
    pub(super) fn points(&self) -> &[Horizontal] {
        &self.points
    }

    /// The cell that a place is in; places outside are in the nearest.
    pub(super) fn index(&self, place: Horizontal) -> Index {
        let (x, y) = place.xy();
        let cell =
            |value: f64, count: usize| libm::floor((value + MARGIN_M) / CELL_M).clamp(0.0, count as f64 - 1.0) as usize;
        [cell(x, self.size[0]), cell(y, self.size[1])]
    }

    /// The middle of a cell.
    pub(super) fn center(&self, index: Index) -> Horizontal {
        Horizontal::from_xy(index.map(|k| (k as f64 + 0.5) * CELL_M - MARGIN_M))
    }

    fn flat(&self, [column, row]: Index) -> usize {
        row * self.size[0] + column
    }

    fn unflat(&self, flat: usize) -> Index {
        [flat % self.size[0], flat / self.size[0]]
    }

    /// Whether the robot cannot be here.
    pub(super) fn is_blocked(&self, place: Horizontal) -> bool {
        self.rooms_m[self.flat(self.index(place))] < CLEARANCE_M
    }

    fn neighbours(&self, [column, row]: Index) -> impl Iterator<Item = (Index, u32)> {
        let size = self.size;
        let around = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (-1, 1), (1, -1), (1, 1)];
        around.into_iter().enumerate().filter_map(move |(k, (dx, dy)): (usize, (isize, isize))| {
            let next = [column.checked_add_signed(dx)?, row.checked_add_signed(dy)?];
            (next[0] < size[0] && next[1] < size[1]).then_some((next, STEP[k / 4]))
        })
    }

    fn add_point(&mut self, point: Horizontal) {
        let index = self.index(point);
        let flat = self.flat(index);
        if !self.walls[flat] {
            self.walls[flat] = true;
            self.points.push(point);
            self.keep_off(point);
        }
    }

    /// Nothing comes close to this point from now on.
    pub(super) fn keep_off(&mut self, point: Horizontal) {
        let index = self.index(point);
        let reach = libm::ceil(CLEARANCE_M / CELL_M) as usize + 1;
        for row in index[1].saturating_sub(reach)..(index[1] + reach + 1).min(self.size[1]) {
            for column in index[0].saturating_sub(reach)..(index[0] + reach + 1).min(self.size[0]) {
                let room_m = self.center([column, row]).minus(point).norm();
                let flat = self.flat([column, row]);
                if room_m < CLEARANCE_M {
                    self.rooms_m[flat] = self.rooms_m[flat].min(room_m);
                }
            }
        }
    }

    /// Takes in a scan from a place. Walls hide what is behind them.
    pub(super) fn scan(&mut self, walls: &[Wall], from: Horizontal, random: &mut Random) -> Vec<Horizontal> {
        let near: Vec<&Wall> = walls.iter().filter(|wall| super::plan::distance_m(wall, from) <= RANGE_M).collect();
        let mut seen = Vec::new();
        for ray in 0..RAYS {
            let direction = Horizontal::from_bearing(std::f64::consts::TAU * ray as f64 / RAYS as f64);
            let end = from.along(direction, RANGE_M);
            let share = near.iter().filter_map(|wall| wall.crossing(from, end)).fold(1.0, f64::min);
            if share < 1.0 {
                let point = from.along(direction, share * RANGE_M + RANGE_SIGMA_M * random.gaussian());
                self.add_point(point);
                seen.push(point);
            }
        }
        seen
    }

    /// Distance along a ray to the first known wall, within a limit.
    pub(super) fn range_to_wall_m(&self, from: Horizontal, direction: Horizontal, limit_m: f64) -> Option<f64> {
        let steps = libm::ceil(limit_m / (0.5 * CELL_M)) as usize;
        (0..steps)
            .map(|k| 0.5 * CELL_M * k as f64)
            .find(|range_m| self.walls[self.flat(self.index(from.along(direction, *range_m)))])
    }

    /// Whether the robot can go straight, as far as is known.
    pub(super) fn is_clear(&self, from: Horizontal, to: Horizontal) -> bool {
        let leg = to.minus(from);
        let steps = libm::ceil(leg.norm() / (0.3 * CELL_M)).max(1.0) as usize;
        // Where it stands does not stop it from leaving.
        let least_m = self.rooms_m[self.flat(self.index(from))].min(CLEARANCE_M);
        (1..=steps).all(|k| {
            let place = from.along(leg, k as f64 / steps as f64);
            self.rooms_m[self.flat(self.index(place))] >= least_m
        }) && !self.is_blocked(to)
    }

    /// The free cell nearest to a place.
    pub(super) fn nearest_free(&self, place: Horizontal) -> Option<Index> {
        let at = self.index(place);
        if self.rooms_m[self.flat(at)] >= CLEARANCE_M {
            return Some(at);
        }
        let reach = 12;
        let mut nearest: Option<(f64, Index)> = None;
        for row in at[1].saturating_sub(reach)..(at[1] + reach + 1).min(self.size[1]) {
            for column in at[0].saturating_sub(reach)..(at[0] + reach + 1).min(self.size[0]) {
                let distance_m = self.center([column, row]).minus(place).norm();
                if self.rooms_m[self.flat([column, row])] >= CLEARANCE_M
                    && nearest.is_none_or(|(least, _)| distance_m < least)
                {
                    nearest = Some((distance_m, [column, row]));
                }
            }
        }
        nearest.map(|(_, index)| index)
    }

    /// The shortest path (A*), cell by cell; unknown ground is free. `None` when there is no path.
    pub(super) fn way(&self, from: Horizontal, to: Horizontal) -> Option<Vec<Horizontal>> {
        let (start, goal) = (self.index(from), self.nearest_free(to)?);
        let estimate = |[column, row]: Index| {
            let (dx, dy) = (column.abs_diff(goal[0]) as u32, row.abs_diff(goal[1]) as u32);
            STEP[0] * (dx.max(dy) - dx.min(dy)) + STEP[1] * dx.min(dy)
        };
        let mut costs = vec![u32::MAX; self.walls.len()];
        let mut parents = vec![usize::MAX; self.walls.len()];
        let mut open = BinaryHeap::new();
        let start_flat = self.flat(start);
        costs[start_flat] = 0;
        open.push(Reverse((estimate(start), start_flat)));
        while let Some(Reverse((total, flat))) = open.pop() {
            let index = self.unflat(flat);
            if index == goal {
                return Some(self.trace(&parents, flat, from));
            }
            let cost = costs[flat];
            if total > cost + estimate(index) {
                continue;
            }
            for (next, step) in self.neighbours(index) {
                let next_flat = self.flat(next);
                if self.admits(index, next) && cost + step < costs[next_flat] {
                    costs[next_flat] = cost + step;
                    parents[next_flat] = flat;
                    open.push(Reverse((cost + step + estimate(next), next_flat)));
                }
            }
        }
        None
    }

    /// Whether a step leads to a free place, not past a corner, or away from a wall that is too close already.
    fn admits(&self, from: Index, to: Index) -> bool {
        let room_m = |index: Index| self.rooms_m[self.flat(index)];
        let least_m = room_m(from).min(CLEARANCE_M);
        let corners = [[from[0], to[1]], [to[0], from[1]]];
        let beside_m = corners.into_iter().map(room_m).fold(f64::INFINITY, f64::min);
        if least_m < CLEARANCE_M { room_m(to) > least_m } else { room_m(to) >= CLEARANCE_M && beside_m >= CLEARANCE_M }
    }

    fn trace(&self, parents: &[usize], goal: usize, from: Horizontal) -> Vec<Horizontal> {
        let mut way = Vec::new();
        let mut at = goal;
        while parents[at] != usize::MAX {
            way.push(self.center(self.unflat(at)));
            at = parents[at];
        }
        if way.is_empty() {
            way.push(from);
        }
        way.reverse();
        way
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_goes_through_the_doors_and_keeps_its_distance() {
        let mut ways = 0;
        for seed in 0..6 {
            let plan = Plan::draw(seed, seed % 2 == 0);
            let known = Known::all(&plan);
            let mut random = Random::new(seed, 9);
            for _ in 0..20 {
                let [from, to] = [0, 1].map(|_| plan.place(&mut random, 0.5));
                let Some(way) = known.way(from, to) else { continue };
                ways += 1;
                for pair in way.windows(2) {
                    assert!(plan.is_clear(pair[0], pair[1]), "seed {seed}: {pair:?}");
                    // A wall may be half a cell's diagonal nearer than the middle of its cell.
                    assert!(plan.room_m(pair[1]) > CLEARANCE_M - 0.5 * core::f64::consts::SQRT_2 * CELL_M);
                }
                let length_m: f64 = way.windows(2).map(|pair| pair[1].minus(pair[0]).norm()).sum();
                assert!(length_m >= to.minus(from).norm() - 2.0 * CELL_M);
            }
        }
        assert!(ways >= 100, "{ways} of 120");
    }

    #[test]
    fn a_scan_sees_the_walls_around_and_nothing_behind_them() {
        let plan = Plan::draw(3, false);
        let mut random = Random::new(3, 9);
        for _ in 0..20 {
            let from = plan.place(&mut random, 0.5);
            let mut known = Known::new(&plan);
            known.scan(&plan.walls, from, &mut random);
            assert!(!known.points().is_empty());
            for point in known.points() {
                assert!(plan.room_m(*point) < 0.1 && point.minus(from).norm() < RANGE_M + 0.1);
                let short = from.along(point.minus(from), 1.0 - 0.15 / point.minus(from).norm());
                assert!(plan.is_clear(from, short), "{from:?} {point:?}");
            }
        }
    }
}
