//! The sending half: setpoints, heartbeats, requests, and telemetry about the search.

use foxhound_core::base::ned::Ned;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::ownship::{Ownship, Stale};
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::{DEG_PER_RAD, sin_cos, wrap_pi};
use foxhound_core::control::guard::Setpoint;
use foxhound_core::guidance;
use foxhound_core::guidance::mission::Outcome;
use foxhound_core::landing::Reason;
use heapless::{Deque, String};

use super::texts::{is_critical, severity, text};
use super::{
    Companion, Pace, Published, SETPOINT_PERIOD_MS, SPEED_MAX_MPS, TIMESYNC_PERIOD_US, TYPE_MASK, TYPE_MASK_YAW,
    YAW_RATE_MAX_RADPS, Yaw,
};
use crate::CharArray;
use crate::autopilot::Autopilot;
use crate::clock::{is_due, is_over};
use crate::dialect::{
    DEBUG_VECT_DATA, HEARTBEAT_DATA, MavAutopilot, MavFrame, MavSeverity, MavState, MavType, NAMED_VALUE_FLOAT_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use crate::failsafe::{Cause, Stream};
use crate::health::Charge;
use crate::landing;
use crate::params::Reply;
use crate::surroundings;

/// With more damaged frames than this the ground station is warned.
const NOISE_WARN_PERCENT: u32 = 5;
/// Warnings that may queue.
const WARNINGS: usize = 4;
/// One value of the list at a time: each of the fifteen every 0.6 s.
const TELEMETRY_PERIOD_US: u32 = 40_000;
static VALUES: [[u8; 10]; 15] = [
    *b"FH_BRG\0\0\0\0",
    *b"FH_SNR\0\0\0\0",
    *b"FH_SIG\0\0\0\0",
    *b"FH_ST\0\0\0\0\0",
    *b"FH_ELV\0\0\0\0",
    *b"FH_RNG\0\0\0\0",
    *b"FH_CNF\0\0\0\0",
    *b"FH_NIS\0\0\0\0",
    *b"FH_RTT\0\0\0\0",
    *b"FH_CRC\0\0\0\0",
    *b"FH_STP\0\0\0\0",
    *b"FH_LATE\0\0\0",
    *b"FH_LOST\0\0\0",
    *b"FH_OB0\0\0\0\0",
    *b"FH_OB1\0\0\0\0",
];
/// Takes the place of the last value where obstacles come from a lidar of our own.
const LIDAR_VALUE: [u8; 10] = *b"FH_LDR\0\0\0\0";
/// Takes the place of the elevation where bearings come from a radio of our own, which gives none.
const RADIO_VALUE: [u8; 10] = *b"FH_RAD\0\0\0\0";
/// Bytes of a `STATUSTEXT`.
pub const NOTICE_BYTES: usize = 50;
/// How the link's own texts begin; a notice brings its own beginning.
pub(crate) const OURS: &str = "Foxhound: ";
/// A state that lasts for less is not reported.
const SETTLED_S: f32 = 0.5;
const TEXT_PERIOD_US: u64 = 1_000_000;
const LANDING_PERIOD_US: u32 = 100_000;
const SURROUNDINGS_PERIOD_US: u64 = 200_000;
/// A bearing older than this is not reported any more.
const BEARING_AGE_MAX_S: f32 = 0.5;
/// A range less certain than this share of it is not sent.
const RANGE_SIGMA_MAX: f32 = 0.5;
/// An outcome that lasts this long is reported again, with advice for the pilot.
const NO_SIGNAL_LONG_S: f32 = 30.0;
const STALE_OBSTACLES_LONG_S: f32 = 15.0;
/// Longer than the autopilot is asked to land.
const NOT_LANDED_S: f32 = 6.0;
/// The commanded yaw may lead the vehicle's by this much.
const YAW_AHEAD_MAX_RAD: f32 = 0.5;

/// What was reported, and when.
#[derive(Clone, Debug)]
pub(super) struct Telemetry {
    due: Instant,
    turn: u8,
    /// The last valid bearing: when, SNR in dB, sigma and elevation in degrees.
    bearing: Option<(Instant, f32, f32, Option<f32>)>,
    outcome: Option<(Outcome, Instant)>,
    stale: Option<Stale>,
    /// Why the landing handed over, and whether the autopilot is asked to land.
    ended: Option<(Reason, bool)>,
    lasting_told: bool,
    /// A text from the application, sent once there is an autopilot.
    notice: Option<String<NOTICE_BYTES>>,
    /// The current cause, and since when.
    cause: (Cause, Instant),
    /// What was announced last.
    announced: Option<&'static str>,
    /// Warnings that wait, the oldest first.
    warnings: Deque<&'static str, WARNINGS>,
    warned_last: bool,
    text_due: Instant,
    landing_due: Instant,
    surroundings_due: Instant,
    noise_told: bool,
    low_told: bool,
    ignored_told: bool,
}

impl Telemetry {
    pub(super) const fn new() -> Self {
        Self {
            due: Instant(0),
            turn: 0,
            bearing: None,
            outcome: None,
            stale: None,
            ended: None,
            lasting_told: false,
            notice: None,
            cause: (Cause::None, Instant(0)),
            announced: None,
            warnings: Deque::new(),
            warned_last: false,
            text_due: Instant(0),
            landing_due: Instant(0),
            surroundings_due: Instant(0),
            noise_told: false,
            low_told: false,
            ignored_told: false,
        }
    }

    /// The clock ran backwards.
    pub(super) fn restart(&mut self, now: Instant) {
        self.bearing = None;
        self.outcome = None;
        self.cause.1 = now;
        for due in [&mut self.due, &mut self.text_due, &mut self.landing_due, &mut self.surroundings_due] {
            *due = now;
        }
    }

    /// Something happened that is to be reported once, by a text without [`OURS`]. It is dropped if the queue is full of others.
    #[inline(never)]
    pub(super) fn warn(&mut self, text: &'static str) {
        if self.warnings.iter().all(|waiting| *waiting != text) {
            self.warnings.push_back(text).ok();
        }
    }

    fn asks_to_land(&self) -> bool {
        self.ended.is_some_and(|(_, wants_land)| wants_land)
    }

    pub(super) fn wants_surroundings(&self, now: Instant) -> bool {
        now >= self.surroundings_due
    }
}

/// Setpoints.
impl Companion {
    pub(super) fn is_sane(&self, setpoint: &Setpoint) -> bool {
        let Ned { north, east, down } = setpoint.velocity_ned_mps;
        let speed_squared = north * north + east * east + down * down;
        // False for what is not finite.
        speed_squared <= SPEED_MAX_MPS * SPEED_MAX_MPS && libm::fabsf(setpoint.yaw_rate_radps) <= YAW_RATE_MAX_RADPS
    }

    /// Queues the setpoint that is due, or withdraws the one that must not be sent any more.
    #[inline(never)]
    pub(super) fn stream(&mut self, autopilot: &Autopilot, cause: Cause) {
        let now = self.now;
        let slot = now.0 / (u64::from(SETPOINT_PERIOD_MS) * 1_000);
        let due = self.setpoint_slot.replace(slot).is_some_and(|last| last != slot);
        // Zeros would take PX4 back into OFFBOARD, out of the failsafe that our silence has begun.
        let prestream = self.config.prestream && !self.has_crashed && !self.is_ownship_lost(now);
        let setpoint = match cause.stream(autopilot.software, prestream) {
            Stream::Silent => None,
            Stream::Zero
                if matches!(cause, Cause::LinkQuiet | Cause::StoreDamaged | Cause::EntryNeeded)
                    && self.may_take_off() =>
            {
                None
            }
            Stream::Zero => Some(Setpoint::default()),
            Stream::Guidance => {
                let is_fresh = |time: Instant| !is_over(now, time, self.config.setpoint_age_max_s);
                let published = self.published.filter(|published| is_fresh(published.time));
                Some(published.map_or_else(Setpoint::default, |published| published.setpoint))
            }
        };
        match setpoint {
            None => {
                self.yaw_rad = None;
                self.outbox.withdraw_setpoint();
            }
            Some(setpoint) if due => {
                let message = self.setpoint_message(autopilot, setpoint);
                self.outbox.post_setpoint(now, &message);
            }
            Some(_) => {}
        }
    }

    #[inline(never)]
    fn setpoint_message(&mut self, autopilot: &Autopilot, setpoint: Setpoint) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
        let now = self.now;
        let velocity = self.continuity.velocity_to_theirs(setpoint.velocity_ned_mps);
        if !autopilot.obeys() {
            // The pilot turns it.
            self.yaw_rad = None;
        }
        let is_yaw = self.config.yaw == Yaw::Angle && self.attitude.is_some();
        SET_POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: boot_ms(now),
            target_system: autopilot.system_id,
            target_component: autopilot.component_id,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
            type_mask: if is_yaw { TYPE_MASK_YAW } else { TYPE_MASK },
            vx: velocity.north,
            vy: velocity.east,
            vz: velocity.down,
            yaw: if is_yaw { self.yaw_ahead_rad(setpoint.yaw_rate_radps) } else { 0.0 },
            yaw_rate: if is_yaw { 0.0 } else { setpoint.yaw_rate_radps },
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
        }
    }

    /// The yaw to command: it moves on at the commanded rate, and waits for the vehicle.
    fn yaw_ahead_rad(&mut self, yaw_rate_radps: f32) -> f32 {
        let actual_rad = self.attitude.map_or(0.0, |attitude| attitude.yaw_rad);
        let last_rad = self.yaw_rad.unwrap_or(actual_rad);
        let ahead_rad = wrap_pi(last_rad - actual_rad) + yaw_rate_radps * f32::from(SETPOINT_PERIOD_MS) * 1e-3;
        let ahead_rad = ahead_rad.clamp(-YAW_AHEAD_MAX_RAD, YAW_AHEAD_MAX_RAD);
        let yaw_rad = wrap_pi(actual_rad + ahead_rad);
        self.yaw_rad = Some(yaw_rad);
        yaw_rad
    }
}

