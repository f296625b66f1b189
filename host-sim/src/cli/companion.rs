//! `foxhound companion`: the whole system beside an autopilot, in real time.

use std::io::{self, IsTerminal as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::Args;
use foxhound_computer::twin::Setup;
use foxhound_core::base::time::Instant as Time;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::guidance;
use foxhound_core::planning::planner;
use foxhound_link::companion::Software;
use foxhound_sim::autopilot::transport::{Address, Line};
use foxhound_sim::drive::companion::{self, Bearings as _, Config, Ends, Eyes, News, Provider};
use foxhound_sim::drive::computer::{Computer, HostComputer};
use foxhound_sim::drive::qemu::QemuComputer;
use foxhound_sim::scenario::Sensor;
use foxhound_sim::scenario::input::{DRONE_RADIUS_M, InputError, MAX_TIME_S, SNR_DB, V_MAX_MPS, read_text};
use foxhound_sim::scenario::params::Given;
use indicatif::{ProgressBar, ProgressDrawTarget};

use super::fly::{Via, estimator_parser, exit_code, look, numbers, planner_parser, word};
use super::radio::RadioArgs;
use super::records::{RecordArgs, Written};
use super::terminal::{say, show_as, stop_flag, styled, warn};
use super::value::{check_apart, number};
use super::{Cli, check_writable, json_line};

const COMPANION_HELP: &str = "Examples:
  foxhound companion --autopilot tcp:127.0.0.1:5760 --source 8,-9,-5
  foxhound companion --autopilot udp:127.0.0.1:14550 --source=-8,-9,-5 \\
    --obstacles pillars.json --tlog flight.tlog
  foxhound companion --autopilot serial:/dev/ttyACM0:115200 --source 30,0,-10 \\
    --via qemu:firmware.elf

It waits for GUIDED (ArduPilot) or OFFBOARD (PX4), armed; it never changes the mode, arms or takes off. Leave the mode to \
take control away; enter it again to give it back. Started while the vehicle is in the mode, it holds until the mode is left \
and entered again. It ends within 1 m of the beacon (with FH_LND_MODE in a parameter file: when \
it has handed over or landed), or with Ctrl-C, at zero velocity.

Obstacles: what the autopilot and its system tell is always heard (DISTANCE_SENSOR, OBSTACLE_DISTANCE).
  --obstacles FILE       a simulated sensor sees these, too; JSON, vertical cylinders,
                         x east, y north, metres:
                         {\"obstacles\": [{\"x\": 3, \"y\": 4, \"r\": 0.3}]}
  --obstacles autopilot  nobody else: it holds while the autopilot tells nothing. For a
                         vehicle that really flies.
  --obstacles none       nobody: it moves only where a parameter file has FH_OBS_REQ 0,
                         and then blind
  (not given)            the autopilot, if it tells anything within 1.5 s or later;
                         else a simulated sensor sees an empty world
With --bearings a radio that runs is flown by, and nothing of the beacon is simulated (docs/hardware/radios.md):
  kraken:HOST[:PORT]    KrakenSDR: its DoA software's CSV over HTTP, port 8081
  heimdall:HOST[:PORT]  KrakenSDR: heimdall's samples over TCP, port 5000; needs --array
  hci:DEVICE:BAUD       a Bluetooth controller's IQ reports over serial; needs --array
  uudf:DEVICE:BAUD      u-blox +UUDF lines over serial
  udp:HOST:PORT         JSON lines that come to this port of ours:
                        {\"azimuth_deg\": 12.5, \"sigma_deg\": 5, \"age_s\": 0.1}
The azimuth is from the antennas' zero, clockwise. A radio that stops makes the flight hold.

\"obstacles\" of the result names the provider, and so does a text to the pilot. \"collisions\" is null where only the autopilot could know.

Exit status: 0 reached; 1 flown, but not reached; 2 bad usage or input, or a file that could not be written; 130 ended by \
Ctrl-C, 143 by SIGTERM.";

#[derive(Args, Debug)]
#[command(after_help = COMPANION_HELP)]
pub(super) struct CompanionCommand {
    /// Where the autopilot is: tcp:HOST:PORT, udp:HOST:PORT or udpin: (we listen there, it sends), udpout:HOST:PORT (it listens
    /// there), or serial:DEVICE:BAUD. It may start later, or restart.
    #[arg(long, value_name = "ADDRESS")]
    autopilot: Address,
    /// Where the beacon is, in metres of the autopilot's local frame: north, east, down. With --bearings it only says how near
    /// the flight came, and may be left out.
    #[arg(
        long,
        value_name = "N,E,D",
        value_parser = triple,
        allow_hyphen_values = true,
        required_unless_present = "bearings"
    )]
    source: Option<[f64; 3]>,
    /// Centre of a red pad on the ground (0 down), north and east in the same frame: a simulated camera of 60 degrees sees it, and
    /// Foxhound lands on it.
    #[arg(long, value_name = "N,E", value_parser = pair, allow_hyphen_values = true, requires = "source")]
    pad: Option<[f64; 2]>,
    #[command(flatten)]
    radio: RadioArgs,
    /// Who provides obstacles: a file of them, in the same frame, `autopilot` or `none`; see below.
    #[arg(long, value_name = "FILE|autopilot|none")]
    obstacles: Option<PathBuf>,
    /// Which computer flies: `host`, or `qemu:ELF` for a firmware image in QEMU.
    #[arg(long, value_name = "COMPUTER", default_value = "host")]
    via: Via,
    /// Horizontal speed of the fastest setpoint, in m/s; plans are flown at 1.3 at most [default: 2]
    #[arg(long, value_name = "M/S", value_parser = number(V_MAX_MPS))]
    v_max: Option<f64>,
    /// Radius of the vehicle, in metres.
    #[arg(long, value_name = "M", default_value_t = 0.15, value_parser = number(DRONE_RADIUS_M))]
    drone_radius: f64,
    /// Signal-to-noise ratio per sample of the antenna waveforms, in dB.
    #[arg(long, value_name = "DB", default_value_t = 20.0, value_parser = number(SNR_DB))]
    snr_db: f64,
    /// Which planner, as for `fly`.
    #[arg(long, value_parser = planner_parser(), default_value = "foxhound", value_name = "PLANNER")]
    planner: planner::Config,
    /// Which angle-of-arrival estimator.
    #[arg(long, value_parser = estimator_parser(), default_value = "cross", value_name = "ESTIMATOR")]
    estimator: Estimator,
    /// Gives up after so many seconds, from the start of the program [default: never].
    #[arg(long, value_name = "S", value_parser = number(MAX_TIME_S))]
    max_time: Option<f64>,
    /// Parameters, as `foxhound params` checks them; they overrule the options. What is stored by
    /// MAVLink is written to this file.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Signs every frame, and believes no position, obstacle or command that is not signed with the same key: a file of
    /// 64 hexadecimal digits.
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    #[command(flatten)]
    records: RecordArgs,
}

/// Three finite numbers with commas between.
pub(super) fn triple(text: &str) -> Result<[f64; 3], String> {
    several(text).ok_or_else(|| "expected three numbers in -10000..=10000, as in 8,-9,-5".to_owned())
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    several(text).ok_or_else(|| "expected two numbers in -10000..=10000, as in 8,-9".to_owned())
}

fn several<const N: usize>(text: &str) -> Option<[f64; N]> {
    let number = |part: &str| part.trim().parse().ok().filter(|number: &f64| number.is_finite());
    text.split(',').map(number).collect::<Option<Vec<f64>>>()?.try_into().ok()
}

pub(super) fn companion(cli: &Cli, args: &CompanionCommand) -> Result<ExitCode, InputError> {
    let obstacles = match &args.obstacles {
        Some(path) if path.as_os_str() == "autopilot" => Provider::Autopilot,
        Some(path) if path.as_os_str() == "none" => Provider::Nobody,
        Some(path) => {
            let named = |error: InputError| InputError::new(format!("--obstacles {error}"));
            let text = read_text(path).map_err(named)?;
            Provider::File(companion::parse_obstacles(&text).map_err(|error| named(error.in_file(path)))?)
        }
        None => Provider::Unsaid,
    };
    let key = match &args.key {
        Some(_) if matches!(args.via, Via::Qemu(_)) => {
            return Err(InputError::new("--key: a firmware image has its key stored; it works with --via host only"));
        }
        Some(path) => {
            let named = |error: InputError| InputError::new(format!("--key {error}"));
            let text = read_text(path).map_err(named)?;
            Some(companion::parse_key(&text).map_err(|error| named(error.in_file(path)))?)
        }
        None => None,
    };
    let config = Config {
        source_ned_m: args.source.unwrap_or_default(),
        pad_ne_m: args.pad,
        is_source_known: args.source.is_some(),
        obstacles,
        v_max_mps: args.v_max.unwrap_or(2.0),
        ends: Ends::Near,
        drone_radius_m: args.drone_radius,
        sensor: Sensor::default(),
        snr_db: args.snr_db,
        seed: cli.seed,
        planner: args.planner,
        estimator: args.estimator,
        max_time_s: args.max_time,
        key,
    };
    let config = config.checked()?;
    if let (Some(v_max_mps), Some(fastest_mps)) = (args.v_max, config.slower_than_asked_mps()) {
        warn(&format!(
            "--v-max = {v_max_mps}: plans are flown at {fastest_mps:.2} m/s at most; only giving way is faster"
        ));
    }
    let [report, mcap, tlog] = args.records.files();
    check_apart(&[
        ("--obstacles", args.obstacles.as_deref()),
        ("--params", args.params.as_deref()),
        ("--key", args.key.as_deref()),
        ("--array", args.radio.array()),
        report,
        mcap,
        tlog,
    ])?;
    check_writable("--report", args.records.report.as_ref())?;
    // Checked here for every computer, so that a refused field is named the same way.
    let mut host = match &args.params {
        Some(path) => HostComputer::with_store(&config.guidance(), path)?,
        None => HostComputer::new(&config.guidance())?,
    };
    let guidance = *host.config();
    // What would come on a serial line that only a board has would be all that is listened to.
    for (is_on_line, name, option) in [
        (guidance.radio.is_some(), "FH_BRG_SRC", "--bearings"),
        (guidance.lidar.is_some(), "FH_OBS_SRC", "--obstacles"),
    ] {
        if is_on_line {
            let why = format!("{name} is for what is on a board's serial line; {option} has it here: set {name} to 0");
            return Err(InputError::new(format!("--params: {why}")));
        }
    }
    let mut config = Config { ends: Ends::of(&guidance), ..config };
    if let Some(path) = &args.params {
        let (fov_deg, range_m) = (guidance.sensor.fov_rad.to_degrees().into(), guidance.sensor.range_m.into());
        config.drone_radius_m = guidance.vehicle.radius_m.into();
        config.sensor = Sensor { fov_deg, range_m, ..Sensor::default() };
        if matches!(args.via, Via::Qemu(_)) {
            let mut given = Given::default();
            given.read(path)?;
            given.refuse_of_link()?;
        }
    }
    let mut records = args.records.begin(&config.mission(), &guidance, host.parameters())?;
    let mut qemu = match &args.via {
        Via::Host => None,
        // A real autopilot says more than QEMU takes from its serial line in real time.
        Via::Qemu(elf) => {
            Some(QemuComputer::start_quick(elf, &Setup { guidance, needs_entry: false }).map_err(refused)?)
        }
        Via::G474(_) => {
            return Err(InputError::new(
                "--via: g474 keeps the board's time, which is slower than this one; `fly` takes it",
            ));
        }
    };
    let failed = |error: io::Error| InputError::new(format!("--autopilot {}: {error}", args.autopilot));
    let mut line = Line::open(&args.autopilot).map_err(failed)?;
    if let Some(turned) = line.turned() {
        warn(&format!("{}: cannot listen there; calls it instead, as {turned}", args.autopilot));
    }
    let mut radio = args.radio.open()?;
    let stop = stop_flag()?;
    let mut progress = Progress::new(cli, args.autopilot.clone());
    progress.text("waits for the autopilot");
    let waited = Instant::now();
    // What the radio says until then is read, so that it does not become old unread, or lost: also whose a report is, which is said once.
    let meanwhile = |now| {
        let _ = radio.as_mut().and_then(|radio| radio.poll(now));
    };
    let mut written = Written { cli, has_failed: false };
    let report = if companion::wait_for_line(&mut line, &stop, config.max_time_s, meanwhile) {
        let waited_s = waited.elapsed().as_secs_f64();
        let config = Config { max_time_s: config.max_time_s.map(|limit_s| limit_s - waited_s), ..config };
        let computer: &mut dyn Computer = match &mut qemu {
            Some(qemu) => {
                // What the firmware did while it was alone belongs to no flight.
                qemu.set_up(&Setup { guidance, needs_entry: true }).map_err(refused)?;
                qemu
            }
            None => {
                // As the firmware does, but for its silence towards PX4: a vehicle that flies in the mode already stays under its pilot's control.
                host.require_entry();
                if let Some(key) = &config.key {
                    host.sign_with(companion::signing(key, 0, Time(0)));
                }
                &mut host
            }
        };
        let bearings = radio.as_mut().map(|radio| radio as &mut dyn companion::Bearings);
        let mut tlog = records.tlog.take();
        let flown = companion::fly(&config, computer, &mut line, tlog.as_mut(), bearings, &stop, |news, moment| {
            progress.tell_eyes(news.eyes, &guidance);
            progress.tell_text(news);
            progress.show(news);
            if let Some(moment) = moment {
                records.watch(moment);
            }
        })?;
        records.tlog = tlog;
        progress.clear();
        if let Some(radio) = &radio {
            cli.note(&radio.summary());
        }
        for complaint in &flown.complaints {
            written.file(None, Err(InputError::new(complaint.clone())));
        }
        if flown.missed_steps > 0 {
            cli.note(&format!("{} steps were left out: the machine was busy", flown.missed_steps));
        }
        flown.report
    } else {
        companion::nobody_there(&config)
    };
    records.end(&mut written, &report, true);
    if cli.json {
        say(&json_line(&report)?);
    } else {
        show_as(look(report.result), &numbers(&report, " in control"));
    }
    records.linger(cli, &stop);
    Ok(exit_code(report.result, &written))
}

fn refused(error: foxhound_sim::drive::qemu::QemuError) -> InputError {
    InputError::new(format!("--via: {error}"))
}

/// A line that is drawn over and over on a terminal; elsewhere a line when something changes.
struct Progress {
    address: Address,
    is_quiet: bool,
    bar: Option<ProgressBar>,
    eyes: Option<Eyes>,
    /// The last text for the pilot.
    told: String,
    state: String,
    shown_s: f64,
}

/// On a terminal the line changes so often; elsewhere no more lines are written than that.
const PERIOD_S: f64 = 0.5;

impl Progress {
    fn new(cli: &Cli, address: Address) -> Self {
        let is_quiet = cli.quiet;
        let bar = (!is_quiet && io::stderr().is_terminal())
            .then(|| styled(ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr()), "{msg}"));
        Self { address, is_quiet, bar, eyes: None, told: String::new(), state: String::new(), shown_s: 0.0 }
    }

    fn text(&self, text: &str) {
        match &self.bar {
            Some(bar) => {
                bar.set_message(format!("{}: {text}", self.address));
                bar.tick();
            }
            None if self.is_quiet => {}
            None => warn(&format!("{}: {text}", self.address)),
        }
    }

    /// Says who provides the obstacles, and that nobody does even where notes are not wanted.
    fn tell_eyes(&mut self, eyes: Eyes, guidance: &guidance::Config) {
        if self.eyes.replace(eyes) == Some(eyes) {
            return;
        }
        let holds = if guidance.mission.obstacles_required {
            "it holds (FH_OBS_REQ is 1)"
        } else {
            "it flies blind (FH_OBS_REQ is 0)"
        };
        let told = match eyes {
            Eyes::Undecided => return,
            Eyes::File => "obstacles: a simulated sensor sees those of the file".to_owned(),
            Eyes::Autopilot => "obstacles: the autopilot's alone".to_owned(),
            Eyes::SimulatedEmpty => {
                "warning: nobody tells of obstacles: a simulated sensor sees an empty world; --obstacles \
                                     autopilot holds instead"
                    .to_owned()
            }
            Eyes::Nobody => format!("warning: --obstacles none: no obstacle sensor, {holds}"),
        };
        if !self.is_quiet || matches!(eyes, Eyes::SimulatedEmpty | Eyes::Nobody) {
            self.note(&told);
        }
    }

    /// Repeats what the pilot is told.
    fn tell_text(&mut self, news: &News) {
        let told = news.told.as_ref().and_then(|text| text.to_str().ok()).unwrap_or_default();
        if !self.is_quiet && told != self.told {
            told.clone_into(&mut self.told);
            self.note(told);
        }
    }

    /// A line that stays.
    fn note(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| warn(text)),
            None => warn(text),
        }
    }

    fn show(&mut self, news: &News) {
        if news.time_s < self.shown_s + PERIOD_S && self.shown_s > 0.0 {
            return;
        }
        let state = state(news);
        if self.bar.is_none() && state == self.state {
            return;
        }
        self.shown_s = news.time_s;
        let distance = news.distance_m.map_or(String::new(), |distance_m| format!(", {distance_m:.1} m to the beacon"));
        self.text(&format!("{:.1} s: {state}{distance}", news.time_s));
        self.state = state;
    }

    fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// How things stand, in words.
