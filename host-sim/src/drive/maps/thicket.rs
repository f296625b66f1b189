//! Dense worlds: a corridor of 4.5 m in which a cellular automaton has grown clumps of thin pillars, as in the BARN benchmark
//! (Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", 2020).
//!
//! Cells of 0.15 m are filled at random, then smoothed: a cell with five full neighbours or more becomes full, one
//! with at most one becomes empty. Every full cell holds a pillar as wide as the cell. As in BARN, a world has a path
//! for a hull of 0.25 m; a world without one is drawn again.

use super::parts::{Pair, Pillar};
use super::route::Forest;
use crate::scenario::input::InputError;
use crate::world::random::Random;

/// Side of a cell and diameter of a pillar.
const CELL_M: f64 = 0.15;
/// Cells across the corridor and along it.
const COLUMNS: usize = 30;
const ROWS: usize = 30;
/// Share of the cells that are full before smoothing.
const FILL: [f64; 2] = [0.15, 0.3];
/// Rounds of smoothing.
const ROUNDS: [u32; 2] = [1, 4];
/// Full neighbours that fill a cell, and those that empty it.
const BIRTH: usize = 5;
const DEATH: usize = 1;
/// The field begins this far north of the start, and the goal is as far north of its end.
const MARGIN_M: f64 = 2.0;
/// Radius of the hull for which there is a path.
const PASSAGE_M: f64 = 0.25;
/// Worlds drawn before a seed counts as one without a path.
const DRAWS: u64 = 200;

/// West, south, east, north of the world.
pub const BOUNDS: [f64; 4] = [-0.5, -1.0, COLUMNS as f64 * CELL_M + 0.5, ROWS as f64 * CELL_M + 2.0 * MARGIN_M + 1.0];

/// The pillars of a world, and the start, the goal and the length of the shortest path between them.
///
/// # Errors
/// None of the worlds that were drawn has a path.
pub fn thicket(seed: u64) -> Result<(Vec<Pillar>, Pair), InputError> {
    let middle = COLUMNS as f64 * CELL_M / 2.0;
    let (start, goal) = ([middle, 0.0], [middle, ROWS as f64 * CELL_M + 2.0 * MARGIN_M]);
    for draw in 0..DRAWS {
        let mut random = Random::new(seed, 64 + draw);
        let pillars: Vec<Pillar> = field(&mut random).into_iter().chain(walls()).collect();
        let forest = Forest::new(BOUNDS, &pillars, PASSAGE_M);
        if let Some(length_m) = forest.shortest_m(start, goal) {
            return Ok((pillars, [start[0], start[1], goal[0], goal[1], length_m]));
        }
    }
    Err(InputError::new(format!("seed = {seed}: no thicket has a path")))
}

/// The clumps between the walls.
fn field(random: &mut Random) -> Vec<Pillar> {
    let fill = FILL[0] + (FILL[1] - FILL[0]) * random.uniform();
    let rounds = ROUNDS[0] + (f64::from(ROUNDS[1] - ROUNDS[0] + 1) * random.uniform()) as u32;
    let mut cells = [[false; COLUMNS]; ROWS];
    for cell in cells.as_flattened_mut() {
        *cell = random.uniform() < fill;
    }
    for _ in 0..rounds {
        let before = cells;
        for (row, line) in cells.iter_mut().enumerate() {
            for (column, cell) in line.iter_mut().enumerate() {
                let full = neighbours(&before, row, column);
                *cell = full >= BIRTH || (*cell && full > DEATH);
            }
        }
    }
    let place = |index: usize| (index as f64 + 0.5) * CELL_M;
    let full = (0..ROWS * COLUMNS).filter(|index| cells[index / COLUMNS][index % COLUMNS]);
    full.map(|index| [place(index % COLUMNS), MARGIN_M + place(index / COLUMNS), CELL_M / 2.0]).collect()
}

fn neighbours(cells: &[[bool; COLUMNS]; ROWS], row: usize, column: usize) -> usize {
    let around = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let cells =
        around(row, ROWS).flat_map(|r| around(column, COLUMNS).map(move |c| (r, c))).filter(|(r, c)| cells[*r][*c]);
    cells.filter(|place| *place != (row, column)).count()
}

/// Both sides of the corridor.
fn walls() -> impl Iterator<Item = Pillar> {
    let [west, east] = [-CELL_M / 2.0, (COLUMNS as f64 + 0.5) * CELL_M];
    let count = ((ROWS as f64 * CELL_M + 2.0 * MARGIN_M) / CELL_M) as u32;
    (0..=count).flat_map(move |k| [west, east].map(|x| [x, f64::from(k) * CELL_M, CELL_M / 2.0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thicket_is_dense_has_a_path_and_depends_on_its_seed_alone() {
        for seed in 0..5 {
            let (pillars, [x0, y0, x1, y1, length_m]) = thicket(seed).unwrap();
            assert!((150..=400).contains(&pillars.len()), "{}", pillars.len());
            assert!(length_m >= (x1 - x0).hypot(y1 - y0) - 1e-9);
            assert_eq!(thicket(seed).unwrap().0, pillars);
            assert_ne!(thicket(seed + 1).unwrap().0, pillars);
        }
    }
}
