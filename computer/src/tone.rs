//! A test tone: the output of a board's digital-to-analogue converter, sample by sample, at the pace of the channels'
//! own samples, so that the tone is coherent with them.
//!
//! 12 turns in 83 samples: 0.14458 of the sample rate, 14.806 kHz at 102.41 kHz, bin 37.01 of 256. The number of
//! samples is prime, so the harmonics 2 to 81 from nonlinearities fall on other lines, three bins or more from the
//! tone. It shares no factor with the length of a block either: every block begins at another phase, and no two
//! frames look alike.

/// Samples of the whole period.
pub const SAMPLES: usize = 83;
/// Turns of the tone in the period.
pub const TURNS: usize = 12;
/// Amplitude, of 4096 steps: 1.4 V of 3.3 V, the range of a buffered output.
pub const AMPLITUDE_CODES: f64 = 1738.0;
/// The middle.
pub const MIDDLE_CODES: f64 = 2048.0;

/// The samples of one period, unsigned, 12 bits.
pub static TABLE: [u16; SAMPLES] = table();

const fn table() -> [u16; SAMPLES] {
    let mut table = [0; SAMPLES];
    let mut n = 0;
    while n < SAMPLES {
        let turned = (n * TURNS % SAMPLES) as f64 / SAMPLES as f64;
        table[n] = (MIDDLE_CODES + AMPLITUDE_CODES * sine_of_turn(turned) + 0.5) as u16;
        n += 1;
    }
    table
}

/// The sine of a part of a turn, 0..1, by its series about the nearest zero: exact to 1e-9.
const fn sine_of_turn(turned: f64) -> f64 {
    // Into -1/4..1/4 of a turn.
    let folded = if turned < 0.25 {
        turned
    } else if turned < 0.75 {
        0.5 - turned
    } else {
        turned - 1.0
    };
    let x = core::f64::consts::TAU * folded;
    let (mut term, mut sum, mut k) = (x, x, 1.0);
    while k < 8.0 {
        term *= -x * x / ((2.0 * k) * (2.0 * k + 1.0));
        sum += term;
        k += 1.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SAMPLES_PER_CHANNEL as N;

    #[test]
    fn the_table_is_a_sine_to_half_a_code_inside_what_the_output_can_do() {
        for (n, code) in TABLE.iter().enumerate() {
            let truth = 2048.0 + 1738.0 * (std::f64::consts::TAU * 12.0 * n as f64 / 83.0).sin();
            assert!((f64::from(*code) - truth).abs() <= 0.5 + 1e-6, "{n}: {code} {truth}");
        }
        // 0.2 V from either supply.
        assert!(TABLE.iter().all(|code| (249..=3847).contains(code)));
    }

    #[test]
    fn no_harmonic_comes_near_the_tone_and_no_block_begins_as_the_one_before() {
        let bin = |harmonic: usize| {
            let turned = (harmonic * TURNS) as f64 / SAMPLES as f64;
            N as f64 * (turned - turned.round()).abs()
        };
        assert!((bin(1) - 37.0).abs() < 0.02);
        assert!((2..=81).all(|harmonic| (bin(harmonic) - bin(1)).abs() > 3.0));
        assert!((1..SAMPLES).all(|blocks| !(blocks * N).is_multiple_of(SAMPLES)));
    }
}
