//! The framer beside the reader and the writer of `mavlink-core` 0.21, another implementation of the same frames. Both
//! use our dialect's types: those are compared with pymavlink in `tests/link/mavlink_peers.rs`.

use crate::bench::read;
use foxhound_link::dialect::MavMessage;
use foxhound_link::framer::{FRAME_MAX, Framer, Header, MavlinkVersion, encode};
use mavlink_core::embedded::Write;
use mavlink_core::error::MessageWriteError;
use mavlink_core::{MAVLinkMessageRaw, MavHeader, MavlinkReader, Message, write_v2_msg};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

const EACH: usize = 50;

struct Sink(Vec<u8>);

impl Write for Sink {
    fn write_all(&mut self, bytes: &[u8]) -> Result<(), MessageWriteError> {
        self.0.extend_from_slice(bytes);
        Ok(())
    }
}

/// A message with random fields, or extreme ones: NaN with a payload, infinities, the greatest and the least.
fn any_message(random: &mut Xoshiro128PlusPlus, id: u32) -> MavMessage {
    const EXTREMES: [u32; 8] =
        [0, u32::MAX, 0x7F80_0000, 0xFF80_0000, 0x7FC0_1234, 0x7F7F_FFFF, 0x8000_0000, 0x7FFF_FFFF];
    let extreme = random.next_u32() % 3;
    let mut payload = [0; 255];
    for word in payload.chunks_mut(4) {
        let special = extreme == 0 || extreme == 1 && random.next_u32().is_multiple_of(2);
        let value = if special { EXTREMES[random.next_u32() as usize % 8] } else { random.next_u32() };
        word.copy_from_slice(&value.to_le_bytes()[..word.len()]);
    }
    // Zeros at the end are not sent.
    payload[random.next_u32() as usize % 255..].fill(0);
    MavMessage::parse(MavlinkVersion::V2, id, &payload).unwrap()
}

/// Every message of the dialect many times, each frame by itself.
fn frames(random: &mut Xoshiro128PlusPlus) -> Vec<(Header, MavMessage, Vec<u8>)> {
    let mut frames = Vec::new();
    for &id in MavMessage::all_ids() {
        for _ in 0..EACH {
            let [system_id, component_id, sequence, _] = random.next_u32().to_le_bytes();
            let header = Header { system_id, component_id, sequence };
            let message = any_message(random, id);
            let mut bytes = [0; FRAME_MAX];
            let length = encode(header, &message, &mut bytes);
            frames.push((header, message, bytes[..length].to_vec()));
        }
    }
    frames
}

/// All fields, bit for bit (a NaN is not equal to itself).
fn bits(message: &MavMessage) -> Vec<u8> {
    let mut bytes = [0; 255];
    let length = message.ser(MavlinkVersion::V2, &mut bytes);
    bytes[..length].to_vec()
}

/// The frames that the other reader finds until the stream ends.
fn theirs(stream: &[u8]) -> Vec<Vec<u8>> {
    let mut reader = MavlinkReader::new(stream);
    let mut found = Vec::new();
    while let Ok(MAVLinkMessageRaw::V2(raw)) = reader.read_raw_message::<MavMessage>(MavlinkVersion::V2) {
        found.push(raw.raw_bytes().to_vec());
    }
    found
}

#[test]
fn each_reads_what_the_other_writes() {
    let mut random = Xoshiro128PlusPlus::seed_from_u64(1);
    let mut framer = Framer::new();
    for (header, message, bytes) in frames(&mut random) {
        let sender = MavHeader {
            system_id: u32::from(header.system_id),
            component_id: header.component_id,
            sequence: header.sequence,
        };
        let mut written = Sink(Vec::new());
        write_v2_msg(&mut written, sender, &message).unwrap();
        assert_eq!(written.0, bytes, "{message:?}");

        let (seen, read): (MavHeader, MavMessage) =
            MavlinkReader::new(&*bytes).read_message(MavlinkVersion::V2).unwrap();
        assert_eq!((seen, bits(&read)), (sender, bits(&message)), "{message:?}");

        assert_eq!(framer.push(&written.0), bytes.len());
        let frame = framer.next_frame().unwrap();
        assert_eq!((frame.header, frame.bytes), (header, &*bytes));
        assert_eq!(bits(&frame.message().unwrap()), bits(&message), "{message:?}");
    }
    assert_eq!(framer.counters().frames as usize, EACH * MavMessage::all_ids().len());
    assert_eq!(framer.counters().skipped_bytes, 0);
}

#[test]
fn both_find_the_same_frames_in_a_damaged_stream() {
    let mut random = Xoshiro128PlusPlus::seed_from_u64(2);
    let sent = frames(&mut random);
    let (mut stream, mut damaged) = (Vec::new(), 0);
    for (_, _, bytes) in &sent {
        for _ in 0..random.next_u32() % 65 {
            let start = random.next_u32().is_multiple_of(8);
            stream.push(if start { 0xFD } else { random.next_u32() as u8 });
        }
        let mut bytes = bytes.clone();
        match random.next_u32() % 8 {
            0 => {
                let at = random.next_u32() as usize % bytes.len();
                bytes[at] ^= 1 << (random.next_u32() % 8);
                damaged += 1;
            }
            1 => {
                bytes.truncate(random.next_u32() as usize % bytes.len());
                damaged += 1;
            }
            _ => {}
        }
        stream.extend_from_slice(&bytes);
    }
    stream.extend_from_slice(&[0; FRAME_MAX]);
    let (mut ours, theirs) = (Vec::new(), theirs(&stream));
    read(&stream, stream.len(), |frame| ours.push(frame.bytes.to_vec()));
    assert!(ours == theirs, "{} and {}", ours.len(), theirs.len());
    assert_eq!(ours.len(), sent.len() - damaged);
}
