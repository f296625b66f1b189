//! Flights in closed loop.

use super::super::*;
use super::model::{Answer, Flight, World, towards_beacon};
use crate::rng::Rng;

fn lander(config: Config) -> Lander {
    config.build().unwrap()
}

pub(super) fn camera() -> Config {
    Config { has_camera: true, ..Config::default() }
}

pub(super) fn landing(seed: u64) -> World {
    let mut rng = Rng::new(seed, 5);
    let at = |rng: &mut Rng, metres: f32| metres * (2.0 * rng.uniform() - 1.0);
    let beacon = Horizontal { north: 5.0 + at(&mut rng, 1.0), east: at(&mut rng, 3.0) };
    let pad = beacon.plus(Horizontal { north: at(&mut rng, 0.5), east: at(&mut rng, 0.5) });
    World {
        pad_ned_m: Some(pad),
        beacon_ned_m: Ned { north: beacon.north, east: beacon.east, down: 0.0 },
        ..World::new(seed)
    }
}

#[test]
fn in_calm_air_it_lands_on_the_pad() {
    let lander = lander(camera());
    let mut landed = 0;
    for seed in 0..100 {
        let answer = if seed % 2 == 0 { Answer::ArduCopter } else { Answer::Fast };
        let world = World { answer, false_share: 0.1, missed_share: 0.1, ..landing(seed) };
        let mut flight = Flight::new(world);
        let (advice, _) = flight.run(&lander, 250.0, towards_beacon);
        let off = flight.lands_at.zip(world.pad_ned_m).map(|(place, pad)| place.minus(pad).norm());
        landed += u32::from(advice.stage == Stage::Landed && off.is_some_and(|off| off < 0.15));
    }
    assert!(landed >= 98, "{landed} of 100");
}
