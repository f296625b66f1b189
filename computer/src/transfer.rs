//! What a DMA transfer of the STM32G474 takes: the rules that its drivers keep and that the twin checks.
//!
//! The part does not report a violation. It transfers nothing, or the wrong bytes, and the driver library panics.

use core::ops::Range;

/// The longest transfer, in items: `NDT` of `DMA_CNDTRx` has 16 bits (RM0440, DMA: channel x number of data to transfer
/// register).
pub const LONGEST: usize = 0xffff;

/// Why the part does not take a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// No bytes: `NDT` = 0 transfers nothing and never completes (RM0440, DMA channel configuration).
    Empty,
    /// More than [`LONGEST`].
    TooLong,
    /// Not, or not wholly, in memory that DMA reaches.
    Unreachable,
}

/// Whether DMA takes a buffer of `length` bytes at `address`, where `memory` lists what it reaches.
///
/// # Errors
/// The first rule that the buffer breaks.
pub fn check(address: usize, length: usize, memory: &[Range<usize>]) -> Result<(), Refused> {
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

/// The transfers that send `bytes`: none for no bytes, and none longer than [`LONGEST`].
pub fn pieces(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    bytes.chunks(LONGEST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    /// SRAM1 and SRAM2, and the flash.
    const MEMORY: [Range<usize>; 2] = [0x2000_0000..0x2001_8000, 0x0800_0000..0x0808_0000];

    #[test]
    fn every_rule_refuses() {
        assert_eq!(check(0x2000_0000, 0, &MEMORY), Err(Refused::Empty));
        assert_eq!(check(0x0800_0000, LONGEST, &MEMORY), Ok(()));
        assert_eq!(check(0x0800_0000, LONGEST + 1, &MEMORY), Err(Refused::TooLong));
        assert_eq!(check(0x1000_0000, 4, &MEMORY), Err(Refused::Unreachable));
        assert_eq!(check(0x2001_7ffc, 4, &MEMORY), Ok(()));
        assert_eq!(check(0x2001_7ffd, 4, &MEMORY), Err(Refused::Unreachable));
        assert_eq!(check(0x1fff_ffff, 4, &MEMORY), Err(Refused::Unreachable));
        assert_eq!(check(usize::MAX, 4, &[0..usize::MAX]), Err(Refused::Unreachable));
    }

    #[test]
    fn pieces_are_taken_and_complete() {
        assert_eq!(pieces(&[]).count(), 0);
        let bytes = vec![7; 2 * LONGEST + 1];
        let lengths: Vec<_> = pieces(&bytes).map(<[u8]>::len).collect();
        assert_eq!(lengths, [LONGEST, LONGEST, 1]);
        assert!(pieces(&bytes).all(|piece| check(0x0800_0000, piece.len(), &MEMORY).is_ok()));
    }
}
