//! Short flights through a scene, received with the product's chain, and the inputs of its classifier.

use std::f64::consts::{PI, TAU};

use foxhound_core::ConfigError;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::array;
use foxhound_core::doa::bearing::{self, BearingEstimator};
use foxhound_core::localize::link_state::{Classifier, FEATURES, Features, Sightline, State};
use foxhound_core::mapping::walls::Wall;
use foxhound_core::signal::phase::{self, Extractor};

use super::scenes::{Scene, within};
use crate::world::antennas::{Antennas, Impairments, Reflection};
use crate::world::random::Random;
use crate::world::rays::{self, Path};
use crate::world::{Horizontal, Pose, wrap_pi};

/// Samples of a frame.
const N: usize = 256;
/// A strongest path with less signal-to-noise ratio per sample than this does not count.
pub const NONE_BELOW_DB: f64 = -13.0;
/// Paths that lose more are not traced.
const LOSS_MAX_DB: f64 = 45.0;
/// Distance that the vehicle flies between observations.
const STEP_M: f64 = 0.082;
/// Observations of a leg, at most.
const LOOKS: usize = 80;
/// From sample to sample.
const EVERY: usize = 6;
/// Legs of a scene.
const LEGS: usize = 4;

/// A moment of a leg.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    /// Without a map.
    pub(super) blind: [f32; FEATURES],
    /// With most walls known.
    pub(super) mapped: [f32; FEATURES],
    /// Truth, an index into `LinkState::ALL`.
    pub(super) class: usize,
    /// By how much the strongest path stands above the strongest of another class.
    pub(super) lead_db: f64,
    /// The truth was another within the window.
    pub(super) is_fresh: bool,
}

/// The chain of the product.
pub(super) struct Chain {
    extractor: Extractor<N>,
    estimator: BearingEstimator,
}

impl Chain {
    pub(super) fn build() -> Result<Self, ConfigError> {
        let estimator = bearing::Config::default().build(array::Config::default().build()?)?;
        Ok(Self { extractor: phase::Config::default().build()?, estimator })
    }

    /// All samples of one scene.
    pub(super) fn samples(&self, seed: u64, purpose: u64) -> Vec<Sample> {
        let mut random = Random::new(seed, purpose);
        let scene = Scene::draw(&mut random);
        (0..LEGS).flat_map(|_| self.leg(&scene, &mut random)).collect()
    }

    fn leg(&self, scene: &Scene, random: &mut Random) -> Vec<Sample> {
        let places = course(scene, random);
        let step_s = if random.uniform() < 0.1 { 0.25 } else { STEP_M / within(random, 0.3, 1.5) };
        let antennas = antennas(scene, random);
        let known = known_walls(scene, random);
        let yaw_bias_rad = 0.015 * random.gaussian();
        let odometry = 1.0 + 0.01 * random.gaussian();
        let (mut yaw_rad, turn_rad) = (within(random, -PI, PI), 0.05 * random.gaussian());
        let mut heard = phase::State::<N>::default();
        let (mut blind, mut mapped) = (State::new(), State::new());
        let mut truths = Vec::with_capacity(places.len());
        let mut samples = Vec::new();
        for (index, place) in places.iter().enumerate() {
            yaw_rad = wrap_pi(yaw_rad + turn_rad);
            let tilt_rad = [0.04 * random.gaussian(), 0.04 * random.gaussian()];
            let pose = Pose {
                position_ned_m: [place.north, place.east, 0.0],
                roll_rad: tilt_rad[0],
                pitch_rad: tilt_rad[1],
                yaw_rad,
            };
            let paths = rays::paths(&scene.walls, scene.source, *place, rays::ORDER_MAX, LOSS_MAX_DB);
            let time = Instant((1e6 * (1.0 + step_s * index as f64)) as u64);
            let snapshot = receive(&antennas, scene, &paths, &pose, time, random);
            let phasors = self.extractor.step(&mut heard, &snapshot);
            let bearing = self.estimator.estimate(&phasors);
            let told_yaw_rad = wrap_pi(yaw_rad + yaw_bias_rad + 0.005 * random.gaussian()) as f32;
            let place_ned_m = Horizontal { north: place.north * odometry, east: place.east * odometry }.to_core();
            let bearing_ned_rad = bearing.valid.then_some(bearing.azimuth_rad + told_yaw_rad);
            let look = |sightline| Features { place_ned_m, bearing: &bearing, bearing_ned_rad, sightline };
            let seen =
                bearing_ned_rad.map_or(Sightline::Clear, |angle| Sightline::among(&known, place.to_core(), angle, 0.2));
            let _ = Classifier::TRAINED.step(&mut blind, &look(Sightline::Unknown));
            let _ = Classifier::TRAINED.step(&mut mapped, &look(seen));
            let (class, lead_db) = truth(scene, &paths);
            truths.push(class);
            if index % EVERY == 0
                && let (Some(blind), Some(mapped)) = (blind.features(), mapped.features())
            {
                let is_fresh = truths[index.saturating_sub(foxhound_core::localize::link_state::WINDOW)..]
                    .iter()
                    .any(|c| *c != class);
                samples.push(Sample { blind, mapped, class, lead_db, is_fresh });
            }
        }
        samples
    }
}

