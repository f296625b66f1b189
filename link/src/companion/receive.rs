//! The receiving half: what each message changes.

use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::sin_cos;
use foxhound_core::guidance::mission::Control;
use foxhound_core::mapping::scan::{Frame, Points};

use super::{Companion, ObstacleFrame, UNSETTLED_US, count};
use crate::MessageData;
use crate::advice::Advice;
use crate::autopilot::{Attitude, Autopilot, Position, Software};
use crate::beams::Beams;
use crate::clock::{PeerClock, Stamped, is_over, nanos};
use crate::continuity::{Continuity, Displacement, PLACE_GAP_MAX_S, Turn};
use crate::dialect::{
    self as d, COMMAND_ACK_DATA, HEARTBEAT_DATA, MavCmd, MavFrame, MavLandedState, MavResult, OBSTACLE_DISTANCE_DATA,
    SETUP_SIGNING_DATA, TIMESYNC_DATA,
};
use crate::framer::{Content, Header};
use crate::health::Health;
use crate::obstacles::{self, Reading, Return};
use crate::params::Params;
use crate::requests::{WISHES, Wish};
use crate::signing::{Setup, set_up};
use crate::sources::Source;

/// Our link to the autopilot, among the links that sign with one key.
const LINK_ID: u8 = 0;

/// From one point of a wide beam to the next.
const ARC_STEP_RAD: f32 = 0.0873;
/// North-aligned obstacles need a yaw at most this old.
const YAW_AGE_MAX_S: f32 = 0.5;
/// After a jump of this the vehicle holds; also after smaller jumps that add up to it, forgotten with a time constant.
const JUMP_MIN_M: f32 = 0.4;
const JUMPS_S: f32 = 1.0;
/// A yaw rate may change by this between two messages.
const YAW_RATE_MARGIN_RADPS: f32 = 2.0;
/// So fast a vehicle may turn of which no yaw rate is reported.
const YAW_RATE_UNTOLD_RADPS: f32 = 4.0;
/// An origin that moves by no more than this, some 0.1 m, is the same.
const ORIGIN_MOVES_DEGE7: u32 = 9;
/// Messages of one autopilot may overtake each other by less than this; a larger step back is a restart.
const BOOT_CLOCK_SLACK_MS: u32 = 1_000;
/// The clock has wrapped, and the autopilot has not restarted, if no more than this was missed.
const BOOT_CLOCK_GAP_MAX_MS: u32 = 60_000;

impl Companion {
    #[inline(never)]
    pub(super) fn handle(&mut self, header: Header, content: &Content) {
        let us = (self.system_id(), self.config.component_id);
        if (header.system_id, header.component_id) == us {
            // A router's echo of ourselves.
            return;
        }
        let is_autopilot = self.is_autopilot(header);
        if is_autopilot {
            self.requests.heard(content.message_id());
        }
        // Most messages are not, and whether we seek takes some work to find out.
        if Params::may_hear(content.message_id()) {
            let is_seeking = self.control(self.now) == Control::Granted;
            if self.params.hear(us, header, content, is_seeking) {
                return;
            }
        }
        // Any component of our system may see obstacles. An autopilot to which we or another component report them reports them again,
        // and calls free what was not reported: it is not heard on obstacles then, only on the distance to the ground.
        let is_aboard = header.system_id == us.0;
        let repeats_others = || self.config.surroundings || self.sources.has_other(self.now, header.component_id);
        let sees_obstacles = is_aboard && !(is_autopilot && repeats_others());
        match content.message_id() {
            d::HEARTBEAT_DATA::ID => self.on_heartbeat(header, content),
            d::SETUP_SIGNING_DATA::ID => self.on_key(content),
            d::COMMAND_LONG_DATA::ID => {
                let command: d::COMMAND_LONG_DATA = content.read();
                let target = (command.target_system, command.target_component);
                self.on_command(header, target, command.command, [command.param1, command.param2]);
            }
            d::COMMAND_INT_DATA::ID => {
                let command: d::COMMAND_INT_DATA = content.read();
                let target = (command.target_system, command.target_component);
                self.on_command(header, target, command.command, [command.param1, command.param2]);
            }
            d::TIMESYNC_DATA::ID => self.on_timesync(header, content),
            d::OBSTACLE_DISTANCE_DATA::ID if sees_obstacles => {
                self.on_obstacles(header, content);
            }
            d::OBSTACLE_DISTANCE_3D_DATA::ID if sees_obstacles => {
                self.note_source(header, content, 0);
                self.on_point(obstacles::point(&content.read()), 0.0);
            }
            d::DISTANCE_SENSOR_DATA::ID if is_aboard => self.on_beam(header, content, sees_obstacles),
            _ if is_autopilot => self.on_telemetry(content),
            _ => {}
        }
    }

