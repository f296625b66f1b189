//! What is on the serial line for a sensor: a [lidar](Lidar), or a [radio](Radio) that finds directions, or nothing.

use foxhound_core::base::error::ConfigError;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::radio::Sends;
use foxhound_core::guidance;

use crate::iq::Reports;
use crate::lidar::{self, Lidar};
use crate::radio::Radio;

/// The sensor.
#[expect(clippy::large_enum_variant, reason = "there is one, in a static")]
#[derive(Clone, Debug)]
pub enum Sensor {
    /// Obstacles come from a lidar.
    Lidar(Lidar),
    /// Bearings come from a radio.
    Radio(Radio),
}

/// The sensor of guidance's configuration, if that has one.
///
/// Readers of IQ reports have memory of their own, which is made ready.
///
/// # Errors
/// The field that is out of range.
#[inline(never)]
pub fn build(config: &guidance::Config, reports: &mut Reports) -> Result<Option<Sensor>, ConfigError> {
    match config.radio {
        Some(mount) => {
            if mount.sends == Sends::IqReports {
                reports.begin(&mount)?;
            }
            Ok(Some(Sensor::Radio(Radio::new(mount))))
        }
        None => Ok(lidar::build(config)?.map(Sensor::Lidar)),
    }
}

impl Sensor {
    /// Takes bytes that have arrived by now.
    pub fn push(&mut self, now: Instant, bytes: &[u8], reports: &mut Reports) {
        match self {
            Self::Lidar(lidar) => lidar.push(now, bytes),
            Self::Radio(radio) => radio.push(now, bytes, reports),
        }
    }

    /// The lidar, if it is one.
    #[must_use]
    pub const fn lidar(&self) -> Option<&Lidar> {
        match self {
            Self::Lidar(lidar) => Some(lidar),
            Self::Radio(_) => None,
        }
    }

    /// The radio, if it is one.
    #[must_use]
    pub const fn radio(&self) -> Option<&Radio> {
        match self {
            Self::Lidar(_) => None,
            Self::Radio(radio) => Some(radio),
        }
    }

    /// Scan and bearing have been taken.
    pub fn take(&mut self) {
        match self {
            Self::Lidar(lidar) => lidar.take(),
            Self::Radio(radio) => radio.take(),
        }
    }
}
