//! The result of several looks.

use heapless::Deque;

use super::{Kept, LOOKS, Method};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::doa::bearing::{Bearing, Flags, Quality};

/// A bearing with a larger sigma is useless.
const SIGMA_USELESS_RAD: f32 = 0.6;

/// The weaker of two paths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflection {
    /// Its direction from north, (-pi, pi].
    pub azimuth_ned_rad: f32,
    /// Its mean power over that of the stronger path, 0..=1.
    pub relative_power: f32,
}

/// The result of several looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// The stronger path, as seen from the last look, in the body frame. `quality.closure_chi2` is the mean residual
    /// of a look over its variance: near 1 if the model is right, thousands if not. Signal-to-noise ratio and
    /// frequency are the last look's; the flags are those of all looks. `MULTIPATH` means that there are two paths.
    pub bearing: Bearing,
    /// The same direction from north.
    pub azimuth_ned_rad: f32,
    /// The weaker path, if there is one. (The direct path need not be the stronger one.)
    pub reflection: Option<Reflection>,
    /// The method used.
    pub method: Method,
    /// Number of looks used.
    pub looks: u8,
}

/// What becomes an [`Arrival`].
pub(super) struct Found {
    pub(super) azimuth_ned_rad: f32,
    pub(super) variance: f32,
    pub(super) chi2: f32,
    pub(super) reflection: Option<Reflection>,
}

impl Found {
    pub(super) fn arrival(&self, looks: &Deque<Kept, LOOKS>, last: &Kept, method: Method, wavenumber: f32) -> Arrival {
        let sigma_rad = sqrt(self.variance);
        // NaN is treated as useless.
        let sigma_rad = if sigma_rad < core::f32::consts::PI { sigma_rad.max(1e-6) } else { core::f32::consts::PI };
        let azimuth_ned_rad = wrap_pi(self.azimuth_ned_rad);
        let finite = azimuth_ned_rad.is_finite();
        let mut flags = Flags::default();
        for look in looks {
            // One look's signs of reflections, and its ambiguity, are resolved by this stage.
            flags = flags.with(Flags(look.bearing.flags.0 & !(Flags::MULTIPATH.0 | Flags::AMBIGUOUS.0)));
        }
        if self.reflection.is_some() || (method == Method::Mean && last.bearing.flags.contains(Flags::MULTIPATH)) {
            flags = flags.with(Flags::MULTIPATH);
        }
        if !finite || sigma_rad > SIGMA_USELESS_RAD {
            flags = flags.with(Flags::AMBIGUOUS);
        }
        let useless = Flags::AMBIGUOUS.0 | Flags::UNCALIBRATED.0 | Flags::NO_SIGNAL.0;
        let azimuth_ned_rad = if finite { azimuth_ned_rad } else { 0.0 };
        Arrival {
            bearing: Bearing {
                time: last.time,
                valid: flags.0 & useless == 0,
                azimuth_rad: wrap_pi(azimuth_ned_rad - last.yaw_rad),
                sigma_rad: if finite { sigma_rad } else { core::f32::consts::PI },
                elevation_rad: libm::acosf(wavenumber.clamp(0.0, 1.0)),
                elevation_sigma_rad: last.bearing.elevation_sigma_rad,
                quality: Quality { closure_chi2: self.chi2, wavenumber, ..last.bearing.quality },
                flags,
            },
            azimuth_ned_rad,
            reflection: self.reflection,
            method,
            looks: looks.len() as u8,
        }
    }
}
