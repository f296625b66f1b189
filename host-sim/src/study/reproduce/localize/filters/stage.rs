//! The experiments, each with the paper's filter and ours on the same courses.

use foxhound_core::ConfigError;
use foxhound_core::localize::source::{Estimate, Sighting, Update, polar};
use foxhound_papers::filters::cartesian;
use foxhound_papers::filters::reflected::{self, Degenerate, Known, literal};

use super::picture::Figure;
use super::scene::{Scene, around, draw_before, draw_range, draw_slanted};
use super::trial::{Course, Gathered, ORIGIN, SIGHTINGS, Wall, anywhere_rad, nees, polar_nees, uniform};
use super::{FIG_3_M, Outcome, Row};
use crate::world::random::Random;
use crate::world::{Horizontal, from_core};

/// The moving source's, its speed along each axis, and the white acceleration that pushes it.
const MOVING_RHO: [f64; 2] = [0.05, 0.003];
const SPEED_MPS: f64 = 0.1;
const ACCELERATION_M2_PER_S3: f64 = 1e-6;

/// One experiment with both filters.
pub(super) struct Stage {
    random: Random,
    runs: usize,
    paper: Gathered,
    ours: Gathered,
    has_paper: bool,
    figure: Figure,
}

impl Stage {
    pub(super) fn new(seed: u64, purpose: u64, runs: usize) -> Self {
        Self {
            random: Random::new(seed, 0x10ca_0000 + purpose),
            runs,
            paper: Gathered::default(),
            ours: Gathered::default(),
            has_paper: true,
            figure: Figure::default(),
        }
    }

    pub(super) fn row(&self, name: &'static str, label: &'static str) -> Row {
        let paper = self.has_paper.then(|| Outcome::new(&self.paper));
        Row { name, label, paper, ours: Outcome::new(&self.ours) }
    }

    pub(super) fn figure(&mut self, title: &str) -> Figure {
        let mut figure = std::mem::take(&mut self.figure);
        title.clone_into(&mut figure.title);
        figure.medians(&self.paper, &self.ours);
        figure
    }

    /// The paper's Cartesian filter and the polar one.
    pub(super) fn line_of_sight(&mut self, draw: impl Fn(&mut Random) -> Scene) -> Result<(), ConfigError> {
        let filter = cartesian::Config::DEFAULT.build()?;
        for run in 0..self.runs {
            let scene = draw(&mut self.random);
            let course = &scene.course;
            let sightings = course.hear(&mut self.random);
            let mut state = cartesian::State::default();
            filter.begin(&mut state, ORIGIN.to_core(), scene.guess.to_core(), scene.guess_sigma_m as f32);
            let at_first = state.estimate();
            let paper = follow(&mut self.paper, course, &sightings, at_first, |sighting| {
                let heard = Ok(filter.step(&mut state, sighting));
                (heard, state.estimate())
            });
            let ours = self.polar::<2, 0>(course, &sightings, scene.rho, 0.0)?;
            if run == 0 {
                self.figure = Figure::new(course, &sightings, &paper, &ours);
            }
        }
        Ok(())
    }

    /// Ours, behind as many walls as there are; estimates at each sighting.
    fn polar<const S: usize, const N: usize>(
        &mut self,
        course: &Course,
        sightings: &[Sighting],
        rho: [f64; 2],
        speed_mps: f64,
    ) -> Result<Vec<Option<Estimate>>, ConfigError> {
        let config = polar::Config {
            inverse_range_per_m: rho[0] as f32,
            inverse_range_sigma_per_m: rho[1] as f32,
            outlier_rate: 0.0,
            odometry_m2_per_s: 0.0,
            speed_sigma_mps: speed_mps as f32,
            acceleration_m2_per_s3: ACCELERATION_M2_PER_S3 as f32,
            ..polar::Config::DEFAULT
        };
        let lines = std::array::from_fn(|k| course.walls[k].to_core());
        let known = Known::<N> { filter: config.build()?, lines };
        let mut state = polar::State::<S>::new();
        let places = follow(&mut self.ours, course, sightings, None, |sighting| {
            let heard = known.step(&mut state, sighting);
            (heard, known.estimate(&state, sighting.place_ned_m))
        });
        self.ours.nees.add(polar_nees(&state, course.polar_truth()) as f32, S as u32);
        Ok(places)
    }

    /// A source of constant velocity, drawn from the prior, in sight or off a wall; the paper's filters know no such source.
    pub(super) fn moving(&mut self, behind: bool) -> Result<(), ConfigError> {
        self.has_paper = !behind;
        let filter = cartesian::Config::DEFAULT.build()?;
        let mut run = 0;
        while run < self.runs {
            let walls = if behind { vec![draw_slanted(&mut self.random)] } else { Vec::new() };
            let ([range_m, sigma_m], towards) = draw_range(MOVING_RHO, &mut self.random);
            // Velocity over range is what the prior is of.
            let ratio = [0, 1].map(|_| SPEED_MPS * MOVING_RHO[0] * self.random.gaussian());
            let velocity = Horizontal { north: range_m * ratio[0], east: range_m * ratio[1] };
            let image = ORIGIN.along(towards, range_m);
            let source = walls.iter().fold(image, |source, wall| wall.mirror(source));
            let velocity = walls.iter().fold(velocity, |v, wall| v.along(wall.normal, -2.0 * wall.normal.dot(v)));
            let Some(course) = Course::moving(walls, source, velocity, ACCELERATION_M2_PER_S3, &mut self.random) else {
                continue;
            };
            run += 1;
            let sightings = course.hear(&mut self.random);
            if behind {
                self.polar::<4, 1>(&course, &sightings, MOVING_RHO, SPEED_MPS)?;
                continue;
            }
            self.polar::<4, 0>(&course, &sightings, MOVING_RHO, SPEED_MPS)?;
            let mut state = cartesian::State::default();
            let guess = around(ORIGIN.along(towards, 1.0 / MOVING_RHO[0]), sigma_m, &mut self.random);
            filter.begin(&mut state, ORIGIN.to_core(), guess.to_core(), sigma_m as f32);
            let at_first = state.estimate();
            follow(&mut self.paper, &course, &sightings, at_first, |sighting| {
                let heard = Ok(filter.step(&mut state, sighting));
                (heard, state.estimate())
            });
        }
        Ok(())
    }

