//! The beam in all directions of the table, and its maxima.

use super::{Beam, Covariance, DIRECTIONS, MIRROR_STEPS, Peak, RIVALS, Vector};
use crate::base::units::{between, sin_cos, wrap_pi};
use crate::signal::phase::Complex;

/// Most steps of Newton's from the table to a maximum, and the change of the outermost antenna's phase that ends them: what
/// remains is of the order of its square, and near the end of a line, beside the mirror image, of the order of itself.
const STEPS_MAX: usize = 8;
const STEP_LAST: f32 = 0.003;
/// A further maximum is refined if it has this share of the best. Of lower ones the parabola through three directions will do.
const REFINED: f32 = 0.4;

/// Powers of the beam in the directions of its table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scan {
    powers: [f32; DIRECTIONS],
}

impl Default for Scan {
    fn default() -> Self {
        Self { powers: [0.0; DIRECTIONS] }
    }
}

impl Scan {
    /// Adds the powers of other phasors.
    pub fn add(&mut self, other: &Self) {
        for (sum, power) in self.powers.iter_mut().zip(&other.powers) {
            *sum += power;
        }
    }
}

/// Power near a direction: its value, slope and bend.
pub(super) struct Near {
    power: f32,
    slope: f32,
    bend: f32,
}

/// What the antennas hear.
pub(super) trait Heard {
    fn lives(&self, antenna: usize) -> bool;
    /// Sum of the antennas' powers.
    fn total(&self) -> f32;
    fn near(&self, beam: &Beam, azimuth_rad: f32) -> Near;
}

impl Heard for Vector {
    fn lives(&self, antenna: usize) -> bool {
        self.get(antenna).is_some_and(|z| z.norm_squared() > 0.0)
    }

    fn total(&self) -> f32 {
        self.iter().map(|z| z.norm_squared()).sum()
    }

    fn near(&self, beam: &Beam, azimuth_rad: f32) -> Near {
        // Sums of the phasors turned back, plain and weighted by the phase and its derivative.
        let (sine, cosine) = sin_cos(azimuth_rad);
        let (mut sum, mut once, mut twice, mut bent) =
            (Complex::default(), Complex::default(), Complex::default(), Complex::default());
        for (z, [x, y]) in self.iter().zip(beam.steering).take(beam.count) {
            let (phase, slope) = (x * cosine + y * sine, y * cosine - x * sine);
            let back = z.times_conj(Complex::at(phase));
            let sloped = back.scaled(slope);
            sum = sum.plus(back);
            once = once.plus(sloped);
            twice = twice.plus(sloped.scaled(slope));
            bent = bent.plus(back.scaled(phase));
        }
        let bend = once.norm_squared() - twice.times_conj(sum).re - bent.times_conj(sum).im;
        Near { power: sum.norm_squared(), slope: 2.0 * once.times_conj(sum).im, bend: 2.0 * bend }
    }
}

impl Heard for Covariance {
    fn lives(&self, antenna: usize) -> bool {
        self.lives(antenna)
    }

    fn total(&self) -> f32 {
        self.trace()
    }

    fn near(&self, beam: &Beam, azimuth_rad: f32) -> Near {
        let (sine, cosine) = sin_cos(azimuth_rad);
        let (wave, mut sloped) = (beam.toward(azimuth_rad), Vector::default());
        let turned = |[x, y]: [f32; 2]| (x * cosine + y * sine, y * cosine - x * sine);
        for ((sloped, wave), at) in sloped.iter_mut().zip(&wave).zip(beam.steering) {
            *sloped = wave.scaled(turned(at).1);
        }
        let mut near = Near { power: 0.0, slope: 0.0, bend: 0.0 };
        let products = self.times(&wave).into_iter().zip(self.times(&sloped));
        for (((y, sloped_y), wave), at) in products.zip(&wave).zip(beam.steering).take(beam.count) {
            let (phase, slope) = turned(at);
            let own = y.times_conj(*wave);
            near.power += own.re;
            near.slope += 2.0 * slope * own.im;
            near.bend += 2.0 * (slope * (sloped_y.times_conj(*wave).re - slope * own.re) - phase * own.im);
        }
        near
    }
}

impl Beam {
    /// Turns the beam over a set of phasors.
    pub fn scan(&self, z: &Vector, scan: &mut Scan) {
        for (power, wave) in scan.powers.iter_mut().zip(&self.table).take(self.directions) {
            let sum = z.iter().zip(wave).fold(Complex::default(), |sum, (z, a)| sum.plus(z.times_conj(*a)));
            *power = sum.norm_squared();
        }
    }

    /// Turns the beam over a covariance.
    fn scan_all(&self, covariance: &Covariance) -> Scan {
        let mut scan = Scan::default();
        for (power, wave) in scan.powers.iter_mut().zip(&self.table).take(self.directions) {
            *power = covariance.power(wave);
        }
        scan
    }

    /// The largest power of a scan, between the directions of the table as well.
    #[must_use]
    pub fn strongest(&self, scan: &Scan) -> f32 {
        let mut most = 0.0;
        self.maxima(scan, |_, power| most = if power > most { power } else { most });
        most
    }

