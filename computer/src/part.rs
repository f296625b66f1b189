//! What the STM32G474 refuses: one list, which the drivers of the NUCLEO-G474RE obey and the twin in QEMU checks.
//!
//! | what | the chip | source |
//! |---|---|---|
//! | an empty transfer | never completes: `NDT` = 0 | RM0440, DMA channel configuration |
//! | a longer one than [`LONGEST`] | `NDT` has 16 bits | RM0440, `DMA_CNDTRx` |
//! | a buffer that DMA does not reach | transfer error, the channel stops | RM0440, DMA error management |
//! | a transfer while one is under way | the channel's registers cannot be written | RM0440, DMA channel configuration |
//! | flash in other units than words of 8 bytes, pages of 2 KB | `PGAERR`, or another page | RM0440, FLASH programming |
//! | flash outside of the store's pages | the program | `memory.x` |
//! | a word over one that is not blank, but zeros | `PROGERR` | RM0440, FLASH programming |
//!
//! The chip does not report most of this: it does nothing, or the wrong thing.

use core::ops::Range;

use embedded_storage::nor_flash::{NorFlashError, NorFlashErrorKind};

/// The longest transfer, in items.
pub const LONGEST: usize = 0xffff;
/// A word of the flash that is blank.
pub const BLANK: u64 = u64::MAX;

/// Why the chip refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// Nothing is to be transferred.
    Empty,
    /// More than [`LONGEST`].
    TooLong,
    /// Not, or not wholly, in memory that DMA reaches.
    Unreachable,
    /// It is busy.
    Busy,
    /// Not in whole units of the flash.
    Misaligned,
    /// Not in our part of the flash.
    Outside,
    /// The word is not blank.
    NotBlank,
    /// It reports an error.
    Failed,
}

impl Refused {
    /// The reason as text.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Empty => "an empty transfer",
            Self::TooLong => "a transfer of more than 65535 items",
            Self::Unreachable => "a buffer that DMA does not reach",
            Self::Busy => "a transfer while one is under way",
            Self::Misaligned => "a flash access that is not in whole units",
            Self::Outside => "flash outside of the store",
            Self::NotBlank => "flash that is not blank",
            Self::Failed => "the flash reports an error",
        }
    }
}

impl NorFlashError for Refused {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// Whether DMA accepts a buffer of `length` bytes at `address`; `memory` lists the memory that it reaches.
///
/// # Errors
/// The first rule that is violated.
pub fn transfer(address: usize, length: usize, memory: &[Range<usize>]) -> Result<(), Refused> {
    if length == 0 {
        return Err(Refused::Empty);
    }
    if length > LONGEST {
        return Err(Refused::TooLong);
    }
    let reaches = |range: &Range<usize>| {
        range.contains(&address) && address.checked_add(length).is_some_and(|end| end <= range.end)
    };
    if memory.iter().any(reaches) { Ok(()) } else { Err(Refused::Unreachable) }
}

/// The transfers that send `bytes` through a buffer of `longest`, up to [`LONGEST`]: none for no bytes.
pub fn pieces(bytes: &[u8], longest: usize) -> impl Iterator<Item = &[u8]> {
    bytes.chunks(longest.clamp(1, LONGEST))
}

/// Whether this many bytes from there on are inside a flash of `size` bytes, and whole units.
///
/// # Errors
/// The first rule that is violated.
pub fn flash(from: u32, bytes: usize, unit: u32, size: u32) -> Result<(), Refused> {
    let end = u32::try_from(bytes).ok().and_then(|bytes| from.checked_add(bytes)).filter(|end| *end <= size);
    let Some(end) = end else { return Err(Refused::Outside) };
    if from.is_multiple_of(unit) && end.is_multiple_of(unit) { Ok(()) } else { Err(Refused::Misaligned) }
}

/// Whether a word of the flash with the content `now` can be written.
///
/// # Errors
/// [`Refused::NotBlank`].
pub const fn program(now: u64, word: u64) -> Result<(), Refused> {
    if word == 0 || now == BLANK { Ok(()) } else { Err(Refused::NotBlank) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    /// SRAM1 and SRAM2, and the flash.
    const MEMORY: [Range<usize>; 2] = [0x2000_0000..0x2001_8000, 0x0800_0000..0x0808_0000];

    #[test]
    fn dma_refuses_what_is_empty_too_long_or_elsewhere() {
        assert_eq!(transfer(0x2000_0000, 0, &MEMORY), Err(Refused::Empty));
        assert_eq!(transfer(0x0800_0000, LONGEST, &MEMORY), Ok(()));
        assert_eq!(transfer(0x0800_0000, LONGEST + 1, &MEMORY), Err(Refused::TooLong));
        assert_eq!(transfer(0x1000_0000, 4, &MEMORY), Err(Refused::Unreachable));
        assert_eq!(transfer(0x2001_7ffc, 4, &MEMORY), Ok(()));
        assert_eq!(transfer(0x2001_7ffd, 4, &MEMORY), Err(Refused::Unreachable));
        assert_eq!(transfer(0x1fff_ffff, 4, &MEMORY), Err(Refused::Unreachable));
        assert_eq!(transfer(usize::MAX, 4, &[0..4, 4..usize::MAX]), Err(Refused::Unreachable));
    }

    #[test]
    fn pieces_are_taken_and_complete() {
        assert_eq!(pieces(&[], 128).count(), 0);
        let bytes = vec![7; 2 * LONGEST + 1];
        for (longest, count) in [(LONGEST, 3), (usize::MAX, 3), (0, bytes.len()), (50_000, 3)] {
            let lengths: Vec<_> = pieces(&bytes, longest).map(<[u8]>::len).collect();
            assert_eq!((lengths.len(), lengths.iter().sum::<usize>()), (count, bytes.len()));
            assert!(pieces(&bytes, longest).all(|piece| transfer(0x0800_0000, piece.len(), &MEMORY).is_ok()));
        }
    }

    #[test]
    fn the_flash_takes_whole_units_of_its_own_and_no_word_twice() {
        assert_eq!(flash(8, 16, 8, 24), Ok(()));
        assert_eq!(flash(8, 24, 8, 24), Err(Refused::Outside));
        assert_eq!(flash(u32::MAX, 8, 8, u32::MAX), Err(Refused::Outside));
        assert_eq!(flash(4, 8, 8, 24), Err(Refused::Misaligned));
        assert_eq!(flash(8, 12, 8, 24), Err(Refused::Misaligned));
        assert_eq!((program(BLANK, 5), program(5, 0)), (Ok(()), Ok(())));
        assert_eq!(program(5, 5), Err(Refused::NotBlank));
    }
}
