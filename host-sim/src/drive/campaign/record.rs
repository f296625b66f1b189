//! The file of a campaign: the results, mission by mission, so that an interrupted campaign continues.
//!
//! Every line is a JSON object: first the image and the number of faults in a mission, then for every mission its
//! seed and its [`Report`]. A mission whose line is incomplete is flown again.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::Report;

/// The first line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Head {
    /// FNV-1a over the image's file, in hexadecimal digits.
    pub image: String,
    /// Faults in each mission.
    pub faults: u32,
}

impl Head {
    /// For the bytes of an image.
    #[must_use]
    pub fn new(image: &[u8], faults: u32) -> Self {
        let hash = image
            .iter()
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3));
        Self { image: format!("{hash:016x}"), faults }
    }
}

#[derive(Serialize, Deserialize)]
struct Mission {
    seed: u64,
    report: Report,
}

/// The results, and their file.
#[derive(Debug)]
pub struct Record {
    file: File,
    /// By seed.
    pub missions: BTreeMap<u64, Report>,
}

impl Record {
    /// Opens a file, or begins one.
    ///
    /// # Errors
    /// The file cannot be read or written, or is of another image or of missions with another number of faults.
    pub fn open(path: &Path, head: &Head) -> io::Result<Self> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        let text = match fs::read_to_string(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            text => text?,
        };
        // A line without an end was being written when the program was ended.
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        let mut lines = text[..whole].lines();
        let mut missions = BTreeMap::new();
        if let Some(first) = lines.next() {
            if serde_json::from_str::<Head>(first).ok().as_ref() != Some(head) {
                let why = "the file is of another image or of missions with another number of faults; remove it, or name another";
                return Err(io::Error::new(io::ErrorKind::InvalidData, why));
            }
            for line in lines {
                let Mission { seed, report } = serde_json::from_str(line)?;
                missions.insert(seed, report);
            }
        }
        let file = File::options().append(true).create(true).open(path)?;
        file.set_len(whole as u64)?;
        let mut record = Self { file, missions };
        if whole == 0 {
            record.write(head)?;
        }
        Ok(record)
    }

    /// Adds a mission.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn note(&mut self, seed: u64, report: Report) -> io::Result<()> {
        self.write(&Mission { seed, report: report.clone() })?;
        self.missions.insert(seed, report);
        Ok(())
    }

    fn write<T: Serialize>(&mut self, line: &T) -> io::Result<()> {
        let mut line = serde_json::to_vec(line)?;
        line.push(b'\n');
        self.file.write_all(&line)?;
        self.file.sync_data()
    }

    /// All missions with seeds from 1 to `missions`, summed up.
    #[must_use]
    pub fn whole(&self, missions: u64) -> Report {
        let mut whole = Report::default();
        self.missions.range(1..=missions).for_each(|(_, report)| whole.add(report));
        whole
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Kind, Row};
    use super::*;

    fn mission(seed: u64) -> Report {
        let mut report = Report { missions: 1, seconds: 70 + seed, ..Report::default() };
        let safe = BTreeMap::from([("no_path".to_owned(), 1)]);
        report.note(1, Kind::LineNoise, &Row { faults: 1, recovered: 1, ..Row::default() });
        report.note(2, Kind::Panic, &Row { faults: 1, safe, restarts: 1, ..Row::default() });
        report
    }

    fn path(name: &str) -> std::path::PathBuf {
        std::env::temp_dir().join(format!("foxhound-record-{name}-{}.jsonl", std::process::id()))
    }

    #[test]
    fn a_campaign_that_is_cut_at_any_byte_goes_on_and_ends_with_the_same_table() {
        let (path, head) = (path("cut"), Head::new(b"image", 2));
        let _ = fs::remove_file(&path);
        let mut record = Record::open(&path, &head).unwrap();
        (1..=3).for_each(|seed| record.note(seed, mission(seed)).unwrap());
        let (bytes, table) = (fs::read(&path).unwrap(), record.whole(3).to_string());
        for end in (0..=bytes.len()).step_by(7).chain([bytes.len()]) {
            fs::write(&path, &bytes[..end]).unwrap();
            let mut record = Record::open(&path, &head).unwrap();
            let lines = bytes[..end].iter().filter(|byte| **byte == b'\n').count();
            assert_eq!(record.missions.len(), lines.saturating_sub(1), "cut at {end}");
            for seed in 1..=3 {
                if !record.missions.contains_key(&seed) {
                    record.note(seed, mission(seed)).unwrap();
                }
            }
            assert_eq!(record.whole(3).to_string(), table, "cut at {end}");
            assert_eq!(fs::read(&path).unwrap(), bytes, "cut at {end}");
        }
        fs::remove_file(&path).unwrap();
    }

    #[test]
    fn a_file_of_another_image_or_of_other_missions_is_refused() {
        let path = path("other");
        let _ = fs::remove_file(&path);
        Record::open(&path, &Head::new(b"image", 10)).unwrap();
        assert!(Record::open(&path, &Head::new(b"image", 10)).is_ok());
        for other in [Head::new(b"imagf", 10), Head::new(b"image", 11)] {
            assert_eq!(Record::open(&path, &other).unwrap_err().kind(), io::ErrorKind::InvalidData);
        }
        fs::remove_file(&path).unwrap();
    }

    #[test]
    fn a_restart_without_a_word_a_restart_too_few_and_a_touched_pillar_are_complaints() {
        let good = Row { faults: 1, recovered: 1, restarts: 1, restarts_told: 1, ..Row::default() };
        assert_eq!(good.complaints(Kind::Panic), [""; 0]);
        assert_eq!(good.complaints(Kind::LineNoise).len(), 1, "an unwanted restart");
        let bad = [
            Row { restarts_told: 0, ..good.clone() },
            Row { restarts: 0, restarts_told: 0, ..good.clone() },
            Row { collisions: 1, ..good.clone() },
            Row { collisions_away: 1, ..good.clone() },
            Row { recovered: 0, lost: 1, ..good.clone() },
            Row { outside_limits: 1, ..good.clone() },
            Row { uninvited: 1, ..good },
        ];
        for row in bad {
            assert_eq!(row.complaints(Kind::Panic).len(), 1, "{row:?}");
        }
        let stolen = Row { faults: 1, recovered: 1, ..Row::default() };
        assert_eq!(stolen.complaints(Kind::StolenProcessor), ["no step was late"]);
    }
}