    /// A key: accepted on a local link while the vehicle is disarmed, and nowhere else.
    #[inline(never)]
    fn on_key(&mut self, content: &Content) {
        let now = self.now;
        let setup: SETUP_SIGNING_DATA = content.read();
        let us = (self.system_id(), self.config.component_id);
        let may = self.config.provisioning && self.autopilot.is_none_or(|autopilot| !autopilot.armed);
        match set_up(now, &setup, us, may, LINK_ID, self.signing.as_ref()) {
            Setup::NotOurs => {}
            Setup::Refused => self.telemetry.warn("takes no key now"),
            Setup::Off => {
                self.sign_with(None);
                self.key_changed = true;
                self.telemetry.warn("signing is off");
            }
            Setup::On(signing) => {
                self.sign_with(Some(signing));
                self.key_changed = true;
                self.telemetry.warn("signing is on");
            }
        }
    }

    #[inline(never)]
    fn is_autopilot(&self, header: Header) -> bool {
        self.autopilot.is_some_and(|autopilot| autopilot.sent(header))
    }

    /// Whether the vehicle is where a setpoint would be wrong: on the ground, or in a take-off that it would end.
    pub(super) fn is_on_ground(&self) -> bool {
        self.landed_state == MavLandedState::MAV_LANDED_STATE_ON_GROUND as u8
            || self.landed_state == MavLandedState::MAV_LANDED_STATE_TAKEOFF as u8
    }

    /// Whether it is not known if the vehicle is in a take-off: we have been restarted, or the link was lost, and the autopilot has not said. ArduPilot ends a
    /// take-off at the first setpoint.
    pub(super) fn may_take_off(&self) -> bool {
        self.landed_state == MavLandedState::MAV_LANDED_STATE_UNDEFINED as u8 && self.is_ardupilot()
    }

    #[inline(never)]
    fn on_heartbeat(&mut self, header: Header, content: &Content) {
        let now = self.now;
        let heartbeat: HEARTBEAT_DATA = content.read();
        let Some(autopilot) = Autopilot::from_heartbeat(now, header, &heartbeat) else {
            return;
        };
        let was_silent = match &self.autopilot {
            Some(known) if known.sent(header) => is_over(now, known.heard, self.config.heartbeat_timeout_s),
            // What cannot be commanded was none, and one that is gone while it was disarmed is not waited for.
            Some(known)
                if (known.software == Software::Other && autopilot.software != Software::Other)
                    || (!known.armed && is_over(now, known.heard, self.config.silence_after_s)) =>
            {
                self.telemetry.warn("follows another autopilot");
                self.forget_autopilot();
                (self.boot_ms, self.health) = (None, Health::new());
                true
            }
            Some(_) => {
                if self.counters.foreign_heartbeats == 0 {
                    self.telemetry.warn("ignores a second autopilot");
                }
                return count(&mut self.counters.foreign_heartbeats);
            }
            None => true,
        };
        let was_lost = self.autopilot.is_some_and(|known| is_over(now, known.heard, self.config.silence_after_s));
        if was_lost {
            // It may have landed meanwhile.
            self.landed_state = 0;
        }
        // Of a heartbeat that is no autopilot's nothing follows.
        self.has_crashed &= autopilot.armed || autopilot.software == Software::Other;
        // The autopilot comes back to our mode by itself from one that its failsafe has chosen, which is no word of the pilot.
        if autopilot.may_obey() {
            self.entry_needed |= was_lost;
        } else {
            (self.entry_needed, self.has_ended, self.paused) = (false, false, false);
        }
        let changed = self.autopilot.is_none_or(|known| known.software != autopilot.software || !known.sent(header));
        self.autopilot = Some(autopilot);
        if changed {
            self.advice = Advice::new();
            self.wish(autopilot.software);
        } else if was_silent {
            self.requests.restart(now);
        }
    }

