//! The flights that a suite has finished, on disk, so that an interrupted suite can be resumed.
//!
//! A file of JSON lines: a [`Header`], then a line for each finished flight, in any order, with its number in the
//! suite. An incomplete last line was being written when the program was killed; its flight is flown again. The numbers restore the
//! order of the suite, and JSON keeps every bit of the values: the results are byte for byte those of an uninterrupted suite. The
//! journal is removed when all results are written.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};

use super::{Flown, shard};
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
    path: PathBuf,
    file: Mutex<File>,
    flown: BTreeMap<usize, Flown>,
}

impl Journal {
    /// Opens or creates the journal of a suite.
    ///
    /// # Errors
    /// Names the file: it cannot be written, is from another build, or exists and `before` refuses it.
    pub fn open(folder: &Path, header: &Header, before: Before) -> Result<Self, InputError> {
        let path = header.path(folder);
        let failed = |error: io::Error| output::failed(&path, &error);
        fs::create_dir_all(folder).map_err(failed)?;
        let text = match fs::read(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            bytes => String::from_utf8_lossy(&bytes.map_err(failed)?).into_owned(),
        };
        let (mut whole, mut flown) = (0, BTreeMap::new());
        if before != Before::Discard {
            (whole, flown) = read(&text, header).map_err(|error| error.in_file(&path))?;
        }
        if before == Before::Refuse && !flown.is_empty() {
            let (done, of) = (flown.len(), header.suite.flights);
            let text = format!(
                "{done} flights of a suite of {of} are here, which was ended; --resume goes on, --force begins anew"
            );
            return Err(InputError::new(text).in_file(&path));
        }
        let file = File::options().append(true).create(true).open(&path).map_err(failed)?;
        file.set_len(whole as u64).map_err(failed)?;
        let journal = Self { path: path.clone(), file: Mutex::new(file), flown };
        if whole == 0 {
            journal.write(header)?;
        }
        Ok(journal)
    }

    /// Its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
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
        self.write(&Line { flight, flown: flown.clone() })
    }

    fn write(&self, line: &impl Serialize) -> Result<(), InputError> {
        let mut text = serde_json::to_string(line).map_err(|error| InputError::new(error.to_string()))?;
        text.push('\n');
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(text.as_bytes()).map_err(|error| output::failed(&self.path, &error))
    }

    /// Removes the journal, when its flights are in the results.
    ///
    /// # Errors
    /// Names the file.
    pub fn remove(self) -> Result<(), InputError> {
        fs::remove_file(&self.path).map_err(|error| output::failed(&self.path, &error))
    }
}

/// The number of complete bytes of a journal, and the flights in them.
fn read(text: &str, header: &Header) -> Result<(usize, BTreeMap<usize, Flown>), InputError> {
    let mut flown = BTreeMap::new();
    let mut whole = 0;
    for line in text.split_inclusive('\n').take_while(|line| line.ends_with('\n')) {
        if whole == 0 {
            match serde_json::from_str::<Header>(line) {
                Ok(found) if found == *header => {}
                Ok(_) => return Err(InputError::new("is of another build of the program; --force begins anew")),
                // The system stopped before the header was on disk.
                Err(_) => break,
            }
        } else {
            let Ok(Line { flight, flown: one }) = serde_json::from_str(line) else { break };
            flown.insert(flight, one);
        }
        whole += line.len();
    }
    Ok((whole, flown))
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
    fn a_journal_cut_at_any_byte_gives_back_whole_flights_and_goes_on() {
        let folder = std::env::temp_dir().join(format!("foxhound-journal-{}", std::process::id()));
        let journal = Journal::open(&folder, &header(), Before::Refuse).unwrap();
        let path = journal.path().to_owned();
        for flight in [3, 0, 2] {
            journal.add(flight, &flown(flight as u32)).unwrap();
        }
        let bytes = fs::read(&path).unwrap();
        for end in 0..=bytes.len() {
            fs::write(&path, &bytes[..end]).unwrap();
            let journal = Journal::open(&folder, &header(), Before::Resume).unwrap();
            let lines = bytes[..end].iter().filter(|byte| **byte == b'\n').count();
            assert_eq!(journal.flown().len(), lines.saturating_sub(1));
            assert!(journal.flown().iter().all(|(flight, one)| *one == flown(*flight as u32)));
            journal.add(8, &flown(8)).unwrap();
            let again = Journal::open(&folder, &header(), Before::Resume).unwrap();
            assert_eq!(again.flown().len(), journal.flown().len() + 1);
        }
        let refused = Journal::open(&folder, &header(), Before::Refuse).unwrap_err().to_string();
        assert!(refused.contains("4 flights of a suite of 9") && refused.contains("--resume"), "{refused}");
        let other = Header { program: "theirs".to_owned(), ..header() };
        assert!(Journal::open(&folder, &other, Before::Resume).unwrap_err().to_string().contains("another build"));
        assert!(Journal::open(&folder, &other, Before::Discard).unwrap().flown().is_empty());
        fs::remove_dir_all(folder).unwrap();
    }
}
