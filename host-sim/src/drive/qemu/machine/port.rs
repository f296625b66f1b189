//! The maintenance port of the firmware in QEMU: a pair of pipes.

use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::thread::sleep;
use std::time::Instant;

use rustix::fs::{CWD, FileType, Mode, OFlags};

use super::{Folder, LOOK_ROUND, PATIENCE, QemuComputer};

/// Its two ends.
#[derive(Debug)]
pub(super) struct Port {
    from: File,
    to: File,
    /// Its output, while it is wanted or may be.
    kept: Option<Vec<u8>>,
    is_wanted: bool,
}

impl Port {
    /// The pipes, to be opened before QEMU opens them.
    pub(super) fn create(folder: &Folder) -> io::Result<Self> {
        let pipe = |name| {
            let path = folder.file(name);
            rustix::fs::mknodat(CWD, &path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0)?;
            // A process that opens both ends does not wait for another.
            let flags = OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC;
            Ok::<_, io::Error>(File::from(rustix::fs::open(&path, flags, Mode::empty())?))
        };
        Ok(Self { from: pipe("port.out")?, to: pipe("port.in")?, kept: Some(Vec::new()), is_wanted: false })
    }

    /// Reads what is available.
    pub(super) fn drain(&mut self) -> io::Result<()> {
        let mut bytes = [0; 4096];
        loop {
            match self.from.read(&mut bytes) {
                Ok(0) => return Ok(()),
                Ok(count) => {
                    if let Some(kept) = &mut self.kept {
                        kept.extend_from_slice(&bytes[..count]);
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(error),
            }
        }
    }

    /// Writes all of it, while QEMU drains it: a pipe holds 64 KB.
    pub(super) fn write_patiently(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        let begin = Instant::now();
        while !bytes.is_empty() {
            match self.to.write(bytes) {
                Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock && begin.elapsed() < PATIENCE => {
                    self.drain()?;
                    sleep(LOOK_ROUND / 10);
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// A step begins: from now on it is known whether the port's output is wanted.
    pub(super) fn settle(&mut self) {
        if !self.is_wanted {
            self.kept = None;
        }
    }
}

impl QemuComputer {
    /// Keeps the output of the maintenance port, from the start; call it before the first step.
    pub fn keep_port(&mut self) {
        self.port.is_wanted = true;
    }

    /// Output of the maintenance port since the last call.
    pub fn take_port(&mut self) -> Vec<u8> {
        // What it said last, even if it is gone.
        let _ = self.port.drain();
        self.port.kept.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Types on the maintenance port.
    ///
    /// # Errors
    /// QEMU is gone, or does not read.
    pub fn type_on_port(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.port.to.write_all(bytes)
    }
}
