//! Why the firmware does not fly in QEMU.

use std::fmt;
use std::io;
use std::path::PathBuf;

use crate::drive::computer::ComputerError;

/// The board's name in the `.foxhound_board` section of a twin's image.
pub(super) const BOARD: &str = "mps2_an386";

/// Why the firmware does not fly.
#[derive(Debug)]
pub enum QemuError {
    /// This system does not have what the connection to QEMU needs.
    System,
    /// The file is not an image for the twin.
    Image {
        /// The file.
        path: PathBuf,
        /// What it is instead.
        why: String,
    },
    /// QEMU cannot be started.
    Start(io::Error),
    /// A file, a socket or a pipe failed.
    Io(io::Error),
    /// The firmware refused, with its text.
    Refused(String),
    /// The firmware has restarted and wants a setup.
    Restarted,
    /// No answer, or an unreadable one.
    Lost {
        /// The expected and the received answer.
        what: String,
        /// Output of QEMU and the firmware (by semihosting).
        console: String,
    },
}

impl fmt::Display for QemuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::System => {
                f.write_str("qemu needs Linux: QEMU shares its memory with this program through a file there")
            }
            Self::Image { path, why } => {
                write!(f, "{} is not a firmware image for {BOARD}: {why}", path.display())
            }
            Self::Start(error) => write!(f, "qemu-system-arm cannot be started: {error}"),
            Self::Io(error) => write!(f, "the connection to QEMU failed: {error}"),
            Self::Restarted => f.write_str("the firmware has restarted"),
            Self::Refused(reason) => write!(f, "the firmware refused: {reason}"),
            Self::Lost { what, console } if console.is_empty() => write!(f, "{what}; it printed nothing"),
            Self::Lost { what, console } => write!(f, "{what}; it had printed: {console}"),
        }
    }
}

impl std::error::Error for QemuError {}

impl From<QemuError> for ComputerError {
    fn from(error: QemuError) -> Self {
        Self(error.to_string())
    }
}

impl From<io::Error> for QemuError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}
