//! The true world: a beacon and vertical pillars, standing or moving, in a horizontal plane.
//!
//! Everything here is in the NED frame, metres and seconds, in `f64`: it is the truth that the core never sees.

use super::geometry::Horizontal;
use super::person::Person;
use super::pillar::Pillar;
use super::rays::{self, Wall};
use crate::scenario::{self, Scenario};

/// The beacon and the pillars at time zero, and the people. The beacon moves straight on; pillars too, or to and fro.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// Pillars at time zero.
    pub pillars: Vec<Pillar>,
    /// The people.
    pub people: Vec<Person>,
    /// The beacon at time zero.
    pub source: Horizontal,
    /// The beacon's velocity.
    pub source_velocity_mps: Horizontal,
    /// The beacon's height in the NED frame: down is positive.
    pub source_down_m: f64,
    /// Walls for radio waves; as obstacles they are rows of pillars.
    pub walls: Vec<Wall>,
}

impl World {
    /// The pillars at a time, and the people who are present then.
    pub fn pillars_at(&self, time_s: f64) -> impl Iterator<Item = Pillar> + '_ {
        self.all_at(time_s).flatten()
    }

    /// The same, always as many in the same order: `None` for a person who is absent.
    pub fn all_at(&self, time_s: f64) -> impl Iterator<Item = Option<Pillar>> + '_ {
        let pillars = self.pillars.iter().map(move |pillar| Some(pillar.after(time_s)));
        pillars.chain(self.people.iter().map(move |person| person.at(time_s)))
    }

    /// The people who are present at a time, without the pillars.
    pub fn people_at(&self, time_s: f64) -> impl Iterator<Item = Pillar> + '_ {
        self.people.iter().filter_map(move |person| person.at(time_s))
    }

    /// The beacon at a time.
    #[must_use]
    pub fn source_at(&self, time_s: f64) -> Horizontal {
        self.source.along(self.source_velocity_mps, time_s)
    }
}

/// Height of the beacon: a third of a metre below the flight, so that elevation is not exactly zero.
const SOURCE_DOWN_M: f64 = -1.7;
/// The beacon in scenarios with a landing: on the ground, plus its own height.
const PAD_SOURCE_DOWN_M: f64 = -0.05;

impl Scenario {
    /// The true world of this scenario, without its people: [`Self::peopled`].
    #[must_use]
    pub fn world(&self) -> World {
        let pillars = self.obstacles.iter().map(|obstacle| Pillar {
            center: Horizontal::from_xy([obstacle.x, obstacle.y]),
            radius_m: obstacle.r,
            velocity_mps: Horizontal::from_xy([obstacle.vx, obstacle.vy]),
            turns_s: obstacle.turns_s,
        });
        let walls = self.walls.iter().map(|wall| rays::Wall {
            from: Horizontal::from_xy([wall.x0, wall.y0]),
            to: Horizontal::from_xy([wall.x1, wall.y1]),
            reflection_db: wall.reflection_db,
            passage_db: wall.passage_db,
        });
        World {
            pillars: pillars.chain(self.walls.iter().flat_map(|wall| wall.pillars())).collect(),
            people: Vec::new(),
            walls: walls.collect(),
            source: Horizontal::from_xy(self.goal),
            source_velocity_mps: Horizontal::from_xy(self.goal_velocity),
            source_down_m: if self.landing.is_some() { PAD_SOURCE_DOWN_M } else { SOURCE_DOWN_M },
        }
    }
}

impl scenario::Wall {
    /// The row of pillars that makes the wall, without gaps.
    fn pillars(self) -> impl Iterator<Item = Pillar> {
        let (from, to) = (Horizontal::from_xy([self.x0, self.y0]), Horizontal::from_xy([self.x1, self.y1]));
        let gaps = libm::ceil(to.minus(from).norm() / (1.5 * self.r)).max(1.0);
        (0..=gaps as u32).map(move |k| Pillar {
            center: from.along(to.minus(from), f64::from(k) / gaps),
            radius_m: self.r,
            velocity_mps: Horizontal::default(),
            turns_s: 0.0,
        })
    }
}

