//! Path search: distances from the vehicle to every place in a window of the remembered map, by fast marching.
//!
//! A window of 90 x 90 cells moves with the vehicle. Cells within an obstacle's reach are closed; a rim around it is
//! passable but slow, so that a wide path is preferred and a narrow one still possible; places that have not been seen
//! count as free. A wave starts at the vehicle and is propagated from cell to cell by the upwind solution of the
//! eikonal equation `|grad T| = slowness` (Sethian 1996): the arrival at a cell is the length of the shortest path
//! there, in any direction and not only along the grid. The cells wait in buckets narrower than half a step instead of in
//! a sorted queue (Yatziv, Bartesaghi and Sapiro 2006), a cell whose arrival improves is queued again, and all
//! arithmetic is integer: a table of 65 entries holds the square roots.
//!
//! Memory 24 KB, fixed; counted in the bench row `replan_64`.

use core::ops::Range;

use heapless::Vec;

use crate::base::config::Fence;
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Obstacle;

/// Number of cells along a side, including a closed rim that makes bounds checks inside unnecessary.
pub const SIDE: usize = 92;
const CELLS: usize = SIDE * SIDE;
/// Units of arrival in one cell's width.
const UNIT: u16 = 64;
/// Arrival of a cell that the wave has not reached.
const FAR: u16 = u16::MAX - 1;
/// Arrival of a cell that is closed.
const CLOSED: u16 = u16::MAX;
/// log2 of the width of a bucket, in units.
const BUCKET_SHIFT: u16 = 4;
/// Number of buckets; together they span more than the longest step, which is a slow one.
const BUCKETS: usize = 32;
/// Largest number of entries waiting at a time. The front is a curve, not an area.
const WAITING_MAX: usize = 1024;
const NONE: u16 = u16::MAX;
/// Largest number of steps of the path back to the start that are stored: those nearest to the start.
pub const ROUTE_MAX: usize = 48;
/// Number of cells whose rims are in one word.
const PER_WORD: usize = 16;
/// Half the diagonal of a cell, in cells.
const DIAGONAL: f32 = core::f32::consts::FRAC_1_SQRT_2;
/// Largest shift of the window ahead of the vehicle, towards its aim.
const AHEAD_M: f32 = 1.2;
/// Width of a cell.
const CELL_M: f32 = 0.1;
/// Clearance above which a cell is not slowed; it is twice as slow below that, and four times where there is none.
const CLEAR_M: f32 = 0.03;

/// `UNIT` times `(d + sqrt(2 - d^2)) / 2` for `d = index / UNIT`: the delay of a cell after its earlier neighbour, when
/// the other neighbour is reached `d` later than the earlier one.
const STEP: [u8; UNIT as usize + 1] = steps();

const fn steps() -> [u8; UNIT as usize + 1] {
    let mut table = [0_u8; UNIT as usize + 1];
    let mut d = 0_u32;
    while d <= UNIT as u32 {
        // The root of a number scaled by 2^8, rounded.
        let wanted = (2 * (UNIT as u32) * (UNIT as u32) - d * d) << 8;
        let mut root = 0_u32;
        while (root + 1) * (root + 1) <= wanted {
            root += 1;
        }
        table[d as usize] = (((d << 4) + root + 16) >> 5) as u8;
        d += 1;
    }
    table
}

/// The window, and the distances in it after a march.
#[derive(Clone, Debug)]
pub struct Window {
    /// Outer (south-western) corner of cell (0, 0).
    corner_ned_m: Horizontal,
    cell_m: f32,
    start_ned_m: Horizontal,
    arrival: [u16; CELLS],
    /// Two bits per cell: in the outer rim, in the inner one.
    rims: [u32; CELLS / PER_WORD],
    queue: Queue,
}

/// The cells from which the wave goes on, sorted by arrival: a list in each bucket.
#[derive(Clone, Debug)]
struct Queue {
    first: [u16; BUCKETS],
    waiting: [Waiting; WAITING_MAX],
    free: u16,
    /// Number of entries for which the queue had no space.
    dropped: u32,
}

