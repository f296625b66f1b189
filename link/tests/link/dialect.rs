//! Our messages on the wire, against pymavlink's. `tests/data/make_golden.py` says how `golden.txt` was made.

use foxhound_link::Message;
use foxhound_link::dialect::*;
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode};

/// Name, `CRC_EXTRA`, frame.
fn golden() -> Vec<(&'static str, u8, Vec<u8>)> {
    let line = |line: &'static str| {
        let mut words = line.split(' ');
        let (name, extra, hex) = (words.next().unwrap(), words.next().unwrap(), words.next().unwrap());
        let byte = |at: usize| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
        (name, extra.parse().unwrap(), (0..hex.len()).step_by(2).map(byte).collect())
    };
    include_str!("../data/golden.txt").lines().map(line).collect()
}

#[test]
fn every_message_of_the_dialect_has_the_official_crc_extra() {
    let mut seen = Vec::new();
    for (name, extra, _) in golden() {
        let id = MavMessage::message_id_from_name(name).unwrap();
        assert_eq!(MavMessage::extra_crc(id), extra, "{name}");
        seen.push(id);
    }
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen, MavMessage::all_ids(), "the golden frames cover the dialect");
}

#[test]
fn golden_frames_are_read_and_written_again_byte_for_byte() {
    let mut framer = Framer::new();
    for (sequence, (name, _, bytes)) in golden().into_iter().enumerate() {
        assert_eq!(framer.push(&bytes), bytes.len());
        let frame = framer.next_frame().unwrap();
        let header = Header { system_id: 7, component_id: 191, sequence: sequence as u8 };
        assert_eq!(frame.header, header, "{name}");
        assert_eq!(frame.bytes, bytes, "{name}");
        let message = frame.message().unwrap();
        assert_eq!(message.message_name(), name);
        let mut again = [0; FRAME_MAX];
        let length = encode(header, &message, &mut again);
        assert_eq!(again[..length], bytes, "{name}");
    }
}

fn nth(index: usize) -> MavMessage {
    let mut framer = Framer::new();
    framer.push(&golden()[index].2);
    framer.next_frame().unwrap().message().unwrap()
}

/// Reading and writing again would not notice two fields of one size swapped.
#[test]
fn fields_are_where_pymavlink_puts_them() {
    let MavMessage::SET_POSITION_TARGET_LOCAL_NED(setpoint) = nth(5) else { panic!() };
    assert_eq!((setpoint.time_boot_ms, setpoint.target_system, setpoint.target_component), (99, 7, 1));
    assert_eq!((setpoint.coordinate_frame, setpoint.type_mask), (1, 0x05C7));
    assert_eq!([setpoint.vx, setpoint.vy, setpoint.vz, setpoint.yaw_rate], [1.5, -0.5, 0.25, -0.75]);
    let rest = [setpoint.x, setpoint.y, setpoint.z, setpoint.afx, setpoint.afy, setpoint.afz, setpoint.yaw];
    assert_eq!(rest, [0.0; 7]);

    let MavMessage::HEARTBEAT(heartbeat) = nth(0) else { panic!() };
    assert_eq!((heartbeat.mavtype, heartbeat.autopilot, heartbeat.base_mode), (18, 8, 0));
    assert_eq!((heartbeat.custom_mode, heartbeat.system_status, heartbeat.mavlink_version), (0, 4, 3));

    let MavMessage::ATTITUDE_QUATERNION(attitude) = nth(3) else { panic!() };
    assert_eq!([attitude.q1, attitude.q2, attitude.q3, attitude.q4], [0.5, -0.5, 0.5, -0.5]);
    assert_eq!([attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed], [0.1, 0.2, 0.3]);
    assert_eq!(attitude.repr_offset_q, [1.0, 0.0, 0.0, 0.25]);

    let MavMessage::COMMAND_LONG(command) = nth(7) else { panic!() };
    assert_eq!((command.target_system, command.target_component), (7, 1));
    assert_eq!((command.command, command.confirmation, command.param1, command.param2), (511, 2, 32.0, 20000.0));

    let MavMessage::COMMAND_ACK(ack) = nth(8) else { panic!() };
    assert_eq!((ack.command, ack.result, ack.progress, ack.result_param2), (400, 2, 50, -3));
    assert_eq!((ack.target_system, ack.target_component), (255, 190));

    let MavMessage::OBSTACLE_DISTANCE(obstacles) = nth(14) else { panic!() };
    assert_eq!((obstacles.increment, obstacles.min_distance, obstacles.max_distance), (5, 20, 4000));
    assert_eq!((obstacles.increment_f, obstacles.angle_offset, obstacles.frame), (-5.0, 12.5, 12));
    assert_eq!((obstacles.distances[0], obstacles.distances[71]), (7, 7107));
    let MavMessage::OBSTACLE_DISTANCE(obstacles) = nth(15) else { panic!() };
    assert_eq!((obstacles.increment_f, obstacles.angle_offset, obstacles.frame), (0.0, 0.0, 0));

    let MavMessage::STATUSTEXT(text) = nth(13) else { panic!() };
    assert_eq!((text.severity, text.id, text.chunk_seq), (4, 513, 3));
    assert_eq!(text.text.to_str().unwrap(), "x".repeat(50));
}

#[test]
fn an_unknown_enum_value_does_not_lose_the_message() {
    let strange = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: 251,
        autopilot: 252,
        base_mode: 253,
        system_status: 254,
        ..HEARTBEAT_DATA::DEFAULT
    });
    let mut bytes = [0; FRAME_MAX];
    let length = encode(Header::default(), &strange, &mut bytes);
    let mut framer = Framer::new();
    framer.push(&bytes[..length]);
    assert_eq!(framer.next_frame().unwrap().message(), Some(strange));
}
