//! Seeking with an antenna that turns with the vehicle ([`rotating`]), if no array gives a direction.
//!
//! Either there is only one directional antenna, or there are four of which fewer than three work: the remaining ones
//! have no phases to compare, but each still receives more from its front than from its back. While the seeker is in
//! use the vehicle yaws at a constant rate, and each full turn gives one sighting, from the vehicle's position in the middle of
//! it. The belief ([`Localizer::observe_rotation`]) answers with the source's bearing as of now, which is then treated
//! as any bearing.
//!
//! [`Localizer::observe_rotation`]: crate::localize::belief::Localizer::observe_rotation
//!
//! One bearing a turn is rare. So the last one stays valid for two turns, or [`MISSION_TURNS`] with some slack; only
//! then does the mission report that there is no signal. It is not repeated in between: repetitions would be taken
//! for new measurements.
//!
//! The obstacle sensor on the nose sweeps the whole circle with every turn, so that every place that the guard needs
//! to see is seen within one turn, and the nose need not be turned there.

use crate::base::adc::CHANNELS;
use crate::base::error::{ConfigError, Why, check};
use crate::base::ned::Horizontal;
use crate::base::ownship::Ownship;
use crate::base::time::Instant;
use crate::control::track::Demand;
use crate::doa::bearing::{Bearing, Flags};
use crate::doa::rotating::{self, Outcome, Rotation};
use crate::guidance::mission::{self, Mission};
use crate::localize::source::Sighting;
use crate::signal::phase::{HOLD_THRESHOLD, Phasors, Tone};

/// A bearing stays valid for this many turns.
pub const MISSION_TURNS: f32 = 2.2;
/// The slowest turn. A rotation must end within the longest, with a fifth to spare.
const YAW_RATE_MIN_RADPS: f32 = 0.4;
const _: () = assert!(core::f32::consts::TAU / YAW_RATE_MIN_RADPS <= 0.8 * rotating::ROTATION_MAX_S);
/// Bearings in a row that lack channels before the vehicle starts to turn: a fifth of a second.
const PATIENCE: u8 = 10;
/// A reading with an older attitude cannot be assigned to a bin.
const ATTITUDE_AGE_MAX_S: f32 = 0.2;
/// A rotation whose powers differ by this factor more than the antenna's pattern, or that fits this badly, is one in
/// which the source started or stopped transmitting.
const CONTRAST_MAX: f32 = 1.25;
const SIGMA_MAX_RAD: f32 = 0.5;
/// What a rotation errs by, over what the fit of the pattern says: the attitude is late, and the vehicle moves on
/// meanwhile. With 1, a filter that started wrong held out against the right bearings.
const DOUBT: f32 = 2.0;
/// Channels that an array needs.
const LIVING_MIN: usize = 3;
/// Reflections that make so many rotations in a row ambiguous make the next ones so as well. Elsewhere they are others, so that a
/// vehicle with one directional antenna goes on as without a signal; what is left of an array may have no direction anywhere.
const AMBIGUOUS_MAX: u8 = 3;
/// `10 / ln 10`.
const DB: f32 = 4.342_945;

/// When the vehicle turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Role {
    /// Always: there is only one antenna, on this channel, 0..4.
    Alone(u8),
    /// While fewer than three channels of the array work: the first of them is used.
    #[default]
    Fallback,
}

/// Configuration of the turning.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// When the vehicle turns.
    pub role: Role,
    /// Direction of each channel's antenna, from the nose, clockwise positive.
    pub boresights_rad: [f32; CHANNELS],
    /// How fast it turns; negative to the left.
    pub yaw_rate_radps: f32,
    /// From power to rotations.
    pub rotating: rotating::Config,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            role: Role::Fallback,
            boresights_rad: [0.0; CHANNELS],
            yaw_rate_radps: 1.2,
            rotating: rotating::Config::default(),
        }
    }
}