/// The kind of cells that a disc is drawn as.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Tier {
    Outer,
    Inner,
    Closed,
}

/// An entry of a bucket: a cell, and the entry after it.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    cell: u16,
    next: u16,
}

impl Default for Window {
    fn default() -> Self {
        Self::new()
    }
}

impl Window {
    /// A window without width, in which no cell has been reached. All bits are zero, so that it takes no flash.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            corner_ned_m: Horizontal { north: 0.0, east: 0.0 },
            cell_m: 0.0,
            start_ned_m: Horizontal { north: 0.0, east: 0.0 },
            arrival: [0; CELLS],
            rims: [0; CELLS / PER_WORD],
            queue: Queue {
                first: [0; BUCKETS],
                waiting: [Waiting { cell: 0, next: 0 }; WAITING_MAX],
                free: 0,
                dropped: 0,
            },
        }
    }

    /// Index of a place's cell; `None` outside the window or in its rim.
    fn cell_at(&self, place_ned_m: Horizontal) -> Option<usize> {
        if !(self.cell_m > 0.0) {
            return None;
        }
        let offset = self.in_cells(place_ned_m);
        let inside = |value: f32| value >= 1.0 && value < (SIDE - 1) as f32;
        (inside(offset.north) && inside(offset.east)).then(|| offset.north as usize * SIDE + offset.east as usize)
    }

    /// A place relative to the corner, in cells.
    fn in_cells(&self, place_ned_m: Horizontal) -> Horizontal {
        place_ned_m.minus(self.corner_ned_m).times(1.0 / self.cell_m)
    }

    /// When the wave reaches a cell; cells outside the window are closed.
    fn arrival(&self, cell: usize) -> u16 {
        self.arrival.get(cell).copied().unwrap_or(CLOSED)
    }

    fn close(&mut self, cell: usize) {
        if let Some(arrival) = self.arrival.get_mut(cell) {
            *arrival = CLOSED;
        }
    }

    /// Centre of a cell.
    fn place_of(&self, cell: usize) -> Horizontal {
        let (row, column) = (cell / SIDE, cell % SIDE);
        let offset = Horizontal { north: row as f32 + 0.5, east: column as f32 + 0.5 };
        self.corner_ned_m.plus(offset.times(self.cell_m))
    }

    /// Length of the shortest path to a place; `None` if there is none, or the place is outside the window.
    #[must_use]
    pub fn arrival_m(&self, place_ned_m: Horizontal) -> Option<f32> {
        let arrival = self.arrival(self.cell_at(place_ned_m)?);
        (arrival < FAR).then(|| f32::from(arrival) * self.cell_m / f32::from(UNIT))
    }

    /// Whether a place lies in the window.
    #[must_use]
    pub fn contains(&self, place_ned_m: Horizontal) -> bool {
        self.cell_at(place_ned_m).is_some()
    }

    /// The reached place at the window's edge over which the path to a place outside is shortest, with a straight line
    /// from the edge.
    #[must_use]
    pub fn best_exit(&self, outside_ned_m: Horizontal) -> Option<Horizontal> {
        self.least(edge(), |arrival_m, place| arrival_m + outside_ned_m.minus(place).norm())
    }

    /// The reached place at the window's edge that is nearest to one outside.
    #[must_use]
    pub fn nearest_exit(&self, outside_ned_m: Horizontal) -> Option<Horizontal> {
        self.least(edge(), |_, place| outside_ned_m.minus(place).norm_squared())
    }

    /// The reached place nearest to an unreachable one, if it is within a radius.
    #[must_use]
    pub fn nearest_reached_within(&self, place_ned_m: Horizontal, radius_m: f32) -> Option<Horizontal> {
        let center = self.cell_at(place_ned_m)?;
        let half = (libm::ceilf(radius_m / self.cell_m) as usize).min(SIDE);
        let (row, column) = (center / SIDE, center % SIDE);
        let rows = row.saturating_sub(half)..(row + half + 1).min(SIDE);
        let columns = column.saturating_sub(half)..(column + half + 1).min(SIDE);
        let around = rows.flat_map(|row| columns.clone().map(move |column| row * SIDE + column));
        let nearest = self.least(around, |_, place| place_ned_m.minus(place).norm_squared())?;
        (nearest.minus(place_ned_m).norm() <= radius_m).then_some(nearest)
    }

    /// The reached place nearest to an unreachable one.
    #[must_use]
    pub fn nearest_reached(&self, place_ned_m: Horizontal) -> Option<Horizontal> {
        self.least(0..CELLS, |_, place| place_ned_m.minus(place).norm_squared())
    }

    /// Whether a place that has not been reached may be connected to the window's edge, so that a path from the start
    /// may reach it from outside. The cells connected with it count as closed from then on.
    pub fn is_open(&mut self, place_ned_m: Horizontal) -> bool {
        let Some(center) = self.cell_at(place_ned_m) else { return true };
        // The entries of the march, as a stack.
        let (mut height, mut open) = (0, false);
        for (row, column, _) in NEIGHBOURS.into_iter().chain([(0, 0, 0)]) {
            height = self.stack(center.wrapping_add_signed(row + column), height);
        }
        while let Some(top) = height.checked_sub(1) {
            height = top;
            let Some(cell) = self.queue.waiting.get(top).map(|waiting| usize::from(waiting.cell)) else { break };
            let (row, column) = (cell / SIDE, cell % SIDE);
            // When the stack is full, cells are left out; such a large area counts as open.
            open |= row == 1 || row == SIDE - 2 || column == 1 || column == SIDE - 2 || height + 8 > WAITING_MAX;
            for there in [cell - SIDE, cell + SIDE, cell - 1, cell + 1] {
                height = self.stack(there, height);
            }
        }
        open
    }

    /// Puts a cell that has not been reached onto the stack, and closes it; returns the new height.
    fn stack(&mut self, cell: usize, height: usize) -> usize {
        match (self.queue.waiting.get_mut(height), self.arrival.get_mut(cell)) {
            (Some(waiting), Some(arrival)) if *arrival == FAR => {
                waiting.cell = cell as u16;
                *arrival = CLOSED;
                height + 1
            }
            _ => height,
        }
    }

    fn least(
        &self,
        cells: impl Iterator<Item = usize>,
        measure: impl Fn(f32, Horizontal) -> f32,
    ) -> Option<Horizontal> {
        let mut best: Option<(f32, Horizontal)> = None;
        for cell in cells {
            let arrival = self.arrival(cell);
            if arrival >= FAR || !(self.cell_m > 0.0) {
                continue;
            }
            let place = self.place_of(cell);
            let value = measure(f32::from(arrival) * self.cell_m / f32::from(UNIT), place);
            if best.is_none_or(|(least, _)| value < least) {
                best = Some((value, place));
            }
        }
        best.map(|(_, place)| place)
    }

    /// The shortest path to a reached place, by steepest descent of the arrival: the part nearest to the start,
    /// beginning at the start. Empty if the place has not been reached.
    #[must_use]
    pub fn route(&self, to_ned_m: Horizontal) -> Vec<Horizontal, ROUTE_MAX> {
        let mut ring = [0_u16; ROUTE_MAX];
        let mut steps = 0;
        let mut cell = self.cell_at(to_ned_m).filter(|cell| self.arrival(*cell) < FAR);
        while let Some(here) = cell {
            let its_arrival = self.arrival(here);
            ring[steps % ROUTE_MAX] = here as u16;
            steps += 1;
            if steps > CELLS {
                break;
            }
            // A diagonal step is longer by the root of two: 5 : 7.
            let mut steepest = (0_u32, None);
            for (row, column, weight) in NEIGHBOURS {
                let arrival = |offset: isize| self.arrival(here.wrapping_add_signed(offset));
                let there = here.wrapping_add_signed(row + column);
                let drop = u32::from(its_arrival.saturating_sub(self.arrival(there))) * weight;
                // Not between two cells that are closed: the wave does not pass there either.
                if drop > steepest.0 && (arrival(row) < FAR || arrival(column) < FAR) {
                    steepest = (drop, Some(there));
                }
            }
            cell = steepest.1;
        }
        let kept = steps.min(ROUTE_MAX);
        let mut route = Vec::new();
        for back in 1..=kept {
            let _ = route.push(self.place_of(usize::from(ring[(steps - back) % ROUTE_MAX])));
        }
        route
    }

    /// Number of entries for which the queue had no space in the last march; if not zero, some paths may have been
    /// missed.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.queue.dropped
    }

    /// Closes the cells of some columns of a row, or marks them as part of a rim.
    fn mark(&mut self, row: usize, columns: Range<usize>, tier: Tier) {
        if columns.is_empty() {
            return;
        }
        let (from, to) = (row * SIDE + columns.start, row * SIDE + columns.end);
        let bits: u32 = match tier {
            Tier::Closed => return self.arrival.get_mut(from..to).unwrap_or_default().fill(CLOSED),
            Tier::Outer => 0x5555_5555,
            Tier::Inner => 0xaaaa_aaaa,
        };
        let words = from / PER_WORD..to.div_ceil(PER_WORD);
        for (index, word) in words.clone().zip(self.rims.get_mut(words).unwrap_or_default()) {
            let low = from.saturating_sub(index * PER_WORD);
            let high = (to - index * PER_WORD).min(PER_WORD);
            *word |= bits & ((u32::MAX >> (2 * (PER_WORD - (high - low)))) << (2 * low));
        }
    }

    /// The wave reaches a cell; queues the cell so that it goes on from there.
    fn reach(&mut self, cell: usize, arrival: u16) {
        if let Some(its_arrival) = self.arrival.get_mut(cell) {
            *its_arrival = arrival;
            self.queue.push(cell, arrival);
        }
    }
}