    /// Where the power of a set of phasors is largest, from its scan; `None` when fewer than two antennas hear anything.
    #[must_use]
    pub fn peak(&self, scan: &Scan, z: &Vector) -> Option<Peak> {
        self.find_from(scan, z)
    }

    /// The same of a covariance.
    #[must_use]
    pub fn peak_of_all(&self, scan: &Scan, covariance: &Covariance) -> Option<Peak> {
        self.find_from(scan, covariance)
    }

    /// Where the power of a covariance is largest; `None` when fewer than two antennas hear anything.
    #[must_use]
    pub fn find(&self, covariance: &Covariance) -> Option<Peak> {
        self.find_from(&self.scan_all(covariance), covariance)
    }

    fn find_from(&self, scan: &Scan, heard: &impl Heard) -> Option<Peak> {
        let antennas = (0..self.count).filter(|antenna| heard.lives(*antenna)).count();
        let total = heard.total() * antennas as f32;
        if antennas < 2 || !(total > 0.0) || !total.is_finite() {
            return None;
        }
        let mut found = [(0.0, 0.0); DIRECTIONS / 2];
        let (mut count, mut highest) = (0, (0.0, f32::MIN));
        self.maxima(scan, |azimuth_rad, power| {
            if let Some(place) = found.get_mut(count) {
                *place = (azimuth_rad, power);
            }
            count += 1;
            highest = if power > highest.1 { (azimuth_rad, power) } else { highest };
        });
        let (azimuth_rad, most) = self.refined(heard, highest.0);
        let mut peak = Peak {
            azimuth_rad: wrap_pi(azimuth_rad),
            mirror_rad: self.mirror_rad(wrap_pi(azimuth_rad), |antenna| heard.lives(antenna)),
            share: (most / total).min(1.0),
            rivals: [0.0; RIVALS],
            sensitivity: self.sensitivity(azimuth_rad, heard),
            antennas,
        };
        let near_rad = MIRROR_STEPS * self.step_rad;
        let is_near = |a_rad: f32, b_rad: f32| libm::fabsf(wrap_pi(a_rad - b_rad)) < near_rad;
        for (other_rad, power) in found.into_iter().take(count) {
            let is_mirror = peak.mirror_rad.is_some_and(|mirror_rad| is_near(other_rad, mirror_rad));
            if !is_mirror && !is_near(other_rad, azimuth_rad) {
                let power = if power > REFINED * most { self.refined(heard, other_rad).1 } else { power };
                peak.note(power / total);
            }
        }
        Some(peak)
    }

    /// The maxima of a scan: azimuth and power, each the vertex of the parabola through three directions.
    fn maxima(&self, scan: &Scan, mut note: impl FnMut(f32, f32)) {
        let powers = scan.powers.get(..self.directions).unwrap_or_default();
        let (Some(first), Some(last)) = (powers.first(), powers.last()) else { return };
        let (mut before, mut power) = (*last, *first);
        for (k, behind) in powers.iter().skip(1).chain([first]).enumerate() {
            if power >= before && power > *behind {
                // The sum is above zero: the last is less than the middle one.
                let part = 0.5 * (behind - before) / (2.0 * power - before - behind);
                note((k as f32 + part) * self.step_rad, power + 0.25 * (behind - before) * part);
            }
            (before, power) = (power, *behind);
        }
    }

    /// The maximum near an azimuth, and its power.
    fn refined(&self, heard: &impl Heard, azimuth_rad: f32) -> (f32, f32) {
        let mut azimuth_rad = azimuth_rad;
        let most_rad = 0.5 * self.step_rad;
        let mut steps = 0;
        loop {
            let Near { power, slope, bend } = heard.near(self, azimuth_rad);
            // Where the power bends upwards, the maximum is uphill.
            let wanted_rad = if bend < 0.0 { -slope / bend } else { libm::copysignf(0.5 * most_rad, slope) };
            let step_rad = between(wanted_rad, -most_rad, most_rad);
            (azimuth_rad, steps) = (azimuth_rad + step_rad, steps + 1);
            if libm::fabsf(step_rad) * self.reach < STEP_LAST || steps == STEPS_MAX {
                return (azimuth_rad, power + step_rad * (slope + 0.5 * step_rad * bend));
            }
        }
    }

    /// See [`Peak::sensitivity`].
    fn sensitivity(&self, azimuth_rad: f32, heard: &impl Heard) -> f32 {
        let (sine, cosine) = sin_cos(azimuth_rad);
        let (mut sum, mut squares, mut count) = (0.0_f32, 0.0_f32, 0.0_f32);
        for (k, [x, y]) in self.steering.iter().enumerate().take(self.count) {
            if heard.lives(k) {
                let slope = y * cosine - x * sine;
                (sum, squares, count) = (sum + slope, squares + slope * slope, count + 1.0);
            }
        }
        if count > 0.0 { (squares - sum * sum / count).max(0.0) } else { 0.0 }
    }
}
