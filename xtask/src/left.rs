//! Finds QEMU processes and folders that tests have left behind.

use std::path::Path;

use crate::Failure;

/// Prefix of a QEMU folder's name, before the number of the process that made it (`host-sim/src/drive/qemu/machine/folder.rs`).
const PREFIX: &str = "foxhound-qemu-";

/// Fails if a QEMU process, or its folder in the temporary folder, is left from a program that has ended.
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

/// The process number in a folder's name.
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
