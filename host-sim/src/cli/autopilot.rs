//! `foxhound autopilot`: a modelled autopilot and its vehicle, in real time, for trials without a real one.

use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::time::Duration;

use clap::{Args, ValueEnum};
use foxhound_link::dialect::{MavMessage, MavType};
use foxhound_link::framer::Framer;
use foxhound_sim::autopilot::transport::{Line, Listen};
use foxhound_sim::autopilot::{Autopilot, Start, Wire, asks_for_entry};
use foxhound_sim::drive::companion::Pace;
use foxhound_sim::scenario::input::{InputError, MAX_TIME_S, check, check_within};
use foxhound_sim::scenario::{self, Software, VehicleModel};
use foxhound_sim::world::Pose;
use foxhound_sim::world::vehicle::Vehicle;
use serde::Serialize;

use super::companion::triple;
use super::terminal::{say, stop_flag};
use super::value::number;
use super::{Cli, json_line};

const AUTOPILOT_HELP: &str = "Examples:
  foxhound autopilot --listen tcp:127.0.0.1:5760
  foxhound autopilot --listen pty --software px4 --begin hovering
  foxhound companion --autopilot tcp:127.0.0.1:5760 --source 8,0,-5

It begins armed, in the air, in LOITER or Hold. Its pilot gives control (GUIDED, OFFBOARD) 2 s after a companion is heard, and \
takes it back when none is heard any more; a ground station may change the mode, arm and take off as usual. It obeys the setpoints that `foxhound companion` sends, velocities of \
LOCAL_NED with a yaw rate or a yaw, and no other frame or type mask. It ends with Ctrl-C. With --json the first line has the address for \
`companion --autopilot`, the last one where the vehicle ended and which setpoints it received.";

/// Physics go on in steps of this length.
const STEP_US: u64 = 10_000;
/// After a stall of the machine longer than this, the lost time is not made up.
const STALL_MAX_US: u64 = 1_000_000;
/// As in `fly`.
const A_MAX_MPS2: f64 = 2.0;

/// From one attempt to enter the companion's mode to the next.
const PILOT_PERIOD_US: u64 = 500_000;
/// The pilot gives control so long after a companion is heard: by then it knows that it is not in control.
const GIVES_AFTER_US: u64 = 2_000_000;
/// A companion that has been silent for so long is gone.
const SILENT_US: u64 = 3_000_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Begin {
    /// In the air; the pilot gives control to every companion that is heard.
    InControl,
    /// In the air, in LOITER or Hold.
    Hovering,
    /// Disarmed on the ground.
    Parked,
}

#[derive(Args, Debug)]
#[command(after_help = AUTOPILOT_HELP)]
pub(super) struct AutopilotCommand {
    /// Address to serve: tcp:HOST:PORT, udp:HOST:PORT (port 0: any free one) or pty. Serves one companion after
    /// another.
    #[arg(long, value_name = "ADDRESS")]
    listen: Listen,
    /// Software of the autopilot.
    #[arg(long, value_enum, default_value_t = Software::ArduCopter)]
    software: Software,
    /// State at the start.
    #[arg(long, value_enum, default_value_t = Begin::InControl)]
    begin: Begin,
    /// Start of the vehicle: north, east and altitude, in metres; on the ground the altitude is zero.
    #[arg(long, value_name = "N,E,ALT", value_parser = triple, allow_hyphen_values = true, default_value = "0,0,5")]
    start: [f64; 3],
    /// Damages this share of the bytes in both directions, as a bad line does.
    #[arg(long, value_name = "SEED:RATE", value_parser = noise)]
    noise: Option<(u64, f64)>,
    /// Ends after this many seconds [default: never].
    #[arg(long, value_name = "S", value_parser = number(MAX_TIME_S))]
    max_time: Option<f64>,
}

fn noise(text: &str) -> Result<(u64, f64), String> {
    let parsed = text.split_once(':').and_then(|(seed, rate)| Some((seed.parse().ok()?, rate.parse().ok()?)));
    let (seed, rate) = parsed.ok_or("expected SEED:RATE, as in 7:0.001")?;
    if (0.0..=1.0).contains(&rate) { Ok((seed, rate)) } else { Err(format!("rate {rate} is outside 0..=1")) }
}

/// The first line with `--json`.
#[derive(Serialize)]
struct Listening {
    autopilot: String,
}

/// The last line with `--json`: what the vehicle did and which setpoints it received.
#[derive(Default, Serialize)]
struct Ended {
    time_s: f64,
    position_ned_m: [f64; 3],
    speed_mps: f64,
    heartbeats: u32,
    setpoints: u32,
    fastest_setpoint_mps: f32,
    last_setpoint_mps: Option<[f32; 3]>,
}

/// What the pilot notices of a companion.
#[derive(Clone, Copy, Default)]
struct Noticed {
    /// Its heartbeat.
    is_heard: bool,
    /// It asks for the mode to be left and entered again.
    asks_again: bool,
}