    /// The messages that we want from an autopilot, and how often.
    pub(super) fn wish(&mut self, software: Software) {
        let now = self.now;
        const IDS: [u32; WISHES] = [
            d::LOCAL_POSITION_NED_DATA::ID,
            d::ATTITUDE_DATA::ID,
            d::EXTENDED_SYS_STATE_DATA::ID,
            d::OBSTACLE_DISTANCE_DATA::ID,
            d::DISTANCE_SENSOR_DATA::ID,
            d::SYS_STATUS_DATA::ID,
            d::BATTERY_STATUS_DATA::ID,
            d::GPS_GLOBAL_ORIGIN_DATA::ID,
            d::RC_CHANNELS_DATA::ID,
            d::EKF_STATUS_REPORT_DATA::ID,
            d::FENCE_STATUS_DATA::ID,
            d::ESTIMATOR_STATUS_DATA::ID,
            d::ODOMETRY_DATA::ID,
        ];
        let ardupilot_hz = if software == Software::ArduPilot { 1.0 } else { 0.0 };
        let px4_hz = if software == Software::Px4 { 1.0 } else { 0.0 };
        let rates_hz = [
            50.0,
            50.0,
            2.0,
            10.0,
            10.0,
            1.0,
            1.0,
            1.0,
            if self.config.switch_channel > 0 { 5.0 } else { 0.0 },
            2.0 * ardupilot_hz,
            ardupilot_hz,
            px4_hz,
            10.0 * px4_hz,
        ];
        let wishes = IDS.iter().zip(rates_hz).filter(|(_, rate_hz)| *rate_hz > 0.0);
        self.requests.wish_for(
            now,
            wishes.map(|(message_id, rate_hz)| Wish {
                // All of ours are below 2^16.
                message_id: *message_id as u16,
                rate_hz,
                is_vital: matches!(*message_id, d::LOCAL_POSITION_NED_DATA::ID | d::ATTITUDE_DATA::ID),
            }),
        );
    }

    #[inline(never)]
    fn on_telemetry(&mut self, content: &Content) {
        let now = self.now;
        match content.message_id() {
            d::LOCAL_POSITION_NED_DATA::ID => self.on_position(content),
            d::ATTITUDE_DATA::ID => self.on_angles(content),
            d::ATTITUDE_QUATERNION_DATA::ID => self.on_quaternion(content),
            d::EXTENDED_SYS_STATE_DATA::ID => {
                self.landed_state = content.read::<d::EXTENDED_SYS_STATE_DATA>().landed_state;
            }
            d::GPS_GLOBAL_ORIGIN_DATA::ID => {
                let origin: d::GPS_GLOBAL_ORIGIN_DATA = content.read();
                let origin = [origin.latitude, origin.longitude];
                // An altitude that drifts, or a last digit, is no new origin; a position that jumps tells so itself.
                let is_elsewhere = |last: [i32; 2]| (0..2).any(|k| origin[k].abs_diff(last[k]) > ORIGIN_MOVES_DEGE7);
                if self.origin.is_some_and(is_elsewhere) {
                    self.continuity.expect_new(false);
                    self.unsettle();
                    self.origin = Some(origin);
                }
                self.origin.get_or_insert(origin);
            }
            d::ODOMETRY_DATA::ID => {
                let resets = content.read::<d::ODOMETRY_DATA>().reset_counter;
                if self.reset_counter.replace(resets).is_some_and(|last| last != resets) {
                    self.continuity.expect_new(true);
                    self.unsettle();
                }
            }
            d::SYSTEM_TIME_DATA::ID => {
                self.follow_boot_clock(content.read::<d::SYSTEM_TIME_DATA>().time_boot_ms);
            }
            d::SYS_STATUS_DATA::ID => self.health.on_sys_status(&content.read()),
            d::BATTERY_STATUS_DATA::ID => self.health.on_battery(&content.read()),
            d::EKF_STATUS_REPORT_DATA::ID => self.health.on_ekf(&content.read()),
            d::ESTIMATOR_STATUS_DATA::ID => self.health.on_estimator(&content.read()),
            d::FENCE_STATUS_DATA::ID => self.health.on_fence(&content.read()),
            d::RC_CHANNELS_DATA::ID if self.config.switch_channel > 0 => {
                self.health.on_channels(now, &content.read(), self.config.switch_channel);
            }
            d::COMMAND_ACK_DATA::ID => self.on_ack(content),
            d::PARAM_VALUE_DATA::ID => {
                let software = self.autopilot.map_or(Software::Other, |autopilot| autopilot.software);
                if let Some(text) = self.advice.hear(now, software, &content.read(), self.params.values()) {
                    self.telemetry.warn(text);
                }
            }
            _ => {}
        }
    }

