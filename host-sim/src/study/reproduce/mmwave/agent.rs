//! The agents that search for the transmitter: each gives goals to the navigation that all share.

use foxhound_core::ConfigError;
use foxhound_core::localize::source::Sighting;
use foxhound_core::localize::source::bank::{self, Answer, FilterBank, Path};
use foxhound_core::localize::source::polar;
use foxhound_core::mapping::walls::{self, Extractor, Wall};
use serde::Serialize;

use super::bend::Bend;
use super::cycle::{PERIOD, View};
use super::explore::Explorer;
use super::known::{CELL_M, Index, RANGE_M};
use super::radio::Link;
use super::walls::Walls;
use crate::world::{Horizontal, from_core};

/// Which agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Knows where the transmitter is.
    Reference,
    /// Follows the raw angle of arrival of the direct wave and of first reflections, as the published code of [11] does.
    Follow,
    /// Goes where the filters say; explores at higher orders, as the paper does.
    Switch,
    /// Ours: goes from point of reflection to point of reflection at higher orders too.
    Estimate,
    /// Ours, on paths on which bearings tell more: with covariance minimisation.
    Belief,
}

impl Kind {
    /// All, in the order of the tables.
    pub(super) const ALL: [Self; 5] = [Self::Reference, Self::Follow, Self::Switch, Self::Estimate, Self::Belief];

    /// The name in tables.
    pub(super) fn label(self) -> &'static str {
        match self {
            Self::Reference => "transmitter known",
            Self::Follow => "AoA [11]",
            Self::Switch => "EKF, paper's switch, T = 0",
            Self::Estimate => "Foxhound, T = 0",
            Self::Belief => "Foxhound, T = 50",
        }
    }
}

/// How the published code of [11] follows: the target is so far ahead,
pub(super) const OFFSET_M: f64 = 0.6;
/// and when the same place is visited so often, it explores
const VISITS_MAX: u32 = 15;
/// for so many periods at first, and each time for more.
const EXPLORED_PERIODS: [u32; 2] = [5, 3];

/// Counts visits, and says when the robot had better explore.
#[derive(Clone, Debug)]
struct Patience {
    visits: Vec<(Index, u32)>,
    periods: u32,
    cycles_left: u32,
}

impl Patience {
    fn new() -> Self {
        Self { visits: Vec::new(), periods: EXPLORED_PERIODS[0], cycles_left: 0 }
    }

    fn is_over(&mut self, at: Index) -> bool {
        if self.cycles_left > 0 {
            self.cycles_left -= 1;
            return true;
        }
        let visits = match self.visits.iter_mut().find(|(index, _)| *index == at) {
            Some((_, visits)) => {
                *visits += 1;
                *visits
            }
            None => {
                self.visits.push((at, 1));
                1
            }
        };
        if visits >= VISITS_MAX {
            self.visits.clear();
            self.cycles_left = self.periods * PERIOD;
            self.periods += EXPLORED_PERIODS[1];
        }
        visits >= VISITS_MAX
    }
}

/// An agent.
pub(super) struct Agent {
    kind: Kind,
    explorer: Explorer,
    patience: Patience,
    transmitter: Horizontal,
    target: Option<(Horizontal, u32)>,
    seeker: Seeker,
    bend: Option<Bend>,
}

impl Agent {
    /// An agent; only the reference looks at `transmitter`. `sigma_rad` is the noise of the angle of arrival.
    ///
    /// # Errors
    /// None that the built-in configuration could cause.
    pub(super) fn new(kind: Kind, transmitter: Horizontal, sigma_rad: f64, seed: u64) -> Result<Self, ConfigError> {
        let seeker = Seeker::new(sigma_rad, kind != Kind::Switch)?;
        let bend = if kind == Kind::Belief { Some(Bend::new(sigma_rad)?) } else { None };
        let (explorer, patience) = (Explorer::new(seed)?, Patience::new());
        Ok(Self { kind, explorer, patience, transmitter, target: None, seeker, bend })
    }

    /// Where to go; `None` to stay.
    pub(super) fn decide(&mut self, view: &View<'_>) -> Option<Horizontal> {
        if self.kind == Kind::Reference {
            return Some(self.transmitter);
        }
        if self.kind != Kind::Follow && self.seeker.listens(view) {
            return None;
        }
        let is_stuck = self.patience.is_over(view.known.index(view.place));
        let goal = match self.kind {
            Kind::Follow => self.follow(view),
            _ => self.seeker.goal(view),
        };
        match goal.filter(|_| !is_stuck) {
            Some(goal) => Some(match (&mut self.bend, &self.seeker.heard) {
                (Some(bend), Some(answer)) => bend.towards(view, goal, answer),
                _ => goal,
            }),
            None => self.explorer.target(view.known, view.place, view.cycle),
        }
    }

