//! The messages about its own state, from the estimate, not the truth.

use foxhound_link::MessageData;
use foxhound_link::dialect::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, BATTERY_STATUS_DATA, EKF_STATUS_REPORT_DATA, ESTIMATOR_STATUS_DATA,
    EXTENDED_SYS_STATE_DATA, EkfStatusFlags, FENCE_STATUS_DATA, GPS_GLOBAL_ORIGIN_DATA, HEARTBEAT_DATA,
    LOCAL_POSITION_NED_DATA, MavLandedState, MavMessage, ODOMETRY_DATA, RC_CHANNELS_DATA, SYS_STATUS_DATA,
    SYSTEM_TIME_DATA,
};

use super::Autopilot;
use super::flight::{Behaviour, LOCAL_NED};
use crate::scenario::Software;
use crate::world::vehicle::Motion;

const BODY_FRD: u8 = 12;
/// Origin of the local frame, in 1e-7 degrees and millimetres: the airfield of ArduPilot's simulation.
const ORIGIN: (i32, i32, i32) = (-353_632_621, 1_491_652_374, 584_000);
const ORIGIN_STEP: i32 = 1000;
/// All valid: attitude, velocities, positions, and their predictions (bits 8 and 9).
const FILTER_GOOD: u16 = EkfStatusFlags::EKF_ATTITUDE as u16
    | EkfStatusFlags::EKF_VELOCITY_HORIZ as u16
    | EkfStatusFlags::EKF_VELOCITY_VERT as u16
    | EkfStatusFlags::EKF_POS_HORIZ_REL as u16
    | EkfStatusFlags::EKF_POS_HORIZ_ABS as u16
    | EkfStatusFlags::EKF_POS_VERT_ABS as u16
    | 0x0300;
const FILTER_BAD: u16 = EkfStatusFlags::EKF_ATTITUDE as u16
    | EkfStatusFlags::EKF_VELOCITY_VERT as u16
    | EkfStatusFlags::EKF_POS_VERT_ABS as u16
    | EkfStatusFlags::EKF_CONST_POS_MODE as u16;
/// Microseconds from 1970 to the boot of the flight.
const UNIX_AT_BOOT_US: u64 = 1_700_000_000_000_000;
/// Test ratios, with limit 1.
const RATIO_GOOD: f32 = 0.05;
const RATIO_BAD: f32 = 1.5;

/// Messages with the vehicle's position.
pub(super) const fn is_ownship(message_id: u32) -> bool {
    matches!(
        message_id,
        LOCAL_POSITION_NED_DATA::ID | ATTITUDE_DATA::ID | ATTITUDE_QUATERNION_DATA::ID | ODOMETRY_DATA::ID
    )
}

impl Autopilot {
    fn position(&self, time_boot_ms: u32, estimate: &Motion) -> LOCAL_POSITION_NED_DATA {
        let mut told = position(time_boot_ms, estimate);
        if let Some(position_ned_m) = self.faults.position_ned_m {
            [told.x, told.y, told.z] = position_ned_m;
        }
        if self.faults.velocity_is_backwards {
            (told.vx, told.vy) = (-told.vx, -told.vy);
        }
        told
    }

