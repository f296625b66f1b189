//! Developer commands: `cargo xtask <test | fresh | firmware | dist | api | size | panics | stack | flash | qemu <boot | bench | faults> | bench | parity | g474 | soak | gusts | campaign | compare | landings | sitl>`.
//!
//! Of the firmware the host builds what needs no hardware; these commands build it
//! for its own target.

mod api;
mod bench;
mod board;
mod build;
mod compare;
mod dist;
mod fresh;
mod g474;
mod left;
mod panics;
mod parity;
mod sitl;
mod size;
mod stack;
mod study;
mod test;
mod thumb;
mod twin;

use std::fmt;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

use clap::{Parser, Subcommand};
use serde_json::json;

use build::{Image, Parts};

#[derive(Parser)]
#[command(name = "cargo xtask", about = "Test everything; build, flash, boot and measure the firmware")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Install what is missing, then run every check: format, lints, documentation, images, tests, flights in QEMU
    Test {
        /// Stop after the build
        #[arg(long)]
        no_run: bool,
    },
    /// Clone what is committed and run the README's two commands there with a rustup home and a cargo home of their own
    Fresh {
        /// Stop after the build
        #[arg(long)]
        no_run: bool,
    },
    /// Build the release image of a board and print its size
    Firmware {
        /// The board: a name of `firmware/src/boards`
        #[arg(long, value_parser = board::named)]
        board: String,
        #[command(flatten)]
        parts: Parts,
        /// Print one JSON object: board, elf, `flash_bytes`, `ram_bytes`
        #[arg(long)]
        json: bool,
    },
    /// Make the files of a release in `target/dist`: images, command line, manual pages, notes, sums
    Dist {
        /// Accept files that differ from the commit, and mark the release as such
        #[arg(long)]
        dirty: bool,
        /// Make it once more in a clone and compare
        #[arg(long, conflicts_with = "dirty")]
        twice: bool,
    },
    /// Compare the public interface of `foxhound-core` and `foxhound-link` with `xtask/api`
    Api {
        /// Write it there instead
        #[arg(long)]
        renew: bool,
    },
    /// Print how much of the flash each layer and crate takes, and the longest functions: docs/results/size.md
    Size {
        #[command(flatten)]
        parts: Parts,
    },
    /// Print the places from which the image can panic in flight
    Panics {
        #[command(flatten)]
        parts: Parts,
    },
    /// Print the most stack that the image can take
    Stack {
        #[command(flatten)]
        parts: Parts,
    },
    /// Build for the NUCLEO-G474RE, write it through the ST-LINK and show its log (needs probe-rs)
    Flash {
        #[command(flatten)]
        parts: Parts,
    },
    /// The firmware's twin in QEMU
    #[command(subcommand)]
    Qemu(Twin),
    /// Count the instructions of each stage in QEMU
    Bench,
    /// Fly many missions on the host and in QEMU, and compare their traces
    Parity {
        /// How many
        #[arg(long, default_value_t = 100)]
        flights: u32,
    },
    /// Run the link for a simulated day, flying to and fro, with faults all the time
    Soak {
        /// Simulated hours
        #[arg(long, default_value_t = 24.0)]
        hours: f64,
    },
    /// Fly in calm air and in gusts, scene by scene: docs/results/gusts.md
    Gusts {
        /// Flights past walls, gaps and pillars each, in strong gusts; of the others at most 100
        #[arg(long, default_value_t = 240)]
        flights: u32,
        /// Fly development seeds, and print
        #[arg(long)]
        development: bool,
    },
    /// Fly every kind of world in every setting of sensor, bearings, vehicle and hull: docs/results/matrix.md
    Campaign {
        /// Factor on the number of flights, except in BARN's worlds
        #[arg(long, default_value_t = 1)]
        times: u32,
        /// Only settings whose name contains this; the page is printed, not written
        #[arg(long)]
        only: Option<String>,
    },
    /// Fly the same held-out flights with another build of `foxhound` and with this tree's: docs/results/compare.md
    Compare {
        /// The other build
        old: PathBuf,
        /// Instead of this tree's
        #[arg(long)]
        new: Option<PathBuf>,
        /// What the page calls the other build
        #[arg(long, default_value = "another build")]
        commit: String,
        /// About how many flights in each setting; of landings a quarter as many
        #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(2..=100_000))]
        flights: u32,
    },
    /// Fly the image of the NUCLEO-G474RE in an instruction emulator, beside the desktop and QEMU
    G474 {
        /// How many missions
        #[arg(long, default_value_t = 5)]
        seeds: u32,
    },
    /// Fly complete missions, onto the pad or above the beacon, scene by scene: docs/results/landings.md
    Landings {
        /// Flights of each scene
        #[arg(long, default_value_t = 200)]
        flights: u32,
        /// Fly development seeds, and print
        #[arg(long)]
        development: bool,
    },
    /// Fly beside `ArduCopter` and PX4 in their own simulators, in real time, with faults: docs/sitl.md
    Sitl(sitl::Campaign),
}

