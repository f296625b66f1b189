//! Rollouts in every field and in every reading, against the ones that leave nothing out.

use super::*;
use foxhound_core::planning::field::ForceField as _;
use foxhound_core::planning::planner::baseline::Kind;
use foxhound_core::planning::rollout::{cost, roll_plainly};
use std::vec::Vec as StdVec;

const GAINS: Gains = Gains { k_att: 1.0, k_rep: 0.2, influence_m: 0.8, swirl: 0.0 };

/// Sixty-four circles, so many to a square metre, and gains like the planner's.
fn forest(seed: u64, density: f32) -> (StdVec<Obstacle>, Gains, Horizontal) {
    let mut rng = Rng::new(seed, 5);
    let side_m = 8.0 / libm::sqrtf(density);
    let obstacles = (0..64)
        .map(|_| Obstacle {
            center_ned_m: Horizontal { north: side_m * (rng.uniform() - 0.5), east: side_m * (rng.uniform() - 0.5) },
            reach_m: 0.25 + 0.23 * rng.uniform(),
        })
        .collect();
    let above = |value: f32, least: f32| if value > least { value } else { least };
    let gains = Gains {
        k_att: above(1.0 + 0.3 * rng.gaussian(), 0.05),
        k_rep: above(0.1 + 0.1 * rng.gaussian(), 0.005),
        influence_m: above(0.8 + 0.3 * rng.gaussian(), 0.05),
        swirl: 3.0 * rng.gaussian(),
    };
    (obstacles, gains, Horizontal::from_bearing(3.0 * rng.uniform()).times(2.5 * rng.uniform()))
}

fn bits(trajectory: &Trajectory, cost: &Cost) -> StdVec<u32> {
    let points = trajectory.iter().flat_map(|p| [p.north, p.east]);
    points.chain([cost.length, cost.error, cost.turns, cost.proximity]).map(f32::to_bits).collect()
}

#[test]
fn leaving_out_what_is_far_changes_no_bit_in_any_law_reading_or_density() {
    let mut scene = Scene::new();
    let (mut slid, mut alone) = (0, 0);
    for seed in 0..3000_u64 {
        let density = [1.0, 1.0, 4.0, 0.3, 0.03, 0.001][(seed % 6) as usize];
        let (obstacles, gains, target) = forest(seed, density);
        let exponent = [Exponent::Half, Exponent::One, Exponent::Two][(seed / 7 % 3) as usize];
        let kind = if seed % 2 == 0 { Kind::Logarithmic } else { Kind::ALL[(seed / 2 % 6) as usize] };
        let field = Field { law: Law { exponent, ..Law::of(kind) }, gains };
        let reading =
            [Reading::Waypoint, Reading::Waypoint, Reading::Quarters, Reading::Gradient][(seed / 6 % 4) as usize];
        // Away from the origin positions are rounded.
        let shift = Horizontal { north: 1e3, east: -2e3 }.times((seed % 5) as f32);
        let obstacles: StdVec<Obstacle> =
            obstacles.iter().map(|o| Obstacle { center_ned_m: o.center_ned_m.plus(shift), ..*o }).collect();
        let target = target.plus(shift);
        scene.gather(shift, obstacles.iter().copied());
        let (trajectory, price) = roll(&scene, &field, reading, target);
        let ordered: StdVec<Obstacle> = scene.obstacles().collect();
        let plain = roll_plainly(&field, Steps(reading), shift, target, &ordered);
        let wanted = cost(shift, &plain, target, &obstacles);
        assert_eq!(bits(&trajectory, &price), bits(&plain, &wanted), "seed {seed}, {field:?}, {reading:?}");
        slid += i32::from(price.turns > 0.1);
        alone += i32::from(1.0 / price.proximity > gains.influence_m);
    }
    assert!(slid > 1500 && alone > 500, "{slid} {alone}");
}

#[test]
fn the_readings_take_one_step_or_four_or_a_fiftieth_of_the_force() {
    let (start, target) = (Horizontal::default(), Horizontal { north: 2.0, east: 0.0 });
    let pillar = Obstacle { center_ned_m: Horizontal { north: 1.0, east: 0.3 }, reach_m: 0.4 };
    let field = Field { gains: GAINS, ..Field::default() };
    let first = |reading| roll_plainly(&field, Steps(reading), start, target, &[pillar])[0];
    let force = field.force(start, target, &[pillar]);
    assert!(first(Reading::Waypoint).minus(force.times(SPACING_M / force.norm())).norm() < 1e-6);
    assert!(first(Reading::Gradient).minus(force.times(0.02)).norm() < 1e-6);
    let mut position = start;
    for _ in 0..4 {
        let force = field.force(position, target, &[pillar]);
        position = position.plus(force.times(0.25 * SPACING_M / force.norm()));
    }
    assert!(first(Reading::Quarters).minus(position).norm() < 1e-6);
    // Without obstacles a fiftieth of the rest is left behind at each of 15 steps.
    let end = roll_plainly(&field, Steps(Reading::Gradient), start, target, &[])[14];
    assert!((end.north - 2.0 * (1.0 - 0.98_f32.powi(15))).abs() < 1e-5, "{end:?}");
    // And no step is longer than the others' even deep inside an obstacle.
    let deep = Obstacle { center_ned_m: Horizontal { north: 0.0, east: -0.1 }, reach_m: 0.6 };
    let khatib = Field { law: Law::of(Kind::Khatib), ..field };
    let leap = roll_plainly(&khatib, Steps(Reading::Gradient), start, target, &[deep])[0];
    assert!((leap.norm() - SPACING_M).abs() < 1e-6, "{leap:?}");
}
