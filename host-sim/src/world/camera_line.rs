//! Frames of a camera as sent to the maintenance port: the layout is in [`foxhound_computer::camera`].

use foxhound_computer::camera::{BEGIN, END, LINE};
use foxhound_core::doa::calibration::record::crc32;
use foxhound_pad::{Format, Header};

/// All records of one frame, whose pixels are line after line, with its age when its last byte has been sent.
#[must_use]
pub fn bytes(header: &Header, pixels: &[u8], age_us: u32) -> Vec<u8> {
    let (format, pixel_bytes) = match header.format {
        Format::Rgb565 => (0, 2),
        Format::Grey => (1, 1),
    };
    let ([w0, w1], [h0, h1]) = (header.width_px.to_le_bytes(), header.height_px.to_le_bytes());
    let mut bytes = record(BEGIN, 0, &[w0, w1, h0, h1, format]);
    let line_bytes = usize::from(header.width_px) * pixel_bytes;
    for (row, line) in (0..).zip(pixels.chunks(line_bytes.max(1))) {
        bytes.extend(record(LINE, row, line));
    }
    bytes.extend(record(END, 0, &age_us.to_le_bytes()));
    bytes
}

/// One record between its zeros.
#[must_use]
pub fn record(kind: u8, number: u32, content: &[u8]) -> Vec<u8> {
    let mut plain = vec![kind];
    let mut rest = number;
    // The number's varint: seven bits a byte, the lowest first.
    while rest >= 0x80 {
        plain.push(rest as u8 | 0x80);
        rest >>= 7;
    }
    plain.push(rest as u8);
    plain.extend_from_slice(content);
    plain.extend_from_slice(&crc32(&plain).to_le_bytes());
    let mut framed = vec![0; cobs::max_encoding_length(plain.len()) + 2];
    let length = cobs::encode(&plain, &mut framed[1..]);
    framed.truncate(length + 1);
    framed.push(0);
    framed
}

#[cfg(test)]
mod tests {
    use foxhound_computer::camera::{Came, Camera, Sighted, detector};
    use foxhound_core::base::time::Instant;
    use foxhound_core::guidance::Config;
    use foxhound_core::landing::observation::{Bad, Seen};

    use super::*;
    use crate::world::camera::{self, Size, random};
    use crate::world::random::Random;

    const HEADER: Header = Header { time: Instant(0), width_px: 160, height_px: 120, format: Format::Rgb565 };

    fn camera() -> Camera {
        Camera::new(detector(&Config::default()).unwrap())
    }

    /// The typed bytes, and the results of the frames.
    fn taken(camera: &mut Camera, bytes: &[u8]) -> (Vec<u8>, Vec<Sighted>) {
        let (mut typed, mut looks) = (Vec::new(), Vec::new());
        for byte in bytes {
            match camera.push(*byte, None) {
                Some(Came::Text(byte)) => typed.push(byte),
                Some(Came::Sighted(sighted)) => looks.push(sighted),
                None => {}
            }
        }
        (typed, looks)
    }

    fn noise(random: &mut Random, zeros: f64) -> Vec<u8> {
        (0..160 * 120 * 2)
            .map(|_| if random.uniform() < zeros { 0 } else { (random.uniform() * 256.0) as u8 })
            .collect()
    }

    #[test]
    fn a_pad_is_seen_through_the_line_as_it_is_seen_without() {
        let recipe = random::Recipe { height_m: [1.0, 3.0], hidden: 0.0, ..random::Recipe::PAD };
        let lens = camera::Camera::default();
        let detector = detector(&Config::default()).unwrap();
        for seed in 0..20 {
            let frame = random::shot(&recipe, &lens, seed).frame;
            assert_eq!(frame.size, Size::USUAL);
            let (typed, looks) = taken(&mut camera(), &bytes(&HEADER, &frame.bytes, 80_000));
            let alone = camera::watch::alone(&detector, &frame, None, 1);
            assert_eq!((typed.len(), looks.len()), (0, 1));
            assert_eq!((looks[0].seen, looks[0].age_us), (alone.seen, 80_000));
            assert_eq!(looks[0].look(Instant(1_000_000)).time, Instant(920_000));
        }
    }

