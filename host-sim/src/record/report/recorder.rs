//! Watches a flight and makes its records.

use foxhound_core::base::ned;
use foxhound_core::base::obstacle::{Disc, Obstacle};
use foxhound_core::guidance;
use foxhound_core::guidance::param::{Id, TABLE, Values};
use foxhound_core::landing as core_landing;
use foxhound_core::mapping::tracks;
use foxhound_core::planning::field;
use foxhound_core::planning::planner::{self, SAMPLES, Verdict, Workspace};
use foxhound_core::planning::rollout::Trajectory;
use foxhound_papers::apf::{self, NAMES};
use serde_json::Value;

use super::picture::Pictures;
use super::record::{
    Bearing, Begin, Belief, End, Field, Gains, Landing, Origin, Parameter, People, Plan, Record, Remembered, Sample,
    Step, Track, Tracks, VERSION, centi, circles, core_xy, degrees, finite, guard, guard_reason, milli, rounded, xy,
};
use super::signal::{self, Signals};
use crate::drive::computer::{Considered, HostComputer};
use crate::drive::flight::{Mission, Moment, Report, TICK_S};
use crate::world::{Horizontal, Pillar};

/// The obstacle map is recorded every so many steps: 5 Hz.
const REMEMBERED_STEPS: u64 = 10;
/// Moving objects are recorded every so many steps: 10 Hz.
const MOVING_STEPS: u64 = 5;
/// What is heard is recorded every so many steps: 5 Hz.
const SIGNAL_STEPS: u64 = 10;
/// Half the side of the raster of the potential, in steps, and the step: a little more than the horizon.
const FIELD_HALF: i32 = 11;
const FIELD_STEP_M: f32 = 0.2;
/// Places with less than this share of the largest weight are left out.
const PLACE_MIN: f32 = 1e-2;

/// Makes the records of a flight.
#[derive(Debug)]
pub struct Recorder {
    config: planner::Config,
    radius_m: f32,
    pictures: Pictures,
    signals: Signals,
    /// Brakes of the guard because the limits of the obstacles contradict one another.
    contradictions: u32,
    /// Time of the first step: a flight with an autopilot waits for it.
    begun_s: Option<f64>,
    steps: u64,
    drawn: Drawn,
    remembered: Vec<[f64; 3]>,
    people: Vec<[f64; 3]>,
    tracks: Vec<Track>,
    records: Vec<Record>,
}

/// The planner's last samples: a plan without samples leaves the earlier ones in place.
type Drawn = Option<([field::Gains; SAMPLES], [Trajectory; SAMPLES])>;

impl Recorder {
    /// Begins with the header: the parameters, and the command that repeats the flight.
    #[must_use]
    pub fn new(mission: &Mission, config: &guidance::Config, values: &Values, command: String) -> Self {
        let planner = config.planner;
        let empty = Workspace::new();
        let mut recorder = Self {
            config: planner,
            radius_m: config.vehicle.radius_m,
            pictures: Pictures::new(config),
            signals: Signals::new(config),
            contradictions: 0,
            begun_s: None,
            steps: 0,
            drawn: Some((empty.gains, empty.samples)),
            remembered: Vec::new(),
            people: Vec::new(),
            tracks: Vec::new(),
            records: Vec::new(),
        };
        recorder.records.push(Record::Begin(Box::new(begin(mission, config, values, command))));
        recorder
    }

