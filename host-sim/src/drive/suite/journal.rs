//! The flights that a suite has finished, on disk, so that an interrupted suite can be resumed.
//!
//! Finished flights stand in any order, each with its number in the suite. The numbers restore the order of the suite, and JSON keeps
//! every bit of the values: the results are byte for byte those of an uninterrupted suite. The journal is removed when all results are
//! written.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};

use super::{Flown, shard};
use crate::drive::lines::Lines;
use crate::scenario::input::InputError;
use crate::scenario::output;

/// The first line: the suite, and the program that flies it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// Everything that determines the flights.
    pub suite: shard::Header,
    /// Identifies the build: flights of different builds are not joined.
    pub program: String,
}

impl Header {
    /// The header for this program.
    #[must_use]
    pub fn new(suite: shard::Header) -> Self {
        let about = std::env::current_exe().and_then(fs::metadata);
        let program = about.and_then(|about| {
            let since = about.modified()?.duration_since(UNIX_EPOCH).unwrap_or_default();
            Ok(format!("{} bytes of {} ns", about.len(), since.as_nanos()))
        });
        Self { suite, program: program.unwrap_or_default() }
    }

    /// Path of the journal.
    #[must_use]
    pub fn path(&self, folder: &Path) -> PathBuf {
        let shard::Header { shard, of, fingerprint, .. } = &self.suite;
        let part = if *of > 1 { format!("-{shard}-of-{of}") } else { String::new() };
        folder.join(format!("suite-{fingerprint}{part}.journal"))
    }
}

/// A finished flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    flight: usize,
    flown: Flown,
}

/// What to do with an existing journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Before {
    /// Continue after its last flight.
    Resume,
    /// Start again.
    Discard,
    /// Refuse: the user asked for neither.
    Refuse,
}

/// The journal of a running suite.
#[derive(Debug)]
pub struct Journal {
    lines: Lines,
    flown: BTreeMap<usize, Flown>,
}

impl Journal {
    /// Opens or creates the journal of a suite.
    ///
    /// # Errors
    /// Names the file: it cannot be written, is from another build, or exists and `before` refuses it.
    pub fn open(folder: &Path, header: &Header, before: Before) -> Result<Self, InputError> {
        let (path, foreign) = (header.path(folder), "is of another build of the program; --force begins anew");
        let (lines, flown) = Lines::open::<_, Line>(&path, header, before == Before::Discard, foreign)?;
        if before == Before::Refuse && !flown.is_empty() {
            let (done, of) = (flown.len(), header.suite.flights);
            let text = format!(
                "{done} flights of a suite of {of} are here, which was ended; --resume goes on, --force begins anew"
            );
            return Err(InputError::new(text).in_file(&path));
        }
        Ok(Self { lines, flown: flown.into_iter().map(|Line { flight, flown }| (flight, flown)).collect() })
    }

    /// Its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.lines.path()
    }

    /// The flights that were finished before it was opened.
    #[must_use]
    pub const fn flown(&self) -> &BTreeMap<usize, Flown> {
        &self.flown
    }

    /// Adds a finished flight.
    ///
    /// # Errors
    /// Names the file; the flight is not on disk.
    pub fn add(&self, flight: usize, flown: &Flown) -> Result<(), InputError> {
        self.lines.add(&Line { flight, flown: flown.clone() })
    }

    /// Removes the journal, when its flights are in the results.
    ///
    /// # Errors
    /// Names the file.
    pub fn remove(self) -> Result<(), InputError> {
        fs::remove_file(self.path()).map_err(|error| output::failed(self.path(), &error))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Place;
    use super::*;
    use crate::drive::flight::Ending;

    fn flown(pair: u32) -> Flown {
        Flown {
            place: Place { row: 1, instance: 2, pair },
            seed: u64::from(pair) + 5,
            result: Ending::Hold,
            reason: "goal_unreachable".to_owned(),
            time_s: 0.1 + f64::from(pair) / 3.0,
            path_length_m: std::f64::consts::PI,
            reference_length_m: 1e-300,
            length_ratio: None,
            whole_length_ratio: Some(2.0 / 3.0),
            min_clearance_m: Some(-0.0),
            replans: 7,
            bearing_rms_deg: None,
            trace_hash: "00ff".to_owned(),
        }
    }

    fn header() -> Header {
        let suite = shard::Header { shard: 1, of: 1, flights: 9, fingerprint: "abc".to_owned() };
        Header { suite, program: "ours".to_owned() }
    }

    #[test]
    fn what_was_flown_is_given_back_and_neither_another_build_nor_a_fresh_start_takes_it() {
        let folder = std::env::temp_dir().join(format!("foxhound-journal-{}", std::process::id()));
        let journal = Journal::open(&folder, &header(), Before::Refuse).unwrap();
        let flights = [3, 0, 2, 8];
        flights.iter().for_each(|flight| journal.add(*flight, &flown(*flight as u32)).unwrap());
        let expected: BTreeMap<_, _> = flights.iter().map(|flight| (*flight, flown(*flight as u32))).collect();
        assert_eq!(Journal::open(&folder, &header(), Before::Resume).unwrap().flown(), &expected);
        let refused = Journal::open(&folder, &header(), Before::Refuse).unwrap_err().to_string();
        assert!(refused.contains("4 flights of a suite of 9") && refused.contains("--resume"), "{refused}");
        let other = Header { program: "theirs".to_owned(), ..header() };
        assert!(Journal::open(&folder, &other, Before::Resume).unwrap_err().to_string().contains("another build"));
        assert!(Journal::open(&folder, &other, Before::Discard).unwrap().flown().is_empty());
        fs::remove_dir_all(folder).unwrap();
    }
}
