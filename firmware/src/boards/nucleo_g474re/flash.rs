//! Non-volatile storage in the last eight pages of the flash.
//!
//! After RM0440, chapter "Embedded flash memory (FLASH) for category 3 devices":
//!
//! - **Banks.** Two of 256 KB, with pages of 2 KB and words of 64 bits, as delivered: the option bytes' production
//!   value is 0xFFEF F8AA, in which DBANK, bit 22, is set. With DBANK clear the pages are different, and
//!   embassy-stm32 panics; so DBANK is checked first, and this flash then refuses everything: the vehicle comes up as
//!   one whose store is lost.
//! - **Time.** 8 bytes take about 0.1 ms, a page 25 ms (DS12288, flash memory characteristics), during which fetches
//!   from bank 2 wait. `memory.x` defines what is there.
//! - **Interrupted words.** A word whose programming or erasing was interrupted by a loss of power may have more
//!   wrong bits than its code corrects. Reading it raises ECCD and the NMI. The handler clears the flag and records
//!   it; the word counts as zeros, and is programmed as zeros, which is allowed over anything, so that it reads the
//!   same ever after. An NMI while a word is read or struck out counts as that word's even if no flag says so: after a
//!   restart it would be met again, and so for ever. At any other time it means damage to the program or to its memory: a
//!   restart.
//! - **Cache.** The data cache is off during a read: its content would hide a damaged word.
//!
//! None of this has happened to a real board yet.

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::asm;
use embassy_stm32::Peri;
use embassy_stm32::flash::{self, Blocking};
use embassy_stm32::pac::{FLASH, RCC};
use embassy_stm32::peripherals;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use foxhound_computer::part::{self, Refused};
use foxhound_computer::restart::End;
use foxhound_computer::store::PAGES;

use super::{Machine, clocks};
use crate::arm::crash_record;

const PAGE_BYTES: usize = 2048;
const BYTES: u32 = PAGES * PAGE_BYTES as u32;
/// From the beginning of the flash; `memory.x` keeps the program out of it.
const FROM: u32 = (512 << 10) - BYTES;
const FLASH_AT: usize = 0x0800_0000;

/// A word of the store is being read or struck out, and may be damaged.
static IS_TOUCHED: AtomicBool = AtomicBool::new(false);
/// It was.
static IS_DAMAGED: AtomicBool = AtomicBool::new(false);

type Driver = flash::Flash<'static, Blocking>;

/// Non-volatile storage; `None` if the banks are not as required.
pub struct Flash(Option<Driver>);

impl Flash {
    /// The flash of the chip.
    pub(super) fn new(flash: Peri<'static, peripherals::FLASH>) -> Self {
        Self(FLASH.optr().read().dbank().then(|| flash::Flash::new_blocking(flash)))
    }

    fn driver(&mut self) -> Result<&mut Driver, Refused> {
        self.0.as_mut().ok_or(Refused::Failed)
    }
}

/// What is done to one word that may be damaged.
fn touch<T>(act: impl FnOnce() -> T) -> T {
    IS_TOUCHED.store(true, Ordering::SeqCst);
    let result = act();
    // The NMI has come through by then.
    asm::dsb();
    asm::isb();
    IS_TOUCHED.store(false, Ordering::SeqCst);
    result
}

/// A word; `None` if it is damaged. The data cache is off.
fn read_word(at: u32) -> Option<[u8; 8]> {
    let word = (FLASH_AT + (FROM + at) as usize) as *const u32;
    IS_DAMAGED.store(false, Ordering::SeqCst);
    // SAFETY: aligned, and inside the flash, behind the program; `part::flash` has looked. A damaged word does not fault.
    let [low, high] = touch(|| [word, word.wrapping_add(1)].map(|half| unsafe { half.read_volatile() }));
    let is_sound = !IS_DAMAGED.load(Ordering::SeqCst);
    is_sound.then(|| (u64::from(high) << 32 | u64::from(low)).to_le_bytes())
}

/// Programs a word as zeros. Whether that succeeds or not, it counts as zeros from now on.
fn strike_out(driver: &mut Driver, at: u32) {
    let _ = touch(|| driver.blocking_write(FROM + at, &[0; 8]));
}

/// The crystal has failed, the word being read is damaged, or something worse has happened.
// SAFETY: it touches its two flags and a register that nobody else touches.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    if RCC.cifr().read().cssf() {
        crash_record::end::<Machine>(End::Halt, 0, clocks::CRYSTAL_FAILED, b"the crystal has failed");
    }
    if !IS_TOUCHED.load(Ordering::SeqCst) {
        crash_record::end::<Machine>(End::Halt, 0, 0, b"flash or RAM damaged");
    }
    // A set flag is cleared by writing it.
    FLASH.eccr().modify(|_| ());
    IS_DAMAGED.store(true, Ordering::SeqCst);
}

impl ErrorType for Flash {
    type Error = Refused;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 8;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Refused> {
        part::flash(offset, bytes.len(), 8, BYTES)?;
        let driver = self.driver()?;
        FLASH.acr().modify(|w| w.set_dcen(false));
        for (at, bytes) in (offset..).step_by(8).zip(bytes.as_chunks_mut().0) {
            *bytes = read_word(at).unwrap_or_else(|| {
                strike_out(driver, at);
                [0; 8]
            });
        }
        FLASH.acr().modify(|w| w.set_dcrst(true));
        FLASH.acr().modify(|w| w.set_dcrst(false));
        FLASH.acr().modify(|w| w.set_dcen(true));
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
        self.driver()?.blocking_erase(FROM + from, FROM + to).map_err(|_| Refused::Failed)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Refused> {
        part::flash(offset, bytes.len(), 8, BYTES)?;
        let driver = self.driver()?;
        for (at, word) in (offset..).step_by(8).zip(bytes.as_chunks::<8>().0) {
            if driver.blocking_write(FROM + at, word).is_err() {
                // A word that looks blank and is not: it would be tried again and again.
                strike_out(driver, at);
                return Err(Refused::Failed);
            }
        }
        Ok(())
    }
}
