//! Why the computer has restarted.
//!
//! Two sources: the chip's report of its last reset ([`Cause`]), and the record that the program wrote before it
//! ended ([`Record`]), in memory that a reset does not clear. The board owns both; this module defines their meaning,
//! how a record is stored in that memory, and the text for the pilot.
//!
//! A record is used only with a valid checksum: after power-up that memory holds anything. It is read once and then
//! [erased](take), so that an old one is never reported again.

use foxhound_core::doa::calibration::record::crc32;
use foxhound_link::companion::NOTICE_BYTES;
use heapless::String;

/// Words of a record in the memory that a reset does not clear.
pub const WORDS: usize = 16;

const MAGIC: u32 = u32::from_le_bytes(*b"FXR1");
const TEXT_AT: usize = 6;
const CRC_AT: usize = WORDS - 1;
/// Bytes of a record's text: the end of a file's name and a line.
pub const TEXT_BYTES: usize = (CRC_AT - TEXT_AT) * 4;

/// The chip's report of the last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cause {
    /// Power-up.
    #[default]
    Power,
    /// The supply sank below its limit.
    BrownOut,
    /// The reset pin.
    Pin,
    /// Requested by the program.
    Software,
    /// The watchdog was not fed.
    Watchdog,
    /// Something else.
    Other,
}

/// What ended the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum End {
    /// A panic; the text says where.
    Panic = 1,
    /// A fault of the processor; the address says where, the status why.
    Fault = 2,
    /// The board found that it cannot continue; the text gives the reason.
    Halt = 3,
    /// A requested restart.
    Wanted = 4,
    /// The watchdog ran out; the address says where the program was.
    Watchdog = 5,
}

/// The record that the program wrote before it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// What ended it.
    pub end: End,
    /// Where, as far as that is known.
    pub address: u32,
    /// `CFSR` of a fault; the board's own after a halt.
    pub status: u32,
    /// Time since its start.
    pub uptime_s: u32,
    text: [u8; TEXT_BYTES],
}

impl Record {
    /// A record with a text, of which the end is kept.
    #[must_use]
    pub fn new(end: End, address: u32, status: u32, uptime_s: u32, text: &[u8]) -> Self {
        let last = text.get(text.len().saturating_sub(TEXT_BYTES)..).unwrap_or_default();
        let mut kept = [0; TEXT_BYTES];
        for (to, from) in kept.iter_mut().zip(last) {
            *to = *from;
        }
        Self { end, address, status, uptime_s, text: kept }
    }

    /// The text, up to the first invalid byte.
    #[must_use]
    pub fn text(&self) -> &str {
        let until = self.text.iter().position(|byte| !byte.is_ascii_graphic() && *byte != b' ').unwrap_or(TEXT_BYTES);
        self.text.get(..until).and_then(|text| str::from_utf8(text).ok()).unwrap_or_default()
    }

    /// The words to be kept over the reset.
    #[must_use]
    pub fn encode(&self) -> [u32; WORDS] {
        let mut words = [0; WORDS];
        let head = [MAGIC, self.end as u32, self.address, self.status, self.uptime_s, 0];
        let text = self.text.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes));
        for (word, value) in words.iter_mut().zip(head.into_iter().chain(text)) {
            *word = value;
        }
        words[CRC_AT] = check(&words);
        words
    }

    fn decode(words: &[u32; WORDS]) -> Option<Self> {
        let [magic, end, address, status, uptime_s, _, rest @ ..] = *words;
        if magic != MAGIC || words[CRC_AT] != check(words) {
            return None;
        }
        let end = [End::Panic, End::Fault, End::Halt, End::Wanted, End::Watchdog]
            .into_iter()
            .find(|known| *known as u32 == end)?;
        let mut text = [0; TEXT_BYTES];
        for (to, from) in text.as_chunks_mut().0.iter_mut().zip(rest) {
            *to = from.to_le_bytes();
        }
        Some(Self { end, address, status, uptime_s, text })
    }
}

fn check(words: &[u32; WORDS]) -> u32 {
    let mut bytes = [0; CRC_AT * 4];
    for (to, from) in bytes.as_chunks_mut().0.iter_mut().zip(words) {
        *to = from.to_le_bytes();
    }
    crc32(&bytes)
}

/// The record that the last run left, if any; it is then erased.
pub fn take(kept: &mut [u32; WORDS]) -> Option<Record> {
    let record = Record::decode(kept);
    *kept = [0; WORDS];
    record
}

/// Whether there is a record that has not been taken.
#[must_use]
pub fn is_begun(kept: &[u32; WORDS]) -> bool {
    kept[0] == MAGIC
}

/// Information about the last restart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Restart {
    /// The chip's report.
    pub cause: Cause,
    /// The program's record.
    pub record: Option<Record>,
}

impl Restart {
    /// Whether the pilot should be informed: not after power-up or the reset button.
    #[must_use]
    pub fn is_news(&self) -> bool {
        self.record.is_some() || !matches!(self.cause, Cause::Power | Cause::Pin)
    }

    /// Whether the last run may have ended in flight: always, unless it was asked to. After a supply that failed for so long that
    /// the memory has forgotten, and after a pulse on the reset line, a start looks like any other.
    #[must_use]
    pub fn is_crash(&self) -> bool {
        self.record.is_none_or(|record| record.end != End::Wanted)
    }

    /// The text for the pilot: at most 50 bytes, as in a `STATUSTEXT`; the rest is cut off. The number of the start
    /// is left out if it is unknown (0).
    #[must_use]
    pub fn words(&self, start: u32) -> String<NOTICE_BYTES> {
        let (mut digits, mut address) = ([0; 10], [0; 10]);
        let [what, which] = self.parts(&mut address);
        let (space, number) = if start > 0 { (" ", decimal(start, &mut digits)) } else { ("", "") };
        let mut words = String::new();
        // What does not fit is cut off.
        let mut letters = ["Foxhound: restart", space, number, ": ", what, which].into_iter().flat_map(str::chars);
        let _ = letters.try_for_each(|letter| words.push(letter));
        words
    }

