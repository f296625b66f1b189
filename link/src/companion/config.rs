//! Configuration of the link.

use foxhound_core::base::error::{ConfigError, Why, check};
use foxhound_core::guidance::param::{self, Values};

use super::Companion;
use crate::signing::Unsigned;

/// What the angles of `OBSTACLE_DISTANCE` count from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ObstacleFrame {
    /// From the nose when the autopilot is ArduPilot, which never looks at the frame field; else as the field says.
    #[default]
    Auto,
    /// As the field says: 12 from the nose, 0 and 1 from north; others are not understood.
    Field,
    /// Always from the nose.
    Body,
}

/// How a setpoint turns the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Yaw {
    /// By a rate ([`TYPE_MASK`](super::TYPE_MASK)).
    #[default]
    Rate,
    /// By an angle that moves on at that rate ([`TYPE_MASK_YAW`](super::TYPE_MASK_YAW)).
    Angle,
}

/// Configuration of the link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Our system id until an autopilot is found, whose system id we take over.
    pub system_id: u8,
    /// Our component id.
    pub component_id: u8,
    /// A published setpoint older than this is replaced by zero velocity.
    pub setpoint_age_max_s: f32,
    /// How a setpoint turns the vehicle.
    pub yaw: Yaw,
    /// Without a heartbeat of the autopilot for this long, the link is lost.
    pub heartbeat_timeout_s: f32,
    /// Without a heartbeat of the autopilot for this long, no setpoints are sent, and control comes back only when the
    /// mode is left and entered again.
    pub silence_after_s: f32,
    /// Whether PX4 is sent zero velocity outside OFFBOARD, so that its pilot can enter OFFBOARD.
    pub prestream: bool,
    /// What the angles of `OBSTACLE_DISTANCE` count from.
    pub obstacle_frame: ObstacleFrame,
    /// Below this battery level, in percent, the vehicle is not flown; 0 leaves it to what the autopilot calls
    /// critical.
    pub battery_min_percent: f32,
    /// The channel of the pilot's transmitter, from 1, that must be on for us to fly; 0 requires none.
    pub switch_channel: u8,
    /// Whether `LANDING_TARGET` is sent while the source is known.
    pub landing_target: bool,
    /// Whether the obstacle map is sent as `OBSTACLE_DISTANCE`.
    pub surroundings: bool,
    /// Whether MAVLink 1 is understood.
    pub accept_v1: bool,
    /// Which unsigned messages are accepted once there is a key.
    pub unsigned: Unsigned,
    /// Whether a key may be set over this link while the vehicle is disarmed: only for a local link, with somebody at
    /// the vehicle.
    pub provisioning: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            system_id: 1,
            component_id: 191,
            setpoint_age_max_s: 0.25,
            yaw: Yaw::Rate,
            heartbeat_timeout_s: 2.5,
            silence_after_s: 5.0,
            prestream: true,
            obstacle_frame: ObstacleFrame::Auto,
            battery_min_percent: 0.0,
            switch_channel: 0,
            landing_target: false,
            surroundings: false,
            accept_v1: false,
            unsigned: Unsigned::UntilFirstSigned,
            provisioning: false,
        }
    }
}

impl Config {
    /// This configuration, with the link's parameters taken from `values`.
    #[must_use]
    #[inline(never)]
    pub fn with(&self, values: &Values) -> Self {
        Self {
            setpoint_age_max_s: values.get(param::FH_SP_AGE),
            heartbeat_timeout_s: values.get(param::FH_HB_TMO),
            silence_after_s: values.get(param::FH_SILENT),
            prestream: values.is_on(param::FH_PRESTREAM),
            obstacle_frame: match values.whole(param::FH_OBS_FRAME) {
                0 => ObstacleFrame::Auto,
                1 => ObstacleFrame::Field,
                _ => ObstacleFrame::Body,
            },
            battery_min_percent: values.get(param::FH_BAT_MIN),
            switch_channel: values.whole(param::FH_RC_CH) as u8,
            unsigned: match values.whole(param::FH_SIGN) {
                0 => Unsigned::Always,
                1 => Unsigned::UntilFirstSigned,
                _ => Unsigned::HeartbeatAndRadioStatusOnly,
            },
            accept_v1: values.is_on(param::FH_V1),
            yaw: if values.is_on(param::FH_YAW_MODE) { Yaw::Angle } else { Yaw::Rate },
            landing_target: values.is_on(param::FH_LND_OUT),
            surroundings: values.is_on(param::FH_OBS_OUT),
            ..*self
        }
    }

    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    #[inline(never)]
    pub fn build(&self) -> Result<Companion, ConfigError> {
        self.check_each()?;
        self.check_together()?;
        Ok(Companion::from_checked(self, Values::DEFAULT))
    }

    /// As [`Self::build`], with the parameters that the application runs with: the link takes its own from them, and
    /// serves all of them to ground stations.
    ///
    /// # Errors
    /// The field that is out of range.
    #[inline(never)]
    pub fn build_with(&self, values: Values) -> Result<Companion, ConfigError> {
        Ok(Companion::from_checked(&self.checked_with(&values)?, values))
    }

    /// As [`Self::build_with`], written over an existing companion, which is unchanged if that fails. A second one on
    /// the stack would not fit a microcontroller.
    ///
    /// # Errors
    /// The field that is out of range.
    #[inline(never)]
    pub fn rebuild_with(&self, companion: &mut Companion, values: Values) -> Result<(), ConfigError> {
        let config = self.checked_with(&values)?;
        *companion = Companion::from_checked(&config, values);
        Ok(())
    }

    #[inline(never)]
    fn checked_with(&self, values: &Values) -> Result<Self, ConfigError> {
        let config = self.with(values);
        config.check_each()?;
        config.check_together()?;
        Ok(config)
    }

    fn check_each(&self) -> Result<(), ConfigError> {
        static RANGES: [(&str, f32, f32); 7] = [
            ("link.system_id", 1.0, 254.0),
            ("link.component_id", 2.0, 255.0),
            ("link.setpoint_age_max_s", 0.05, 1.0),
            ("link.heartbeat_timeout_s", 1.5, 10.0),
            ("link.silence_after_s", 1.5, 30.0),
            ("link.battery_min_percent", 0.0, 100.0),
            ("link.switch_channel", 0.0, 18.0),
        ];
        let values = [
            f32::from(self.system_id),
            f32::from(self.component_id),
            self.setpoint_age_max_s,
            self.heartbeat_timeout_s,
            self.silence_after_s,
            self.battery_min_percent,
            f32::from(self.switch_channel),
        ];
        for (&(field, min, max), value) in RANGES.iter().zip(values) {
            check(field, value, min, max)?;
        }
        Ok(())
    }

    #[inline(never)]
    pub(super) fn check_together(&self) -> Result<(), ConfigError> {
        if self.silence_after_s < self.heartbeat_timeout_s {
            let why = Why::Inconsistent("silence must not come before the link is lost (link.heartbeat_timeout_s)");
            return Err(ConfigError { field: "link.silence_after_s", value: self.silence_after_s, why });
        }
        Ok(())
    }
}