/// Heartbeats and requests.
impl Companion {
    #[inline(never)]
    pub(super) fn heartbeat(&self, cause: Cause) -> HEARTBEAT_DATA {
        let now = self.now;
        let state = match (cause, self.published) {
            (Cause::None, Some(published))
                if !is_over(now, published.time, self.config.setpoint_age_max_s) && !is_critical(published.outcome) =>
            {
                MavState::MAV_STATE_ACTIVE
            }
            (Cause::None, _) => MavState::MAV_STATE_CRITICAL,
            (cause, _) if cause.is_critical() || self.store_damaged => MavState::MAV_STATE_CRITICAL,
            _ => MavState::MAV_STATE_STANDBY,
        };
        HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER as u8,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID as u8,
            system_status: state as u8,
            ..HEARTBEAT_DATA::DEFAULT
        }
    }

    /// Asks for the messages that we need, and for the time.
    #[inline(never)]
    pub(super) fn ask(&mut self, autopilot: &Autopilot) {
        let now = self.now;
        let (outbox, target) = (&mut self.outbox, (autopilot.system_id, autopilot.component_id));
        self.requests.poll(now, target, |command| outbox.post_errand(&command));
        if is_due(now, &mut self.timesync_due, TIMESYNC_PERIOD_US) {
            self.outbox.post_errand(&TIMESYNC_DATA {
                tc1: 0,
                ts1: self.clock.ask(now),
                target_system: target.0,
                target_component: target.1,
            });
        }
        let is_fresh = |published: &Published| !is_over(now, published.time, self.config.setpoint_age_max_s);
        let wants_land = self.published.filter(is_fresh).is_some_and(|published| published.wants_land);
        let obeys = self.obeys();
        if let Some(request) = self.landing.poll(now, wants_land, obeys, autopilot.heard, target) {
            self.outbox.post_errand(&request);
        }
        if !self.obeys()
            && let Some(request) = self.advice.poll(now, autopilot.software, target)
        {
            self.outbox.post_errand(&request);
        }
        if self.requests.is_ignored() && !self.telemetry.ignored_told {
            self.telemetry.warn("autopilot does not answer; signing?");
        }
        self.telemetry.ignored_told = self.requests.is_ignored();
    }
}

