//! The link as a whole, driven the way the firmware drives it: `cargo xtask size` measures what it takes. Nothing that
//! goes in is known to the compiler, so that nothing is left out.
#![no_std]
#![no_main]

use core::hint::black_box;

use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::Output;
use foxhound_core::guidance::param::Values;
use foxhound_firmware as _;
use foxhound_link::companion::{Companion, Config};
use foxhound_link::signing::{Key, Signing};

#[cortex_m_rt::entry]
fn main() -> ! {
    if let Some((config, values, key)) = black_box(None::<(&Config, &Values, &[u8; 32])>)
        && let Ok(mut companion) = config.build_with(*values)
    {
        companion.sign_with(Key::new(*key).map(|key| Signing::new(key, 0)));
        loop {
            let now = black_box(Instant(0));
            run(&mut companion, now);
            tune(&mut companion);
            sign(&mut companion, now);
        }
    }
    loop {
        cortex_m::asm::wfi();
    }
}

fn run(companion: &mut Companion, now: Instant) {
    companion.receive(now, black_box(&[0; 64]));
    black_box((companion.scan(), companion.points(), companion.control(now)));
    companion.drop_obstacles();
    black_box((&companion.ownship(), companion.landed(), &companion.autopilot(), &companion.counters()));
    if let Some(output) = black_box(None::<&Output>) {
        companion.publish(now, output);
    }
    if companion.wants_surroundings(now) {
        companion.publish_surroundings(now, black_box(&[] as &[Circle]).iter().copied());
    }
    companion.poll(now);
    companion.transmit(black_box(&mut [0; 64]));
    if black_box(false) {
        companion.fail();
    }
}

fn tune(companion: &mut Companion) {
    let values = *companion.parameters();
    black_box(companion.set_parameters(values).is_ok());
    black_box(companion.take_storage());
    companion.stored(black_box(true));
    if let Some(proposal) = companion.proposal() {
        black_box(&proposal);
        companion.settle(black_box(Ok(())));
    }
}

fn sign(companion: &mut Companion, now: Instant) {
    black_box(companion.take_key_change());
    if let Some(signing) = companion.signing() {
        signing.restore(now, black_box(0));
        signing.set_clock(now, black_box(0));
        black_box(signing.timestamp_to_store(now));
        black_box(signing.key());
    }
}