#[derive(Subcommand)]
enum Twin {
    /// Boot it; MAVLink is served on the given serial line
    Boot {
        /// What UART0 is connected to: the value of QEMU's -serial
        #[arg(long, default_value = "tcp:127.0.0.1:5760,server=on,wait=off")]
        serial: String,
    },
    /// Count the instructions of each stage, and the worst of whole missions: docs/results/bench.md
    Bench,
    /// Fly many missions with random faults: docs/results/faults.md
    Faults {
        /// How many missions
        #[arg(long, default_value_t = 100)]
        missions: u32,
        /// How many faults in each
        #[arg(long, default_value_t = 10)]
        faults: u32,
        /// File of the results, mission by mission; an existing one is continued
        #[arg(long, default_value = "out/faults.jsonl")]
        record: PathBuf,
        /// Fly only this mission, and write nothing
        #[arg(long)]
        seed: Option<u64>,
    },
}

/// The flash that a program may take, and the memory for variables and for the stack: every board's `memory.x`.
const FLASH_BYTES: u64 = 496 << 10;
const RAM_BYTES: u64 = 89 << 10;
const STACK_BYTES: u64 = 39 << 10;

/// What went wrong, in words.
#[derive(Debug)]
struct Failure(String);

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

fn main() -> ExitCode {
    match run(&Arguments::parse().task) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("xtask: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(task: &Task) -> Result<(), Failure> {
    match task {
        Task::Test { no_run } => test::run(*no_run),
        Task::Fresh { no_run } => fresh::run(*no_run),
        Task::Firmware { board, parts, json } => firmware(*parts, board, *json),
        Task::Dist { dirty, twice } => dist::run(*dirty, *twice),
        Task::Api { renew } => api::run(*renew),
        Task::Size { parts } => size::run(*parts),
        Task::Panics { parts } => panics::run(*parts),
        Task::Stack { parts } => stack::run(*parts),
        Task::Flash { parts } => {
            let image = Image::with(*parts, board::NUCLEO)?;
            let mut probe = Command::new("probe-rs");
            probe.args(["run", "--chip", "STM32G474RETx"]).arg(&image.elf);
            attend(&mut probe)
        }
        Task::Qemu(Twin::Boot { serial }) => {
            let image = Image::build(board::TWIN, "foxhound-firmware")?;
            eprintln!("UART0 (MAVLink) is at {serial}; end with Ctrl-C");
            let mut qemu = qemu(&image);
            qemu.args(["-serial", serial]);
            attend(&mut qemu)
        }
        Task::Qemu(Twin::Bench) => twin::bench(),
        Task::Qemu(Twin::Faults { missions, faults, record, seed }) => twin::faults(*missions, *faults, record, *seed),
        Task::Bench => bench::run(),
        Task::Parity { flights } => parity::run(*flights),
        Task::Soak { hours } => study::run("soak", &[&hours.to_string()]),
        Task::Gusts { flights, development } => study::write("gusts", *flights, "gusts", *development),
        Task::Landings { flights, development } => study::write("landings", *flights, "landings", *development),
        Task::Campaign { times, only } => study::matrix(*times, only.as_deref()),
        Task::Compare { old, new, commit, flights } => compare::run(old, new.as_deref(), commit, *flights),
        Task::Sitl(campaign) => sitl::run(campaign),
        Task::G474 { seeds } => g474::run(*seeds),
    }
}

fn firmware(parts: Parts, board: &str, json: bool) -> Result<(), Failure> {
    let image = Image::with(parts, board)?;
    let size = image.size()?;
    if json {
        let line = json!({
            "board": board,
            "elf": image.elf,
            "flash_bytes": size.flash_bytes,
            "ram_bytes": size.ram_bytes,
        });
        println!("{line}");
    } else {
        println!("{}", image.elf.display());
        println!("flash {:>7} bytes of {FLASH_BYTES}", size.flash_bytes);
        println!("RAM   {:>7} bytes of {RAM_BYTES}, beside {STACK_BYTES} of stack", size.ram_bytes);
    }
    Ok(())
}

/// QEMU with an image: `-icount shift=8` makes an instruction last 256 ns of the machine's time.
fn qemu(image: &Image) -> Command {
    // `setpriv` ends it with this program; without `setpriv` the image ends it.
    let mut qemu = Command::new("setpriv");
    if qemu.arg("--version").output().is_ok_and(|output| output.status.success()) {
        qemu = Command::new("setpriv");
        qemu.args(["--pdeathsig", "KILL", "qemu-system-arm"]);
    } else {
        qemu = Command::new("qemu-system-arm");
    }
    qemu.args(["-M", "mps2-an386", "-display", "none", "-monitor", "none", "-icount", "shift=8"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(&image.elf);
    qemu
}

/// Runs a program to its end, with our terminal.
fn attend(command: &mut Command) -> Result<(), Failure> {
    let name = command.get_program().to_string_lossy().into_owned();
    let status = command.status().map_err(|error| Failure(format!("{name} cannot be started: {error}")))?;
    if status.success() { Ok(()) } else { Err(Failure(format!("{name} ended with {status}"))) }
}
