//! Gathers bearings into sightings: the average over a tenth of a second, so that filters run at 10 Hz and their input
//! errors are less correlated.

use super::Sighting;
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::time::Instant;

/// Time over which bearings are gathered.
pub const SIGHTING_S: f32 = 0.1;

/// The bearings gathered so far for the next sighting.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gathering {
    since: Option<Instant>,
    last_sighting: Option<Instant>,
    direction: Horizontal,
    place: Horizontal,
    variance: f32,
    count: f32,
}

impl Gathering {
    /// Adds a bearing, as a unit vector; returns the sighting when it is complete.
    pub fn add(
        &mut self,
        at: Instant,
        direction_ned: Horizontal,
        place_ned_m: Horizontal,
        sigma_rad: f32,
    ) -> Option<Sighting> {
        let since = *self.since.get_or_insert(at);
        self.direction = self.direction.plus(direction_ned);
        self.place = self.place.plus(place_ned_m);
        self.variance += sigma_rad * sigma_rad;
        self.count += 1.0;
        if at.seconds_since(since) < SIGHTING_S {
            return None;
        }
        let share = 1.0 / self.count;
        let norm = self.direction.norm();
        let sighting = (norm > 1e-3).then(|| Sighting {
            place_ned_m: self.place.times(share),
            direction_ned: self.direction.times(1.0 / norm),
            // The variance of a mean.
            sigma_rad: sqrt(self.variance) * share,
            since_s: self.last_sighting.map_or(0.0, |last| at.seconds_since(last)),
        });
        *self = Self { last_sighting: Some(at), ..Self::default() };
        sighting
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_bearings_at_50_hz_become_one_with_the_variance_of_their_mean() {
        let mut gathering = Gathering::default();
        let mut sightings = std::vec::Vec::new();
        for k in 0..13_u64 {
            let north = Horizontal { north: k as f32, east: 0.0 };
            let turned = Horizontal::from_bearing(if k % 2 == 0 { 0.1 } else { -0.1 });
            sightings.extend(gathering.add(Instant(k * 20_000), turned, north, 0.06));
        }
        assert_eq!(sightings.len(), 2);
        let [first, second] = [sightings[0], sightings[1]];
        assert!((first.place_ned_m.north - 2.5).abs() < 1e-5 && first.direction_ned.bearing_rad().abs() < 1e-5);
        assert!((first.sigma_rad - 0.06 / 6.0_f32.sqrt()).abs() < 1e-5, "{first:?}");
        assert!(first.since_s == 0.0 && (second.since_s - 0.12).abs() < 1e-5, "{second:?}");
    }
}
