//! Child processes end with this program, however it ends.

use std::process::Command;

/// Has a child killed when the thread that starts it ends, also if this program is ended by SIGKILL. The child must be started on a
/// thread that lives as long as it is needed. On systems other than Linux the child ends when it is dropped, or when it reads the end
/// of its input.
pub(super) fn ends_with_us(command: &mut Command) -> &mut Command {
    #[cfg(target_os = "linux")]
    bind(command);
    command
}

#[cfg(target_os = "linux")]
#[expect(unsafe_code, reason = "what runs between fork and exec is two system calls, without memory of our own")]
fn bind(command: &mut Command) {
    use std::os::unix::process::CommandExt as _;

    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    let parent = rustix::process::getpid();
    let bind = move || {
        set_parent_process_death_signal(Some(Signal::KILL))?;
        // The parent may have ended before that.
        if getppid() == Some(parent) { Ok(()) } else { Err(std::io::ErrorKind::BrokenPipe.into()) }
    };
    // SAFETY: between fork and exec only functions may be called that are safe in a signal handler. The closure makes two
    // system calls; it takes no lock, and neither it nor the errors that it returns allocate.
    unsafe {
        command.pre_exec(bind);
    }
}