impl Queue {
    fn clear(&mut self) {
        self.first = [NONE; BUCKETS];
        for (index, waiting) in self.waiting.iter_mut().enumerate() {
            waiting.next = if index + 1 < WAITING_MAX { index as u16 + 1 } else { NONE };
        }
        (self.free, self.dropped) = (0, 0);
    }

    fn push(&mut self, cell: usize, arrival: u16) {
        let entry = self.free;
        let Some(waiting) = self.waiting.get_mut(usize::from(entry)) else {
            self.dropped += 1;
            return;
        };
        let first = &mut self.first[usize::from(arrival >> BUCKET_SHIFT) % BUCKETS];
        self.free = waiting.next;
        *waiting = Waiting { cell: cell as u16, next: *first };
        *first = entry;
    }

    /// Takes a cell that waits in a bucket.
    fn pop(&mut self, bucket: usize) -> Option<usize> {
        let first = &mut self.first[bucket % BUCKETS];
        let entry = *first;
        // No entry has the number `NONE`.
        let waiting = self.waiting.get_mut(usize::from(entry))?;
        *first = waiting.next;
        waiting.next = self.free;
        self.free = entry;
        Some(usize::from(waiting.cell))
    }
}

const ROW: isize = SIDE as isize;
/// The way to each cell around one, by rows and by columns, and the weight of a step there.
const NEIGHBOURS: [(isize, isize, u32); 8] =
    [(-ROW, 0, 7), (ROW, 0, 7), (0, -1, 7), (0, 1, 7), (-ROW, -1, 5), (-ROW, 1, 5), (ROW, -1, 5), (ROW, 1, 5)];