/// Telemetry.
impl Companion {
    /// Parameters are sent when nothing else waits.
    #[inline(never)]
    pub(super) fn tell_parameters(&mut self) {
        let now = self.now;
        if !self.outbox.has_room_for_a_parameter() {
            return;
        }
        match self.params.next(now) {
            Some(Reply::Value(value)) => self.outbox.post_parameter(&value),
            Some(Reply::Text(text)) => self.outbox.post_note(&text),
            Some(Reply::Ack(ack)) => self.outbox.post_errand(&ack),
            None => {}
        }
    }

    /// Sends the next value of the list when it is due and available, and the messages that have a period of their own.
    #[inline(never)]
    pub(super) fn report(&mut self, output: &guidance::Output) {
        let now = self.now;
        if let Some(bearing) = output.bearing.filter(|bearing| bearing.valid) {
            let elevation_deg = (bearing.elevation_sigma_rad < 0.5).then_some(bearing.elevation_rad * DEG_PER_RAD);
            let sigma_deg = bearing.sigma_rad * DEG_PER_RAD;
            self.telemetry.bearing = Some((now, bearing.quality.snr_db, sigma_deg, elevation_deg));
        }
        if self.telemetry.outcome.is_none_or(|(outcome, _)| outcome != output.outcome) {
            self.telemetry.outcome = Some((output.outcome, now));
            self.telemetry.lasting_told = false;
        }
        self.telemetry.stale = output.stale;
        self.telemetry.ended = output.landing.and_then(|landing| Some((landing.reason?, landing.wants_land)));
        self.report_landing(output);
        if !is_due(now, &mut self.telemetry.due, TELEMETRY_PERIOD_US) {
            return;
        }
        self.telemetry.turn = (self.telemetry.turn + 1) % VALUES.len() as u8;
        let fresh = self.telemetry.bearing.filter(|(time, ..)| !is_over(now, *time, BEARING_AGE_MAX_S));
        let towards_rad = output.source_bearing_ned_rad.map(|bearing| self.continuity.heading_to_theirs(bearing));
        let belief = output.source_share_and_nis.filter(|_| fresh.is_some());
        let turn = self.telemetry.turn;
        let lidar_bad = self.pace.and_then(|pace| pace.lidar_bad);
        let radio_bad = self.pace.and_then(|pace| pace.radio_bad);
        let value = match turn {
            0 => towards_rad.map(compass_deg),
            1 => fresh.map(|(_, snr_db, ..)| snr_db),
            2 => fresh.map(|(_, _, sigma_deg, _)| sigma_deg),
            3 => Some(f32::from(output.outcome as u8)),
            4 if radio_bad.is_some() => radio_bad.map(|bad| bad as f32),
            4 => fresh.and_then(|(.., elevation_deg)| elevation_deg),
            5 => self.range_m(output),
            6 => belief.map(|(share, _)| share),
            7 => belief.map(|(_, nis)| nis),
            8 => self.clock.round_trip_us().map(|us| us.min(60_000_000) as f32 * 1e-3),
            9 => Some(self.noise.percent as f32),
            10 => self.pace.map(|pace| pace.longest_us as f32 * 1e-3),
            11 => self.pace.map(|pace| pace.late as f32),
            12 => self.pace.map(|pace| pace.lost as f32),
            14 if lidar_bad.is_some() => lidar_bad.map(|bad| bad as f32),
            _ => self.sources.ages(now).nth(usize::from(turn - 13)).map(|(_, age_s)| age_s),
        };
        if turn == 0
            && let Some(towards_rad) = towards_rad
        {
            let depression_rad = fresh.and_then(|(.., elevation_deg)| elevation_deg).unwrap_or(0.0) / DEG_PER_RAD;
            self.outbox.post_direction(&direction(now, towards_rad, depression_rad));
        }
        if let Some(value) = value.filter(|value| value.is_finite()) {
            let name = CharArray::new(match turn {
                4 if radio_bad.is_some() => RADIO_VALUE,
                14 if lidar_bad.is_some() => LIDAR_VALUE,
                _ => VALUES[usize::from(turn)],
            });
            self.outbox.post_note(&NAMED_VALUE_FLOAT_DATA { time_boot_ms: boot_ms(now), value, name });
        }
    }

