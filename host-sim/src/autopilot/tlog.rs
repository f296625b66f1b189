//! Telemetry logs: MAVLink frames, each with the time of its transmission, as ground stations write them.
//!
//! A record is 8 bytes of big-endian microseconds and one frame. Frames of MAVLink 1 are read as well: an autopilot
//! may begin with those, and a ground station writes everything that it receives.

use std::collections::BTreeMap;
use std::path::Path;

use foxhound_link::framer::{Framer, MavlinkVersion};
use foxhound_link::signing::is_secret;
use serde::Serialize;

use crate::scenario::input::InputError;
use crate::scenario::output::Output;

/// Writes a log.
#[derive(Debug)]
pub struct Writer {
    file: Output,
    framers: [Framer; 2],
    /// The first error; nothing is written after it.
    failed: Option<InputError>,
}

/// Direction of the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the autopilot to the companion.
    ToCompanion = 0,
    /// From the companion to the autopilot.
    ToAutopilot = 1,
}

impl Writer {
    /// Starts a log.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(path: &Path) -> Result<Self, InputError> {
        Ok(Self { file: Output::create(path)?, framers: [Framer::new(), Framer::new()], failed: None })
    }

    /// Takes bytes of one direction; whole frames are written as they complete, except those that carry a key.
    ///
    /// # Errors
    /// The file cannot be written; [`finish`](Self::finish) says so once more.
    pub fn bytes(&mut self, time_us: u64, direction: Direction, mut bytes: &[u8]) -> Result<(), InputError> {
        if let Some(error) = &self.failed {
            return Err(error.clone());
        }
        let framer = &mut self.framers[direction as usize];
        while !bytes.is_empty() {
            bytes = &bytes[framer.push(bytes)..];
            while let Some(frame) = framer.next_frame() {
                if is_secret(frame.message_id) {
                    continue;
                }
                let put = self.file.put(&time_us.to_be_bytes()).and_then(|()| self.file.put(frame.bytes));
                if let Err(error) = put {
                    self.failed = Some(error.clone());
                    return Err(error);
                }
            }
        }
        Ok(())
    }

    /// Ends the log.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(self) -> Result<(), InputError> {
        self.failed.map_or(Ok(()), Err)?;
        self.file.finish()
    }
}

/// Content of a log.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// Frames whose checksum is right.
    pub frames: u64,
    /// Frames whose checksum is wrong.
    pub bad_crc: u64,
    /// Bytes outside frames and time stamps.
    pub skipped_bytes: u64,
    /// Those of `frames` that are of MAVLink 1.
    #[serde(skip_serializing_if = "is_zero")]
    pub mavlink_1: u64,
    /// Frames per message id.
    pub counts: BTreeMap<u32, u64>,
    /// Names of these message ids, if they have one.
    pub names: BTreeMap<u32, &'static str>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
const fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// Number and name of every message of MAVLink's ArduPilot dialect, as of pymavlink 2.4.50.
const NAMES: &str = include_str!("messages.txt");

/// The name of a message; `None` if the dialect has no message of this number.
#[must_use]
pub fn name(message_id: u32) -> Option<&'static str> {
    NAMES.lines().find_map(|line| {
        let (id, name) = line.split_once(' ')?;
        (id.parse() == Ok(message_id)).then_some(name)
    })
}

const STAMP_BYTES: usize = 8;
const MAGIC: u8 = 0xFD;
const MAGIC_1: u8 = 0xFE;
/// Fewer frames of MAVLink 1 in a stream may be chance.
const MAVLINK_1_MIN: u64 = 3;

/// Counts the frames of a plain byte stream; those of MAVLink 1 only if there are more than chance makes of noise.
#[must_use]
pub fn read_raw(bytes: &[u8]) -> Summary {
    let both = read_versions(bytes, true);
    named(if both.mavlink_1 < MAVLINK_1_MIN { read_versions(bytes, false) } else { both })
}

/// With the names of its messages.
fn named(mut summary: Summary) -> Summary {
    summary.names = summary.counts.keys().filter_map(|id| Some((*id, name(*id)?))).collect();
    summary
}

fn read_versions(bytes: &[u8], accept_v1: bool) -> Summary {
    let mut framer = Framer::new();
    framer.accept_v1(accept_v1);
    let mut summary = Summary::default();
    framer.each(bytes, |frame| {
        summary.frames += 1;
        summary.mavlink_1 += u64::from(frame.version == MavlinkVersion::V1);
        *summary.counts.entry(frame.message_id).or_default() += 1;
    });
    summary.bad_crc = u64::from(framer.counters().bad_crc);
    summary.skipped_bytes = u64::from(framer.counters().skipped_bytes);
    summary
}

