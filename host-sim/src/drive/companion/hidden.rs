//! Hidden courses: posts that only the autopilot's own proximity sensor sees, flown as `foxhound companion` flies, in simulated
//! time. Collisions are counted from where the model's vehicle and the posts really are.

use foxhound_link::dialect::MavMessage;
use foxhound_link::framer::Framer;

use super::*;
use crate::autopilot::{Autopilot, GUIDED, Proximity, Start, Told};
use crate::drive::computer::HostComputer;
use crate::scenario::Software;
use crate::world::random::Random;
use crate::world::vehicle::Vehicle;
use crate::world::{Hull, Pose, World};

const SOURCE_M: f64 = 12.0;
const COURSES: usize = 6;
const TIME_MAX_S: f64 = 180.0;
/// A vehicle that has been so long slower than [`SLOW_MPS`] stands.
const STANDS_S: f64 = 20.0;

#[derive(Debug)]
struct Ended {
    reached: bool,
    /// Why it stood at the end.
    reason: Outcome,
    collided: bool,
    min_clearance_m: f64,
    /// From its start to the end.
    away_m: f64,
    eyes: Eyes,
}

/// Posts in the way to the beacon, which is straight ahead.
fn course(number: usize, seed: u64) -> Vec<Obstacle> {
    let mut random = Random::new(seed, 7);
    let mut aside = |most: f64| most * (2.0 * random.uniform() - 1.0);
    let post = |x: f64, y: f64, r: f64| Obstacle { x, y, r, ..Obstacle::default() };
    match number {
        // One in the middle of the way.
        0 => vec![post(aside(0.3), 6.0 + aside(1.0), 0.3)],
        // Two staggered ones.
        1 => vec![post(-0.4 + aside(0.3), 4.5 + aside(0.5), 0.2), post(0.5 + aside(0.3), 8.0 + aside(0.5), 0.25)],
        // A gate, and a post behind it.
        2 => {
            let half_m = 1.1 + aside(0.2);
            vec![post(-half_m, 5.0, 0.2), post(half_m, 5.0, 0.2), post(aside(0.4), 8.5, 0.3)]
        }
        // A row across the way that nothing fits through, longer than the sensor sees.
        3 => (-9..=9).map(|post_at| post(0.5 * f64::from(post_at) + aside(0.05), 6.0 + aside(0.2), 0.12)).collect(),
        // A few anywhere.
        4 => (0..6).map(|post_at| post(aside(2.5), 3.0 + 1.2 * f64::from(post_at) + aside(0.4), 0.2)).collect(),
        // Many thin ones.
        _ => (0..12).map(|_| post(aside(1.5), 6.5 + aside(4.5), 0.1)).collect(),
    }
}

fn senses(config: &Config) -> Senses {
    let Config { source_ned_m, snr_db, seed, ref obstacles, .. } = *config;
    Senses::new(source_ned_m, snr_db, &config.scenario(), seed, None, obstacles).unwrap()
}

/// A flight under way.
struct Flown {
    config: Config,
    truth: World,
    computer: HostComputer,
    vehicle: Vehicle,
    autopilot: Autopilot,
    senses: Senses,
    hull: Hull,
    time_s: f64,
    /// What the pilot was told.
    texts: Vec<String>,
    /// Why the landing is where it is.
    reason: Option<Reason>,
}

impl Flown {
    fn new(provider: Provider, posts: Vec<Obstacle>, seed: u64) -> Self {
        let config =
            Config { source_ned_m: [SOURCE_M, 0.0, -5.0], obstacles: provider, seed, ..super::tests::config() };
        let truth = Scenario { obstacles: posts, ..Scenario::default() }.world();
        let pose = Pose { position_ned_m: [0.0, 0.0, -5.0], ..Pose::default() };
        let model = scenario::Vehicle { model: VehicleModel::Arducopter, ..scenario::Vehicle::default() };
        Self {
            computer: HostComputer::new(&config.guidance()).unwrap(),
            vehicle: Vehicle::new(model, scenario::Limits::default().a_max, pose),
            autopilot: Autopilot::new(Software::ArduCopter, Start::InControl),
            senses: senses(&config),
            hull: Hull::new(&truth, config.drone_radius_m, Horizontal::default()),
            truth,
            config,
            time_s: 0.0,
            texts: Vec::new(),
            reason: None,
        }
    }

    fn with_sensor(mut self, told: Told, range_m: f64, rate_hz: f64) -> Self {
        self.autopilot.proximity = Some(Proximity::new(self.truth.clone(), told, range_m, rate_hz));
        self
    }

