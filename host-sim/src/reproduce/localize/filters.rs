//! How well filters localize: fig. 2 and 3 of the mmWave paper, and what it leaves out.
//!
//! The robot moves at random along both axes, up to the paper's control limit of 1 m, and hears the source with 0.05 rad at
//! each of 200 places. The paper shows one run a figure and prints neither its map nor its covariances; here each row is
//! many runs, on geometries drawn anew, sources 10-30 m away.
//!
//! - `los_fig_2`: line of sight, 40 m initial error. The paper's filter begins with a guess that is 40 m off in any
//!   direction, with a covariance that says so. Ours takes the direction from the first bearing; its range is 40 m off.
//! - `los_prior`, `los_leg`, `los_moving`: truths drawn from our filter's prior, which is when consistency means something:
//!   random motions; 6 m of a straight leg of about 12 m; a source of nearly constant velocity, which the paper's filter
//!   does not know.
//! - `nlos_fig_3`: first-order reflection off a known wall, 10 m initial error, and the same off a wall that is vertical in
//!   the paper's frame, off two walls of a corner, and from a moving source.
//! - `nlos_unknown`: the wall is not known, but guessed 20 % off: the source by 20 % of its distance along each axis, the
//!   wall's distance by 20 %, its slope by 20 % of one, which is 0.1 rad. A run has converged when the image's place is
//!   known to 10 % of its distance, which is all that bearings tell, and the source is nearer than the guess was, or within
//!   3 m, to which the paper's own filter comes with the wall known. All walls with all the sources that they mirror into
//!   one image sound alike, so the rest of the error is the guess's.
//!
//! Normalised innovations (NIS) are gathered over all sightings, normalised errors (NEES) at the ends of runs, each with the
//! band in which 95 % of the means of a consistent filter are.

use std::fmt::Write as _;

use foxhound_core::ConfigError;
use foxhound_core::source::consistency::{Consistency, Verdict};
use foxhound_core::source::reflected::{Degenerate, Known, Unknown, literal, unknown};
use foxhound_core::source::{Estimate, Heard, Sighting, cartesian, polar};
use serde::Serialize;

use crate::flight::from_core;
use crate::input::InputError;
use crate::random::Random;
use crate::world::Horizontal;

mod picture;
mod trial;

use trial::{Course, Gathered, ORIGIN, SIGHTINGS, Wall, anywhere_rad, nees, polar_nees, uniform};

/// Runs of each experiment.
pub const RUNS: usize = 200;
/// Initial errors of fig. 2 and 3, and the error that the paper's fig. 3 ends with.
const FIG_2_M: f64 = 40.0;
const FIG_3_M: f64 = 10.0;
const PAPER_FIG_3_M: f64 = 3.0;
/// How far off the guess of an unknown wall is.
const GUESS: f64 = 0.2;
/// The slope of a wall at 45 deg, 20 % off.
const GUESS_RAD: f64 = 0.1;
/// Prior of the drawn truths.
const PRIOR_RHO: [f64; 2] = [1.0 / 15.0, 0.01];
/// The leg's: about 12 m.
const LEG_RHO: [f64; 2] = [0.08, 0.006];
/// The moving source's, its speed along each axis, and the white acceleration that pushes it.
const MOVING_RHO: [f64; 2] = [0.05, 0.003];
const SPEED_MPS: f64 = 0.1;
const ACCELERATION_M2_PER_S3: f64 = 1e-6;

/// The experiment's result.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// `localize-filters`.
    pub experiment: &'static str,
    /// Runs of each experiment.
    pub runs: usize,
    /// One for each experiment.
    pub rows: Vec<Row>,
    #[serde(skip)]
    figures: [picture::Figure; 2],
}

/// One experiment.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Its name.
    pub name: &'static str,
    /// The same for people.
    pub label: &'static str,
    /// What the paper's filter, as printed, makes of it; none where it has none.
    pub paper: Option<Outcome>,
    /// What ours does.
    pub ours: Outcome,
}

/// Many runs of a filter.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Median error of the source's place at the first sighting.
    pub initial_m: f64,
    /// At the end.
    pub median_m: f64,
    /// Nine of ten runs end with less.
    pub p90_m: f64,
    /// Share of the runs that converged; of unknown walls only.
    pub converged: Option<f64>,
    /// Runs that lost their way.
    pub lost: usize,
    /// Normalised innovations squared: one on average.
    pub nis: Normalised,
    /// Normalised errors squared at the end: as many as states on average.
    pub nees: Normalised,
}

