//! The last metres: the camera that looks down, the range finder, and the end of the flight on the ground or above
//! it.

use std::collections::VecDeque;
use std::f32::consts::TAU;

use foxhound_core::base::time::Instant;
use foxhound_core::guidance::Output;
use foxhound_core::landing::{self, Stage};
use foxhound_link::dialect::DISTANCE_SENSOR_DATA;
use foxhound_pad::Format;
use serde::Serialize;

use crate::scenario::{self, inside};
use crate::world::camera::{self, Frame, Ground, Lighting, Scene, Shadow, Shape, Size, Target, Thing};
use crate::world::random::Random;
use crate::world::{Horizontal, Pose, World, camera_line, horizontal};

/// From one reading of the range finder to the next: 17 Hz.
pub(super) const RANGE_TICKS: u64 = 3;
/// `MAV_SENSOR_ROTATION_PITCH_270`: it looks down.
const DOWN: u8 = 25;
const RANGE_MIN_M: f64 = 0.1;
const RANGE_MAX_M: f64 = 12.0;
/// Noise of the range finder.
const RANGE_SIGMA_M: f64 = 0.02;
/// How long it hovers after handing over before the flight counts as ended.
const HANDED_OVER_S: f64 = 3.0;
/// How long it must be on the ground, so that an autopilot that is asked to disarm has done so.
const LANDED_S: f64 = 1.0;
/// Time between pictures in the report.
const PICTURE_EVERY_S: f64 = 0.5;
/// Distance of red objects from the pad, and between their centres.
const DISTRACTOR_M: [f32; 2] = [0.9, 5.0];
const DISTRACTORS: usize = 6;

/// The result of a landing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Landing {
    /// The last stage: `landed` and `handed_over` are ends, the others are not.
    pub stage: Stage,
    /// The reason.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<&'static str>,
    /// Horizontal distance from the centre of the pad; `None` without a pad.
    pub pad_distance_m: Option<f64>,
    /// Horizontal distance from the beacon.
    pub beacon_distance_m: f64,
    /// Height over the ground.
    pub height_m: f64,
    /// Speed of the touchdown.
    pub touchdown_mps: Option<f64>,
    /// Number of the camera's frames.
    pub frames: u32,
}

impl Landing {
    /// Whether the vehicle is where it should be: on the pad, or over the beacon after handing over.
    pub(super) fn is_there(&self, scenario: &scenario::Scenario, to_goal_m: f64) -> bool {
        let pad_radius_m = scenario.landing.map_or(0.0, |landing| landing.pad_radius);
        match self.stage {
            Stage::Landed => self.pad_distance_m.is_some_and(|distance_m| distance_m <= pad_radius_m),
            Stage::HandedOver => to_goal_m <= scenario.goal_tolerance,
            _ => false,
        }
    }
}

/// A picture that the camera took.
#[derive(Clone, Debug)]
pub struct Picture {
    /// When.
    pub time_s: f64,
    /// Height of the camera.
    pub height_m: f64,
    /// The frame.
    pub frame: Frame,
}

/// The sensors that look down.
#[derive(Debug)]
pub(super) struct Downward {
    landing: scenario::Landing,
    random: Random,
    pad: Option<Horizontal>,
    view: Option<View>,
    /// Frames in transmission, with the time of their arrival.
    underway: VecDeque<(u64, Vec<u8>)>,
    exposure_us: u64,
    frames: u32,
    picture: Option<Picture>,
    /// When the flight ended, and the speed of the touchdown.
    over_s: Option<f64>,
    touchdown_mps: Option<f64>,
    last: Option<landing::Output>,
}

/// Scene and camera.
#[derive(Debug)]
struct View {
    camera: scenario::Camera,
    scene: Scene,
    lighting: Lighting,
    seed: u64,
}

impl Downward {
    pub(super) fn new(scenario: &scenario::Scenario, world: &World, seed: u64) -> Option<Self> {
        let landing = scenario.landing?;
        let mut random = Random::new(seed, 5);
        let [east, north] = landing.pad;
        let pad = Horizontal { north: world.source.north + north, east: world.source.east + east };
        let pad = (!landing.pad_missing).then_some(pad);
        let around = pad.unwrap_or(world.source);
        let view = landing.camera.map(|camera| View::new(camera, &landing, pad, around, &mut random, seed));
        Some(Self {
            landing,
            random,
            pad,
            view,
            underway: VecDeque::new(),
            exposure_us: 0,
            frames: 0,
            picture: None,
            over_s: None,
            touchdown_mps: None,
            last: None,
        })
    }