    /// Range of the source, where it is known.
    fn range_m(&self, output: &guidance::Output) -> Option<f32> {
        let here = self.ownship()?.position_ned_m.horizontal();
        let source = output.source?;
        let range_m = source.place_ned_m.minus(here).norm();
        (source.sigma_m <= RANGE_SIGMA_MAX * range_m).then_some(range_m)
    }

    #[inline(never)]
    fn report_landing(&mut self, output: &guidance::Output) {
        let now = self.now;
        if !self.config.landing_target || !is_due(now, &mut self.telemetry.landing_due, LANDING_PERIOD_US) {
            return;
        }
        let message = self.landing_target(output);
        let software = self.autopilot.map(|autopilot| autopilot.software);
        let message = message.zip(software).and_then(|(target, software)| landing::message(now.0, software, &target));
        self.outbox.post_landing(message.as_ref());
    }

    /// The pad where it is seen; else the source, while its signal is received and its range is known.
    fn landing_target(&self, output: &guidance::Output) -> Option<landing::Target> {
        let ownship = self.ownship()?;
        if let Some(pad) = output.landing.and_then(|landing| landing.target).filter(|target| target.is_pad) {
            let (here, place) = (ownship.position_ned_m, pad.place_ned_m);
            let away =
                Ned { north: place.north - here.north, east: place.east - here.east, down: place.down - here.down };
            let place_ned_m = self.continuity.place_to_theirs(place);
            return Some(landing::Target { body_frd_m: ownship.vector_to_body(away), place_ned_m, is_pad: true });
        }
        let (bearing, source) = (output.bearing.filter(|bearing| bearing.valid)?, output.source?);
        let range_m = self.range_m(output)?;
        let (sin_elevation, cos_elevation) = sin_cos(libm::fabsf(bearing.elevation_rad));
        let (sin_azimuth, cos_azimuth) = sin_cos(bearing.azimuth_rad);
        // Beyond 84 degrees the height is more accurate than the range; nobody needs it here.
        let distance_m = range_m / if cos_elevation > 0.1 { cos_elevation } else { 0.1 };
        let ahead = [cos_azimuth * cos_elevation, sin_azimuth * cos_elevation, sin_elevation];
        let place = Ned {
            north: source.place_ned_m.north,
            east: source.place_ned_m.east,
            down: ownship.position_ned_m.down + distance_m * sin_elevation,
        };
        Some(landing::Target {
            body_frd_m: ahead.map(|part| part * distance_m),
            place_ned_m: self.continuity.place_to_theirs(place),
            is_pad: false,
        })
    }

