//! Known lines of reflection: the line-of-sight filter with the sightings of the vehicle's mirror image.
//!
//! There is nothing to linearise that [`polar`] does not linearise already, so a reflection costs no accuracy over a direct
//! signal of the same length of path, and a source that moves is followed through its reflection.

use super::fold::fold;
use super::{Degenerate, Estimate, Sighting, Update, kalman};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::localize::source::polar;
use foxhound_core::mapping::walls::Wall;

/// A filter behind `N` lines, in the order from the source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known<const N: usize> {
    /// Of the source itself.
    pub filter: polar::Filter,
    /// The lines.
    pub lines: [Wall; N],
}

impl<const N: usize> Known<N> {
    /// Updates with a sighting off the last line.
    ///
    /// # Errors
    /// If the ray meets no line; the state is unchanged.
    pub fn step<const S: usize>(&self, state: &mut polar::State<S>, sighting: &Sighting) -> Result<Update, Degenerate> {
        if !sighting.is_plausible() {
            return Ok(Update::Refused);
        }
        Ok(self.filter.step(state, &fold(&self.lines, sighting)?))
    }

    /// The estimate of the source, with bearing and range from the vehicle straight through the walls.
    #[must_use]
    pub fn estimate<const S: usize>(&self, state: &polar::State<S>, vehicle_ned_m: Horizontal) -> Option<Estimate> {
        let direct = state.estimate()?;
        let seen = kalman::seen(vehicle_ned_m, direct.place_ned_m, direct.covariance_m2, 1e-3);
        Some(Estimate { velocity_ned_mps: direct.velocity_ned_mps, ..seen })
    }
}

impl Known<1> {
    /// [`Self::step`] for a source that may move, compiled with this crate (for speed) and not with the caller.
    ///
    /// # Errors
    /// If the ray meets no line; the state is unchanged.
    #[inline(never)]
    pub fn step_moving(&self, state: &mut polar::Moving, sighting: &Sighting) -> Result<Update, Degenerate> {
        if !sighting.is_plausible() {
            return Ok(Update::Refused);
        }
        Ok(self.filter.step_moving(state, &fold(&self.lines, sighting)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGMA_RAD: f32 = 0.05;

    fn at(north: f32, east: f32) -> Horizontal {
        Horizontal { north, east }
    }

    #[test]
    fn what_has_no_geometry_is_told_and_changes_nothing() {
        let filter = polar::Config::DEFAULT.build().unwrap();
        let known = Known { filter, lines: [Wall::between(at(10.0, -40.0), at(10.0, 40.0)).unwrap()] };
        let mut state = polar::Resting::new();
        let heard = |place: Horizontal, bearing_rad: f32| Sighting {
            place_ned_m: place,
            direction_ned: Horizontal::from_bearing(bearing_rad),
            sigma_rad: SIGMA_RAD,
            since_s: 0.1,
        };
        assert_eq!(known.step(&mut state, &heard(at(0.0, 0.0), 0.4)), Ok(Update::Started));
        let before = state;
        assert_eq!(known.step(&mut state, &heard(at(10.0, 0.0), 0.4)), Err(Degenerate::OnLine));
        assert_eq!(known.step(&mut state, &heard(at(0.0, 0.0), 2.0)), Err(Degenerate::NoReflection));
        assert_eq!(known.step(&mut state, &heard(at(f32::NAN, 0.0), 0.4)), Ok(Update::Refused));
        assert_eq!(state, before);
    }
}