    fn place(&self) -> Horizontal {
        let [north, east, _] = self.vehicle.motion.pose.position_ned_m;
        Horizontal { north, east }
    }

    fn is_guided(&self) -> bool {
        self.autopilot.custom_mode == GUIDED
    }

    /// What the loop in real time does in a step; says what came of it, and whether it has collided.
    fn step(&mut self) -> (Outcome, bool) {
        let now_us = (self.time_s * 1e6 + 0.5) as u64;
        let (now, motion) = (Instant(now_us), self.vehicle.motion);
        self.autopilot.telemetry(now_us, &motion, false);
        let rx = self.autopilot.transmit();
        self.senses.receive(now, &rx);
        let fix = self.senses.fix(now);
        let frame = fix.as_ref().map(|fix| self.senses.hear(now, fix));
        let front_end = frame.as_deref().map_or(FrontEnd::Nothing, FrontEnd::Frame);
        let circles = fix.as_ref().and_then(|fix| self.senses.look(now, fix));
        if let Some(bytes) = fix.as_ref().and_then(|fix| self.senses.film(now, fix)) {
            self.computer.see(&bytes).unwrap();
        }
        let report = self.computer.step(now, front_end, circles.as_deref(), &rx).unwrap();
        self.note_texts(&report.tx);
        self.autopilot.receive(now_us, &motion, &report.tx);
        self.vehicle.step(self.autopilot.command(now_us), TICK_S);
        self.vehicle.touch_ground();
        self.time_s += TICK_S;
        self.reason = report.output.landing.and_then(|landing| landing.reason);
        let place = self.place();
        (report.output.outcome, self.hull.collides(&self.truth, place, 0.0))
    }

    fn note_texts(&mut self, tx: &[u8]) {
        Framer::new().each(tx, |frame| {
            if let Some(MavMessage::STATUSTEXT(text)) = frame.message() {
                self.texts.extend(text.text.to_str().map(str::to_owned));
            }
        });
    }

    fn fly(mut self) -> Ended {
        let source = Horizontal { north: SOURCE_M, east: 0.0 };
        let mut moved_s = 0.0;
        loop {
            let (reason, collided) = self.step();
            let place = self.place();
            let [north_mps, east_mps, _] = self.vehicle.motion.velocity_ned_mps;
            if libm::hypot(north_mps, east_mps) > SLOW_MPS {
                moved_s = self.time_s;
            }
            let reached = source.minus(place).norm() <= ARRIVED_M;
            if reached || collided || self.time_s > TIME_MAX_S || self.time_s > moved_s + STANDS_S {
                let min_clearance_m = self.hull.min_clearance_m;
                let eyes = self.senses.eyes();
                return Ended { reached, reason, collided, min_clearance_m, away_m: place.norm(), eyes };
            }
        }
    }
}

/// Every course, with so many seeds each: nothing is touched, and who does not arrive stands for a reason. Says how many arrived, and how
/// many stand since nobody tells what there is.
fn fly_all(
    provider: &Provider,
    told: Told,
    range_m: f64,
    rate_hz: f64,
    seeds: std::ops::RangeInclusive<u64>,
) -> (usize, usize) {
    let (mut reached, mut untold) = (0, 0);
    for (number, seed) in (0..COURSES).flat_map(|number| seeds.clone().map(move |seed| (number, seed))) {
        let ended = Flown::new(provider.clone(), course(number, seed), seed).with_sensor(told, range_m, rate_hz).fly();
        let named = format!("{provider:?}, {told:?} at {rate_hz} Hz, course {number}, seed {seed}: {ended:?}");
        assert!(!ended.collided && ended.min_clearance_m > 0.0, "{named}");
        assert!(ended.reached || ended.reason.behaviour() == Behaviour::Hold, "{named}");
        let eyes = if *provider == Provider::File(Vec::new()) { Eyes::File } else { Eyes::Autopilot };
        assert_eq!(ended.eyes, eyes, "{named}");
        reached += usize::from(ended.reached);
        untold += usize::from(!ended.reached && ended.reason == Outcome::StaleObstacles);
    }
    (reached, untold)
}

#[test]
fn posts_that_only_eight_distance_sensors_see_are_not_touched() {
    for provider in [Provider::Unsaid, Provider::Autopilot, Provider::File(Vec::new())] {
        for rate_hz in [2.0, 10.0] {
            let (reached, _) = fly_all(&provider, Told::Directions, 12.0, rate_hz, 1..=5);
            assert!(reached >= 28, "{provider:?} at {rate_hz} Hz: {reached} of 30 arrive");
        }
    }
}