    #[inline(never)]
    pub(super) fn report_surroundings(
        &mut self,
        now: Instant,
        ownship: &Ownship,
        circles: &mut dyn Iterator<Item = Circle>,
    ) {
        self.telemetry.surroundings_due = now.plus_micros(SURROUNDINGS_PERIOD_US);
        self.outbox.post_surroundings(&surroundings::message(now.0, ownship, circles));
    }

    /// Sends a text when our state changes or something happened, at most one a second. A change that did not last is
    /// not reported, nor how a change begins, such as the wait for the first plan.
    #[inline(never)]
    pub(super) fn announce(&mut self, cause: Cause) {
        let now = self.now;
        if self.telemetry.cause.0 != cause {
            self.telemetry.cause = (cause, now);
        }
        let is_low = cause == Cause::None && self.health.charge(self.config.battery_min_percent) == Charge::Low;
        if is_low && !self.telemetry.low_told {
            self.telemetry.warn("battery low");
        }
        self.telemetry.low_told = is_low;
        let is_noisy = self.noise.percent > NOISE_WARN_PERCENT;
        if is_noisy && !self.telemetry.noise_told {
            self.telemetry.warn("frames arrive damaged");
        }
        self.telemetry.noise_told = is_noisy;
        if now < self.telemetry.text_due {
            return;
        }
        if let Some(notice) = self.autopilot.and_then(|_| self.telemetry.notice.take()) {
            self.tell(MavSeverity::MAV_SEVERITY_WARNING, [&notice, ""]);
            return;
        }
        let outcome = self.telemetry.outcome.map(|(outcome, _)| outcome);
        let Telemetry { stale, ended, .. } = self.telemetry;
        let text = cause.text().or(outcome.map(|outcome| text(outcome, stale, ended)));
        let is_settled = is_over(now, self.telemetry.cause.1, SETTLED_S);
        let is_quiet = self.autopilot.is_none() || cause == Cause::Paused && self.paused_aboard || !is_settled;
        // In turns, so that neither suppresses the other.
        let text = text.filter(|text| !is_quiet && self.telemetry.announced != Some(*text));
        let warns_first = text.is_none() || !self.telemetry.warned_last;
        let warning = if warns_first { self.telemetry.warnings.pop_front() } else { None };
        self.telemetry.warned_last = warning.is_some();
        let (severity, text) = if let Some(warning) = warning {
            (MavSeverity::MAV_SEVERITY_WARNING, warning)
        } else if let Some(text) = text {
            self.telemetry.announced = Some(text);
            (severity(cause, outcome, ended), text)
        } else if let Some(text) = self.lasting(cause) {
            self.telemetry.lasting_told = true;
            (MavSeverity::MAV_SEVERITY_CRITICAL, text)
        } else {
            return;
        };
        self.tell(severity, [OURS, text]);
    }

