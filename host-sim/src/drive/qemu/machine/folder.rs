//! The folder of the files for the communication with QEMU, until QEMU has opened them.

use std::fs::{DirBuilder, File};
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, FileExt as _};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use rustix::io::Errno;
use rustix::process::{Pid, test_kill_process};

/// Prefix of a folder's name, before the process number and a counter.
const PREFIX: &str = "foxhound-qemu-";
/// A folder older than this whose program has ended was left behind.
const STALE: Duration = Duration::from_secs(60);

/// A temporary folder for sockets, the shared memory and output; removed with everything in it as soon as QEMU has
/// opened all of that, so that nothing is left whatever ends this program.
#[derive(Debug)]
pub(super) struct Folder(PathBuf);

impl Folder {
    pub(super) fn create() -> io::Result<Self> {
        sweep();
        static COUNT: AtomicU32 = AtomicU32::new(0);
        loop {
            let count = COUNT.fetch_add(1, Ordering::Relaxed);
            let path = std::env::temp_dir().join(format!("{PREFIX}{}-{count}", std::process::id()));
            match DirBuilder::new().mode(0o700).create(&path) {
                Ok(()) => return Ok(Self(path)),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
    }

    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Creates a file in it that stays readable after its name is removed.
    pub(super) fn create_file(&self, name: &str) -> io::Result<File> {
        File::options().read(true).write(true).create_new(true).open(self.file(name))
    }
}

/// The output of QEMU.
#[derive(Debug)]
pub(super) struct Console {
    stdout: File,
    stderr: File,
}

impl Console {
    pub(super) fn create(folder: &Folder) -> io::Result<Self> {
        Ok(Self { stdout: folder.create_file("stdout")?, stderr: folder.create_file("stderr")? })
    }

    /// The files for QEMU to write into.
    pub(super) fn handles(&self) -> io::Result<[File; 2]> {
        Ok([self.stdout.try_clone()?, self.stderr.try_clone()?])
    }

    /// What has been printed, as far as it is text.
    pub(super) fn text(&self) -> String {
        let text = |file: &File| {
            let mut bytes = vec![0; file.metadata().map_or(0, |about| about.len() as usize)];
            // QEMU shares this handle and writes at its position, so reading must not move it.
            let read = file.read_exact_at(&mut bytes, 0);
            read.map_or_else(|_| String::new(), |()| String::from_utf8_lossy(&bytes).trim().to_owned())
        };
        let (stdout, stderr) = (text(&self.stdout), text(&self.stderr));
        [stderr, stdout].into_iter().filter(|text| !text.is_empty()).collect::<Vec<_>>().join("\n")
    }
}

/// Removes the folders of programs that were killed while they started QEMU.
fn sweep() {
    let Ok(entries) = std::fs::read_dir(std::env::temp_dir()) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let process = name.strip_prefix(PREFIX).and_then(|rest| rest.split_once('-')?.0.parse::<i32>().ok());
        let Some(process) = process.and_then(Pid::from_raw) else { continue };
        let age = entry.metadata().and_then(|about| about.modified()).ok().and_then(|made| made.elapsed().ok());
        let is_gone = test_kill_process(process) == Err(Errno::SRCH);
        if is_gone && age.is_some_and(|age| age > STALE) {
            // Another user's stays.
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Leftovers are removed when the temporary folder is cleaned.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
