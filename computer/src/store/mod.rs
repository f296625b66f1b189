//! What is kept while the power is off: parameters, calibration, the key of signing, and how often the computer was started.
//!
//! | pages | what lies there |
//! |---|---|
//! | 0 | which page is being erased (`flash`) |
//! | 1, 2 | the count of starts, and a mark for each name: the number of its newest record |
//! | 3 to 7 | the records (`record`) |
//!
//! Records lie in the map of `sequential-storage`: each new one is written behind the others, and only the last whole one of
//! its key counts. So whenever the power goes a record is all old or all new. A page is erased when the ring of pages comes
//! round to it; by then what counts in it has been copied.
//!
//! A record is written first and its mark after it. When the power goes between the two the record is newer than its mark,
//! and counts. A record that is older than its mark, or missing where there is a mark, says that a newer one was complete and is
//! damaged: that is [`Kept::Lost`], never the older one, and not the same as [`Kept::Nothing`]. `start` says what the vehicle does
//! then.
//!
//! A damaged mark reads as the one before it, and a start sets it right by the records; so one flipped bit, wherever it is,
//! costs at most one start of the count.
//!
//! To write takes about 0.1 ms for eight bytes, and 25 ms for each page that is erased, and the processor may stand still:
//! nothing is written while the vehicle is in control, and a step in which something was has an excuse
//! ([`Store::take_written`]). A program that finds a flash full of anything does a bounded amount of work: every page is read
//! a bounded number of times, and erased at most a few times.

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

use crate::flight::Mapper;
use flash::{Sure, at_once};
use record::{Content, RECORD_MAX, Record, Starts};

pub use flash::PAGES;
pub use record::Restored;

const STARTS: Range<u32> = 1..3;
const RECORDS: Range<u32> = 3..PAGES;

/// So often a record is tried to be written; a word that takes nothing is left behind each time.
const TRIES: usize = 4;

/// What can be kept, as the key of its record.
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

/// What was kept of something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept<T> {
    /// Nothing was, or it was taken away.
    Nothing,
    /// This.
    Found(T),
    /// Something was, and the newest of it cannot be read.
    Lost,
}

/// Why the flash did not do as it should.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    /// The driver refuses.
    Refused,
    /// What is in it makes no sense.
    Damaged,
}

/// The store: what was kept, and a place to keep it. The flash is all its own: [`PAGES`] pages, the first at 0, words of 8
/// bytes, over which zeros can be written whatever is there.
#[derive(Debug)]
pub struct Store<F> {
    flash: Sure<F>,
    buffer: [u8; RECORD_MAX],
    starts: Starts,
    /// A bit for each name whose newest record was damaged at the start and was not kept anew since.
    damaged: u8,
    untold: start::Untold,
}

impl<F: NorFlash> Store<F> {
    /// Nothing is read yet.
    pub const fn new(flash: F) -> Self {
        Self {
            flash: Sure::new(flash),
            buffer: [0; RECORD_MAX],
            starts: Starts { count: 0, marks: [0; NAMES] },
            damaged: 0,
            untold: start::Untold::NOTHING,
        }
    }

    /// Finishes what the power has ended, looks what was kept, and counts this start. To be called once, before anything else;
    /// the number of this start, or 0 where it cannot be told.
    #[inline(never)]
    pub fn begin(&mut self) -> u32 {
        // What cannot be finished shows below.
        let _ = self.flash.finish();
        let stood = match self.get(STARTS, COUNT_OF_STARTS) {
            Ok(Some(record)) => record::numbered(record).and_then(|(_, held)| Starts::decode(held)),
            _ => None,
        };
        self.starts = stood.unwrap_or_else(|| {
            // With a blank sheet nothing was kept; else nobody knows what was.
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

    /// Keeps a calibration; false where that is not possible.
    #[inline(never)]
    pub fn keep_calibration(&mut self, calibration: &Calibration) -> bool {
        self.keep(Name::Calibration, Content::Calibration(&calibration.encode()))
    }

    /// The key of signing, and the timestamp behind everything that was signed with it.
    #[inline(never)]
    pub fn key(&mut self) -> Kept<(Key, u64)> {
        let bytes = match self.read(Name::Key, record::key) {
            Kept::Found(bytes) => bytes,
            Kept::Lost => return Kept::Lost,
            Kept::Nothing => return Kept::Nothing,
        };
        let timestamp = match self.read(Name::Timestamp, |record| record::timestamp(record, &bytes)) {
            Kept::Found(timestamp) => timestamp,
            // What was signed is not known: the first that is heard tells where we are.
            Kept::Lost | Kept::Nothing => 0,
        };
        Key::new(bytes).map_or(Kept::Lost, |key| Kept::Found((key, timestamp)))
    }

    /// Keeps the key, or that there is none; false where that is not possible.
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

    /// Whether the newest record of anything was damaged at the start, and nothing was kept in its place since.
    #[must_use]
    pub const fn is_damaged(&self) -> bool {
        self.damaged != 0
    }

    /// Keeps a timestamp for the key; false where that is not possible.
    #[inline(never)]
    pub fn keep_timestamp(&mut self, key: &Key, timestamp: u64) -> bool {
        self.keep(Name::Timestamp, Content::Bytes(&record::timestamp_record(key.secret(), timestamp)))
    }

    /// Forgets everything but the count of starts. Nothing of it can be read out of the flash any more, either.
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

    /// Keeps a record, then its mark.
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

    /// Writes a record, and looks that it is there. Where the pages make no sense any more they are begun anew: what was in
    /// them is lost then.
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

/// A future that waits, which none does, is damage like any other.
fn settle<T, E>(result: Option<Result<T, sequential_storage::Error<E>>>) -> Result<T, Trouble> {
    match result {
        Some(Ok(value)) => Ok(value),
        Some(Err(sequential_storage::Error::Storage { .. })) => Err(Trouble::Refused),
        Some(Err(_)) | None => Err(Trouble::Damaged),
    }
}

impl<F: NorFlash> Mapper for Store<F> {
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