    #[test]
    fn any_pixels_travel_and_what_is_typed_between_frames_arrives() {
        let (mut camera, mut random) = (camera(), Random::new(7, 1));
        for frame in 0..60 {
            let zeros = [0.0, 0.3, 0.99][frame % 3];
            let mut stream = bytes(&HEADER, &noise(&mut random, zeros), 0);
            stream.extend_from_slice(b"status\r");
            let (typed, looks) = taken(&mut camera, &stream);
            assert_eq!(typed, b"status\r");
            assert_eq!(looks.len(), 1, "{looks:?}");
            assert!(!matches!(looks[0].seen, Seen::Bad(bad) if bad != Bad::Flat), "{looks:?}");
        }
    }

    #[test]
    fn a_frame_that_is_damaged_is_bad_and_the_next_one_is_not() {
        let (mut random, good) = (Random::new(3, 1), bytes(&HEADER, &noise(&mut Random::new(9, 1), 0.1), 0));
        let lines: Vec<usize> = (0..good.len() - 1).filter(|at| good[*at..*at + 2] == [0, 0]).collect();
        for round in 0..200 {
            let mut camera = camera();
            let mut damaged = good.clone();
            let at = 60 + (random.uniform() * (damaged.len() - 120) as f64) as usize;
            match round % 4 {
                // A bit, a piece, a zero that gets lost, one that was not there.
                0 => damaged[at] ^= 1 << (round % 8),
                1 => drop(damaged.drain(at..at + 40)),
                2 => drop(damaged.remove(lines[round % lines.len()])),
                _ => damaged.insert(at, 0),
            }
            let (_, looks) = taken(&mut camera, &damaged);
            assert!(looks.iter().all(|sighted| matches!(sighted.seen, Seen::Bad(_))), "{round}: {looks:?}");
            let (_, looks) = taken(&mut camera, &good);
            let last = looks.last().unwrap();
            assert!(!matches!(last.seen, Seen::Bad(_)), "{round}: {looks:?}");
        }
    }

    #[test]
    fn each_thing_that_can_be_wrong_has_its_name() {
        let pixels = noise(&mut Random::new(5, 1), 0.1);
        let line = |row: u32, width: usize| record(LINE, row, &pixels[..2 * width]);
        let begin = |width: u16, height: u16| {
            let ([w0, w1], [h0, h1]) = (width.to_le_bytes(), height.to_le_bytes());
            record(BEGIN, 0, &[w0, w1, h0, h1, 0])
        };
        let end = record(END, 0, &1000_u32.to_le_bytes());
        let whole = bytes(&HEADER, &pixels, 0);
        let old =
            [&whole[..whole.len() - record(END, 0, &[0; 4]).len()], &record(END, 0, &3_000_000_u32.to_le_bytes())];
        for (stream, bad) in [
            (vec![begin(8, 8), end.clone()], Bad::Size),
            (vec![begin(321, 240), end.clone()], Bad::Size),
            (vec![record(BEGIN, 0, &[160, 0, 120, 0, 2]), end.clone()], Bad::Size),
            (vec![begin(160, 120), line(0, 100), end.clone()], Bad::Line),
            (vec![begin(160, 120), line(0, 160), line(2, 160), end.clone()], Bad::Order),
            (vec![begin(160, 120), line(1 << 17, 160), end.clone()], Bad::Order),
            (vec![begin(160, 120), line(0, 160), end.clone()], Bad::Cut),
            (vec![begin(160, 120), line(0, 160), begin(160, 120)], Bad::Cut),
            (vec![bytes(&HEADER, &[0x42; 160 * 120 * 2], 0)], Bad::Flat),
            (vec![old.concat()], Bad::Age),
        ] {
            let (_, looks) = taken(&mut camera(), &stream.concat());
            let seen: Vec<_> = looks.iter().map(|sighted| sighted.seen).collect();
            assert_eq!(seen, [Seen::Bad(bad)]);
        }
        // Without a begin there is no result.
        assert_eq!(taken(&mut camera(), &[line(0, 160), end].concat()), (Vec::new(), Vec::new()));
    }

    #[test]
    fn a_zero_by_chance_swallows_no_more_than_the_longest_record() {
        let mut camera = camera();
        let (typed, _) = taken(&mut camera, &[b"\0".to_vec(), b"status\r".repeat(110)].concat());
        assert!(typed.ends_with(b"status\r") && typed.len() > 100, "{}", typed.len());
    }
}