    #[inline(never)]
    fn on_position(&mut self, content: &Content) {
        let message: d::LOCAL_POSITION_NED_DATA = content.read();
        if self.position.is_some_and(|last| was_overtaken(message.time_boot_ms, last.time_boot_ms)) {
            return count(&mut self.counters.rejected);
        }
        let made = self.made(Stamped::Position, message.time_boot_ms);
        let Some(position) = Position::from_message(made, &message) else { return count(&mut self.counters.rejected) };
        if let Some(last) = &self.position {
            let dt_s = seconds_between((last.time_boot_ms, last.time), (position.time_boot_ms, position.time));
            let moved = Displacement {
                from_m: last.position_ned_m,
                to_m: position.position_ned_m,
                from_mps: last.velocity_ned_mps,
                to_mps: position.velocity_ned_mps,
                dt_s,
            };
            // How the vehicle has moved meanwhile is unknown, and whether its frame has: nothing that is remembered can be relied on.
            if dt_s > PLACE_GAP_MAX_S {
                (self.world_is_lost, self.seeking) = (true, false);
                self.entry_needed |= self.has_ended;
            }
            // A smaller jump is followed without holding, unless many add up: then it is not the estimate that jumps.
            self.jumped_m *= 1.0 - moved.dt_s.min(JUMPS_S) / JUMPS_S;
            if let Some(jumped_m) = self.continuity.follow_place(&moved) {
                self.jumped_m += jumped_m;
                if self.jumped_m > JUMP_MIN_M {
                    self.jumped_m = 0.0;
                    self.unsettle();
                }
            }
        }
        self.position = Some(position);
    }

    #[inline(never)]
    fn on_angles(&mut self, content: &Content) {
        let message: d::ATTITUDE_DATA = content.read();
        let made = self.made(Stamped::Angles, message.time_boot_ms);
        self.on_attitude(Attitude::from_angles(made, &message));
    }

    #[inline(never)]
    fn on_quaternion(&mut self, content: &Content) {
        let message: d::ATTITUDE_QUATERNION_DATA = content.read();
        let made = self.made(Stamped::Quaternion, message.time_boot_ms);
        self.on_attitude(Attitude::from_quaternion(made, &message));
    }

