//! The files of a release, in `target/dist`: `cargo xtask dist`.
//!
//! One commit gives the same bytes in every folder: no file names a place of this machine or a time. The images are those that the
//! tests fly, byte for byte.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;

use object::read::elf::{ElfFile32, ProgramHeader as _};
use sha2::{Digest as _, Sha256};

use crate::board::{NUCLEO, TWIN};
use crate::build::{
    Image, answer, built, cargo, cargo_home, host, in_a_clone, install_target, path_flags, path_setting, sysroot,
    workspace,
};
use crate::{Failure, attend};

/// The shells that get completions, and the names by which they find them.
const SHELLS: [(&str, &str); 3] = [("bash", "foxhound.bash"), ("zsh", "_foxhound"), ("fish", "foxhound.fish")];
const SUMS: &str = "SHA256SUMS";
/// Systems for which the command line is checked, not built: there is no linker for them here.
const ELSEWHERE: [&str; 2] = ["x86_64-pc-windows-gnu", "aarch64-apple-darwin"];

/// Writes everything. A tree that differs from its commit is refused, unless `dirty` says that it may; `COMMIT` says so then. With
/// `twice` everything is made once more in a clone, and compared.
pub(crate) fn run(dirty: bool, twice: bool) -> Result<(), Failure> {
    let changed = changed()?;
    if !(changed.is_empty() || dirty && !twice) {
        let remedy = if twice { "commit first" } else { "commit first, or give --dirty" };
        return Err(Failure(format!("these files differ from the commit; {remedy}:\n{changed}")));
    }
    let mark = if changed.is_empty() { "" } else { "-dirty" };
    let commit = format!("{}{mark}\n", git(&["rev-parse", "HEAD"])?);
    ELSEWHERE.iter().try_for_each(|target| lint_for(target))?;
    let folder = workspace().join("target/dist");
    let emptied = fs::remove_dir_all(&folder);
    if folder.exists() {
        return Err(Failure(format!("{}: {emptied:?}", folder.display())));
    }
    for name in ["man", "completions"] {
        fs::create_dir_all(folder.join(name)).map_err(|error| failed(&folder, &error))?;
    }
    for board in [NUCLEO, TWIN] {
        formats(&Image::build(board, "foxhound-firmware")?, board, &folder)?;
    }
    let program = program()?;
    copy(&program, &folder.join(format!("foxhound-{}{}", host()?, std::env::consts::EXE_SUFFIX)))?;
    attend(Command::new(&program).args(["--quiet", "man", "--out"]).arg(folder.join("man")))?;
    for (shell, name) in SHELLS {
        let script = answer(Command::new(&program).args(["completions", shell]))?;
        write(&folder.join("completions").join(name), &(script + "\n"))?;
    }
    wheel(&folder)?;
    let changelog = workspace().join("CHANGELOG.md");
    let changelog = fs::read_to_string(&changelog).map_err(|error| failed(&changelog, &error))?;
    write(&folder.join("NOTES.md"), newest(&changelog))?;
    write(&folder.join("COMMIT"), &commit)?;
    let sums = sums(&folder)?;
    write(&folder.join(SUMS), &sums)?;
    print!("{sums}");
    println!("{}", folder.display());
    if twice { again(&sums) } else { Ok(()) }
}

/// Lints what a stranger may build on another system.
fn lint_for(target: &str) -> Result<(), Failure> {
    install_target(target)?;
    let mut clippy = cargo();
    let packages =
        ["core", "papers", "pad", "link", "computer", "sim"].map(|name| format!("--package=foxhound-{name}"));
    clippy.args(["clippy", "--release", "--target", target]).args(packages);
    // One dependency has assembly, for which there is no assembler here. What it would make is needed by a linker only.
    clippy.env("CC_aarch64_apple_darwin", "true").env("AR_aarch64_apple_darwin", "true");
    attend(clippy.args(["--", "--deny", "warnings"]))
}

