//! A companion on the bench: a test plays its autopilot, moves its clock and reads what it sends.

use foxhound_core::base::ned::Ned;
use foxhound_core::base::time::Instant;
use foxhound_core::control::guard::{Action, Setpoint};
use foxhound_core::doa::bearing::{Bearing, Flags, Quality};
use foxhound_core::guidance::Output;
use foxhound_core::guidance::mission::Outcome;
use foxhound_core::mapping::scan::{Points, Scan};
use foxhound_link::companion::{Companion, Config};
use foxhound_link::dialect::*;
use foxhound_link::framer::{FRAME_MAX, Frame, Framer, Header, encode};

pub(crate) const QUADROTOR: u8 = 2;
pub(crate) const ARDUPILOT: u8 = 3;
pub(crate) const PX4: u8 = 12;
pub(crate) const GUIDED: u32 = 4;
pub(crate) const OFFBOARD: u32 = 6 << 16;
pub(crate) const ARMED: u8 = 0x89;
pub(crate) const DISARMED: u8 = 0x09;

/// The autopilot's address unless a test says otherwise.
pub(crate) const AUTOPILOT: (u8, u8) = (1, 1);

pub(crate) struct Sent {
    pub(crate) at_us: u64,
    pub(crate) header: Header,
    pub(crate) message: MavMessage,
}

pub(crate) struct Bench {
    pub(crate) companion: Companion,
    pub(crate) now_us: u64,
    pub(crate) sent: Vec<Sent>,
    /// Repeated once a second when set.
    pub(crate) heartbeat: Option<HEARTBEAT_DATA>,
    /// Published at every step when set.
    pub(crate) output: Option<Output>,
    /// Whether the autopilot acknowledges what it is asked for.
    pub(crate) answers: bool,
    pub(crate) next_heartbeat_us: u64,
    sequence: u8,
    expected_sequence: u8,
    framer: Framer,
}

impl Bench {
    pub(crate) fn new(config: Config) -> Self {
        Self {
            companion: config.build().unwrap(),
            now_us: 10_000_000,
            sent: Vec::new(),
            heartbeat: None,
            output: None,
            answers: false,
            next_heartbeat_us: 0,
            sequence: 0,
            expected_sequence: 0,
            framer: Framer::new(),
        }
    }

    /// In GUIDED, armed, with a setpoint published at every step.
    pub(crate) fn flying() -> Self {
        let mut bench = Self::new(Config::default());
        bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
        bench.output = Some(output([1.0, -0.5, -0.25], 0.125));
        bench
    }

    pub(crate) fn now(&self) -> Instant {
        Instant(self.now_us)
    }

