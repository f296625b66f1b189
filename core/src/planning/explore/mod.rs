//! Selects where to fly when no signal is received: to the edge of the area that has been seen, until a signal is
//! received.
//!
//! Frontier exploration (B. Yamauchi, "A frontier-based approach for autonomous exploration", CIRA 1997) on a coarse
//! grid of 32 by 32 cells around the place where the search began. Each step
//!
//! 1. marks the cells that the sensor sees: in its range and field of view, and not behind a remembered circle;
//! 2. takes as candidates the cells that have not been seen, have a neighbour that has, are not in an obstacle and not
//!    farther than [`Config::radius_m`] from where the search began, nor outside of the fence;
//! 3. flood-fills the seen cells from the vehicle's cell, one ring of neighbours after the other, through the sides
//!    where the vehicle fits between the circles: the number of the ring that reaches a candidate is its distance;
//! 4. selects the candidate with the smallest sum of path, turning and seeded jitter. The target is kept while it is a
//!    candidate and no other is better by 2 m. Candidates that the fill does not reach come last, but are not given up:
//!    a door can be narrower than the grid resolves.
//!
//! A target that the caller reports as [`State::blocked`], or that comes no nearer in 20 s of search, is not tried again. So
//! every search ends: when no candidates are left ([`Explored::Exhausted`]), by time ([`Explored::TimedOut`]), or by
//! [`State::end`] when the signal returns.
//!
//! The state takes 312 bytes, a step 0.8 KB of stack. The cost of a step depends on the number of cells seen for the
//! first time and of cell sides around each circle.

use core::f32::consts::TAU;

use crate::base::config::{Fence, RangeSensor};
use crate::base::error::{ConfigError, Why, check};
use crate::base::ned::Horizontal;
use crate::base::obstacle::Disc;
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::base::units::{between, sin_cos, wrap_pi};

mod grid;

use grid::{Cell, Grid, MIDDLE, Passages, Rows, SIDE, cells_of, has, ring, set};

/// So many plans in a row to the source, some three seconds of signal, end a search.
const HOMED_MIN: u8 = 5;
/// Circles hide cells behind them as if their radius were larger by this: a wall is remembered with gaps in it.
const SHADE_M: f32 = 0.2;
/// Length of path that costs as much as turning by one radian.
const TURN_M_PER_RAD: f32 = 0.5;
/// Another target must be better by this to replace the present one.
const STICK_M: f32 = 2.0;
/// A target that comes no nearer, by this, in so long a time is blocked. A pause between two steps counts as [`STEP_MAX_MS`].
const NEARER_M: f32 = 0.25;
const PATIENCE_MS: u32 = 20_000;
const STEP_MAX_MS: u32 = 1_500;

/// How to search.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// The search is given up after this long.
    pub limit_s: f32,
    /// Largest distance of a target from where the search began.
    pub radius_m: f32,
    /// Width of a cell.
    pub cell_m: f32,
    /// Seed of the jitter that decides between nearly equal targets.
    pub seed: u32,
}

impl Default for Config {
    fn default() -> Self {
        Self { limit_s: 180.0, radius_m: 15.0, cell_m: 1.0, seed: 1 }
    }
}

impl Config {
    /// Checks the configuration. `clearance_m` is the smallest distance of the vehicle's centre from an obstacle's rim; no
    /// target lies outside of the fence.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self, clearance_m: f32, fence: &Fence) -> Result<Explorer, ConfigError> {
        check("explore.limit_s", self.limit_s, 1.0, 3600.0)?;
        check("explore.cell_m", self.cell_m, 0.2, 20.0)?;
        check("explore.radius_m", self.radius_m, self.cell_m, 300.0)?;
        check("vehicle.radius_m + planner.margin_m", clearance_m, 0.0, 2.0)?;
        if self.radius_m > (MIDDLE - 1) as f32 * self.cell_m {
            let why = Why::Inconsistent("must not be greater than 15 explore.cell_m, the reach of the grid");
            return Err(ConfigError { field: "explore.radius_m", value: self.radius_m, why });
        }
        Ok(Explorer { config: *self, clearance_m, fence: *fence })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Explorer {
    config: Config,
    clearance_m: f32,
    fence: Fence,
}

/// State of a search.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    began: Option<Began>,
    looked: Rows,
    refused: Rows,
    target: Option<Target>,
    /// Whether the fill ever reached the target. Not part of `target`: there it would give an `Option` without a target
    /// bits that are not zero.
    is_connected: bool,
    /// Number of searches that have ended: it changes the jitter of the next one.
    searches: u32,
    /// Plans to the source since the last step.
    homed: u8,
}