    /// The range finder's reading; `None` without ground in view.
    pub(super) fn range(&mut self, pose: &Pose) -> Option<DISTANCE_SENSOR_DATA> {
        let level = libm::cos(pose.roll_rad) * libm::cos(pose.pitch_rad);
        let slant_m = -pose.position_ned_m[2] / level + RANGE_SIGMA_M * self.random.gaussian();
        let is_seen = self.landing.range_finder && slant_m <= RANGE_MAX_M && level > 0.0;
        is_seen.then(|| DISTANCE_SENSOR_DATA {
            orientation: DOWN,
            min_distance: (RANGE_MIN_M * 100.0) as u16,
            max_distance: (RANGE_MAX_M * 100.0) as u16,
            current_distance: libm::rint(slant_m * 100.0).max(0.0) as u16,
            ..DISTANCE_SENSOR_DATA::DEFAULT
        })
    }

    /// The camera's bytes that arrive now; a new frame is exposed when it is due.
    pub(super) fn look(&mut self, now_us: u64, pose: &Pose) -> Option<Vec<u8>> {
        if let Some(view) = &self.view
            && now_us >= self.exposure_us
        {
            let camera = view.camera;
            let time_s = now_us as f64 * 1e-6;
            self.exposure_us = now_us + (1e6 / camera.rate_hz) as u64;
            let mut frame = view.expose(pose, self.frames);
            if inside(camera.blind, time_s) {
                frame.bytes.fill(0x42);
            }
            let latency_us = (camera.latency_s * 1e6) as u64;
            let mut bytes = camera_line::bytes(&frame.header(Instant(now_us)), &frame.bytes, latency_us as u32);
            if inside(camera.cut, time_s) {
                bytes.truncate(bytes.len() / 2);
            }
            self.underway.push_back((now_us + latency_us, bytes));
            self.frames += 1;
            self.keep(time_s, -pose.position_ned_m[2], frame);
        }
        self.underway.pop_front_if(|(at_us, _)| *at_us <= now_us).map(|(_, bytes)| bytes)
    }

    /// Stores a picture for the report, now and then.
    fn keep(&mut self, time_s: f64, height_m: f64, frame: Frame) {
        if self.picture.as_ref().is_none_or(|last| time_s - last.time_s >= PICTURE_EVERY_S) {
            self.picture = Some(Picture { time_s, height_m, frame });
        }
    }

    /// The picture of this step, if it is for the report.
    pub(super) fn fresh(&self, time_s: f64) -> Option<&Picture> {
        self.picture.as_ref().filter(|picture| picture.time_s >= time_s)
    }

    /// Records the speed of the first touchdown.
    pub(super) fn touch(&mut self, down_mps: Option<f64>) {
        self.touchdown_mps = self.touchdown_mps.or(down_mps);
    }

    /// Records a step; true if the flight is over.
    pub(super) fn follow(&mut self, time_s: f64, output: &Output) -> bool {
        let Some(advice) = output.landing else {
            // The autopilot flies the landing that was asked for, until it is on the ground.
            return self.touchdown_mps.is_some() && self.last.is_some_and(|last| last.wants_land);
        };
        self.last = Some(advice);
        let waits_s = match advice.stage {
            Stage::Landed => LANDED_S,
            Stage::HandedOver => HANDED_OVER_S,
            _ => {
                self.over_s = None;
                return false;
            }
        };
        time_s - *self.over_s.get_or_insert(time_s) >= waits_s
    }

    /// The result.
    pub(super) fn ended(&self, world: &World, time_s: f64, pose: &Pose) -> Landing {
        let here = horizontal(pose);
        Landing {
            stage: self.last.map_or(Stage::Seeking, |advice| advice.stage),
            reason: self.last.and_then(|advice| advice.reason).map(foxhound_core::landing::Reason::name),
            pad_distance_m: self.pad.map(|pad| pad.minus(here).norm()),
            beacon_distance_m: world.source_at(time_s).minus(here).norm(),
            height_m: -pose.position_ned_m[2],
            touchdown_mps: self.touchdown_mps,
            frames: self.frames,
        }
    }
}

