//! The input of the direction finding in a flight: bearings with noise, lines of a radio with such, or the antennas' waveforms.

use std::f64::consts::TAU;

use foxhound_computer::iq::ARRAY;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::{self, Flags};
use foxhound_core::guidance::FrontEnd;

use super::{Mission, SIGMA_FLOOR_RAD};
use crate::drive::computer::BLOCK;
use crate::scenario::{BearingModel, OtherBeacon, Pulses, inside};
use crate::world::antennas::{Antennas, Fault, Interferer, Pattern, Reflection};
use crate::world::iq;
use crate::world::random::Random;
use crate::world::{Horizontal, Pose, World, horizontal, rays, wrap_pi};

/// The simulated receiver of a flight.
pub(super) struct Receiver<'a> {
    mission: &'a Mission,
    antennas: Antennas,
    random: Random,
    /// Time of the next bearing of a slow radio.
    due_s: f64,
    /// A Bluetooth controller has said whose packets it reports.
    is_synchronised: bool,
}

/// The reception of one step.
pub(super) enum Reception {
    Frame(Box<foxhound_core::base::adc::AdcFrame<BLOCK>>),
    Bearing(bearing::Bearing),
    /// Bytes of a radio on the computer's own line.
    Line(Vec<u8>),
    Nothing,
}

impl Reception {
    pub(super) fn front_end(&self) -> FrontEnd<'_, BLOCK> {
        match self {
            Self::Frame(snapshot) => FrontEnd::Frame(snapshot),
            Self::Bearing(bearing) => FrontEnd::Bearing(*bearing),
            Self::Line(_) | Self::Nothing => FrontEnd::Nothing,
        }
    }
}

impl Reception {
    /// The samples, if there are any.
    pub(super) fn frame(&self) -> Option<&foxhound_core::base::adc::AdcFrame<BLOCK>> {
        match self {
            Self::Frame(snapshot) => Some(snapshot),
            Self::Bearing(_) | Self::Line(_) | Self::Nothing => None,
        }
    }

    /// The bytes of a radio, if there are any.
    pub(super) fn line(&self) -> Option<&[u8]> {
        match self {
            Self::Line(line) => Some(line),
            _ => None,
        }
    }
}

impl<'a> Receiver<'a> {
    pub(super) fn new(mission: &'a Mission) -> Self {
        let snr_db = mission.scenario.bearing.snr_db.unwrap_or(DEFAULT_SNR_DB);
        let pattern = mission.scenario.antenna.map(|antenna| Pattern {
            exponent: antenna.exponent,
            front_to_back_db: antenna.front_to_back_db,
            boresights_rad: antenna.boresight_deg.map(f64::to_radians),
        });
        let mut antennas = Antennas { snr_db: Some(snr_db), pattern, ..Antennas::default() };
        antennas.impairments.pulses = mission.scenario.bearing.pulses.map(Pulses::at_antennas);
        Self { mission, antennas, random: Random::new(mission.seed, 1), due_s: 0.0, is_synchronised: false }
    }

    pub(super) fn receive(&mut self, world: &World, vehicle: &Pose, now: Instant, time_s: f64) -> Reception {
        match (self.hear(world, vehicle, now, time_s), self.mission.scenario.bearing_model()) {
            (Reception::Bearing(bearing), BearingModel::Uudf) => {
                self.uudf(&bearing).map_or(Reception::Nothing, |line| Reception::Line(line.into_bytes()))
            }
            (Reception::Bearing(bearing), BearingModel::Hci) => Reception::Line(self.report(&bearing)),
            (heard, _) => heard,
        }
    }

    /// The IQ report of a packet from there, in front of the first that of whose it is.
    fn report(&mut self, bearing: &bearing::Bearing) -> Vec<u8> {
        let is_known = std::mem::replace(&mut self.is_synchronised, true);
        let mut bytes = if is_known { Vec::new() } else { iq::synchronised(HANDLE, self.address()) };
        bytes.extend(iq::report(&ARRAY, HANDLE, self.off_zero_rad(bearing), OFFSET_HZ));
        bytes
    }

    /// The line of a radio that has measured this; `None` behind it.
    fn uudf(&self, bearing: &bearing::Bearing) -> Option<String> {
        let azimuth_deg = self.off_zero_rad(bearing).to_degrees();
        let (address, time_ms) = (self.address(), bearing.time.0 / 1000);
        (azimuth_deg.abs() <= 90.0)
            .then(|| format!("+UUDF:{address:012X},-56,{azimuth_deg:.0},0,0,37,\"6C1DEBA79D14\",\"\",{time_ms},0\r\n"))
    }

