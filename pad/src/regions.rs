//! Regions of selected pixels, line by line: the majority of three lines, runs, and regions made of runs.
//!
//! A run joins the region whose last line it overlaps; gaps in runs by a cable, and lines hidden by it, are bridged.
//! Of a region its outline is kept (first and last column of up to [`ROWS`] lines, of every second, fourth or eighth
//! when it is higher), its area, its moments and colours inside and outside of its edge and of a gap in its middle.
//! When the table is full the smallest region is replaced.

#![deny(clippy::float_arithmetic)]

use super::{Format, WIDTH_MAX};

/// Words of a line, a bit a pixel, the first one in the highest bit.
pub(super) const WORDS: usize = WIDTH_MAX as usize / 32;
/// Lines of an outline.
pub(super) const ROWS: usize = 24;
/// Largest number of regions at a time.
pub(super) const REGIONS: usize = 12;
/// Pixels from the edge to where the colours are sampled.
const STEP_IN: u16 = 2;
/// Shorter runs are ignored as noise.
const RUN_MIN: u16 = 2;
/// Narrower gaps consist only of edges.
const GAP_MIN: u16 = 2;
/// Colour samples that a sum can hold.
const SAMPLES_MAX: u8 = 250;

/// Selected pixels of a line.
pub(super) type Mask = [u32; WORDS];

/// First column, and the one after the last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Span {
    pub(super) from: u16,
    pub(super) to: u16,
}

impl Span {
    fn touches(self, other: Self) -> bool {
        self.from <= other.to && other.from <= self.to
    }

    fn hull(self, other: Self) -> Self {
        Self { from: self.from.min(other.from), to: self.to.max(other.to) }
    }
}

/// First and last column of some lines.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outline {
    /// Number of the first line kept, by `1 << shift`.
    top: u8,
    length: u8,
    /// One line in this many is kept: `1 << shift`.
    shift: u8,
    /// First and last column; none if the first is after the last.
    ends: [[u8; 2]; ROWS],
}

const NO_ENDS: [u8; 2] = [255, 0];

impl Outline {
    const fn new() -> Self {
        Self { top: 0, length: 0, shift: 0, ends: [[0; 2]; ROWS] }
    }

    /// The lines: number, from, to.
    pub(super) fn lines(&self) -> impl DoubleEndedIterator<Item = (u16, [u8; 2])> + '_ {
        let lines = self.ends.iter().take(usize::from(self.length)).enumerate();
        lines
            .map(|(at, ends)| ((u16::from(self.top) + at as u16) << self.shift, *ends))
            .filter(|(_, [from, to])| from <= to)
    }

    /// From the first column of any line to the last of any.
    pub(super) fn width(&self) -> u16 {
        let hull = self.lines().fold(NO_ENDS, |hull, (_, [from, to])| [hull[0].min(from), hull[1].max(to)]);
        u16::from(hull[1].saturating_sub(hull[0]))
    }

    /// One line in this many is kept.
    pub(super) fn step(&self) -> u16 {
        1 << self.shift
    }

    /// Keeps every second line of those kept.
    fn coarsen(&mut self) {
        let top = self.top;
        let mut length = 0_u8;
        for at in usize::from(top & 1)..usize::from(self.length) {
            if (at + usize::from(top)) % 2 == 0
                && let Some(ends) = self.ends.get(at).copied()
                && let Some(slot) = self.ends.get_mut(usize::from(length))
            {
                *slot = ends;
                length += 1;
            }
        }
        (self.top, self.length, self.shift) = (top.div_ceil(2), length, self.shift + 1);
    }

    /// Adds a line, unless it falls between those kept.
    fn put(&mut self, row: u16, ends: [u8; 2]) {
        // Up to 240 lines: three times at most.
        for _ in 0..8 {
            if row & ((1 << self.shift) - 1) != 0 {
                return;
            }
            let number = row >> self.shift;
            if self.length == 0 {
                self.top = number as u8;
            }
            let (top, length) = (u16::from(self.top), u16::from(self.length));
            let above = top.saturating_sub(number);
            let at = number.saturating_sub(top);
            if above + length > ROWS as u16 || at >= ROWS as u16 {
                self.coarsen();
                continue;
            }
            if above > 0 {
                let above = usize::from(above);
                self.ends.copy_within(0..usize::from(length), above);
                self.ends.iter_mut().take(above).for_each(|ends| *ends = NO_ENDS);
                (self.top, self.length) = (number as u8, (length + above as u16) as u8);
            }
            let at = usize::from(at);
            while usize::from(self.length) <= at {
                if let Some(slot) = self.ends.get_mut(usize::from(self.length)) {
                    *slot = NO_ENDS;
                }
                self.length += 1;
            }
            if let Some([from, to]) = self.ends.get_mut(at) {
                (*from, *to) = ((*from).min(ends[0]), (*to).max(ends[1]));
            }
            return;
        }
    }

    fn merge(&mut self, other: &Self) {
        while self.shift < other.shift {
            self.coarsen();
        }
        for (row, ends) in other.lines() {
            self.put(row, ends);
        }
    }
}

