//! The vehicle with its autopilot in its world: the part that all simulated flights share.
//!
//! In a step the sensors measure, the autopilot sends, the computer answers, the autopilot receives that, and the
//! vehicle flies until the next step. The caller uses the step and decides when the flight ends: [`super::flight`]
//! judges a mission, [`super::trial`] injects faults.

use std::collections::VecDeque;

use foxhound_core::base::obstacle::Circle;
use foxhound_link::dialect::OBSTACLE_DISTANCE_DATA;

use super::landing::{Downward, Landing, RANGE_TICKS};
use crate::autopilot::Autopilot;
use crate::scenario::{Scenario, SensorModel};
use crate::world::air::{Air, Drift};
use crate::world::lidar::Lidar;
use crate::world::random::Random;
use crate::world::ranging::Ranging;
use crate::world::sensor::View;
use crate::world::vehicle::{Motion, Vehicle};
use crate::world::{Horizontal, Hull, Pose, World, horizontal};

pub use crate::scenario::TICK_S;
/// Steps from one scan of the obstacle sensor to the next: 10 Hz.
const SENSOR_TICKS: u64 = 5;

/// Time of a step, and silent sensors.
#[derive(Clone, Copy, Debug)]
pub struct When {
    /// The number of the step.
    pub tick: u64,
    /// Time on the autopilot's clock.
    pub now_us: u64,
    /// Time in the world.
    pub time_s: f64,
    /// The autopilot sends no position and no attitude.
    pub ownship_is_silent: bool,
    /// The obstacle sensor sends nothing.
    pub obstacles_are_silent: bool,
}

/// The computer's input of a step.
#[derive(Clone, Debug)]
pub struct Sensed {
    /// True motion of the vehicle at the beginning of the step.
    pub motion: Motion,
    /// The bytes of the autopilot.
    pub rx: Vec<u8>,
    /// The circles of a sensor that delivers circles.
    pub circles: Option<Vec<Circle>>,
    /// The bytes of a lidar on the computer's own line.
    pub lidar: Option<Vec<u8>>,
    /// The bytes of the camera.
    pub camera: Option<Vec<u8>>,
}

/// The computer's answer to a step.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The bytes to the autopilot.
    pub tx: Vec<u8>,
    /// The time to the next step.
    pub step_s: f64,
}

/// A flight in progress.
#[derive(Debug)]
pub struct Rig {
    /// The autopilot, for its faults and its pilot.
    pub autopilot: Autopilot,
    /// The beacon and the pillars.
    pub world: World,
    /// The hull has touched a pillar or a person.
    pub collided: bool,
    pub(super) vehicle: Vehicle,
    pub(super) hull: Hull,
    pub(super) downward: Option<Downward>,
    scenario: Scenario,
    air: Option<Air>,
    drift: Option<Drift>,
    lidar: Option<Lidar>,
    ranging: Ranging,
    /// Messages of the obstacle sensor on their way, each with the tick of its arrival.
    on_their_way: VecDeque<(u64, OBSTACLE_DISTANCE_DATA)>,
    /// Parts of a step; the hull is checked after each of them.
    checks: u32,
}

impl Rig {
    /// A vehicle at rest at a pose, in calm air and with an exact position. The hull is checked after each of
    /// `checks` parts of a step.
    #[must_use]
    pub fn new(scenario: &Scenario, world: World, autopilot: Autopilot, pose: Pose, checks: u32) -> Self {
        Self {
            autopilot,
            collided: false,
            vehicle: Vehicle::new(scenario.vehicle, scenario.limits.a_max, pose),
            hull: Hull::new(&world, scenario.drone_radius, horizontal(&pose)),
            world,
            downward: None,
            air: None,
            drift: None,
            lidar: (scenario.sensor.model == SensorModel::Lidar).then(Lidar::default),
            ranging: Ranging::new(&scenario.sensor, Random::new(0, 8)),
            on_their_way: VecDeque::new(),
            scenario: scenario.clone(),
            checks,
        }
    }

    /// The same with the scenario's wind, errors of position and of ranges, range finder and camera, by a seed.
    #[must_use]
    pub fn disturbed(self, seed: u64) -> Self {
        let scenario = &self.scenario;
        Self {
            downward: Downward::new(scenario, &self.world, seed),
            air: scenario.wind.map(|wind| Air::new(wind, Random::new(seed, 3))),
            drift: scenario.position.map(|position| Drift::new(position, Random::new(seed, 4))),
            ranging: Ranging::new(&scenario.sensor, Random::new(seed, 8)),
            ..self
        }
    }

