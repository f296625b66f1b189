//! A suite in parts, each flown by its own process, on any machine.
//!
//! Part K of N has every Nth flight from the Kth on, so that the parts take about equally long whatever the order of
//! the maps. Sums of floating-point numbers depend on their order: a part therefore stores its flights, and [`merge`]
//! restores the order of the suite before they are summed up. The sums are then, to the last bit, those of the suite
//! flown in one piece.
//!
//! A part is a file of JSON lines: a [`Header`], then a line for each flight. The header's fingerprint distinguishes
//! parts of another suite, seed, planner or release.

use std::fmt;
use std::str::FromStr;

use foxhound_core::doa::bearing::Estimator;
use foxhound_core::planning::planner;
use serde::{Deserialize, Serialize};

use super::{Flown, Selection, Suite};
use crate::drive::lines::hash;
use crate::scenario::input::InputError;

/// Largest number of parts of a suite.
const PARTS_MAX: usize = 100_000;

/// Part K of N.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 1 on.
    number: usize,
    of: usize,
}

impl FromStr for Shard {
    type Err = InputError;

    fn from_str(text: &str) -> Result<Self, InputError> {
        let parts = text.split_once('/').map(|(number, of)| (number.parse(), of.parse()));
        match parts {
            Some((Ok(number), Ok(of))) if 1 <= number && number <= of && of <= PARTS_MAX => Ok(Self { number, of }),
            _ => Err(InputError::new(format!("expected K/N, with K in 1..=N and N in 1..={PARTS_MAX}"))),
        }
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl Shard {
    /// The whole suite.
    #[must_use]
    pub const fn whole() -> Self {
        Self { number: 1, of: 1 }
    }

    /// Whether the suite's flight of this number, from 0 on, belongs to it.
    #[must_use]
    pub const fn takes(self, flight: usize) -> bool {
        flight % self.of == self.number - 1
    }

    /// How many of `flights` belong to it.
    const fn share(self, flights: usize) -> usize {
        flights.saturating_sub(self.number - 1).div_ceil(self.of)
    }

    /// The name of its file.
    #[must_use]
    pub fn file_name(self) -> String {
        format!("shard-{}-of-{}.jsonl", self.number, self.of)
    }

    /// The first line of its file, for a suite of this many flights.
    #[must_use]
    pub const fn header(self, flights: usize, fingerprint: String) -> Header {
        Header { shard: self.number, of: self.of, flights, fingerprint }
    }
}

/// The first line of a part's file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// Number of the part, from 1 on.
    pub shard: usize,
    /// Number of parts.
    pub of: usize,
    /// Flights of all parts together.
    pub flights: usize,
    /// Hash over everything that determines the flights.
    pub fingerprint: String,
}

/// Hash over everything that determines the flights: release, suite, selection, seed, planner, estimator.
///
/// # Errors
/// The suite holds a number that JSON cannot express.
pub fn fingerprint(
    suite: &Suite,
    selection: &Selection,
    seed: u64,
    planner: planner::Config,
    estimator: Estimator,
) -> Result<String, InputError> {
    let suite = serde_json::to_string(suite).map_err(|error| InputError::new(error.to_string()))?;
    let Selection { only, pairs, shard: _ } = selection;
    let release = env!("CARGO_PKG_VERSION");
    let text = format!("{release} {suite} {only:?} {pairs:?} {seed} {planner:?} {estimator:?}");
    Ok(hash(text.as_bytes()))
}

/// A part that was flown.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    shard: Shard,
    header: Header,
    flown: Vec<Flown>,
}

impl Part {
    /// Reads a part's file.
    ///
    /// # Errors
    /// The line and its error, or how many are missing.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        let in_line = |line: usize, error: serde_json::Error| InputError::new(format!("line {line}: {error}"));
        let mut lines = text.lines();
        let header: Header =
            serde_json::from_str(lines.next().unwrap_or_default()).map_err(|error| in_line(1, error))?;
        let shard: Shard = format!("{}/{}", header.shard, header.of)
            .parse()
            .map_err(|error| InputError::new(format!("line 1: shard {}/{}: {error}", header.shard, header.of)))?;
        let flown: Vec<Flown> = (2..)
            .zip(lines)
            .map(|(line, text)| serde_json::from_str(text).map_err(|error| in_line(line, error)))
            .collect::<Result<_, _>>()?;
        let expected = shard.share(header.flights);
        if flown.len() != expected {
            return Err(InputError::new(format!("{} flights of the {expected} of shard {shard}", flown.len())));
        }
        Ok(Self { shard, header, flown })
    }
}

