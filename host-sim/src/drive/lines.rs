//! Files of JSON lines that grow while flights are flown, so that work that was interrupted goes on: a header that tells the work from
//! other work, then a line for each part that is done.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::scenario::input::InputError;
use crate::scenario::output;

/// Such a file.
#[derive(Debug)]
pub(super) struct Lines {
    path: PathBuf,
    file: Mutex<File>,
}

impl Lines {
    /// Opens a file, or begins one, anew if it `is_new`; returns the lines that it has. A line without an end was being written when the
    /// program was ended, and is dropped.
    ///
    /// # Errors
    /// Names the file: it cannot be read or written, or has another header, as `foreign` says.
    pub(super) fn open<H, L>(path: &Path, header: &H, is_new: bool, foreign: &str) -> Result<(Self, Vec<L>), InputError>
    where
        H: Serialize + DeserializeOwned + PartialEq,
        L: DeserializeOwned,
    {
        let failed = |error: io::Error| output::failed(path, &error);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(failed)?;
        }
        let text = match fs::read(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            bytes => String::from_utf8_lossy(&bytes.map_err(failed)?).into_owned(),
        };
        let (mut whole, mut lines) = (0, Vec::new());
        for line in text.split_inclusive('\n').filter(|line| !is_new && line.ends_with('\n')) {
            if whole > 0 {
                let Ok(one) = serde_json::from_str(line) else { break };
                lines.push(one);
            } else if serde_json::from_str::<H>(line).ok().as_ref() != Some(header) {
                return Err(InputError::new(foreign).in_file(path));
            }
            whole += line.len();
        }
        let file = File::options().append(true).create(true).open(path).map_err(failed)?;
        file.set_len(whole as u64).map_err(failed)?;
        let opened = Self { path: path.to_owned(), file: Mutex::new(file) };
        if whole == 0 {
            opened.add(header)?;
        }
        Ok((opened, lines))
    }

    /// Adds a line.
    ///
    /// # Errors
    /// Names the file; the line is not on disk.
    pub(super) fn add(&self, line: &impl Serialize) -> Result<(), InputError> {
        let mut text = serde_json::to_string(line).map_err(|error| InputError::new(error.to_string()))?;
        text.push('\n');
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(text.as_bytes()).map_err(|error| output::failed(&self.path, &error))
    }

    /// Its path.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

/// A hash for headers: FNV-1a, which does not change with the compiler, in hexadecimal digits.
pub(super) fn hash(bytes: &[u8]) -> String {
    let hash = bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_cut_at_any_byte_gives_back_whole_lines_and_goes_on() {
        let path = std::env::temp_dir().join(format!("foxhound-lines-{}.jsonl", std::process::id()));
        let open = |header: u32, is_new| Lines::open::<u32, f64>(&path, &header, is_new, "is foreign");
        let (lines, _) = open(7, true).unwrap();
        // JSON keeps every bit.
        let numbers = [2.0 / 3.0, 1e-300, -0.0];
        numbers.iter().for_each(|number| lines.add(number).unwrap());
        let bytes = fs::read(&path).unwrap();
        for end in 0..=bytes.len() {
            fs::write(&path, &bytes[..end]).unwrap();
            let (lines, read) = open(7, false).unwrap();
            let ends = bytes[..end].iter().filter(|byte| **byte == b'\n').count();
            assert_eq!(read, numbers[..ends.saturating_sub(1)], "cut at {end}");
            numbers[read.len()..].iter().for_each(|number| lines.add(number).unwrap());
            assert_eq!(fs::read(&path).unwrap(), bytes, "cut at {end}");
        }
        assert!(open(8, false).unwrap_err().to_string().ends_with("is foreign"));
        assert_eq!(fs::read(&path).unwrap(), bytes, "and left as it is");
        assert!(open(8, true).unwrap().1.is_empty());
        fs::remove_file(path).unwrap();
    }

    #[test]
    fn the_hash_is_the_published_one() {
        // Fowler, Noll, Vo: FNV-1a of 64 bits, of nothing and of "foobar".
        assert_eq!([hash(b""), hash(b"foobar")], ["cbf29ce484222325", "85944171f73967e8"]);
    }
}
