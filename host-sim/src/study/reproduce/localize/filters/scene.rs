//! Where sources, walls and guesses are drawn from.

use super::FIG_2_M;
use super::trial::{Course, ORIGIN, Wall, anywhere_rad, uniform};
use crate::world::Horizontal;
use crate::world::random::Random;

/// A course and the prior of its inverse range; how the paper's filter begins.
pub(super) struct Scene {
    pub(super) course: Course,
    pub(super) rho: [f64; 2],
    pub(super) guess: Horizontal,
    pub(super) guess_sigma_m: f64,
}

/// 40 m off, in any direction or in range.
pub(super) fn draw_fig_2(random: &mut Random) -> Scene {
    loop {
        let range_m = uniform(random, 10.0, 30.0);
        let source = ORIGIN.along(Horizontal::from_bearing(anywhere_rad(random)), range_m);
        let guess = source.along(Horizontal::from_bearing(anywhere_rad(random)), FIG_2_M);
        if let Some(course) = Course::random(Vec::new(), source, random) {
            let rho = [1.0 / (range_m + FIG_2_M), 0.04];
            return Scene { course, rho, guess, guess_sigma_m: FIG_2_M / std::f64::consts::SQRT_2 };
        }
    }
}

/// A range from the prior, and the same in metres for the paper's filter.
pub(super) fn draw_range([rho, sigma]: [f64; 2], random: &mut Random) -> ([f64; 2], Horizontal) {
    loop {
        let drawn = rho + sigma * random.gaussian();
        if drawn > 0.4 * rho {
            let towards = Horizontal::from_bearing(anywhere_rad(random));
            return ([1.0 / drawn, sigma / (rho * rho)], towards);
        }
    }
}

/// In sight, from a prior of the inverse range and its standard deviation.
pub(super) fn draw_prior(rho: [f64; 2], random: &mut Random) -> Scene {
    loop {
        let ([range_m, guess_sigma_m], towards) = draw_range(rho, random);
        let source = ORIGIN.along(towards, range_m);
        let guess = around(ORIGIN.along(towards, 1.0 / rho[0]), guess_sigma_m, random);
        if let Some(course) = Course::random(Vec::new(), source, random) {
            return Scene { course, rho, guess, guess_sigma_m };
        }
    }
}

/// Half of a straight leg to a source from the prior.
pub(super) fn draw_leg(leg: [f64; 2], random: &mut Random) -> Scene {
    loop {
        let ([range_m, guess_sigma_m], towards) = draw_range(leg, random);
        if range_m > 8.0 {
            let guess = around(ORIGIN.along(towards, 1.0 / leg[0]), guess_sigma_m, random);
            let course = Course::straight(ORIGIN.along(towards, range_m), 6.0);
            return Scene { course, rho: leg, guess, guess_sigma_m };
        }
    }
}

/// A place, so uncertain along each axis.
pub(super) fn around(place: Horizontal, sigma_m: f64, random: &mut Random) -> Horizontal {
    place
        .along(Horizontal { north: 1.0, east: 0.0 }, sigma_m * random.gaussian())
        .along(Horizontal { north: 0.0, east: 1.0 }, sigma_m * random.gaussian())
}

/// A wall with a slope: its normal is within 60 deg of the paper's y axis.
pub(super) fn draw_slanted(random: &mut Random) -> Wall {
    let side = if random.uniform() < 0.5 { 0.0 } else { std::f64::consts::PI };
    Wall::new(side + uniform(random, -60.0, 60.0).to_radians(), uniform(random, 6.0, 12.0))
}

/// A wall without one.
pub(super) fn draw_vertical(random: &mut Random) -> Wall {
    let side = if random.uniform() < 0.5 { -0.5 } else { 0.5 };
    Wall::new(side * std::f64::consts::PI, uniform(random, 6.0, 12.0))
}

/// A source in front of these walls.
pub(super) fn draw_before(walls: &[Wall], random: &mut Random) -> Horizontal {
    loop {
        let towards = Horizontal::from_bearing(anywhere_rad(random));
        let source = ORIGIN.along(towards, uniform(random, 5.0, 15.0));
        if walls.iter().all(|wall| wall.clearance_m(source) > 2.0) {
            return source;
        }
    }
}
