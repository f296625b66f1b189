//! Gathers bearings into sightings: the average over a tenth of a second, so that filters run at 10 Hz and their input
//! errors are less correlated.
//!
//! Averaged are the bearings that agree with the one that most of the others agree with (a consensus set, as in RANSAC, Fischler
//! and Bolles 1981, with every bearing tried): outliers stay outside as long as they do not agree with each other.
//!
//! Errors that are alike from bearing to bearing are not averaged away. Those by other paths of the wave are alike in the sightings of one
//! or two seconds, each of which counts for less. A radio's, by its antennas and its site ([`Flags::ALIKE`]), are alike until the vehicle is
//! elsewhere: its bearings are gathered for a second, and a sighting counts for as much as the vehicle has moved meanwhile.

use heapless::Vec;

use super::Sighting;
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::time::Instant;
use crate::base::units::between;
use crate::doa::bearing::{Bearing, Flags};

/// Time over which bearings are gathered.
pub const SIGHTING_S: f32 = 0.1;
/// Most bearings of one sighting: six at 50 Hz. Of more, the last are left out.
const BEARINGS_MAX: usize = 8;
/// Directions agree when they are no farther apart than this and three of their sigmas: true ones turn as fast near the source.
const APART_RAD: f32 = 0.1;
/// So many sightings, about one second of them, are alike in their errors by other paths, and so many once a reflection was among the
/// hypotheses.
const ALIKE_SIGHTINGS: f32 = 10.0;
const REFLECTED_SIGHTINGS: f32 = 16.0;
/// Time over which bearings with errors of the site are gathered.
const SITE_S: f32 = 1.0;
/// At places so far apart the errors of the site differ; recorded at places 3 m apart, they do (`docs/results/radios.md`).
const SITE_M: f32 = 2.0;

/// A bearing of the next sighting.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Heard {
    direction_ned: Horizontal,
    place_ned_m: Horizontal,
    /// Variance of what differs from bearing to bearing, and of what is alike.
    noise_rad2: f32,
    alike_rad2: f32,
}

impl Heard {
    fn agrees(&self, other: &Self) -> bool {
        let apart = self.direction_ned.minus(other.direction_ned).norm_squared();
        apart < APART_RAD * APART_RAD + 9.0 * (self.noise_rad2 + other.noise_rad2)
    }
}

/// The bearings gathered so far for the next sighting.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gathering {
    since: Option<Instant>,
    last_sighting: Option<Instant>,
    heard: Vec<Heard, BEARINGS_MAX>,
}

impl Gathering {
    /// Adds a bearing with its direction, a unit vector; returns the sighting when it is complete. `has_reflections`: one was
    /// supposed before.
    pub fn add(
        &mut self,
        bearing: &Bearing,
        direction_ned: Horizontal,
        place_ned_m: Horizontal,
        has_reflections: bool,
    ) -> Option<Sighting> {
        let at = bearing.time;
        let since = *self.since.get_or_insert(at);
        let alike_rad2 = bearing.alike_rad() * bearing.alike_rad();
        let sigma_rad2 = bearing.sigma_rad * bearing.sigma_rad;
        let is_of_site = bearing.flags.contains(Flags::ALIKE);
        // How much of a site's errors differs from bearing to bearing is not known: all of it may.
        let noise_rad2 = if is_of_site { sigma_rad2 } else { sigma_rad2 - alike_rad2 };
        // When the list is full, it is left out.
        let _ = self.heard.push(Heard { direction_ned, place_ned_m, noise_rad2, alike_rad2 });
        let is_enough = is_of_site && self.heard.is_full();
        if at.seconds_since(since) < if is_of_site { SITE_S } else { SIGHTING_S } && !is_enough {
            return None;
        }
        let since_s = self.last_sighting.map_or(0.0, |last| at.seconds_since(last));
        let moved_m = self.heard.first().map_or(0.0, |first| place_ned_m.minus(first.place_ned_m).norm());
        let alike = match (is_of_site, has_reflections) {
            (true, _) => between(SITE_M / (moved_m + 1e-3), 1.0, ALIKE_SIGHTINGS),
            (false, true) => REFLECTED_SIGHTINGS,
            (false, false) => ALIKE_SIGHTINGS,
        };
        let sighting = self.sighting(since_s, alike);
        self.heard.clear();
        (self.since, self.last_sighting) = (None, Some(at));
        sighting
    }

