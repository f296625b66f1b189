//! Cosine and sine of a phase in turns, in integers, at compile time and at run time.

#![deny(clippy::float_arithmetic)]

/// One in the format of this file, Q30.
pub const ONE: i32 = 1 << 30;

/// Cosine and sine in Q30 of a phase whose 2^32 is one turn; within 4 units in the last place.
///
/// Reduced to an eighth of a turn either side of a quadrant, then the Taylor series in nested form:
/// `cos x = 1 - x^2/2 (1 - x^2/12 (1 - ...))`, `sin x = x (1 - x^2/6 (1 - x^2/20 (1 - ...)))`.
#[must_use]
pub const fn cos_sin(phase: u32) -> (i32, i32) {
    // 2 pi in Q29, truncated to an integer.
    const TAU_Q29: i64 = 3_373_259_426;
    let quadrant = phase.wrapping_add(1 << 29) >> 30;
    let offset = phase.wrapping_sub(quadrant << 30) as i32 as i64;
    // Q32 turns times Q29 is Q61; x in Q30.
    let x = ((offset * TAU_Q29 + (1 << 30)) >> 31) as i32;
    let x2 = product(x, x);
    let cosine = nested(x2, &COSINE);
    let sine = product(x, nested(x2, &SINE));
    match quadrant & 3 {
        0 => (cosine, sine),
        1 => (-sine, cosine),
        2 => (-cosine, -sine),
        _ => (sine, -cosine),
    }
}

/// Reciprocals in Q30 of the divisors of the series' terms.
const COSINE: [i32; 5] = reciprocals([2, 12, 30, 56, 90]);
const SINE: [i32; 5] = reciprocals([6, 20, 42, 72, 110]);

const fn reciprocals(divisors: [i32; 5]) -> [i32; 5] {
    let mut result = divisors;
    let mut i = 0;
    while i < result.len() {
        result[i] = (ONE + divisors[i] / 2) / divisors[i];
        i += 1;
    }
    result
}

/// `1 - r0 x2 (1 - r1 x2 (1 - ...))` in Q30.
#[inline(always)]
const fn nested(x2: i32, reciprocals: &[i32; 5]) -> i32 {
    let mut sum = ONE;
    let mut i = reciprocals.len();
    while i > 0 {
        i -= 1;
        sum = ONE - product(product(sum, x2), reciprocals[i]);
    }
    sum
}

/// Product in Q30, rounded.
#[inline(always)]
const fn product(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64 + (1 << 29)) >> 30) as i32
}

/// A phasor that turns by the same angle at every step, in Q30.
#[derive(Clone, Copy, Debug)]
pub struct Oscillator {
    cosine: i32,
    sine: i32,
    step_cosine: i32,
    step_sine: i32,
}

impl Oscillator {
    /// Starts at phase `start`; 2^32 is one turn.
    #[must_use]
    pub const fn new(start: u32, step: u32) -> Self {
        let (cosine, sine) = cos_sin(start);
        let (step_cosine, step_sine) = cos_sin(step);
        Self { cosine, sine, step_cosine, step_sine }
    }

    /// Cosine and sine now; then turns.
    #[inline(always)]
    pub fn turn(&mut self) -> (i32, i32) {
        let now = (self.cosine, self.sine);
        let product = |a: i32, b: i32| ((i64::from(a) * i64::from(b)) >> 32) as i32;
        self.cosine = (product(now.0, self.step_cosine) - product(now.1, self.step_sine)) << 2;
        self.sine = (product(now.0, self.step_sine) + product(now.1, self.step_cosine)) << 2;
        now
    }
}

#[cfg(test)]
#[expect(clippy::float_arithmetic, reason = "the oracle is f64")]
mod tests {
    use super::*;

    fn truth(phase: f64) -> (f64, f64) {
        let (sine, cosine) = (phase / 4_294_967_296.0 * std::f64::consts::TAU).sin_cos();
        (cosine * f64::from(ONE), sine * f64::from(ONE))
    }

    #[test]
    fn cosine_and_sine_are_within_four_units_of_f64_everywhere() {
        let mut worst = 0.0_f64;
        for k in 0..200_000_u32 {
            let phase = k.wrapping_mul(0x9e37_79b9);
            let (cosine, sine) = cos_sin(phase);
            let (c, s) = truth(f64::from(phase));
            worst = worst.max((f64::from(cosine) - c).abs()).max((f64::from(sine) - s).abs());
        }
        assert!(worst <= 4.0, "{worst}");
        for (phase, expected) in [(0, (ONE, 0)), (1 << 30, (0, ONE)), (1 << 31, (-ONE, 0)), (3 << 30, (0, -ONE))] {
            assert_eq!(cos_sin(phase), expected);
        }
    }

    #[test]
    fn an_oscillator_keeps_amplitude_and_phase_over_the_longest_half_block() {
        let mut worst = 0.0_f64;
        for step in [0x0200_0000_u32, 0x1234_5678, 0x4000_0000, 0x7f00_0001, 0x0080_0003] {
            let mut oscillator = Oscillator::new(step / 2, step);
            for k in 0..512 {
                let (c, s) = truth(f64::from(step / 2) + f64::from(step) * f64::from(k));
                let (cosine, sine) = oscillator.turn();
                worst = worst.max((f64::from(cosine) - c).abs()).max((f64::from(sine) - s).abs());
            }
        }
        // 2e-6, a tenth of the resolution of the finest table built from it.
        assert!(worst / f64::from(ONE) < 2e-6, "{}", worst / f64::from(ONE));
    }
}