/// Sums of red, green and blue, or of grey in all three, and how many.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Colour {
    pub(super) sums: [u16; 3],
    pub(super) count: u8,
}

impl Colour {
    fn add(&mut self, format: Format, bytes: &[u8], column: u16) {
        if self.count >= SAMPLES_MAX {
            return;
        }
        let at = usize::from(column);
        let values = match format {
            Format::Rgb565 => {
                let Some([low, high]) = bytes.as_chunks::<2>().0.get(at).copied() else { return };
                let pixel = u16::from_le_bytes([low, high]);
                [pixel >> 11 << 1, pixel >> 5 & 63, (pixel & 31) << 1]
            }
            Format::Grey => [bytes.get(at).map_or(0, |value| u16::from(*value)); 3],
        };
        for (sum, value) in self.sums.iter_mut().zip(values) {
            *sum += value;
        }
        self.count += 1;
    }

    /// Means times 16.
    pub(super) fn mean16(&self) -> [u32; 3] {
        self.sums.map(|sum| 16 * u32::from(sum) / u32::from(self.count.max(1)))
    }

    fn merge(&mut self, other: &Self) {
        let total = u16::from(self.count) + u16::from(other.count);
        // If two sums do not fit into one, the larger is kept.
        if total <= u16::from(SAMPLES_MAX) {
            for (sum, value) in self.sums.iter_mut().zip(other.sums) {
                *sum += value;
            }
            self.count = total as u8;
        } else if other.count > self.count {
            *self = *other;
        }
    }
}

/// Connected pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Region {
    /// Pixels; 0: the place is free.
    pub(super) area: u32,
    /// Sums over the pixels of column, line, and both squared.
    pub(super) column_sum: u32,
    pub(super) row_sum: u32,
    pub(super) square_sum: u32,
    pub(super) inside: Colour,
    pub(super) outside: Colour,
    /// Colour in the middle of lines with a gap.
    pub(super) gap: Colour,
    pub(super) outline: Outline,
    /// Its last line, that line's span, and that of the line before.
    row: u8,
    first_row: u8,
    /// 0 dark or red, 1 bright.
    pub(super) class: u8,
    span: Span,
    before: Span,
}

impl Region {
    const fn free() -> Self {
        Self {
            area: 0,
            column_sum: 0,
            row_sum: 0,
            square_sum: 0,
            inside: Colour { sums: [0; 3], count: 0 },
            outside: Colour { sums: [0; 3], count: 0 },
            gap: Colour { sums: [0; 3], count: 0 },
            outline: Outline::new(),
            row: 0,
            first_row: 0,
            class: 0,
            span: Span { from: 0, to: 0 },
            before: Span { from: 0, to: 0 },
        }
    }

    pub(super) fn first_row(&self) -> u16 {
        u16::from(self.first_row)
    }

    pub(super) fn last_row(&self) -> u16 {
        u16::from(self.row)
    }

    /// Whether its outline reaches the left or the right border of the picture.
    pub(super) fn touches_border(&self, width_px: u16) -> bool {
        let narrow = u8::from(width_px > 255);
        self.outline.lines().any(|(_, [from, to])| from == 0 || u16::from(to) >= width_px >> narrow)
    }

    /// How many lines of it may be hidden.
    fn is_open(&self, row: u8) -> bool {
        let height = self.row - self.first_row;
        row.saturating_sub(self.row) <= 2 + height / 8
    }

    /// The span that a run of this line must touch.
    fn last(&self, row: u8) -> Span {
        if self.row == row { self.before } else { self.span }
    }

    /// Puts the span of the last line into the outline.
    fn keep_line(&mut self, narrow: u8) {
        let [from, to] = [self.span.from >> narrow, self.span.to >> narrow];
        self.outline.put(u16::from(self.row), [from.min(255) as u8, to.min(255) as u8]);
    }