/// When and where a search began.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Began {
    at: Instant,
    place_ned_m: Horizontal,
}

/// The cell that the vehicle is sent to.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Target {
    cell: Cell,
    /// The vehicle's smallest distance from it so far, and the time of search since.
    nearest_m: f32,
    since_ms: u32,
    /// When that was last added to.
    at_ms: u32,
}

/// Result of a step of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Explored {
    /// Fly there.
    Target(Horizontal),
    /// Every place within the radius that can be seen has been seen.
    Exhausted,
    /// The search has reached its time limit.
    TimedOut,
    /// The pose was not finite, and there is no target yet.
    NoPose,
}

impl State {
    /// No search. All bits are zero.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            began: None,
            looked: [0; SIDE],
            refused: [0; SIDE],
            target: None,
            is_connected: false,
            searches: 0,
            homed: 0,
        }
    }

    /// The signal is back. A signal that lasts ends the search; one that comes for a moment now and then must not give it more time,
    /// nor another place.
    pub fn home(&mut self) {
        self.homed = self.homed.saturating_add(1);
        self.target = None;
        if self.homed >= HOMED_MIN {
            self.end();
        }
    }

    /// Ends the search: the next step begins a new search at the vehicle's position then.
    pub fn end(&mut self) {
        if self.began.is_some() {
            *self = Self { searches: self.searches.wrapping_add(1), ..Self::new() };
        }
    }

    /// Reports that there is no path to the target: it is not tried again, and neither are its neighbours if the fill
    /// never reached it.
    pub fn blocked(&mut self) {
        let Some(target) = self.target.take() else { return };
        let bit = 1_u32 << (target.cell.column & 31);
        let row = usize::from(target.cell.row);
        if self.is_connected {
            if let Some(refused) = self.refused.get_mut(row) {
                *refused |= bit;
            }
        } else {
            for refused in self.refused.iter_mut().skip(row.saturating_sub(1)).take(if row > 0 { 3 } else { 2 }) {
                *refused |= bit | bit << 1 | bit >> 1;
            }
        }
    }

    fn looked(&self, cell: Cell) -> bool {
        has(&self.looked, cell)
    }
}

