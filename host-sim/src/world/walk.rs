//! How a person walks: along the route or the heading, swaying, stopping and turning at random, by the flight's seed.

use super::course::Course;
use super::geometry::Horizontal;
use super::random::Random;
use crate::scenario;

/// Time between two positions of a walk.
const STEP_S: f64 = 0.1;
/// Acceleration at the start and at a stop.
const STARTS_MPS2: f64 = 2.0;
/// Rate of random turns; at the points of a route a person turns on the spot.
const TURNS_DEGPS: f64 = 150.0;
/// Purpose of the random numbers of the first in a scenario; those of the others follow.
const PURPOSE: u64 = 0x3a1c_0000;

/// A step of the walk of a group.
struct Step {
    time_s: f64,
    place: Horizontal,
    /// A unit vector.
    heading: Horizontal,
    /// The time walked so far, without stops.
    walked_s: f64,
}

/// The walks of a group, number `index` of a scenario.
pub(super) fn walks(person: &scenario::Person, index: usize, seed: u64, lasts_s: f64) -> Vec<Course> {
    let mut random = Random::new(seed, PURPOSE + index as u64);
    let steps = steps(person, &mut random, lasts_s);
    person.abreast().map(|aside| sway(person, Horizontal::from_xy(aside), &steps, random.uniform())).collect()
}

/// The walk of one of the group: with the offset to the others, and the sway.
fn sway(person: &scenario::Person, aside: Horizontal, steps: &[Step], phase: f64) -> Course {
    let across_m =
        |walked_s: f64| person.sway_m * libm::sin(std::f64::consts::TAU * (walked_s / person.sway_s + phase));
    let (mut course, mut offset, mut before_m) = (Course::default(), aside, across_m(0.0));
    for step in steps {
        let now_m = across_m(step.walked_s);
        // Across the present heading, so that a turn causes no jump.
        let right = Horizontal { north: -step.heading.east, east: step.heading.north };
        offset = offset.along(right, now_m - before_m);
        before_m = now_m;
        course.push(step.time_s, step.place.along(offset, 1.0));
    }
    course
}

fn steps(person: &scenario::Person, random: &mut Random, lasts_s: f64) -> Vec<Step> {
    let mut route = person.route.iter().copied().map(Horizontal::from_xy);
    let mut place = route.next().unwrap_or_default();
    let mut target = route.next();
    let mut heading_rad = Horizontal::from_xy(person.first_heading()).bearing_rad();
    let (mut wanted_rad, mut speed_mps, mut walked_s) = (heading_rad, person.speed, 0.0);
    let (mut stops_s, mut goes_s) = (after(random, person.stop_every_s), 0.0);
    let mut turns_s = after(random, person.turn_every_s);
    let mut steps = Vec::new();
    for step in 0..=libm::ceil(lasts_s / STEP_S) as u32 {
        let time_s = f64::from(step) * STEP_S;
        steps.push(Step { time_s, place, heading: Horizontal::from_bearing(heading_rad), walked_s });
        if time_s >= stops_s {
            goes_s = time_s + after(random, person.stop_s);
            stops_s = goes_s + after(random, person.stop_every_s);
        }
        if time_s >= turns_s {
            wanted_rad += (2.0 * random.uniform() - 1.0) * person.turn_deg.to_radians();
            turns_s = time_s + after(random, person.turn_every_s);
        }
        let wanted_mps = if time_s < goes_s { 0.0 } else { person.speed };
        speed_mps += (wanted_mps - speed_mps).clamp(-STARTS_MPS2 * STEP_S, STARTS_MPS2 * STEP_S);
        let most_rad = TURNS_DEGPS.to_radians() * STEP_S;
        heading_rad += (wanted_rad - heading_rad).clamp(-most_rad, most_rad);
        if speed_mps > 0.0 {
            walked_s += STEP_S;
        }
        let mut left_m = speed_mps * STEP_S;
        while let Some(to) = target {
            let way = to.minus(place);
            heading_rad = way.bearing_rad();
            wanted_rad = heading_rad;
            if way.norm() > left_m {
                break;
            }
            left_m -= way.norm();
            (place, target) = (to, route.next());
        }
        place = place.along(Horizontal::from_bearing(heading_rad), left_m);
    }
    steps
}

