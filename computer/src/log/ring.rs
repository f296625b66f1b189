//! A queue of bytes from the fast loop to the maintenance port: one writer, one reader, neither waits.
//!
//! A draft becomes readable when it is committed, all of it at once; a draft that does not fit is dropped without a
//! trace. The bytes are atomics, so that there are no locks and no `unsafe`: storing one is a plain store.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

/// Space for `N - 1` bytes. All its bits are zero at first.
#[derive(Debug)]
pub struct Ring<const N: usize> {
    bytes: [AtomicU8; N],
    /// Position of the next byte to write and to read; equal if it is empty.
    head: AtomicUsize,
    tail: AtomicUsize,
}

impl<const N: usize> Ring<N> {
    /// An empty one.
    #[must_use]
    pub const fn new() -> Self {
        Self { bytes: [const { AtomicU8::new(0) }; N], head: AtomicUsize::new(0), tail: AtomicUsize::new(0) }
    }

    /// Its two ends.
    pub fn ends(&mut self) -> (Producer<'_>, Consumer<'_>) {
        let Self { bytes, head, tail } = self;
        (Producer { bytes, head, tail }, Consumer { bytes, head, tail })
    }
}

impl<const N: usize> Default for Ring<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// The writer.
#[derive(Debug)]
pub struct Producer<'a> {
    bytes: &'a [AtomicU8],
    head: &'a AtomicUsize,
    tail: &'a AtomicUsize,
}

/// The reader.
#[derive(Debug)]
pub struct Consumer<'a> {
    bytes: &'a [AtomicU8],
    head: &'a AtomicUsize,
    tail: &'a AtomicUsize,
}

/// The position after `at`.
fn next(at: usize, length: usize) -> usize {
    if at + 1 < length { at + 1 } else { 0 }
}

impl Producer<'_> {
    /// Whether everything has been read.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.head.load(Ordering::Relaxed) == self.tail.load(Ordering::Acquire)
    }

    /// Bytes that fit in total.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.bytes.len().saturating_sub(1)
    }

    /// Bytes that fit now.
    #[must_use]
    pub fn room(&self) -> usize {
        let (head, tail) = (self.head.load(Ordering::Relaxed), self.tail.load(Ordering::Acquire));
        let used = if head >= tail { head - tail } else { head + self.bytes.len() - tail };
        self.capacity().saturating_sub(used)
    }

    /// Begins to write.
    #[must_use]
    pub fn draft(&self) -> Draft {
        Draft(self.head.load(Ordering::Relaxed))
    }

    /// Appends a byte to a draft; returns its position. There is one draft at a time.
    ///
    /// # Errors
    /// The queue is full.
    #[inline(never)]
    pub fn push(&mut self, draft: &mut Draft, byte: u8) -> Result<usize, Full> {
        let (at, behind) = (draft.0, next(draft.0, self.bytes.len()));
        if behind == self.tail.load(Ordering::Acquire) {
            return Err(Full);
        }
        self.set(at, byte);
        draft.0 = behind;
        Ok(at)
    }

    /// Changes a byte of a draft.
    pub fn set(&mut self, at: usize, byte: u8) {
        if let Some(place) = self.bytes.get(at) {
            place.store(byte, Ordering::Relaxed);
        }
    }

    /// Makes a draft readable.
    pub fn commit(&mut self, draft: Draft) {
        self.head.store(draft.0, Ordering::Release);
    }
}

/// A draft in progress, which can still be dropped: its end.
#[derive(Debug)]
pub struct Draft(usize);

/// The queue is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Full;

impl Consumer<'_> {
    /// Removes waiting bytes, as many as fit; returns how many.
    pub fn read(&mut self, into: &mut [u8]) -> usize {
        let head = self.head.load(Ordering::Acquire);
        let mut tail = self.tail.load(Ordering::Relaxed);
        let mut count = 0;
        for to in into {
            let Some(byte) = self.bytes.get(tail).filter(|_| tail != head) else { break };
            *to = byte.load(Ordering::Relaxed);
            tail = next(tail, self.bytes.len());
            count += 1;
        }
        self.tail.store(tail, Ordering::Release);
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng as _, SeedableRng as _};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use std::collections::VecDeque;
    use std::vec::Vec;

    #[test]
    fn what_is_committed_comes_out_once_in_order_and_what_is_given_up_never() {
        let mut ring = Ring::<61>::new();
        let (mut producer, mut consumer) = ring.ends();
        let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
        let mut model = VecDeque::new();
        let mut given_up = 0;
        for _ in 0..20_000 {
            let length = random.next_u32() as usize % 40;
            let bytes: Vec<u8> = (0..length).map(|_| random.next_u32() as u8).collect();
            let room = producer.room();
            assert_eq!(room, 60 - model.len());
            let mut draft = producer.draft();
            let pushed = bytes.iter().try_for_each(|byte| producer.push(&mut draft, *byte).map(|_| ()));
            assert_eq!(pushed.is_ok(), length <= room);
            if pushed.is_ok() {
                producer.commit(draft);
                model.extend(&bytes);
            } else {
                given_up += 1;
            }
            let mut out = [0; 32];
            let wanted = random.next_u32() as usize % 32;
            let count = consumer.read(&mut out[..wanted]);
            assert_eq!(count, wanted.min(model.len()));
            assert!(out[..count].iter().all(|byte| model.pop_front() == Some(*byte)));
            assert_eq!(producer.is_empty(), model.is_empty());
        }
        assert!(given_up > 1000);
    }

    #[test]
    fn a_reader_that_runs_beside_the_writer_sees_whole_drafts_only() {
        let mut ring = Ring::<37>::new();
        let (mut producer, mut consumer) = ring.ends();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for number in 0..20_000_u32 {
                    'again: loop {
                        let mut draft = producer.draft();
                        let Ok(place) = producer.push(&mut draft, 0) else { continue };
                        for byte in number.to_le_bytes() {
                            if producer.push(&mut draft, byte).is_err() {
                                continue 'again;
                            }
                        }
                        producer.set(place, 0xa5);
                        producer.commit(draft);
                        break;
                    }
                }
            });
            for number in 0..20_000_u32 {
                let mut frame = [0; 5];
                let mut at = 0;
                while at < 5 {
                    at += consumer.read(&mut frame[at..]);
                }
                assert_eq!((frame[0], &frame[1..]), (0xa5, &number.to_le_bytes()[..]));
            }
        });
    }
}
