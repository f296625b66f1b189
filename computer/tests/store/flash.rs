//! A flash in memory, as that of an STM32G4 is: words of 8 bytes with an error correction, pages of 2 KB. Its power can be cut
//! at every word that is written and at every page that is erased.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use foxhound_computer::store::PAGES;

pub(crate) const PAGE_BYTES: usize = 2048;
const WORDS: usize = PAGES as usize * PAGE_BYTES / 8;
const BLANK: u64 = u64::MAX;

/// Random numbers (Vigna's splitmix64).
#[derive(Clone, Debug)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn below(&mut self, limit: u64) -> u64 {
        self.next() % limit
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Flash {
    pub(crate) words: Vec<u64>,
    /// Reads as blank, and takes nothing any more.
    weak: Vec<bool>,
    /// Words and pages that are written and erased before the power goes.
    pub(crate) until_cut: Option<u64>,
    pub(crate) is_off: bool,
    /// Words that are written before one is refused, once, with the power on.
    pub(crate) until_refused: Option<u64>,
    /// It refuses everything, whatever the power does.
    pub(crate) is_broken: bool,
    /// What was written and erased since the beginning.
    pub(crate) operations: u64,
    pub(crate) reads: u64,
    pub(crate) erased: [u32; PAGES as usize],
    pub(crate) random: Random,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Refused;

impl NorFlashError for Refused {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl Flash {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            words: vec![BLANK; WORDS],
            weak: vec![false; WORDS],
            until_cut: None,
            is_off: false,
            until_refused: None,
            is_broken: false,
            operations: 0,
            reads: 0,
            erased: [0; PAGES as usize],
            random: Random(seed),
        }
    }

    /// The power comes again.
    pub(crate) fn restart(&mut self) {
        (self.until_cut, self.is_off) = (None, self.is_broken);
    }

    /// Counts an operation; true where the power goes in it.
    fn is_cut(&mut self) -> bool {
        self.operations += 1;
        match &mut self.until_cut {
            Some(0) => self.is_off = true,
            Some(left) => *left -= 1,
            None => {}
        }
        self.is_off
    }

    /// A word that was on its way from one state to another: the old or the new one, bits of both, uncorrectable (which
    /// reads as zeros), or blank to the eye.
    fn tear(&mut self, at: usize, new: u64) {
        let old = self.words[at];
        let mix = self.random.next();
        (self.words[at], self.weak[at]) = match self.random.below(5) {
            0 => (old, self.weak[at]),
            1 => (new, false),
            2 => ((old & mix) | (new & !mix), false),
            3 => (0, false),
            _ => (BLANK, true),
        };
    }
}

impl ErrorType for Flash {
    type Error = Refused;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 8;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Refused> {
        assert!(offset.is_multiple_of(8) && bytes.len().is_multiple_of(8), "whole words");
        if self.is_off {
            return Err(Refused);
        }
        let words = &self.words[offset as usize / 8..][..bytes.len() / 8];
        self.reads += words.len() as u64;
        for (bytes, word) in bytes.as_chunks_mut().0.iter_mut().zip(words) {
            *bytes = word.to_le_bytes();
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        PAGES as usize * PAGE_BYTES
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = PAGE_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Refused> {
        assert!(from.is_multiple_of(2048) && to.is_multiple_of(2048) && from < to && to <= PAGES * 2048, "whole pages");
        for page in from as usize / PAGE_BYTES..to as usize / PAGE_BYTES {
            if self.is_off {
                return Err(Refused);
            }
            let is_cut = self.is_cut();
            self.erased[page] += 1;
            // A page goes as a whole, some cells before others; and it may as well go from one end to the other.
            let (begin, end) = (page * PAGE_BYTES / 8, (page + 1) * PAGE_BYTES / 8);
            let edge = begin + self.random.below(256) as usize;
            let kind = self.random.below(3);
            for at in begin..end {
                match kind {
                    _ if !is_cut => (self.words[at], self.weak[at]) = (BLANK, false),
                    0 => self.tear(at, BLANK),
                    1 if at < edge => self.words[at] = BLANK,
                    2 if at >= edge => self.words[at] = BLANK,
                    _ => {}
                }
            }
            if is_cut {
                return Err(Refused);
            }
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Refused> {
        assert!(offset.is_multiple_of(8) && bytes.len().is_multiple_of(8), "whole words");
        for (index, bytes) in bytes.as_chunks().0.iter().enumerate() {
            if self.is_off {
                return Err(Refused);
            }
            self.until_refused = match self.until_refused {
                Some(0) => {
                    self.until_refused = None;
                    return Err(Refused);
                }
                left => left.map(|left| left - 1),
            };
            let (at, word) = (offset as usize / 8 + index, u64::from_le_bytes(*bytes));
            if word != 0 && (self.words[at] != BLANK || self.weak[at]) {
                // Not even these: the driver strikes the word out, so that it reads alike from now on.
                (self.words[at], self.weak[at]) = (0, false);
                return Err(Refused);
            }
            if self.is_cut() {
                self.tear(at, word);
                return Err(Refused);
            }
            (self.words[at], self.weak[at]) = (word, false);
        }
        Ok(())
    }
}