    /// Flies for one step; `exchange` passes the sensors' data to the computer, and returns its answer and a value
    /// for the caller.
    ///
    /// # Errors
    /// That of `exchange`; the vehicle stays where it is.
    pub fn step<T, E>(
        &mut self,
        when: &When,
        exchange: impl FnOnce(&Self, &Sensed) -> Result<(Answer, T), E>,
    ) -> Result<T, E> {
        let error = self.drift.as_mut().map_or(Horizontal::default(), |drift| drift.step(TICK_S));
        let sensed = self.sense(when, error);
        let (answer, result) = exchange(self, &sensed)?;
        self.autopilot.receive(when.now_us, &sensed.motion.displaced(error), &answer.tx);
        self.fly(when, &sensed.motion, answer.step_s);
        Ok(result)
    }

    /// The result of the landing, if the scenario has one.
    pub(super) fn landing(&self, time_s: f64) -> Option<Landing> {
        let downward = self.downward.as_ref()?;
        Some(downward.ended(&self.world, time_s, &self.vehicle.motion.pose))
    }

    /// The data of the autopilot, whose position has this `error`, and of the sensors.
    fn sense(&mut self, when: &When, error: Horizontal) -> Sensed {
        let When { tick, now_us, time_s, .. } = *when;
        let (motion, sensor) = (self.vehicle.motion, self.scenario.sensor);
        self.autopilot.telemetry(now_us, &motion.displaced(error), when.ownship_is_silent);
        let (position, yaw_rad) = (horizontal(&motion.pose), motion.pose.yaw_rad);
        let view = View { world: &self.world, time_s, position, yaw_rad, sensor };
        let mut circles = None;
        if !when.obstacles_are_silent {
            match sensor.model {
                SensorModel::Circles => {
                    circles = tick.is_multiple_of(SENSOR_TICKS).then(|| on_the_map(view.circles(), error));
                }
                SensorModel::Scan => {
                    let arrives = tick + (sensor.lag_s / TICK_S).round() as u64;
                    let scan = view.scan_in_turn(tick, SENSOR_TICKS, TICK_S, now_us, &motion, &mut self.ranging);
                    self.on_their_way.extend(scan.map(|message| (arrives, message)));
                }
                SensorModel::Lidar => {}
            }
        }
        while let Some((_, message)) = self.on_their_way.pop_front_if(|(arrives, _)| *arrives <= tick) {
            self.autopilot.forward(&message);
        }
        let lidar =
            self.lidar.as_mut().map(|lidar| lidar.turn(&view, &motion, &mut self.ranging, when.obstacles_are_silent));
        let mut camera = None;
        if let Some(downward) = &mut self.downward {
            if tick.is_multiple_of(RANGE_TICKS)
                && let Some(range) = downward.range(&motion.pose)
            {
                self.autopilot.find_range(&range);
            }
            camera = downward.look(now_us, &motion.pose);
        }
        Sensed { motion, rx: self.autopilot.transmit(), circles, lidar, camera }
    }

    /// Flies the vehicle until the next step. It ends where the hull touches something.
    fn fly(&mut self, when: &When, motion: &Motion, step_s: f64) {
        let When { now_us, time_s, .. } = *when;
        if let Some(air) = &mut self.air {
            self.vehicle.push = air.step(step_s);
        }
        let [north, east, _] = motion.velocity_ned_mps;
        self.world.step_aside(
            self.scenario.drone_radius,
            horizontal(&motion.pose),
            Horizontal { north, east },
            time_s,
            time_s + step_s,
        );
        for part in 1..=self.checks {
            self.vehicle.step(self.autopilot.command(now_us), step_s / f64::from(self.checks));
            if let Some(downward) = &mut self.downward {
                downward.touch(self.vehicle.touch_ground());
            }
            let at_s = time_s + step_s * f64::from(part) / f64::from(self.checks);
            if self.hull.collides(&self.world, horizontal(&self.vehicle.motion.pose), at_s) {
                self.collided = true;
                break;
            }
        }
    }
}

/// Circles in the frame of an autopilot with an error of its position.
fn on_the_map(mut circles: Vec<Circle>, error: Horizontal) -> Vec<Circle> {
    let error = error.to_core();
    for circle in &mut circles {
        circle.center_ned_m.north += error.north;
        circle.center_ned_m.east += error.east;
    }
    circles
}
