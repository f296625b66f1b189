//! Non-volatile storage: parameters, calibration, the signing key, and the number of starts.
//!
//! | pages | content |
//! |---|---|
//! | 0 | which page is being erased (`flash`) |
//! | 1, 2 | the count of starts, and a mark for each name: the number of its newest record |
//! | 3 to 7 | the records (`record`) |
//!
//! Records are in the map of `sequential-storage`: each new one is written after the others, and only the last
//! complete one of its key is valid. So after a loss of power a record is completely old or completely new. A page is
//! erased when the ring of pages reaches it; its valid content has been copied by then.
//!
//! A record is written first and its mark after it. If the power fails between the two, the record is newer than its
//! mark, and is valid. A record that is older than its mark, or missing, means that a newer one was complete and is
//! damaged: that is [`Kept::Lost`], never the older one, and not the same as [`Kept::Nothing`]. `start` defines the
//! vehicle's reaction.
//!
//! A damaged mark reads as the one before it, and a start corrects it from the records; so one flipped bit, wherever
//! it is, costs at most one start of the count.
//!
//! Writing takes about 0.1 ms for eight bytes, and 25 ms for each erased page, and the processor may stand still. So
//! nothing is written while the vehicle is in control, and a step with a write is excused from its deadline
//! ([`Store::take_written`]). With any content of the flash the program does a bounded amount of work: every page is
//! read a bounded number of times, and erased at most a few times.

mod flash;
mod record;
mod start;

use core::ops::Range;

use embedded_storage::nor_flash::NorFlash;
use foxhound_core::doa::calibration::record::{Calibration, RECORD_BYTES};
use foxhound_core::guidance::param::Values;
use foxhound_link::signing::Key;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

use crate::flight::ParameterStore;
use flash::{Sure, at_once};
use record::{Content, RECORD_MAX, Record, Starts};

pub use flash::PAGES;
pub use record::Restored;

const STARTS: Range<u32> = 1..3;
const RECORDS: Range<u32> = 3..PAGES;

/// Attempts to write a record; a word that cannot be written is skipped each time.
const TRIES: usize = 4;

/// The kinds of records, as their keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Name {
    Parameters = 1,
    Calibration = 2,
    Key = 3,
    Timestamp = 4,
}

impl Name {
    const ALL: [Self; NAMES] = [Self::Parameters, Self::Calibration, Self::Key, Self::Timestamp];

    const fn bit(self) -> u8 {
        1 << self as u8
    }
}

const NAMES: usize = 4;

/// The key of the one record among the starts.
const COUNT_OF_STARTS: u8 = 1;

/// The stored value of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept<T> {
    /// There is none, or it was removed.
    Nothing,
    /// This value.
    Found(T),
    /// There is one, but the newest cannot be read.
    Lost,
}

/// Errors of the flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    /// The driver refuses.
    Refused,
    /// Its content is inconsistent.
    Damaged,
}

/// The store. It owns its flash: [`PAGES`] pages, the first at 0, words of 8 bytes, over which zeros can always be
/// written.
#[derive(Debug)]
pub struct Store<F> {
    flash: Sure<F>,
    buffer: [u8; RECORD_MAX],
    starts: Starts,
    /// A bit for each kind whose newest record was damaged at the start and has not been stored again.
    damaged: u8,
    untold: start::Untold,
}

impl<F: NorFlash> Store<F> {
    /// Before anything is read.
    pub const fn new(flash: F) -> Self {
        Self {
            flash: Sure::new(flash),
            buffer: [0; RECORD_MAX],
            starts: Starts { count: 0, marks: [0; NAMES] },
            damaged: 0,
            untold: start::Untold::NOTHING,
        }
    }

