//! The stack: its guard, and a measurement of its use.
//!
//! It is at the bottom of the memory and grows down towards its end (`memory.x`), so that an overflow changes no
//! variables; the memory protection unit turns it into a fault, since the program uses nothing of the 32 KB below. At the start all of
//! it is painted; a word that has lost its paint has been used. Each step checks only a few words.

use core::ptr;

use cortex_m::peripheral::MPU;

use crate::register_values::region_size;

const PAINT: u32 = 0x5AFE_57AC;
/// Words per check.
const WORDS: u32 = 64;
/// The first bytes below the stack pointer are not painted: the painting itself uses them.
const GAP_BYTES: u32 = 256;

unsafe extern "C" {
    static _stack_start: u32;
    static _stack_end: u32;
}

fn top() -> u32 {
    &raw const _stack_start as u32
}

fn bottom() -> u32 {
    &raw const _stack_end as u32
}

/// Makes a fault of an overflow (Armv7-M Architecture Reference Manual, B3.5). To be called once, early.
pub(crate) fn guard(mpu: &mut MPU) {
    const REGION: u32 = 0;
    const BYTES: u32 = 32 << 10;
    const SIZE: u32 = region_size(BYTES);
    const EXECUTE_NEVER: u32 = 1 << 28;
    const ENABLE: u32 = 1;
    /// Memory without a region is accessible as without the unit.
    const BACKGROUND: u32 = 1 << 2;
    // SAFETY: the program uses nothing of this region, and everything else stays as it was.
    unsafe {
        mpu.rnr.write(REGION);
        mpu.rbar.write(bottom() - BYTES);
        mpu.rasr.write(EXECUTE_NEVER | SIZE | ENABLE);
        mpu.ctrl.write(BACKGROUND | ENABLE);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Paints the free part of the stack. Call it once, early.
pub(crate) fn paint() {
    let until = cortex_m::register::msp::read().saturating_sub(GAP_BYTES);
    let mut at = bottom();
    while at < until {
        // SAFETY: word-aligned, between the end of the stack and what is in use of it: nobody's memory.
        unsafe { ptr::with_exposed_provenance_mut::<u32>(at as usize).write_volatile(PAINT) };
        at += 4;
    }
}

/// Searches for the deepest word that has lost its paint, a few words at a time.
#[derive(Debug)]
pub struct Watermark {
    /// The deepest one found.
    deepest: u32,
    /// Where the next check begins; below `deepest`.
    at: u32,
}

impl Watermark {
    /// Before the first check.
    pub(crate) fn new() -> Self {
        Self { deepest: top(), at: bottom() }
    }

    /// One check; returns the number of bytes of the stack used, as found so far.
    pub fn look(&mut self) -> u32 {
        for _ in 0..WORDS {
            if self.at >= self.deepest {
                self.at = bottom();
                break;
            }
            // SAFETY: word-aligned and inside the stack; volatile, because somebody's frame may lie there.
            let word = unsafe { ptr::with_exposed_provenance::<u32>(self.at as usize).read_volatile() };
            if word != PAINT {
                self.deepest = self.at;
                self.at = bottom();
                break;
            }
            self.at += 4;
        }
        self.bytes()
    }

    /// The number of bytes of the stack used, as found so far.
    pub fn bytes(&self) -> u32 {
        top() - self.deepest
    }
}