/// Counts the frames of a log with time stamps, which are not skipped bytes.
///
/// A record is valid while a frame with a right checksum follows its time stamp. Elsewhere bytes are skipped one by
/// one until that is true again, as in the framer.
#[must_use]
pub fn read_stamped(bytes: &[u8]) -> Summary {
    named(count_stamped(bytes))
}

fn count_stamped(bytes: &[u8]) -> Summary {
    let mut summary = Summary::default();
    let mut at = 0;
    while let Some(record) = bytes.get(at + STAMP_BYTES..).filter(|record| !record.is_empty()) {
        match whole_frame(record) {
            Frame::Whole { length, message_id } => {
                summary.frames += 1;
                summary.mavlink_1 += u64::from(record[0] == MAGIC_1);
                *summary.counts.entry(message_id).or_default() += 1;
                at += STAMP_BYTES + length;
            }
            // Cut off by the end of the log.
            Frame::Cut => return summary,
            Frame::Damaged { length } if starts_record(&bytes[(at + STAMP_BYTES + length).min(bytes.len())..]) => {
                // The next record is where this one's length says: its stamp is valid, its frame is damaged.
                summary.bad_crc += 1;
                summary.skipped_bytes += length as u64;
                at += STAMP_BYTES + length;
            }
            Frame::Damaged { .. } => {
                summary.bad_crc += 1;
                summary.skipped_bytes += 1;
                at += 1;
            }
            Frame::None => {
                summary.skipped_bytes += 1;
                at += 1;
            }
        }
    }
    // Fewer bytes than a time stamp: cut inside the last record.
    summary
}

enum Frame {
    Whole { length: usize, message_id: u32 },
    Damaged { length: usize },
    Cut,
    None,
}

fn starts_record(bytes: &[u8]) -> bool {
    bytes.len() <= STAMP_BYTES || [MAGIC, MAGIC_1].contains(&bytes[STAMP_BYTES])
}