    /// The mean of those that agree, where so many sightings have alike errors.
    fn sighting(&self, since_s: f32, alike: f32) -> Option<Sighting> {
        let (mut middle, mut most) = (self.heard.first()?, 0);
        for one in &self.heard {
            let count = self.heard.iter().filter(|other| one.agrees(other)).count();
            if count > most {
                (middle, most) = (one, count);
            }
        }
        let (mut direction, mut place) = (Horizontal::default(), Horizontal::default());
        let (mut noise_rad2, mut alike_rad2) = (0.0, 0.0);
        for one in self.heard.iter().filter(|one| middle.agrees(one)) {
            direction = direction.plus(one.direction_ned);
            place = place.plus(one.place_ned_m);
            noise_rad2 += one.noise_rad2;
            alike_rad2 += one.alike_rad2;
        }
        let (share, norm) = (1.0 / most as f32, direction.norm());
        (norm > 1e-3).then(|| Sighting {
            place_ned_m: place.times(share),
            direction_ned: direction.times(1.0 / norm),
            sigma_rad: sqrt(share * (share * noise_rad2 + alike * alike_rad2)),
            since_s,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::doa::bearing::Quality;
    use crate::localize::source::bank;

    const NORTH: Horizontal = Horizontal { north: 1.0, east: 0.0 };

    fn bearing(k: u64, sigma_rad: f32, flags: Flags) -> Bearing {
        Bearing { sigma_rad, ..Bearing::without(Instant(k * 20_000), Quality::default(), flags) }
    }

    #[test]
    fn six_bearings_at_50_hz_become_one_with_the_variance_of_their_mean() {
        let mut gathering = Gathering::default();
        let mut sightings = std::vec::Vec::new();
        for k in 0..13_u64 {
            let north = Horizontal { north: k as f32, east: 0.0 };
            let turned = Horizontal::from_bearing(if k % 2 == 0 { 0.1 } else { -0.1 });
            sightings.extend(gathering.add(&bearing(k, 0.06, Flags::default()), turned, north, false));
        }
        assert_eq!(sightings.len(), 2);
        let [first, second] = [sightings[0], sightings[1]];
        assert!((first.place_ned_m.north - 2.5).abs() < 1e-5 && first.direction_ned.bearing_rad().abs() < 1e-5);
        assert!((first.sigma_rad - 0.06 / 6.0_f32.sqrt()).abs() < 1e-5, "{first:?}");
        assert!(first.since_s == 0.0 && (second.since_s - 0.12).abs() < 1e-5, "{second:?}");
    }

    #[test]
    fn outliers_that_do_not_agree_are_left_out() {
        let mut gathering = Gathering::default();
        let azimuths_rad = [2.0, 0.01, -0.01, -1.5, 0.01, -0.01];
        let add = |(k, azimuth_rad): (usize, f32)| {
            gathering.add(
                &bearing(k as u64, 0.02, Flags::default()),
                Horizontal::from_bearing(azimuth_rad),
                Horizontal::default(),
                false,
            )
        };
        let sighting = azimuths_rad.into_iter().enumerate().filter_map(add).next().unwrap();
        assert!(sighting.direction_ned.bearing_rad().abs() < 1e-5, "{sighting:?}");
        assert!((sighting.sigma_rad - 0.01).abs() < 1e-5, "of four: {sighting:?}");
    }

    #[test]
    fn errors_by_other_paths_are_not_averaged_away() {
        let sigma_rad = |flags: Flags| {
            let mut gathering = Gathering::default();
            let add = |k| gathering.add(&bearing(k, 0.1, flags), NORTH, Horizontal::default(), false);
            (0..6).filter_map(add).next().unwrap().sigma_rad
        };
        assert!(sigma_rad(Flags::MULTIPATH) > 0.2 && sigma_rad(Flags::default()) < 0.05);
    }

    /// The squared error over its covariance, per degree of freedom, at the end of a flight to and fro past a source 20 m away, by
    /// bearings at 10 Hz that are off by noise and by what depends on the direction from the nose.
    fn nees_of_site(seed: u64, flags: Flags) -> f32 {
        let bank = bank::Config::DEFAULT.build().unwrap();
        let (mut gathering, mut state, mut rng) = (Gathering::default(), bank::State::new(), Rng::new(seed, 1));
        let source = Horizontal { north: 20.0, east: 0.0 };
        let (bias_rad, noise_rad) = (0.087 * 1.414, 0.035);
        let phase_rad = core::f32::consts::TAU * rng.uniform();
        let mut answer = None;
        for k in 0..300_u64 {
            let t_s = 0.1 * k as f32;
            let east = 5.0 - libm::fabsf(5.0 - t_s % 10.0);
            let place = Horizontal { north: 0.5 * t_s, east };
            let nose_rad = if t_s % 10.0 < 5.0 { 1.1 } else { -1.1 };
            let true_rad = source.minus(place).bearing_rad();
            let off_rad = bias_rad * libm::sinf(2.0 * (true_rad - nose_rad) + phase_rad) + noise_rad * rng.gaussian();
            let one = Bearing { time: Instant(k * 100_000), ..bearing(0, 0.094, flags) };
            let sighting = gathering.add(&one, Horizontal::from_bearing(true_rad + off_rad), place, false);
            answer = sighting.and_then(|sighting| bank.step(&mut state, &sighting, 0.0, &[])).or(answer);
        }
        let estimate = answer.unwrap().estimate;
        let off = estimate.place_ned_m.minus(source);
        let [nn, ne, ee] = estimate.covariance_m2;
        let squares = ee * off.north * off.north - 2.0 * ne * off.north * off.east + nn * off.east * off.east;
        0.5 * squares / (nn * ee - ne * ne)
    }

    #[test]
    fn the_errors_of_a_site_are_not_averaged_away() {
        let mean_nees = |flags: Flags| (0..40).map(|seed| nees_of_site(seed, flags)).sum::<f32>() / 40.0;
        let (whole, averaged) = (mean_nees(Flags::ALIKE), mean_nees(Flags::default()));
        assert!(whole < 2.0 && averaged > 5.0, "{whole}, {averaged}");
    }
}
