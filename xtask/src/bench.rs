//! Instruction counts of the stages: the firmware's bench image in QEMU.
//!
//! The image measures itself and the crates that do the same work, and compares the target's kernels with the portable
//! ones (its own documentation says in which lines). A row above its ceiling fails the run.
//!
//! CMSIS-DSP is no part of the image: its counts are those of commit ec1bb752, `-O3`, linked with Rust kernels into one
//! image and counted the same way, with scaling, copies and four arctangents (which add some 370 instructions) included.

use std::fmt::Write as _;

use crate::board;
use crate::build::Image;
use crate::{Failure, qemu};

/// CMSIS-DSP routines, four channels of 256 samples, and their instructions.
const CMSIS_DSP: [(&str, u32); 4] =
    [("rfft_q15x4", 45_311), ("rfft_fast_f32x4", 51_791), ("cfft_q15x2_packed", 29_985), ("dot_prod_q15x8", 5_588)];

/// Builds the bench image, runs it, and prints what it counted.
pub(crate) fn run() -> Result<(), Failure> {
    let image = Image::build(board::TWIN, "bench")?;
    let output = qemu(&image)
        .args(["-serial", "null"])
        .output()
        .map_err(|error| Failure(format!("qemu-system-arm cannot be started: {error}")))?;
    let text = String::from_utf8_lossy(&output.stdout);
    if !output.status.success() {
        let why = String::from_utf8_lossy(&output.stderr);
        return Err(Failure(format!("the bench image ended with {}: {text}{why}", output.status)));
    }
    let report = Report::parse(&text)?;
    print!("{}", report.table());
    let over: Vec<&str> = report.rows.iter().filter(|row| row.is_over()).map(|row| row.name).collect();
    if over.is_empty() { Ok(()) } else { Err(Failure(format!("above the ceiling: {}", over.join(", ")))) }
}

/// What the image printed.
#[derive(Default)]
struct Report<'a> {
    rows: Vec<Row<'a>>,
    /// Number of 32-bit words on which the kernels agree.
    equal_words: Option<u64>,
}

/// One measured quantity.
struct Row<'a> {
    name: &'a str,
    quantity: Quantity,
    value: u64,
    ceiling: Option<u64>,
    /// Crates that do the same work.
    peers: Vec<(&'a str, u64)>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Instructions,
    /// Rms error in millionths of a degree.
    Error,
}

impl<'a> Report<'a> {
    fn parse(text: &'a str) -> Result<Self, Failure> {
        let mut report = Self::default();
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            report.take(&words).ok_or_else(|| Failure(format!("the bench image printed {line:?}")))?;
        }
        if report.rows.is_empty() || report.equal_words.unwrap_or(0) == 0 {
            return Err(Failure("the bench image did not measure, or did not compare the kernels".to_owned()));
        }
        Ok(report)
    }

    fn take(&mut self, words: &[&'a str]) -> Option<()> {
        let number = |word: &str| word.parse::<u64>().ok();
        match *words {
            ["equal", count] => self.equal_words = Some(number(count)?),
            ["peer", name, whose, count] => {
                let row = self.rows.iter_mut().find(|row| row.name == name)?;
                row.peers.push((whose, number(count)?));
            }
            [kind @ ("count" | "error"), name, value, ceiling] => {
                let quantity = if kind == "count" { Quantity::Instructions } else { Quantity::Error };
                let ceiling = Some(number(ceiling)?).filter(|ceiling| *ceiling > 0);
                self.rows.push(Row { name, quantity, value: number(value)?, ceiling, peers: Vec::new() });
            }
            _ => return None,
        }
        Some(())
    }

    fn table(&self) -> String {
        let mut text = String::new();
        let _ = writeln!(text, "kernels equal on {} words", self.equal_words.unwrap_or(0));
        for row in &self.rows {
            let mark = if row.is_over() { "  ABOVE ITS CEILING" } else { "" };
            let number = |value: u64| match row.quantity {
                Quantity::Instructions => value.to_string(),
                Quantity::Error => format!("{:.4} deg", value as f64 * 1e-6),
            };
            let ceiling = row.ceiling.map_or_else(String::new, |ceiling| format!("of {:>10}", number(ceiling)));
            let line = format!("{:<26} {:>10} {ceiling:<13}{mark}", row.name, number(row.value));
            let _ = writeln!(text, "{}", line.trim_end());
            for (whose, count) in &row.peers {
                let _ = writeln!(text, "    {whose:<22} {count:>10} {:>6.1} x", *count as f64 / row.value as f64);
            }
            for (whose, count) in row.cmsis_dsp() {
                let name = format!("CMSIS {whose}");
                let ratio = f64::from(*count) / row.value as f64;
                let _ = writeln!(text, "    {name:<22} {count:>10} {ratio:>6.1} x  (reference)");
            }
        }
        text
    }
}

impl Row<'_> {
    fn is_over(&self) -> bool {
        self.ceiling.is_some_and(|ceiling| self.value > ceiling)
    }

    /// The routines that do this row's work: all find phasors, the transforms find a spectrum too.
    fn cmsis_dsp(&self) -> &'static [(&'static str, u32)] {
        match self.name {
            "phasors" | "phasors_and_phases" => &CMSIS_DSP,
            "spectrum" => CMSIS_DSP.split_last().map_or(&[], |(_, transforms)| transforms),
            _ => &[],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINES: &str = "equal 8\ncount phasors 2000 1900\npeer phasors microfft 9000\nerror a 4 5\ncount b 7 0";

    #[test]
    fn a_row_above_its_ceiling_is_marked_and_has_its_peers_below_it() {
        let report = Report::parse(LINES).unwrap();
        assert_eq!(report.rows.iter().map(Row::is_over).collect::<Vec<_>>(), [true, false, false]);
        let table = report.table();
        for part in ["phasors", "ABOVE", "microfft", "9000", "CMSIS dot_prod_q15x8", "5588"] {
            assert!(table.contains(part), "{part}: {table}");
        }
    }

    #[test]
    fn output_without_the_comparison_of_kernels_or_with_other_lines_is_refused() {
        for text in ["", "count a 1 2", "equal 0\ncount a 1 2", "equal 8\ncount a 1", "equal 8\npeer a b 1", "hello"] {
            assert!(Report::parse(text).is_err(), "{text:?}");
        }
    }
}
