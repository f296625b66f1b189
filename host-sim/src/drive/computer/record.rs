//! The flight log of the computer in this process: the same frames that the firmware sends by its maintenance port.

use foxhound_computer::log::ring::Ring;
use foxhound_computer::log::{Log, State};

/// Space for the records of one step.
const RING_BYTES: usize = 1 << 16;

/// A log in progress.
#[derive(Debug, Default)]
pub(super) struct Recording {
    ring: Box<Ring<RING_BYTES>>,
    state: State,
    bytes: Vec<u8>,
}

impl Recording {
    /// Writes with the log.
    pub(super) fn write<T>(&mut self, with: impl FnOnce(&mut Log<'_>) -> T) -> T {
        let (producer, mut consumer) = self.ring.ends();
        let mut log = Log::resume(producer, self.state);
        let result = with(&mut log);
        self.state = log.pause();
        let mut bytes = [0; 1024];
        loop {
            let count = consumer.read(&mut bytes);
            if count == 0 {
                return result;
            }
            self.bytes.extend_from_slice(&bytes[..count]);
        }
    }

    /// The bytes written since the last call.
    pub(super) fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }
}