impl Config {
    /// Checks the configuration, with the mission's configuration for flight without turning.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self, mission: &mission::Config, yaw_rate_max_radps: f32) -> Result<Turning, ConfigError> {
        if let Role::Alone(channel) = self.role {
            check("turning.role", f32::from(channel), 0.0, (CHANNELS - 1) as f32)?;
        }
        for boresight_rad in self.boresights_rad {
            check("turning.boresights_rad", boresight_rad, -6.3, 6.3)?;
        }
        let speed_radps = libm::fabsf(self.yaw_rate_radps);
        check("turning.yaw_rate_radps", speed_radps, YAW_RATE_MIN_RADPS, 6.3)?;
        if speed_radps > yaw_rate_max_radps {
            let why = Why::Inconsistent("exceeds the guard's yaw rate limit");
            return Err(ConfigError { field: "turning.yaw_rate_radps", value: self.yaw_rate_radps, why });
        }
        let turn_s = core::f32::consts::TAU / speed_radps;
        let patience_s = MISSION_TURNS * turn_s;
        let mission = mission::Config {
            bearing_age_max_s: if patience_s > mission.bearing_age_max_s {
                patience_s
            } else {
                mission.bearing_age_max_s
            },
            stall_s: mission.stall_s + patience_s,
            ..*mission
        };
        Ok(Turning {
            role: self.role,
            boresights_rad: self.boresights_rad,
            yaw_rate_radps: self.yaw_rate_radps,
            contrast_max_db: CONTRAST_MAX
                * (self.rotating.pattern.gain_db(0.0) - self.rotating.pattern.gain_db(core::f32::consts::PI)),
            seeker: self.rotating.build()?,
            mission: mission.build()?,
        })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turning {
    role: Role,
    boresights_rad: [f32; CHANNELS],
    yaw_rate_radps: f32,
    contrast_max_db: f32,
    seeker: rotating::Seeker,
    /// The mission's limits while the vehicle turns.
    pub mission: Mission,
}

/// The rotation in progress, and the information from those before.
#[derive(Clone, Debug, Default)]
pub struct State {
    rotating: rotating::State,
    /// The channel in use.
    channel: u8,
    /// Bearings in a row that lacked channels.
    lacking: u8,
    /// Ambiguous rotations since the last direction.
    ambiguous: u8,
    /// Where the rotation in progress began.
    from_ned_m: Option<Horizontal>,
    /// The middle of the last rotation with a signal.
    heard: Option<Instant>,
}

/// The result of a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turned {
    /// A direction, and the sighting from the middle of the rotation.
    Direction(Rotation, Sighting),
    /// No direction, and why.
    Nothing(Flags),
}

impl Turning {
    /// Whether the seeker is in use, as of the last bearing.
    #[must_use]
    pub fn is_used(&self, state: &State) -> bool {
        match self.role {
            Role::Alone(_) => true,
            Role::Fallback => state.lacking >= PATIENCE,
        }
    }

    /// A demand with the yaw rate of the turning instead of its own.
    #[must_use]
    pub fn turn(&self, demand: Demand) -> Demand {
        Demand { yaw_rate_radps: self.yaw_rate_radps, ..demand }
    }

    /// Takes the array's bearing of a frame; true if it is unusable and the seeker has to be used.
    pub fn notice(&self, state: &mut State, bearing: &Bearing) -> bool {
        match self.role {
            Role::Alone(channel) => state.channel = channel,
            Role::Fallback => self.count_living(state, bearing),
        }
        self.is_used(state)
    }

    fn count_living(&self, state: &mut State, bearing: &Bearing) {
        let lives = |channel: &usize| !bearing.flags.contains(Flags::dead(*channel));
        if bearing.valid || (0..CHANNELS).filter(lives).count() >= LIVING_MIN {
            // Silence gives no information about the channels.
            if !bearing.flags.contains(Flags::NO_SIGNAL) {
                state.lacking = 0;
            }
            return;
        }
        let is_new = state.lacking < PATIENCE;
        state.lacking = state.lacking.saturating_add(1).min(PATIENCE);
        let first = (0..CHANNELS).find(lives).unwrap_or(0) as u8;
        if is_new || bearing.flags.contains(Flags::dead(usize::from(state.channel))) {
            // Another antenna needs a new rotation, and so does a return after a while with the array.
            *state = State { lacking: state.lacking, channel: first, ..State::default() };
        }
    }

