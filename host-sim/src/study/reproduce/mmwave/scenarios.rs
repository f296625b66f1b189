//! Where transmitters are and where robots start.

use rayon::prelude::{IntoParallelIterator as _, ParallelIterator as _};

use super::known::Known;
use super::plan::Plan;
use super::radio::{self, Link};
use super::trial::Start;
use crate::world::random::Random;

/// Plans.
pub(super) const PLANS: u32 = 10;
/// Starts of one transmitter: the paper has 200 scenarios with 100 transmitters.
const STARTS: usize = 2;
/// Nearest that a start is to its transmitter.
pub(super) const DISTANCE_MIN_M: f64 = 8.0;
/// Free space around a transmitter and a start.
const ROOM_M: f64 = 0.5;
/// Starts that are tried with one transmitter.
const TRIES: usize = 40;
/// The link at the start, by which scenarios are classed.
pub(super) const CLASSES: [Link; 3] = [Link::LineOfSight, Link::FirstOrder, Link::HigherOrder];

/// A scenario.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scenario {
    /// Which plan.
    pub(super) plan: usize,
    /// Where it begins.
    pub(super) start: Start,
    /// The link there.
    pub(super) link: Link,
}

/// Draws the plans, every other one with a corridor.
pub(super) fn plans(seed: u64) -> Vec<Plan> {
    (0..PLANS).map(|k| Plan::draw(seed_of(seed, k as usize), k % 2 == 0)).collect()
}

fn seed_of(seed: u64, plan: usize) -> u64 {
    seed.wrapping_mul(1000).wrapping_add(plan as u64)
}

/// Draws so many scenarios, as many of each class and on each plan as it goes, all with a path to the transmitter.
pub(super) fn scenarios(plans: &[Plan], seed: u64, count: usize) -> Vec<Scenario> {
    let of_plan = |plan: usize| {
        let quota = |class: usize| {
            // Scenario k is of class k mod 3 and on plan (k / 3) mod 10.
            (0..count).filter(|k| k % CLASSES.len() == class && (k / CLASSES.len()) % plans.len() == plan).count()
        };
        draw(&plans[plan], plan, seed_of(seed, plan), [0, 1, 2].map(quota))
    };
    (0..plans.len()).into_par_iter().flat_map_iter(of_plan).collect()
}

fn draw(plan: &Plan, index: usize, seed: u64, mut wanted: [usize; CLASSES.len()]) -> Vec<Scenario> {
    let known = Known::all(plan);
    let mut random = Random::new(seed, 6);
    let mut drawn = Vec::new();
    while wanted.iter().any(|count| *count > 0) {
        let transmitter = plan.place(&mut random, ROOM_M);
        let mut starts = 0;
        for _ in 0..TRIES {
            let place = plan.place(&mut random, ROOM_M);
            if place.minus(transmitter).norm() < DISTANCE_MIN_M {
                continue;
            }
            let link = radio::hear(&plan.walls, transmitter, place).link;
            let Some(class) = CLASSES.iter().position(|class| *class == link).filter(|class| wanted[*class] > 0) else {
                continue;
            };
            let way = known.way(place, transmitter);
            if !way.is_some_and(|way| way.last().is_some_and(|last| last.minus(transmitter).norm() < ROOM_M)) {
                continue;
            }
            wanted[class] -= 1;
            let seed = seed.wrapping_mul(1000).wrapping_add(drawn.len() as u64);
            drawn.push(Scenario { plan: index, start: Start { transmitter, place, seed }, link });
            starts += 1;
            if starts == STARTS {
                break;
            }
        }
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_are_balanced_and_every_start_is_what_it_says() {
        let plans = plans(3);
        let all = scenarios(&plans, 3, 31);
        assert_eq!(CLASSES.map(|class| all.iter().filter(|s| s.link == class).count()), [11, 10, 10]);
        for scenario in &all {
            let (plan, start) = (&plans[scenario.plan], scenario.start);
            assert_eq!(radio::hear(&plan.walls, start.transmitter, start.place).link, scenario.link);
            assert!(start.place.minus(start.transmitter).norm() >= DISTANCE_MIN_M);
            assert_eq!(plan.is_clear(start.place, start.transmitter), scenario.link == Link::LineOfSight);
        }
    }
}