impl Ended {
    fn watch(&mut self, framer: &mut Framer, bytes: &[u8]) -> Noticed {
        let mut noticed = Noticed::default();
        framer.each(bytes, |frame| match frame.message() {
            Some(MavMessage::HEARTBEAT(heartbeat)) => {
                self.heartbeats += 1;
                noticed.is_heard |= heartbeat.mavtype == MavType::MAV_TYPE_ONBOARD_CONTROLLER as u8;
            }
            Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(target)) => {
                self.setpoints += 1;
                self.fastest_setpoint_mps = self.fastest_setpoint_mps.max(libm::hypotf(target.vx, target.vy));
                self.last_setpoint_mps = Some([target.vx, target.vy, target.vz]);
            }
            Some(MavMessage::STATUSTEXT(text)) => {
                noticed.asks_again |= asks_for_entry(&text);
            }
            _ => {}
        });
        noticed
    }
}

/// Gives control to a companion once it is heard, takes it back when it is gone, and gives it anew where that is asked for.
#[derive(Default)]
struct Pilot {
    heard_us: Option<u64>,
    gives_us: Option<u64>,
}

impl Pilot {
    fn act(&mut self, now_us: u64, noticed: Noticed, is_open: bool, autopilot: &mut Autopilot, hover_mode: u32) {
        if noticed.is_heard && self.heard_us.replace(now_us).is_none() {
            self.gives_us = Some(now_us + GIVES_AFTER_US);
        }
        if self.heard_us.is_some_and(|heard_us| !is_open || now_us > heard_us + SILENT_US) {
            *self = Self::default();
            if autopilot.custom_mode == autopilot.companion_mode() {
                autopilot.select_mode(now_us, hover_mode);
            }
        } else if noticed.asks_again {
            autopilot.select_mode(now_us, hover_mode);
            self.gives_us = Some(now_us + GIVES_AFTER_US);
        }
        if self.gives_us.is_some_and(|gives_us| now_us >= gives_us) {
            let is_given = autopilot.select_mode(now_us, autopilot.companion_mode());
            self.gives_us = (!is_given).then_some(now_us + PILOT_PERIOD_US);
        }
    }
}

pub(super) fn autopilot(cli: &Cli, args: &AutopilotCommand) -> Result<ExitCode, InputError> {
    for (axis, value) in ["N", "E", "ALT"].into_iter().zip(args.start) {
        // An altitude is up: a negative one is a down coordinate by mistake.
        let least = if axis == "ALT" { 0.0 } else { -10_000.0 };
        check(&format!("--start: {axis}"), value, least, 10_000.0)?;
    }
    if let Some(max_time_s) = args.max_time {
        check_within("--max-time", max_time_s, &MAX_TIME_S)?;
    }
    let (mut line, address) =
        Line::listen(&args.listen).map_err(|error| InputError::new(format!("--listen: {error}")))?;
    let stop = stop_flag()?;
    say(&if cli.json {
        json_line(&Listening { autopilot: address.to_string() })?
    } else {
        format!("fly it with: foxhound companion --autopilot {address} --source N,E,D\n")
    });

    let [north, east, altitude] = args.start;
    let altitude = if args.begin == Begin::Parked { 0.0 } else { altitude };
    let pose = Pose { position_ned_m: [north, east, -altitude], ..Pose::default() };
    let begin = if args.begin == Begin::Parked { Start::Parked } else { Start::Hovering };
    let mut autopilot = Autopilot::new(args.software, begin);
    let hover_mode = autopilot.custom_mode;
    let mut pilot = (args.begin == Begin::InControl).then(Pilot::default);
    let model =
        scenario::Vehicle { model: VehicleModel::Arducopter, autopilot: args.software, ..scenario::Vehicle::default() };
    let mut vehicle = Vehicle::new(model, A_MAX_MPS2, pose);
    let (seed, rate) = args.noise.unwrap_or_default();
    let mut wire = Wire::new(seed, 0.0, rate);
    let (mut framer, mut ended) = (Framer::new(), Ended::default());
    let mut pace = Pace::new(Duration::from_micros(STEP_US));
    let mut flown_us = 0;
    while !stop.load(Ordering::Relaxed) && args.max_time.is_none_or(|limit_s| ended.time_s < limit_s) {
        let now_us = pace.wait().0;
        ended.time_s = now_us as f64 * 1e-6;
        let rx = wire.to_autopilot(&line.read());
        let noticed = ended.watch(&mut framer, &rx);
        autopilot.receive(now_us, &vehicle.motion, &rx);
        if let Some(pilot) = &mut pilot {
            pilot.act(now_us, noticed, line.is_open(), &mut autopilot, hover_mode);
        }
        flown_us = flown_us.max(now_us.saturating_sub(STALL_MAX_US));
        while flown_us + STEP_US <= now_us {
            vehicle.step(autopilot.command(now_us), STEP_US as f64 * 1e-6);
            flown_us += STEP_US;
        }
        autopilot.telemetry(now_us, &vehicle.motion, false);
        let tx = wire.to_companion(&autopilot.transmit());
        if line.is_open() {
            line.write(&tx);
        }
    }
    let [north_mps, east_mps, _] = vehicle.motion.velocity_ned_mps;
    ended.position_ned_m = vehicle.motion.pose.position_ned_m;
    ended.speed_mps = libm::hypot(north_mps, east_mps);
    if cli.json {
        say(&json_line(&ended)?);
    }
    Ok(ExitCode::SUCCESS)
}
