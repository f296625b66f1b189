//! What the vehicle would hear and see where its autopilot says it is.
//!
//! The autopilot's telemetry is taken in by a second [`Companion`] that only listens: so that what is synthesised, and what
//! the flying computer is told, rest on the same reading of the same bytes. Position and yaw are carried on to the present
//! by velocity and yaw rate. Without telemetry there are no waves and no obstacles.

use foxhound_core::ConfigError;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::mission::{Control, Outcome};
use foxhound_link::companion::{self, Autopilot, Companion};
use foxhound_link::framer::{Framer, MavlinkVersion};
use foxhound_link::signing::Signing;

use super::provider::{Chooser, Eyes, Provider};
use crate::drive::computer::BLOCK;
use crate::drive::flight::Sample;
use crate::drive::landing::{Downward, Picture};
use crate::scenario;
use crate::world::antennas::Antennas;
use crate::world::random::Random;
use crate::world::sensor::View;
use crate::world::vehicle::Motion;
use crate::world::{Horizontal, Pose, World};

/// Telemetry older than this says nothing about now.
const AGE_MAX_S: f32 = 0.5;
/// Fewer frames of MAVLink 1 may be chance.
const OLD_FRAMES_MIN: u32 = 3;
/// From one look of the obstacle sensor to the next.
const LOOK_PERIOD_US: u64 = 100_000;

/// The vehicle, as its autopilot says.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fix {
    /// When the position was heard.
    pub(super) heard: Instant,
    /// The position that was heard.
    pub(super) heard_at: Horizontal,
    /// The pose now.
    pub(super) pose: Pose,
    /// Velocity, and its horizontal part.
    pub(super) velocity_ned_mps: [f64; 3],
    /// See `velocity_ned_mps`.
    pub(super) speed_mps: f64,
}

impl Fix {
    pub(super) fn place(&self) -> Horizontal {
        Horizontal { north: self.pose.position_ned_m[0], east: self.pose.position_ned_m[1] }
    }

    /// The same for those who watch the flight.
    pub(super) fn moves(&self, time_s: f64, outcome: Outcome) -> (Motion, Sample) {
        let Self { pose, velocity_ned_mps, speed_mps, .. } = *self;
        let [_, _, down_m] = pose.position_ned_m;
        let motion = Motion { pose, velocity_ned_mps, ..Motion::default() };
        (motion, Sample { time_s, position: self.place(), yaw_rad: pose.yaw_rad, down_m, speed_mps, outcome })
    }
}

/// Ears and eyes.
#[derive(Debug)]
pub(super) struct Senses {
    ear: Companion,
    antennas: Antennas,
    random: Random,
    source_ned_m: [f64; 3],
    world: World,
    sensor: scenario::Sensor,
    look_due: Instant,
    /// The camera, where a pad is given.
    downward: Option<Downward>,
    chooser: Chooser,
    /// Reads MAVLink 1 as well, only to say so.
    versions: Framer,
    old_frames: u32,
}

impl Senses {
    pub(super) fn new(
        source_ned_m: [f64; 3],
        snr_db: f64,
        scenario: &scenario::Scenario,
        seed: u64,
        signing: Option<Signing>,
        provider: &Provider,
    ) -> Result<Self, ConfigError> {
        let world = scenario.world();
        let mut ear = companion::Config::default().build()?;
        ear.sign_with(signing);
        let mut versions = Framer::new();
        versions.accept_v1(true);
        Ok(Self {
            ear,
            antennas: Antennas { snr_db: Some(snr_db), ..Antennas::default() },
            random: Random::new(seed, 1),
            source_ned_m,
            downward: Downward::new(scenario, &world, seed),
            world,
            sensor: scenario.sensor,
            look_due: Instant::default(),
            chooser: Chooser::new(provider),
            versions,
            old_frames: 0,
        })
    }

    /// Takes in what the autopilot sent.
    pub(super) fn receive(&mut self, now: Instant, bytes: &[u8]) {
        self.ear.receive(now, bytes);
        let mut rest = bytes;
        while !rest.is_empty() && self.old_frames < OLD_FRAMES_MIN {
            rest = &rest[self.versions.push(rest)..];
            while let Some(frame) = self.versions.next_frame() {
                self.old_frames += u32::from(frame.version == MavlinkVersion::V1);
            }
        }
        // It keeps its books only while it believes that it speaks, too.
        self.ear.poll(now);
        while self.ear.transmit(&mut [0; 1024]) > 0 {}
    }

    pub(super) fn autopilot(&self) -> Option<Autopilot> {
        self.ear.autopilot()
    }

    /// Whether there was anything that is not signed as it should be.
    pub(super) const fn disbelieves(&self) -> bool {
        let counters = self.ear.counters();
        counters.unsigned > 0 || counters.forged > 0
    }

    /// MAVLink 1 is heard.
    pub(super) const fn hears_mavlink_1(&self) -> bool {
        self.old_frames >= OLD_FRAMES_MIN
    }

    pub(super) fn is_in_control(&self, now: Instant) -> bool {
        self.ear.control(now) == Control::Granted
    }

    pub(super) fn world(&self) -> &World {
        &self.world
    }