    /// Both as one, if that is no higher and wider than this many pixels.
    pub(super) fn with(&self, other: &Self, most_px: u32) -> Option<Self> {
        let (first, last) = (self.first_row.min(other.first_row), self.row.max(other.row));
        let mut both = *self;
        both.merge(other);
        both.row = last;
        let is_small = u32::from(last - first) <= most_px && u32::from(both.outline.width()) <= most_px;
        (is_small && self.class == other.class).then_some(both)
    }

    fn merge(&mut self, other: &Self) {
        self.area += other.area;
        self.column_sum += other.column_sum;
        self.row_sum += other.row_sum;
        self.square_sum = self.square_sum.saturating_add(other.square_sum);
        self.inside.merge(&other.inside);
        self.outside.merge(&other.outside);
        self.gap.merge(&other.gap);
        self.outline.merge(&other.outline);
        self.first_row = self.first_row.min(other.first_row);
    }
}

/// A run: its span, and how many of its pixels passed.
#[derive(Clone, Copy)]
struct Run {
    span: Span,
    count: u16,
    /// Position of the widest gap that it bridges.
    gap: Span,
}

/// The regions of a frame so far.
#[derive(Clone, Debug)]
pub(super) struct Regions {
    table: [Region; REGIONS],
    /// Columns per column of an outline: `1 << narrow`.
    narrow: u8,
    /// Number of places used, from the first on.
    used: u8,
}

impl Regions {
    pub(super) const fn new() -> Self {
        Self { table: [Region::free(); REGIONS], narrow: 0, used: 0 }
    }

    pub(super) fn begin(&mut self, width_px: u16) {
        for region in &mut self.table {
            region.area = 0;
        }
        self.narrow = u8::from(width_px > 255);
        self.used = 0;
    }

    /// Columns per column of an outline.
    pub(super) fn narrow(&self) -> u8 {
        self.narrow
    }

    /// Ends the frame.
    pub(super) fn end(&mut self) {
        for region in self.table.iter_mut().filter(|region| region.area > 0) {
            region.keep_line(self.narrow);
        }
    }

    /// The regions found.
    pub(super) fn all(&self) -> impl Iterator<Item = &Region> {
        self.table.iter().filter(|region| region.area > 0)
    }

    /// Processes a line; `bytes` are its pixels, or those of a neighbour, for the colours at the edges.
    pub(super) fn line(&mut self, row: u8, class: u8, mask: impl Iterator<Item = u32>, format: Format, bytes: &[u8]) {
        let mut waiting: Option<Run> = None;
        let mut begun: Option<u16> = None;
        let mut base = 0;
        for word in mask {
            let mut word = word;
            let first = base;
            base += 32;
            // Most are whole words without an edge.
            if word == 0 && begun.is_none() || word == u32::MAX && begun.is_some() {
                continue;
            }
            let mut column = 0_u16;
            loop {
                let ahead = if begun.is_some() { (!word).leading_zeros() } else { word.leading_zeros() } as u16;
                if column + ahead >= 32 {
                    break;
                }
                column += ahead;
                word = word.checked_shl(u32::from(ahead)).unwrap_or(0);
                match begun.take() {
                    None => begun = Some(first + column),
                    Some(from) => {
                        let to = first + column;
                        let run = Run { span: Span { from, to }, count: to - from, gap: Span::default() };
                        waiting = self.queue(waiting, run, row, class, format, bytes);
                    }
                }
            }
        }
        if let Some(from) = begun {
            let run = Run { span: Span { from, to: base }, count: base - from, gap: Span::default() };
            waiting = self.queue(waiting, run, row, class, format, bytes);
        }
        if let Some(run) = waiting {
            self.take(run, row, class, format, bytes);
        }
    }

    /// Merges a run with the one before it if the gap between them is narrow; otherwise processes the one before.
    fn queue(
        &mut self,
        waiting: Option<Run>,
        run: Run,
        row: u8,
        class: u8,
        format: Format,
        bytes: &[u8],
    ) -> Option<Run> {
        if run.count < RUN_MIN {
            return waiting;
        }
        let Some(before) = waiting else { return Some(run) };
        if run.span.from - before.span.to <= 2 + before.count.max(run.count) / 8 {
            let gap = Span { from: before.span.to, to: run.span.from };
            let gap = if gap.to - gap.from > before.gap.to - before.gap.from { gap } else { before.gap };
            return Some(Run { span: before.span.hull(run.span), count: before.count + run.count, gap });
        }
        self.take(before, row, class, format, bytes);
        Some(run)
    }