    /// Takes the power of a frame, or the bearing made elsewhere; returns the result of a rotation that ends with it.
    pub fn step(
        &self,
        state: &mut State,
        bearing: &Bearing,
        phasors: Option<&Phasors>,
        ownship: &Ownship,
    ) -> Option<Turned> {
        let time = bearing.time;
        if time.seconds_since(ownship.attitude_time) > ATTITUDE_AGE_MAX_S {
            return None;
        }
        let here = ownship.position_ned_m.horizontal();
        let from = *state.from_ned_m.get_or_insert(here);
        let channel = usize::from(state.channel);
        let power_db = phasors.map_or(bearing.quality.snr_db, |phasors| power_db(phasors, channel));
        let boresight_rad = self.boresights_rad.get(channel).copied().unwrap_or(0.0);
        let antenna_rad = ownship.yaw_at(time) + boresight_rad;
        let outcome = self.seeker.step(&mut state.rotating, time, antenna_rad, power_db)?;
        state.from_ned_m = Some(here);
        let Outcome::Rotation(rotation) = outcome else { return Some(Turned::Nothing(Flags::NO_SIGNAL)) };
        if rotation.ambiguous {
            state.ambiguous = state.ambiguous.saturating_add(1);
            let goes_on = state.ambiguous > AMBIGUOUS_MAX && matches!(self.role, Role::Alone(_));
            return Some(Turned::Nothing(if goes_on { Flags::NO_SIGNAL } else { Flags::AMBIGUOUS }));
        }
        if rotation.contrast_db > self.contrast_max_db || rotation.independent_sigma_rad() > SIGMA_MAX_RAD {
            // Nor may the next one use it.
            state.rotating = rotating::State::new();
            return Some(Turned::Nothing(Flags::NO_SIGNAL));
        }
        state.ambiguous = 0;
        let place_ned_m = from.plus(here).times(0.5);
        let since_s = state.heard.replace(rotation.time).map_or(0.0, |heard| rotation.time.seconds_since(heard));
        let direction_ned = Horizontal::from_bearing(rotation.bearing_ned_rad);
        let sigma_rad = DOUBT * rotation.independent_sigma_rad();
        Some(Turned::Direction(rotation, Sighting { place_ned_m, direction_ned, sigma_rad, since_s }))
    }
}