impl View {
    fn new(
        camera: scenario::Camera,
        landing: &scenario::Landing,
        pad: Option<Horizontal>,
        around: Horizontal,
        random: &mut Random,
        seed: u64,
    ) -> Self {
        let mut between = |low: f32, high: f32| low + (high - low) * random.uniform() as f32;
        let grounds = [
            Ground::Grass,
            Ground::Gravel,
            Ground::Concrete,
            Ground::Tiles { side_m: between(0.15, 0.8), colour: [0.40, 0.38, 0.35] },
            Ground::Soil { colour: [0.28, 0.19, 0.12] },
            Ground::Mixed,
        ];
        let ground = grounds[between(0.0, grounds.len() as f32 - 0.01) as usize];
        let (north, east) = (around.north as f32, around.east as f32);
        let distractor = |between: &mut dyn FnMut(f32, f32) -> f32| {
            let (turn, far_m) = (between(0.0, TAU), between(DISTRACTOR_M[0], DISTRACTOR_M[1]));
            let shapes = [
                Shape::Rectangle(2.2),
                Shape::Triangle,
                Shape::Sector(0.5),
                Shape::Ring(0.6),
                Shape::Leaf(2.0),
                Shape::Glow,
            ];
            Thing {
                shape: shapes[between(0.0, shapes.len() as f32 - 0.01) as usize],
                north_m: north + far_m * libm::cosf(turn),
                east_m: east + far_m * libm::sinf(turn),
                radius_m: between(0.12, 0.35),
                turn_rad: between(0.0, TAU),
                colour: camera::PAD_RED,
            }
        };
        let things = if camera.distractors { DISTRACTORS } else { 0 };
        let things = (0..things).map(|_| distractor(&mut between)).collect();
        let target = pad.map(|pad| Target {
            north_m: pad.north as f32,
            east_m: pad.east as f32,
            radius_m: landing.pad_radius as f32,
            ring_m: if between(0.0, 1.0) < 0.4 { 0.05 } else { 0.0 },
            colour: camera::PAD_RED,
        });
        let shadow = Shadow {
            north_m: north + between(-0.5, 0.5),
            east_m: east + between(-0.5, 0.5),
            into: camera::direction(between(0.0, TAU)),
            width_m: between(0.5, 4.0),
            left: between(0.3, 0.7),
        };
        let lighting = Lighting {
            exposure: between(0.5, 1.5),
            gains: camera::lamp(between(3500.0, 8000.0)),
            vignette: between(0.0, 0.3),
            gradient: [between(-0.2, 0.2), between(-0.2, 0.2)],
            shadows: if between(0.0, 1.0) < 0.4 { vec![shadow] } else { Vec::new() },
            flare: between(0.0, 0.04),
            blur_px: between(0.3, 0.8),
            read_noise: between(0.003, 0.012),
            dead_ppm: 100.0,
            ..Lighting::default()
        };
        let scene = Scene { ground, things, target, covers: Vec::new() };
        Self { camera, scene, lighting, seed }
    }

    fn expose(&self, pose: &Pose, number: u32) -> Frame {
        let Self { camera, scene, lighting, seed } = self;
        let Pose { position_ned_m: [north, east, down], roll_rad, pitch_rad, yaw_rad, .. } = *pose;
        let pose = camera::Pose {
            north_m: north as f32,
            east_m: east as f32,
            height_m: (-down).max(0.02) as f32,
            roll_rad: roll_rad as f32,
            pitch_rad: pitch_rad as f32,
            yaw_rad: yaw_rad as f32,
        };
        let size = Size {
            width_px: camera.width,
            height_px: camera.height,
            format: if camera.grey { Format::Grey } else { Format::Rgb565 },
        };
        let lens = camera::Camera { focal_widths: camera.focal_widths() as f32 };
        // The texture of the ground is constant, the noise of the sensor is not.
        camera::render(scene, &lens, &pose, lighting, size, *seed ^ u64::from(number) << 40)
    }
}
