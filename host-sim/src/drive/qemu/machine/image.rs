//! Checks whether a file is a firmware image for the twin.

use std::path::Path;

use object::{Object as _, ObjectSection as _, ObjectSegment as _};

use super::super::error::{BOARD, QemuError};

const BOARD_SECTION: &str = ".foxhound_board";
/// The twin's memories for program and data: QEMU's, not the smaller ones that the linker may use.
const MEMORIES: [std::ops::Range<u64>; 2] = [0..0x0040_0000, 0x2000_0000..0x2040_0000];

/// Refuses every file that is not a firmware image for the twin, and reports what it is.
pub(super) fn check_image(path: &Path) -> Result<(), QemuError> {
    let refuse = |why: String| QemuError::Image { path: path.to_owned(), why };
    let bytes = std::fs::read(path).map_err(|error| refuse(format!("it cannot be read ({error})")))?;
    let image = object::File::parse(bytes.as_slice()).map_err(|_| refuse("it is not an ELF file".to_owned()))?;
    if image.format() != object::BinaryFormat::Elf
        || image.architecture() != object::Architecture::Arm
        || image.is_64()
        || !image.is_little_endian()
    {
        let bits = if image.is_64() { 64 } else { 32 };
        return Err(refuse(format!("it is a {bits}-bit {:?} file for {:?}", image.format(), image.architecture())));
    }
    if image.kind() != object::ObjectKind::Executable {
        return Err(refuse("it is an Arm file, but not an executable".to_owned()));
    }
    if let Some(section) = image.section_by_name(BOARD_SECTION) {
        let name = section.data().unwrap_or_default();
        if name != BOARD.as_bytes() {
            return Err(refuse(format!("it is for the board {}", String::from_utf8_lossy(name))));
        }
    } else {
        return Err(refuse(format!("it is an Arm executable, but not of Foxhound (no {BOARD_SECTION} section)")));
    }
    let inside = |start: u64, end: u64| MEMORIES.iter().any(|memory| memory.contains(&start) && end <= memory.end);
    for segment in image.segments().filter(|segment| segment.size() > 0) {
        let (start, end) = (segment.address(), segment.address() + segment.size());
        if !inside(start, end) {
            return Err(refuse(format!("it needs memory at {start:#010x}..{end:#010x}, where the board has none")));
        }
    }
    if !inside(image.entry(), image.entry() + 1) {
        return Err(refuse(format!("it starts at {:#010x}, where the board has no memory", image.entry())));
    }
    Ok(())
}