#[test]
fn posts_in_directions_that_are_told_only_once_something_was_seen_are_not_touched() {
    // Where nobody else looks it stands while nothing is told: at the start, where the nearest posts are farther away than this sensor
    // sees, and once they are behind it.
    for provider in [Provider::Unsaid, Provider::Autopilot, Provider::File(Vec::new())] {
        for rate_hz in [2.0, 10.0] {
            let (reached, untold) = fly_all(&provider, Told::DirectionsOnceSeen, 4.0, rate_hz, 1..=5);
            let named = format!("{provider:?} at {rate_hz} Hz: {reached} of 30 arrive, {untold} are told nothing");
            assert!(reached + untold >= 28 && (untold == 0 || provider != Provider::File(Vec::new())), "{named}");
        }
    }
}

#[test]
fn an_ardupilot_that_tells_nothing_of_its_sensor_since_nothing_is_near_is_waited_for() {
    // The only post stands beside the start, and is soon out of sight.
    let beside = vec![Obstacle { x: 1.5, y: -1.0, r: 0.2, ..Obstacle::default() }];
    for posts in [beside, Vec::new()] {
        let ended = Flown::new(Provider::Autopilot, posts, 1).with_sensor(Told::DirectionsOnceSeen, 3.0, 10.0).fly();
        assert!(!ended.reached && !ended.collided && ended.reason == Outcome::StaleObstacles, "{ended:?}");
    }
}

#[test]
fn posts_that_only_the_autopilots_72_sectors_see_are_not_touched_from_2_to_10_hz() {
    for provider in [Provider::Unsaid, Provider::Autopilot, Provider::File(Vec::new())] {
        for rate_hz in [2.0, 5.0, 10.0] {
            let (reached, _) = fly_all(&provider, Told::Sectors, 6.0, rate_hz, 1..=5);
            assert!(reached >= 28, "{provider:?} at {rate_hz} Hz: {reached} of 30 arrive");
        }
    }
}

#[test]
fn a_sensor_that_falls_silent_on_the_way_is_waited_for_and_not_taken_for_an_empty_world() {
    for provider in [Provider::Unsaid, Provider::Autopilot] {
        let mut flown = Flown::new(provider, course(0, 1), 1).with_sensor(Told::Directions, 12.0, 10.0);
        while flown.time_s < 5.0 {
            flown.step();
        }
        flown.autopilot.proximity = None;
        let left_at_m = flown.place().norm();
        let ended = flown.fly();
        assert!(!ended.reached && !ended.collided && ended.reason == Outcome::StaleObstacles, "{ended:?}");
        assert!(ended.away_m < left_at_m + 2.0, "{left_at_m} {ended:?}");
    }
}

#[test]
fn without_anybody_it_moves_only_where_its_parameters_let_it_fly_blind() {
    for provider in [Provider::Nobody, Provider::Autopilot] {
        let ended = Flown::new(provider.clone(), Vec::new(), 1).fly();
        assert!(!ended.reached && ended.away_m < 0.05 && ended.reason == Outcome::StaleObstacles, "{ended:?}");
        let mut flown = Flown::new(provider, Vec::new(), 1);
        let mut guidance = flown.config.guidance();
        // FH_OBS_REQ.
        guidance.mission.obstacles_required = false;
        flown.computer = HostComputer::new(&guidance).unwrap();
        assert!(flown.fly().reached);
    }
    let ended = Flown::new(Provider::Unsaid, Vec::new(), 1).fly();
    assert!(ended.reached && ended.eyes == Eyes::SimulatedEmpty, "{ended:?}");
}

#[test]
fn the_pilot_of_a_flight_without_trouble_reads_that_it_seeks_and_nothing_else_of_it() {
    let mut flown = Flown::new(Provider::Autopilot, course(0, 1), 1).with_sensor(Told::Sectors, 6.0, 10.0);
    while flown.place().norm() < SOURCE_M - ARRIVED_M && flown.time_s < TIME_MAX_S {
        flown.step();
    }
    // What the autopilot's parameters leave open, and what the guard does, is another matter.
    let told: Vec<&String> =
        flown.texts.iter().filter(|text| !text.contains("set 1") && !text.contains("guard")).collect();
    assert_eq!(told, ["Foxhound: seeking"], "{:?}", flown.texts);
}