/// The frame at the start of `bytes`.
fn whole_frame(bytes: &[u8]) -> Frame {
    let (Some(payload), Some(flags)) = (bytes.get(1), bytes.get(2)) else {
        return if [MAGIC, MAGIC_1].contains(&bytes[0]) { Frame::Cut } else { Frame::None };
    };
    let length = usize::from(*payload)
        + match bytes[0] {
            MAGIC_1 => 8,
            MAGIC if *flags == 0 => 12,
            MAGIC if *flags == 1 => 25,
            _ => return Frame::None,
        };
    let Some(candidate) = bytes.get(..length) else { return Frame::Cut };
    let mut framer = Framer::new();
    framer.accept_v1(bytes[0] == MAGIC_1);
    framer.push(candidate);
    match framer.next_frame() {
        Some(frame) if frame.bytes.len() == length => Frame::Whole { length, message_id: frame.message_id },
        _ => Frame::Damaged { length },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_link::dialect::{ATTITUDE_DATA, HEARTBEAT_DATA, SETUP_SIGNING_DATA};
    use foxhound_link::framer::{FRAME_MAX, Header, encode_data};

    fn frames() -> [Vec<u8>; 2] {
        let header = Header { system_id: 1, component_id: 1, sequence: 0 };
        let mut heartbeat = vec![0; FRAME_MAX];
        let length = encode_data(header, &HEARTBEAT_DATA::default(), &mut heartbeat);
        heartbeat.truncate(length);
        let mut attitude = vec![0; FRAME_MAX];
        let length = encode_data(header, &ATTITUDE_DATA { yaw: 1.5, ..ATTITUDE_DATA::default() }, &mut attitude);
        attitude.truncate(length);
        [heartbeat, attitude]
    }

    /// A log whose time stamps hold the frames' magic byte.
    fn log() -> Vec<u8> {
        let [heartbeat, attitude] = frames();
        let stamp = 0x0000_FDFD_0000_FD01_u64.to_be_bytes();
        [&stamp[..], &heartbeat, &stamp, &attitude, &stamp, &attitude].concat()
    }

    #[test]
    fn a_clean_log_has_no_skipped_bytes() {
        let summary = read_stamped(&log());
        assert_eq!((summary.frames, summary.bad_crc, summary.skipped_bytes), (3, 0, 0));
        assert_eq!(summary.counts, BTreeMap::from([(0, 1), (30, 2)]));
        let json = serde_json::to_string(&summary).unwrap();
        assert_eq!(
            json,
            r#"{"frames":3,"bad_crc":0,"skipped_bytes":0,"counts":{"0":1,"30":2},"names":{"0":"HEARTBEAT","30":"ATTITUDE"}}"#
        );
    }

    #[test]
    fn a_log_cut_anywhere_in_its_last_record_is_fine() {
        let log = log();
        let last = frames()[1].len() + STAMP_BYTES;
        for cut in 1..last {
            let summary = read_stamped(&log[..log.len() - cut]);
            assert_eq!((summary.frames, summary.bad_crc, summary.skipped_bytes), (2, 0, 0), "{cut} bytes missing");
        }
        assert_eq!(read_stamped(&[]), Summary::default());
    }

    /// A heartbeat of MAVLink 1, as pymavlink packs it.
    const OLD: [u8; 17] = [254, 9, 5, 1, 1, 0, 0, 0, 0, 0, 2, 3, 81, 4, 3, 46, 80];

    #[test]
    fn frames_of_mavlink_1_are_read_among_those_of_mavlink_2() {
        let [heartbeat, _] = frames();
        let stamp = 0x0000_FEFE_0000_FD01_u64.to_be_bytes();
        let log = [&stamp[..], &OLD, &stamp, &heartbeat, &stamp, &OLD, &stamp, &OLD].concat();
        let summary = read_stamped(&log);
        assert_eq!((summary.frames, summary.mavlink_1, summary.bad_crc, summary.skipped_bytes), (4, 3, 0, 0));
        let mut damaged = log.clone();
        damaged[STAMP_BYTES + 8] ^= 1;
        let summary = read_stamped(&damaged);
        assert_eq!((summary.frames, summary.mavlink_1, summary.bad_crc, summary.skipped_bytes), (3, 2, 1, 17));
        let stream = [&OLD[..], &heartbeat, &OLD, &OLD].concat();
        let summary = read_raw(&stream);
        assert_eq!((summary.frames, summary.mavlink_1, summary.skipped_bytes), (4, 3, 0));
        assert_eq!(read_raw(&[&OLD[..], &heartbeat].concat()).frames, 1, "one may be chance");
        for cut in 1..OLD.len() + STAMP_BYTES {
            assert_eq!(read_stamped(&log[..log.len() - cut]).frames, 3, "{cut} bytes missing");
        }
    }

    #[test]
    fn a_damaged_frame_is_counted_and_the_next_one_is_found() {
        let mut log = log();
        let payload_of_the_second = STAMP_BYTES + frames()[0].len() + STAMP_BYTES + 12;
        log[payload_of_the_second] ^= 0x40;
        let summary = read_stamped(&log);
        assert_eq!((summary.frames, summary.bad_crc), (2, 1));
        assert_eq!(summary.skipped_bytes, frames()[1].len() as u64);
    }

    #[test]
    fn messages_have_names_beside_their_numbers() {
        let all: Vec<u32> = NAMES.lines().map(|line| line.split_once(' ').unwrap().0.parse().unwrap()).collect();
        assert!(all.is_sorted() && all.len() > 300);
        let [heartbeat, attitude] = frames();
        let summary = read_raw(&[&heartbeat[..], &attitude].concat());
        assert_eq!(summary.names, BTreeMap::from([(0, "HEARTBEAT"), (30, "ATTITUDE")]));
        assert_eq!((name(84), name(16_000_000)), (Some("SET_POSITION_TARGET_LOCAL_NED"), None));
    }

    #[test]
    fn bytes_in_between_are_skipped() {
        let [heartbeat, attitude] = frames();
        let stream = [&[1, 2, 3][..], &heartbeat, &[9; 5], &attitude].concat();
        let summary = read_raw(&stream);
        assert_eq!((summary.frames, summary.skipped_bytes), (2, 8));
        let stamp = 77_u64.to_be_bytes();
        let stamped = [&stamp[..], &heartbeat, &[9; 5], &stamp, &attitude].concat();
        let summary = read_stamped(&stamped);
        assert_eq!((summary.frames, summary.skipped_bytes), (2, 5));
    }

    #[test]
    fn frames_split_between_writes_come_out_whole_with_their_time_and_keys_do_not() {
        let path = std::env::temp_dir().join(format!("foxhound-tlog-test-{}.tlog", std::process::id()));
        let [heartbeat, attitude] = frames();
        let mut writer = Writer::create(&path).unwrap();
        writer.bytes(1, Direction::ToCompanion, &heartbeat[..7]).unwrap();
        writer.bytes(2, Direction::ToAutopilot, &attitude).unwrap();
        writer.bytes(0x0102, Direction::ToCompanion, &heartbeat[7..]).unwrap();
        let header = Header { system_id: 255, component_id: 190, sequence: 0 };
        let mut secret = [0; FRAME_MAX];
        let length =
            encode_data(header, &SETUP_SIGNING_DATA { secret_key: [7; 32], ..Default::default() }, &mut secret);
        writer.bytes(4, Direction::ToCompanion, &secret[..length]).unwrap();
        writer.finish().unwrap();
        let written = std::fs::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let expected = [&2_u64.to_be_bytes()[..], &attitude, &[0, 0, 0, 0, 0, 0, 1, 2], &heartbeat].concat();
        assert_eq!(written, expected);
    }
}