impl Explorer {
    /// Marks the cells in view and selects the next target. Begins a search if none is in progress.
    pub fn step<'a>(
        &self,
        state: &mut State,
        now: Instant,
        pose: &Pose,
        sensor: &RangeSensor,
        discs: impl Iterator<Item = &'a Disc> + Clone,
    ) -> Explored {
        state.homed = 0;
        let here = pose.position_ned_m;
        let has_pose = here.norm_squared() < 1e12 && libm::fabsf(pose.yaw_rad) < 1e3;
        let began = match state.began {
            Some(began) => began,
            None if has_pose => *state.began.insert(Began { at: now, place_ned_m: here }),
            None => return Explored::NoPose,
        };
        let grid = Grid { began_ned_m: began.place_ned_m, cell_m: self.config.cell_m };
        if now.seconds_since(began.at) > self.config.limit_s {
            state.target = None;
            return Explored::TimedOut;
        }
        if !has_pose {
            return state.target.map_or(Explored::NoPose, |target| Explored::Target(grid.place_of(target.cell)));
        }
        let discs = discs.filter(|disc| disc.is_plausible());
        Self::look(state, &grid, pose, sensor, discs.clone());
        let now_ms = (now.0 / 1000) as u32;
        Self::lose_patience(state, &grid, now_ms, here);
        // Moving obstacles will have moved on.
        let standing = discs.filter(|disc| !disc.moves);
        let passages = self.passages(&grid, standing);
        let candidates = self.candidates(state, &grid, here, &passages);
        let Some((cell, is_connected)) = self.choose(state, &grid, pose, &passages, &candidates) else {
            state.target = None;
            return Explored::Exhausted;
        };
        if state.target.is_none_or(|target| target.cell != cell) {
            state.target = Some(Target { cell, nearest_m: f32::INFINITY, since_ms: 0, at_ms: now_ms });
            state.is_connected = false;
        }
        state.is_connected |= is_connected;
        Explored::Target(grid.place_of(cell))
    }

    /// Marks the cells that the sensor sees, and the vehicle's own.
    fn look<'a>(
        state: &mut State,
        grid: &Grid,
        pose: &Pose,
        sensor: &RangeSensor,
        discs: impl Iterator<Item = &'a Disc> + Clone,
    ) {
        let here = pose.position_ned_m;
        let heading = Horizontal::from_bearing(pose.yaw_rad);
        let RangeSensor { range_m, fov_rad, .. } = *sensor;
        let (_, edge) = sin_cos(if fov_rad < TAU { 0.5 * fov_rad } else { 0.5 * TAU });
        let sees_around = fov_rad >= TAU;
        for cell in grid.cells_within(here, range_m) {
            if state.looked(cell) {
                continue;
            }
            let away = grid.place_of(cell).minus(here);
            let away_m = away.norm();
            let is_in_view = away_m <= range_m && (sees_around || heading.dot(away) >= edge * away_m);
            // An obstacle in the cell itself does not hide it.
            let free_m = away_m - 0.5 * grid.cell_m;
            let hides = |disc: &Disc| {
                let towards = disc.center_ned_m.minus(here);
                let along = towards.dot(away);
                let across = towards.north * away.east - towards.east * away.north;
                let reach = (disc.radius_m + SHADE_M) * away_m;
                along > 0.0 && along < free_m * away_m && across * across < reach * reach
            };
            if is_in_view && !discs.clone().any(hides) {
                set(&mut state.looked, cell);
            }
        }
        if let Some(cell) = grid.cell_at(here) {
            set(&mut state.looked, cell);
        }
    }

    /// Gives up a target when the vehicle does not come nearer to it.
    fn lose_patience(state: &mut State, grid: &Grid, now_ms: u32, here: Horizontal) {
        let Some(target) = &mut state.target else { return };
        target.since_ms += now_ms.wrapping_sub(target.at_ms).min(STEP_MAX_MS);
        target.at_ms = now_ms;
        let away_m = grid.place_of(target.cell).minus(here).norm();
        if away_m < target.nearest_m - NEARER_M {
            (target.nearest_m, target.since_ms) = (away_m, 0);
        } else if target.since_ms > PATIENCE_MS {
            state.blocked();
        }
    }

    fn passages<'a>(&self, grid: &Grid, discs: impl Iterator<Item = &'a Disc>) -> Passages {
        let mut passages = Passages { covered: [0; SIDE], east: [0; SIDE], north: [0; SIDE] };
        // The side extends from 0 to the width of a cell; this is the distance beyond its ends.
        let beside = |along_m: f32| along_m - between(along_m, 0.0, grid.cell_m);
        for disc in discs {
            let reach_m = disc.radius_m + self.clearance_m;
            let (center, reach2) = (disc.center_ned_m, reach_m * reach_m);
            for cell in grid.cells_within(center, reach_m + grid.cell_m) {
                let off = center.minus(grid.place_of(cell));
                let (north2, east2) = (off.north * off.north, off.east * off.east);
                let (beside_north, beside_east) = (beside(off.north), beside(off.east));
                if north2 + east2 < reach2 {
                    set(&mut passages.covered, cell);
                }
                if north2 + beside_east * beside_east < reach2 {
                    set(&mut passages.east, cell);
                }
                if east2 + beside_north * beside_north < reach2 {
                    set(&mut passages.north, cell);
                }
            }
        }
        passages
    }

    fn candidates(&self, state: &State, grid: &Grid, here: Horizontal, passages: &Passages) -> Rows {
        let (radius_m, reach_m) = (self.config.radius_m, self.fence.reach_m(here));
        let mut candidates = [0; SIDE];
        let row = |index: usize| state.looked.get(index).copied().unwrap_or_default();
        for (index, found) in candidates.iter_mut().enumerate() {
            let beside = row(index) << 1 | row(index) >> 1 | row(index + 1) | index.checked_sub(1).map_or(0, row);
            *found = beside & !row(index) & !state.refused[index] & !passages.covered[index];
            let mut rest = *found;
            while rest != 0 {
                let column = rest.trailing_zeros();
                rest &= rest - 1;
                let place = grid.place_of(Cell { row: index as u8, column: column as u8 });
                if place.minus(grid.began_ned_m).norm_squared() > radius_m * radius_m
                    || place.minus(self.fence.center_ned_m).norm_squared() > reach_m * reach_m
                {
                    *found &= !(1 << column);
                }
            }
        }
        candidates
    }

    /// The best candidate, and whether the fill reached it.
    fn choose(
        &self,
        state: &State,
        grid: &Grid,
        pose: &Pose,
        passages: &Passages,
        candidates: &Rows,
    ) -> Option<(Cell, bool)> {
        let here = pose.position_ned_m;
        let mut best =
            Best { kept: state.target.map(|target| target.cell), kept_cost_m: None, cell: None, cost_m: 0.0 };
        let price = |cell: Cell, way_m: f32| {
            let turn_rad = libm::fabsf(wrap_pi(grid.place_of(cell).minus(here).bearing_rad() - pose.yaw_rad));
            let jitter_m = 0.5 * grid.cell_m * jitter(self.config.seed.wrapping_add(state.searches), cell);
            way_m + TURN_M_PER_RAD * turn_rad + jitter_m
        };
        let mut open = [0; SIDE];
        for (index, open) in open.iter_mut().enumerate() {
            *open = state.looked[index] & !passages.covered[index] | candidates[index];
        }
        let mut front = [0; SIDE];
        if let Some(cell) = grid.cell_at(here) {
            set(&mut front, cell);
            if let Some(open) = open.get_mut(usize::from(cell.row)) {
                *open &= !(1 << cell.column);
            }
        }
        let mut way_m = 0.0;
        while front.iter().any(|row| *row != 0) {
            way_m += grid.cell_m;
            // Every candidate farther away costs more.
            if best.cell.is_some() && way_m > best.cost_m + STICK_M {
                return best.choice().map(|cell| (cell, true));
            }
            front = ring(&front, &open, passages);
            for (index, front) in front.iter_mut().enumerate() {
                open[index] &= !*front;
                for cell in cells_of(index, *front & candidates[index]) {
                    best.offer(cell, price(cell, way_m));
                }
                *front &= !candidates[index];
            }
        }
        // A target that the fill no longer reaches may be behind a door that the grid does not resolve from here.
        if best.kept_cost_m.is_none()
            && let Some(kept) = best.kept.filter(|kept| has(candidates, *kept))
        {
            return Some((kept, false));
        }
        if let Some(cell) = best.choice() {
            return Some((cell, true));
        }
        for (index, row) in candidates.iter().enumerate() {
            for cell in cells_of(index, *row) {
                best.offer(cell, price(cell, grid.place_of(cell).minus(here).norm()));
            }
        }
        best.choice().map(|cell| (cell, false))
    }
}

