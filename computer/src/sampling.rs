//! Sample rates that a timer can have.
//!
//! A timer counts whole cycles of its clock from sample to sample, so that not every rate is possible. The timer's
//! actual rate is written back into the configuration, so that all frequencies computed from it are right.

use foxhound_core::base::error::{ConfigError, Why, check};
use foxhound_core::guidance;

use crate::SAMPLES_PER_CHANNEL as N;

const RATE: &str = "phase.sample_rate_hz";
/// Largest relative difference between the requested and the nearest possible rate.
const OFF_MAX: f32 = 100e-6;
/// Largest relative difference between the period of the frames and that of the steps.
const PERIOD_OFF_MAX: f32 = 0.05;

/// The timer that triggers every sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timer {
    /// Its clock.
    pub clock_hz: u32,
    /// Duration of one sample: sampling, conversion, and what precedes them.
    pub cycles_min: u32,
    /// Largest count.
    pub cycles_max: u32,
}

/// A timer's sampling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// From sample to sample.
    pub cycles: u32,
    /// The resulting rate.
    pub rate_hz: f32,
    /// One in this many successive blocks is a frame: one per step.
    pub blocks: u32,
}

impl Timer {
    /// The sampling for this configuration.
    ///
    /// # Errors
    /// `phase.sample_rate_hz` if a sample takes longer than that, the timer cannot count that far, or no count comes
    /// within 100 ppm; `tick_s` if it is not a whole number of blocks.
    pub fn sampling(&self, config: &guidance::Config) -> Result<Sampling, ConfigError> {
        let clock_hz = self.clock_hz as f32;
        let (slowest, fastest) = (clock_hz / self.cycles_max as f32, clock_hz / self.cycles_min as f32);
        let wanted_hz = check(RATE, config.phase.sample_rate_hz, slowest, fastest)?;
        let cycles = libm::roundf(clock_hz / wanted_hz);
        let rate_hz = clock_hz / cycles;
        if libm::fabsf(rate_hz - wanted_hz) > OFF_MAX * wanted_hz {
            let why = Why::Inconsistent("the sample timer has no rate within 100 ppm of this");
            return Err(ConfigError { field: RATE, value: wanted_hz, why });
        }
        let tick_blocks = check("tick_s", config.tick_s, 0.005, 0.1)? * rate_hz / N as f32;
        let blocks = libm::roundf(tick_blocks);
        if blocks < 1.0 || libm::fabsf(blocks - tick_blocks) > PERIOD_OFF_MAX * tick_blocks {
            let why = Why::Inconsistent("it is not a whole number of blocks of 256 samples");
            return Err(ConfigError { field: "tick_s", value: config.tick_s, why });
        }
        Ok(Sampling { cycles: cycles as u32, rate_hz, blocks: blocks as u32 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As that of the NUCLEO-G474RE.
    const TIMER: Timer = Timer { clock_hz: 42_500_000, cycles_min: 108, cycles_max: 1 << 16 };

    fn config(rate_hz: f32, tick_s: f32) -> guidance::Config {
        let mut config = guidance::Config { tick_s, ..guidance::Config::default() };
        config.phase.sample_rate_hz = rate_hz;
        config
    }

    #[test]
    fn the_default_rate_is_had_within_94_ppm_and_a_frame_comes_with_every_step() {
        let sampling = TIMER.sampling(&guidance::Config::default()).unwrap();
        assert_eq!((sampling.cycles, sampling.blocks), (415, 8));
        // 42.5 MHz / 415, in double precision.
        assert!((f64::from(sampling.rate_hz) - 42.5e6 / 415.0).abs() < 0.005);
    }

    #[test]
    fn a_rate_that_a_timer_has_is_had_again() {
        for cycles in [108, 125, 414, 415, 416, 1_751, 3_250] {
            let rate_hz = 42.5e6 / cycles as f32;
            let blocks = (0.02 * rate_hz / 256.0).round().max(1.0);
            let tick_s = (blocks * 256.0 / rate_hz).min(0.1);
            let sampling = TIMER.sampling(&config(rate_hz, tick_s)).unwrap();
            assert_eq!((sampling.cycles, sampling.rate_hz.to_bits()), (cycles, rate_hz.to_bits()));
        }
    }

    #[test]
    fn what_cannot_be_had_is_refused_by_name() {
        let refused = |rate_hz, tick_s| TIMER.sampling(&config(rate_hz, tick_s)).unwrap_err().field;
        // A sample takes 108 cycles; the timer counts to 65 536.
        assert_eq!(refused(394_000.0, 0.02), RATE);
        assert_eq!(refused(640.0, 0.1), RATE);
        assert_eq!(refused(f32::NAN, 0.02), RATE);
        // Between 212 and 213 cycles: 0.24 % from either.
        assert_eq!(refused(42.5e6 / 212.5, 0.02), RATE);
        // 1.17 blocks a step.
        assert_eq!(refused(42.5e6 / 2_833.0, 0.02), "tick_s");
        assert_eq!(refused(5_000.0, 0.02), "tick_s");
    }
}
