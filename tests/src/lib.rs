//! How the system tests reach the product: through its command line, as a user does.

#![expect(clippy::unwrap_used, reason = "a test that cannot run has failed")]

use std::ffi::OsStr;
use std::io::{BufRead as _, BufReader, Lines, Read, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{OnceLock, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use serde_json::Value;

pub mod recording;
pub mod station;

/// The root of the repository.
#[must_use]
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// The files in a folder, and in those inside it, whose names end in `ending`; in order.
#[must_use]
pub fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let found = entries.flat_map(|path| if path.is_dir() { files(&path, ending) } else { vec![path] });
    let mut found: Vec<PathBuf> = found.filter(|path| path.extension().is_some_and(|of| of == ending)).collect();
    found.sort();
    found
}

/// A path as an argument.
#[must_use]
pub fn text(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

/// A command that runs the release build of `foxhound`, built once.
#[must_use]
pub fn foxhound() -> Command {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    let path = BINARY.get_or_init(|| {
        // No package is named: with the features of all of them it is what `cargo run --release` builds.
        let build = escargot::CargoBuild::new().manifest_path(root().join("Cargo.toml")).bin("foxhound").release();
        build.run().unwrap().path().to_path_buf()
    });
    Command::new(path)
}

/// Runs `foxhound` with arguments.
#[must_use]
pub fn run(arguments: &[&str]) -> Output {
    foxhound().args(arguments).output().unwrap()
}

/// Runs `foxhound` and reads its standard output as one JSON object; there must be nothing else on it.
#[must_use]
pub fn run_json(arguments: &[&str]) -> (i32, Value) {
    let output = run(arguments);
    let value = serde_json::from_slice(&output.stdout);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(value.is_ok(), "{arguments:?}: {value:?}\nstdout: {said}\nstderr: {}", errors(&output));
    (output.status.code().unwrap_or(-1), value.unwrap())
}

/// The number at a JSON pointer; NaN where there is none.
#[must_use]
pub fn number(value: &Value, pointer: &str) -> f64 {
    value.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN)
}

/// Runs `foxhound`, which must end well, and reads its standard output as JSON, an object a line.
#[must_use]
pub fn run_json_lines(arguments: &[&str]) -> Vec<Value> {
    let output = run(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", errors(&output));
    json_lines(&output)
}

/// Standard output as JSON, an object a line.
#[must_use]
pub fn json_lines(output: &Output) -> Vec<Value> {
    let printed = std::str::from_utf8(&output.stdout).unwrap();
    printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// What a program said on its standard error.
#[must_use]
pub fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs `foxhound`, which must refuse these arguments: status 2, and nothing on standard output. What it says.
#[must_use]
pub fn refused(arguments: &[&str]) -> String {
    let output = run(arguments);
    let said = errors(&output);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{arguments:?}: {said}");
    assert!(!said.contains("panicked"), "{arguments:?}: {said}");
    said
}

/// Runs `foxhound` with each of these arguments, which it must refuse in these words.
pub fn assert_refused<'a>(before: &[&'a str], cases: &[(impl AsRef<[&'a str]>, impl AsRef<[&'a str]>)]) {
    for (arguments, words) in cases {
        let words = words.as_ref();
        let said = refused(&[before, arguments.as_ref()].concat());
        assert!(words.iter().all(|word| said.contains(word)), "{:?}: {words:?} in {said}", arguments.as_ref());
    }
}

/// What an environment variable names, which `cargo xtask test` makes.
fn made(variable: &str) -> String {
    let value = std::env::var(variable);
    assert!(value.is_ok(), "{variable} is not set: `cargo xtask test` makes what it names, and runs this test");
    value.unwrap()
}

/// The firmware image for QEMU.
#[must_use]
pub fn qemu_image() -> String {
    made("FOXHOUND_QEMU_ELF")
}

/// The image for the NUCLEO-G474RE.
#[must_use]
pub fn g474_image() -> String {
    made("FOXHOUND_G474_ELF")
}

/// The image for it that reads IQ reports.
#[must_use]
pub fn g474_iq_image() -> String {
    made("FOXHOUND_G474_IQ_ELF")
}

/// A Python with pymavlink and what else the tests need.
#[must_use]
pub fn python() -> Command {
    Command::new(made("FOXHOUND_PYTHON"))
}

/// A Python program of `tests/peers`.
#[must_use]
pub fn peer(script: &str) -> Command {
    let mut command = python();
    command.arg(root().join("tests/peers").join(script));
    command
}

/// What a program of `tests/peers`, which must end well, makes of its input.
#[must_use]
pub fn piped_through(script: &str, arguments: &[impl AsRef<OsStr>], input: Vec<u8>) -> Vec<u8> {
    let mut command = peer(script);
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut to_child = child.stdin.take().unwrap();
    let writer = std::thread::spawn(move || to_child.write_all(&input));
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{script}: {said}\n{}", errors(&output));
    writer.join().unwrap().unwrap();
    output.stdout
}

/// What a program of `tests/peers`, which must end well, says.
#[must_use]
pub fn peer_says(script: &str, arguments: &[impl AsRef<OsStr>]) -> String {
    String::from_utf8(piped_through(script, arguments, Vec::new())).unwrap()
}

/// Has a program of `tests/peers` check something, to the end; what it says.
pub fn checked_by(script: &str, arguments: &[impl AsRef<OsStr>]) -> String {
    let said = peer_says(script, arguments);
    assert!(said.contains("all checks passed"), "{script}: {said}");
    said
}

/// What a function makes of each item, on all cores; in the order of the items.
pub fn in_parallel<T: Sync, R: Send>(items: &[T], make: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let work = || {
        let at = || next.fetch_add(1, Ordering::Relaxed);
        let items = std::iter::repeat_with(at).map_while(|at| Some((at, items.get(at)?)));
        items.map(|(at, item)| (at, make(item))).collect::<Vec<_>>()
    };
    let cores = std::thread::available_parallelism().map_or(2, usize::from);
    let mut made: Vec<(usize, R)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
    });
    made.sort_by_key(|(at, _)| *at);
    made.into_iter().map(|(_, made)| made).collect()
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