/// Clearance between the vehicle's hull and pillars and people, and which counts as a collision.
///
/// A hull that overlaps a pillar at the start has not collided while that overlap grows by no more than 1 mm; once out,
/// the pillar is one like any other.
#[derive(Clone, Debug)]
pub struct Hull {
    radius_m: f64,
    /// Per pillar: the smallest clearance that is not a collision yet.
    allowed_m: Vec<f64>,
    /// Smallest clearance so far; infinite in a world without pillars.
    pub min_clearance_m: f64,
}

/// How much an overlap at the start may grow.
const START_OVERLAP_GROWTH_M: f64 = 1e-3;

/// Larger than any rounding error of a distance.
const ROOT_MARGIN: f64 = 1.0 + 1e-9;

impl Hull {
    /// The hull at the start of a flight.
    #[must_use]
    pub fn new(world: &World, radius_m: f64, start: Horizontal) -> Self {
        let clearance = |pillar: Option<Pillar>| pillar.map_or(f64::INFINITY, |one| clearance_m(&one, radius_m, start));
        let clearances: Vec<f64> = world.all_at(0.0).map(clearance).collect();
        let min_clearance_m = clearances.iter().copied().fold(f64::INFINITY, f64::min);
        let allowed_m = clearances
            .into_iter()
            .map(|clearance| if clearance < 0.0 { clearance - START_OVERLAP_GROWTH_M } else { 0.0 })
            .collect();
        Self { radius_m, allowed_m, min_clearance_m }
    }

    /// Whether the hull at `position` has collided at `time_s`.
    pub fn collides(&mut self, world: &World, position: Horizontal, time_s: f64) -> bool {
        let mut collided = false;
        for (pillar, allowed_m) in world.all_at(time_s).zip(&mut self.allowed_m) {
            let Some(pillar) = pillar else {
                *allowed_m = 0.0;
                continue;
            };
            // Most pillars are farther away than the nearest ever was: decided without a root.
            let to_center = pillar.center.minus(position);
            let counts_m = (self.min_clearance_m.max(0.0) + pillar.radius_m + self.radius_m) * ROOT_MARGIN;
            if to_center.dot(to_center) > counts_m * counts_m {
                *allowed_m = 0.0;
                continue;
            }
            let clearance = clearance_m(&pillar, self.radius_m, position);
            self.min_clearance_m = self.min_clearance_m.min(clearance);
            collided |= clearance < *allowed_m;
            if clearance >= 0.0 {
                *allowed_m = 0.0;
            }
        }
        collided
    }
}

