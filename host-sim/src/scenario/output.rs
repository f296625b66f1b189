//! Writes results: to a temporary file in the same folder, which is then renamed. However the program ends, and after a power cut, the
//! file of that name is either complete or the previous one.
//!
//! Devices and pipes are written to directly.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use super::input::InputError;

/// A file that is being written.
#[derive(Debug)]
pub struct Output {
    /// As the user named it.
    path: PathBuf,
    file: BufWriter<File>,
    /// The temporary file and the final one; `None` for a device.
    moves: Option<[PathBuf; 2]>,
}

impl Output {
    /// Begins a file, and creates its folder if necessary.
    ///
    /// # Errors
    /// Names the file.
    pub fn create(path: &Path) -> Result<Self, InputError> {
        Self::begin(path).map_err(|error| failed(path, &error))
    }

    fn begin(path: &Path) -> io::Result<Self> {
        let (target, there) = match place(path)? {
            Place::File { target, there } => (target, there),
            Place::Device(device) => {
                return Ok(Self { path: path.to_owned(), file: BufWriter::new(device), moves: None });
            }
        };
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let mut name = target.file_name().map_or_else(OsString::new, OsString::from);
        name.push(format!(".{}-{count}.part", std::process::id()));
        let beside = target.with_file_name(name);
        let file = File::options().write(true).create_new(true).open(&beside)?;
        if let Some(there) = there {
            // The result is complete without them.
            let _ = file.set_permissions(there.permissions());
        }
        Ok(Self { path: path.to_owned(), file: BufWriter::new(file), moves: Some([beside, target]) })
    }

    /// Writes bytes.
    ///
    /// # Errors
    /// Names the file.
    pub fn put(&mut self, bytes: &[u8]) -> Result<(), InputError> {
        self.file.write_all(bytes).map_err(|error| failed(&self.path, &error))
    }

    /// Renames the complete file to its final name.
    ///
    /// # Errors
    /// The file could not be written completely; the previous one stays.
    pub fn finish(mut self) -> Result<(), InputError> {
        let named = |error: &io::Error| failed(&self.path, error);
        self.file.flush().map_err(|error| named(&error))?;
        if let Some([beside, target]) = &self.moves {
            // After a power cut the name may be on disk without the bytes, if these are not there first.
            self.file.get_ref().sync_all().map_err(|error| named(&error))?;
            fs::rename(beside, target).map_err(|error| named(&error))?;
            // Without it the previous file may come back, which is complete, too. Not every system can do it.
            let _ = File::open(folder_of(target).unwrap_or(Path::new("."))).and_then(|folder| folder.sync_all());
            self.moves = None;
        }
        Ok(())
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Output {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if let Some([beside, _]) = &self.moves {
            // An incomplete file is not a result.
            let _ = fs::remove_file(beside);
        }
    }
}

/// Writes a file.
///
/// # Errors
/// Names the file; the previous one stays.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    let mut output = Output::create(path)?;
    output.put(bytes)?;
    output.finish()
}

/// Checks before the work that its result can be written. It makes no file: a program that is killed meanwhile leaves none.
///
/// # Errors
/// Names the file.
pub fn check_writable(path: &Path) -> Result<(), InputError> {
    let checked = place(path).and_then(|place| match place {
        Place::File { target, .. } => may_write(folder_of(&target).unwrap_or(Path::new("."))),
        Place::Device(_) => Ok(()),
    });
    checked.map_err(|error| failed(path, &error))
}

#[cfg(unix)]
fn may_write(folder: &Path) -> io::Result<()> {
    use rustix::fs::{Access, access};
    Ok(access(folder, Access::WRITE_OK | Access::EXEC_OK)?)
}

/// Elsewhere only the attempt tells.
#[cfg(not(unix))]
fn may_write(_: &Path) -> io::Result<()> {
    Ok(())
}

