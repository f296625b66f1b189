//! A flash in the memory shared with the simulator, behind its blocks: it survives our resets, and the simulator can
//! read it and damage it.
//!
//! It behaves as that of the STM32G4: words of 8 bytes, pages of 2 KB; a word that is not blank accepts only zeros,
//! and is struck out by any other value. Every bit is stored inverted, so that a new file, which is full of zeros, is
//! a blank flash.

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use foxhound_computer::part::{self, BLANK, Refused};
use foxhound_computer::store::PAGES;
use foxhound_computer::twin;

const PAGE_BYTES: usize = 2048;
const BYTES: u32 = PAGES * PAGE_BYTES as u32;

/// Non-volatile storage.
#[derive(Debug)]
pub struct Flash(());

impl Flash {
    /// The only one.
    pub(super) fn new() -> Self {
        Self(())
    }

    /// A word of the shared memory, in two halves; `at` is inside and aligned.
    fn halves(at: u32) -> [*mut u32; 2] {
        let low = (super::PSRAM + twin::STORE_AT + at as usize) as *mut u32;
        [low, low.wrapping_add(1)]
    }

    fn read_word(at: u32) -> u64 {
        // SAFETY: word-aligned and inside the 16 MB PSRAM, where no Rust object lies; volatile, because the simulator may
        // write there.
        let [low, high] = Self::halves(at).map(|half| u64::from(!unsafe { half.read_volatile() }));
        high << 32 | low
    }

    fn write_word(at: u32, word: u64) {
        for (half, value) in Self::halves(at).into_iter().zip([word as u32, (word >> 32) as u32]) {
            // SAFETY: as above.
            unsafe { half.write_volatile(!value) };
        }
    }
}

impl ErrorType for Flash {
    type Error = Refused;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 8;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Refused> {
        part::flash(offset, bytes.len(), 8, BYTES)?;
        for (at, bytes) in (offset..).step_by(8).zip(bytes.as_chunks_mut().0) {
            *bytes = Self::read_word(at).to_le_bytes();
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        BYTES as usize
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = PAGE_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Refused> {
        part::flash(from, to.saturating_sub(from) as usize, PAGE_BYTES as u32, BYTES)?;
        (from..to).step_by(8).for_each(|at| Self::write_word(at, BLANK));
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Refused> {
        part::flash(offset, bytes.len(), 8, BYTES)?;
        for (at, bytes) in (offset..).step_by(8).zip(bytes.as_chunks().0) {
            let word = u64::from_le_bytes(*bytes);
            if let Err(refused) = part::program(Self::read_word(at), word) {
                Self::write_word(at, 0);
                return Err(refused);
            }
            Self::write_word(at, word);
        }
        Ok(())
    }
}
