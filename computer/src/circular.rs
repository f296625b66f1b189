//! Reads a ring that DMA writes in circles.
//!
//! The writer does not wait. Its position is the number of bytes written since the start, modulo 2^32, of which the
//! ring holds the last ones. A reader that falls behind by more than the ring's size loses bytes; it never reads a
//! byte twice, nor one that was overwritten during the read.

/// Bytes written since the start, if the channel has completed `laps` laps of a ring of `length` bytes and `left`
/// bytes (`NDT` of `DMA_CNDTRx`) are missing to the next lap.
#[must_use]
pub const fn written(laps: u32, left: u32, length: u32) -> u32 {
    // A channel that is just being reloaded shows none left.
    laps.wrapping_mul(length).wrapping_add(length.saturating_sub(left) % length)
}

/// Position of a reader.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cursor {
    /// Bytes read since the start, modulo 2^32.
    read: u32,
    counts: Counts,
}

/// Counts of a reader.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bytes that were overwritten before they were read.
    pub lost: u32,
    /// The largest number that ever waited.
    pub most: u32,
}

impl Cursor {
    /// At the start.
    #[must_use]
    pub const fn new() -> Self {
        Self { read: 0, counts: Counts { lost: 0, most: 0 } }
    }

    /// Counts of the bytes.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// The writer has started anew.
    pub const fn begin_anew(&mut self) {
        self.read = 0;
    }

    /// Reads the waiting bytes, as many as fit: `written` returns the writer's position, `byte` reads the ring at an
    /// index below `length`, a power of two.
    pub fn take(
        &mut self,
        bytes: &mut [u8],
        length: u32,
        written: impl Fn() -> u32,
        byte: impl Fn(usize) -> u8,
    ) -> usize {
        loop {
            let until = written();
            let waiting = until.wrapping_sub(self.read);
            // The count of laps may be one behind for a moment.
            if waiting == 0 || waiting > u32::MAX / 2 {
                return 0;
            }
            self.counts.most = self.counts.most.max(waiting.min(length));
            if waiting > length {
                // Leaves half of the ring between it and the writer, for the time in which that goes on.
                self.skip(waiting - length / 2);
                continue;
            }
            let count = bytes.len().min(waiting as usize);
            for (offset, slot) in (0..).zip(bytes.iter_mut().take(count)) {
                *slot = byte((self.read.wrapping_add(offset) & (length - 1)) as usize);
            }
            let now_waiting = written().wrapping_sub(self.read);
            if now_waiting > length {
                self.skip(now_waiting - length / 2);
                continue;
            }
            self.read = self.read.wrapping_add(count as u32);
            return count;
        }
    }

    fn skip(&mut self, bytes: u32) {
        self.read = self.read.wrapping_add(bytes);
        self.counts.lost = self.counts.lost.saturating_add(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng as _, SeedableRng as _};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use std::cell::{Cell, RefCell};
    use std::vec;
    use std::vec::Vec;

    const LENGTH: u32 = 64;

    /// A writer of which every byte tells when it was written.
    struct Writer {
        ring: RefCell<Vec<u8>>,
        total: Cell<u32>,
    }

    impl Writer {
        fn new(total: u32) -> Self {
            Self { ring: RefCell::new(vec![0; LENGTH as usize]), total: Cell::new(total) }
        }

        fn write(&self, count: u32) {
            for _ in 0..count {
                let total = self.total.get();
                self.ring.borrow_mut()[(total % LENGTH) as usize] = total as u8;
                self.total.set(total.wrapping_add(1));
            }
        }
    }

    #[test]
    fn laps_and_what_is_left_make_the_total() {
        assert_eq!(written(0, 64, 64), 0);
        assert_eq!(written(0, 63, 64), 1);
        assert_eq!(written(2, 1, 64), 191);
        assert_eq!(written(2, 0, 64), 128, "while the channel is reloaded");
        assert_eq!(written(1 << 26, 64, 64), 0, "modulo 2^32");
    }

    #[test]
    fn every_byte_comes_once_and_in_order_over_the_end_of_the_count() {
        let begin = u32::MAX - 1000;
        let (writer, mut random) = (Writer::new(begin), Xoshiro256PlusPlus::seed_from_u64(1));
        let mut cursor = Cursor { read: begin, ..Cursor::new() };
        let mut next = begin as u8;
        for _ in 0..1000 {
            writer.write(random.next_u32() % (LENGTH + 1));
            let mut bytes = [0; 24];
            loop {
                let count = cursor.take(&mut bytes, LENGTH, || writer.total.get(), |index| writer.ring.borrow()[index]);
                for byte in &bytes[..count] {
                    assert_eq!(*byte, next);
                    next = next.wrapping_add(1);
                }
                if count == 0 {
                    break;
                }
            }
        }
        assert_eq!(cursor.counts(), Counts { lost: 0, most: LENGTH });
    }

    #[test]
    fn what_was_overwritten_is_lost_and_never_taken_for_new() {
        let writer = Writer::new(0);
        let mut cursor = Cursor::new();
        writer.write(LENGTH + 1);
        let mut bytes = [0; LENGTH as usize];
        let count = cursor.take(&mut bytes, LENGTH, || writer.total.get(), |index| writer.ring.borrow()[index]);
        assert_eq!((count, bytes[0], bytes[count - 1]), (32, 33, 64));
        assert_eq!(cursor.counts(), Counts { lost: 33, most: LENGTH });
        let count = cursor.take(&mut bytes, LENGTH, || writer.total.get(), |_| panic!("nothing is new"));
        assert_eq!(count, 0);
    }

    #[test]
    fn a_writer_that_overtakes_during_the_read_spoils_nothing() {
        let writer = Writer::new(0);
        let mut cursor = Cursor::new();
        writer.write(60);
        let mut bytes = [0; 8];
        let overtakes = Cell::new(true);
        let byte = |index| {
            if overtakes.take() {
                writer.write(10);
            }
            writer.ring.borrow()[index]
        };
        let count = cursor.take(&mut bytes, LENGTH, || writer.total.get(), byte);
        assert_eq!((count, bytes), (8, [38, 39, 40, 41, 42, 43, 44, 45]));
        assert_eq!(cursor.counts().lost, 38);
    }

    #[test]
    fn a_count_of_laps_that_is_behind_gives_nothing() {
        let mut cursor = Cursor { read: 100, ..Cursor::new() };
        assert_eq!(cursor.take(&mut [0; 8], LENGTH, || 70, |_| panic!("nothing is there")), 0);
        assert_eq!(cursor, Cursor { read: 100, ..Cursor::new() });
    }
}
