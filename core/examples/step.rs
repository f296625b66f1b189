//! The whole chain in a loop with a vehicle that does as it is told, from bearings to setpoints, past a pillar:
//! `cargo run --package foxhound-core --example step`.

use foxhound_core::ConfigError;
use foxhound_core::base::ned::{Horizontal, Ned};
use foxhound_core::base::obstacle::{Circle, Disc};
use foxhound_core::base::ownship::Ownship;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::{Bearing, Flags, Quality};
use foxhound_core::guidance::mission::Control;
use foxhound_core::guidance::{Config, FrontEnd, Input};
use foxhound_core::planning::planner::Workspace;

/// A bearing as good as a strong beacon gives, from elsewhere: with antennas it is `FrontEnd::Frame`.
fn bearing(time: Instant, azimuth_rad: f32) -> Bearing {
    let quality = Quality { snr_db: 20.0, wavenumber: 1.0, ..Quality::default() };
    Bearing { valid: true, azimuth_rad, sigma_rad: 0.01, ..Bearing::without(time, quality, Flags::default()) }
}

fn main() -> Result<(), ConfigError> {
    let config = Config { seed: 1, ..Config::default() };
    let (guidance, planner) = (config.build::<256>()?, config.build_planner()?);
    let (mut state, mut workspace) = (guidance.start(), Box::new(Workspace::new()));
    let beacon_ned_m = Horizontal { north: 8.0, east: 2.0 };
    let center_ned_m = Horizontal { north: 4.0, east: 0.9 };
    let pillar = Circle { center_ned_m, radius_m: 0.3, ..Circle::default() };

    let (mut place, mut velocity, mut yaw_rad, mut answer) = (Horizontal::default(), Ned::default(), 0.0_f32, None);
    for step in 0..1000_u64 {
        let now = Instant(20_000 * step);
        let ownship = Ownship {
            position_time: now,
            position_ned_m: Ned { north: place.north, east: place.east, down: -2.0 },
            velocity_ned_mps: velocity,
            attitude_time: now,
            yaw_rad,
            ..Ownship::default()
        };
        let input = Input {
            front_end: FrontEnd::Bearing(bearing(now, beacon_ned_m.minus(place).bearing_rad() - yaw_rad)),
            ownship: Some(ownship),
            circles: Some(&[pillar]),
            control: Control::Granted,
            answer: answer.as_ref(),
            ..Input::at(now)
        };
        let output = guidance.step(&mut state, &input);
        // The slow loop, which on the vehicle runs at a lower priority.
        answer = output.plan_requested.then(|| {
            let known: Vec<Disc> = state.map().discs().collect();
            planner.answer(&mut workspace, state.request(), &known)
        });

        velocity = output.setpoint.velocity_ned_mps;
        yaw_rad += 0.02 * output.setpoint.yaw_rate_radps;
        place = place.plus(Horizontal { north: velocity.north, east: velocity.east }.times(0.02));
        if step % 50 == 0 {
            println!(
                "{:4.1} s: {:5.2} m north {:5.2} m east, {:?}",
                step as f32 * 0.02,
                place.north,
                place.east,
                output.outcome
            );
        }
        assert!(place.minus(pillar.center_ned_m).norm() > pillar.radius_m + 0.15, "the hull touches the pillar");
        if place.minus(beacon_ned_m).norm() < 0.5 {
            println!("at the beacon after {:.1} s", step as f32 * 0.02);
            break;
        }
    }
    assert!(place.minus(beacon_ned_m).norm() < 0.5, "it does not arrive");
    Ok(())
}