/// Writes an image as ELF, plain binary and Intel HEX, and checks that all three have the same program.
fn formats(image: &Image, board: &str, folder: &Path) -> Result<(), Failure> {
    let [elf, bin, hex] = ["elf", "bin", "hex"].map(|ending| folder.join(format!("foxhound-{board}.{ending}")));
    copy(&image.elf, &elf)?;
    objcopy(&["-O", "binary"], &elf, &bin)?;
    objcopy(&["-O", "ihex"], &elf, &hex)?;
    let back = folder.join("hex.bin");
    objcopy(&["-I", "ihex", "-O", "binary"], &hex, &back)?;
    let program = loaded(&elf)?;
    for file in [&bin, &back] {
        if read(file)? != program {
            return Err(Failure(format!("{} is not the program of {}", file.display(), elf.display())));
        }
    }
    fs::remove_file(&back).map_err(|error| failed(&back, &error))
}

/// What a loader writes into the flash, from the lowest address to the highest.
fn loaded(elf: &Path) -> Result<Vec<u8>, Failure> {
    let unreadable = |error| Failure(format!("{}: {error}", elf.display()));
    let bytes = read(elf)?;
    let file = ElfFile32::<object::Endianness>::parse(bytes.as_slice()).map_err(unreadable)?;
    let mut pieces = Vec::new();
    for header in file.elf_program_headers() {
        if header.p_type(file.endian()) == object::elf::PT_LOAD {
            let data = header.data(file.endian(), file.data());
            let data = data.map_err(|()| Failure(format!("{}: a segment has no data", elf.display())))?;
            pieces.push((header.p_paddr(file.endian()) as usize, data));
        }
    }
    Ok(laid(pieces))
}

/// Pieces at their addresses, with zeros between them.
fn laid(mut pieces: Vec<(usize, &[u8])>) -> Vec<u8> {
    pieces.retain(|(_, data)| !data.is_empty());
    pieces.sort_by_key(|(at, _)| *at);
    let start = pieces.first().map_or(0, |(at, _)| *at);
    let mut all = Vec::new();
    for (at, data) in pieces {
        all.resize(at - start, 0);
        all.extend_from_slice(data);
    }
    all
}

/// LLVM's objcopy, which comes with the compiler.
fn objcopy(arguments: &[&str], from: &Path, to: &Path) -> Result<(), Failure> {
    let toolchain = sysroot()?;
    let program = toolchain.join("lib/rustlib").join(host()?).join("bin/rust-objcopy");
    attend(Command::new(program).env("LD_LIBRARY_PATH", toolchain.join("lib")).args(arguments).arg(from).arg(to))
}

/// Builds `foxhound` for this machine, without symbols: the names that the optimizer makes depend on the folder.
fn program() -> Result<PathBuf, Failure> {
    let host = host()?;
    let mut cargo = cargo();
    cargo.args(["build", "--release", "--package", "foxhound-sim", "--bin", "foxhound", "--target", &host]);
    cargo.args(["--config", "profile.release.debug=false", "--config", "profile.release.strip='symbols'"]);
    cargo.args(["--config", &path_setting(&host)?]);
    let program = built(&mut cargo, "foxhound")?;
    let bytes = read(&program)?;
    for place in [workspace().to_owned(), cargo_home()] {
        let name = place.as_os_str().as_encoded_bytes();
        if bytes.windows(name.len()).any(|window| window == name) {
            return Err(Failure(format!("{} names the folder {}", program.display(), place.display())));
        }
    }
    Ok(program)
}

/// The wheel of the Python package, where there is one.
fn wheel(folder: &Path) -> Result<(), Failure> {
    let package = workspace().join("python");
    if !package.exists() {
        println!("NO WHEEL: there is no folder `python`");
        return Ok(());
    }
    let mut pip = Command::new("python3");
    pip.args(["-m", "pip", "wheel", "--no-deps", "--wheel-dir"]).arg(folder).arg(package);
    pip.env("CARGO_ENCODED_RUSTFLAGS", path_flags()?.join("\u{1f}"));
    // The times of the files in the wheel.
    attend(pip.env("SOURCE_DATE_EPOCH", git(&["log", "-1", "--format=%ct"])?))
}

