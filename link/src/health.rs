//! The vehicle's fitness as the autopilot and the pilot report it: battery, estimator, fence, the switch on the
//! transmitter.
//!
//! What was never reported is not held against the vehicle.

use foxhound_core::base::time::Instant;

use crate::clock::is_over;
use crate::dialect::{
    BATTERY_STATUS_DATA, EKF_STATUS_REPORT_DATA, ESTIMATOR_STATUS_DATA, EkfStatusFlags, EstimatorStatusFlags,
    FENCE_STATUS_DATA, MavBatteryChargeState, MavSysStatusSensor, RC_CHANNELS_DATA, SYS_STATUS_DATA,
};

/// Batteries that are distinguished; those with higher numbers count as the last one.
const BATTERIES: usize = 10;
/// A switch whose messages stop for this long is off.
const SWITCH_AGE_MAX_S: f32 = 2.0;
/// Pulses of a transmitter are between these; anything else is no signal.
const PULSE_US: core::ops::RangeInclusive<u16> = 800..=2200;
/// A switch is on above this.
const ON_US: u16 = 1500;

/// How empty the batteries are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Charge {
    #[default]
    Enough,
    Low,
    Critical,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Health {
    charges: [Charge; BATTERIES],
    /// Energy left in the first battery, by the last message of each kind.
    remaining_percent: [Option<u8>; 2],
    estimator_is_bad: bool,
    fence_is_breached: bool,
    switch: Option<(Instant, bool)>,
    had_receiver: bool,
    receiver_is_lost: bool,
}

impl Health {
    pub(crate) const fn new() -> Self {
        Self {
            charges: [Charge::Enough; BATTERIES],
            remaining_percent: [None; 2],
            estimator_is_bad: false,
            fence_is_breached: false,
            switch: None,
            had_receiver: false,
            receiver_is_lost: false,
        }
    }

    pub(crate) fn on_battery(&mut self, battery: &BATTERY_STATUS_DATA) {
        use MavBatteryChargeState as State;
        let state = battery.charge_state;
        if let Some(charge) = self.charges.get_mut(usize::from(battery.id).min(BATTERIES - 1)) {
            *charge = if state == State::MAV_BATTERY_CHARGE_STATE_LOW as u8 {
                Charge::Low
            } else if (State::MAV_BATTERY_CHARGE_STATE_CRITICAL as u8..=State::MAV_BATTERY_CHARGE_STATE_UNHEALTHY as u8)
                .contains(&state)
            {
                Charge::Critical
            } else {
                Charge::Enough
            };
        }
        if battery.id == 0 {
            self.remaining_percent[0] = percent(battery.battery_remaining);
        }
    }

    pub(crate) fn on_sys_status(&mut self, status: &SYS_STATUS_DATA) {
        use MavSysStatusSensor as Part;
        let (present, healthy) = (status.onboard_control_sensors_present, status.onboard_control_sensors_health);
        let has = |parts: u32, part: Part| parts & part as u32 != 0;
        self.remaining_percent[1] = percent(status.battery_remaining);
        // ArduPilot repeats the last pulses of a transmitter that is gone, and sends no FENCE_STATUS any more when the
        // fence is switched off.
        // PX4 may repeat them too, and says of a receiver that is lost that there is none.
        let receiver = Part::MAV_SYS_STATUS_SENSOR_RC_RECEIVER;
        self.had_receiver |= has(present, receiver);
        self.receiver_is_lost = self.had_receiver && !(has(present, receiver) && has(healthy, receiver));
        self.fence_is_breached &= !has(healthy, Part::MAV_SYS_STATUS_GEOFENCE);
    }

    pub(crate) fn on_ekf(&mut self, report: &EKF_STATUS_REPORT_DATA) {
        use EkfStatusFlags as Flag;
        let has = |flag: Flag| u32::from(report.flags) & flag as u32 != 0;
        let knows = has(Flag::EKF_ATTITUDE)
            && has(Flag::EKF_VELOCITY_HORIZ)
            && (has(Flag::EKF_POS_HORIZ_REL) || has(Flag::EKF_POS_HORIZ_ABS))
            && !has(Flag::EKF_CONST_POS_MODE)
            && !has(Flag::EKF_UNINITIALIZED);
        self.estimator_is_bad = !knows;
    }

    pub(crate) fn on_estimator(&mut self, report: &ESTIMATOR_STATUS_DATA) {
        use EstimatorStatusFlags as Flag;
        // A constant position is told of a vehicle at rest as well, whose position is known.
        let has = |flag: Flag| u32::from(report.flags) & flag as u32 != 0;
        let knows = has(Flag::ESTIMATOR_ATTITUDE)
            && has(Flag::ESTIMATOR_VELOCITY_HORIZ)
            && (has(Flag::ESTIMATOR_POS_HORIZ_REL) || has(Flag::ESTIMATOR_POS_HORIZ_ABS));
        self.estimator_is_bad = !knows;
    }

    pub(crate) fn on_fence(&mut self, fence: &FENCE_STATUS_DATA) {
        self.fence_is_breached = fence.breach_status != 0;
    }

    /// `channel` counts from 1.
    pub(crate) fn on_channels(&mut self, now: Instant, channels: &RC_CHANNELS_DATA, channel: u8) {
        let c = channels;
        let pulses_us = [
            c.chan1_raw,
            c.chan2_raw,
            c.chan3_raw,
            c.chan4_raw,
            c.chan5_raw,
            c.chan6_raw,
            c.chan7_raw,
            c.chan8_raw,
            c.chan9_raw,
            c.chan10_raw,
            c.chan11_raw,
            c.chan12_raw,
            c.chan13_raw,
            c.chan14_raw,
            c.chan15_raw,
            c.chan16_raw,
            c.chan17_raw,
            c.chan18_raw,
        ];
        let pulse_us = pulses_us.get(usize::from(channel).wrapping_sub(1)).copied().unwrap_or_default();
        if channel <= c.chancount && PULSE_US.contains(&pulse_us) {
            self.switch = Some((now, pulse_us > ON_US));
        }
    }

    /// The worst of the batteries; also critical when less is left than `least_percent` (0 for no limit).
    #[inline(never)]
    pub(crate) fn charge(&self, least_percent: f32) -> Charge {
        let is_below = |left: &u8| f32::from(*left) < least_percent;
        if self.remaining_percent.iter().flatten().any(is_below) {
            return Charge::Critical;
        }
        self.charges.iter().copied().max().unwrap_or_default()
    }

    /// Whether the estimator's last report says that its position is unknown. Silence does not clear it.
    pub(crate) fn is_estimator_bad(&self) -> bool {
        self.estimator_is_bad
    }

    /// Whether the fence was breached in the last report. Silence does not clear it.
    pub(crate) fn is_fence_breached(&self) -> bool {
        self.fence_is_breached
    }

    /// Whether the pilot's switch is on, and his transmitter heard.
    pub(crate) fn is_switched_on(&self, now: Instant) -> bool {
        !self.receiver_is_lost && self.switch.is_some_and(|(at, on)| on && !is_over(now, at, SWITCH_AGE_MAX_S))
    }

    /// Handles a clock that ran backwards: nothing is younger than now.
    pub(crate) fn follow_clock(&mut self, now: Instant) {
        if let Some((at, _)) = &mut self.switch {
            *at = (*at).min(now);
        }
    }
}

fn percent(remaining: i8) -> Option<u8> {
    u8::try_from(remaining).ok().filter(|percent| *percent <= 100)
}