    #[inline(never)]
    fn on_attitude(&mut self, heard: Option<Attitude>) {
        let Some(attitude) = heard else { return count(&mut self.counters.rejected) };
        if self.attitude.is_some_and(|last| was_overtaken(attitude.time_boot_ms, last.time_boot_ms)) {
            return count(&mut self.counters.rejected);
        }
        if let Some(last) = &self.attitude {
            let dt_s = seconds_between((last.time_boot_ms, last.time), (attitude.time_boot_ms, attitude.time));
            let at_m = self.position.map_or_else(Default::default, |position| position.position_ned_m);
            let rate_radps = 0.5 * (last.yaw_rate_radps + attitude.yaw_rate_radps);
            // A gyroscope never reads exactly zero: an autopilot that sends zero reports no rates, and the vehicle may
            // turn as commanded.
            let tells_rates = last.yaw_rate_radps != 0.0 || attitude.yaw_rate_radps != 0.0;
            let unknown_radps = if tells_rates {
                // Between the two messages it may have been either rate, and a little more.
                YAW_RATE_MARGIN_RADPS + 0.5 * libm::fabsf(attitude.yaw_rate_radps - last.yaw_rate_radps)
            } else {
                YAW_RATE_UNTOLD_RADPS
            };
            let turn = Turn { from_rad: last.yaw_rad, rate_radps, unknown_radps, to_rad: attitude.yaw_rad, dt_s };
            if self.continuity.follow_heading(turn, at_m).is_some() {
                self.unsettle();
            }
        }
        self.attitude = Some(attitude);
    }

    /// The autopilot's estimate jumped: guidance holds until it has settled.
    #[inline(never)]
    fn unsettle(&mut self) {
        let now = self.now;
        if now >= self.settled_at {
            count(&mut self.counters.jumps);
            // An estimate that settles before control is given, or on the ground, is nothing to warn of.
            if self.obeys() && !self.is_on_ground() {
                self.telemetry.warn("position or heading jumped");
            }
        }
        self.settled_at = now.plus_micros(UNSETTLED_US);
        self.yaw_rad = None;
    }

    /// When a message of the autopilot was made, by its clock, which is checked first.
    #[inline(never)]
    fn made(&mut self, kind: Stamped, time_boot_ms: u32) -> Instant {
        let now = self.now;
        self.follow_boot_clock(time_boot_ms);
        self.clock.made(now, kind, time_boot_ms)
    }

    /// The autopilot's clock running backwards means that it restarted: nothing that it sent before counts. Its frame
    /// begins anew, and how the vehicle moved meanwhile is unknown, so guidance's memory is of no use either.
    #[inline(never)]
    fn follow_boot_clock(&mut self, time_boot_ms: u32) {
        let now = self.now;
        if let Some(last) = self.boot_ms {
            // The clock wraps after 49.7 days.
            if time_boot_ms < last && time_boot_ms.wrapping_sub(last) < BOOT_CLOCK_GAP_MAX_MS {
                self.boot_ms = Some(time_boot_ms);
                return;
            }
            if last.saturating_sub(time_boot_ms) <= BOOT_CLOCK_SLACK_MS {
                self.boot_ms = Some(last.max(time_boot_ms));
                return;
            }
            count(&mut self.counters.reboots);
            self.telemetry.warn("autopilot has restarted");
            self.forget_autopilot();
            self.requests.restart(now);
        }
        self.boot_ms = Some(time_boot_ms);
    }

    /// Nothing counts that an autopilot sent before.
    #[inline(never)]
    fn forget_autopilot(&mut self) {
        self.continuity = Continuity::new();
        self.clock = PeerClock::new();
        self.position = None;
        self.jumped_m = 0.0;
        self.attitude = None;
        self.world_is_lost = true;
        self.landed_state = 0;
        self.origin = None;
        self.reset_counter = None;
        self.usable_at = None;
        self.ground = None;
        self.turns.clear();
        (self.proximity, self.beams) = (Beams::new(), Beams::new());
        self.points = None;
        // Whatever the mode was: only a heartbeat in another mode, received from now on, lifts it.
        self.entry_needed = true;
        if let Some(autopilot) = &mut self.autopilot {
            autopilot.armed = false;
        }
    }

    #[inline(never)]
    fn note_source(&mut self, header: Header, content: &Content, sensor_id: u8) {
        // All of ours are below 2^16.
        let message_id = content.message_id() as u16;
        self.sources.hear(self.now, Source { component_id: header.component_id, message_id, sensor_id });
    }

