//! Nothing is kept while the power is off.
//!
//! [`foxhound_computer::store`] writes words of 8 bytes, strikes them out one by one, and erases pages, of which it has eight. The
//! flash of the STM32H743 (RM0433, chapter "Embedded flash memory") is written in words of 32 bytes, whose check bits are made of
//! all 32, so that no 8 of them can be written or struck out alone. What it erases is a sector of 128 KB: eight are half of the
//! flash. A store for that is another one, and is not written.
//!
//! So this refuses everything, as the flash of the NUCLEO-G474RE does where its banks are not as they should be: the vehicle
//! comes up as one whose store is lost, says so, does not seek, and answers that it cannot keep what it is told to.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

/// Keeps nothing.
#[derive(Debug)]
pub struct Flash(());

impl Flash {
    /// The only one.
    pub(super) const fn new() -> Self {
        Self(())
    }
}

/// It does not do it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused;

impl NorFlashError for Refused {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl ErrorType for Flash {
    type Error = Refused;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 8;

    fn read(&mut self, _offset: u32, _bytes: &mut [u8]) -> Result<(), Refused> {
        Err(Refused)
    }

    fn capacity(&self) -> usize {
        0
    }
}

/// The sizes are those that the store wants, not those of the chip.
impl NorFlash for Flash {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = 2048;

    fn erase(&mut self, _from: u32, _to: u32) -> Result<(), Refused> {
        Err(Refused)
    }

    fn write(&mut self, _offset: u32, _bytes: &[u8]) -> Result<(), Refused> {
        Err(Refused)
    }
}