fn state(news: &News) -> String {
    if let Some(ending) = news.ending {
        return format!("{}; brakes", word(ending));
    }
    if !news.is_open {
        return "the line is down".to_owned();
    }
    let Some(autopilot) = news.autopilot else {
        if news.hears_mavlink_1 {
            return "MAVLink 1 is heard; set the autopilot's port to MAVLink 2 (ArduPilot: SERIALn_PROTOCOL 2; PX4: \
                    MAV_PROTO_VER 2)"
                .to_owned();
        }
        let heard =
            if news.is_disbelieved { "nobody who signs with this key is heard" } else { "no autopilot is heard" };
        return heard.to_owned();
    };
    let software = match autopilot.software {
        Software::ArduPilot => "ArduPilot",
        Software::Px4 => "PX4",
        Software::Other => "an autopilot that is not commanded",
    };
    let mode = match (autopilot.software, autopilot.in_mode) {
        (Software::ArduPilot, true) => "GUIDED".to_owned(),
        (Software::Px4, true) => "OFFBOARD".to_owned(),
        (Software::Px4, false) => format!("main mode {}", (autopilot.custom_mode >> 16) & 0xFF),
        _ => format!("mode {}", autopilot.custom_mode),
    };
    let armed = if autopilot.armed { "armed" } else { "disarmed" };
    format!("{software}, {mode}, {armed}: {}", news.outcome.name())
}