fn clearance_m(pillar: &Pillar, hull_radius_m: f64, position: Horizontal) -> f64 {
    position.minus(pillar.center).norm() - pillar.radius_m - hull_radius_m
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_pillar(velocity_east: f64) -> World {
        World {
            pillars: vec![Pillar {
                center: Horizontal { north: 0.0, east: 0.0 },
                radius_m: 0.5,
                velocity_mps: Horizontal { north: 0.0, east: velocity_east },
                turns_s: 0.0,
            }],
            people: Vec::new(),
            source: Horizontal::default(),
            source_velocity_mps: Horizontal::default(),
            source_down_m: 0.0,
            walls: Vec::new(),
        }
    }

    fn north(north: f64) -> Horizontal {
        Horizontal { north, east: 0.0 }
    }

    #[test]
    fn touching_is_clear_and_any_overlap_from_outside_is_a_collision() {
        let world = one_pillar(0.0);
        let mut hull = Hull::new(&world, 0.15, north(2.0));
        assert!(!hull.collides(&world, north(0.650_001), 0.0));
        assert!(hull.collides(&world, north(0.649_9), 0.0));
        assert!((hull.min_clearance_m + 1e-4).abs() < 1e-9);
    }

    #[test]
    fn an_overlap_at_the_start_may_grow_by_a_millimetre_and_counts_anew_once_left() {
        let world = one_pillar(0.0);
        let mut hull = Hull::new(&world, 0.15, north(0.60));
        assert!((hull.min_clearance_m + 0.05).abs() < 1e-12);
        assert!(!hull.collides(&world, north(0.599_1), 0.0));
        assert!(hull.clone().collides(&world, north(0.598_9), 0.0));
        assert!(!hull.collides(&world, north(0.7), 0.0));
        assert!(hull.collides(&world, north(0.64), 0.0), "left once: no allowance any more");
    }

    #[test]
    fn a_moving_pillar_runs_into_a_hovering_hull() {
        let world = one_pillar(-0.3);
        let at = Horizontal { north: 0.0, east: -2.0 };
        let mut hull = Hull::new(&world, 0.15, at);
        assert!(!hull.collides(&world, at, 4.49));
        assert!(hull.collides(&world, at, 4.51));
    }

    #[test]
    fn pillars_far_off_are_passed_over_and_change_neither_clearance_nor_collision() {
        let mut random = crate::world::random::Random::new(5, 1);
        for _ in 0..50 {
            let mut pillar = || Pillar {
                center: Horizontal { north: 9.0 * random.uniform(), east: 9.0 * random.uniform() },
                radius_m: 0.2 + random.uniform(),
                velocity_mps: Horizontal { north: random.uniform() - 0.5, east: 0.0 },
                turns_s: if random.uniform() < 0.5 { 3.0 } else { 0.0 },
            };
            let world = World { pillars: (0..20).map(|_| pillar()).collect(), ..one_pillar(0.0) };
            let clearances = |at: Horizontal, time_s: f64| -> Vec<f64> {
                world.pillars_at(time_s).map(|pillar| clearance_m(&pillar, 0.15, at)).collect()
            };
            let mut hull = Hull::new(&world, 0.15, north(0.0));
            let mut allowed_m: Vec<f64> =
                clearances(north(0.0), 0.0).iter().map(|c| if *c < 0.0 { c - 1e-3 } else { 0.0 }).collect();
            let mut least_m = hull.min_clearance_m;
            for step in 1..=90 {
                let (at, time_s) = (north(f64::from(step) * 0.1), f64::from(step) * 0.1);
                let all = clearances(at, time_s);
                let collides = all.iter().zip(&allowed_m).any(|(clearance, allowed)| clearance < allowed);
                assert_eq!(hull.collides(&world, at, time_s), collides);
                least_m = all.iter().copied().fold(least_m, f64::min);
                assert_eq!(hull.min_clearance_m, least_m);
                allowed_m.iter_mut().zip(&all).filter(|(_, c)| **c >= 0.0).for_each(|(allowed, _)| *allowed = 0.0);
            }
        }
    }

    #[test]
    fn who_walks_to_and_fro_is_back_after_two_legs_and_says_which_way_he_goes() {
        let mut world = one_pillar(0.5);
        world.pillars[0].turns_s = 4.0;
        for (time_s, east, mps) in
            [(0.0, 0.0, 0.5), (3.0, 1.5, 0.5), (4.5, 1.75, -0.5), (7.0, 0.5, -0.5), (8.0, 0.0, 0.5), (83.0, 1.5, 0.5)]
        {
            let pillar = world.pillars_at(time_s).next().unwrap();
            assert!((pillar.center.east - east).abs() < 1e-12, "{time_s} s: {}", pillar.center.east);
            assert_eq!(pillar.velocity_mps.east, mps, "{time_s} s");
        }
    }

    #[test]
    fn the_built_in_mission_passes_its_own_checks_and_starts_clear() {
        let scenario = Scenario::built_in().checked().unwrap();
        let world = scenario.world();
        for place in [scenario.start, scenario.goal] {
            let hull = Hull::new(&world, scenario.drone_radius, Horizontal::from_xy(place));
            assert!(hull.min_clearance_m > 0.5);
        }
    }
}
