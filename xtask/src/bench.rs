//! Instruction counts of the rooms: the firmware's bench image in QEMU.
//!
//! The image measures itself (see its own documentation) and prints a line a row: name, instructions, ceiling.

use serde_json::json;

use crate::build::Image;
use crate::{Board, Failure, qemu};

/// Builds the bench image, runs it, and prints what it counted.
pub(crate) fn run(json: bool) -> Result<(), Failure> {
    let image = Image::build(Board::Mps2An386, "bench")?;
    let output = qemu(&image)
        .args(["-serial", "null"])
        .output()
        .map_err(|error| Failure(format!("qemu-system-arm cannot be started: {error}")))?;
    let text = String::from_utf8_lossy(&output.stdout);
    if !output.status.success() {
        let why = String::from_utf8_lossy(&output.stderr);
        return Err(Failure(format!("the bench image ended with {}: {text}{why}", output.status)));
    }
    let rows = text.lines().map(row).collect::<Result<Vec<_>, _>>()?;
    if json {
        let rows: Vec<_> = rows
            .iter()
            .map(|row| json!({"name": row.name, "instructions": row.instructions, "ceiling": row.ceiling}))
            .collect();
        println!("{}", json!({ "rows": rows }));
    } else {
        for row in rows {
            let ceiling = row.ceiling.map_or_else(String::new, |ceiling| format!("of {ceiling:>9}"));
            println!("{:<24} {:>9} {ceiling}", row.name, row.instructions);
        }
    }
    Ok(())
}

struct Row<'a> {
    name: &'a str,
    instructions: u32,
    ceiling: Option<u32>,
}

fn row(line: &str) -> Result<Row<'_>, Failure> {
    let bad = || Failure(format!("the bench image printed {line:?}"));
    let mut words = line.split_whitespace();
    let name = words.next().ok_or_else(bad)?;
    let mut number = || -> Result<u32, Failure> { words.next().and_then(|word| word.parse().ok()).ok_or_else(bad) };
    let (instructions, ceiling) = (number()?, number()?);
    Ok(Row { name, instructions, ceiling: (ceiling > 0).then_some(ceiling) })
}