    /// The paper's filter of eq. 8 and ours behind a mirror.
    pub(super) fn known(&mut self, draw: &dyn Fn(&mut Random) -> Wall) -> Result<(), ConfigError> {
        let filter = literal::Config::DEFAULT.build()?;
        let mut run = 0;
        while run < self.runs {
            let wall = draw(&mut self.random);
            let source = draw_before(&[wall], &mut self.random);
            let Some(course) = Course::random(vec![wall], source, &mut self.random) else { continue };
            let sightings = course.hear(&mut self.random);
            let guess = literal::Guess {
                vehicle_ned_m: ORIGIN.to_core(),
                vehicle_sigma_m: 0.01,
                source_ned_m: source.along(Horizontal::from_bearing(anywhere_rad(&mut self.random)), FIG_3_M).to_core(),
                source_sigma_m: (FIG_3_M / std::f64::consts::SQRT_2) as f32,
                slope_intercept: reflected::slope_intercept(&wall.to_core()),
                slope_intercept_sigma: [0.0; 2],
            };
            let mut state = literal::State::default();
            let paper = if filter.begin_known(&mut state, &guess).is_ok() {
                let at_first = state.estimate();
                follow(&mut self.paper, &course, &sightings, at_first, |sighting| {
                    let heard = filter.step(&mut state, sighting);
                    (heard, state.estimate())
                })
            } else {
                self.paper.lost += 1;
                Vec::new()
            };
            let range_m = course.image(0).norm();
            let ours = self.polar::<2, 1>(&course, &sightings, [1.0 / (range_m + FIG_3_M), 0.03], 0.0)?;
            if run == 0 {
                self.figure = Figure::new(&course, &sightings, &paper, &ours);
            }
            run += 1;
        }
        Ok(())
    }

    /// Two known walls; the paper writes eq. 9 "for completeness" and has no filter of it.
    pub(super) fn corner(&mut self) -> Result<(), ConfigError> {
        self.has_paper = false;
        let mut run = 0;
        while run < self.runs {
            let first = Wall::new(anywhere_rad(&mut self.random), uniform(&mut self.random, 6.0, 12.0));
            let turned = first.normal.bearing_rad() + std::f64::consts::FRAC_PI_2;
            let walls = vec![first, Wall::new(turned, uniform(&mut self.random, 6.0, 12.0))];
            let source = draw_before(&walls, &mut self.random);
            let Some(course) = Course::random(walls, source, &mut self.random) else { continue };
            // Only robots that the ray reaches by this reflection.
            let lines = [0, 1].map(|k| course.walls[k].to_core());
            let reached = |k: usize| {
                let ends = [source, course.robot[k]].map(Horizontal::to_core);
                foxhound_papers::filters::reflected::fold::points(&lines, ends[0], ends[1]).is_ok()
            };
            if !(0..SIGHTINGS).all(reached) {
                continue;
            }
            run += 1;
            let sightings = course.hear(&mut self.random);
            let range_m = course.image(0).norm();
            self.polar::<2, 2>(&course, &sightings, [1.0 / (range_m + FIG_3_M), 0.03], 0.0)?;
        }
        Ok(())
    }
}

/// Gives a filter the measurements, and gathers its errors; its NEES too, when it began with a place.
fn follow(
    gathered: &mut Gathered,
    course: &Course,
    sightings: &[Sighting],
    at_first: Option<Estimate>,
    mut step: impl FnMut(&Sighting) -> (Result<Update, Degenerate>, Option<Estimate>),
) -> Vec<Option<Estimate>> {
    let mut found_its_way = true;
    let mut places = Vec::with_capacity(sightings.len());
    for (k, sighting) in sightings.iter().enumerate() {
        let (heard, estimate) = step(sighting);
        found_its_way &= gathered.heard(heard);
        let shown = if k == 0 { at_first.or(estimate) } else { estimate };
        let error_m = shown.map_or(f64::INFINITY, |shown| from_core(shown.place_ned_m).minus(course.source[k]).norm());
        gathered.at(k, error_m);
        places.push(shown);
    }
    let last = sightings.len() - 1;
    gathered.lost += usize::from(!found_its_way);
    gathered.errors_m.push(gathered.over_time_m[last].last().copied().unwrap_or(f64::INFINITY));
    if let (Some(estimate), Some(_)) = (places[last], at_first) {
        let off = from_core(estimate.place_ned_m).minus(course.source[last]);
        let [nn, ne, ee] = estimate.covariance_m2.map(f64::from);
        gathered.nees.add(nees([off.north, off.east], [[nn, ne], [ne, ee]]) as f32, 2);
    }
    places
}