    /// Completes interrupted erases, reads the marks, and counts this start. Call it once, before anything else;
    /// returns the number of this start, or 0 if it is unknown.
    #[inline(never)]
    pub fn begin(&mut self) -> u32 {
        // An error shows below.
        let _ = self.flash.finish();
        let stood = match self.get(STARTS, COUNT_OF_STARTS) {
            Ok(Some(record)) => record::numbered(record).and_then(|(_, held)| Starts::decode(held)),
            _ => None,
        };
        self.starts = stood.unwrap_or_else(|| {
            // With blank pages nothing was stored; otherwise it is unknown what was.
            let is_new = self.flash.is_blank(STARTS) || self.flash.is_blank(RECORDS);
            Starts { marks: [if is_new { 0 } else { 1 }; NAMES], count: 0 }
        });
        for name in Name::ALL {
            let newest = self.get(RECORDS, name as u8).ok().flatten();
            let number = newest.and_then(record::numbered).map(|(number, _)| number);
            let mark = self.starts.mark(name);
            if let Some(number) = number
                && (stood.is_none() || *mark == 0 || record::is_older(*mark, number))
            {
                *mark = number;
            }
        }
        self.starts.count = self.starts.count.saturating_add(1);
        if self.put_starts() { self.starts.count } else { 0 }
    }

    /// The parameters.
    #[inline(never)]
    pub fn parameters(&mut self) -> Kept<Restored> {
        self.read(Name::Parameters, record::parameters)
    }

    /// The calibration of the antennas.
    #[inline(never)]
    pub fn calibration(&mut self) -> Kept<Calibration> {
        self.read(Name::Calibration, |record| {
            let record: &[u8; RECORD_BYTES] = record.try_into().ok()?;
            Calibration::decode(record)
        })
    }

    /// Stores a calibration; false if that is not possible.
    #[inline(never)]
    pub fn keep_calibration(&mut self, calibration: &Calibration) -> bool {
        self.keep(Name::Calibration, Content::Calibration(&calibration.encode()))
    }

    /// The signing key, and a timestamp after everything that was signed with it.
    #[inline(never)]
    pub fn key(&mut self) -> Kept<(Key, u64)> {
        let bytes = match self.read(Name::Key, record::key) {
            Kept::Found(bytes) => bytes,
            Kept::Lost => return Kept::Lost,
            Kept::Nothing => return Kept::Nothing,
        };
        let timestamp = match self.read(Name::Timestamp, |record| record::timestamp(record, &bytes)) {
            Kept::Found(timestamp) => timestamp,
            // What was signed is unknown: the first received timestamp sets the clock.
            Kept::Lost | Kept::Nothing => 0,
        };
        Key::new(bytes).map_or(Kept::Lost, |key| Kept::Found((key, timestamp)))
    }

    /// Stores the key, or its removal; false if that is not possible.
    #[inline(never)]
    pub fn keep_key(&mut self, key: Option<&Key>) -> bool {
        match key {
            Some(key) => self.keep(Name::Key, Content::Bytes(key.secret())),
            None => self.keep(Name::Key, Content::Gone) && self.keep(Name::Timestamp, Content::Gone),
        }
    }

    fn has_key(&mut self) -> bool {
        matches!(self.read(Name::Key, record::key), Kept::Found(_))
    }

    /// Whether the newest record of any kind was damaged at the start, and has not been stored again.
    #[must_use]
    pub const fn is_damaged(&self) -> bool {
        self.damaged != 0
    }

    /// Stores a timestamp for the key; false if that is not possible.
    #[inline(never)]
    pub fn keep_timestamp(&mut self, key: &Key, timestamp: u64) -> bool {
        self.keep(Name::Timestamp, Content::Bytes(&record::timestamp_record(key.secret(), timestamp)))
    }

    /// Erases everything but the count of starts, so that nothing of it can be read from the flash any more.
    #[inline(never)]
    pub fn factory_reset(&mut self) -> bool {
        self.starts.marks = [0; NAMES];
        let is_done = self.put_starts() && self.flash.erase_surely(&RECORDS).is_ok();
        if is_done {
            self.damaged = 0;
        }
        is_done
    }