    fn take(&mut self, run: Run, row: u8, class: u8, format: Format, bytes: &[u8]) {
        let mut joined: Option<usize> = None;
        for at in 0..usize::from(self.used) {
            let Some(region) = self.table.get(at) else { break };
            let is_its =
                region.area > 0 && region.class == class && region.is_open(row) && region.last(row).touches(run.span);
            if !is_its {
                continue;
            }
            match joined {
                None => joined = Some(at),
                Some(first) => self.unite(first, at, row),
            }
        }
        let at = match joined {
            Some(at) => at,
            None => match self.place(run, row, class) {
                Some(at) => at,
                None => return,
            },
        };
        let narrow = self.narrow;
        let Some(region) = self.table.get_mut(at) else { return };
        if region.area > 0 && region.row != row {
            region.keep_line(narrow);
            (region.before, region.span, region.row) = (region.span, run.span, row);
        } else {
            if region.area > 0 && run.span.from > region.span.to + GAP_MIN {
                region.gap.add(format, bytes, region.span.to.midpoint(run.span.from));
            }
            region.span = if region.area > 0 { region.span.hull(run.span) } else { run.span };
        }
        if run.gap.to > run.gap.from + GAP_MIN {
            region.gap.add(format, bytes, run.gap.from.midpoint(run.gap.to));
        }
        let (count, line) = (u32::from(run.count), u32::from(row));
        let twice_middle = u32::from(run.span.from) + u32::from(run.span.to) - 1;
        region.area += count;
        region.column_sum += count * twice_middle / 2;
        region.row_sum += count * line;
        // Around the middle a run of n has n (n^2 - 1) / 12.
        let squares = count * (twice_middle * twice_middle / 4 + line * line + count * count / 12);
        region.square_sum = region.square_sum.saturating_add(squares);
        // One end of a line is enough, and in a large region one of every second line.
        if run.count >= 2 * STEP_IN && (row.is_multiple_of(2) || region.inside.count < 24) {
            let (span, out) = (run.span, STEP_IN + 1);
            if (row ^ (row >> 1)).is_multiple_of(2) {
                region.inside.add(format, bytes, span.from + STEP_IN);
                if span.from >= out {
                    region.outside.add(format, bytes, span.from - out);
                }
            } else {
                region.inside.add(format, bytes, span.to - out);
                let width = bytes.len() as u16 / if format == Format::Rgb565 { 2 } else { 1 };
                if span.to + STEP_IN < width {
                    region.outside.add(format, bytes, span.to + STEP_IN);
                }
            }
        }
    }

    /// Merges two regions.
    fn unite(&mut self, first: usize, second: usize, row: u8) {
        let narrow = self.narrow;
        let Some(other) = self.table.get_mut(second) else { return };
        let mut gone = *other;
        other.area = 0;
        // Its line belongs to the other region, if that has reached this one.
        let is_here = gone.row == row;
        if !is_here {
            gone.keep_line(narrow);
        }
        let Some(region) = self.table.get_mut(first) else { return };
        let (is_first_here, newer) = (region.row == row, gone.row > region.row);
        let last = gone.last(row);
        if is_here && !is_first_here {
            region.keep_line(narrow);
            (region.before, region.span, region.row) = (region.span.hull(last), gone.span, row);
        } else if is_here {
            region.before = region.before.hull(last);
            region.span = region.span.hull(gone.span);
        } else if is_first_here {
            region.before = region.before.hull(last);
        } else {
            region.keep_line(narrow);
            if newer {
                region.row = gone.row;
            }
            region.span = region.span.hull(last);
        }
        region.merge(&gone);
    }

    /// A place for a new region: a free one, or that of the smallest, if it is no larger than the run.
    fn place(&mut self, run: Run, row: u8, class: u8) -> Option<usize> {
        let (at, region) = self.table.iter_mut().enumerate().min_by_key(|(_, region)| region.area)?;
        if region.area > 0 {
            // Closed ones of a few pixels were noise.
            if region.area > u32::from(run.count) && (region.is_open(row) || region.area > 24) {
                return None;
            }
        }
        self.used = self.used.max(at as u8 + 1);
        *region = Region::free();
        (region.row, region.first_row, region.class) = (row, row, class);
        (region.span, region.before) = (run.span, run.span);
        Some(at)
    }
}

/// The majority of three lines. Along the lines, pixels are already summed by threes.
pub(super) fn most<'a>([above, middle, below]: [&'a Mask; 3], width_px: u16) -> impl Iterator<Item = u32> + 'a {
    let words = usize::from(width_px.div_ceil(32)).min(WORDS);
    above.iter().zip(middle).zip(below).take(words).map(|((a, b), c)| (a & b) | (c & (a | b)))
}
