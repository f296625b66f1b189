//! What a program takes without the link: start-up, board, panic handler. `cargo xtask size` subtracts it.
#![no_std]
#![no_main]

use core::hint::black_box;

use foxhound_firmware as _;

#[cortex_m_rt::entry]
fn main() -> ! {
    let bytes = black_box([0_u8; 64]);
    // What an index out of bounds ends in.
    black_box(bytes[black_box(7)]);
    loop {
        cortex_m::asm::wfi();
    }
}