/// Fills a window around `start_ned_m` with distances. `scale` enlarges the cells, to cover a wider area. An
/// obstacle that contains the start is shrunk to end just short of it. What lies outside of the fence is closed, and so are
/// gaps of less than twice `passable_m`.
pub fn march(
    window: &mut Window,
    start_ned_m: Horizontal,
    towards_ned_m: Horizontal,
    scale: f32,
    passable_m: f32,
    obstacles: &[Obstacle],
    fence: &Fence,
) {
    let cell_m = CELL_M * scale;
    let half_m = 0.5 * cell_m * SIDE as f32;
    let ahead = towards_ned_m.minus(start_ned_m).times(0.5).clamped(AHEAD_M * scale);
    // Aligned to the grid, so that a pillar always covers the same cells.
    let raster = |value: f32| libm::floorf(value / cell_m) * cell_m;
    let corner = start_ned_m.plus(ahead);
    window.corner_ned_m = Horizontal { north: raster(corner.north - half_m), east: raster(corner.east - half_m) };
    window.cell_m = cell_m;
    window.start_ned_m = start_ned_m;
    window.arrival.fill(FAR);
    for k in 0..SIDE {
        for cell in [k, (SIDE - 1) * SIDE + k, k * SIDE, k * SIDE + SIDE - 1] {
            window.close(cell);
        }
    }
    window.rims = [0; CELLS / PER_WORD];
    let reach_m = fence.reach_m(start_ned_m);
    if reach_m < f32::INFINITY {
        let (center, radius) = (window.in_cells(fence.center_ned_m), reach_m / cell_m);
        for row in 1..SIDE - 1 {
            let inside = columns_within(center, radius, row);
            window.mark(row, 1..inside.start, Tier::Closed);
            window.mark(row, inside.end.max(1)..SIDE - 1, Tier::Closed);
        }
    }
    for obstacle in obstacles {
        draw(window, obstacle.center_ned_m, obstacle.reach_m + CLEAR_M, Tier::Outer);
        draw(window, obstacle.center_ned_m, obstacle.reach_m, Tier::Inner);
        // A cell is closed when the middle of a just passable gap cannot lie in it, however the gap is aligned to
        // the grid.
        let free_m = obstacle.center_ned_m.minus(start_ned_m).norm() - 0.01;
        let reach_m = obstacle.reach_m + passable_m - DIAGONAL * cell_m;
        draw(window, obstacle.center_ned_m, if reach_m < free_m { reach_m } else { free_m }, Tier::Closed);
    }
    // Gaps that are too narrow are closed by a line of cells, which the wave cannot cross.
    for (index, one) in obstacles.iter().enumerate() {
        for other in obstacles.get(index + 1..).unwrap_or_default() {
            let reach_m = one.reach_m + other.reach_m + 2.0 * passable_m;
            let across = other.center_ned_m.minus(one.center_ned_m);
            if across.norm_squared() < reach_m * reach_m {
                bridge(window, one.center_ned_m, across);
            }
        }
    }
    spread(window);
}

