//! The whole check, and what it needs installed: `cargo xtask test`.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::build::{Image, TARGET, workspace};
use crate::{Board, Failure, attend};

/// The peers that read our bytes, at the versions that the tests were written against.
const PEERS: [&str; 3] = ["pymavlink==2.4.50", "mavsdk==4.1.0", "pyserial==3.5"];
/// As a router it needs no more than the above, and no picture, map or plot of what it asks for.
const ROUTER: &str = "MAVProxy==1.8.75";
/// Loads them, and exits with 1 where a version is another one.
const CHECK: &str = "
import sys
from importlib.metadata import version
import mavsdk, serial
from MAVProxy import modules
from pymavlink.dialects.v20 import ardupilotmega
sys.exit(any(version(name) != wanted for name, wanted in (peer.split('==') for peer in sys.argv[1:])))
";

/// Installs what is missing, then runs everything, cheapest first.
pub(crate) fn run() -> Result<(), Failure> {
    let python = install()?;
    let firmware = ["--package", "foxhound-firmware", "--target", TARGET];
    let strict = ["--", "--deny", "warnings"];

    step("format");
    cargo(&["fmt", "--all", "--check"], &[])?;
    step("lints, host");
    cargo(&["clippy", "--workspace", "--exclude", "foxhound-firmware", "--all-targets"], &strict)?;
    for board in [Board::NucleoG474re, Board::Mps2An386] {
        step(&format!("lints, {}", board.name()));
        let feature = format!("board-{}", board.name());
        cargo(&["clippy", "--profile", "firmware", "--features", &feature], &[&firmware[..], &strict].concat())?;
    }
    step("documentation");
    let mut doc = command(&["doc", "--no-deps", "--workspace", "--exclude", "foxhound-firmware"]);
    attend(doc.env("RUSTDOCFLAGS", "--deny warnings"))?;

    step("firmware images");
    let board = Image::build(Board::NucleoG474re, "foxhound-firmware")?;
    let twin = Image::build(Board::Mps2An386, "foxhound-firmware")?;
    // The design has half of the flash for the product, 256 KB, and that is not kept (README, limits); the twin, which carries
    // the simulator's side as well, must fit into all of it.
    for (name, image, flash) in [("nucleo_g474re", &board, 320 * 1024), ("mps2_an386", &twin, 512 * 1024)] {
        let size = image.size()?;
        println!("{name}: flash {} bytes of {flash} allowed, RAM {} of 90112", size.flash_bytes, size.ram_bytes);
        if size.flash_bytes > flash || size.ram_bytes > 88 * 1024 {
            return Err(Failure(format!("{name} is over its budget")));
        }
    }

    step("panics, looked for in the machine code");
    crate::panics::run(false)?;
    step("stack, at most");
    crate::stack::run(false)?;

    step("tests");
    let mut test = command(&["test", "--", "--include-ignored"]);
    test.env("FOXHOUND_QEMU_ELF", &twin.elf).env("FOXHOUND_G474_ELF", &board.elf).env("FOXHOUND_PYTHON", &python);
    attend(&mut test)?;

    step("instructions, counted in QEMU");
    crate::bench::run(false)?;
    println!("\nall checks passed");
    Ok(())
}

fn step(name: &str) {
    println!("\n== {name}");
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(workspace()).args(arguments);
    command
}

fn cargo(arguments: &[&str], more: &[&str]) -> Result<(), Failure> {
    attend(command(arguments).args(more))
}

/// Installs what the checks need and says so; returns a Python that has the peers.
fn install() -> Result<PathBuf, Failure> {
    for component in ["rustfmt", "clippy"] {
        if !runs(&format!("cargo-{}", component.trim_start_matches("rust")), "--version") {
            println!("installing {component} (rustup)");
            attend(Command::new("rustup").args(["component", "add", component]))?;
        }
    }
    if !runs("qemu-system-arm", "--version") {
        println!("installing qemu-system-arm (apt)");
        apt("qemu-system-arm")?;
    }
    let folder = workspace().join("target/venv");
    let python = folder.join("bin/python");
    let has_peers = |python: &Path| {
        let check = Command::new(python).args(["-c", CHECK]).args(PEERS).arg(ROUTER).output();
        check.is_ok_and(|output| output.status.success())
    };
    if !has_peers(&python) {
        println!("installing {} {ROUTER} (pip) into {}", PEERS.join(" "), folder.display());
        if attend(Command::new("python3").args(["-m", "venv"]).arg(&folder)).is_err() {
            println!("installing python3-venv (apt)");
            apt("python3-venv")?;
            attend(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder))?;
        }
        let pip = || {
            let mut pip = Command::new(&python);
            pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
            pip
        };
        attend(pip().args(PEERS))?;
        attend(pip().args(["--no-deps", ROUTER]))?;
    }
    if has_peers(&python) { Ok(python) } else { Err(Failure("a MAVLink peer does not load".to_owned())) }
}

fn runs(program: &str, argument: &str) -> bool {
    Command::new(program).arg(argument).output().is_ok_and(|output| output.status.success())
}

/// Installs a Debian package, as root or through sudo.
fn apt(package: &str) -> Result<(), Failure> {
    let sudo: &[&str] = if runs("sudo", "--version") { &["sudo"] } else { &[] };
    for arguments in [&["apt-get", "update", "-qq"][..], &["apt-get", "install", "-qq", "-y", package]] {
        let line = [sudo, arguments].concat();
        let mut apt = Command::new(line[0]);
        attend(apt.args(&line[1..]).env("DEBIAN_FRONTEND", "noninteractive"))?;
    }
    Ok(())
}
