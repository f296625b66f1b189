//! Builds an image of the firmware and measures it.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use object::{Object as _, ObjectSection as _};

use crate::{Failure, attend};

pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// What an image has beside what all have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::Args)]
pub(crate) struct Parts {
    /// Read Bluetooth's IQ reports, in place of the camera and its pad detector
    #[arg(long)]
    iq: bool,
}

impl Parts {
    /// The other kind of image.
    pub(crate) const IQ: Self = Self { iq: true };

    /// A board's name with what its image has.
    pub(crate) fn name(self, board: &str) -> String {
        format!("{board}{}", if self.iq { "-iq" } else { "" })
    }

    /// Arguments of cargo for a board.
    pub(crate) fn features(self, board: &str) -> Vec<String> {
        let (others, iq) = if self.iq { (Some("--no-default-features"), ",iq") } else { (None, "") };
        let features = ["--features".to_owned(), format!("board-{board}{iq}")];
        others.map(str::to_owned).into_iter().chain(features).collect()
    }
}

/// A linked image.
pub(crate) struct Image {
    /// Absolute path of the ELF file.
    pub(crate) elf: PathBuf,
}

/// How much of the chip an image takes.
pub(crate) struct Size {
    /// Program, constants, and the initial values of the variables.
    pub(crate) flash_bytes: u64,
    /// Variables; the stack has a place of its own.
    pub(crate) ram_bytes: u64,
}

impl Image {
    /// Builds one of the firmware's programs.
    pub(crate) fn build(board: &str, program: &str) -> Result<Self, Failure> {
        Self::of(board, program, Parts::default())
    }

    /// Builds the firmware with these parts.
    pub(crate) fn with(parts: Parts, board: &str) -> Result<Self, Failure> {
        Self::of(board, "foxhound-firmware", parts)
    }

    fn of(board: &str, program: &str, parts: Parts) -> Result<Self, Failure> {
        install_target(TARGET)?;
        let mut cargo = cargo();
        cargo.args(["build", "--profile", "firmware", "--package", "foxhound-firmware", "--bin", program]);
        cargo.args(["--target", TARGET]).args(parts.features(board)).args(["--config", &path_setting(TARGET)?]);
        let built = built(&mut cargo, program)?;
        // Cargo puts every board's image in the same place.
        let elf = built.with_file_name(format!("{program}-{}.elf", parts.name(board)));
        std::fs::copy(&built, &elf).map_err(|error| Failure(format!("{}: {error}", elf.display())))?;
        Ok(Self { elf })
    }

    /// Adds up the sections that are loaded.
    pub(crate) fn size(&self) -> Result<Size, Failure> {
        let unreadable = |why: String| Failure(format!("{}: {why}", self.elf.display()));
        let bytes = std::fs::read(&self.elf).map_err(|error| unreadable(error.to_string()))?;
        let image = object::File::parse(bytes.as_slice()).map_err(|error| unreadable(error.to_string()))?;
        let mut size = Size { flash_bytes: 0, ram_bytes: 0 };
        for section in image.sections() {
            let object::SectionFlags::Elf { sh_flags, .. } = section.flags() else { continue };
            if !sh_flags.contains(object::elf::SHF_ALLOC) {
                continue;
            }
            // On every board, everything from here on is RAM.
            if section.address() >= 0x2000_0000 {
                size.ram_bytes += section.size();
            }
            if section.kind() != object::SectionKind::UninitializedData {
                size.flash_bytes += section.size();
            }
        }
        Ok(size)
    }
}

/// Builds a program with a cargo that has all its arguments but the format of the messages, and returns where it is.
pub(crate) fn built(cargo: &mut Command, program: &str) -> Result<PathBuf, Failure> {
    // Those of the environment would take the place of all others.
    cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS");
    cargo.arg("--message-format=json-render-diagnostics").stderr(Stdio::inherit());
    let output = cargo.output().map_err(|error| Failure(format!("cargo cannot be started: {error}")))?;
    if !output.status.success() {
        return Err(Failure(format!("{program} does not build")));
    }
    // One JSON object a line; the program's own says where it was put.
    String::from_utf8_lossy(&output.stdout)
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        .filter(|message| message["target"]["name"] == program)
        .find_map(|message| message["executable"].as_str().map(PathBuf::from))
        .ok_or_else(|| Failure(format!("cargo does not say where {program} is")))
}