    /// Where the vehicle is now.
    pub(super) fn fix(&self, now: Instant) -> Option<Fix> {
        let ownship = self.ear.ownship()?;
        let ahead_s = now.seconds_since(ownship.position_time);
        if ahead_s > AGE_MAX_S || now.seconds_since(ownship.attitude_time) > AGE_MAX_S {
            return None;
        }
        let heard = [ownship.position_ned_m.north, ownship.position_ned_m.east, ownship.position_ned_m.down];
        let velocity = [ownship.velocity_ned_mps.north, ownship.velocity_ned_mps.east, ownship.velocity_ned_mps.down];
        let position_ned_m = std::array::from_fn(|axis| f64::from(heard[axis] + velocity[axis] * ahead_s));
        let pose = Pose {
            position_ned_m,
            roll_rad: f64::from(ownship.roll_rad),
            pitch_rad: f64::from(ownship.pitch_rad),
            yaw_rad: f64::from(ownship.yaw_at(now)),
        };
        let heard_at = Horizontal { north: f64::from(heard[0]), east: f64::from(heard[1]) };
        let speed_mps = f64::from(libm::hypotf(velocity[0], velocity[1]));
        let velocity_ned_mps = velocity.map(f64::from);
        Some(Fix { heard: ownship.position_time, heard_at, pose, velocity_ned_mps, speed_mps })
    }

    /// One frame of the antennas.
    pub(super) fn hear(&mut self, now: Instant, fix: &Fix) -> Box<AdcFrame<BLOCK>> {
        Box::new(self.antennas.frame(now, &fix.pose, self.source_ned_m, &mut self.random))
    }

    /// The bytes of the camera's frames that arrive now.
    pub(super) fn film(&mut self, now: Instant, fix: &Fix) -> Option<Vec<u8>> {
        self.downward.as_mut()?.look(now.0, &fix.pose)
    }

    /// The picture of this step, if it is for the report.
    pub(super) fn picture(&self, now: Instant) -> Option<&Picture> {
        self.downward.as_ref()?.fresh(now.0 as f64 * 1e-6)
    }

    /// Who provides the obstacles.
    pub(super) const fn eyes(&self) -> Eyes {
        self.chooser.eyes()
    }

    /// What the simulated obstacle sensor sees, where there is one and it is time to look.
    pub(super) fn look(&mut self, now: Instant, fix: &Fix) -> Option<Vec<Circle>> {
        let is_told = self.ear.obstacle_sources(now).next().is_some();
        self.chooser.step(now, is_told);
        if now < self.look_due || !self.eyes().is_simulated() {
            return None;
        }
        self.look_due = now.plus_micros(LOOK_PERIOD_US);
        let (position, yaw_rad) = (fix.place(), fix.pose.yaw_rad);
        Some(View { world: &self.world, time_s: 0.0, position, yaw_rad, sensor: self.sensor }.circles())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_link::MessageData;
    use foxhound_link::dialect::{ATTITUDE_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA};
    use foxhound_link::framer::{FRAME_MAX, Header, encode_data};

    fn bytes<D: MessageData>(data: &D) -> Vec<u8> {
        let mut frame = [0; FRAME_MAX];
        let length = encode_data(Header { system_id: 1, component_id: 1, sequence: 0 }, data, &mut frame);
        frame[..length].to_vec()
    }

    fn senses() -> Senses {
        let obstacles = vec![scenario::Obstacle { x: 0.0, y: 3.0, r: 0.5, ..Default::default() }];
        let scenario = scenario::Scenario { obstacles, ..Default::default() };
        let file = Provider::File(Vec::new());
        let mut senses = Senses::new([10.0, 0.0, -5.0], 20.0, &scenario, 1, None, &file).unwrap();
        let now = Instant(1_000_000);
        let heartbeat =
            HEARTBEAT_DATA { custom_mode: 4, mavtype: 2, autopilot: 3, base_mode: 0x81, ..HEARTBEAT_DATA::DEFAULT };
        senses.receive(now, &bytes(&heartbeat));
        senses.receive(now, &bytes(&LOCAL_POSITION_NED_DATA { vx: 2.0, z: -5.0, ..LOCAL_POSITION_NED_DATA::DEFAULT }));
        senses.receive(now, &bytes(&ATTITUDE_DATA { yawspeed: 0.5, ..ATTITUDE_DATA::DEFAULT }));
        senses
    }

    #[test]
    fn telemetry_is_carried_on_to_the_present_and_forgotten_when_it_is_old() {
        let senses = senses();
        let fix = senses.fix(Instant(1_100_000)).unwrap();
        assert!((fix.place().north - 0.2).abs() < 1e-6 && fix.heard_at.north == 0.0 && fix.speed_mps == 2.0);
        assert!((fix.pose.yaw_rad - 0.05).abs() < 1e-6);
        assert!(senses.fix(Instant(1_501_000)).is_none());
        assert!(senses.is_in_control(Instant(1_100_000)) && !senses.is_in_control(Instant(4_000_000)));
    }

    #[test]
    fn mavlink_1_is_noticed_where_it_is_heard() {
        // A heartbeat of MAVLink 1, as pymavlink packs it.
        const OLD: [u8; 17] = [254, 9, 5, 1, 1, 0, 0, 0, 0, 0, 2, 3, 81, 4, 3, 46, 80];
        let mut senses = senses();
        for _ in 0..3 {
            assert!(!senses.hears_mavlink_1());
            senses.receive(Instant(1_000_000), &OLD);
        }
        assert!(senses.hears_mavlink_1());
    }

    #[test]
    fn an_obstacle_in_view_is_seen_ten_times_a_second() {
        let mut senses = senses();
        let mut looks = 0;
        for step in 0..20 {
            let now = Instant(1_000_000 + step * 20_000);
            let fix = senses.fix(now).unwrap();
            if let Some(circles) = senses.look(now, &fix) {
                assert_eq!(circles.len(), 1);
                looks += 1;
            }
        }
        assert_eq!(looks, 4);
    }
}