/// The mean of normalised squares.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Normalised {
    /// The mean.
    pub mean: f64,
    /// Where 95 % of the means of a consistent filter are.
    pub band: [f64; 2],
    /// What that says.
    pub verdict: Verdict,
}

impl From<Consistency> for Normalised {
    fn from(gathered: Consistency) -> Self {
        Self { mean: f64::from(gathered.mean()), band: gathered.band().map(f64::from), verdict: gathered.verdict() }
    }
}

impl Outcome {
    fn new(gathered: &Gathered, judged: bool) -> Self {
        let share = |values: &[f64], share: f64| {
            let mut sorted = values.to_vec();
            sorted.sort_by(f64::total_cmp);
            let index = libm::ceil(share * sorted.len() as f64) as usize;
            sorted.get(index.saturating_sub(1)).copied().unwrap_or(f64::INFINITY)
        };
        Self {
            initial_m: share(&gathered.initial_m, 0.5),
            median_m: share(&gathered.errors_m, 0.5),
            p90_m: share(&gathered.errors_m, 0.9),
            converged: judged.then(|| gathered.converged as f64 / gathered.errors_m.len() as f64),
            lost: gathered.lost,
            nis: gathered.nis.into(),
            nees: gathered.nees.into(),
        }
    }
}

/// Runs the experiments.
///
/// # Errors
/// None that the built-in configuration could cause.
pub fn run(seed: u64) -> Result<Report, InputError> {
    run_with(seed, RUNS)
}

fn run_with(seed: u64, runs: usize) -> Result<Report, InputError> {
    let mut rows = Vec::new();
    let mut figures = [picture::Figure::default(), picture::Figure::default()];

    let mut stage = Stage::new(seed, 1, runs);
    stage.line_of_sight(draw_fig_2)?;
    figures[0] = stage.figure("line of sight (fig. 2)");
    rows.push(stage.row("los_fig_2", "line of sight, 40 m off (fig. 2)", false));

    let mut stage = Stage::new(seed, 2, runs);
    stage.line_of_sight(|random| draw_prior(PRIOR_RHO, random))?;
    rows.push(stage.row("los_prior", "line of sight, drawn from the prior", false));

    let mut stage = Stage::new(seed, 3, runs);
    stage.line_of_sight(|random| draw_leg(LEG_RHO, random))?;
    rows.push(stage.row("los_leg", "line of sight, 6 m of a straight leg", false));

    let mut stage = Stage::new(seed, 4, runs);
    stage.moving(false)?;
    rows.push(stage.row("los_moving", "line of sight, moving source", false));

    let mut stage = Stage::new(seed, 5, runs);
    stage.known(&draw_slanted)?;
    figures[1] = stage.figure("one wall, known (fig. 3)");
    rows.push(stage.row("nlos_fig_3", "one wall, known, 10 m off (fig. 3)", false));

    let mut stage = Stage::new(seed, 6, runs);
    stage.known(&draw_vertical)?;
    rows.push(stage.row("nlos_vertical", "the same, a vertical wall", false));

    let mut stage = Stage::new(seed, 7, runs);
    stage.corner()?;
    rows.push(stage.row("nlos_corner", "two walls, known, 10 m off", false));

    let mut stage = Stage::new(seed, 8, runs);
    stage.moving(true)?;
    rows.push(stage.row("nlos_moving", "one wall, known, moving source", false));

    let mut stage = Stage::new(seed, 9, runs);
    stage.unknown(&draw_slanted)?;
    rows.push(stage.row("nlos_unknown", "one wall, 20 % off", true));

    let mut stage = Stage::new(seed, 10, runs);
    stage.unknown(&draw_vertical)?;
    rows.push(stage.row("nlos_unknown_vertical", "the same, a vertical wall", true));

    Ok(Report { experiment: "localize-filters", runs, rows, figures })
}

/// A course and the prior of its inverse range; how the paper's filter begins.
struct Scene {
    course: Course,
    rho: [f64; 2],
    guess: Horizontal,
    guess_sigma_m: f64,
}