/// [`path_flags`] as a setting of cargo for a target.
pub(crate) fn path_setting(target: &str) -> Result<String, Failure> {
    // An array of strings is written alike in Rust and in TOML.
    Ok(format!("target.{target}.rustflags = {:?}", path_flags()?))
}

/// Flags by which a program does not depend on where the repository, the crates and the toolchain's sources lie: it names places in
/// them, in messages and for the debugger. What is relative to `.` is in the repository.
pub(crate) fn path_flags() -> Result<Vec<String>, Failure> {
    // Of several that fit, the last is taken; the homes may lie in the repository.
    let mut places = vec![(workspace().to_owned(), ".".to_owned())];
    if let Some(folder) = std::env::var_os("CARGO_TARGET_DIR") {
        places.push((workspace().join(folder), "./target".to_owned()));
    }
    // A folder for each registry, named by cargo's version; none where the crates come from elsewhere.
    let registries = std::fs::read_dir(cargo_home().join("registry").join("src"));
    places.extend(registries.into_iter().flatten().flatten().map(|folder| (folder.path(), "crates".to_owned())));
    places.push((sysroot()?.join("lib/rustlib/src/rust"), format!("/rustc/{}", of_compiler("commit-hash")?)));
    Ok(places.iter().map(|(from, to)| format!("--remap-path-prefix={}={to}", from.display())).collect())
}

/// Where cargo keeps the sources of crates.
pub(crate) fn cargo_home() -> PathBuf {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    home.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cargo"))).unwrap_or_default()
}

/// The name of this machine's target.
pub(crate) fn host() -> Result<String, Failure> {
    of_compiler("host")
}

/// A line of what the compiler says of itself.
fn of_compiler(key: &str) -> Result<String, Failure> {
    let about = answer(Command::new("rustc").current_dir(workspace()).arg("-vV"))?;
    let value = about.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(": "));
    value.map(str::to_owned).ok_or_else(|| Failure(format!("rustc does not say its {key}")))
}

/// The folder of the running toolchain.
pub(crate) fn sysroot() -> Result<PathBuf, Failure> {
    answer(Command::new("rustc").current_dir(workspace()).args(["--print", "sysroot"])).map(PathBuf::from)
}

/// What a program prints, without the end of the line.
pub(crate) fn answer(command: &mut Command) -> Result<String, Failure> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| Failure(format!("{name} cannot be started: {error}")))?;
    if !output.status.success() {
        return Err(Failure(format!(
            "{name} ended with {}: {}",
            output.status,
            String::from_utf8_lossy(&output.stderr)
        )));
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim_end().to_owned())
}

/// The cargo that runs us, in the root of the repository.
pub(crate) fn cargo() -> Command {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(workspace());
    cargo
}

/// `cargo run` of the simulator's programs, in release.
pub(crate) fn simulator() -> Command {
    let mut cargo = cargo();
    cargo.args(["run", "--release", "--quiet", "--package", "foxhound-sim"]);
    cargo
}

/// Clones what is committed into a folder below the system's temporary one (`TMPDIR`). A failure leaves it behind.
pub(crate) fn in_a_clone(purpose: &str, work: impl FnOnce(&Path) -> Result<(), Failure>) -> Result<(), Failure> {
    let folder = std::env::temp_dir().join(format!("foxhound-{purpose}-{}", std::process::id()));
    println!("cloning into {}", folder.display());
    attend(Command::new("git").args(["clone", "--quiet"]).arg(workspace()).arg(&folder))?;
    work(&folder)?;
    std::fs::remove_dir_all(&folder).map_err(|error| Failure(format!("{}: {error}", folder.display())))
}

pub(crate) fn workspace() -> &'static Path {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().unwrap_or(here)
}

/// Gives the running toolchain a target, where it does not have it. [`TARGET`] comes with the toolchain of `rust-toolchain.toml`.
pub(crate) fn install_target(target: &str) -> Result<(), Failure> {
    if has_target(target) {
        return Ok(());
    }
    eprintln!("installing {target} (rustup)");
    attend(Command::new("rustup").current_dir(workspace()).args(["target", "add", target]).stdout(Stdio::null()))
}

fn has_target(target: &str) -> bool {
    let mut rustc = Command::new("rustc");
    rustc.current_dir(workspace()).args(["--print", "target-libdir", "--target", target]);
    rustc.output().is_ok_and(|output| Path::new(String::from_utf8_lossy(&output.stdout).trim()).is_dir())
}