    #[inline(never)]
    fn on_obstacles(&mut self, header: Header, content: &Content) {
        let now = self.now;
        self.note_source(header, content, 0);
        let obstacles: OBSTACLE_DISTANCE_DATA = content.read();
        let ardupilot = self.is_ardupilot();
        let from_nose = match self.config.obstacle_frame {
            ObstacleFrame::Auto if ardupilot => true,
            ObstacleFrame::Body => true,
            ObstacleFrame::Auto | ObstacleFrame::Field => obstacles.frame == MavFrame::MAV_FRAME_BODY_FRD as u8,
        };
        let from_north = obstacles.frame == MavFrame::MAV_FRAME_GLOBAL as u8
            || obstacles.frame == MavFrame::MAV_FRAME_LOCAL_NED as u8;
        let yaw_rad = match self.attitude {
            _ if from_nose => Some(None),
            // The autopilot's own: so does north.
            Some(attitude) if from_north && !is_over(now, attitude.time, YAW_AGE_MAX_S) => Some(Some(attitude.yaw_rad)),
            _ => None,
        };
        let zero_touches = !ardupilot;
        self.on_sectors(
            header.component_id,
            &obstacles,
            yaw_rad.map(|yaw_rad| Reading { yaw_rad, zero_touches, untold: 0 }),
        );
    }

    fn is_ardupilot(&self) -> bool {
        self.autopilot.is_some_and(|autopilot| autopilot.software == Software::ArduPilot)
    }

    /// Sectors around the vehicle.
    #[inline(never)]
    fn on_sectors(&mut self, component_id: u8, sectors: &OBSTACLE_DISTANCE_DATA, reading: Option<Reading>) {
        let now = self.now;
        let waits = self.turns.scan().is_some() && self.turns.component_id() != component_id;
        if waits && self.last_scan_of == component_id {
            // Two sensors report between two steps: it is the other one's turn.
            return;
        }
        match reading.and_then(|reading| obstacles::part(sectors, reading)) {
            Some(part) => self.turns.hear(now, component_id, &part),
            None => count(&mut self.counters.rejected),
        }
    }

    /// A beam: the distance to the ground, a sector of a sensor that covers all directions, or a single beam.
    #[inline(never)]
    fn on_beam(&mut self, header: Header, content: &Content, sees_obstacles: bool) {
        let beam: d::DISTANCE_SENSOR_DATA = content.read();
        if beam.orientation == obstacles::DOWN {
            self.ground = obstacles::ground_m(&beam).map(|ground_m| (self.now, ground_m)).or(self.ground);
            return;
        }
        if !sees_obstacles || !obstacles::is_level(&beam) {
            return;
        }
        self.note_source(header, content, beam.id);
        let is_ardupilot = self.is_ardupilot() && self.is_autopilot(header);
        let beams = if is_ardupilot { &mut self.proximity } else { &mut self.beams };
        match beams.sector(header.component_id, is_ardupilot, &beam) {
            Some((sectors, untold)) => {
                let reading = Reading { yaw_rad: None, zero_touches: false, untold };
                self.on_sectors(header.component_id, &sectors, Some(reading));
            }
            None => self.on_point(obstacles::beam(&beam), obstacles::half_width_rad(&beam)),
        }
    }

    /// An obstacle at a point, or anywhere at that distance within an angle on either side.
    #[inline(never)]
    fn on_point(&mut self, heard: Return, half_width_rad: f32) {
        let now = self.now;
        let point = match heard {
            Return::At(point) => Some(point),
            Return::Free => None,
            Return::Nothing => return,
            Return::Absurd => return count(&mut self.counters.rejected),
        };
        // The time is that of the first point, so that none seems younger than it is.
        let empty = || Points { time: now, frame: Frame::Body, ..Points::default() };
        let points = &mut self.points.get_or_insert_with(empty).points_m;
        let Some(point) = point else { return };
        // Four on either side of 22.5 degrees. A float to integer cast saturates.
        let aside = (half_width_rad / ARC_STEP_RAD) as i8;
        for step in -aside..=aside {
            let (sin, cos) = sin_cos(f32::from(step) * ARC_STEP_RAD);
            let point =
                Horizontal { north: cos * point.north - sin * point.east, east: sin * point.north + cos * point.east };
            // What comes when the list is full is left out.
            let _ = points.push(point);
        }
    }

