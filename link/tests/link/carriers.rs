//! Frames inside frames: what travels in another message's payload is not traffic.

use crate::bench::{ARDUPILOT, ARMED, Bench, GUIDED, heartbeat, read};
use foxhound_core::base::time::Instant;
use foxhound_link::companion::Config;
use foxhound_link::dialect::MavMessage;
use foxhound_link::framer::{FRAME_MAX, Header, encode, known, known_ids};
use mavlink_core::calculate_crc;

/// A heartbeat of an autopilot that is armed and in GUIDED.
fn cargo() -> Vec<u8> {
    let message = MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, GUIDED, ARMED));
    let mut bytes = [0; FRAME_MAX];
    let length = encode(Header { system_id: 1, component_id: 1, sequence: 7 }, &message, &mut bytes);
    bytes[..length].to_vec()
}

/// A frame of any published message.
fn carrier(id: u32, payload: &[u8]) -> Vec<u8> {
    let [low, middle, high, _] = id.to_le_bytes();
    let mut frame = vec![0xFD, payload.len() as u8, 0, 0, 9, 1, 191, low, middle, high];
    frame.extend_from_slice(payload);
    let crc = calculate_crc(&frame[1..], known(id).unwrap().extra);
    frame.extend_from_slice(&crc.to_le_bytes());
    frame
}

fn heard(stream: &[u8], chunk: usize) -> Vec<u32> {
    let mut ids = Vec::new();
    let framer = read(stream, chunk, |frame| ids.push(frame.message_id));
    assert_eq!((framer.waiting(), framer.counters().skipped_bytes, framer.counters().bad_crc), (0, 0, 0));
    ids
}

#[test]
fn a_heartbeat_in_the_payload_of_any_published_message_is_not_heard() {
    let cargo = cargo();
    let mut carriers = 0;
    for id in known_ids() {
        let room = usize::from(known(id).unwrap().shortest);
        // At the front, at the end, and cut off by the end.
        for at in [0, 1, room.saturating_sub(cargo.len()), room.saturating_sub(cargo.len() - 1)] {
            if at >= room {
                continue;
            }
            let mut payload = vec![0x55; room];
            let carried = cargo.len().min(room - at);
            payload[at..at + carried].copy_from_slice(&cargo[..carried]);
            let mut stream = carrier(id, &payload);
            stream.extend_from_slice(&cargo);
            for chunk in [1, 64] {
                assert_eq!(heard(&stream, chunk), [id, 0], "message {id}, byte {at}, pieces of {chunk}");
            }
            carriers += u32::from(carried == cargo.len());
        }
    }
    assert!(carriers > 500, "{carriers}");
}

#[test]
fn the_cargo_of_tunnels_files_logs_and_serial_ports_wakes_no_companion() {
    let cargo = cargo();
    // TUNNEL, FILE_TRANSFER_PROTOCOL, LOG_DATA, SERIAL_CONTROL: id and where their data start.
    for (id, data) in [(385, 5), (110, 3), (120, 7), (126, 9)] {
        let mut bench = Bench::new(Config::default());
        let mut payload = vec![0; data];
        while payload.len() + cargo.len() <= usize::from(known(id).unwrap().shortest) {
            payload.extend_from_slice(&cargo);
        }
        let stream = carrier(id, &payload);
        for chunk in [1, 7, stream.len()] {
            for piece in stream.chunks(chunk) {
                bench.companion.receive(Instant(bench.now_us), piece);
            }
        }
        assert!(payload.len() > cargo.len() * 3, "message {id}");
        assert_eq!(bench.companion.autopilot(), None, "message {id}");
        let counters = bench.companion.counters().framer;
        assert_eq!((counters.unknown, counters.frames, counters.skipped_bytes), (3, 0, 0), "message {id}");
        // The same heartbeat outside is heard.
        bench.companion.receive(Instant(bench.now_us), &cargo);
        assert!(bench.companion.autopilot().is_some());
    }
}