/// The best of the candidates, and the present target.
struct Best {
    kept: Option<Cell>,
    kept_cost_m: Option<f32>,
    cell: Option<Cell>,
    cost_m: f32,
}

impl Best {
    fn offer(&mut self, cell: Cell, cost_m: f32) {
        if self.kept == Some(cell) {
            self.kept_cost_m = Some(cost_m);
        }
        if self.cell.is_none() || cost_m < self.cost_m {
            (self.cell, self.cost_m) = (Some(cell), cost_m);
        }
    }

    fn choice(&self) -> Option<Cell> {
        match self.kept_cost_m {
            Some(cost_m) if cost_m <= self.cost_m + STICK_M => self.kept,
            _ => self.cell,
        }
    }
}

/// A number in 0..1, constant for a cell during a search: a multiplicative hash of seed and cell.
fn jitter(seed: u32, cell: Cell) -> f32 {
    let mut mixed =
        (seed.wrapping_mul(0x85eb_ca6b) ^ u32::from(cell.row) << 8 ^ u32::from(cell.column)).wrapping_mul(0x9e37_79b1);
    mixed ^= mixed >> 15;
    mixed = mixed.wrapping_mul(0xc2b2_ae35);
    (mixed >> 16) as f32 * (1.0 / 65_536.0)
}

#[cfg(test)]
mod tests;
