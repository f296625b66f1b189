//! Which messages stream, and how often.
//!
//! - `MAV_CMD_SET_MESSAGE_INTERVAL` sets one message of the link it came on: microseconds, -1 off, 0 the default \[src,
//!   both\]. What cannot be streamed is answered with FAILED.
//! - `REQUEST_DATA_STREAM` overwrites the rates of a whole group on ArduPilot \[issue: ardupilot#17046, #19761\]; PX4
//!   ignores it \[mem\].
//! - A message is sent at most once per step of the caller, however often it was requested.

use foxhound_link::MessageData;
use foxhound_link::dialect::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, BATTERY_STATUS_DATA, EKF_STATUS_REPORT_DATA, ESTIMATOR_STATUS_DATA,
    EXTENDED_SYS_STATE_DATA, FENCE_STATUS_DATA, GPS_GLOBAL_ORIGIN_DATA, LOCAL_POSITION_NED_DATA, ODOMETRY_DATA,
    RC_CHANNELS_DATA, REQUEST_DATA_STREAM_DATA, SYS_STATUS_DATA, SYSTEM_TIME_DATA, TIMESYNC_DATA,
};

use super::{AUTOPILOT, Autopilot, is_for_us};
use crate::scenario::Software;

/// ArduPilot requests the time soon after its boot, then every 10 s \[src: `GCS_Common.cpp`; one in 3 s, run\].
pub(super) const TIMESYNC_FIRST_US: u64 = 1_000_000;
const ARDUPILOT_TIMESYNC_US: u64 = 10_000_000;
/// PX4 requests it at 10 Hz in Onboard mode \[src\].
const PX4_TIMESYNC_US: u64 = 100_000;

/// Groups of `REQUEST_DATA_STREAM`, by its numbers.
const ALL: u8 = 0;
const EXTENDED_STATUS: u8 = 2;
const RC: u8 = 3;
const POSITION: u8 = 6;
const EXTRA1: u8 = 10;
const EXTRA3: u8 = 12;
/// In no group of ArduCopter's: by interval only \[src\].
const NO_GROUP: u8 = 255;

/// A message and its interval now; `None`: off.
#[derive(Clone, Copy, Debug)]
struct Stream {
    message_id: u32,
    group: u8,
    default_us: Option<u64>,
    interval_us: Option<u64>,
    due_us: u64,
}

/// All messages that can be streamed.
#[derive(Clone, Debug)]
pub(super) struct Streams(Vec<Stream>);

impl Streams {
    pub(super) fn of(software: Software) -> Self {
        let stream = |(message_id, group, rate_hz): (u32, u8, f64)| {
            let default_us = (rate_hz > 0.0).then_some((1e6 / rate_hz) as u64);
            Stream { message_id, group, default_us, interval_us: default_us, due_us: 0 }
        };
        Self(match software {
            // Off until requested [run; src]. The groups are Copter's [src].
            Software::ArduCopter => [
                (LOCAL_POSITION_NED_DATA::ID, POSITION, 0.0),
                (ATTITUDE_DATA::ID, EXTRA1, 0.0),
                (EXTENDED_SYS_STATE_DATA::ID, NO_GROUP, 0.0),
                (ATTITUDE_QUATERNION_DATA::ID, NO_GROUP, 0.0),
                (SYS_STATUS_DATA::ID, EXTENDED_STATUS, 0.0),
                (FENCE_STATUS_DATA::ID, EXTENDED_STATUS, 0.0),
                (BATTERY_STATUS_DATA::ID, EXTRA3, 0.0),
                (EKF_STATUS_REPORT_DATA::ID, EXTRA3, 0.0),
                (SYSTEM_TIME_DATA::ID, EXTRA3, 0.0),
                (RC_CHANNELS_DATA::ID, RC, 0.0),
                (GPS_GLOBAL_ORIGIN_DATA::ID, NO_GROUP, 0.0),
            ]
            .map(stream)
            .to_vec(),
            // Onboard mode [src: mavlink_main.cpp, MAVLINK_MODE_ONBOARD; the last four mem].
            Software::Px4 => [
                (LOCAL_POSITION_NED_DATA::ID, NO_GROUP, 30.0),
                (ATTITUDE_DATA::ID, NO_GROUP, 100.0),
                (ATTITUDE_QUATERNION_DATA::ID, NO_GROUP, 50.0),
                (ODOMETRY_DATA::ID, NO_GROUP, 30.0),
                (EXTENDED_SYS_STATE_DATA::ID, NO_GROUP, 5.0),
                (BATTERY_STATUS_DATA::ID, NO_GROUP, 0.5),
                (ESTIMATOR_STATUS_DATA::ID, NO_GROUP, 1.0),
                (SYS_STATUS_DATA::ID, NO_GROUP, 5.0),
                (SYSTEM_TIME_DATA::ID, NO_GROUP, 1.0),
                (RC_CHANNELS_DATA::ID, NO_GROUP, 5.0),
                (GPS_GLOBAL_ORIGIN_DATA::ID, NO_GROUP, 1.0),
            ]
            .map(stream)
            .to_vec(),
        })
    }

