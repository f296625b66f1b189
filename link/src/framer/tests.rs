//! The framer on hand-made streams. What is random or recorded is in `tests/link`.

use super::*;
use crate::dialect::HEARTBEAT_DATA;
use mavlink_core::calculate_crc;
use std::vec::Vec;

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

// pymavlink 2.4.50: the heartbeat of an armed quadrotor in GUIDED, system 1, component 1.
const HEARTBEAT: &str = "fd090000000101000000040000000203890403dbb3";
// The same as the cargo of a TUNNEL (385), which is not in our dialect.
const TUNNEL: &str = "fd1a00000001bf8101000000010115fd090000000101000000040000000203890403dbb3ac70";
// A signed heartbeat of component 191: key 00 01 .. 1f, link 3, time stamp 123456.
const SIGNED_HEARTBEAT: &str = "fd0901000001bf000000000000001208000403493e0340e2010000002bb0c9030021";

/// The ids of all frames in a stream, and the counters.
fn read(stream: &[u8]) -> (Vec<u32>, Counters) {
    let mut framer = Framer::new();
    let mut ids = Vec::new();
    framer.each(stream, |frame| ids.push(frame.message_id));
    (ids, framer.counters())
}

#[test]
fn a_frame_of_an_unknown_message_is_passed_over_whole_with_its_cargo() {
    let mut stream = bytes(TUNNEL);
    stream.extend_from_slice(&bytes(HEARTBEAT));
    let (ids, counters) = read(&stream);
    assert_eq!(ids, [385, 0]);
    assert_eq!((counters.frames, counters.unknown, counters.skipped_bytes), (1, 1, 0));

    // Damaged, it is rescanned like any other.
    stream[12] ^= 0x10;
    let (ids, counters) = read(&stream);
    assert_eq!(ids, [0, 0]);
    assert_eq!((counters.frames, counters.unknown, counters.bad_crc), (2, 0, 1));
}

#[test]
fn a_signed_frame_is_taken_and_its_signature_belongs_to_it() {
    let mut stream = bytes(SIGNED_HEARTBEAT);
    stream.extend_from_slice(&bytes(HEARTBEAT));
    let mut framer = Framer::new();
    framer.push(&stream);
    let signed = framer.next_frame().unwrap();
    assert!(signed.signed && signed.bytes.len() == 34 && signed.header.component_id == 191);
    assert_eq!(signed.signature().unwrap()[..], bytes("0340e2010000002bb0c9030021")[..]);
    let plain = framer.next_frame().unwrap();
    assert!(!plain.signed && plain.signature().is_none());
    assert_eq!(framer.counters().skipped_bytes, 0);
}

#[test]
fn unknown_flags_and_the_old_protocol_are_not_understood() {
    // Flag 0x02 (32-bit system ids) and flag 0x80, each with a right checksum.
    for flags in [0x02, 0x80] {
        let mut stream = bytes(HEARTBEAT);
        stream[2] = flags;
        let crc = calculate_crc(&stream[1..19], 50).to_le_bytes();
        stream[19..21].copy_from_slice(&crc);
        stream.extend_from_slice(&bytes(HEARTBEAT));
        let (ids, counters) = read(&stream);
        assert_eq!((ids.len(), counters.skipped_bytes), (1, 21), "flags {flags:#x}");
    }
    // MAVLink 1, the same heartbeat.
    let mut stream = bytes("fe0900010100040000000203890403");
    let crc = calculate_crc(&stream[1..], 50).to_le_bytes();
    stream.extend_from_slice(&crc);
    stream.extend_from_slice(&bytes(HEARTBEAT));
    let (ids, counters) = read(&stream);
    assert_eq!((ids.len(), counters.skipped_bytes), (1, 17));
}

#[test]
fn missing_frames_are_counted_for_each_sender() {
    let mut stream = Vec::new();
    let mut send = |component_id, sequence| {
        let header = Header { system_id: 1, component_id, sequence };
        let mut bytes = [0; FRAME_MAX];
        let length = encode_data(header, &HEARTBEAT_DATA::DEFAULT, &mut bytes);
        stream.extend_from_slice(&bytes[..length]);
    };
    for sequence in [250, 251, 255, 0, 0, 2] {
        send(1, sequence);
        send(2, sequence.wrapping_mul(3));
    }
    let (_, counters) = read(&stream);
    // Component 1: 252..=254 and 1. Component 2 sent 238, 241, 253, 0, 0, 6: 2 + 11 + 2 + 0 + 5.
    assert_eq!(counters.lost, 4 + 20);
}

#[test]
fn a_header_that_no_published_message_has_holds_nothing_back() {
    // What follows the start byte: a length of 255 and flags that do not exist; or an id outside the table, with the
    // right checksum of a message that nobody published, or with none.
    let mut private = bytes("fd0400000001010300004865792e");
    private.extend_from_slice(&calculate_crc(&private[1..], 77).to_le_bytes());
    for start in [bytes("fdff02"), bytes("fdff0000000000ffffff"), bytes("fdff0000000000030000"), private] {
        let mut stream = start.clone();
        stream.extend_from_slice(&bytes(HEARTBEAT));
        let mut framer = Framer::new();
        for &byte in &stream[..stream.len() - 1] {
            assert_eq!(framer.push(&[byte]), 1);
            assert_eq!(framer.next_frame(), None);
        }
        framer.push(&stream[stream.len() - 1..]);
        assert_eq!(framer.next_frame().unwrap().message_id, 0, "with its last byte: {start:x?}");
        assert_eq!(framer.counters().skipped_bytes as usize, start.len());
        assert_eq!(framer.counters().bad_crc, 0);
    }
}

