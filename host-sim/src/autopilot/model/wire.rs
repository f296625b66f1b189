//! A line that loses and changes bytes, in both directions.

use crate::world::random::Random;

/// A bad line. Each direction has its own random numbers, so that the traffic of one does not affect the other.
#[derive(Clone, Debug)]
pub struct Wire {
    to_companion: Random,
    to_autopilot: Random,
    /// Share of the bytes that get lost.
    pub loss: f64,
    /// Share of the bytes that arrive changed.
    pub corruption: f64,
}

impl Wire {
    /// A line with shares of lost and of changed bytes.
    #[must_use]
    pub fn new(seed: u64, loss: f64, corruption: f64) -> Self {
        let purpose = |way: u64| Random::new(seed, 0x11e0 + way);
        Self { to_companion: purpose(0), to_autopilot: purpose(1), loss, corruption }
    }

    /// The bytes that arrive at the companion.
    #[must_use]
    pub fn to_companion(&mut self, bytes: &[u8]) -> Vec<u8> {
        carry(&mut self.to_companion, self.loss, self.corruption, bytes)
    }

    /// The bytes that arrive at the autopilot.
    #[must_use]
    pub fn to_autopilot(&mut self, bytes: &[u8]) -> Vec<u8> {
        carry(&mut self.to_autopilot, self.loss, self.corruption, bytes)
    }
}

fn carry(random: &mut Random, loss: f64, corruption: f64, bytes: &[u8]) -> Vec<u8> {
    let mut arrive = |byte: u8| {
        let (is_lost, is_changed) = (random.uniform() < loss, random.uniform() < corruption);
        let flip = 1 + (random.uniform() * 255.0) as u8;
        (!is_lost).then_some(if is_changed { byte ^ flip } else { byte })
    };
    bytes.iter().filter_map(|byte| arrive(*byte)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_wire_loses_and_changes_as_many_bytes_as_it_should_and_a_good_one_none() {
        let sent = vec![0x55; 100_000];
        assert_eq!(Wire::new(1, 0.0, 0.0).to_companion(&sent), sent);
        let mut wire = Wire::new(1, 0.02, 0.01);
        let arrived = wire.to_autopilot(&sent);
        let lost = (sent.len() - arrived.len()) as f64 / 1e5;
        let changed = arrived.iter().filter(|byte| **byte != 0x55).count() as f64 / 1e5;
        assert!((lost - 0.02).abs() < 0.002 && (changed - 0.0098).abs() < 0.0015, "{lost} {changed}");
        assert_eq!(Wire::new(1, 0.02, 0.01).to_autopilot(&sent), arrived, "seeded");
        assert_ne!(wire.to_companion(&sent), arrived, "each way by itself");
    }
}