    /// A target ahead along the angle of arrival, until it is reached or the period is over.
    fn follow(&mut self, view: &View<'_>) -> Option<Horizontal> {
        let kept = self.target.filter(|(target, age)| *age < PERIOD && target.minus(view.place).norm() > CELL_M);
        let is_usable = matches!(view.link, Link::LineOfSight | Link::FirstOrder);
        let ahead = || (view.place.along(Horizontal::from_bearing(view.bearing_rad), OFFSET_M), 0);
        self.target = None;
        let (target, age) = kept.or_else(|| is_usable.then(ahead))?;
        self.target = Some((target, age + 1));
        Some(target)
    }

    /// There is no path to its goal.
    pub(super) fn blocked(&mut self) {
        self.explorer.blocked();
    }
}

/// The filters, and what to make of them.
struct Seeker {
    /// Whether higher orders are followed from point of reflection to point of reflection.
    climbs: bool,
    bank: FilterBank,
    /// What is received directly, by one reflection, and by more.
    ears: [Ear; 3],
    extractor: Extractor,
    workspace: Box<walls::Workspace>,
    walls: Walls,
    sigma_rad: f64,
    /// The goal, and the order of the link when it was set.
    goal: Option<(Horizontal, usize)>,
    heard: Option<Answer>,
    link: Link,
    listened: u32,
}

/// No bearing is taken to be better: the filters' model of a wall is not.
const SIGMA_MIN_RAD: f64 = 0.03;
/// A goal that is reached without the transmitter coming into sight was wrong.
const REACHED_M: f64 = 0.6;
/// Farthest that a goal is from the point of reflection.
const OFF_LINE_M: f64 = 2.5;
/// While the bearing is known no better than this, it stays to measure more,
const LISTEN_RAD: f64 = 0.14;
/// but not for more cycles.
const LISTEN_CYCLES: u32 = 8;
/// Sightings in a row that no filter explains, before all start again.
const UNEXPLAINED_MAX: u32 = 2;
/// How far ahead to go where no line is known.
const LOOK_M: f64 = 5.0;
/// No goal is farther away,
const FAR_M: f64 = 20.0;
/// and none farther than the above whose range is not known to this part of it.
const RANGE_KNOWN: f32 = 0.4;

impl Seeker {
    fn new(sigma_rad: f64, climbs: bool) -> Result<Self, ConfigError> {
        let polar =
            polar::Config { inverse_range_per_m: 0.05, inverse_range_sigma_per_m: 0.08, ..bank::Config::DEFAULT.polar };
        let bank = bank::Config { polar, slack_m: 0.2 }.build()?;
        let extractor = walls::Config { length_min_m: 0.8, gap_m: 0.6 };
        Ok(Self {
            climbs,
            bank,
            ears: [Ear::new(), Ear::new(), Ear::new()],
            extractor: extractor.build()?,
            workspace: Box::default(),
            walls: Walls::default(),
            sigma_rad: sigma_rad.max(SIGMA_MIN_RAD),
            goal: None,
            heard: None,
            link: Link::None,
            listened: 0,
        })
    }

    /// How many reflections there are in what is received, if that is of use.
    fn order(&self, link: Link) -> Option<usize> {
        match link {
            Link::LineOfSight => Some(0),
            Link::FirstOrder => Some(1),
            Link::HigherOrder => self.climbs.then_some(2),
            Link::None => None,
        }
    }

    /// Whether to use what is received now: not on the path to where the link was of a lower order.
    fn heeds(&self, order: usize) -> bool {
        self.goal.is_none_or(|(_, of)| order <= of)
    }

    /// Takes in what is seen and received; whether to stay and go on measuring.
    fn listens(&mut self, view: &View<'_>) -> bool {
        let points: Vec<_> = view.scan.iter().step_by(2).map(|point| point.to_core()).collect();
        for line in self.extractor.find(&mut self.workspace, &points) {
            self.walls.add(line);
        }
        if view.link != self.link {
            (self.link, self.listened) = (view.link, 0);
            // The transmitter stays where it is, but the image that is received next may be another one.
            self.ears[1] = Ear::new();
            self.ears[2] = Ear::new();
        }
        self.heard = None;
        let Some(order) = self.order(view.link) else { return false };
        let (reflected, lines) = if order == 0 { (0.0, &[][..]) } else { (0.98, self.walls.lines()) };
        self.heard = self.ears[order].hear(&self.bank, view, self.sigma_rad, reflected, lines);
        self.listened += 1;
        let is_vague = self.heard.is_some_and(|answer| f64::from(answer.estimate.bearing_sigma_rad) > LISTEN_RAD);
        is_vague && self.listened <= LISTEN_CYCLES && self.heeds(order)
    }