#[test]
fn a_false_start_right_before_a_frame_does_not_cost_it() {
    // A heartbeat of which one byte is left, from component 1. With the 0xFD in front its length becomes the flags of a
    // signed frame and its component the id of a SYS_STATUS, of 253 bytes.
    let mut heartbeat = bytes("fd0100000701010000007f");
    heartbeat.extend_from_slice(&calculate_crc(&heartbeat[1..], 50).to_le_bytes());
    let mut stream = bytes("fd");
    stream.extend_from_slice(&heartbeat);
    stream.extend_from_slice(&[0; FRAME_MAX]);
    let (ids, counters) = read(&stream);
    assert_eq!((&ids[..], counters.bad_crc), (&[0][..], 1));
}

#[test]
fn what_waits_behind_a_false_start_is_found_with_the_next_bytes() {
    // A true header, of a heartbeat of 255 bytes, and 12 heartbeats: 262 bytes of the 267.
    let mut stream = bytes("fdff0000000101000000");
    (0..12).for_each(|_| stream.extend_from_slice(&bytes(HEARTBEAT)));
    let mut framer = Framer::new();
    assert_eq!(framer.push(&stream), 262);
    assert_eq!(framer.next_frame(), None);
    assert_eq!(framer.waiting(), 262);
    (0..5).for_each(|_| stream.push(0));
    assert_eq!(read(&stream).0, [0; 12]);
}

#[test]
fn a_frame_may_have_extensions_that_are_newer_than_the_table() {
    let mut frame = bytes("fd0c0000000101000000040000000203890403aabbcc");
    frame.extend_from_slice(&calculate_crc(&frame[1..], 50).to_le_bytes());
    let mut framer = Framer::new();
    framer.push(&frame);
    let longer = framer.next_frame().unwrap();
    assert_eq!(longer.payload.len(), 12);
    let Some(MavMessage::HEARTBEAT(heartbeat)) = longer.message() else { panic!() };
    assert_eq!((heartbeat.custom_mode, heartbeat.mavlink_version), (4, 3));
}

#[test]
fn mavlink_1_is_read_when_switched_on() {
    // pymavlink 2.4.50, dialect of MAVLink 1: the heartbeat from above, and a STATUSTEXT without its extensions.
    const HEARTBEAT: &str = "fe0904010100040000000203890403f883";
    const TEXT: &str = "fe33040101fd0675700000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000008a68";
    let stream = bytes(&[HEARTBEAT, TEXT].concat());
    let mut framer = Framer::new();
    framer.accept_v1(true);
    for piece in stream.chunks(5) {
        framer.push(piece);
        while let Some(frame) = framer.next_frame() {
            assert_eq!((frame.version, frame.signed), (MavlinkVersion::V1, false));
            assert_eq!(frame.header, Header { system_id: 1, component_id: 1, sequence: 4 });
            match frame.message() {
                Some(MavMessage::HEARTBEAT(heartbeat)) => {
                    assert_eq!((heartbeat.custom_mode, heartbeat.base_mode, heartbeat.mavlink_version), (4, 0x89, 3));
                }
                Some(MavMessage::STATUSTEXT(text)) => {
                    assert_eq!((text.severity, text.text.to_str(), text.id), (6, Ok("up"), 0));
                }
                other => panic!("{other:?}"),
            }
        }
    }
    assert_eq!((framer.counters().frames, framer.counters().skipped_bytes), (2, 0));

    // Cut short, as only MAVLink 2 may, with a right checksum.
    let mut short = bytes("fe0804010100040000000203890400");
    short.truncate(14);
    short.extend_from_slice(&calculate_crc(&short[1..], 50).to_le_bytes());
    framer.push(&short);
    assert_eq!(framer.next_frame(), None);
    assert_eq!(framer.counters().skipped_bytes, 16);

    framer.accept_v1(false);
    framer.push(&stream[..17]);
    assert_eq!(framer.next_frame(), None);
    assert_eq!(framer.counters().skipped_bytes, 33);
}

#[test]
fn no_count_overflows() {
    let mut framer = Framer::new();
    let most = u32::MAX;
    framer.counters = Counters { frames: most, unknown: most, bad_crc: most, skipped_bytes: most - 1, lost: most - 1 };
    let mut stream = bytes(HEARTBEAT);
    stream.extend_from_slice(&bytes(TUNNEL));
    // Damaged, so three frames: the tunnel's cargo is one, with another sequence number.
    stream[21 + 12] ^= 1;
    stream.extend_from_slice(&bytes(TUNNEL));
    stream.extend_from_slice(&bytes("000000"));
    framer.push(&stream);
    while framer.next_frame().is_some() {}
    assert_eq!(
        framer.counters,
        Counters { frames: most, unknown: most, bad_crc: most, skipped_bytes: most, lost: most - 1 }
    );
}

#[test]
fn a_sink_that_is_too_small_gets_nothing() {
    let mut sink = [0xAA; 20];
    assert_eq!(encode_data(Header::default(), &HEARTBEAT_DATA::DEFAULT, &mut sink), 0);
    assert_eq!(sink, [0xAA; 20]);
}