/// Power of a channel's tone, or half of the power below which it is not detected: a tone that is lost while the
/// antenna points away must not leave a gap.
fn power_db(phasors: &Phasors, channel: usize) -> f32 {
    // The tone is detected in the mean of all channels, and the others may be dead.
    let unheard = 0.5 * HOLD_THRESHOLD * CHANNELS as f32 * phasors.noise.get(channel).copied().unwrap_or(0.0);
    let tone = match phasors.tone {
        Tone::Present => phasors.z.get(channel).map_or(0.0, |z| z.norm_squared()),
        Tone::Absent => 0.0,
    };
    let power = if tone > unheard { tone } else { unheard };
    DB * libm::logf(if power > 1e-9 { power } else { 1e-9 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::sqrt;
    use crate::base::ned::Ned;
    use crate::base::rng::Rng;
    use crate::base::units::wrap_pi;
    use crate::doa::bearing::Quality;
    use crate::localize::belief::{self, Localizer};
    use crate::localize::source::bank;
    use crate::signal::phase::Complex;
    use std::vec::Vec;

    const DT_S: f32 = 0.02;
    /// Amplitude on boresight, and noise of a phasor: 40 dB apart.
    const AMPLITUDE: f32 = 1000.0;
    const NOISE: f32 = 1e2;

    /// The belief's answer to a rotation, and the rotation's sighting.
    #[derive(Debug)]
    struct Heard {
        bearing: Bearing,
        sighting: Option<Sighting>,
    }

    /// A vehicle that turns while it flies from the origin to the north, past a source.
    struct Flight {
        turning: Turning,
        localizer: Localizer,
        belief: belief::State,
        pattern: rotating::pattern::Config,
        state: State,
        rng: Rng,
        tick: u64,
        speed_mps: f32,
        yaw_rate_radps: f32,
        source: Horizontal,
        boresight_rad: f32,
        noise: f32,
    }

    impl Flight {
        fn new(config: &Config, source: Horizontal) -> Self {
            Self {
                turning: config.build(&mission::Config::default(), 2.5).unwrap(),
                localizer: Localizer::build(&bank::Config::default(), false, false).unwrap(),
                belief: belief::State::default(),
                pattern: config.rotating.pattern,
                state: State::default(),
                rng: Rng::new(7, 3),
                tick: 0,
                speed_mps: 0.0,
                yaw_rate_radps: config.yaw_rate_radps,
                source,
                boresight_rad: 0.0,
                noise: NOISE,
            }
        }

        fn ownship(&self) -> Ownship {
            let time = Instant(1_000_000 + self.tick * 20_000);
            let at_s = self.tick as f32 * DT_S;
            Ownship {
                position_time: time,
                position_ned_m: Ned { north: self.speed_mps * at_s, east: 0.0, down: -2.0 },
                velocity_ned_mps: Ned { north: self.speed_mps, east: 0.0, down: 0.0 },
                attitude_time: time,
                yaw_rad: wrap_pi(self.yaw_rate_radps * at_s),
                yaw_rate_radps: self.yaw_rate_radps,
                ..Ownship::default()
            }
        }

        /// One frame with these channels working; whether the seeker is in use, and what a rotation gives.
        fn frame(&mut self, living: &[usize], sounds: bool) -> (bool, Option<Heard>) {
            self.tick += 1;
            let ownship = self.ownship();
            let towards_rad = self.source.minus(ownship.position_ned_m.horizontal()).bearing_rad();
            let gain_db = self.pattern.gain_db(towards_rad - ownship.yaw_rad - self.boresight_rad);
            let amplitude = AMPLITUDE * libm::expf(0.5 * gain_db / DB);
            let mut phasors = Phasors {
                time: ownship.attitude_time,
                z: [Complex::default(); CHANNELS],
                noise: [self.noise; CHANNELS],
                snr_db: 0.0,
                frequency_hz: 1e4,
                tone: if sounds { Tone::Present } else { Tone::Absent },
                clipped: false,
                interferer: false,
            };
            let sigma = sqrt(0.5 * self.noise);
            for channel in living.iter().filter(|_| sounds) {
                phasors.z[*channel] =
                    Complex { re: amplitude + sigma * self.rng.gaussian(), im: sigma * self.rng.gaussian() };
            }
            let mut flags = if sounds { Flags::default() } else { Flags::NO_SIGNAL };
            for channel in (0..CHANNELS).filter(|channel| sounds && !living.contains(channel)) {
                flags = flags.with(Flags::dead(channel));
            }
            let without = Bearing::without(ownship.attitude_time, Quality::default(), flags);
            let bearing = Bearing { valid: sounds && living.len() >= LIVING_MIN, sigma_rad: 0.01, ..without };
            let is_used = self.turning.notice(&mut self.state, &bearing);
            let turned =
                is_used.then(|| self.turning.step(&mut self.state, &bearing, Some(&phasors), &ownship)).flatten();
            let heard = turned.map(|turned| match turned {
                Turned::Nothing(flags) => {
                    Heard { bearing: Bearing::without(bearing.time, bearing.quality, flags), sighting: None }
                }
                Turned::Direction(rotation, sighting) => {
                    let belief = &mut self.belief;
                    let (bearing, _) = self.localizer.observe_rotation(belief, &rotation, &sighting, &ownship, &[]);
                    Heard { bearing, sighting: Some(sighting) }
                }
            });
            (is_used, heard)
        }

        fn frames(&mut self, count: usize, living: &[usize], sounds: bool) -> Vec<Heard> {
            (0..count).filter_map(|_| self.frame(living, sounds).1).collect()
        }
    }

    fn alone() -> Config {
        Config { role: Role::Alone(0), ..Config::default() }
    }

    fn error_rad(flight: &Flight, turned: &Heard) -> f32 {
        let ownship = flight.ownship();
        let truth_rad = flight.source.minus(ownship.position_ned_m.horizontal()).bearing_rad();
        wrap_pi(ownship.bearing_ned_rad(turned.bearing.azimuth_rad, 0.0, turned.bearing.time) - truth_rad)
    }

    #[test]
    fn every_turn_is_a_bearing_within_its_sigma_either_way_round_and_wherever_the_antenna_points() {
        for (yaw_rate_radps, boresight_rad) in [(1.2, 0.0), (-1.2, 0.0), (0.8, 2.0), (2.0, -1.0)] {
            let config = Config { yaw_rate_radps, boresights_rad: [boresight_rad, 0.0, 0.0, 0.0], ..alone() };
            let mut flight = Flight::new(&config, Horizontal { north: -6.0, east: 8.0 });
            flight.boresight_rad = boresight_rad;
            let mut count = 0;
            for _ in 0..1600 {
                let Some(turned) = flight.frame(&[0], true).1 else { continue };
                count += 1;
                let error = error_rad(&flight, &turned);
                // Whether the first one is an outlier is unknown.
                let most_rad = if count == 1 { 0.6 } else { 0.15 };
                assert!(turned.bearing.valid && turned.bearing.sigma_rad < most_rad, "{turned:?}");
                assert!(libm::fabsf(error) < 3.0 * turned.bearing.sigma_rad, "{yaw_rate_radps}: {error} {turned:?}");
                assert!(libm::fabsf(error) < 0.05, "{yaw_rate_radps}: {error}");
            }
            let turns = 32.0 * libm::fabsf(yaw_rate_radps) / core::f32::consts::TAU;
            assert!((count as f32 - turns).abs() < 1.5, "{yaw_rate_radps}: {count} of {turns}");
        }
    }

    #[test]
    fn a_bearing_is_of_now_and_its_sighting_of_the_middle_of_the_turn() {
        let mut flight = Flight::new(&alone(), Horizontal { north: 6.0, east: 6.0 });
        flight.speed_mps = 0.25;
        let (mut carried, mut stale, mut count) = (0.0, 0.0, 0.0);
        for _ in 0..1500 {
            let before = flight.state.from_ned_m;
            let Some(turned) = flight.frame(&[0], true).1 else { continue };
            let (here, sighting) = (flight.ownship().position_ned_m.horizontal(), turned.sighting.unwrap());
            let middle = before.unwrap_or_default().plus(here).times(0.5);
            assert!(sighting.place_ned_m.minus(middle).norm() < 0.02, "{sighting:?}");
            let off_rad = sighting.direction_ned.bearing_rad() - flight.source.minus(middle).bearing_rad();
            assert!(libm::fabsf(wrap_pi(off_rad)) < 0.06, "{off_rad}");
            let late_rad = sighting.direction_ned.bearing_rad() - flight.source.minus(here).bearing_rad();
            // Once it has been seen from two sides.
            if count > 2.0 {
                carried += libm::fabsf(error_rad(&flight, &turned));
                stale += libm::fabsf(wrap_pi(late_rad));
            }
            count += 1.0;
        }
        assert!(count > 4.5 && carried < 0.5 * stale, "{carried} {stale}");
    }

    #[test]
    fn it_falls_back_when_two_channels_die_and_gives_way_when_they_are_back() {
        let mut flight = Flight::new(&Config::default(), Horizontal { north: 5.0, east: -8.0 });
        for living in [&[0, 1, 2, 3][..], &[0, 1, 3], &[1, 2, 3]] {
            for _ in 0..400 {
                assert!(!flight.frame(living, true).0);
            }
        }
        // A short loss is no reason, and neither is silence.
        assert!(!flight.frame(&[1, 3], true).0 && !flight.frame(&[0, 1, 2, 3], true).0);
        assert!(flight.frames(400, &[0, 1, 2, 3], false).is_empty() && !flight.turning.is_used(&flight.state));
        let turns = flight.frames(700, &[1, 3], true);
        assert!(turns.len() == 2 && turns.iter().all(|turned| turned.bearing.valid), "{turns:?}");
        assert_eq!(flight.state.channel, 1);
        let heard_rad = turns[1].sighting.unwrap().direction_ned.bearing_rad();
        assert!(libm::fabsf(wrap_pi(heard_rad - flight.source.bearing_rad())) < 0.08, "{heard_rad}");
        // The channel in use dies as well: the other one's rotation starts afresh.
        assert!(flight.frame(&[3], true).0);
        assert_eq!((flight.state.channel, flight.state.heard), (3, None));
        // Silence does not bring channels back.
        flight.frames(20, &[3], false);
        assert!(flight.turning.is_used(&flight.state));
        assert!(!flight.frame(&[0, 1, 3], true).0);
    }

    #[test]
    fn silence_is_no_direction_and_neither_is_a_source_that_falls_silent_on_the_way() {
        for sounding in [0, 60, 130, 200] {
            let mut flight = Flight::new(&alone(), Horizontal { north: 5.0, east: 5.0 });
            flight.frames(sounding, &[0], true);
            let turns = flight.frames(1400, &[0], false);
            assert!(turns.len() >= 4, "{sounding}");
            for turned in &turns {
                assert!(!turned.bearing.valid && turned.sighting.is_none(), "{sounding}: {turned:?}");
                assert!(turned.bearing.flags.contains(Flags::NO_SIGNAL), "{sounding}");
            }
        }
    }

    #[test]
    fn a_tone_that_is_lost_whenever_the_antenna_looks_away_still_has_a_direction() {
        let mut flight = Flight::new(&alone(), Horizontal { north: 5.0, east: 5.0 });
        // 24 dB.
        flight.noise = 4e3;
        let mut count = 0;
        for _ in 0..1400 {
            let ahead = libm::fabsf(wrap_pi(flight.source.bearing_rad() - flight.ownship().yaw_rad)) < 1.5;
            let Some(turned) = flight.frame(&[0], ahead).1 else { continue };
            count += 1;
            assert!(turned.bearing.valid && libm::fabsf(error_rad(&flight, &turned)) < 0.1, "{turned:?}");
        }
        assert!(count >= 4);
    }

    #[test]
    fn an_antenna_that_hears_the_same_all_round_has_no_direction() {
        let mut flight = Flight::new(&alone(), Horizontal { north: 5.0, east: 5.0 });
        flight.pattern.front_to_back_db = -60.0;
        let turns = flight.frames(1400, &[0], true);
        assert!(turns.len() >= 4 && turns.iter().all(|turned| !turned.bearing.valid), "{turns:?}");
    }

    #[test]
    fn the_mission_waits_for_two_turns() {
        let turning = alone().build(&mission::Config::default(), 2.5).unwrap();
        let outcome = |age_s: f32| {
            let now = Instant(100_000_000);
            let input = mission::Input {
                now,
                control: mission::Control::Granted,
                position: Some(now),
                attitude: Some(now),
                contradiction: None,
                obstacles: Some(now),
                bearing: Some(Instant(now.0 - (age_s * 1e6) as u64)),
                bearing_flags: Flags::NO_SIGNAL,
                is_plan_late: false,
                is_arriving: false,
                place_ned_m: Horizontal::default(),
                source_ned_m: None,
            };
            turning.mission.admit(&mut mission::State::default(), &input)
        };
        assert_eq!((outcome(10.5), outcome(12.0)), (mission::Outcome::Nominal, mission::Outcome::NoSignal));
    }

    #[test]
    fn what_is_out_of_range_is_refused_by_name_and_the_state_is_small() {
        let refused = |change: &dyn Fn(&mut Config)| {
            let mut config = Config::default();
            change(&mut config);
            config.build(&mission::Config::default(), 2.5).unwrap_err().field
        };
        assert_eq!(refused(&|config| config.role = Role::Alone(4)), "turning.role");
        assert_eq!(refused(&|config| config.boresights_rad[2] = f32::NAN), "turning.boresights_rad");
        for yaw_rate_radps in [0.0, f32::NAN, 2.6, -2.6, 0.35] {
            assert_eq!(refused(&|config| config.yaw_rate_radps = yaw_rate_radps), "turning.yaw_rate_radps");
        }
        assert_eq!(refused(&|config| config.rotating.memory = 1.0), "rotating.memory");
        let bytes = size_of::<State>();
        assert!(bytes <= 960, "{bytes}");
    }
}
