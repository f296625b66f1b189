//! What `foxhound calibrate` fits to the measured channels: their sampling delays, and the deviation.
//!
//! **Sampling delays** rotate the phases in proportion to the frequency: two entries or more, at one carrier, give
//! them as the slope `2 pi tau_m`, relative to their mean. The steps of the phases from one entry to the next must
//! stay below half a turn.
//!
//! **Deviation**: hover, yaw once around in front of a source whose direction is known, and fit `estimate - truth` as a
//! function of the estimated body azimuth, by least squares (nine normal equations, Cholesky). This is how a ship's
//! compass is swung.

use std::f32::consts::TAU;

use foxhound_core::base::adc::CHANNELS;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::doa::array::{Entry, phase_steps};
use foxhound_core::doa::bearing::Bearing;
use foxhound_core::doa::calibration::deviation::{Deviation, ORDER, TERMS, terms};

/// Sectors of the circle, each of which must have been seen.
const SECTORS: usize = 12;

/// The channels' sampling delays relative to their mean, from entries of one carrier by rising frequency, whose
/// phases are corrected for them; add them to the array file's `skew_s`. `None` with fewer than two
/// entries.
pub(super) fn take_skew(entries: &mut [Entry]) -> Option<[f32; CHANNELS]> {
    let [first, .., last] = entries else { return None };
    if !(last.frequency_hz > first.frequency_hz) {
        return None;
    }
    // Least squares of the unwrapped phases over the frequency.
    let origin = *first;
    let n = entries.len() as f32;
    let (mut phases, mut before) = ([0.0_f32; CHANNELS], origin);
    let (mut f, mut ff) = (0.0, 0.0);
    let (mut p, mut fp) = ([0.0_f32; CHANNELS], [0.0_f32; CHANNELS]);
    for entry in entries.iter() {
        let steps = phase_steps(&before, entry);
        let away_hz = entry.frequency_hz - origin.frequency_hz;
        (f, ff) = (f + away_hz, ff + away_hz * away_hz);
        for m in 0..CHANNELS {
            phases[m] += steps[m];
            p[m] += phases[m];
            fp[m] += away_hz * phases[m];
        }
        before = *entry;
    }
    let slope: [f32; CHANNELS] = std::array::from_fn(|m| (n * fp[m] - f * p[m]) / (n * ff - f * f));
    let common = slope.iter().sum::<f32>() / CHANNELS as f32;
    let skew_s = slope.map(|slope| (slope - common) / TAU);
    for entry in entries {
        for (phase_rad, skew_s) in entry.phase_rad.iter_mut().zip(skew_s) {
            *phase_rad = wrap_pi(*phase_rad - TAU * entry.frequency_hz * skew_s);
        }
    }
    Some(skew_s)
}

/// Measurements during a turn on the spot.
#[derive(Clone, Debug, Default)]
pub(super) struct Spin {
    normal: [[f32; TERMS]; TERMS],
    right: [f32; TERMS],
    squares: f32,
    looks: u32,
    seen: u16,
}

impl Spin {
    /// Takes a bearing and its true body azimuth; an invalid one changes nothing.
    pub(super) fn step(&mut self, bearing: &Bearing, truth_rad: f32) {
        let error_rad = wrap_pi(bearing.azimuth_rad - truth_rad);
        if !bearing.valid || !error_rad.is_finite() {
            return;
        }
        let terms = terms(bearing.azimuth_rad);
        for ((row, right), a) in self.normal.iter_mut().zip(&mut self.right).zip(terms) {
            for (sum, b) in row.iter_mut().zip(terms) {
                *sum += a * b;
            }
            *right += a * error_rad;
        }
        self.squares += error_rad * error_rad;
        self.looks += 1;
        let turn = 0.5 + wrap_pi(bearing.azimuth_rad) / TAU;
        self.seen |= 1 << ((turn * SECTORS as f32) as usize).min(SECTORS - 1);
    }