    /// From the radio's zero, which need not be the nose.
    fn off_zero_rad(&self, bearing: &bearing::Bearing) -> f64 {
        let mount_rad = self.mission.scenario.bearing.mount_deg.to_radians();
        if mount_rad == 0.0 { bearing.azimuth_rad.into() } else { wrap_pi(f64::from(bearing.azimuth_rad) - mount_rad) }
    }

    /// Of the beacon.
    fn address(&self) -> u64 {
        match self.mission.scenario.bearing.tag {
            0 => ADDRESS,
            tag => (ADDRESS & !0xFF_FFFF) | u64::from(tag),
        }
    }

    fn hear(&mut self, world: &World, vehicle: &Pose, now: Instant, time_s: f64) -> Reception {
        let scenario = &self.mission.scenario;
        let settings = &scenario.bearing;
        let from = horizontal(vehicle);
        let to_source = world.source_at(time_s).minus(from);
        let is_outlier = settings.outlier.rate > 0.0 && self.random.uniform() < settings.outlier.rate;
        let offset_rad = match is_outlier {
            true if settings.outlier.anywhere => TAU * self.random.uniform(),
            true => settings.outlier.offset_deg.to_radians(),
            false => 0.0,
        };
        let bias_rad = place_bias(self.mission.seed, from) * settings.place_bias_deg.to_radians();
        let bearing_ned_rad = to_source.bearing_rad() + offset_rad + bias_rad;
        if inside(scenario.faults.nan_bearing, time_s) {
            return Reception::Bearing(bearing_of(now, f64::NAN, SIGMA_FLOOR_RAD));
        }
        let is_between = settings.pulses.is_some_and(|pulses| !pulses.at_antennas().sounds(time_s));
        let is_silent = inside(settings.dropout, time_s) || is_between && scenario.bearing_model() != BearingModel::Rf;
        let other = |beacon: &OtherBeacon| Interferer {
            tone_hz: self.antennas.tone_hz + beacon.offset_hz,
            azimuth_ned_rad: Horizontal::from_xy([beacon.x, beacon.y]).minus(from).bearing_rad(),
            elevation_rad: 0.0,
            level_db: beacon.level_db,
        };
        self.antennas.impairments.interferers = scenario.other_beacons.iter().map(other).collect();
        let is_single = scenario.antenna.is_some_and(|antenna| antenna.single);
        self.antennas.impairments.faults = std::array::from_fn(|channel| {
            let is_dead = inside(scenario.faults.dead_channels[channel], time_s) || is_single && channel > 0;
            if is_dead { Fault::Dead } else { Fault::None }
        });
        let is_line = matches!(scenario.bearing_model(), BearingModel::Uudf | BearingModel::Hci);
        if let Some(rate_hz) = settings.rate_hz.or_else(|| is_line.then_some(RADIO_HZ)) {
            if time_s < self.due_s {
                return Reception::Nothing;
            }
            self.due_s = (self.due_s + 1.0 / rate_hz).max(time_s);
        }
        match scenario.bearing_model() {
            _ if !world.walls.is_empty() => self.receive_among_walls(world, vehicle, now, time_s, is_silent),
            BearingModel::Noise | BearingModel::Uudf | BearingModel::Hci if is_silent => Reception::Nothing,
            BearingModel::Noise | BearingModel::Uudf | BearingModel::Hci => {
                let sigma_rad = settings.sigma_deg.to_radians();
                let azimuth_rad = bearing_ned_rad - vehicle.yaw_rad + sigma_rad * self.random.gaussian();
                // The sigma includes the bias, as found by a calibration at many places.
                let told_rad = libm::hypot(sigma_rad, settings.place_bias_deg.to_radians());
                let mut bearing = bearing_of(now, wrap_pi(azimuth_rad), told_rad.max(SIGMA_FLOOR_RAD));
                if settings.place_bias_deg > 0.0 {
                    bearing.flags = Flags::ALIKE;
                }
                Reception::Bearing(bearing)
            }
            BearingModel::Rf => {
                let apparent = from.along(Horizontal::from_bearing(bearing_ned_rad), to_source.norm());
                let source = [apparent.north, apparent.east, world.source_down_m];
                self.antennas.channel_gain = [if is_silent { 0.0 } else { 1.0 }; 4];
                Reception::Frame(Box::new(self.antennas.frame(now, vehicle, source, &mut self.random)))
            }
        }
    }
}

