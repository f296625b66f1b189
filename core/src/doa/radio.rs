//! A radio that finds the direction of a transmitter: what it sends, how it is mounted, and the bearings that this becomes.

use core::f32::consts::{FRAC_PI_2, PI};

use crate::base::error::{ConfigError, check};
use crate::base::time::Instant;
use crate::base::units::wrap_pi;
use crate::doa::bearing::{Bearing, Flags, Quality};

/// The part of an address by which a transmitter is known: what a 32-bit float holds exactly.
const ADDRESS_END: u64 = 0xFF_FFFF;
/// Least sigma of its bearings: a tenth of a degree.
pub const SIGMA_MIN_RAD: f32 = 0.1 / 180.0 * PI;

/// What it sends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Sends {
    /// Angles.
    #[default]
    Angles,
    /// Samples of an antenna array behind a switch: Bluetooth's IQ reports.
    IqReports,
}

/// What it sends, how it is mounted, how exact it is, and which transmitter is sought.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Mount {
    /// What it sends.
    pub sends: Sends,
    /// Direction of its zero, from the nose, clockwise.
    pub yaw_rad: f32,
    /// Standard deviation of its angles; the least one where it sends samples.
    pub sigma_rad: f32,
    /// The lower 24 bits of the wanted transmitter's address; 0: any transmitter.
    pub tag: u32,
}

impl Default for Mount {
    /// Angles of 8 degrees, any transmitter.
    fn default() -> Self {
        Self { sends: Sends::Angles, yaw_rad: 0.0, sigma_rad: 8.0 / 180.0 * PI, tag: 0 }
    }
}

impl Mount {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        check("radio.yaw_rad", self.yaw_rad, -PI, PI)?;
        check("radio.sigma_rad", self.sigma_rad, SIGMA_MIN_RAD, FRAC_PI_2)?;
        check("radio.tag", self.tag as f32, 0.0, ADDRESS_END as f32).map(|_| ())
    }

    /// Whether this is the address of a wanted transmitter.
    #[must_use]
    pub const fn wants(&self, address: u64) -> bool {
        self.tag == 0 || self.tag as u64 == address & ADDRESS_END
    }

    /// A bearing from its zero, from the nose.
    #[must_use]
    pub fn mounted(&self, bearing: &Bearing) -> Bearing {
        let azimuth_rad = wrap_pi(bearing.azimuth_rad + self.yaw_rad);
        Bearing { azimuth_rad, flags: bearing.flags.with(Flags::ALIKE), ..*bearing }
    }

    /// The bearing of an azimuth that it has measured, clockwise from its zero.
    #[must_use]
    pub fn bearing(&self, time: Instant, azimuth_rad: f32) -> Bearing {
        let quality = Quality { wavenumber: 1.0, ..Quality::default() };
        let without = Bearing::without(time, quality, Flags::default());
        self.mounted(&Bearing { valid: true, azimuth_rad, sigma_rad: self.sigma_rad, ..without })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bearing_is_turned_by_the_mount_and_has_its_sigma() {
        let mount = Mount { yaw_rad: 0.75 * PI, ..Mount::default() };
        let bearing = mount.bearing(Instant(7), FRAC_PI_2);
        assert!((bearing.azimuth_rad + 0.75 * PI).abs() < 1e-6, "{bearing:?}");
        assert!(bearing.valid && bearing.time == Instant(7));
        assert!((bearing.sigma_rad.to_degrees() - 8.0).abs() < 1e-5, "{bearing:?}");
    }

    #[test]
    fn a_transmitter_is_known_by_the_end_of_its_address() {
        let mount = Mount { tag: 0xA4_1845, ..Mount::default() };
        assert!(mount.wants(0x6C1D_EBA4_1845) && !mount.wants(0x6C1D_EBA4_1846));
        assert!(Mount::default().wants(1));
    }

    #[test]
    fn what_is_out_of_range_is_refused_by_name() {
        let field = |mount: Mount| mount.check().unwrap_err().field;
        assert_eq!(field(Mount { yaw_rad: 3.2, ..Mount::default() }), "radio.yaw_rad");
        assert_eq!(field(Mount { sigma_rad: 0.0, ..Mount::default() }), "radio.sigma_rad");
        assert!(Mount::default().check().is_ok());
    }
}