    /// The deviation; `None` while some twelfth of the circle is missing or there are too few measurements.
    pub(super) fn deviation(&self) -> Option<Deviation> {
        if self.seen != (1 << SECTORS) - 1 || self.looks < 2 * TERMS as u32 {
            return None;
        }
        let x = solve(self.normal, self.right)?;
        let explained: f32 = x.iter().zip(self.right).map(|(x, right)| x * right).sum();
        let freedom = (self.looks - TERMS as u32) as f32;
        let variance = (self.squares - explained).max(0.0) / freedom;
        Some(Deviation {
            constant_rad: x[0],
            cosine_rad: std::array::from_fn(|k| x[1 + k]),
            sine_rad: std::array::from_fn(|k| x[1 + ORDER + k]),
            sigma_rad: f32::sqrt(variance * TERMS as f32 / self.looks as f32),
        })
    }
}

/// Solves a symmetric positive definite system; `None` when it is not.
fn solve(mut a: [[f32; TERMS]; TERMS], mut x: [f32; TERMS]) -> Option<[f32; TERMS]> {
    let least = 1e-4 * a[0][0];
    for i in 0..TERMS {
        for j in 0..=i {
            let sum = a[i][j] - (0..j).map(|k| a[i][k] * a[j][k]).sum::<f32>();
            if i != j {
                a[i][j] = sum / a[j][j];
            } else if sum > least {
                a[i][i] = f32::sqrt(sum);
            } else {
                return None;
            }
        }
    }
    for i in 0..TERMS {
        x[i] = (x[i] - (0..i).map(|k| a[i][k] * x[k]).sum::<f32>()) / a[i][i];
    }
    for i in (0..TERMS).rev() {
        x[i] = (x[i] - (i + 1..TERMS).map(|k| a[k][i] * x[k]).sum::<f32>()) / a[i][i];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::base::rng::Rng;
    use foxhound_core::base::time::Instant;
    use foxhound_core::doa::bearing::{Flags, Quality};
    use std::f64::consts::TAU;

    fn error_rad(found: f32, truth: f64) -> f64 {
        let difference = f64::from(found) - truth;
        difference.sin().atan2(difference.cos())
    }

    fn bearing(azimuth_rad: f64) -> Bearing {
        let without = Bearing::without(Instant(0), Quality::default(), Flags::default());
        Bearing { valid: true, azimuth_rad: wrap_pi(azimuth_rad as f32), sigma_rad: 0.002, ..without }
    }

    /// The estimate for a truth: an airframe that turns bearings by up to 9 deg, 0.2 of it in the fifth harmonic.
    fn estimate(truth: f64) -> f64 {
        let d = 2.0 + 4.0 * (truth - 0.3).sin() + 2.0 * (2.0 * truth).cos() - 1.0 * (4.0 * truth + 1.0).sin();
        truth + (d + 0.2 * (5.0 * truth).sin()).to_radians()
    }

    fn spin(looks: u32, noise_rad: f32, turns: f64, rng: &mut Rng) -> Spin {
        let mut spin = Spin::default();
        for k in 0..looks {
            let truth = TAU * turns * f64::from(k) / f64::from(looks) - 2.0;
            spin.step(&bearing(estimate(truth) + f64::from(noise_rad * rng.gaussian())), wrap_pi(truth as f32));
        }
        spin
    }

    #[test]
    fn a_turn_on_the_spot_takes_degrees_of_deviation_down_to_tenths() {
        let mut rng = Rng::new(1, 1);
        let deviation = spin(720, 0.0025, 1.0, &mut rng).deviation().unwrap();
        let (mut before, mut after) = (0.0, 0.0);
        for degree in 0..360 {
            let truth = f64::from(degree).to_radians();
            let raw = bearing(estimate(truth));
            before += error_rad(raw.azimuth_rad, truth).powi(2) / 360.0;
            after += error_rad(deviation.apply(&raw).azimuth_rad, truth).powi(2) / 360.0;
        }
        let (before, after) = (before.sqrt().to_degrees(), after.sqrt().to_degrees());
        assert!(before > 3.5, "{before}");
        // The harmonics above the fourth remain; as a function of the estimate there are some more of them.
        assert!(after < 0.30, "{after}");
    }

    #[test]
    fn the_fit_is_exact_for_a_series_of_order_four_and_says_how_sure_it_is() {
        let truth = Deviation {
            constant_rad: 0.03,
            cosine_rad: [0.05, -0.02, 0.0, 0.01],
            sine_rad: [-0.04, 0.0, 0.03, -0.01],
            sigma_rad: 0.0,
        };
        let mut rng = Rng::new(2, 1);
        for (noise_rad, bound) in [(0.0, 1e-5), (0.01, 0.004)] {
            let mut spin = Spin::default();
            for k in 0..360 {
                let azimuth = wrap_pi(f64::from(k).to_radians() as f32);
                let found = bearing(f64::from(azimuth + noise_rad * rng.gaussian()));
                spin.step(&found, wrap_pi(azimuth - truth.at(azimuth)));
            }
            let found = spin.deviation().unwrap();
            let mut worst = 0.0_f32;
            for k in 0..100 {
                let azimuth = k as f32 * 0.06 - 3.0;
                worst = worst.max((found.at(azimuth) - truth.at(azimuth)).abs());
            }
            assert!(worst < bound, "{worst}");
            let expected = noise_rad * (9.0_f32 / 360.0).sqrt();
            assert!((found.sigma_rad - expected).abs() < 0.2 * expected + 1e-5, "{} {expected}", found.sigma_rad);
        }
    }

    #[test]
    fn an_unfinished_turn_and_useless_bearings_give_no_deviation() {
        let mut rng = Rng::new(3, 1);
        assert!(spin(720, 0.0, 0.8, &mut rng).deviation().is_none());
        assert!(spin(12, 0.0, 1.0, &mut rng).deviation().is_none());
        assert!(Spin::default().deviation().is_none());
        let mut spin = Spin::default();
        for k in 0..720 {
            spin.step(&Bearing { valid: false, ..bearing(f64::from(k)) }, 0.0);
            spin.step(&bearing(f64::NAN), 0.0);
        }
        assert!(spin.deviation().is_none());
    }

    #[test]
    fn the_delays_are_the_slopes_of_the_phases_and_are_taken_off_them() {
        let (rest_rad, delay_s) = ([0.1, -0.9, 2.0, -1.2], [0.0, 7.3e-6, -5.9e-6, 3.0e-6_f32]);
        let mean_s = delay_s.iter().sum::<f32>() / 4.0;
        let entry = |frequency_hz: f32| Entry {
            frequency_hz,
            gain: [1.0; 4],
            phase_rad: std::array::from_fn(|m| wrap_pi(rest_rad[m] + TAU as f32 * frequency_hz * delay_s[m])),
            ..Entry::default()
        };
        for frequencies_hz in [&[8e3, 30e3][..], &[6e3, 19e3, 32e3, 44e3]] {
            let mut entries: Vec<Entry> = frequencies_hz.iter().map(|frequency_hz| entry(*frequency_hz)).collect();
            let skew_s = take_skew(&mut entries).unwrap();
            for (skew_s, truth_s) in skew_s.iter().zip(delay_s) {
                assert!((skew_s - (truth_s - mean_s)).abs() < 1e-9, "{frequencies_hz:?}: {skew_s}");
            }
            for entry in entries {
                let left = |m: usize| wrap_pi(entry.phase_rad[m] - entry.phase_rad[0] - (rest_rad[m] - rest_rad[0]));
                assert!((1..4).all(|m| left(m).abs() < 1e-4), "{entry:?}");
            }
        }
        assert!(take_skew(&mut [entry(8e3)]).is_none());
    }
}