/// A NumPy file of frames: codes of four channels, `n` samples each.
#[must_use]
pub fn npy_frames(codes: &[i16], n: usize) -> Vec<u8> {
    let values: Vec<u8> = codes.iter().flat_map(|code| code.to_le_bytes()).collect();
    npy("<i2", &format!("({}, 4, {n})", codes.len() / (4 * n)), &values)
}

/// The tests of a program run beside one another. Those that measure time, or start many processes, must not disturb one
/// another: they hold this, shared or alone.
static MACHINE: RwLock<()> = RwLock::new(());

/// Held by a test that may run beside others that share the machine, but not beside one that takes it.
pub fn share_machine() -> RwLockReadGuard<'static, ()> {
    // A test that failed while it held the lock has left nothing undone.
    MACHINE.read().unwrap_or_else(PoisonError::into_inner)
}

/// Held by a test beside which no other may run that shares the machine or takes it.
pub fn take_machine() -> RwLockWriteGuard<'static, ()> {
    MACHINE.write().unwrap_or_else(PoisonError::into_inner)
}

/// Sends a process a signal, as `kill` names them: `-INT`.
pub fn signal(process: u32, name: &str) {
    assert!(Command::new("kill").args([name, &process.to_string()]).status().unwrap().success(), "kill {name}");
}

/// A program beside the test, which ends with it, however that ends.
#[derive(Debug)]
pub struct Program(Child);

impl Program {
    /// Starts it with its input and output in our hands. What it says to people is dropped.
    #[must_use]
    pub fn start(command: &mut Command) -> Self {
        Self(command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap())
    }

    /// Starts it with input and output as its command has them.
    #[must_use]
    pub fn spawn(command: &mut Command) -> Self {
        Self(command.spawn().unwrap())
    }

    /// The process.
    pub const fn child(&mut self) -> &mut Child {
        &mut self.0
    }

    /// Waits for its end, and reads to it what it says.
    #[must_use]
    pub fn output(&mut self) -> Output {
        let errors = self.0.stderr.take();
        let errors = std::thread::spawn(move || all_of(errors));
        let stdout = all_of(self.0.stdout.take());
        Output { status: self.0.wait().unwrap(), stdout, stderr: errors.join().unwrap() }
    }

    /// What it says, line for line; once.
    #[must_use]
    pub fn lines(&mut self) -> Lines<BufReader<ChildStdout>> {
        BufReader::new(self.0.stdout.take().unwrap()).lines()
    }

    /// Ends its input.
    pub fn end_input(&mut self) {
        drop(self.0.stdin.take());
    }

    /// Sends it a signal.
    pub fn signal(&self, name: &str) {
        signal(self.0.id(), name);
    }

    /// Waits for its end; its exit code, or -1 where a signal ended it.
    pub fn wait(&mut self) -> i32 {
        self.0.wait().unwrap().code().unwrap_or(-1)
    }
}

fn all_of(pipe: Option<impl Read>) -> Vec<u8> {
    let mut bytes = Vec::new();
    if let Some(mut pipe) = pipe {
        pipe.read_to_end(&mut bytes).unwrap();
    }
    bytes
}

impl Drop for Program {
    fn drop(&mut self) {
        // It may have ended before.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// `foxhound autopilot`, at a TCP port of the system's choice.
#[derive(Debug)]
pub struct Autopilot {
    program: Program,
    lines: Lines<BufReader<ChildStdout>>,
    /// For `--autopilot`.
    pub address: String,
}

impl Autopilot {
    /// Starts it, with more options.
    #[must_use]
    pub fn start(more: &[&str]) -> Self {
        let listen = ["autopilot", "--json", "--listen", "tcp:127.0.0.1:0"];
        let mut program = Program::start(foxhound().args(listen).args(more));
        let mut autopilot = Self { lines: program.lines(), program, address: String::new() };
        autopilot.address = autopilot.says()["autopilot"].as_str().unwrap().to_owned();
        autopilot
    }

    fn says(&mut self) -> Value {
        serde_json::from_str(&self.lines.next().unwrap().unwrap()).unwrap()
    }

    /// Ends it by Ctrl-C; what it says of its flight.
    #[must_use]
    pub fn end(mut self) -> Value {
        self.program.signal("-INT");
        let last = self.says();
        assert!(self.program.wait() == 0 && self.lines.next().is_none());
        last
    }
}