/// The outermost cells inside the rim.
fn edge() -> impl Iterator<Item = usize> {
    (1..SIDE - 1).flat_map(|k| [SIDE + k, (SIDE - 2) * SIDE + k, k * SIDE + 1, k * SIDE + SIDE - 2])
}

/// Draws a disc: every cell whose centre is inside.
fn draw(window: &mut Window, center_ned_m: Horizontal, radius_m: f32, tier: Tier) {
    if !(radius_m > 0.0) {
        return;
    }
    let (center, radius) = (window.in_cells(center_ned_m), radius_m / window.cell_m);
    for row in cells_within(center.north, radius) {
        window.mark(row, columns_within(center, radius, row), tier);
    }
}

/// The cells of a row inside the window's rim whose middles are in a disc, all in cells.
#[inline(always)]
fn columns_within(center: Horizontal, radius: f32, row: usize) -> Range<usize> {
    let off = row as f32 + 0.5 - center.north;
    let half_squared = radius * radius - off * off;
    if half_squared > 0.0 { cells_within(center.east, sqrt(half_squared)) } else { 0..0 }
}

/// The cells along one axis inside the rim whose middles are within `half` of a place, in cells.
#[inline(always)]
fn cells_within(center: f32, half: f32) -> Range<usize> {
    let low = center - half - 0.5;
    // Saturating casts: what extends beyond the window ends at its edge.
    let below = (low as usize).min(SIDE);
    let first = below + usize::from(low > below as f32);
    first.max(1)..((center + half + 0.5) as usize).min(SIDE - 1)
}

