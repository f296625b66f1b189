//! What a program takes without the link: start-up, board, panic handler, and of the arithmetic what guidance has anyway.
//! `cargo xtask size` subtracts it.
#![no_std]
#![no_main]

use core::hint::black_box;

use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::{sin_cos, wrap_pi};
use foxhound_firmware as _;

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut bytes = black_box([0_u8; 64]);
    // What an index out of bounds ends in.
    black_box(bytes[black_box(7)]);
    // Copies of any length, with and without overlap, and zeros.
    bytes.copy_within(black_box(1)..black_box(9), black_box(5));
    black_box(&bytes);
    bytes.fill(black_box(0));
    black_box(bytes == black_box([0; 64]));
    let (mut words, some) = (black_box([0_u32; 64]), black_box(9));
    words[some..][..some].copy_from_slice(&black_box([0; 64])[..some]);
    words[..some].fill(0);
    black_box((&words, black_box([0_u64; 64])));
    bytes[..some].fill(0);
    black_box(&bytes);
    arithmetic(black_box(Instant(7)), black_box(1.0));
    loop {
        cortex_m::asm::wfi();
    }
}

/// Angles, square roots, and numbers of 64 bits; called by their addresses, so that they are not taken apart.
fn arithmetic(now: Instant, x: f32) {
    let place = Horizontal { north: x, east: black_box(x) };
    black_box((black_box(wrap_pi as fn(f32) -> f32)(x), black_box(sin_cos as fn(f32) -> (f32, f32))(x)));
    black_box((place.bearing_rad(), place.minus(black_box(place)).bearing_rad(), place.norm()));
    black_box((now.seconds_since(black_box(Instant(3))), now.0 / black_box(9), now.0 as i64 / black_box(9)));
}
