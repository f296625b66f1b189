//! Bytes over anything that is read and written like a file and never waits.

use std::io::{ErrorKind, Read, Write};

/// Most bytes that one call reads.
const READ_MAX: usize = 1 << 16;

/// A byte stream.
#[derive(Debug)]
pub(super) struct Stream<S> {
    inner: S,
    /// The rest of a frame whose beginning has been sent.
    begun: Vec<u8>,
}

/// The other end is gone.
#[derive(Debug)]
pub(super) struct Gone;

impl<S: Read + Write> Stream<S> {
    pub(super) fn new(inner: S) -> Self {
        Self { inner, begun: Vec::new() }
    }

    /// Appends what there is to read.
    pub(super) fn read(&mut self, sink: &mut Vec<u8>) -> Result<(), Gone> {
        let mut piece = [0; 4096];
        let most = sink.len() + READ_MAX;
        while sink.len() < most {
            match self.inner.read(&mut piece) {
                Ok(0) => return Err(Gone),
                Ok(count) => sink.extend_from_slice(&piece[..count]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Err(Gone),
            }
        }
        Ok(())
    }

    /// Writes what fits now. A frame that fits in part is finished by later calls; the frames behind it are dropped.
    pub(super) fn write(&mut self, mut frames: &[u8]) -> Result<(), Gone> {
        let begun = std::mem::take(&mut self.begun);
        let sent = self.put(&begun)?;
        if sent < begun.len() {
            self.begun = begun[sent..].to_vec();
            return Ok(());
        }
        while !frames.is_empty() {
            let (frame, rest) = frames.split_at(frame_length(frames));
            let sent = self.put(frame)?;
            if sent < frame.len() {
                self.begun = if sent > 0 { frame[sent..].to_vec() } else { Vec::new() };
                break;
            }
            frames = rest;
        }
        Ok(())
    }

    /// Writes as much as is accepted now, and returns how much.
    fn put(&mut self, bytes: &[u8]) -> Result<usize, Gone> {
        let mut sent = 0;
        while sent < bytes.len() {
            match self.inner.write(&bytes[sent..]) {
                Ok(0) => return Err(Gone),
                Ok(count) => sent += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Err(Gone),
            }
        }
        Ok(sent)
    }
}

/// Length of the frame at the start of `bytes`; of all of them, if it is not a frame.
pub(super) fn frame_length(bytes: &[u8]) -> usize {
    match bytes {
        [0xFD, payload, flags, ..] => {
            (12 + usize::from(*payload) + if flags & 1 == 1 { 13 } else { 0 }).min(bytes.len())
        }
        _ => bytes.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;

    /// Takes so many bytes, and says then that it would have to wait.
    struct Narrow {
        room: usize,
        taken: Vec<u8>,
    }

    impl Read for Narrow {
        fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
            Err(ErrorKind::WouldBlock.into())
        }
    }

    impl Write for Narrow {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let count = bytes.len().min(self.room);
            if count == 0 {
                return Err(ErrorKind::WouldBlock.into());
            }
            self.room -= count;
            self.taken.extend_from_slice(&bytes[..count]);
            Ok(count)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn frame(mark: u8) -> Vec<u8> {
        let mut frame = vec![mark; 12 + 9];
        (frame[0], frame[1], frame[2]) = (0xFD, 9, 0);
        frame
    }

    #[test]
    fn what_the_line_does_not_take_is_dropped_by_whole_frames() {
        let mut stream = Stream::new(Narrow { room: 30, taken: Vec::new() });
        let [a, b, c, d] = [1, 2, 3, 4].map(frame);
        stream.write(&[&a[..], &b, &c].concat()).unwrap();
        stream.inner.room = 5;
        stream.write(&d).unwrap();
        stream.inner.room = 100;
        stream.write(&d).unwrap();
        assert_eq!(stream.inner.taken, [&a[..], &b, &d].concat(), "the second was finished, the third never begun");
    }
}