    /// Whether the flash was written since the last call: then this step may have taken long.
    pub const fn take_written(&mut self) -> bool {
        self.flash.take_written()
    }

    fn read<T>(&mut self, name: Name, decode: impl FnOnce(&[u8]) -> Option<T>) -> Kept<T> {
        let mark = *self.starts.mark(name);
        match self.get(RECORDS, name as u8).map(|record| record.and_then(record::numbered)) {
            Ok(Some((number, _))) if mark != 0 && record::is_older(number, mark) => Kept::Lost,
            Ok(Some((_, held))) if record::is_gone(held) => Kept::Nothing,
            Ok(Some((_, held))) => decode(held).map_or(Kept::Lost, Kept::Found),
            Ok(None) if mark == 0 => Kept::Nothing,
            Ok(None) | Err(_) => Kept::Lost,
        }
    }

    /// Stores a record, then its mark.
    fn keep(&mut self, name: Name, content: Content<'_>) -> bool {
        let number = record::next(*self.starts.mark(name));
        if !self.put(RECORDS, name as u8, &Record(number, content)) {
            return false;
        }
        *self.starts.mark(name) = number;
        self.damaged &= !name.bit();
        self.put_starts()
    }

    fn put_starts(&mut self) -> bool {
        let starts = self.starts.encode();
        self.put(STARTS, COUNT_OF_STARTS, &Record(0, Content::Starts(&starts)))
    }

    /// Writes a record, and verifies it. If the pages are inconsistent they are erased, and their content is lost.
    #[inline(never)]
    fn put(&mut self, pages: Range<u32>, key: u8, record: &Record<'_>) -> bool {
        (0..TRIES).any(|_| self.put_once(pages.clone(), key, record).is_ok())
            || (self.flash.erase_surely(&pages).is_ok() && self.put_once(pages, key, record).is_ok())
    }

    fn put_once(&mut self, pages: Range<u32>, key: u8, record: &Record<'_>) -> Result<(), Trouble> {
        let Self { flash, buffer, .. } = self;
        let mut map = map(flash, pages.clone())?;
        settle(at_once(map.store_item(buffer, &key, record)))?;
        match self.get(pages, key)? {
            Some(read) if record.is(read) => Ok(()),
            _ => Err(Trouble::Damaged),
        }
    }

    #[inline(never)]
    fn get(&mut self, pages: Range<u32>, key: u8) -> Result<Option<&[u8]>, Trouble> {
        let Self { flash, buffer, .. } = self;
        let mut map = map(flash, pages)?;
        settle(at_once(map.fetch_item(buffer, &key)))
    }
}

type Map<'a, F> = MapStorage<u8, &'a mut Sure<F>, Cache<Uncached, Uncached, Uncached, u8>>;

fn map<F: NorFlash>(flash: &mut Sure<F>, pages: Range<u32>) -> Result<Map<'_, F>, Trouble> {
    let size = F::ERASE_SIZE as u32;
    let config = MapConfig::try_new(pages.start * size..pages.end * size).map_err(|_| Trouble::Damaged)?;
    Ok(MapStorage::new(flash, config, Cache::new_uncached()))
}

/// A future that waits, which none should, counts as damage.
fn settle<T, E>(result: Option<Result<T, sequential_storage::Error<E>>>) -> Result<T, Trouble> {
    match result {
        Some(Ok(value)) => Ok(value),
        Some(Err(sequential_storage::Error::Storage { .. })) => Err(Trouble::Refused),
        Some(Err(_)) | None => Err(Trouble::Damaged),
    }
}

impl<F: NorFlash> ParameterStore for Store<F> {
    fn save(&mut self, values: &Values) -> bool {
        self.keep(Name::Parameters, Content::Parameters(values))
    }

    fn load(&mut self) -> Option<Values> {
        match self.parameters() {
            Kept::Found(restored) => Some(restored.values),
            Kept::Nothing | Kept::Lost => None,
        }
    }

    fn reset(&mut self) -> bool {
        self.factory_reset()
    }
}
