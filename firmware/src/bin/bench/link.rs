//! The rows of the serial lines: the cost of receiving from a full one, of the autopilot and of a lidar.

use core::hint::black_box;

use crate::halt;
use foxhound_computer::lidar::{self, FRAME_BYTES, crc8};
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::param::Values;
use foxhound_link::companion::Config;
use foxhound_link::dialect::{
    ATTITUDE_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, OBSTACLE_DISTANCE_DATA, SYS_STATUS_DATA,
};
use foxhound_link::framer::{FRAME_MAX, Header, encode_data};
use foxhound_link::{MessageData, companion::Companion};

use crate::row;

/// What 921 600 baud carry in a step of 20 ms.
const STEP_BYTES: usize = 1843;
const STEPS_PER_S: u64 = 50;
/// 5 % of the core: 170 MHz at 1.5 cycles an instruction.
const CEILING: u32 = 5_667_000;

/// Frames that 230 400 baud carry in a step: 9.8.
const LIDAR_FRAMES: usize = 10;
const LIDAR_CEILING: u32 = 60_000;

/// A second of a line that carries nothing but telemetry which we read, as close as it comes.
pub fn rows(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let Ok(mut companion) = Config::default().build_with(Values::DEFAULT) else {
        halt(format_args!("the link does not build"));
    };
    let mut stream = Stream { bytes: [0; STEP_BYTES], length: 0, sequence: 0 };
    let mut sum = 0;
    for step in 0..STEPS_PER_S {
        stream.fill(step as u32 * 20);
        let now = Instant(step * 20_000);
        sum += measure(&mut || companion.receive(now, black_box(&stream.bytes)));
        leave(&mut companion);
    }
    if companion.counters().framer.frames < 1000 {
        halt(format_args!("the link has not heard what was said"));
    }
    row("link_full_line_second", sum, CEILING);
    row("lidar_full_line_step", full_lidar(measure), LIDAR_CEILING);
}

/// The worst of the steps in which a lidar's line carries frame after frame, through several turns.
#[inline(never)]
fn full_lidar(measure: &impl Fn(&mut dyn FnMut()) -> u32) -> u32 {
    let Ok(mut lidar) = lidar::Config::default().build() else {
        halt(format_args!("the lidar does not build"));
    };
    let (mut worst, mut number) = (0, 0);
    for step in 0..STEPS_PER_S {
        let mut bytes = [[0; FRAME_BYTES]; LIDAR_FRAMES];
        for frame in &mut bytes {
            *frame = lidar_frame(number);
            number += 1;
        }
        let now = Instant(step * 20_000);
        worst = worst.max(measure(&mut || lidar.push(now, black_box(bytes.as_flattened()))));
        lidar.take();
    }
    if lidar.counters().frames != number || lidar.counters().turns < 10 {
        halt(format_args!("the lidar was not heard"));
    }
    worst
}

/// Twelve points, 0.8 degrees apart, at ten turns a second.
fn lidar_frame(number: u32) -> [u8; FRAME_BYTES] {
    let mut frame = [100; FRAME_BYTES];
    let angle = |point: u32| ((number * 12 + point) * 80 % 36_000) as u16;
    for (at, word) in [(0, 0x2C54), (2, 3_600), (4, angle(0)), (FRAME_BYTES - 5, angle(11))] {
        for (to, from) in frame.iter_mut().skip(at).zip(word.to_le_bytes()) {
            *to = from;
        }
    }
    let (body, check) = frame.split_at_mut(FRAME_BYTES - 1);
    check.fill(crc8(body));
    frame
}

/// Guidance takes the data in its step.
fn leave(companion: &mut Companion) {
    black_box((companion.scan(), companion.points()));
    companion.drop_obstacles();
}

/// Frames in sequence, cut where a step ends.
struct Stream {
    bytes: [u8; STEP_BYTES],
    length: usize,
    sequence: u8,
}

impl Stream {
    fn fill(&mut self, time_boot_ms: u32) {
        self.length = 0;
        self.say(&HEARTBEAT_DATA {
            autopilot: 3,
            mavtype: 2,
            base_mode: 129,
            custom_mode: 4,
            ..HEARTBEAT_DATA::DEFAULT
        });
        self.say(&OBSTACLE_DISTANCE_DATA { distances: [250; 72], increment: 5, ..OBSTACLE_DISTANCE_DATA::DEFAULT });
        while self.length < STEP_BYTES {
            self.say(&ATTITUDE_DATA {
                time_boot_ms,
                roll: 0.1,
                pitch: 0.2,
                yaw: 0.3,
                rollspeed: 0.1,
                ..ATTITUDE_DATA::DEFAULT
            });
            self.say(&LOCAL_POSITION_NED_DATA { time_boot_ms, x: 1.0, y: 2.0, z: -5.0, vx: 0.5, vy: 0.5, vz: 0.1 });
            self.say(&SYS_STATUS_DATA { battery_remaining: 80, voltage_battery: 15_000, ..SYS_STATUS_DATA::DEFAULT });
        }
    }

    fn say<D: MessageData>(&mut self, data: &D) {
        let mut frame = [0; FRAME_MAX];
        let length = encode_data(Header { system_id: 1, component_id: 1, sequence: self.sequence }, data, &mut frame);
        self.sequence = self.sequence.wrapping_add(1);
        let room = self.bytes.get_mut(self.length..).unwrap_or_default();
        for (to, from) in room.iter_mut().zip(frame.iter().take(length)) {
            *to = *from;
        }
        self.length += length;
    }
}
