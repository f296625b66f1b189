//! The people of a world: their walks, and the vehicle relative to those who give way.

use super::aside::{Aside, Meeting};
use super::course::Course;
use super::geometry::Horizontal;
use super::person::Person;
use super::truth::World;
use super::walk;
use crate::scenario::Scenario;

/// Walks last this much longer than the flight.
const BEYOND_S: f64 = 1.0;

impl World {
    /// Updates the people who step aside with the vehicle's motion, from one time to another.
    pub fn step_aside(&mut self, hull_m: f64, place: Horizontal, velocity_mps: Horizontal, from_s: f64, until_s: f64) {
        for person in &mut self.people {
            let seen = person.at(from_s).map(|body| Meeting {
                apart_m: body.center.minus(place),
                closing_mps: body.velocity_mps.minus(velocity_mps),
                reach_m: body.radius_m + hull_m,
            });
            if let Some(aside) = &mut person.aside {
                aside.step(seen, from_s, until_s);
            }
        }
    }
}

impl Scenario {
    /// [`Self::world`] with its people, who walk by a seed.
    #[must_use]
    pub fn peopled(&self, seed: u64) -> World {
        let courses = self.people.iter().enumerate().flat_map(|(index, person)| {
            let courses = if person.track.is_empty() {
                walk::walks(person, index, seed, self.max_time_s + BEYOND_S)
            } else {
                let mut course = Course::default();
                person.track.iter().for_each(|[time_s, x, y]| course.push(*time_s, Horizontal::from_xy([*x, *y])));
                vec![course]
            };
            courses.into_iter().map(move |course| (person, course))
        });
        let people = courses.map(|(person, course)| Person {
            course,
            radius_m: person.r,
            aside: person.steps_aside.then(Aside::new),
        });
        World { people: people.collect(), ..self.world() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn world(text: &str) -> World {
        Scenario::parse(text).unwrap().peopled(7)
    }

    #[test]
    fn who_has_a_track_is_there_while_it_lasts() {
        let world = world(r#"{"people":[{"track":[[2,5,5],[4,7,5]]}],"obstacles":[{"x":3,"y":9,"r":0.2}]}"#);
        let there = |time_s: f64| world.pillars_at(time_s).count() - 1;
        assert_eq!([1.9, 2.0, 4.0, 4.1].map(there), [0, 1, 1, 0]);
        let body = world.pillars_at(3.0).last().unwrap();
        assert_eq!((body.center.xy(), body.velocity_mps.xy(), body.radius_m), ((6.0, 5.0), (1.0, 0.0), 0.3));
    }

    /// The least distance of a person who walks towards a hull that stands, and the final offset from the route.
    fn passes_m(steps_aside: bool, off_m: f64) -> (f64, f64) {
        let text = format!(
            r#"{{"people":[{{"route":[[{off_m},8]],"heading_deg":180,"steps_aside":{steps_aside}}}],"start":[0,-9],"bounds":[-9,-9,9,9]}}"#
        );
        let (mut world, hull) = (world(&text), Horizontal::default());
        let mut least_m = f64::INFINITY;
        for step in 0..600 {
            let time_s = f64::from(step) * 0.02;
            least_m = least_m.min(world.pillars_at(time_s).next().unwrap().center.minus(hull).norm());
            world.step_aside(0.15, hull, Horizontal::default(), time_s, time_s + 0.02);
        }
        (least_m, world.pillars_at(12.0).next().unwrap().center.east - off_m)
    }

    #[test]
    fn who_steps_aside_passes_a_hull_that_stands_and_comes_back_to_his_way() {
        for off_m in [-0.4, -0.1, 0.0, 0.05, 0.3] {
            assert!((passes_m(false, off_m).0 - libm::fabs(off_m)).abs() < 0.02);
            let (least_m, off_in_the_end_m) = passes_m(true, off_m);
            assert!(least_m > 0.5, "{off_m}: {least_m}");
            assert!(off_in_the_end_m.abs() < 0.05, "{off_m}: {off_in_the_end_m}");
        }
        assert_eq!(passes_m(true, 1.5), passes_m(false, 1.5), "there is room");
    }

    #[test]
    fn what_was_is_not_changed_by_what_comes_after() {
        let text = r#"{"people":[{"route":[[5,8]],"heading_deg":180,"steps_aside":true}]}"#;
        let mut world = world(text);
        let mut seen = Vec::new();
        for step in 0..200 {
            let time_s = f64::from(step) * 0.02;
            seen.push(world.pillars_at(time_s).next().unwrap().center);
            world.step_aside(0.15, Horizontal::from_xy([5.0, 3.0]), Horizontal::default(), time_s, time_s + 0.02);
        }
        for (step, center) in seen.into_iter().enumerate() {
            let now = world.pillars_at(step as f64 * 0.02).next().unwrap().center;
            assert!(now.minus(center).norm() < 1e-12, "{step}");
        }
    }
}
