//! Who reports obstacles, and how long ago: a source is a component, its message and its sensor.

use foxhound_core::base::time::Instant;

/// Sources that are distinguished; one more replaces the one that has been silent longest.
const SOURCES: usize = 4;
/// A source that has been silent for longer does not report any more.
const SILENT_US: u64 = 1_000_000;

/// Someone who reports obstacles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// Its component.
    pub component_id: u8,
    /// The number of the sensor, where the message has one.
    pub sensor_id: u8,
    /// The message that it sends.
    pub message_id: u16,
}

/// The sources received, the first one first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sources {
    heard: [Option<(Source, Instant)>; SOURCES],
}

impl Sources {
    /// Nobody.
    pub(crate) const fn new() -> Self {
        Self { heard: [None; SOURCES] }
    }

    /// A source has reported.
    pub(crate) fn hear(&mut self, now: Instant, source: Source) {
        let known = self.heard.iter().position(|heard| heard.is_some_and(|(other, _)| other == source));
        let free = || self.heard.iter().position(Option::is_none);
        // An empty slot counts as older than all.
        let oldest = || (0..SOURCES).min_by_key(|at| self.heard[*at].map(|(_, heard)| heard.0));
        let at = known.or_else(free).or_else(oldest);
        if let Some(heard) = at.and_then(|at| self.heard.get_mut(at)) {
            *heard = Some((source, now));
        }
    }

    /// Every source, and how long ago it reported.
    pub(crate) fn ages(&self, now: Instant) -> impl Iterator<Item = (Source, f32)> {
        self.heard.iter().flatten().map(move |(source, heard)| (*source, now.seconds_since(*heard)))
    }

    /// Whether another component than this one reports.
    pub(crate) fn has_other(&self, now: Instant, component_id: u8) -> bool {
        let is_other = |(source, heard): &(Source, Instant)| {
            source.component_id != component_id && now < heard.plus_micros(SILENT_US)
        };
        self.heard.iter().flatten().any(is_other)
    }

    /// Handles a clock that ran backwards: nothing is younger than now.
    pub(crate) fn follow_clock(&mut self, now: Instant) {
        for (_, heard) in self.heard.iter_mut().flatten() {
            *heard = (*heard).min(now);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn source(component_id: u8) -> Source {
        Source { component_id, message_id: 330, sensor_id: 0 }
    }

    #[test]
    fn each_source_has_an_age_of_its_own_and_the_most_silent_makes_room() {
        let mut sources = Sources::new();
        for component in 1..=4 {
            sources.hear(Instant(u64::from(component) * 1_000_000), source(component));
        }
        sources.hear(Instant(5_000_000), source(1));
        let ages: Vec<_> = sources.ages(Instant(6_000_000)).collect();
        assert_eq!(ages, [(source(1), 1.0), (source(2), 4.0), (source(3), 3.0), (source(4), 2.0)]);
        sources.hear(Instant(6_000_000), source(9));
        // Of the others than 9, the last one to be heard was 1, at 5 s.
        assert!(sources.has_other(Instant(6_500_000), 1));
        assert!(!sources.has_other(Instant(6_500_000), 9));
        let there: Vec<u8> = sources.ages(Instant(6_000_000)).map(|(source, _)| source.component_id).collect();
        assert_eq!(there, [1, 9, 3, 4]);
        sources.follow_clock(Instant(2_500_000));
        assert!(sources.ages(Instant(2_500_000)).all(|(_, age)| age == 0.0));
    }
}
