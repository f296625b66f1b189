//! The process of QEMU and the lines to it, on Linux.

use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::FileExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant as WallInstant};

use foxhound_computer::twin::{self, BLOCK_BYTES, Fault, Ready, Report, Setup, Step};
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::FrontEnd;

use super::{QemuError, Worst};
use crate::drive::child::ends_with_us;
use crate::drive::computer::{BLOCK, StepReport};

mod folder;
mod image;
mod port;

use folder::{Console, Folder};
use image::check_image;
use port::Port;

/// Time limit of one answer. A replan takes a fraction of a second.
const PATIENCE: Duration = Duration::from_secs(20);
/// The autopilot's bytes that a step takes at most: what its line carries in that time, twice. More is said in the next steps.
const SAY_MAX_BYTES: usize = 4096;
const _: () = assert!(SAY_MAX_BYTES <= twin::LINE_BYTES, "they fit");
/// Time until we check whether the firmware waits for us.
const LOOK_ROUND: Duration = Duration::from_millis(20);

/// The firmware, running in QEMU.
#[derive(Debug)]
pub struct QemuComputer {
    qemu: Child,
    console: Console,
    memory: File,
    mavlink: UnixStream,
    bell: UnixStream,
    /// The autopilot's bytes go through the memory.
    is_quick: bool,
    /// Those for which there was no room in the last step.
    waiting: Vec<u8>,
    sequence: u32,
    rx_total: u32,
    tx_total: u32,
    /// Bytes of camera frames since its last start, and of those that went through the memory.
    camera_total: u32,
    camera_laid: u32,
    /// Bytes of the sensor since its last start.
    sensor_total: u32,
    /// Frames are sent on the serial line, byte by byte, as on a board.
    camera_by_line: bool,
    /// MAVLink bytes that were read from the socket before the end of their step.
    drained: Vec<u8>,
    /// Late steps since its last start.
    late_steps: u32,
    /// The fault of the next step.
    fault: Option<Fault>,
    worst: Worst,
    port: Port,
}

impl QemuComputer {
    /// Boots an image and sets it up.
    ///
    /// # Errors
    /// [`QemuError::Image`] for a file that is not an image of this board; [`QemuError::Refused`] for a configuration
    /// that
    /// does not build.
    pub fn start(elf: &Path, setup: &Setup) -> Result<Self, QemuError> {
        Self::boot(elf, setup, false)
    }

    /// The same for long flights, several times faster: the autopilot's bytes go through the memory instead of UART0,
    /// and the maintenance port is not connected.
    ///
    /// # Errors
    /// As of [`start`](Self::start).
    pub fn start_quick(elf: &Path, setup: &Setup) -> Result<Self, QemuError> {
        Self::boot(elf, setup, true)
    }

    fn boot(elf: &Path, setup: &Setup, is_quick: bool) -> Result<Self, QemuError> {
        check_image(elf)?;
        let folder = Folder::create()?;
        let memory_path = folder.file("memory");
        let memory = folder.create_file("memory")?;
        let console = Console::create(&folder)?;
        let [stdout, stderr] = console.handles()?;
        memory.set_len(16 << 20)?;
        let listen = |name| UnixListener::bind(folder.file(name));
        let (mavlink, bell) = (listen("mavlink")?, listen("bell")?);
        let port = Port::create(&folder)?;

        let socket = |id: &str| format!("socket,id={id},path={}", folder.file(id).display());
        let port_line = if is_quick {
            "null,id=port".to_owned()
        } else {
            format!("pipe,id=port,path={}", folder.file("port").display())
        };
        let mut command = Command::new("qemu-system-arm");
        command
            .args(["-M", "mps2-an386,memory-backend=ram", "-display", "none", "-monitor", "none", "-nic", "none"])
            .args(["-icount", "shift=8", "-semihosting-config", "enable=on,target=native"])
            .arg("-object")
            .arg(format!("memory-backend-file,id=ram,size=16M,share=on,mem-path={}", memory_path.display()))
            .args(["-chardev", &socket("mavlink"), "-serial", "chardev:mavlink"])
            .args(["-chardev", &socket("bell"), "-serial", "chardev:bell"])
            .args(["-chardev", &port_line])
            .args(["-serial", "chardev:port"])
            .arg("-kernel")
            .arg(elf)
            .stdin(Stdio::null())
            .stdout(stdout)
            .stderr(stderr);
        let mut qemu = ends_with_us(&mut command).spawn().map_err(QemuError::Start)?;
        keep_together(&qemu);
        let connected = accept(&mavlink, &mut qemu).and_then(|mavlink| Ok((mavlink, accept(&bell, &mut qemu)?)));
        let (mavlink, bell) = match connected {
            Ok(connected) => connected,
            Err(error) => {
                // It may be gone already.
                let _ = qemu.kill();
                let _ = qemu.wait();
                return Err(QemuError::Lost { what: format!("QEMU did not start: {error}"), console: console.text() });
            }
        };
        mavlink.set_read_timeout(Some(PATIENCE))?;
        bell.set_read_timeout(Some(LOOK_ROUND))?;

        let mut computer = Self {
            qemu,
            console,
            memory,
            mavlink,
            bell,
            is_quick,
            waiting: Vec::new(),
            sequence: 0,
            rx_total: 0,
            tx_total: 0,
            camera_total: 0,
            camera_laid: 0,
            sensor_total: 0,
            camera_by_line: false,
            drained: Vec::new(),
            late_steps: 0,
            fault: None,
            worst: Worst::default(),
            port,
        };
        computer.await_boot()?;
        // QEMU has opened all its files.
        drop(folder);
        computer.set_up(setup)?;
        Ok(computer)
    }

