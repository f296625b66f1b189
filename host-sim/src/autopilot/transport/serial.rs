//! Serial ports, and pseudo-terminals that look like one.

use std::fs::File;
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{Mode, OFlags};
use rustix::pty::OpenptFlags;
use rustix::termios::{ControlModes, OptionalActions};

use super::stream::Stream;

const OPEN_AGAIN_AFTER: Duration = Duration::from_millis(500);

/// A serial port, or the far end of one.
#[derive(Debug)]
pub struct Serial {
    stream: Option<Stream<File>>,
    kind: Kind,
    /// How often it has been opened again.
    openings: u32,
}

#[derive(Debug)]
enum Kind {
    /// It may be unplugged and come back.
    Port { device: PathBuf, baud: u32, try_again: Instant },
    /// It stays; programs may open and close its other end.
    Terminal { is_open: bool },
}

impl Serial {
    pub(super) fn open(device: &Path, baud: u32) -> io::Result<Self> {
        let stream = Some(Stream::new(open_port(device, baud)?));
        let kind = Kind::Port { device: device.to_owned(), baud, try_again: Instant::now() };
        Ok(Self { stream, kind, openings: 0 })
    }

    /// A pseudo-terminal and the device by which it is reached.
    pub(super) fn pseudo_terminal() -> io::Result<(Self, PathBuf)> {
        let terminal = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        rustix::pty::grantpt(&terminal)?;
        rustix::pty::unlockpt(&terminal)?;
        let name = rustix::pty::ptsname(&terminal, Vec::new())?;
        let device = PathBuf::from(name.into_string().map_err(io::Error::other)?);
        // No echo, whoever opens it; and from now on it can be detected that nobody has.
        drop(open_port(&device, 115_200)?);
        let flags = rustix::fs::fcntl_getfl(&terminal)?;
        rustix::fs::fcntl_setfl(&terminal, flags | OFlags::NONBLOCK)?;
        // A program that is started meanwhile would keep it open.
        rustix::io::fcntl_setfd(&terminal, rustix::io::FdFlags::CLOEXEC)?;
        let stream = Some(Stream::new(File::from(terminal)));
        Ok((Self { stream, kind: Kind::Terminal { is_open: false }, openings: 0 }, device))
    }

    pub(super) fn is_open(&mut self) -> bool {
        match &mut self.kind {
            Kind::Terminal { is_open } => *is_open,
            Kind::Port { device, baud, try_again } => {
                if self.stream.is_none() && Instant::now() >= *try_again {
                    *try_again = Instant::now() + OPEN_AGAIN_AFTER;
                    self.stream = open_port(device, *baud).ok().map(Stream::new);
                    self.openings += u32::from(self.stream.is_some());
                }
                self.stream.is_some()
            }
        }
    }

    pub(super) fn openings(&self) -> u32 {
        self.openings
    }

    pub(super) fn read(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.is_open();
        if let Some(stream) = &mut self.stream {
            let outcome = stream.read(&mut bytes);
            self.follow(outcome.is_ok());
        }
        bytes
    }

    pub(super) fn write(&mut self, frames: &[u8]) {
        if self.is_open()
            && let Some(stream) = &mut self.stream
        {
            let outcome = stream.write(frames);
            self.follow(outcome.is_ok());
        }
    }

    /// A port that failed is closed; at a terminal the other end is open, or not.
    fn follow(&mut self, works: bool) {
        match &mut self.kind {
            Kind::Terminal { is_open } => *is_open = works,
            Kind::Port { .. } if !works => self.stream = None,
            Kind::Port { .. } => {}
        }
    }
}

fn open_port(device: &Path, baud: u32) -> io::Result<File> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let port: OwnedFd = rustix::fs::open(device, flags, Mode::empty())?;
    let mut settings = rustix::termios::tcgetattr(&port)?;
    settings.make_raw();
    settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    settings.control_modes &= !(ControlModes::CRTSCTS | ControlModes::CSTOPB | ControlModes::PARENB);
    settings.set_speed(baud)?;
    rustix::termios::tcsetattr(&port, OptionalActions::Now, &settings)?;
    Ok(File::from(port))
}