    /// Takes a step.
    pub fn watch(&mut self, moment: &Moment<'_>) {
        let time_s = milli(moment.sample.time_s - *self.begun_s.get_or_insert(moment.sample.time_s));
        let contradictions = moment.output.guard_counts.not_converged;
        let contradicts = contradictions != std::mem::replace(&mut self.contradictions, contradictions);
        let guard_reason = guard_reason(moment.output.guard, contradicts);
        let step = step(moment, self.radius_m);
        self.records.push(Record::Step(Step { time_s, guard_reason, ..step }));
        if let Some(frame) = moment.frame.filter(|_| self.steps.is_multiple_of(SIGNAL_STEPS)) {
            self.records.push(Record::Signal(self.signals.signal(time_s, frame)));
        }
        if self.steps.is_multiple_of(REMEMBERED_STEPS) {
            let inside = moment.computer.inside();
            let circles_m = circles(inside.into_iter().flat_map(|one| one.state().map().circles()).map(Disc::from));
            if circles_m != self.remembered {
                self.remembered.clone_from(&circles_m);
                self.records.push(Record::Remembered(Remembered { time_s, circles_m }));
            }
        }
        if self.steps.is_multiple_of(MOVING_STEPS) {
            self.watch_moving(moment, time_s);
        }
        if let Some(shown) = moment.picture {
            self.records.extend(self.pictures.picture(time_s, shown).map(Record::Picture));
        }
        if let Some(considered) = moment.computer.inside().and_then(HostComputer::considered) {
            let drawn = Some((considered.workspace.gains, considered.workspace.samples));
            let draws = drawn != self.drawn;
            self.drawn = drawn;
            let trace = format!("{:016x}", moment.output.trace_hash);
            let plan = Plan { time_s, trace, ..plan((&self.config, self.radius_m), &considered, draws) };
            self.records.push(Record::Plan(Box::new(plan)));
        }
        self.steps += 1;
    }

    /// Records people and tracks, if they have changed.
    fn watch_moving(&mut self, moment: &Moment<'_>, time_s: f64) {
        let one = |pillar: Pillar| {
            let [x, y] = xy(pillar.center);
            [x, y, milli(pillar.radius_m)]
        };
        let circles_m: Vec<[f64; 3]> = moment.world.people_at(moment.sample.time_s).map(one).collect();
        if circles_m != self.people {
            self.people.clone_from(&circles_m);
            self.records.push(Record::People(People { time_s, circles_m }));
        }
        let known = moment.computer.inside().into_iter().flat_map(|one| one.state().tracks().all());
        let tracks: Vec<Track> = known.filter(|body| body.moves()).map(track).collect();
        if tracks != self.tracks || self.steps == 0 {
            self.tracks.clone_from(&tracks);
            self.records.push(Record::Tracks(Tracks { time_s, tracks }));
        }
    }

    /// Ends with the result of the flight.
    pub fn end(&mut self, report: &Report) {
        let steps = self.steps;
        self.records.push(Record::End(End { report: report.clone(), steps }));
    }

    /// Removes the records since the last call.
    pub fn take(&mut self) -> Vec<Record> {
        std::mem::take(&mut self.records)
    }
}

fn begin(mission: &Mission, config: &guidance::Config, values: &Values, command: String) -> Begin {
    let is_it = |name: &&str| apf::named(name) == Some(mission.planner);
    let number = |value: f32| finite(value).map_or(Value::Null, Value::from);
    let parameters = TABLE.iter().zip(Id::all()).map(|(row, id)| Parameter {
        name: row.name,
        value: number(values.get(id)),
        default: number(row.default),
        unit: row.unit,
        what: row.doc,
    });
    let scenario = &mission.scenario;
    let world = scenario.world();
    let beacon_height_m = milli(-world.source_down_m);
    let walls = world.pillars.into_iter().skip(scenario.obstacles.len()).map(|pillar| {
        let [x, y] = xy(pillar.center);
        [x, y, milli(pillar.radius_m)]
    });
    Begin {
        version: VERSION,
        program: env!("CARGO_PKG_VERSION"),
        command,
        seed: mission.seed,
        planner: NAMES.into_iter().find(is_it).unwrap_or("of its own"),
        tick_s: TICK_S,
        gains: gains(&config.planner.gains),
        horizon_m: rounded(f64::from(planner::HORIZON_M), 3),
        margins_m: [config.planner.margin_m, config.planner.tight_margin_m].map(|m| milli(f64::from(m))),
        speed_max_mps: milli(f64::from(config.guard.v_max_mps)),
        beacon_height_m,
        bin_hz: signal::bin_hz(config),
        walls: walls.collect(),
        scenario: scenario.clone(),
        parameters: parameters.collect(),
    }
}

