//! The senders of frames, and how many of their frames are missing.

use super::Header;

/// Senders whose sequence numbers are followed.
const SENDERS: usize = 8;

/// The latest frame of each of the most recent senders, the latest first.
#[derive(Clone, Debug)]
pub(super) struct Senders {
    latest: [Header; SENDERS],
    count: usize,
}

impl Senders {
    pub(super) const NONE: Self =
        Self { latest: [Header { system_id: 0, component_id: 0, sequence: 0 }; SENDERS], count: 0 };

    /// Takes a frame into account and returns how many are missing before it, as far as sequence numbers, which count to
    /// 255, can say. A new sender replaces the one that has been silent longest.
    #[inline(never)]
    pub(super) fn hear(&mut self, mut latest: Header) -> u32 {
        let same = |(_, other): &(usize, &Header)| {
            other.system_id == latest.system_id && other.component_id == latest.component_id
        };
        let (at, missing) = if let Some((at, last)) = self.latest.iter().take(self.count).enumerate().find(same) {
            // A frame that a router sent twice is no gap.
            (at, latest.sequence.wrapping_sub(last.sequence).saturating_sub(1))
        } else {
            self.count = (self.count + 1).min(SENDERS);
            (self.count - 1, 0)
        };
        for place in self.latest.iter_mut().take(at + 1) {
            latest = core::mem::replace(place, latest);
        }
        u32::from(missing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(component_id: u8, sequence: u8) -> Header {
        Header { system_id: 1, component_id, sequence }
    }

    #[test]
    fn the_ninth_sender_takes_the_place_of_the_one_that_was_silent_longest() {
        let mut senders = Senders::NONE;
        for sequence in 0..3 {
            for component_id in 1..=8 {
                assert_eq!(senders.hear(frame(component_id, sequence)), 0);
            }
        }
        // The first heard of all goes on talking; the second falls silent.
        assert_eq!(senders.hear(frame(1, 5)), 2);
        assert_eq!(senders.hear(frame(9, 77)), 0);
        assert_eq!(senders.latest.map(|latest| latest.component_id), [9, 1, 8, 7, 6, 5, 4, 3]);
        assert_eq!(senders.hear(frame(2, 200)), 0, "forgotten");
    }
}
