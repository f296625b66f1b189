//! The grid of a search: cells in rows of bits, and the sides between them.

use crate::base::ned::Horizontal;

/// Cells along a side of the grid.
pub(super) const SIDE: usize = 32;
/// The cell in whose middle the search begins.
pub(super) const MIDDLE: usize = SIDE / 2;

/// A row of the grid, one bit per cell from west to east; the rows are ordered from south to north.
pub(super) type Rows = [u32; SIDE];

/// A cell by its row and column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cell {
    pub(super) row: u8,
    pub(super) column: u8,
}

/// The cells and sides of the grid that obstacles block.
pub(super) struct Passages {
    /// Cells whose middle lies in an obstacle.
    pub(super) covered: Rows,
    /// Closed sides towards the next cell to the east.
    pub(super) east: Rows,
    /// Closed sides towards the next cell to the north.
    pub(super) north: Rows,
}

/// The open cells next to those of a front, through sides that are not closed.
pub(super) fn ring(front: &Rows, open: &Rows, passages: &Passages) -> Rows {
    let mut next = [0; SIDE];
    for (index, next) in next.iter_mut().enumerate() {
        let (row, east) = (front[index], passages.east[index]);
        let beside = (row & !east) << 1 | row >> 1 & !east;
        let from_south = index.checked_sub(1).map_or(0, |south| front[south] & !passages.north[south]);
        let from_north = front.get(index + 1).map_or(0, |row| row & !passages.north[index]);
        *next = (beside | from_south | from_north) & open[index];
    }
    next
}

/// Position and cell size of the grid.
pub(super) struct Grid {
    pub(super) began_ned_m: Horizontal,
    pub(super) cell_m: f32,
}

impl Grid {
    pub(super) fn place_of(&self, cell: Cell) -> Horizontal {
        let offset = |index: u8| (f32::from(index) - MIDDLE as f32) * self.cell_m;
        self.began_ned_m.plus(Horizontal { north: offset(cell.row), east: offset(cell.column) })
    }

    pub(super) fn cell_at(&self, place_ned_m: Horizontal) -> Option<Cell> {
        let offset = place_ned_m.minus(self.began_ned_m).times(1.0 / self.cell_m);
        let index = |value: f32| {
            let shifted = value + (MIDDLE as f32 + 0.5);
            (shifted >= 0.0 && shifted < SIDE as f32).then_some(shifted as u8)
        };
        Some(Cell { row: index(offset.north)?, column: index(offset.east)? })
    }

    /// The cells of a square around a place that contains all places within a distance.
    pub(super) fn cells_within(&self, place_ned_m: Horizontal, reach_m: f32) -> impl Iterator<Item = Cell> + use<> {
        let offset = place_ned_m.minus(self.began_ned_m).times(1.0 / self.cell_m);
        let reach = reach_m / self.cell_m;
        // Conversions to integers saturate, and NaN becomes zero.
        let limits = |value: f32| {
            let first = value - reach + MIDDLE as f32;
            let last = value + reach + (MIDDLE as f32 + 1.0);
            (first as usize).min(SIDE) as u8..(last as usize).min(SIDE) as u8
        };
        let columns = limits(offset.east);
        limits(offset.north).flat_map(move |row| columns.clone().map(move |column| Cell { row, column }))
    }
}

pub(super) fn has(rows: &Rows, cell: Cell) -> bool {
    rows.get(usize::from(cell.row)).is_some_and(|row| row >> (cell.column & 31) & 1 != 0)
}

pub(super) fn set(rows: &mut Rows, cell: Cell) {
    if let Some(row) = rows.get_mut(usize::from(cell.row)) {
        *row |= 1 << (cell.column & 31);
    }
}

/// The cells of a row whose bits are set.
pub(super) fn cells_of(row: usize, bits: u32) -> impl Iterator<Item = Cell> {
    (0..SIDE as u8).filter(move |column| bits >> column & 1 != 0).map(move |column| Cell { row: row as u8, column })
}