    pub(crate) fn say_as(&mut self, (system_id, component_id): (u8, u8), message: &MavMessage) {
        let header = Header { system_id, component_id, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
        let mut bytes = [0; FRAME_MAX];
        let length = encode(header, message, &mut bytes);
        self.companion.receive(Instant(self.now_us), &bytes[..length]);
    }

    pub(crate) fn say(&mut self, message: &MavMessage) {
        self.say_as(AUTOPILOT, message);
    }

    /// Lets time pass in steps of 10 ms and collects what is sent.
    pub(crate) fn run(&mut self, seconds: f64) {
        let end_us = self.now_us + (seconds * 1e6).round() as u64;
        while self.now_us < end_us {
            self.step(10_000);
        }
    }

    pub(crate) fn step(&mut self, micros: u64) {
        self.now_us += micros;
        if let Some(heartbeat) = self.heartbeat.clone()
            && self.now_us >= self.next_heartbeat_us
        {
            self.next_heartbeat_us = self.now_us + 1_000_000;
            self.say(&MavMessage::HEARTBEAT(heartbeat));
        }
        if let Some(output) = &self.output {
            self.companion.publish(Instant(self.now_us), output);
        }
        self.companion.poll(Instant(self.now_us));
        self.drain();
        self.answer();
    }

    /// Acknowledges what was asked for in this step.
    fn answer(&mut self) {
        let now_us = self.now_us;
        let of_now = self.sent.iter().rev().take_while(|sent| sent.at_us == now_us);
        let asked = of_now.filter(|sent| matches!(sent.message, MavMessage::COMMAND_LONG(_))).count();
        (0..if self.answers { asked } else { 0 }).for_each(|_| self.say(&ack(511, 0)));
    }

    /// Reads everything that waits to be sent.
    pub(crate) fn drain(&mut self) {
        let mut bytes = [0; 64];
        loop {
            let length = self.companion.transmit(&mut bytes);
            if length == 0 {
                break;
            }
            assert_eq!(self.framer.push(&bytes[..length]), length);
            while let Some(frame) = self.framer.next_frame() {
                let message = frame.message().expect("we send only what we know");
                assert_eq!(frame.header.sequence, self.expected_sequence, "they count up in the order of sending");
                self.expected_sequence = self.expected_sequence.wrapping_add(1);
                self.sent.push(Sent { at_us: self.now_us, header: frame.header, message });
            }
        }
        assert_eq!(self.framer.counters().skipped_bytes, 0, "every byte belongs to a frame");
    }

    /// Scan and points, as a step of the flight takes them.
    pub(crate) fn take_obstacles(&mut self) -> (Option<Scan>, Option<Points>) {
        let taken = (self.companion.scan().cloned(), self.companion.points().cloned());
        self.companion.drop_obstacles();
        taken
    }

    pub(crate) fn take_scan(&mut self) -> Option<Scan> {
        self.take_obstacles().0
    }

    pub(crate) fn take_points(&mut self) -> Option<Points> {
        self.take_obstacles().1
    }

    /// What was sent since the last look.
    pub(crate) fn take_sent(&mut self) -> Vec<Sent> {
        std::mem::take(&mut self.sent)
    }

    pub(crate) fn setpoints(&mut self) -> Vec<(u64, SET_POSITION_TARGET_LOCAL_NED_DATA)> {
        let pick = |sent: Sent| match sent.message {
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(setpoint) => Some((sent.at_us, setpoint)),
            _ => None,
        };
        self.take_sent().into_iter().filter_map(pick).collect()
    }

    pub(crate) fn commands(&mut self) -> Vec<(u64, COMMAND_LONG_DATA)> {
        let pick = |sent: Sent| match sent.message {
            MavMessage::COMMAND_LONG(command) => Some((sent.at_us, command)),
            _ => None,
        };
        self.take_sent().into_iter().filter_map(pick).collect()
    }
}

/// Reads a stream that comes in pieces.
pub(crate) fn read(stream: &[u8], chunk: usize, mut each: impl FnMut(&Frame<'_>)) -> Framer {
    let mut framer = Framer::new();
    for piece in stream.chunks(chunk) {
        framer.each(piece, |frame| each(&frame));
    }
    framer
}

pub(crate) fn heartbeat(autopilot: u8, custom_mode: u32, base_mode: u8) -> HEARTBEAT_DATA {
    HEARTBEAT_DATA {
        mavtype: QUADROTOR,
        autopilot,
        custom_mode,
        base_mode,
        system_status: 4,
        ..HEARTBEAT_DATA::DEFAULT
    }
}

pub(crate) fn output([north, east, down]: [f32; 3], yaw_rate_radps: f32) -> Output {
    Output {
        time: Instant(0),
        outcome: Outcome::Nominal,
        stale: None,
        setpoint: Setpoint { velocity_ned_mps: Ned { north, east, down }, yaw_rate_radps },
        bearing: None,
        bearing_ned_rad: None,
        source_bearing_ned_rad: None,
        target_ned_m: None,
        source: None,
        source_share_and_nis: None,
        landing: None,
        guard: Action::Passed,
        guard_counts: foxhound_core::control::guard::Counts::default(),
        plan_requested: false,
        trace_hash: 0,
    }
}

pub(crate) fn velocity(setpoint: &SET_POSITION_TARGET_LOCAL_NED_DATA) -> [f32; 4] {
    [setpoint.vx, setpoint.vy, setpoint.vz, setpoint.yaw_rate]
}

pub(crate) const ZERO: [f32; 4] = [0.0; 4];

pub(crate) fn position(time_boot_ms: u32) -> MavMessage {
    MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
        time_boot_ms,
        x: 1.0,
        y: 2.0,
        z: -3.0,
        vx: 0.1,
        vy: 0.2,
        vz: 0.3,
    })
}

pub(crate) fn attitude(time_boot_ms: u32, yaw: f32) -> MavMessage {
    MavMessage::ATTITUDE(ATTITUDE_DATA { time_boot_ms, yaw, ..ATTITUDE_DATA::DEFAULT })
}

pub(crate) fn extended(landed_state: u8) -> MavMessage {
    MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA { vtol_state: 0, landed_state })
}

pub(crate) fn ack(command: u16, result: u8) -> MavMessage {
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { command, result, ..COMMAND_ACK_DATA::DEFAULT })
}

pub(crate) fn bearing() -> Bearing {
    Bearing {
        time: Instant(0),
        valid: true,
        azimuth_rad: 0.0,
        sigma_rad: 0.1,
        elevation_rad: 0.2,
        elevation_sigma_rad: 0.1,
        quality: Quality { snr_db: 14.5, ..Quality::default() },
        flags: Flags(0),
    }
}

pub(crate) fn texts(bench: &mut Bench) -> Vec<(u64, String)> {
    let pick = |sent: Sent| match sent.message {
        MavMessage::STATUSTEXT(text) => Some((sent.at_us, text.text.to_str().unwrap().to_owned())),
        _ => None,
    };
    bench.take_sent().into_iter().filter_map(pick).collect()
}
