//! `mmwave`: agents that look for a transmitter indoors.

pub mod agent;
pub mod explore;
pub mod known;
pub mod plan;
pub mod radio;
pub mod trial;
pub mod walls;

use rayon::prelude::{IntoParallelRefIterator as _, ParallelIterator as _};

use crate::random::Random;
use agent::Kind;
use known::Known;
use plan::Plan;
use radio::Link;
use trial::{Noise, Start};

/// Plans.
pub const PLANS: u32 = 10;

/// A scenario.
#[derive(Clone, Copy, Debug)]
pub struct Scenario {
    pub plan: usize,
    pub start: Start,
    pub link: Link,
    pub shortest_m: f64,
}

const DISTANCE_MIN_M: f64 = 8.0;
const CLASSES: [Link; 3] = [Link::LineOfSight, Link::FirstOrder, Link::HigherOrder];

pub fn plans(seed: u64) -> Vec<Plan> {
    (0..PLANS).map(|k| Plan::draw(seed.wrapping_mul(1000).wrapping_add(k.into()), k % 2 == 0)).collect()
}

pub fn scenarios(plans: &[Plan], seed: u64, count: usize) -> Vec<Scenario> {
    let each = count.div_ceil(plans.len());
    let mut all: Vec<Scenario> = plans
        .iter()
        .enumerate()
        .collect::<Vec<_>>()
        .par_iter()
        .flat_map_iter(|(k, plan)| {
            let known = Known::all(plan);
            let mut random = Random::new(seed.wrapping_mul(1000).wrapping_add(*k as u64), 6);
            let mut out = Vec::new();
            let mut transmitter = plan.place(&mut random, 0.5);
            let mut tries = 0;
            while out.len() < each {
                if tries == 300 || (out.len() % 2 == 0 && tries == 0) {
                    transmitter = plan.place(&mut random, 0.5);
                    tries = 0;
                }
                tries += 1;
                let wanted = CLASSES[(out.len() + k) % 3];
                let place = plan.place(&mut random, 0.5);
                if place.minus(transmitter).norm() < DISTANCE_MIN_M {
                    continue;
                }
                let link = radio::hear(&plan.walls, transmitter, place).link;
                if link != wanted {
                    continue;
                }
                let Some(way) = known.way(place, transmitter) else { continue };
                if way.last().is_none_or(|last| last.minus(transmitter).norm() > 0.5) {
                    continue;
                }
                let shortest_m = way.windows(2).map(|pair| pair[1].minus(pair[0]).norm()).sum();
                out.push(Scenario {
                    plan: *k,
                    start: Start {
                        transmitter,
                        place,
                        seed: seed ^ (*k as u64 * 1000 + out.len() as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15),
                    },
                    link,
                    shortest_m,
                });
                tries = 0;
            }
            out
        })
        .collect();
    all.truncate(count);
    all
}