    /// A message now, if it exists.
    pub(super) fn message(&self, now_us: u64, message_id: u32) -> Option<MavMessage> {
        let estimate = self.flight.estimate();
        let time_boot_ms = self.boot_ms(now_us);
        let is_px4 = self.software == Software::Px4;
        Some(match message_id {
            HEARTBEAT_DATA::ID => MavMessage::HEARTBEAT(self.heartbeat()),
            LOCAL_POSITION_NED_DATA::ID => MavMessage::LOCAL_POSITION_NED(self.position(time_boot_ms, &estimate)),
            ATTITUDE_DATA::ID => MavMessage::ATTITUDE(attitude(time_boot_ms, &estimate)),
            ATTITUDE_QUATERNION_DATA::ID => {
                let [q1, q2, q3, q4] = quaternion(&estimate);
                let yawspeed = estimate.yaw_rate_radps as f32;
                MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                    time_boot_ms,
                    q1,
                    q2,
                    q3,
                    q4,
                    yawspeed,
                    ..Default::default()
                })
            }
            ODOMETRY_DATA::ID if is_px4 => MavMessage::ODOMETRY(self.odometry(now_us, &estimate)),
            EXTENDED_SYS_STATE_DATA::ID => MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
                vtol_state: 0,
                landed_state: self.landed_state() as u8,
            }),
            SYS_STATUS_DATA::ID => MavMessage::SYS_STATUS(SYS_STATUS_DATA {
                voltage_battery: 15_200,
                current_battery: 1_200,
                battery_remaining: self.faults.battery.remaining_percent,
                ..Default::default()
            }),
            BATTERY_STATUS_DATA::ID => MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
                temperature: i16::MAX,
                voltages: std::array::from_fn(|cell| if cell < 4 { 3_800 } else { u16::MAX }),
                current_battery: 1_200,
                battery_remaining: self.faults.battery.remaining_percent,
                charge_state: self.faults.battery.charge_state,
                ..Default::default()
            }),
            EKF_STATUS_REPORT_DATA::ID if !is_px4 => {
                let ratio = if self.faults.filter_is_bad { RATIO_BAD } else { RATIO_GOOD };
                MavMessage::EKF_STATUS_REPORT(EKF_STATUS_REPORT_DATA {
                    flags: self.filter_flags(),
                    velocity_variance: ratio,
                    pos_horiz_variance: ratio,
                    pos_vert_variance: RATIO_GOOD,
                    compass_variance: RATIO_GOOD,
                    ..Default::default()
                })
            }
            ESTIMATOR_STATUS_DATA::ID if is_px4 => {
                let ratio = if self.faults.filter_is_bad { RATIO_BAD } else { RATIO_GOOD };
                MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA {
                    time_usec: self.boot_us(now_us),
                    flags: self.filter_flags(),
                    vel_ratio: ratio,
                    pos_horiz_ratio: ratio,
                    pos_horiz_accuracy: if self.faults.filter_is_bad { 50.0 } else { 0.3 },
                    pos_vert_accuracy: 0.3,
                    ..Default::default()
                })
            }
            SYSTEM_TIME_DATA::ID => {
                MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA { time_unix_usec: UNIX_AT_BOOT_US + now_us, time_boot_ms })
            }
            GPS_GLOBAL_ORIGIN_DATA::ID => MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA {
                latitude: ORIGIN.0 + ORIGIN_STEP * self.flight.origin_moves,
                longitude: ORIGIN.1,
                altitude: ORIGIN.2,
                time_usec: self.boot_us(now_us),
            }),
            FENCE_STATUS_DATA::ID if !is_px4 => MavMessage::FENCE_STATUS(FENCE_STATUS_DATA {
                breach_status: u8::from(self.faults.fence_is_breached),
                breach_count: u16::from(self.faults.fence_is_breached),
                ..Default::default()
            }),
            RC_CHANNELS_DATA::ID => MavMessage::RC_CHANNELS(self.channels(time_boot_ms)),
            _ => return None,
        })
    }

    const fn filter_flags(&self) -> u16 {
        if self.faults.filter_is_bad { FILTER_BAD } else { FILTER_GOOD }
    }

    /// \[src: `landed_state()` of ArduCopter\]
    pub(super) fn landed_state(&self) -> MavLandedState {
        match self.behaviour() {
            _ if self.flight.landed => MavLandedState::MAV_LANDED_STATE_ON_GROUND,
            Behaviour::Land => MavLandedState::MAV_LANDED_STATE_LANDING,
            _ if self.flight.takeoff_down_m.is_some() => MavLandedState::MAV_LANDED_STATE_TAKEOFF,
            _ => MavLandedState::MAV_LANDED_STATE_IN_AIR,
        }
    }

    /// Pose in the local frame, velocities in the body's; counts the filter's steps \[src: ODOMETRY.hpp\].
    fn odometry(&self, now_us: u64, estimate: &Motion) -> ODOMETRY_DATA {
        let [x, y, z] = estimate.pose.position_ned_m.map(|x| x as f32);
        let [vx, vy, vz] = to_body(estimate, estimate.velocity_ned_mps).map(|v| v as f32);
        let mut covariance = [0.0; 21];
        for diagonal in [0, 6, 11, 15, 18, 20] {
            covariance[diagonal] = if self.faults.filter_is_bad { 100.0 } else { 0.01 };
        }
        ODOMETRY_DATA {
            time_usec: self.boot_us(now_us),
            frame_id: LOCAL_NED,
            child_frame_id: BODY_FRD,
            x,
            y,
            z,
            q: quaternion(estimate),
            vx,
            vy,
            vz,
            yawspeed: estimate.yaw_rate_radps as f32,
            pose_covariance: covariance,
            velocity_covariance: covariance,
            reset_counter: self.flight.resets,
            // MAV_ESTIMATOR_TYPE_AUTOPILOT.
            estimator_type: 8,
            quality: if self.faults.filter_is_bad { -1 } else { 100 },
            ..Default::default()
        }
    }

    fn channels(&self, time_boot_ms: u32) -> RC_CHANNELS_DATA {
        let us = self.faults.rc_us;
        let is_heard = !self.faults.rc_is_lost;
        let us = if is_heard { us } else { [u16::MAX; 18] };
        RC_CHANNELS_DATA {
            time_boot_ms,
            chancount: if is_heard { 18 } else { 0 },
            chan1_raw: us[0],
            chan2_raw: us[1],
            chan3_raw: us[2],
            chan4_raw: us[3],
            chan5_raw: us[4],
            chan6_raw: us[5],
            chan7_raw: us[6],
            chan8_raw: us[7],
            chan9_raw: us[8],
            chan10_raw: us[9],
            chan11_raw: us[10],
            chan12_raw: us[11],
            chan13_raw: us[12],
            chan14_raw: us[13],
            chan15_raw: us[14],
            chan16_raw: us[15],
            chan17_raw: us[16],
            chan18_raw: us[17],
            rssi: if is_heard { 200 } else { 0 },
        }
    }
}