/// Where the vehicle flies: straight on or in a curve, until a wall or the beacon is near; or it hovers.
fn course(scene: &Scene, random: &mut Random) -> Vec<Horizontal> {
    let mut longest = Vec::new();
    // Most places see the beacon: every other leg begins where that is not so, if there is such a place.
    let hidden = random.uniform() < 0.6;
    for attempt in 0..30 {
        let mut place = Horizontal {
            north: within(random, 0.4, scene.size_m[0] - 0.4),
            east: within(random, 0.4, scene.size_m[1] - 0.4),
        };
        let paths = rays::paths(&scene.walls, scene.source, place, rays::ORDER_MAX, LOSS_MAX_DB);
        if hidden && attempt < 25 && matches!(truth(scene, &paths).0, 0 | 3) {
            continue;
        }
        let mut heading_rad = within(random, -PI, PI);
        let curve_rad = if random.uniform() < 0.5 { 0.0 } else { 0.03 * random.gaussian() };
        let step_m = if random.uniform() < 0.07 { 0.01 } else { STEP_M };
        let mut places = Vec::new();
        while places.len() < LOOKS
            && scene.clearance_m(place) > 0.3
            && place.minus(scene.source).norm() > 1.5
            && (0.0..scene.size_m[0]).contains(&place.north)
            && (0.0..scene.size_m[1]).contains(&place.east)
        {
            places.push(place);
            heading_rad += curve_rad;
            place = place.along(Horizontal::from_bearing(heading_rad), step_m);
        }
        if places.len() > longest.len() {
            longest = places;
        }
        if longest.len() > 30 {
            break;
        }
    }
    longest
}

/// Antennas whose calibration is good, not perfect.
fn antennas(scene: &Scene, random: &mut Random) -> Antennas {
    Antennas {
        fall_off_from_m: Some(1.0),
        snr_db: Some(scene.snr_at_1m_db),
        gain_control: false,
        channel_gain: [0; 4].map(|_| 1.0 + 0.03 * random.gaussian()),
        channel_phase_rad: [0; 4].map(|_| 0.02 * random.gaussian()),
        ..Antennas::default()
    }
}

/// Most walls, not quite where they are.
fn known_walls(scene: &Scene, random: &mut Random) -> Vec<Wall> {
    let share = within(random, 0.6, 1.0);
    let walls = scene.walls.iter().filter_map(|wall| {
        let known = random.uniform() < share;
        let [a, b] = [wall.from, wall.to].map(|end| Horizontal {
            north: end.north + 0.1 * random.gaussian(),
            east: end.east + 0.1 * random.gaussian(),
        });
        Wall::between(a.to_core(), b.to_core()).filter(|_| known)
    });
    walls.collect()
}

/// One frame of all paths: the strongest stands for the beacon, the others for its reflections.
fn receive(
    antennas: &Antennas,
    scene: &Scene,
    paths: &[Path],
    pose: &Pose,
    time: Instant,
    random: &mut Random,
) -> foxhound_core::base::adc::AdcFrame<N> {
    let image = |path: &Path| [path.image.north, path.image.east, -scene.source_above_m];
    let loss_db = paths.first().map_or(200.0, |path| path.loss_db);
    let reflections = paths.iter().skip(1).filter(|path| path.loss_db < loss_db + 40.0);
    let heard = Antennas {
        // Both fall by as much, so that the noise stays.
        amplitude_codes: antennas.amplitude_codes * libm::pow(10.0, -loss_db / 20.0),
        snr_db: antennas.snr_db.map(|snr_db| snr_db - loss_db),
        impairments: Impairments {
            reflections: reflections
                .map(|path| Reflection { image_ned_m: image(path), level_db: loss_db - path.loss_db })
                .collect(),
            ..Impairments::default()
        },
        ..antennas.clone()
    };
    let source_ned_m = paths.first().map_or([TAU, 0.0, 0.0], image);
    heard.frame(time, pose, source_ned_m, random)
}

/// The class of the strongest path, and by how much it leads that of any other class.
fn truth(scene: &Scene, paths: &[Path]) -> (usize, f64) {
    let class = |path: &Path| path.order.min(2);
    let Some(first) = paths.first() else { return (3, LOSS_MAX_DB) };
    let snr_db = scene.snr_at_1m_db + first.gain_db();
    if snr_db < NONE_BELOW_DB {
        return (3, NONE_BELOW_DB - snr_db);
    }
    let other = paths.iter().find(|path| class(path) != class(first));
    (class(first), other.map_or(LOSS_MAX_DB, |other| first.gain_db() - other.gain_db()))
}
