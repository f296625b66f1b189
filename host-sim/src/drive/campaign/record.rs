//! The file of a campaign: the results, mission by mission, so that an interrupted campaign continues.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::Report;
use crate::drive::lines::{Lines, hash};
use crate::scenario::input::InputError;

/// The first line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Head {
    /// A hash of the image's file.
    pub image: String,
    /// Faults in each mission.
    pub faults: u32,
}

impl Head {
    /// For the bytes of an image.
    #[must_use]
    pub fn new(image: &[u8], faults: u32) -> Self {
        Self { image: hash(image), faults }
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
    lines: Lines,
    /// By seed.
    pub missions: BTreeMap<u64, Report>,
}

impl Record {
    /// Opens a file, or begins one.
    ///
    /// # Errors
    /// The file cannot be read or written, or is of another image or of missions with another number of faults.
    pub fn open(path: &Path, head: &Head) -> Result<Self, InputError> {
        let foreign = "is of another image or of missions with another number of faults; remove it, or name another";
        let (lines, missions) = Lines::open::<_, Mission>(path, head, false, foreign)?;
        Ok(Self { lines, missions: missions.into_iter().map(|Mission { seed, report }| (seed, report)).collect() })
    }

    /// Adds a mission.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn note(&mut self, seed: u64, report: Report) -> Result<(), InputError> {
        self.lines.add(&Mission { seed, report: report.clone() })?;
        self.missions.insert(seed, report);
        Ok(())
    }

    /// All missions with seeds from 1 to `missions`, summed up.
    #[must_use]
    pub fn whole(&self, missions: u64) -> Report {
        let mut whole = Report::default();
        self.missions.range(1..=missions).for_each(|(_, report)| whole.add(report));
        whole
    }
}