    fn goal(&mut self, view: &View<'_>) -> Option<Horizontal> {
        let order = self.order(view.link);
        if let (Some(answer), Some(order)) = (self.heard, order)
            && self.heeds(order)
        {
            let goal = match order {
                0 => in_sight(view, &answer),
                _ => around_the_corner(view, &answer, self.walls.lines()),
            };
            self.goal = Some((goal, order));
        }
        let (goal, _) = self.goal?;
        if order == Some(0) || goal.minus(view.place).norm() > REACHED_M {
            return Some(goal);
        }
        // Nothing there: on along the angle of arrival, as long as it means something.
        self.goal = None;
        let image = image_of(&self.heard?);
        Some(view.place.along(Horizontal::from_bearing(image.minus(view.place).bearing_rad()), OFFSET_M))
    }
}

/// Where a filter takes the wave to come from: the transmitter, or its last image.
fn image_of(answer: &Answer) -> Horizontal {
    let estimate = answer.estimate.place_ned_m;
    from_core(match answer.path {
        Path::Direct => estimate,
        Path::Reflected(line) => line.mirror(estimate),
    })
}

/// A bank of filters, started again when it explains nothing any more.
struct Ear {
    state: bank::State,
    unexplained: u32,
    answer: Option<Answer>,
}

impl Ear {
    fn new() -> Self {
        Self { state: bank::State::new(), unexplained: 0, answer: None }
    }

    fn hear(
        &mut self,
        bank: &FilterBank,
        view: &View<'_>,
        sigma_rad: f64,
        reflected: f32,
        lines: &[Wall],
    ) -> Option<Answer> {
        let sighting = Sighting {
            place_ned_m: view.place.to_core(),
            direction_ned: Horizontal::from_bearing(view.bearing_rad).to_core(),
            sigma_rad: sigma_rad as f32,
            since_s: 1.0,
        };
        self.answer = bank.step(&mut self.state, &sighting, reflected, lines);
        let is_explained = self.answer.is_some_and(|answer| answer.explained);
        self.unexplained = if is_explained { 0 } else { self.unexplained + 1 };
        if self.unexplained >= UNEXPLAINED_MAX {
            self.unexplained = 0;
            self.state = bank::State::new();
            self.answer = bank.step(&mut self.state, &sighting, reflected, lines);
        }
        self.answer
    }
}

/// The source is before the first wall on its bearing. Where a wall is right in front, the bearing is a little off.
fn in_sight(view: &View<'_>, answer: &Answer) -> Horizontal {
    let estimate = &answer.estimate;
    let far_m = if estimate.range_sigma_ratio < RANGE_KNOWN { FAR_M } else { LOOK_M };
    let range_m = f64::from(estimate.range_m).clamp(1.0, far_m);
    let sigma_rad = f64::from(estimate.bearing_sigma_rad).max(0.05);
    let free_m = |turn: f64| {
        let direction = Horizontal::from_bearing(f64::from(estimate.bearing_ned_rad) + turn * sigma_rad);
        let wall_m = view.known.range_to_wall_m(view.place, direction, range_m);
        (direction, wall_m.map_or(range_m, |wall_m| wall_m - 0.3))
    };
    let mut best = free_m(0.0);
    for turn in [-0.5, 0.5, -1.0, 1.0, -1.5, 1.5, -2.0, 2.0] {
        let other = free_m(turn);
        if best.1 < range_m.min(2.0) && other.1 > best.1 + 0.2 {
            best = other;
        }
    }
    view.place.along(best.0, best.1.max(0.5))
}

/// From the point of reflection the source is in sight, and all along the path from there to the source.
fn around_the_corner(view: &View<'_>, answer: &Answer, lines: &[Wall]) -> Horizontal {
    let direction = Horizontal::from_bearing(image_of(answer).minus(view.place).bearing_rad());
    let ahead = |range_m: f64, from: Horizontal, direction: Horizontal| {
        let wall_m = view.known.range_to_wall_m(from, direction, range_m);
        from.along(direction, wall_m.map_or(range_m, |wall_m| (wall_m - 0.3).max(0.0)))
    };
    let Some(wall_m) = view.known.range_to_wall_m(view.place, direction, RANGE_M) else {
        return ahead(LOOK_M, view.place, direction);
    };
    let near = |range_m: &f32| (f64::from(*range_m) - wall_m).abs() < 0.6;
    let met = lines.iter().filter_map(|line| {
        let range_m = line.range_along_m(view.place.to_core(), direction.to_core(), 0.2).filter(near)?;
        Some((line, range_m))
    });
    let Some((line, range_m)) = met.min_by(|a, b| a.1.total_cmp(&b.1)) else {
        return ahead(LOOK_M, view.place, direction);
    };
    let bounce = view.place.along(direction, f64::from(range_m));
    let back = from_core(line.mirror_direction(direction.to_core()));
    // A little off the line, so as not to meet it.
    let off = bounce.along(back, 0.5);
    ahead(OFF_LINE_M - 0.5, off, back)
}
