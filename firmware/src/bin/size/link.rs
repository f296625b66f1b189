//! The link as a whole, driven the way the firmware drives it: `cargo xtask size` measures what it takes. Nothing that
//! goes in is known to the compiler, so that nothing is left out.
#![no_std]
#![no_main]

use core::hint::black_box;

use foxhound_core::guidance::Output;
use foxhound_core::time::Instant;
use foxhound_firmware as _;
use foxhound_link::companion::{Companion, Config};
use foxhound_link::dialect::SETUP_SIGNING_DATA;
use foxhound_link::framer::FRAME_MAX;
use foxhound_link::signing::{Key, Setup, Signing, Unsigned, Verdict, is_secret, set_up};

#[cortex_m_rt::entry]
fn main() -> ! {
    let config = black_box(Config::default());
    let (Ok(mut companion), Some(key)) = (config.build(), Key::new(black_box([1; 32]))) else {
        loop {
            cortex_m::asm::wfi();
        }
    };
    let mut signing = Some(Signing::new(key, 0));
    let mut now = Instant(0);
    loop {
        now = black_box(now);
        speak(&mut companion, now);
        sign(&mut signing, now);
    }
}

fn speak(companion: &mut Companion, now: Instant) {
    companion.receive(now, &black_box([0; 64]));
    companion.poll(now);
    if let Some(output) = black_box(None::<Output>) {
        companion.publish(now, &output);
    }
    let mut sink = [0; 64];
    black_box(companion.transmit(&mut sink));
    black_box(&sink);
    black_box((companion.control(now), companion.autopilot(), companion.ownship(), companion.landed()));
    black_box((companion.take_scan(), companion.take_points(), companion.counters()));
}

fn sign(signing: &mut Option<Signing>, now: Instant) {
    let setup = black_box(SETUP_SIGNING_DATA::DEFAULT);
    match set_up(now, &setup, black_box((1, 191)), black_box(true), 0, signing.as_ref()) {
        Setup::On(new) => *signing = Some(new),
        Setup::Off => *signing = None,
        Setup::NotOurs | Setup::Refused => {}
    }
    let Some(signing) = signing else { return };
    signing.restore(now, black_box(0));
    signing.set_clock(now, black_box(0));
    black_box(signing.timestamp_to_store(now));
    let mut frame = black_box([0; FRAME_MAX]);
    let length = signing.sign(now, &mut frame, black_box(21));
    let verdict = signing.check(now, &frame[..length]);
    let id = black_box(0);
    black_box(verdict == Verdict::Unsigned && black_box(Unsigned::default()).takes(id, black_box(true)));
    black_box(is_secret(id));
}
