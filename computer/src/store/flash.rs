//! A flash that completes every erase, whenever the power fails.
//!
//! A map in flash can detect a half written word by its checksums, but not a half erased page: its remains may look
//! like an old page, or like a free one. So the first page of the store is a journal. Before pages are erased, their
//! numbers are written there, and struck out (by zeros, which can be written over anything) afterwards; an erase that
//! is still in the journal at the start is repeated.
//!
//! Every operation completes at once, so the futures of the map end at their first poll.

use core::ops::Range;
use core::pin::pin;
use core::task::{Context, Poll, Waker};

use embedded_storage::nor_flash::NorFlash;
use embedded_storage_async::nor_flash as later;

/// Bytes per write.
pub(super) const WORD: usize = 8;
/// Pages of the store.
pub const PAGES: u32 = 8;

const JOURNAL: Range<u32> = 0..1;
const BLANK: u64 = u64::MAX;
const DONE: u64 = 0;
/// An entry of the journal: its last bytes are the first page and the one after the last, preceded by their
/// complements.
const ENTRY: u64 = 0x46AC_9E35_0000_0000;

/// The flash, and whether it was written.
#[derive(Debug)]
pub(super) struct Sure<F> {
    flash: F,
    /// It was written or erased since [`Self::take_written`].
    is_written: bool,
}

impl<F: NorFlash> Sure<F> {
    const WORDS_FIT: () = assert!(F::READ_SIZE <= WORD && F::WRITE_SIZE == WORD, "words of eight bytes");

    pub(super) const fn new(flash: F) -> Self {
        const { Self::WORDS_FIT };
        Self { flash, is_written: false }
    }

    pub(super) const fn take_written(&mut self) -> bool {
        core::mem::replace(&mut self.is_written, false)
    }

    fn journal() -> impl Iterator<Item = u32> {
        (0..F::ERASE_SIZE as u32).step_by(WORD)
    }

    fn word(&mut self, at: u32) -> Result<u64, F::Error> {
        let mut word = [0; WORD];
        self.flash.read(at, &mut word)?;
        Ok(u64::from_le_bytes(word))
    }

    fn write_word(&mut self, at: u32, word: u64) -> Result<(), F::Error> {
        self.is_written = true;
        self.flash.write(at, &word.to_le_bytes())
    }

    fn erase_pages(&mut self, pages: &Range<u32>) -> Result<(), F::Error> {
        self.is_written = true;
        let size = F::ERASE_SIZE as u32;
        self.flash.erase(pages.start * size, pages.end * size)
    }

    /// Repeats what a loss of power may have interrupted. Call it before anything else.
    pub(super) fn finish(&mut self) -> Result<(), F::Error> {
        let mut is_sound = true;
        for at in Self::journal() {
            let word = self.word(at)?;
            if let Some(pages) = pages_of(word) {
                self.erase_pages(&pages)?;
                is_sound &= self.write_word(at, DONE).is_ok();
            } else {
                is_sound &= word == BLANK || word == DONE;
            }
        }
        if is_sound { Ok(()) } else { self.erase_pages(&JOURNAL) }
    }

    /// Records that pages are about to be erased, and returns the position of the entry.
    fn note(&mut self, pages: &Range<u32>) -> Result<Option<u32>, F::Error> {
        for at in Self::journal() {
            // A word that looks free but cannot be written: try the next one.
            if self.word(at)? == BLANK && self.write_word(at, entry(pages)).is_ok() {
                return Ok(Some(at));
            }
        }
        Ok(None)
    }

    /// Erases all of them, or, seen from the next start, none.
    pub(super) fn erase_surely(&mut self, pages: &Range<u32>) -> Result<(), F::Error> {
        let mut at = self.note(pages)?;
        if at.is_none() {
            self.erase_pages(&JOURNAL)?;
            at = self.note(pages)?;
        }
        self.erase_pages(pages)?;
        match at.map(|at| self.write_word(at, DONE)) {
            // An entry that is not struck out would erase at the next start what is written there from now on.
            Some(Err(_)) => self.erase_pages(&JOURNAL),
            _ => Ok(()),
        }
    }

    /// Whether nothing was ever written in these pages.
    pub(super) fn is_blank(&mut self, pages: Range<u32>) -> bool {
        let size = F::ERASE_SIZE as u32;
        (pages.start * size..pages.end * size).step_by(WORD).all(|at| self.word(at).is_ok_and(|word| word == BLANK))
    }
}

fn entry(pages: &Range<u32>) -> u64 {
    let [first, end] = [pages.start, pages.end].map(|page| u64::from(page & 0xff));
    ENTRY | (first ^ 0xff) << 24 | (end ^ 0xff) << 16 | first << 8 | end
}

/// The journal itself is never in it.
fn pages_of(word: u64) -> Option<Range<u32>> {
    let pages = (word >> 8 & 0xff) as u32..(word & 0xff) as u32;
    (word == entry(&pages) && 0 < pages.start && pages.start < pages.end && pages.end <= PAGES).then_some(pages)
}

/// The result of a future that never waits.
pub(super) fn at_once<T>(future: impl Future<Output = T>) -> Option<T> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

impl<F: NorFlash> later::ErrorType for Sure<F> {
    type Error = F::Error;
}

impl<F: NorFlash> later::ReadNorFlash for Sure<F> {
    const READ_SIZE: usize = WORD;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.flash.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        PAGES as usize * F::ERASE_SIZE
    }
}

impl<F: NorFlash> later::NorFlash for Sure<F> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        let size = F::ERASE_SIZE as u32;
        self.erase_surely(&(from / size..to / size))
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.is_written = true;
        self.flash.write(offset, bytes)
    }
}