/// 40 m off, in any direction or in range.
fn draw_fig_2(random: &mut Random) -> Scene {
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
fn draw_range([rho, sigma]: [f64; 2], random: &mut Random) -> ([f64; 2], Horizontal) {
    loop {
        let drawn = rho + sigma * random.gaussian();
        if drawn > 0.4 * rho {
            let towards = Horizontal::from_bearing(anywhere_rad(random));
            return ([1.0 / drawn, sigma / (rho * rho)], towards);
        }
    }
}

fn draw_prior(rho: [f64; 2], random: &mut Random) -> Scene {
    loop {
        let ([range_m, guess_sigma_m], towards) = draw_range(rho, random);
        let source = ORIGIN.along(towards, range_m);
        let guess = around(ORIGIN.along(towards, 1.0 / rho[0]), guess_sigma_m, random);
        if let Some(course) = Course::random(Vec::new(), source, random) {
            return Scene { course, rho, guess, guess_sigma_m };
        }
    }
}

fn draw_leg(leg: [f64; 2], random: &mut Random) -> Scene {
    loop {
        let ([range_m, guess_sigma_m], towards) = draw_range(leg, random);
        if range_m > 8.0 {
            let guess = around(ORIGIN.along(towards, 1.0 / leg[0]), guess_sigma_m, random);
            let course = Course::straight(ORIGIN.along(towards, range_m), 6.0);
            return Scene { course, rho: leg, guess, guess_sigma_m };
        }
    }
}

fn around(place: Horizontal, sigma_m: f64, random: &mut Random) -> Horizontal {
    place
        .along(Horizontal { north: 1.0, east: 0.0 }, sigma_m * random.gaussian())
        .along(Horizontal { north: 0.0, east: 1.0 }, sigma_m * random.gaussian())
}

/// A wall with a slope: its normal is within 60 deg of the paper's y axis.
fn draw_slanted(random: &mut Random) -> Wall {
    let side = if random.uniform() < 0.5 { 0.0 } else { std::f64::consts::PI };
    Wall::new(side + uniform(random, -60.0, 60.0).to_radians(), uniform(random, 6.0, 12.0))
}

/// A wall without one.
fn draw_vertical(random: &mut Random) -> Wall {
    let side = if random.uniform() < 0.5 { -0.5 } else { 0.5 };
    Wall::new(side * std::f64::consts::PI, uniform(random, 6.0, 12.0))
}

/// A source in front of these walls.
fn draw_before(walls: &[Wall], random: &mut Random) -> Horizontal {
    loop {
        let towards = Horizontal::from_bearing(anywhere_rad(random));
        let source = ORIGIN.along(towards, uniform(random, 5.0, 15.0));
        if walls.iter().all(|wall| wall.clearance_m(source) > 2.0) {
            return source;
        }
    }
}

/// One experiment with both filters.
struct Stage {
    random: Random,
    runs: usize,
    paper: Gathered,
    ours: Gathered,
    has_paper: bool,
    figure: picture::Figure,
}

impl Stage {
    fn new(seed: u64, purpose: u64, runs: usize) -> Self {
        Self {
            random: Random::new(seed, 0x10ca_0000 + purpose),
            runs,
            paper: Gathered::default(),
            ours: Gathered::default(),
            has_paper: true,
            figure: picture::Figure::default(),
        }
    }

    fn row(&self, name: &'static str, label: &'static str, judged: bool) -> Row {
        let paper = self.has_paper.then(|| Outcome::new(&self.paper, judged));
        Row { name, label, paper, ours: Outcome::new(&self.ours, judged) }
    }

    fn figure(&mut self, title: &str) -> picture::Figure {
        let mut figure = std::mem::take(&mut self.figure);
        title.clone_into(&mut figure.title);
        figure.medians(&self.paper, &self.ours);
        figure
    }

    /// The paper's Cartesian filter and the polar one.
    fn line_of_sight(&mut self, draw: impl Fn(&mut Random) -> Scene) -> Result<(), ConfigError> {
        let filter = cartesian::Config::default().build()?;
        for run in 0..self.runs {
            let scene = draw(&mut self.random);
            let course = &scene.course;
            let sightings = course.hear(&mut self.random);
            let mut state = cartesian::State::new();
            filter.begin(&mut state, ORIGIN.to_core(), scene.guess.to_core(), scene.guess_sigma_m as f32);
            let at_first = state.estimate();
            let paper = follow(&mut self.paper, course, &sightings, at_first, |sighting| {
                let heard = Ok(filter.step(&mut state, sighting));
                (heard, state.estimate())
            });
            let ours = self.polar::<2, 0>(course, &sightings, scene.rho, 0.0)?;
            if run == 0 {
                self.figure = picture::Figure::new(course, &sightings, &paper, &ours);
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
    fn moving(&mut self, behind: bool) -> Result<(), ConfigError> {
        self.has_paper = !behind;
        let filter = cartesian::Config::default().build()?;
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
            let mut state = cartesian::State::new();
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
    fn known(&mut self, draw: &dyn Fn(&mut Random) -> Wall) -> Result<(), ConfigError> {
        let filter = literal::Config::default().build()?;
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
                slope_intercept: wall.to_core().slope_intercept(),
                slope_intercept_sigma: [0.0; 2],
            };
            let mut state = literal::State::new();
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
                self.figure = picture::Figure::new(&course, &sightings, &paper, &ours);
            }
            run += 1;
        }
        Ok(())
    }

    /// Two known walls; the paper writes eq. 9 "for completeness" and has no filter of it.
    fn corner(&mut self) -> Result<(), ConfigError> {
        self.has_paper = false;
        let mut run = 0;
        while run < self.runs {
            let first = Wall::new(anywhere_rad(&mut self.random), uniform(&mut self.random, 6.0, 12.0));
            let turned = first.normal.bearing_rad() + std::f64::consts::FRAC_PI_2;
            let walls = vec![first, Wall::new(turned, uniform(&mut self.random, 6.0, 12.0))];
            let source = draw_before(&walls, &mut self.random);
            let Some(course) = Course::random(walls, source, &mut self.random) else { continue };
            // Only robots that the ray takes this way to.
            let lines = [0, 1].map(|k| course.walls[k].to_core());
            let reached = |k: usize| {
                let ends = [source, course.robot[k]].map(Horizontal::to_core);
                foxhound_core::source::reflected::fold::points(&lines, ends[0], ends[1]).is_ok()
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

    /// The paper's filter of `(p, m, c)` and ours of image and line, from one guess.
    fn unknown(&mut self, draw: &dyn Fn(&mut Random) -> Wall) -> Result<(), ConfigError> {
        let paper = literal::Config::default().build()?;
        let ours = unknown::Config {
            outlier_rate: 0.0,
            odometry_m2_per_s: 0.0,
            angle_rad2_per_s: 0.0,
            offset_m2_per_s: 0.0,
            ..unknown::Config::DEFAULT
        };
        let ours = ours.build()?;
        let mut run = 0;
        while run < self.runs {
            let wall = draw(&mut self.random);
            let source = draw_before(&[wall], &mut self.random);
            let source_sigma_m = GUESS * source.norm();
            let offset_sigma_m = GUESS * wall.offset_m;
            let guessed_wall = Wall::new(
                wall.normal.bearing_rad() + GUESS_RAD * self.random.gaussian(),
                wall.offset_m + offset_sigma_m * self.random.gaussian(),
            );
            let guessed = around(source, source_sigma_m, &mut self.random);
            // A guess says at least that source and robot are on one side of the wall.
            if guessed_wall.clearance_m(guessed) < 0.5 || guessed_wall.offset_m < 0.5 {
                continue;
            }
            let Some(course) = Course::random(vec![wall], source, &mut self.random) else { continue };
            run += 1;
            let sightings = course.hear(&mut self.random);
            let line = guessed_wall.to_core();
            let initial_m = guessed.minus(source).norm();

            let guess = unknown::Guess {
                vehicle_ned_m: ORIGIN.to_core(),
                source_ned_m: guessed.to_core(),
                source_sigma_m: source_sigma_m as f32,
                line,
                angle_sigma_rad: GUESS_RAD as f32,
                offset_sigma_m: offset_sigma_m as f32,
            };
            self.follow_unknown(&ours, &guess, &course, &sightings, initial_m);

            let [m, c] = line.slope_intercept();
            let stretch = libm::hypot(1.0, f64::from(m));
            let lever_m = libm::hypot(offset_sigma_m, GUESS_RAD * guessed.norm());
            let guess = literal::Guess {
                vehicle_ned_m: guess.vehicle_ned_m,
                vehicle_sigma_m: 0.01,
                source_ned_m: guess.source_ned_m,
                source_sigma_m: guess.source_sigma_m,
                slope_intercept: [m, c],
                slope_intercept_sigma: [(GUESS_RAD * stretch * stretch) as f32, (lever_m * stretch) as f32],
            };
            let mut state = literal::State::new();
            if paper.begin_unknown(&mut state, &guess).is_err() {
                self.paper.lost += 1;
                continue;
            }
            let at_first = state.estimate();
            let places = follow(&mut self.paper, &course, &sightings, at_first, |sighting| {
                let heard = paper.step(&mut state, sighting);
                (heard, state.estimate())
            });
            let line = foxhound_core::lor::Line::of_slope_intercept(state.slope_intercept());
            let image = places.last().copied().flatten().map(|estimate| line.mirror(estimate.place_ned_m));
            self.paper.judge(&course, image.map(from_core), initial_m);
        }
        Ok(())
    }

    fn follow_unknown(
        &mut self,
        filter: &Unknown,
        guess: &unknown::Guess,
        course: &Course,
        sightings: &[Sighting],
        initial_m: f64,
    ) {
        let mut state = unknown::State::new();
        if filter.begin(&mut state, guess).is_err() {
            self.ours.lost += 1;
            return;
        }
        let at_first = state.estimate();
        follow(&mut self.ours, course, sightings, at_first, |sighting| {
            let heard = filter.step(&mut state, sighting);
            (heard, state.estimate())
        });
        let image = state.image().map(|image| from_core(image.place_ned_m));
        self.ours.judge(course, image, initial_m);
    }
}

impl Gathered {
    /// Whether the last run has converged: the image is known, and the source not worse than before.
    fn judge(&mut self, course: &Course, image: Option<Horizontal>, initial_m: f64) {
        let last = course.robot.len() - 1;
        let truth = course.image(last);
        let range_m = truth.minus(course.robot[last]).norm();
        let error_m = self.errors_m.last().copied().unwrap_or(f64::INFINITY);
        let image_found = image.is_some_and(|image| image.minus(truth).norm() < 0.1 * range_m);
        self.converged += usize::from(image_found && (error_m < initial_m || error_m < PAPER_FIG_3_M));
    }
}

/// Gives a filter what is heard, and gathers how it fares; its NEES too, when it began with a place.
fn follow(
    gathered: &mut Gathered,
    course: &Course,
    sightings: &[Sighting],
    at_first: Option<Estimate>,
    mut step: impl FnMut(&Sighting) -> (Result<Heard, Degenerate>, Option<Estimate>),
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

impl Report {
    /// The rows for people.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text =
            format!("Error of the source's place after {SIGHTINGS} bearings of 0.05 rad, {} runs each\n\n", self.runs);
        let _ = writeln!(
            text,
            "{:<38}{:<8}{:>7}{:>8}{:>8}{:>6}{:>6}  {:<28}{:<28}",
            "", "filter", "first", "median", "90 %", "conv.", "lost", "NIS (95 % band)", "NEES (95 % band)"
        );
        for row in &self.rows {
            let both = [row.paper.as_ref().map(|paper| ("paper", paper)), Some(("ours", &row.ours))];
            let mut label = row.label;
            for (filter, outcome) in both.into_iter().flatten() {
                let converged =
                    outcome.converged.map_or_else(|| "-".to_owned(), |share| format!("{:.0} %", 100.0 * share));
                let metres = [outcome.initial_m, outcome.median_m, outcome.p90_m].map(metres);
                let _ = writeln!(
                    text,
                    "{label:<38}{filter:<8}{:>7}{:>8}{:>8}{converged:>6}{:>6}  {:<28}{:<28}",
                    metres[0],
                    metres[1],
                    metres[2],
                    outcome.lost,
                    outcome.nis.written(),
                    outcome.nees.written()
                );
                label = "";
            }
        }
        text
    }
}

fn metres(value: f64) -> String {
    if value.is_finite() { format!("{value:.2} m") } else { "-".to_owned() }
}

impl Normalised {
    fn written(&self) -> String {
        let [low, high] = self.band;
        let verdict = match self.verdict {
            Verdict::Consistent => "",
            Verdict::Optimistic => " optim.",
            Verdict::Pessimistic => " pessim.",
            Verdict::TooFew => return "-".to_owned(),
        };
        let mean = if self.mean < 100.0 { format!("{:.3}", self.mean) } else { format!("{:.0}", self.mean) };
        format!("{mean} ({low:.3}..{high:.3}){verdict}")
    }
}

#[cfg(test)]
mod tests;
