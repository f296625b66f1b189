//! Errors of the ranges that an obstacle sensor measures.

use super::random::Random;
use crate::scenario::Sensor;

/// The errors of one sensor.
#[derive(Clone, Debug)]
pub struct Ranging {
    noise_m: f64,
    missed: f64,
    range_max_m: f64,
    random: Random,
}

impl Ranging {
    /// Those of a scenario's sensor.
    #[must_use]
    pub fn new(sensor: &Sensor, random: Random) -> Self {
        let Sensor { noise_m, missed, range_m, .. } = *sensor;
        Self { noise_m, missed, range_max_m: range_m, random }
    }

    /// What is measured of a range; nothing where too little comes back, or beyond the sensor's range.
    pub fn measure(&mut self, range_m: f64) -> Option<f64> {
        if self.missed > 0.0 && self.random.uniform() < self.missed {
            return None;
        }
        let error_m = if self.noise_m > 0.0 { self.noise_m * self.random.gaussian() } else { 0.0 };
        Some((range_m + error_m).max(0.0)).filter(|measured_m| *measured_m <= self.range_max_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_off_by_the_noise_and_a_share_is_missed() {
        let sensor = Sensor { noise_m: 0.03, missed: 0.1, ..Sensor::default() };
        let mut ranging = Ranging::new(&sensor, Random::new(1, 6));
        let errors_m: Vec<f64> =
            (0..10_000).filter_map(|_| ranging.measure(2.0)).map(|range_m| range_m - 2.0).collect();
        assert!((errors_m.len() as f64 - 9000.0).abs() < 150.0, "{}", errors_m.len());
        let variance_m2 = errors_m.iter().map(|error_m| error_m * error_m).sum::<f64>() / errors_m.len() as f64;
        assert!((variance_m2.sqrt() - 0.03).abs() < 0.001, "{variance_m2}");
        let beyond = (0..1000).filter(|_| ranging.measure(sensor.range_m).is_none()).count();
        assert!((500..600).contains(&beyond), "{beyond}");
    }

    #[test]
    fn without_errors_ranges_are_exact() {
        let mut ranging = Ranging::new(&Sensor::default(), Random::new(1, 6));
        assert_eq!((ranging.measure(2.0), ranging.measure(3.0)), (Some(2.0), Some(3.0)));
    }
}
