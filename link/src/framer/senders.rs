//! The senders of frames, and how many of their frames are missing.

use super::Header;

/// Senders whose sequence numbers are followed.
const SENDERS: usize = 8;

/// One sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// Its address, and the sequence number of its latest frame.
    pub latest: Header,
    /// Its frames that arrived.
    pub received: u32,
    /// Its frames that are missing between those that arrived, as far as sequence numbers, which count to 255, can say.
    pub lost: u32,
}

impl Sender {
    const NOBODY: Self = Self { latest: Header { system_id: 0, component_id: 0, sequence: 0 }, received: 0, lost: 0 };
}

/// The most recent senders, the latest first.
#[derive(Clone, Debug)]
pub(super) struct Senders {
    senders: [Sender; SENDERS],
    count: usize,
}

impl Senders {
    pub(super) const NONE: Self = Self { senders: [Sender::NOBODY; SENDERS], count: 0 };

    pub(super) fn all(&self) -> &[Sender] {
        self.senders.get(..self.count).unwrap_or_default()
    }

    /// Takes a frame into account and returns how many are missing before it. A new sender replaces the one that has
    /// been silent longest.
    #[inline(never)]
    pub(super) fn hear(&mut self, latest: Header) -> u32 {
        let is_it = |(_, sender): &(usize, Sender)| {
            sender.latest.system_id == latest.system_id && sender.latest.component_id == latest.component_id
        };
        let known = self.all().iter().copied().enumerate().find(is_it);
        let (at, mut sender, missing) = if let Some((at, sender)) = known {
            // A frame that a router sent twice is no gap.
            let missing = latest.sequence.wrapping_sub(sender.latest.sequence).saturating_sub(1);
            (at, sender, u32::from(missing))
        } else {
            self.count = (self.count + 1).min(SENDERS);
            (self.count - 1, Sender::NOBODY, 0)
        };
        sender.latest = latest;
        sender.received = sender.received.saturating_add(1);
        sender.lost = sender.lost.saturating_add(missing);
        for place in self.senders.iter_mut().take(at + 1) {
            sender = core::mem::replace(place, sender);
        }
        missing
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
        let heard: [(u8, u32, u32); SENDERS] =
            core::array::from_fn(|at| senders.all()[at]).map(|s: Sender| (s.latest.component_id, s.received, s.lost));
        let expected = [9, 1, 8, 7, 6, 5, 4, 3].map(|id| match id {
            9 => (9, 1, 0),
            1 => (1, 4, 2),
            _ => (id, 3, 0),
        });
        assert_eq!(heard, expected);
        assert_eq!(senders.hear(frame(2, 200)), 0, "forgotten");
    }

    #[test]
    fn no_count_overflows() {
        let mut senders = Senders::NONE;
        senders.hear(frame(1, 0));
        senders.senders[0].received = u32::MAX;
        senders.senders[0].lost = u32::MAX - 1;
        assert_eq!(senders.hear(frame(1, 100)), 99);
        assert_eq!((senders.all()[0].received, senders.all()[0].lost), (u32::MAX, u32::MAX));
    }
}
