//! The boards of the firmware: those that have a memory map in `firmware/src/boards`, as its `build.rs` sees them.

use crate::Failure;
use crate::build::workspace;

/// The board that flies.
pub(crate) const NUCLEO: &str = "nucleo_g474re";
/// The twin in QEMU.
pub(crate) const TWIN: &str = "mps2_an386";

/// Their names, in order.
pub(crate) fn all() -> Result<Vec<String>, Failure> {
    let folder = workspace().join("firmware/src/boards");
    let unreadable = |error| Failure(format!("{}: {error}", folder.display()));
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&folder).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        if entry.path().join("memory.x").exists() {
            names.push(entry.file_name().to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

/// A board by its name.
pub(crate) fn named(name: &str) -> Result<String, String> {
    let names = all().map_err(|failure| failure.to_string())?;
    names.iter().find(|known| *known == name).cloned().ok_or_else(|| format!("the boards are {}", names.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_board_has_a_file_a_memory_map_and_a_feature() {
        let boards = all().unwrap();
        for known in [NUCLEO, TWIN, "example"] {
            assert_eq!(named(known).as_deref(), Ok(known));
        }
        assert_eq!(named("host"), Err(format!("the boards are {}", boards.join(", "))));
        let manifest = std::fs::read_to_string(workspace().join("firmware/Cargo.toml")).unwrap();
        let features: Vec<&str> = manifest
            .lines()
            .filter_map(|line| line.strip_prefix("board-")?.split_once(" =").map(|(name, _)| name))
            .collect();
        for board in &boards {
            assert!(workspace().join(format!("firmware/src/boards/{board}.rs")).exists(), "{board}");
            assert!(features.contains(&board.as_str()), "{board}");
        }
        assert_eq!(features.len(), boards.len(), "{features:?}");
    }
}
