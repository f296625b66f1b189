//! The framer and the messages against pymavlink, frame by frame. `cargo xtask test` installs pymavlink and runs these.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::BTreeMap;
use std::fmt::Write as _;

use foxhound_link::Message as _;
use foxhound_link::dialect::MavMessage;
use foxhound_link::framer::{FRAME_MAX, Framer, Header, MavlinkVersion, encode, known, known_ids};
use foxhound_tests::{piped_through, share_machine};
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::Xoshiro128PlusPlus;
use serde_json::Value;

const EACH: usize = 50;

/// What a program of `tests/peers` makes of text.
fn peer(script: &str, arguments: &[String], input: String) -> String {
    String::from_utf8(piped_through(script, arguments, input.into_bytes())).unwrap()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}

fn unhex(text: &str) -> Vec<u8> {
    (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap()).collect()
}

/// The fields of a message by name, read from what it prints for people: `NAME(NAME_DATA { field: value, .. })`, where a
/// value is a number, a list of numbers, or text, `CharArray { data: [..], str_len: .. }`.
fn fields(message: &MavMessage) -> BTreeMap<String, Vec<String>> {
    let text = format!("{message:?}").replace("CharArray { data: ", "").replace(", str_len: ", " len ");
    let body = &text[text.find('{').unwrap() + 1..text.rfind('}').unwrap()];
    let mut fields = BTreeMap::new();
    let mut rest = body.trim();
    while !rest.is_empty() {
        let (name, behind) = rest.split_once(": ").unwrap();
        let (values, behind) = match behind.strip_prefix('[') {
            Some(list) => list.split_once(']').unwrap(),
            None => behind.split_at(behind.find(", ").unwrap_or(behind.len())),
        };
        fields.insert(name.trim().to_owned(), values.trim().split(", ").map(str::to_owned).collect());
        rest = behind.split_once(", ").map_or("", |(_, rest)| rest);
    }
    fields
}

/// Whether a value as Rust prints it is the one whose bit pattern pymavlink gave. Rust does not print the bits of a NaN;
/// those are compared on the wire.
fn agree(ours: &str, theirs: &str) -> bool {
    if let Some(bits) = theirs.strip_prefix("f32:") {
        let theirs = f32::from_bits(u32::from_str_radix(bits, 16).unwrap());
        let ours: f32 = ours.parse().unwrap();
        ours.to_bits() == theirs.to_bits() || ours.is_nan() && theirs.is_nan()
    } else if let Some(bits) = theirs.strip_prefix("f64:") {
        let theirs = f64::from_bits(u64::from_str_radix(bits, 16).unwrap());
        let ours: f64 = ours.parse().unwrap();
        ours.to_bits() == theirs.to_bits() || ours.is_nan() && theirs.is_nan()
    } else {
        ours == theirs
    }
}

/// Compares names and values of all fields; says whether pymavlink has all of ours.
fn compare(message: &MavMessage, report: &Value) -> bool {
    assert_eq!(report["name"], message.message_name());
    let mut ours = fields(message);
    for (name, values) in report["fields"].as_object().unwrap() {
        let name = if name == "type" { "mavtype" } else { name };
        let mine = ours.remove(name).unwrap_or_else(|| panic!("{name} of {message:?}"));
        let theirs: Vec<&str> = values.as_array().unwrap().iter().map(|value| value.as_str().unwrap()).collect();
        let same = mine.len() == theirs.len() && mine.iter().zip(&theirs).all(|(ours, theirs)| agree(ours, theirs));
        assert!(same, "{name} of {message:?}: {mine:?} and {theirs:?}");
    }
    // Two extensions are newer than pymavlink's definitions.
    let newer = ours.keys().map(String::as_str).collect::<Vec<_>>();
    let expected: &[&str] =
        if matches!(message, MavMessage::TIMESYNC(_)) { &["target_component", "target_system"] } else { &[] };
    assert_eq!(newer, expected, "{message:?}");
    newer.is_empty()
}

fn header(report: &Value) -> Header {
    let byte = |at: usize| u8::try_from(report["header"][at].as_u64().unwrap()).unwrap();
    Header { system_id: byte(0), component_id: byte(1), sequence: byte(2) }
}

fn write(header: Header, message: &MavMessage) -> Vec<u8> {
    let mut bytes = [0; FRAME_MAX];
    let length = encode(header, message, &mut bytes);
    bytes[..length].to_vec()
}