    /// The cause, and which one of its kind; `digits` is for an address.
    #[must_use]
    pub fn parts<'a>(&'a self, digits: &'a mut [u8; 10]) -> [&'a str; 2] {
        match (&self.record, self.cause) {
            (Some(Record { end: End::Fault, address, .. }), _) => ["fault at ", hexadecimal(*address, digits)],
            (Some(record @ Record { end: End::Panic, .. }), _) => ["panic ", record.text()],
            (Some(record @ Record { end: End::Halt, .. }), _) => ["", record.text()],
            (Some(Record { end: End::Wanted, .. }), _) => ["as asked", ""],
            (Some(Record { end: End::Watchdog, address, .. }), _) => ["watchdog at ", hexadecimal(*address, digits)],
            (None, Cause::Power) => ["power", ""],
            (None, Cause::BrownOut) => ["brown-out", ""],
            (None, Cause::Pin) => ["reset pin", ""],
            (None, Cause::Software) => ["software", ""],
            (None, Cause::Watchdog) => ["watchdog", ""],
            (None, Cause::Other) => ["unknown", ""],
        }
    }
}

/// `0x` and eight digits, without the formatting of numbers, which takes 2 KB of flash.
fn hexadecimal(value: u32, digits: &mut [u8; 10]) -> &str {
    *digits = *b"0x00000000";
    for (at, digit) in digits.iter_mut().rev().take(8).enumerate() {
        let nibble = (value >> (4 * at)) as u8 & 0xf;
        *digit = if nibble < 10 { b'0' + nibble } else { b'a' + nibble - 10 };
    }
    str::from_utf8(digits).unwrap_or_default()
}

/// A number without the standard formatting.
#[inline(never)]
pub fn decimal(mut number: u32, digits: &mut [u8; 10]) -> &str {
    let mut from = digits.len();
    for (at, digit) in digits.iter_mut().enumerate().rev() {
        *digit = b'0' + (number % 10) as u8;
        (number, from) = (number / 10, at);
        if number == 0 {
            break;
        }
    }
    digits.get(from..).and_then(|digits| str::from_utf8(digits).ok()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_read_once_as_it_was_written() {
        let record = Record::new(End::Panic, 7, 8, 9, b"computer/src/flight.rs:123");
        let mut kept = record.encode();
        assert_eq!(take(&mut kept), Some(record));
        assert_eq!(record.text(), "computer/src/flight.rs:123");
        assert_eq!(take(&mut kept), None, "an old one is not told again");
    }

    #[test]
    fn a_record_with_any_bit_changed_is_none() {
        let kept = Record::new(End::Fault, 0x0800_1234, 0x8200, 3, b"").encode();
        for bit in 0..WORDS * 32 {
            let mut spoiled = kept;
            spoiled[bit / 32] ^= 1 << (bit % 32);
            assert_eq!(take(&mut spoiled), None, "bit {bit}");
        }
        for fill in [0, u32::MAX, 0x5555_5555] {
            assert_eq!(take(&mut [fill; WORDS]), None);
        }
    }

    #[test]
    fn of_a_long_text_the_end_is_kept_and_the_words_fit_a_message() {
        let text = "a/very/long/path/to/some/file/in/a/crate/flight.rs:123";
        let record = Record::new(End::Panic, 0, 0, 0, text.as_bytes());
        assert!(record.text().ends_with("flight.rs:123") && record.text().len() == TEXT_BYTES);
        let restart = Restart { cause: Cause::Software, record: Some(record) };
        assert!(restart.words(u32::MAX).len() <= 50);
        assert!(restart.words(0).starts_with("Foxhound: restart: panic "));
    }

    #[test]
    fn only_a_start_that_was_asked_for_may_not_have_been_in_flight() {
        for cause in [Cause::Power, Cause::BrownOut, Cause::Pin, Cause::Software, Cause::Watchdog, Cause::Other] {
            assert!(Restart { cause, record: None }.is_crash(), "{cause:?}");
            for (end, is_crash) in [(End::Panic, true), (End::Fault, true), (End::Watchdog, true), (End::Wanted, false)]
            {
                let record = Some(Record::new(end, 0, 0, 0, b""));
                assert_eq!(Restart { cause, record }.is_crash(), is_crash, "{cause:?}, {end:?}");
            }
        }
    }

    #[test]
    fn the_words_say_which_start_it_is() {
        let restart = Restart { cause: Cause::Watchdog, record: None };
        for start in [1, 9, 10, 305, 1_000_000_000, u32::MAX] {
            assert_eq!(restart.words(start), std::format!("Foxhound: restart {start}: watchdog").as_str());
        }
    }

    #[test]
    fn every_restart_has_its_words_and_a_press_of_the_button_is_no_news() {
        let record = Record::new(End::Fault, 0x0800_12ab, 0, 0, b"");
        let fault = Restart { cause: Cause::Software, record: Some(record) };
        assert_eq!(fault.parts(&mut [0; 10]), ["fault at ", "0x080012ab"]);
        let causes = [Cause::Power, Cause::BrownOut, Cause::Pin, Cause::Software, Cause::Watchdog, Cause::Other];
        let all = causes.map(|cause| Restart { cause, record: None });
        assert_eq!(all.map(|restart| restart.is_news()), [false, true, false, true, true, true]);
        for (index, restart) in all.iter().enumerate() {
            assert!(all[..index].iter().all(|other| other.words(7) != restart.words(7)));
        }
    }
}