    #[inline(never)]
    fn tell(&mut self, severity: MavSeverity, parts: [&str; 2]) {
        self.telemetry.text_due = self.now.plus_micros(TEXT_PERIOD_US);
        let mut text = [0; NOTICE_BYTES];
        for (place, letter) in text.iter_mut().zip(parts.into_iter().flat_map(str::bytes)) {
            *place = letter;
        }
        self.outbox.post_note(&STATUSTEXT_DATA {
            severity: severity as u8,
            text: CharArray::new(text),
            ..STATUSTEXT_DATA::DEFAULT
        });
    }

    /// Queues a text, to be sent once there is an autopilot; a newer one replaces one that waits.
    pub fn notify(&mut self, text: String<NOTICE_BYTES>) {
        self.telemetry.notice = Some(text);
    }

    /// The same for a `&str`; false where it is too long.
    pub fn notify_text(&mut self, text: &str) -> bool {
        String::try_from(text).map(|text| self.notify(text)).is_ok()
    }

    /// Whether such a text waits.
    #[must_use]
    pub const fn has_notice(&self) -> bool {
        self.telemetry.notice.is_some()
    }

    /// Sets how long the steps of guidance take, for telemetry.
    pub const fn note_pace(&mut self, pace: Pace) {
        self.pace = Some(pace);
    }

    /// The text for an outcome that has lasted.
    #[inline(never)]
    fn lasting(&self, cause: Cause) -> Option<&'static str> {
        let now = self.now;
        let (outcome, since) =
            self.telemetry.outcome.filter(|_| cause == Cause::None && !self.telemetry.lasting_told)?;
        match outcome {
            Outcome::NoSignal if is_over(now, since, NO_SIGNAL_LONG_S) => Some("no signal for 30 s, take over"),
            Outcome::StaleObstacles if is_over(now, since, STALE_OBSTACLES_LONG_S) => {
                Some("no obstacle data for 15 s, take over")
            }
            Outcome::HandedOver if self.telemetry.asks_to_land() && is_over(now, since, NOT_LANDED_S) => {
                Some("autopilot does not land, take over")
            }
            _ => None,
        }
    }
}

fn direction(now: Instant, towards_rad: f32, depression_rad: f32) -> DEBUG_VECT_DATA {
    let (sin, cos) = sin_cos(towards_rad);
    let (down, level) = sin_cos(depression_rad);
    DEBUG_VECT_DATA {
        time_usec: now.0,
        name: CharArray::new(*b"FH_DIR\0\0\0\0"),
        x: cos * level,
        y: sin * level,
        z: down,
    }
}

/// Milliseconds since boot; wraps after 49 days, as MAVLink's own clocks do.
fn boot_ms(now: Instant) -> u32 {
    (now.0 / 1_000) as u32
}

/// A bearing in degrees from north, 0 to 360.
fn compass_deg(bearing_rad: f32) -> f32 {
    let degrees = bearing_rad * DEG_PER_RAD;
    if degrees < 0.0 { degrees + 360.0 } else { degrees }
}
