//! Foxhound on the board that is chosen.
#![no_std]
#![no_main]

#[cortex_m_rt::entry]
fn main() -> ! {
    foxhound_firmware::program::run()
}
