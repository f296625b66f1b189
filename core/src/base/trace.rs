//! The trace hash: 64 bits over every bearing, plan and setpoint, used to compare host and target.

/// A running hash over 32-bit words: FNV-1a's multiplication, a word instead of a byte at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Trace(u64);

impl Default for Trace {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Trace {
    /// Adds one word.
    pub fn word(&mut self, word: u32) {
        self.0 = (self.0 ^ u64::from(word)).wrapping_mul(0x0000_0100_0000_01b3);
    }

    /// Adds the bits of a float; both zeros count as one.
    pub fn float(&mut self, value: f32) {
        self.word((value + 0.0).to_bits());
    }

    /// The hash so far.
    #[must_use]
    pub fn hash(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_and_single_bits_matter_and_the_sign_of_zero_does_not() {
        let hash = |values: &[f32]| {
            let mut trace = Trace::default();
            values.iter().for_each(|value| trace.float(*value));
            trace.hash()
        };
        assert_ne!(hash(&[1.0, 2.0]), hash(&[2.0, 1.0]));
        assert_ne!(hash(&[1.0]), hash(&[f32::from_bits(1.0_f32.to_bits() + 1)]));
        assert_eq!(hash(&[0.0]), hash(&[-0.0]));
    }
}