    pub(super) const fn len(&self) -> usize {
        self.0.len()
    }

    /// The message at `index` if it is due; it is then rescheduled.
    pub(super) fn take_due(&mut self, index: usize, now_us: u64) -> Option<u32> {
        let stream = &mut self.0[index];
        let interval_us = stream.interval_us.filter(|_| now_us >= stream.due_us)?;
        // A step may be a microsecond or two short of the interval.
        stream.due_us = (stream.due_us + interval_us).max(now_us + interval_us / 2);
        Some(stream.message_id)
    }

    /// Sets one message; false where there is no such stream.
    pub(super) fn set(&mut self, now_us: u64, message_id: u32, interval_us: f32) -> bool {
        let Some(stream) = self.0.iter_mut().find(|stream| stream.message_id == message_id) else { return false };
        stream.interval_us = match interval_us {
            x if x > 0.0 => Some(x as u64),
            0.0 => stream.default_us,
            _ => None,
        };
        stream.due_us = now_us;
        true
    }

    fn set_group(&mut self, now_us: u64, group: u8, rate_hz: u16) {
        let interval_us = (rate_hz > 0).then(|| 1_000_000 / u64::from(rate_hz));
        let is_meant = |stream: &&mut Stream| stream.group != NO_GROUP && (group == ALL || stream.group == group);
        for stream in self.0.iter_mut().filter(is_meant) {
            stream.interval_us = interval_us;
            stream.due_us = now_us;
        }
    }
}

impl Autopilot {
    pub(super) fn obey_stream_request(&mut self, now_us: u64, request: &REQUEST_DATA_STREAM_DATA) {
        if is_for_us(request.target_system, request.target_component) && self.software == Software::ArduCopter {
            let rate_hz = if request.start_stop == 0 { 0 } else { request.req_message_rate };
            self.streams.set_group(now_us, request.req_stream_id, rate_hz);
        }
    }

    /// Both request the time themselves; ArduPilot hides its system id in the last digits \[src\].
    pub(super) fn ask_for_time(&mut self, now_us: u64) {
        if now_us < self.timesync_due_us {
            return;
        }
        let (interval_us, mark) = match self.software {
            Software::ArduCopter => (ARDUPILOT_TIMESYNC_US, i64::from(super::SYSTEM)),
            Software::Px4 => (PX4_TIMESYNC_US, 0),
        };
        self.timesync_due_us = now_us + interval_us;
        let ts1 = self.boot_ns(now_us) + mark;
        self.send(AUTOPILOT, &TIMESYNC_DATA { tc1: 0, ts1, target_system: 0, target_component: 0 });
    }
}