/// The newest section of the changelog.
fn newest(changelog: &str) -> &str {
    let from = changelog.find("\n## ").map_or(0, |at| at + 1);
    let to = changelog[from..].find("\n## ").map_or(changelog.len(), |length| from + length + 1);
    &changelog[from..to]
}

/// A line for each file, as `sha256sum -c` reads it.
fn sums(folder: &Path) -> Result<String, Failure> {
    let (mut folders, mut files) = (vec![folder.to_owned()], Vec::new());
    while let Some(inner) = folders.pop() {
        for entry in fs::read_dir(&inner).map_err(|error| failed(&inner, &error))? {
            let path = entry.map_err(|error| failed(&inner, &error))?.path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files.sort();
    let line = |file: &PathBuf| {
        let sum: String = Sha256::digest(read(file)?).iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(format!("{sum}  {}\n", file.strip_prefix(folder).unwrap_or(file).display()))
    };
    files.iter().map(line).collect()
}

/// Makes the release in a clone, and compares.
fn again(sums: &str) -> Result<(), Failure> {
    in_a_clone("dist", |clone| {
        let mut dist = cargo();
        dist.current_dir(clone).env_remove("CARGO_TARGET_DIR").args([
            "run",
            "--quiet",
            "--package",
            "xtask",
            "--",
            "dist",
        ]);
        attend(&mut dist)?;
        let theirs = String::from_utf8_lossy(&read(&clone.join("target/dist").join(SUMS))?).into_owned();
        if theirs != sums {
            let differing: Vec<_> = sums.lines().filter(|line| !theirs.lines().any(|their| their == *line)).collect();
            return Err(Failure(format!("not the same in {}:\n{}", clone.display(), differing.join("\n"))));
        }
        println!("made twice, in two folders: the same bytes");
        Ok(())
    })
}

/// What differs from the commit, as `git status` prints it.
fn changed() -> Result<String, Failure> {
    git(&["status", "--porcelain"])
}

fn git(arguments: &[&str]) -> Result<String, Failure> {
    answer(Command::new("git").current_dir(workspace()).args(arguments))
}

fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    fs::read(path).map_err(|error| failed(path, &error))
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    fs::write(path, text).map_err(|error| failed(path, &error))
}

fn copy(from: &Path, to: &Path) -> Result<(), Failure> {
    fs::copy(from, to).map(drop).map_err(|error| failed(to, &error))
}

fn failed(path: &Path, error: &io::Error) -> Failure {
    Failure(format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_notes_are_the_newest_section_alone() {
        assert_eq!(newest("# Changelog\n\n## [2]\n\n- b\n\n## [1]\n\n- a\n"), "## [2]\n\n- b\n\n");
        assert_eq!(newest("# Changelog\n\n## [1]\n\n- a\n"), "## [1]\n\n- a\n");
        assert!(newest(include_str!("../../CHANGELOG.md")).starts_with("## ["));
    }

    #[test]
    fn a_program_is_laid_by_address_with_zeros_in_the_gaps() {
        assert_eq!(laid(vec![(12, &[3]), (8, &[1, 2]), (9, &[])]), [1, 2, 0, 0, 3]);
        assert!(laid(Vec::new()).is_empty());
    }

    /// `sha256sum` reads what is written.
    #[test]
    fn the_sums_are_checked_by_sha256sum() {
        let folder = std::env::temp_dir().join(format!("foxhound-sums-{}", std::process::id()));
        fs::create_dir_all(folder.join("man")).unwrap();
        fs::write(folder.join("b"), "abc").unwrap();
        fs::write(folder.join("man/a"), "").unwrap();
        let text = sums(&folder).unwrap();
        // FIPS 180-2, appendix B.1.
        assert!(text.starts_with("ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  b\n"), "{text}");
        fs::write(folder.join(SUMS), &text).unwrap();
        let check = |folder| Command::new("sha256sum").current_dir(folder).args(["--check", "--strict", SUMS]).output();
        assert!(check(&folder).unwrap().status.success());
        fs::write(folder.join("b"), "abd").unwrap();
        assert!(!check(&folder).unwrap().status.success());
        fs::remove_dir_all(folder).unwrap();
    }
}