fn position(time_boot_ms: u32, motion: &Motion) -> LOCAL_POSITION_NED_DATA {
    let [x, y, z] = motion.pose.position_ned_m.map(|x| x as f32);
    let [vx, vy, vz] = motion.velocity_ned_mps.map(|v| v as f32);
    LOCAL_POSITION_NED_DATA { time_boot_ms, x, y, z, vx, vy, vz }
}

fn attitude(time_boot_ms: u32, motion: &Motion) -> ATTITUDE_DATA {
    ATTITUDE_DATA {
        time_boot_ms,
        roll: motion.pose.roll_rad as f32,
        pitch: motion.pose.pitch_rad as f32,
        yaw: motion.pose.yaw_rad as f32,
        yawspeed: motion.yaw_rate_radps as f32,
        ..ATTITUDE_DATA::default()
    }
}

/// From body to local, w first.
fn quaternion(motion: &Motion) -> [f32; 4] {
    let half = |angle_rad: f64| (libm::sin(angle_rad / 2.0), libm::cos(angle_rad / 2.0));
    let ((sr, cr), (sp, cp), (sy, cy)) =
        (half(motion.pose.roll_rad), half(motion.pose.pitch_rad), half(motion.pose.yaw_rad));
    [cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy]
        .map(|part| part as f32)
}

fn to_body(motion: &Motion, [north, east, down]: [f64; 3]) -> [f64; 3] {
    let (sy, cy) = (libm::sin(motion.pose.yaw_rad), libm::cos(motion.pose.yaw_rad));
    let (sp, cp) = (libm::sin(motion.pose.pitch_rad), libm::cos(motion.pose.pitch_rad));
    let (sr, cr) = (libm::sin(motion.pose.roll_rad), libm::cos(motion.pose.roll_rad));
    let (x, y) = (north * cy + east * sy, east * cy - north * sy);
    let (x, z) = (x * cp - down * sp, x * sp + down * cp);
    [x, y * cr + z * sr, z * cr - y * sr]
}
