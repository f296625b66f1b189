//! What a test has left behind: QEMU processes, and their folders, of programs that are gone.

use std::path::Path;

use crate::Failure;

/// How the folder of a QEMU begins, before the process that made it (`host-sim/src/drive/qemu/folder.rs`).
const PREFIX: &str = "foxhound-qemu-";

/// Fails where a QEMU runs, or a folder of one lies in the temporary folder, whose program is gone.
pub(crate) fn check() -> Result<(), Failure> {
    let mut left = Vec::new();
    for entry in std::fs::read_dir("/proc").into_iter().flatten().flatten() {
        let line = std::fs::read(entry.path().join("cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line).replace('\0', " ");
        if line.starts_with("qemu-system-arm ") && owner(&line).is_some_and(is_gone) {
            left.push(format!("process {}: {line}", entry.file_name().display()));
        }
    }
    for entry in std::fs::read_dir(std::env::temp_dir()).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(PREFIX)
            && owner(&entry.file_name().to_string_lossy()).is_some_and(is_gone)
        {
            left.push(entry.path().display().to_string());
        }
    }
    if left.is_empty() { Ok(()) } else { Err(Failure(format!("left behind:\n{}", left.join("\n")))) }
}

/// The process in the name of the folder that a text names.
fn owner(text: &str) -> Option<u32> {
    let (_, rest) = text.split_once(PREFIX)?;
    rest.split_once('-')?.0.parse().ok()
}

fn is_gone(process: u32) -> bool {
    !Path::new("/proc").join(process.to_string()).exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_owner_of_a_folder_is_in_its_name() {
        let line = "qemu-system-arm -object memory-backend-file,id=ram,mem-path=/tmp/foxhound-qemu-4711-3/memory";
        assert_eq!((owner(line), owner("foxhound-qemu-12-0"), owner("foxhound-12")), (Some(4711), Some(12), None));
        assert!(!is_gone(std::process::id()));
    }
}