    /// Injects a fault into the next step.
    pub fn inject(&mut self, fault: Fault) {
        self.fault = Some(fault);
    }

    /// The worst values since it was started.
    #[must_use]
    pub const fn worst(&self) -> Worst {
        self.worst
    }

    /// Late steps since its last start.
    #[must_use]
    pub const fn late_steps(&self) -> u32 {
        self.late_steps
    }

    /// Reads the memory that is shared with the firmware, which survives its resets.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read_memory(&self, bytes: &mut [u8], at: usize) -> io::Result<()> {
        self.memory.read_exact_at(bytes, at as u64)
    }

    /// Writes into the memory that is shared with the firmware.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_memory(&self, bytes: &[u8], at: usize) -> io::Result<()> {
        self.memory.write_all_at(bytes, at as u64)
    }

    /// After [`QemuError::Restarted`]: sets it up again. Bytes that it had sent meanwhile are lost, and so are those
    /// in transmission.
    ///
    /// # Errors
    /// As of [`set_up`](Self::set_up).
    pub fn recover(&mut self, setup: &Setup) -> Result<(), QemuError> {
        (self.rx_total, self.tx_total, self.late_steps) = (0, 0, 0);
        self.waiting.clear();
        (self.camera_total, self.camera_laid, self.sensor_total) = (0, 0, 0);
        self.write_setup(setup)?;
        let block = self.ring(twin::SETUP)?;
        let ready: Ready =
            twin::read_record(&block).map_err(|error| self.lost(format!("the answer to the setup: {error}")))?;
        self.drain()?;
        self.drained.clear();
        (self.sequence, self.tx_total) = (0, ready.tx_total);
        Ok(())
    }

    fn await_boot(&mut self) -> Result<(), QemuError> {
        match self.answer()? {
            twin::BOOTED => Ok(()),
            other => Err(self.lost(format!("the firmware's first byte is {other:#04x}"))),
        }
    }

    /// Starts the firmware's guidance and link anew.
    ///
    /// # Errors
    /// [`QemuError::Refused`] for a configuration that does not build: the old one goes on.
    pub fn set_up(&mut self, setup: &Setup) -> Result<(), QemuError> {
        self.write_setup(setup)?;
        let block = self.ring(twin::SETUP)?;
        let ready: Ready =
            twin::read_record(&block).map_err(|error| self.lost(format!("the answer to the setup: {error}")))?;
        // Bytes that it sent while it ran freely belong to no step.
        self.take_sent(ready.tx_total)?;
        self.sequence = 0;
        Ok(())
    }

    fn write_setup(&mut self, setup: &Setup) -> Result<(), QemuError> {
        let mut block = [0; BLOCK_BYTES];
        twin::write_record(&mut block, setup).map_err(|error| self.lost(format!("the setup: {error}")))?;
        self.write_rx_total()?;
        self.write_camera_total()?;
        self.write_sensor_total()?;
        Ok(self.write_memory(&block, twin::SETUP_AT)?)
    }

    /// One step of the fast loop. `rx` are the bytes that the autopilot has sent since the last step.
    ///
    /// # Errors
    /// When the firmware does not answer.
    pub fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, QemuError> {
        self.port.settle();
        self.say(rx)?;
        self.sequence = self.sequence.wrapping_add(1);
        let step = Step {
            sequence: self.sequence,
            now,
            rx_expected: self.rx_total,
            camera_expected: self.camera_total,
            sensor_expected: self.sensor_total,
            front_end,
            circles,
            fault: self.fault.take(),
        };
        let is_stolen = matches!(step.fault, Some(Fault::Steal { .. }));
        let mut block = [0; BLOCK_BYTES];
        step.encode(&mut block).map_err(|error| self.lost(format!("the step: {error}")))?;
        self.write_memory(&block, twin::STEP_AT)?;
        let block = self.ring(twin::FRAME)?;
        let report: Report = twin::read_record(&block).map_err(|error| self.lost(format!("the report: {error}")))?;
        if report.sequence != self.sequence {
            return Err(self.lost(format!("step {} was answered with step {}", self.sequence, report.sequence)));
        }
        let tx = self.take_sent(report.tx_total)?;
        self.port.drain()?;
        self.late_steps = report.late;
        self.worst.add(Worst {
            // The instructions of a storm are not guidance's.
            fast_instructions: if is_stolen { 0 } else { twin::instructions(report.fast_ticks) },
            plan_instructions: report.plan.as_ref().map_or(0, |plan| twin::instructions(plan.ticks)),
            stack_bytes: report.stack_bytes,
            late_steps: report.late,
        });
        Ok(StepReport { output: report.output, tx, plan: report.plan })
    }

    /// Sends camera frames on the maintenance port's serial line from now on, not through the shared memory: that
    /// takes QEMU a second per frame.
    pub fn put_camera_on_line(&mut self) {
        self.camera_by_line = true;
    }

    /// Passes bytes of camera frames to it, which it will have processed before the next step.
    ///
    /// # Errors
    /// They are more than fit, or QEMU is gone.
    pub fn see(&mut self, bytes: &[u8]) -> Result<(), QemuError> {
        self.camera_total = self.camera_total.wrapping_add(bytes.len() as u32);
        if self.camera_by_line {
            return Ok(self.port.write_patiently(bytes)?);
        }
        let at = self.camera_laid;
        self.camera_laid = self.camera_laid.wrapping_add(bytes.len() as u32);
        self.lay(bytes, at, twin::PORT_AT, twin::PORT_BYTES)?;
        Ok(self.write_camera_total()?)
    }

    /// Passes bytes of a lidar, or of a radio, to it, which it will have received before the next step.
    ///
    /// # Errors
    /// They are more than fit, or QEMU is gone.
    pub fn turn(&mut self, bytes: &[u8]) -> Result<(), QemuError> {
        let at = self.sensor_total;
        self.sensor_total = self.sensor_total.wrapping_add(bytes.len() as u32);
        self.lay(bytes, at, twin::SENSOR_AT, twin::SENSOR_BYTES)?;
        Ok(self.write_sensor_total()?)
    }

    /// Passes the autopilot's bytes to it.
    fn say(&mut self, rx: &[u8]) -> Result<(), QemuError> {
        let at = self.rx_total;
        if !self.is_quick {
            self.rx_total = at.wrapping_add(rx.len() as u32);
            return Ok(self.mavlink.write_all(rx)?);
        }
        self.waiting.extend_from_slice(rx);
        let later = self.waiting.split_off(self.waiting.len().min(SAY_MAX_BYTES));
        let now = std::mem::replace(&mut self.waiting, later);
        self.rx_total = at.wrapping_add(now.len() as u32);
        self.lay(&now, at, twin::LINE_AT, twin::LINE_BYTES)?;
        Ok(self.write_rx_total()?)
    }

    /// Writes bytes into a ring of the shared memory, after `laid` bytes before them.
    fn lay(&mut self, bytes: &[u8], laid: u32, ring_at: usize, ring_bytes: usize) -> Result<(), QemuError> {
        if bytes.len() > ring_bytes {
            return Err(self.lost(format!("{} bytes are more than a step can take", bytes.len())));
        }
        let at = laid as usize % ring_bytes;
        let (before, after) = bytes.split_at(bytes.len().min(ring_bytes - at));
        self.write_memory(before, ring_at + at)?;
        Ok(self.write_memory(after, ring_at)?)
    }

    fn write_sensor_total(&self) -> io::Result<()> {
        self.write_memory(&self.sensor_total.to_le_bytes(), twin::SENSOR_TOTAL_AT)
    }

    fn write_rx_total(&self) -> io::Result<()> {
        let total = if self.is_quick { self.rx_total } else { 0 };
        self.write_memory(&total.to_le_bytes(), twin::LINE_TOTAL_AT)
    }

    fn write_camera_total(&self) -> io::Result<()> {
        self.write_memory(&self.camera_laid.to_le_bytes(), twin::PORT_TOTAL_AT)
    }

    /// Rings the doorbell, waits for the answer, and reads the report block.
    fn ring(&mut self, bell: u8) -> Result<twin::Block, QemuError> {
        self.bell.write_all(&[bell])?;
        let answer = self.answer()?;
        let mut block = [0; BLOCK_BYTES];
        self.read_memory(&mut block, twin::REPORT_AT)?;
        match answer {
            twin::DONE => Ok(block),
            twin::BOOTED => Err(QemuError::Restarted),
            twin::REFUSED => match twin::decode_refusal(&block) {
                Ok(reason) => Err(QemuError::Refused(reason.to_owned())),
                Err(error) => Err(self.lost(format!("the firmware refused, and the reason is lost: {error}"))),
            },
            other => Err(self.lost(format!("the firmware answered {other:#04x}"))),
        }
    }

    /// Waits for a byte on the doorbell's line.
    fn answer(&mut self) -> Result<u8, QemuError> {
        let mut answer = [0];
        let begin = WallInstant::now();
        while let Err(error) = self.bell.read_exact(&mut answer) {
            let waits = matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut);
            if !waits || begin.elapsed() > PATIENCE {
                return Err(self.lost(format!("the firmware does not answer ({error})")));
            }
            // QEMU sends byte by byte, and a socket holds fewer than 300 such writes: make space, or it waits for us.
            self.drain()?;
            self.port.drain()?;
        }
        Ok(answer[0])
    }

    /// Reads what is in the MAVLink socket.
    fn drain(&mut self) -> io::Result<()> {
        let mut bytes = [0; 1024];
        self.mavlink.set_nonblocking(true)?;
        let outcome = loop {
            match self.mavlink.read(&mut bytes) {
                Ok(0) => break Ok(()),
                Ok(count) => self.drained.extend_from_slice(&bytes[..count]),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break Ok(()),
                Err(error) => break Err(error),
            }
        };
        self.mavlink.set_nonblocking(false)?;
        outcome
    }

    /// The firmware's bytes since the last call, up to its own count.
    fn take_sent(&mut self, tx_total: u32) -> Result<Vec<u8>, QemuError> {
        let mut sent = std::mem::take(&mut self.drained);
        let drained = sent.len();
        sent.resize((tx_total.wrapping_sub(self.tx_total) as usize).max(drained), 0);
        if let Err(error) = self.mavlink.read_exact(&mut sent[drained..]) {
            return Err(self.lost(format!("{} bytes of MAVLink are missing ({error})", sent.len() - drained)));
        }
        self.tx_total = tx_total;
        Ok(sent)
    }

    fn lost(&mut self, what: String) -> QemuError {
        let what = match self.qemu.try_wait() {
            Ok(Some(status)) => format!("{what}; QEMU has ended with {status}"),
            _ => what,
        };
        QemuError::Lost { what, console: self.console.text() }
    }
}