/// A step, without its time and the guard's reason.
fn step(moment: &Moment<'_>, radius_m: f32) -> Step {
    let Moment { world, motion, sample, output, computer, knows_source, .. } = moment;
    let to_source = knows_source.then(|| world.source_at(sample.time_s).minus(sample.position));
    let clearance =
        |pillar: Pillar| pillar.center.minus(sample.position).norm() - pillar.radius_m - f64::from(radius_m);
    let [north, east, down_mps] = motion.velocity_ned_mps;
    let heard = output.bearing.map(|bearing| Bearing {
        valid: bearing.valid && bearing.azimuth_rad.is_finite(),
        bearing_deg: output.bearing_ned_rad.filter(|rad| rad.is_finite()).map(|rad| degrees(f64::from(rad))),
        sigma_deg: degrees(f64::from(bearing.sigma_rad)),
        // Exactly zero is that of a radio that tells angles only.
        snr_db: Some(f64::from(bearing.quality.snr_db))
            .filter(|snr_db| *snr_db != 0.0)
            .map(|snr_db| rounded(snr_db, 1)),
        flags: bearing.flags.names().collect(),
    });
    Step {
        time_s: 0.0,
        place_m: xy(sample.position),
        height_m: milli(-sample.down_m),
        yaw_deg: degrees(sample.yaw_rad),
        velocity_mps: xy(Horizontal { north, east }).map(centi),
        climb_mps: centi(-down_mps),
        setpoint_mps: core_xy(output.setpoint.velocity_ned_mps.horizontal()).map(centi),
        setpoint_climb_mps: centi(-f64::from(output.setpoint.velocity_ned_mps.down)),
        yaw_rate_degps: rounded(degrees(f64::from(output.setpoint.yaw_rate_radps)), 1),
        evasion_mps: computer.inside().and_then(|one| one.state().evasion_ned_mps()).map(core_xy),
        outcome: output.outcome.name(),
        guard: guard(output.guard),
        guard_reason: None,
        landing: output.landing.map(landing),
        clearance_m: world.pillars_at(sample.time_s).map(clearance).min_by(f64::total_cmp).map(milli),
        truth_deg: to_source.map(|to_source| degrees(to_source.bearing_rad())),
        truth_m: to_source.map(|to_source| milli(to_source.norm())),
        heard,
        followed_deg: output
            .source_bearing_ned_rad
            .filter(|rad| rad.is_finite())
            .map(|rad| rounded(degrees(f64::from(rad)), 1)),
        source_m: output.source.map(|source| core_xy(source.place_ned_m)),
        source_sigma_m: output.source.and_then(|source| finite(source.sigma_m)),
        target_m: output.target_ned_m.map(core_xy),
    }
}

fn landing(advice: core_landing::Output) -> Landing {
    let sees_pad = advice.target.is_some_and(|target| target.is_pad);
    Landing { stage: advice.stage, reason: advice.reason.map(core_landing::Reason::name), sees_pad }
}

fn track(body: &tracks::Track) -> Track {
    Track {
        place_m: core_xy(body.center_ned_m),
        velocity_mps: core_xy(body.velocity_ned_mps),
        covariance: body.covariance.map(|value| rounded(f64::from(value), 6)),
        unseen_s: milli(f64::from(body.unseen_s)),
    }
}

/// A plan, without its time and trace.
fn plan((config, radius_m): (&planner::Config, f32), considered: &Considered<'_>, draws: bool) -> Plan {
    let Considered { known, plan, support, workspace } = considered;
    let chosen = (0..SAMPLES).find(|index| {
        draws && workspace.samples[*index] == plan.waypoints_ned_m && workspace.gains[*index] == plan.gains
    });
    let chosen = chosen.filter(|_| plan.verdict == Verdict::Follow);
    let origin = match (plan.verdict, chosen) {
        (Verdict::Brake, _) => Origin::Brake,
        (_, Some(_)) => Origin::Sampled,
        _ if config.kind != planner::Kind::Foxhound => Origin::Initial,
        _ if draws => Origin::Straight,
        _ => Origin::Bent,
    };
    let obstacles: Vec<Obstacle> = known.iter().map(|disc| Obstacle::of(disc, radius_m)).collect();
    let places = if config.kind == planner::Kind::Foxhound { support.places() } else { &[] };
    let heaviest = places.iter().map(|(_, weight)| *weight).fold(0.0, f32::max);
    let kept = places.iter().filter(|(_, weight)| *weight > PLACE_MIN * heaviest);
    Plan {
        time_s: 0.0,
        trace: String::new(),
        id: plan.id,
        origin,
        searches: plan.search.is_some(),
        start_m: core_xy(plan.start_ned_m),
        target_m: core_xy(plan.target_ned_m),
        waypoints_m: line(&plan.waypoints_ned_m),
        cost: finite(plan.cost),
        gains: gains(&plan.gains),
        samples: if draws { samples(workspace) } else { Vec::new() },
        chosen,
        circles_m: circles(known.iter().copied()),
        places: kept.map(|(at, weight)| place(*at, weight / heaviest)).collect(),
        belief: belief(places),
        field: Some(potential(config, plan, &obstacles)),
        thinned: false,
    }
}

