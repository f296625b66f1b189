//! Serial ports and pseudo-terminals on systems other than Unix: refused when one is opened.

use std::io;
use std::path::{Path, PathBuf};

/// A serial port, or the far end of one: not on this system.
#[derive(Debug)]
pub enum Serial {}

impl Serial {
    pub(super) fn open(_: &Path, _: u32) -> io::Result<Self> {
        Err(io::Error::new(io::ErrorKind::Unsupported, "serial ports need Linux or macOS; connect by tcp or udp"))
    }

    pub(super) fn pseudo_terminal() -> io::Result<(Self, PathBuf)> {
        Err(io::Error::new(io::ErrorKind::Unsupported, "pty needs Linux or macOS; listen by tcp or udp"))
    }

    pub(super) fn is_open(&mut self) -> bool {
        match *self {}
    }

    pub(super) fn read(&mut self) -> Vec<u8> {
        match *self {}
    }

    pub(super) fn write(&mut self, _: &[u8]) {
        match *self {}
    }
}