impl Drop for QemuComputer {
    fn drop(&mut self) {
        // It may be gone already.
        let _ = self.qemu.kill();
        let _ = self.qemu.wait();
    }
}

/// Keeps QEMU's threads on our processor. They work strictly in turn, and waking a thread on the same processor takes
/// a sixth of the time that it takes on another one that sleeps.
fn keep_together(qemu: &Child) {
    use rustix::thread::{CpuSet, Pid, sched_getcpu, sched_setaffinity};
    let mut here = CpuSet::new();
    here.set(sched_getcpu());
    if let Some(pid) = i32::try_from(qemu.id()).ok().and_then(Pid::from_raw) {
        // Only the speed depends on it.
        let _ = sched_setaffinity(Some(pid), &here);
    }
}

/// Waits until QEMU connects, or has ended.
fn accept(listener: &UnixListener, qemu: &mut Child) -> io::Result<UnixStream> {
    listener.set_nonblocking(true)?;
    let begin = WallInstant::now();
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                stream.set_nonblocking(false)?;
                return Ok(stream);
            }
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
        if let Some(status) = qemu.try_wait()? {
            return Err(io::Error::other(format!("it has ended with {status}")));
        }
        if begin.elapsed() > PATIENCE {
            return Err(io::ErrorKind::TimedOut.into());
        }
        sleep(Duration::from_millis(2));
    }
}