#[test]
fn a_computer_that_is_to_hand_over_above_the_beacon_comes_to_it() {
    let mut flown = Flown::new(Provider::Unsaid, Vec::new(), 1);
    let mut guidance = flown.config.guidance();
    guidance.landing = Some(foxhound_core::landing::Config::default());
    assert_eq!(Ends::of(&guidance), Ends::HandedOver);
    flown.computer = HostComputer::new(&guidance).unwrap();
    let mut arrival = Arrival::new(Ends::HandedOver);
    while flown.time_s < TIME_MAX_S {
        let (outcome, _) = flown.step();
        let now = Instant((flown.time_s * 1e6) as u64);
        arrival.step(now, outcome, flown.reason);
        if arrival.has_ended(now, true) {
            let off_m = flown.place().minus(Horizontal { north: SOURCE_M, east: 0.0 }).norm();
            assert!(off_m < ARRIVED_M, "{off_m} m off the beacon");
            return;
        }
    }
    panic!("it has not handed over");
}

/// A flight to a beacon this far below the vehicle, whose computer is to have the autopilot land it there.
fn landing(below_m: f64, seed: u64) -> Flown {
    let mut flown = Flown::new(Provider::Unsaid, Vec::new(), seed);
    flown.config.source_ned_m[2] += below_m;
    flown.senses = senses(&flown.config);
    let landing = foxhound_core::landing::Config { request_land: true, ..foxhound_core::landing::Config::default() };
    let guidance = guidance::Config { landing: Some(landing), ..flown.config.guidance() };
    assert_eq!(Ends::of(&guidance), Ends::Landing);
    flown.computer = HostComputer::new(&guidance).unwrap();
    flown
}

#[test]
fn on_a_pad_that_the_simulated_camera_sees_it_lands_and_asks_the_autopilot_to_disarm() {
    for seed in 1..=4 {
        let mut flown = landing(5.0, seed);
        flown.config.pad_ne_m = Some([SOURCE_M + 0.4, -0.3]);
        flown.senses = senses(&flown.config);
        let mut guidance = flown.config.guidance();
        guidance.landing.as_mut().unwrap().request_land = true;
        flown.computer = HostComputer::new(&guidance).unwrap();
        let mut arrival = Arrival::new(Ends::Landing);
        while !arrival.has_ended(Instant((flown.time_s * 1e6) as u64), flown.is_guided()) {
            let outcome = flown.step();
            arrival.step(Instant((flown.time_s * 1e6) as u64), outcome.0, flown.reason);
            assert!(flown.time_s < TIME_MAX_S, "seed {seed}: {:?}", flown.texts);
        }
        let off_m = flown.place().minus(Horizontal { north: SOURCE_M + 0.4, east: -0.3 }).norm();
        assert!(arrival.is_there && off_m < 0.25, "seed {seed}: {off_m} m off, {:?}", flown.texts);
        assert_eq!(flown.reason, Some(Reason::Landed), "seed {seed}");
    }
}

#[test]
fn above_or_below_the_beacon_the_autopilot_is_asked_to_land_and_level_with_it_the_pilot_reads_why_not() {
    for (below_m, lands) in [(5.0, true), (2.0, true), (0.5, true), (0.0, false), (-0.5, true), (-1.0, true)] {
        for seed in 1..=3 {
            let mut flown = landing(below_m, seed);
            let mut arrival = Arrival::new(Ends::Landing);
            while !arrival.has_ended(Instant((flown.time_s * 1e6) as u64), flown.is_guided()) {
                let outcome = flown.step();
                arrival.step(Instant((flown.time_s * 1e6) as u64), outcome.0, flown.reason);
                assert!(flown.time_s < TIME_MAX_S, "{below_m} m below, seed {seed}: {:?}", flown.texts);
            }
            let named = format!("{below_m} m below, seed {seed}, {:.1} s: {:?}", flown.time_s, flown.texts);
            assert_eq!((arrival.is_there, !flown.is_guided()), (lands, lands), "{named}");
            let text =
                if lands { "arrived, asks the autopilot to land" } else { "beacon not located, hovers, take over" };
            assert!(flown.texts.contains(&format!("Foxhound: {text}")), "{named}");
            let off_m = flown.place().minus(Horizontal { north: SOURCE_M, east: 0.0 }).norm();
            assert!(off_m < ARRIVED_M, "{off_m} m off the beacon; {named}");
        }
    }
}