impl Receiver<'_> {
    /// By all the paths of a wave among walls. The receiver's gain follows the strongest one; the scenario's
    /// signal-to-noise ratio is that at [`REFERENCE_M`].
    fn receive_among_walls(
        &mut self,
        world: &World,
        vehicle: &Pose,
        now: Instant,
        time_s: f64,
        is_silent: bool,
    ) -> Reception {
        let settings = &self.mission.scenario.bearing;
        let from = horizontal(vehicle);
        let source = world.source_at(time_s);
        let paths = rays::paths(&world.walls, source, from, REFLECTIONS_MAX, LOSS_MAX_DB);
        let Some(strongest) = paths.first() else { return Reception::Nothing };
        let snr_db = settings.snr_db.unwrap_or(DEFAULT_SNR_DB) + strongest.gain_db() + 20.0 * libm::log10(REFERENCE_M);
        match self.mission.scenario.bearing_model() {
            BearingModel::Noise | BearingModel::Uudf | BearingModel::Hci if is_silent || snr_db < SNR_MIN_DB => {
                Reception::Nothing
            }
            BearingModel::Noise | BearingModel::Uudf | BearingModel::Hci => {
                let sigma_rad = settings.sigma_deg.to_radians();
                let heard_rad = strongest.bearing_rad(from) + sigma_rad * self.random.gaussian();
                let mut bearing = bearing_of(now, wrap_pi(heard_rad - vehicle.yaw_rad), sigma_rad.max(SIGMA_FLOOR_RAD));
                bearing.quality.snr_db = snr_db as f32;
                Reception::Bearing(bearing)
            }
            BearingModel::Rf => {
                let place = |at: Horizontal| [at.north, at.east, world.source_down_m];
                let level_db = |path: &rays::Path| path.gain_db() - strongest.gain_db();
                let direct = paths.iter().find(|path| path.order == 0);
                let images = paths.iter().filter(|path| path.order > 0);
                let antennas = &mut self.antennas;
                antennas.snr_db = Some(snr_db.min(SNR_MAX_DB));
                antennas.impairments.direct_level_db = direct.map_or(-2.0 * LOSS_MAX_DB, level_db);
                antennas.impairments.reflections = images
                    .map(|path| Reflection { image_ned_m: place(path.image), level_db: level_db(path) })
                    .collect();
                antennas.channel_gain = [if is_silent { 0.0 } else { 1.0 }; 4];
                Reception::Frame(Box::new(antennas.frame(now, vehicle, place(source), &mut self.random)))
            }
        }
    }
}

/// Lines or packets of the radio a second.
const RADIO_HZ: f64 = 10.0;
/// Of the beacon, for a Bluetooth controller: its handle, its address, and how far its frequency is off.
const HANDLE: u8 = 1;
const ADDRESS: u64 = 0x6C1D_EBA4_1845;
const OFFSET_HZ: f64 = 7e3;

/// A standard normal number that is fixed for each place.
fn place_bias(seed: u64, at: Horizontal) -> f64 {
    let cell = |metres: f64| (metres / PLACE_M).floor() as i64 as u64;
    let number = cell(at.north).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ cell(at.east).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    Random::new(seed ^ number, 7).gaussian()
}

/// Side of a place in which the bias is the same.
const PLACE_M: f64 = 2.0;
/// Largest number of reflections of a path.
const REFLECTIONS_MAX: usize = 3;
/// Paths with a larger loss are ignored.
const LOSS_MAX_DB: f64 = 60.0;
/// The distance to which the signal-to-noise ratio of a scenario with walls refers.
const REFERENCE_M: f64 = 10.0;
/// Largest signal-to-noise ratio, however near.
const SNR_MAX_DB: f64 = 40.0;
/// Below this the noise model receives nothing.
const SNR_MIN_DB: f64 = -5.0;

/// Signal-to-noise ratio of waveforms if the scenario does not give one.
const DEFAULT_SNR_DB: f64 = 20.0;

fn bearing_of(time: Instant, azimuth_rad: f64, sigma_rad: f64) -> bearing::Bearing {
    bearing::Bearing {
        time,
        valid: true,
        azimuth_rad: azimuth_rad as f32,
        sigma_rad: sigma_rad as f32,
        elevation_rad: 0.0,
        elevation_sigma_rad: std::f32::consts::FRAC_PI_2,
        quality: bearing::Quality { snr_db: DEFAULT_SNR_DB as f32, wavenumber: 1.0, ..bearing::Quality::default() },
        flags: Flags::default(),
    }
}