/// Closes the cells along a line.
fn bridge(window: &mut Window, from_ned_m: Horizontal, along: Horizontal) {
    let steps = libm::ceilf(along.norm() / (0.5 * window.cell_m));
    if !(steps <= 4.0 * SIDE as f32) {
        return;
    }
    for step in 0..=steps as usize {
        if let Some(cell) =
            window.cell_at(from_ned_m.plus(along.times(step as f32 / if steps > 1.0 { steps } else { 1.0 })))
        {
            window.close(cell);
        }
    }
}

/// Propagates the wave from the start to all reachable cells.
// Not inlined: inside the planner its loop would run out of registers.
#[inline(never)]
fn spread(window: &mut Window) {
    window.queue.clear();
    let Some(origin) = window.cell_at(window.start_ned_m) else { return };
    for (row, column, _) in NEIGHBOURS.into_iter().chain([(0, 0, 0)]) {
        let cell = origin.wrapping_add_signed(row + column);
        let is_open = |offset: isize| window.arrival(origin.wrapping_add_signed(offset)) != CLOSED;
        // The start is always reached, even in a closed cell, and out of that the wave goes to every side.
        let is_passable = !is_open(0) || is_open(row) || is_open(column);
        if cell == origin || is_open(row + column) && is_passable {
            let distance = window.place_of(cell).minus(window.start_ned_m).norm() / window.cell_m;
            window.reach(cell, (distance * f32::from(UNIT)) as u16);
        }
    }

    let mut empty = 0;
    let mut bucket = 0;
    // Each cell waits a few times at most; the bound makes the end of the loop obvious.
    let mut left = 4 * CELLS;
    while empty < BUCKETS && left > 0 {
        let Some(cell) = window.queue.pop(bucket) else {
            empty += 1;
            bucket = (bucket + 1) % BUCKETS;
            continue;
        };
        empty = 0;
        left -= 1;
        let corner = cell.wrapping_sub(SIDE + 1);
        if corner > CELLS - AROUND {
            continue;
        }
        let Some(around) = window.arrival[corner..].first_chunk_mut() else { continue };
        let mut relax = |there, across| relax(around, corner, there, across, &window.rims, &mut window.queue);
        relax(1, [0, 2]);
        relax(2 * SIDE + 1, [2 * SIDE, 2 * SIDE + 2]);
        relax(SIDE, [0, 2 * SIDE]);
        relax(SIDE + 2, [2, 2 * SIDE + 2]);
    }
}

/// The cells from a cell's neighbour below left to its neighbour above right: one bounds check for all of them.
const AROUND: usize = 2 * SIDE + 3;

/// Propagates the wave from the middle to a cell, with the earlier one of the two cells across. Cells are counted from
/// the corner.
#[inline(always)]
fn relax(
    around: &mut [u16; AROUND],
    corner: usize,
    there: usize,
    across: [usize; 2],
    rims: &[u32; CELLS / PER_WORD],
    queue: &mut Queue,
) {
    let (here, old) = (u32::from(around[SIDE + 1]), u32::from(around[there]));
    // Reached earlier, or closed.
    if old <= here || old == u32::from(CLOSED) {
        return;
    }
    let across = across.map(|cell| u32::from(around[cell]));
    let across = if across[0] < across[1] { across[0] } else { across[1] };
    let (early, late) = if across < here { (across, here) } else { (here, across) };
    let shift = slowness(rims, corner + there);
    let apart = ((late - early) >> shift).min(u32::from(UNIT));
    let arrival = early + (u32::from(STEP[apart as usize]) << shift);
    if arrival < old {
        around[there] = arrival as u16;
        queue.push(corner + there, arrival as u16);
    }
}

/// log2 of the slowness of a cell: 0 in no rim, 1 in the outer one, 2 in the inner one, also when both are set.
#[inline(always)]
fn slowness(rims: &[u32; CELLS / PER_WORD], cell: usize) -> u32 {
    let bits = rims.get(cell / PER_WORD).map_or(0, |word| (word >> (2 * (cell % PER_WORD))) & 3);
    bits & !(bits >> 1)
}

#[cfg(test)]
mod tests;