/// The flights of all parts, in the order of the suite.
///
/// # Errors
/// Parts of different suites, a part twice, or the parts that are missing.
pub fn merge(mut parts: Vec<Part>) -> Result<Vec<Flown>, InputError> {
    parts.sort_by_key(|part| part.shard.number);
    let Some(first) = parts.first().map(|part| part.header.clone()) else {
        return Err(InputError::new("no shards given"));
    };
    for part in &parts {
        let Header { of, flights, fingerprint, .. } = &part.header;
        if (*of, *flights, fingerprint) != (first.of, first.flights, &first.fingerprint) {
            return Err(InputError::new(format!(
                "shard {} is of another suite, seed or release than shard {}/{}",
                part.shard, first.shard, first.of
            )));
        }
    }
    if let Some(twice) = parts.windows(2).find(|pair| pair[0].shard == pair[1].shard) {
        return Err(InputError::new(format!("shard {} was given twice", twice[0].shard)));
    }
    if parts.len() != first.of {
        let missing = (1..=first.of).find(|number| parts.iter().all(|part| part.shard.number != *number));
        return Err(InputError::new(format!(
            "shard {}/{} is missing, {} in all",
            missing.unwrap_or_default(),
            first.of,
            first.of - parts.len()
        )));
    }
    let mut rests: Vec<_> = parts.into_iter().map(|part| part.flown.into_iter()).collect();
    Ok((0..first.flights).filter_map(|flight| rests[flight % first.of].next()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shard(text: &str) -> Shard {
        text.parse().unwrap()
    }

    #[test]
    fn every_flight_is_in_one_shard_and_shares_differ_by_one_at_most() {
        for (flights, of) in [(0, 3), (1, 4), (11, 4), (12, 4), (800, 7)] {
            let shards: Vec<Shard> = (1..=of).map(|number| Shard { number, of }).collect();
            for flight in 0..flights {
                assert_eq!(shards.iter().filter(|shard| shard.takes(flight)).count(), 1);
            }
            for shard in shards {
                let own = (0..flights).filter(|flight| shard.takes(*flight)).count();
                assert_eq!(own, shard.share(flights), "{shard} of {flights}");
                assert!(own.abs_diff(flights / of) <= 1);
            }
        }
    }

    #[test]
    fn a_shard_is_written_as_k_of_n() {
        assert_eq!(shard("3/8"), Shard { number: 3, of: 8 });
        assert_eq!(shard("3/8").to_string(), "3/8");
        for text in ["", "3", "0/4", "5/4", "1/0", "-1/4", "1/100001", "1/4/4", "a/b"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }

    #[test]
    fn the_fingerprint_tells_suites_seeds_planners_estimators_and_selections_apart_but_not_shards() {
        let (suite, selection) = (Suite::default(), Selection::default());
        let (planner, estimator) = (planner::Config::default(), Estimator::CrossSpectrum);
        let of = |suite: &Suite, selection: &Selection, seed, planner, estimator| {
            fingerprint(suite, selection, seed, planner, estimator).unwrap()
        };
        let base = of(&suite, &selection, 1, planner, estimator);
        let part = Selection { shard: Some(shard("1/2")), ..selection.clone() };
        assert_eq!(of(&suite, &part, 1, planner, estimator), base);
        let larger = Suite { drone_radius: 0.2, ..suite.clone() };
        let fewer = Selection { pairs: Some(1), ..selection.clone() };
        let paper = foxhound_papers::apf::named("paper").unwrap();
        let others = [
            of(&larger, &selection, 1, planner, estimator),
            of(&suite, &fewer, 1, planner, estimator),
            of(&suite, &selection, 2, planner, estimator),
            of(&suite, &selection, 1, paper, estimator),
            of(&suite, &selection, 1, planner, Estimator::PaperCorrelated),
        ];
        assert!(!others.contains(&base), "{others:?}");
    }
}