/// Random time until an event with this mean interval, independent of the last one; zero: never.
fn after(random: &mut Random, mean_s: f64) -> f64 {
    if mean_s > 0.0 { -mean_s * libm::log(1.0 - random.uniform()) } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Person;

    const LASTS_S: f64 = 120.0;

    fn walk(person: &Person, seed: u64) -> Vec<(Horizontal, Horizontal)> {
        let course = walks(person, 0, seed, LASTS_S).remove(0);
        (0..1200).map(|step| course.at(f64::from(step) * 0.1).unwrap()).collect()
    }

    fn north() -> Person {
        Person { route: vec![[0.0, 0.0]], heading_deg: Some(0.0), ..Person::default() }
    }

    #[test]
    fn who_only_walks_walks_straight_on_at_his_speed_whatever_the_seed() {
        for (step, (place, velocity)) in walk(&north(), 1).into_iter().enumerate() {
            assert!(place.minus(Horizontal { north: 0.167 * step as f64, east: 0.0 }).norm() < 1e-9);
            assert!(velocity.minus(Horizontal { north: 1.67, east: 0.0 }).norm() < 1e-9);
        }
        assert_eq!(walk(&north(), 1), walk(&north(), 2));
    }

    #[test]
    fn a_route_is_walked_from_place_to_place_and_straight_on_from_the_last() {
        let person = Person { route: vec![[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]], speed: 1.0, ..Person::default() };
        let places: Vec<(f64, f64)> = walk(&person, 1).into_iter().map(|(place, _)| place.xy()).collect();
        for (step, place) in [(0, (0.0, 0.0)), (20, (2.0, 0.0)), (30, (3.0, 0.0)), (70, (3.0, 4.0)), (90, (3.0, 6.0))] {
            assert!((places[step].0 - place.0).hypot(places[step].1 - place.1) < 1e-9, "{step}: {:?}", places[step]);
        }
    }

    #[test]
    fn swaying_goes_as_far_as_it_says_to_either_side_and_as_often() {
        let person = Person { sway_m: 0.3, sway_s: 4.0, ..north() };
        let east: Vec<f64> = walk(&person, 5).into_iter().map(|(place, _)| place.east).collect();
        let (least, most) = east.iter().fold((f64::MAX, f64::MIN), |(least, most), x| (least.min(*x), most.max(*x)));
        assert!((most - least - 0.6).abs() < 0.01, "{least} {most}");
        let middle = 0.5 * (least + most);
        let crossings = east.windows(2).filter(|pair| (pair[0] < middle) != (pair[1] < middle)).count();
        assert!((59..=61).contains(&crossings), "{crossings} in {LASTS_S} s");
        assert_eq!(east[0], 0.0, "he starts where he is said to");
    }

    #[test]
    fn stops_are_as_often_and_as_long_as_they_are_said_to_be_and_take_their_time() {
        let person = Person { stop_every_s: 6.0, stop_s: 3.0, ..north() };
        let (mut stands, mut stops) = (0, 0);
        for seed in 0..50 {
            let speeds: Vec<f64> = walk(&person, seed).into_iter().map(|(_, velocity)| velocity.norm()).collect();
            stands += speeds.iter().filter(|speed| **speed < 1e-9).count();
            stops += speeds.windows(2).filter(|pair| pair[0] >= 1e-9 && pair[1] < 1e-9).count();
            assert!(speeds.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.2 + 1e-9));
        }
        // 120 s are 13.3 times 9 s; the stop and the start take 0.8 s each, so that the shortest stops do not count.
        assert!((9.0..14.0).contains(&(stops as f64 / 50.0)), "{stops}");
        assert!((0.18..0.34).contains(&(stands as f64 / (50.0 * 1200.0))), "{stands}");
        assert_ne!(walk(&person, 1), walk(&person, 2));
        assert_eq!(walk(&person, 1), walk(&person, 1));
    }

    #[test]
    fn turns_go_to_either_side_and_no_farther_nor_quicker_than_they_may() {
        let person = Person { turn_every_s: 10.0, turn_deg: 40.0, ..north() };
        let (mut left, mut right) = (0, 0);
        for seed in 0..50 {
            let headings: Vec<f64> =
                walk(&person, seed).into_iter().map(|(_, v)| v.bearing_rad().to_degrees()).collect();
            for pair in headings.windows(2) {
                let turned = libm::remainder(pair[1] - pair[0], 360.0);
                assert!(turned.abs() < 15.0 + 1e-6, "{turned}");
                (left, right) = (left + i32::from(turned < -1e-6), right + i32::from(turned > 1e-6));
            }
        }
        assert!(left > 300 && right > 300 && (left - right).abs() < 300, "{left} {right}");
    }

    #[test]
    fn a_group_stays_together() {
        let person = Person { group: 3, group_gap: 0.8, stop_every_s: 5.0, turn_every_s: 5.0, ..north() };
        let courses = walks(&person, 0, 3, LASTS_S);
        assert_eq!(courses.len(), 3);
        for step in 0..1200 {
            let places: Vec<Horizontal> = courses.iter().map(|way| way.at(f64::from(step) * 0.1).unwrap().0).collect();
            for pair in places.windows(2) {
                assert!((pair[1].minus(pair[0]).norm() - 0.8).abs() < 1e-9);
            }
        }
    }
}