    /// Every command addressed to us is answered. We can pause, go on, and test the receiver; we never arm and never
    /// change the mode.
    #[inline(never)]
    fn on_command(&mut self, header: Header, target: (u8, u8), command: u16, params: [f32; 2]) {
        if target != (self.system_id(), self.config.component_id) {
            return;
        }
        let is = |known: MavCmd| known as u16 == command;
        let [param1, _] = params;
        let result = if is(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM) || is(MavCmd::MAV_CMD_DO_SET_MODE) {
            MavResult::MAV_RESULT_DENIED
        } else if is(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE) && self.has_crashed && param1 == 1.0 {
            (self.has_crashed, self.paused) = (false, false);
            MavResult::MAV_RESULT_ACCEPTED
        } else if is(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE) && !self.may_obey() {
            // It would be forgotten when the mode is entered.
            MavResult::MAV_RESULT_TEMPORARILY_REJECTED
        } else if is(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE) && (param1 == 0.0 || param1 == 1.0) {
            self.paused = param1 == 0.0;
            self.paused_aboard = header.system_id == self.system_id();
            MavResult::MAV_RESULT_ACCEPTED
        } else if is(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE) {
            MavResult::MAV_RESULT_DENIED
        } else if is(MavCmd::MAV_CMD_USER_1) || is(MavCmd::MAV_CMD_USER_2) {
            self.on_exam(header, command, params)
        } else {
            MavResult::MAV_RESULT_UNSUPPORTED
        };
        self.acknowledge((header.system_id, header.component_id), command, result);
    }

    /// Whether a target address is ours or a broadcast.
    #[inline(never)]
    fn is_for_us(&self, system_id: u8, component_id: u8) -> bool {
        (system_id == 0 || system_id == self.system_id())
            && (component_id == 0 || component_id == self.config.component_id)
    }

    #[inline(never)]
    fn on_ack(&mut self, content: &Content) {
        let now = self.now;
        let ack: COMMAND_ACK_DATA = content.read();
        if self.is_for_us(ack.target_system, ack.target_component)
            && ack.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16
            && ack.result != MavResult::MAV_RESULT_IN_PROGRESS as u8
        {
            self.requests.acknowledged(now, ack.result != MavResult::MAV_RESULT_ACCEPTED as u8);
        }
    }

    #[inline(never)]
    fn on_timesync(&mut self, header: Header, content: &Content) {
        let now = self.now;
        let timesync: TIMESYNC_DATA = content.read();
        if !self.is_for_us(timesync.target_system, timesync.target_component) {
            return;
        }
        if timesync.tc1 == 0 {
            // Others take any answer for their autopilot's.
            if timesync.target_component == 0 && !self.is_autopilot(header) {
                return;
            }
            self.outbox.post_errand(&TIMESYNC_DATA {
                tc1: nanos(now),
                ts1: timesync.ts1,
                target_system: header.system_id,
                target_component: header.component_id,
            });
        } else if self.is_autopilot(header) {
            self.clock.answered(now, timesync.ts1, timesync.tc1);
        }
    }
}

/// Whether a landed state means that the vehicle is on the ground; `None` where it is undefined.
pub(super) fn landed(landed_state: u8) -> Option<bool> {
    (landed_state != MavLandedState::MAV_LANDED_STATE_UNDEFINED as u8)
        .then_some(landed_state == MavLandedState::MAV_LANDED_STATE_ON_GROUND as u8)
}

/// Whether a later message of the autopilot was received before: by its clock, which is not set back by a restart.
fn was_overtaken(time_boot_ms: u32, last_ms: u32) -> bool {
    (1..=BOOT_CLOCK_SLACK_MS).contains(&last_ms.saturating_sub(time_boot_ms))
}

/// By the autopilot's clock, or by ours where that stands still; never negative.
fn seconds_between(from: (u32, Instant), to: (u32, Instant)) -> f32 {
    match to.0.saturating_sub(from.0) {
        0 => to.1.seconds_since(from.1),
        ms => ms as f32 * 1e-3,
    }
}