fn samples(workspace: &Workspace) -> Vec<Sample> {
    let sample = |index: usize| Sample {
        waypoints_m: line(&workspace.samples[index]),
        gains: gains(&workspace.gains[index]),
        cost: rounded(f64::from(workspace.costs[index]), 4),
        feasible: workspace.feasible[index],
    };
    (0..SAMPLES).map(sample).collect()
}

fn line(trajectory: &Trajectory) -> Vec<[f64; 2]> {
    trajectory.iter().map(|waypoint| core_xy(*waypoint)).collect()
}

fn gains(gains: &field::Gains) -> Gains {
    let [k_att, k_rep, influence_m, swirl] =
        [gains.k_att, gains.k_rep, gains.influence_m, gains.swirl].map(|gain| rounded(f64::from(gain), 4));
    Gains { k_att, k_rep, influence_m, swirl }
}

fn place(place: ned::Horizontal, weight: f32) -> [f64; 3] {
    [rounded(f64::from(place.east), 2), rounded(f64::from(place.north), 2), rounded(f64::from(weight), 2)]
}

/// The moments of the places; `None` without places.
fn belief(places: &[(ned::Horizontal, f32)]) -> Option<Belief> {
    let sum = |of: &dyn Fn(f64, f64) -> f64| {
        let one = |(place, weight): &(ned::Horizontal, f32)| {
            f64::from(*weight) * of(f64::from(place.east), f64::from(place.north))
        };
        places.iter().map(one).sum::<f64>()
    };
    let (x, y) = (sum(&|x, _| x), sum(&|_, y| y));
    let covariance_m2 = [
        sum(&|at_x, _| (at_x - x) * (at_x - x)),
        sum(&|at_x, at_y| (at_x - x) * (at_y - y)),
        sum(&|_, at_y| (at_y - y) * (at_y - y)),
    ];
    let belief = Belief { mean_m: [milli(x), milli(y)], covariance_m2: covariance_m2.map(|value| rounded(value, 5)) };
    (!places.is_empty()).then_some(belief)
}

/// The potential that the followed trajectory descends, and that of the mean gains, from the core's own field.
fn potential(config: &planner::Config, plan: &planner::Plan, obstacles: &[Obstacle]) -> Field {
    let start = plan.start_ned_m;
    let offset = |step: i32| step as f32 * FIELD_STEP_M;
    let raster = |gains: field::Gains| {
        let field = apf::Field { law: config.law, gains };
        let value = |(row, column)| {
            let place = ned::Horizontal { north: start.north + offset(row), east: start.east + offset(column) };
            rounded(f64::from(field.potential(place, plan.target_ned_m, obstacles)), 2)
        };
        let side = -FIELD_HALF..=FIELD_HALF;
        side.clone().flat_map(|row| side.clone().map(move |column| (row, column))).map(value).collect()
    };
    let half = ned::Horizontal { north: offset(FIELD_HALF), east: offset(FIELD_HALF) };
    Field {
        south_west_m: core_xy(start.minus(half)),
        step_m: rounded(f64::from(FIELD_STEP_M), 4),
        columns: 2 * FIELD_HALF as usize + 1,
        followed: raster(plan.gains),
        mean: raster(config.gains),
    }
}
