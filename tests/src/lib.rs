//! How the system tests reach the product: through its command line, as a user does.

use std::io::{BufRead as _, BufReader, Lines};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::sync::{OnceLock, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use serde_json::Value;

pub mod recording;

/// The root of the repository.
#[must_use]
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new("."))
}

/// A command that runs the release build of `foxhound`, built once.
///
/// # Panics
/// When the binary does not build.
#[must_use]
pub fn foxhound() -> Command {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    let path = BINARY.get_or_init(|| {
        // No package is named: with the features of all of them it is what `cargo run --release` builds.
        let build = escargot::CargoBuild::new().manifest_path(root().join("Cargo.toml")).bin("foxhound").release();
        match build.run() {
            Ok(run) => run.path().to_path_buf(),
            Err(error) => fail(&format!("foxhound does not build: {error}")),
        }
    });
    Command::new(path)
}

/// Runs `foxhound` with arguments.
///
/// # Panics
/// When it cannot be started.
#[must_use]
pub fn run(arguments: &[&str]) -> Output {
    match foxhound().args(arguments).output() {
        Ok(output) => output,
        Err(error) => fail(&format!("foxhound does not start: {error}")),
    }
}

/// Runs `foxhound` and reads its standard output as one JSON object.
///
/// # Panics
/// When there is anything else on it.
#[must_use]
pub fn run_json(arguments: &[&str]) -> (i32, Value) {
    let output = run(arguments);
    let text = String::from_utf8_lossy(&output.stdout);
    match serde_json::from_str(&text) {
        Ok(value) => (output.status.code().unwrap_or(-1), value),
        Err(error) => {
            let errors = String::from_utf8_lossy(&output.stderr);
            fail(&format!("{arguments:?}: {error}\nstdout: {text}\nstderr: {errors}"))
        }
    }
}

/// The firmware image for QEMU, which `cargo xtask test` builds and names.
///
/// # Panics
/// When it is not named.
#[must_use]
pub fn qemu_image() -> String {
    match std::env::var("FOXHOUND_QEMU_ELF") {
        Ok(path) => path,
        Err(_) => fail("FOXHOUND_QEMU_ELF names no image; `cargo xtask test` builds one and runs this test"),
    }
}

/// The image for the NUCLEO-G474RE, which `cargo xtask test` builds and names.
///
/// # Panics
/// When it is not named.
#[must_use]
pub fn g474_image() -> String {
    match std::env::var("FOXHOUND_G474_ELF") {
        Ok(path) => path,
        Err(_) => fail("FOXHOUND_G474_ELF names no image; `cargo xtask test` builds one and runs this test"),
    }
}

/// The image for it that reads IQ reports, which `cargo xtask test` builds and names.
///
/// # Panics
/// When it is not named.
#[must_use]
pub fn g474_iq_image() -> String {
    match std::env::var("FOXHOUND_G474_IQ_ELF") {
        Ok(path) => path,
        Err(_) => fail("FOXHOUND_G474_IQ_ELF names no image; `cargo xtask test` builds one and runs this test"),
    }
}

/// A Python with pymavlink, which `cargo xtask test` installs and names.
///
/// # Panics
/// When it is not named.
#[must_use]
pub fn python() -> Command {
    match std::env::var("FOXHOUND_PYTHON") {
        Ok(path) => Command::new(path),
        Err(_) => fail("FOXHOUND_PYTHON names no Python; `cargo xtask test` makes one and runs this test"),
    }
}

/// The tests of a program run beside one another. Those that measure time, or start many processes, must not disturb one
/// another: they hold this, shared or alone.
static MACHINE: RwLock<()> = RwLock::new(());

/// Held by a test that may run beside others that share the machine, but not beside one that takes it.
pub fn share_machine() -> RwLockReadGuard<'static, ()> {
    // A test that failed while it held the lock has left nothing undone.
    MACHINE.read().unwrap_or_else(PoisonError::into_inner)
}

/// A NumPy file: its type, its shape as Python writes it, and its values as bytes.
#[must_use]
pub fn npy(dtype: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend_from_slice(&(header.len() as u16).to_le_bytes());
    file.extend_from_slice(header.as_bytes());
    file.extend_from_slice(values);
    file
}

/// Held by a test beside which no other may run that shares the machine or takes it.
pub fn take_machine() -> RwLockWriteGuard<'static, ()> {
    MACHINE.write().unwrap_or_else(PoisonError::into_inner)
}

/// A program beside the test, which ends with it, however that ends.
#[derive(Debug)]
pub struct Program(Child);

impl Program {
    /// Starts it with its input and output in our hands. What it says to people is dropped.
    ///
    /// # Panics
    /// When it does not start.
    #[must_use]
    pub fn start(command: &mut Command) -> Self {
        match command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn() {
            Ok(child) => Self(child),
            Err(error) => fail(&format!("{command:?}: {error}")),
        }
    }

    /// What it says, line for line; once.
    ///
    /// # Panics
    /// When somebody has it already.
    #[must_use]
    pub fn lines(&mut self) -> Lines<BufReader<ChildStdout>> {
        match self.0.stdout.take() {
            Some(output) => BufReader::new(output).lines(),
            None => fail("the output is taken"),
        }
    }

    /// Ends its input.
    pub fn end_input(&mut self) {
        drop(self.0.stdin.take());
    }

    /// Sends it a signal, as `kill` names them: `-INT`.
    ///
    /// # Panics
    /// When it is gone.
    pub fn signal(&self, name: &str) {
        match Command::new("kill").args([name, &self.0.id().to_string()]).status() {
            Ok(status) if status.success() => {}
            other => fail(&format!("kill {name}: {other:?}")),
        }
    }

    /// Waits for its end; its exit code, or -1 where a signal ended it.
    ///
    /// # Panics
    /// When the system does not say.
    pub fn wait(&mut self) -> i32 {
        match self.0.wait() {
            Ok(status) => status.code().unwrap_or(-1),
            Err(error) => fail(&format!("{error}")),
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        // It may have ended before.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[expect(clippy::panic, reason = "a test that cannot run has failed")]
fn fail(text: &str) -> ! {
    panic!("{text}")
}