/// What a path stands for.
enum Place {
    /// A device or a pipe, opened.
    Device(File),
    /// A file, and what is there now.
    File { target: PathBuf, there: Option<fs::Metadata> },
}

/// Finds the place, and creates its folder if necessary.
fn place(path: &Path) -> io::Result<Place> {
    if let Some(folder) = folder_of(path) {
        fs::create_dir_all(folder)?;
    }
    let there = match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Ok(Place::File { target: path.to_owned(), there: None });
        }
        metadata => metadata?,
    };
    if there.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    if !there.is_file() {
        return Ok(Place::Device(File::options().write(true).open(path)?));
    }
    // The target of a symbolic link is replaced, not the link; a read-only file is refused.
    let target = fs::canonicalize(path)?;
    File::options().append(true).open(&target)?;
    Ok(Place::File { target, there: Some(there) })
}

/// The error for a file; a full disk is reported as "no space left".
#[must_use]
pub fn failed(path: &Path, error: &(dyn std::error::Error + 'static)) -> InputError {
    InputError::new(reason(error)).in_file(path)
}

/// The operating system's reason behind an error, or the error itself.
#[must_use]
pub fn reason(error: &(dyn std::error::Error + 'static)) -> String {
    let mut cause = Some(error);
    while let Some(inner) = cause {
        if let Some(error) = inner.downcast_ref::<io::Error>().filter(|error| error.raw_os_error().is_some()) {
            return match error.kind() {
                io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
                    format!("no space left ({error})")
                }
                _ => error.to_string(),
            };
        }
        // `source` does not show an error that is wrapped in an `io::Error`.
        cause = match inner.downcast_ref::<io::Error>().and_then(io::Error::get_ref) {
            Some(wrapped) => {
                let wrapped: &(dyn std::error::Error + 'static) = wrapped;
                Some(wrapped)
            }
            None => inner.source(),
        };
    }
    error.to_string()
}

fn folder_of(path: &Path) -> Option<&Path> {
    path.parent().filter(|folder| !folder.as_os_str().is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder of the test's own.
    fn folder(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("foxhound-output-{}-{name}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        path
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_that_is_not_finished_leaves_the_old_one_and_nothing_beside_it() {
        let folder = folder("unfinished");
        let path = folder.join("a.txt");
        write(&path, b"old").unwrap();
        let mut output = Output::create(&path).unwrap();
        output.write_all(b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"old");
        drop(output);
        assert_eq!((fs::read(&path).unwrap(), names(&folder)), (b"old".to_vec(), vec!["a.txt".to_owned()]));
        write(&path, b"new").unwrap();
        assert_eq!((fs::read(&path).unwrap(), names(&folder)), (b"new".to_vec(), vec!["a.txt".to_owned()]));
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn to_check_whether_a_file_can_be_written_makes_none_and_refuses_what_cannot() {
        let folder = folder("check");
        check_writable(&folder.join("deeper/a.txt")).unwrap();
        assert_eq!((names(&folder), names(&folder.join("deeper"))), (vec!["deeper".to_owned()], vec![]));
        assert!(check_writable(&folder).unwrap_err().to_string().contains("irectory"));
        fs::write(folder.join("file"), "").unwrap();
        assert!(check_writable(&folder.join("file/a.txt")).is_err());
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_link_stays_one_and_its_file_is_replaced() {
        let folder = folder("link");
        let (path, link) = (folder.join("a.txt"), folder.join("link.txt"));
        write(&path, b"old").unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        write(&link, b"new").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&path).unwrap(), b"new");
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_full_device_is_told_by_its_name() {
        let path = Path::new("/dev/full");
        if !path.exists() {
            eprintln!("skipped: there is no /dev/full");
            return;
        }
        let text = write(path, b"something").unwrap_err().to_string();
        assert!(text.starts_with("/dev/full: no space left"), "{text}");
        assert!(write(&std::env::temp_dir(), b"").unwrap_err().to_string().contains("irectory"));
    }
}
