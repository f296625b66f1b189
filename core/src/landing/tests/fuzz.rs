//! For any input, demands are finite, inside the limits, and change no faster than allowed.

use super::super::observation::{Bad, Nothing, Pad, PadObservation, Seen};
use super::super::*;
use super::{Landing, Memory, TICK_US, Told, nothing};
use crate::base::rng::Rng;
use crate::doa::bearing::{Bearing, Flags, Quality};

const WILD: [f32; 12] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    0.0,
    -0.0,
    1e20,
    -1e20,
    1e-20,
    1e6,
];

/// Mostly a number of that scale, sometimes any bit pattern.
fn some(rng: &mut Rng, scale: f32, wildness: f32) -> f32 {
    if rng.uniform() < wildness { WILD[(rng.uniform() * 11.99) as usize] } else { scale * rng.gaussian() }
}

fn ned(rng: &mut Rng, scale: f32, wildness: f32) -> Ned {
    let mut next = || some(rng, scale, wildness);
    Ned { north: next(), east: next(), down: next() }
}

fn ownship(rng: &mut Rng, now: u64, wildness: f32) -> Ownship {
    let late = |rng: &mut Rng| {
        let late = if rng.uniform() < wildness { 1e9 } else { 50_000.0 };
        Instant(now.saturating_sub((late * rng.uniform()) as u64))
    };
    Ownship {
        position_time: late(rng),
        position_ned_m: ned(rng, 0.5, wildness),
        velocity_ned_mps: ned(rng, 0.3, wildness),
        attitude_time: late(rng),
        roll_rad: some(rng, 0.1, wildness),
        pitch_rad: some(rng, 0.1, wildness),
        yaw_rad: some(rng, 1.0, wildness),
        yaw_rate_radps: some(rng, 0.5, wildness),
    }
}

fn bearing(rng: &mut Rng, now: u64, wildness: f32) -> Bearing {
    Bearing {
        time: Instant(now - (rng.uniform() * 20_000.0) as u64),
        valid: rng.uniform() < 0.8,
        azimuth_rad: some(rng, 2.0, wildness),
        sigma_rad: libm::fabsf(some(rng, 0.2, wildness)),
        elevation_rad: some(rng, 1.0, wildness),
        elevation_sigma_rad: libm::fabsf(some(rng, 0.3, wildness)),
        quality: Quality {
            snr_db: some(rng, 20.0, wildness),
            wavenumber: some(rng, 0.5, wildness),
            ..Quality::default()
        },
        flags: Flags(if rng.uniform() < 0.2 { 1 << (rng.uniform() * 9.9) as u16 } else { 0 }),
    }
}

fn look(rng: &mut Rng, now: u64, wildness: f32) -> PadObservation {
    let time = Instant(now - (rng.uniform() * 250_000.0) as u64);
    let kind = rng.uniform();
    let seen = if kind < 0.7 {
        Seen::Pad(Pad {
            forward: some(rng, 0.1, wildness),
            right: some(rng, 0.1, wildness),
            radius: libm::fabsf(some(rng, 0.2, wildness)),
            confidence: some(rng, 0.9, wildness),
            is_cut: rng.uniform() < 0.2,
        })
    } else if kind < 0.85 {
        Seen::Nothing(Nothing::Shape)
    } else {
        Seen::Bad(Bad::Line)
    };
    PadObservation { time, seen }
}

#[test]
fn no_facts_lead_to_a_demand_outside_of_the_limits() {
    let mut stages = [0_u32; 10];
    for seed in 0..300 {
        let mut rng = Rng::new(seed, 21);
        let wildness = [0.0, 0.003, 0.03, 0.3][(seed % 4) as usize];
        let config = Config { has_camera: seed % 3 > 0, ..Config::default() };
        let lander = Landing::new(config);
        let mut state = Memory::default();
        let mut last: Option<(Horizontal, f32)> = None;
        let mut now = 10_000_000;
        for _ in 0..1_500 {
            now += TICK_US;
            let ownship = ownship(&mut rng, now, wildness);
            let bearing = bearing(&mut rng, now, wildness);
            let estimate = Estimate {
                place_ned_m: ned(&mut rng, 0.5, wildness).horizontal(),
                covariance_m2: [
                    some(&mut rng, 0.3, wildness),
                    some(&mut rng, 0.1, wildness),
                    some(&mut rng, 0.3, wildness),
                ],
                range_sigma_ratio: some(&mut rng, 0.3, wildness),
                ..Estimate::default()
            };
            let input = Told {
                ownship: (rng.uniform() > 0.02).then_some(&ownship),
                height_m: (seed % 2 == 0).then_some(some(&mut rng, 2.0, wildness)),
                bearing: (rng.uniform() > 0.1).then_some(&bearing),
                estimate: (rng.uniform() > 0.5).then_some(&estimate),
                look: {
                    let look = look(&mut rng, now, wildness);
                    (rng.uniform() > 0.5).then_some(look)
                },
                is_landed: rng.uniform() < 0.001,
                is_blocked: rng.uniform() < 0.1,
                clearance_m: if rng.uniform() < 0.1 { f32::NAN } else { rng.uniform() },
                tick_s: if rng.uniform() < wildness { some(&mut rng, 1.0, 0.5) } else { 0.02 },
                ..nothing(now)
            };
            let output = lander.step(&mut state, &input);
            stages[output.stage as usize] += 1;
            let Some((velocity, down_mps)) = output.demand else {
                last = None;
                continue;
            };
            assert!(velocity.norm() <= centring::SPEED_MAX_MPS * 1.001, "seed {seed}: {output:?}");
            assert!((-centring::CLIMB_MPS..=centring::DESCENT_MAX_MPS).contains(&down_mps), "seed {seed}: {output:?}");
            let tick_s = if input.tick_s > 1e-3 && input.tick_s < 0.2 { input.tick_s } else { 0.02 };
            if let Some((velocity_before, down_before_mps)) = last {
                assert!(
                    velocity.minus(velocity_before).norm() <= centring::ACCEL_MAX_MPS2 * tick_s * 1.01,
                    "seed {seed}: {output:?}"
                );
                assert!(
                    (down_mps - down_before_mps).abs() <= centring::DOWN_ACCEL_MAX_MPS2 * tick_s * 1.01,
                    "seed {seed}: {output:?}"
                );
            }
            last = output.demand;
            if let Some(target) = output.target {
                assert!(target.place_ned_m.is_finite() && target.sigma_m.is_finite(), "seed {seed}: {target:?}");
            }
            if matches!(output.stage, Stage::Landed | Stage::HandedOver) {
                (state, last) = (Memory::default(), None);
            }
        }
    }
    // Noise does not land on a pad; the flights of the model do, with the same checks.
    let [seeking, approaching, _, for_pad, centring, descending, recovering, ..] = stages;
    let reached = [seeking, approaching, for_pad, centring, descending, recovering];
    assert!(reached.iter().all(|count| *count > 0), "{stages:?}");
}