/// A payload of random bytes, of words that are extreme as integers or as floats, or both, with zeros from somewhere on.
fn any_payload(random: &mut Xoshiro128PlusPlus) -> [u8; 255] {
    const EXTREMES: [u32; 8] =
        [0, u32::MAX, 0x7F80_0000, 0xFF80_0000, 0x7FC0_1234, 0x7F7F_FFFF, 0x8000_0000, 0x7FFF_FFFF];
    let mut payload = [0; 255];
    let extreme = random.next_u32() % 3;
    for word in payload.chunks_mut(4) {
        let special = extreme == 0 || extreme == 1 && random.next_u32().is_multiple_of(2);
        let value = if special { EXTREMES[random.next_u32() as usize % 8] } else { random.next_u32() };
        word.copy_from_slice(&value.to_le_bytes()[..word.len()]);
    }
    if random.next_u32().is_multiple_of(3) {
        payload[random.next_u32() as usize % 64..].fill(0);
    }
    // Python cannot hold a signalling NaN of 32 bits: it turns quiet on the way to 64.
    let signals = |word: &[u8]| {
        let value = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
        f32::from_bits(value).is_nan() && value & 0x0040_0000 == 0
    };
    while let Some(at) = payload.windows(4).position(signals) {
        payload[at + 2] |= 0x40;
    }
    payload
}

/// pymavlink reads our frames of every message with random values, and writes the same bytes.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn pymavlink_reads_our_frames_and_writes_the_same() {
    let _machine = share_machine();
    let mut random = Xoshiro128PlusPlus::seed_from_u64(61);
    let (mut sent, mut lines) = (Vec::new(), String::new());
    for &id in MavMessage::all_ids() {
        for round in 0..EACH {
            let payload = if round == 0 { [0; 255] } else { any_payload(&mut random) };
            let message = MavMessage::parse(MavlinkVersion::V2, id, &payload).unwrap();
            let [system_id, component_id, sequence, _] = random.next_u32().to_le_bytes();
            let header = Header { system_id, component_id, sequence };
            let bytes = write(header, &message);
            writeln!(lines, "{}", hex(&bytes)).unwrap();
            sent.push((header, message, bytes));
        }
    }
    let output = peer("per_frame.py", &["read".to_owned()], lines);
    let reports: Vec<Value> = output.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(reports.len(), sent.len());
    for ((sender, message, bytes), report) in sent.iter().zip(&reports) {
        assert_eq!(header(report), *sender);
        if compare(message, report) {
            assert_eq!(report["frame"], hex(bytes), "{message:?}");
        }
    }
}

/// We read pymavlink's frames of every message with random values, and write the same bytes.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn we_read_pymavlinks_frames_and_write_the_same() {
    let _machine = share_machine();
    let mut arguments = vec!["write".to_owned(), "62".to_owned(), EACH.to_string()];
    arguments.extend(MavMessage::all_ids().iter().map(u32::to_string));
    let output = peer("per_frame.py", &arguments, String::new());
    let mut framer = Framer::new();
    let mut read = 0;
    for line in output.lines() {
        let report: Value = serde_json::from_str(line).unwrap();
        let bytes = unhex(report["frame"].as_str().unwrap());
        assert_eq!(framer.push(&bytes), bytes.len());
        let frame = framer.next_frame().unwrap();
        assert_eq!((frame.header, frame.bytes), (header(&report), &*bytes));
        let message = frame.message().unwrap();
        compare(&message, &report);
        assert_eq!(write(frame.header, &message), bytes, "{message:?}");
        read += 1;
    }
    assert_eq!(read, EACH * MavMessage::all_ids().len());
    let counters = framer.counters();
    assert_eq!((counters.frames as usize, counters.skipped_bytes, counters.bad_crc), (read, 0, 0));
}

/// Our table of message lengths and checksums equals pymavlink's for every message that it knows.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn every_published_message_that_pymavlink_knows_is_in_our_table_as_it_knows_it() {
    let _machine = share_machine();
    let mut table = String::new();
    for id in known_ids() {
        let known = known(id).unwrap();
        writeln!(table, "{id} {} {}", known.extra, known.shortest).unwrap();
    }
    let output = peer("check_known.py", &[], table);
    assert!(output.contains("all checks passed"), "{output}");
}
