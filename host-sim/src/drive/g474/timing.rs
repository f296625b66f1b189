//! A table of the use of the board's time.

use std::fmt::Write as _;

use serde_json::Value;

/// From one frame to the next.
const PERIOD_MS: f64 = 19.998;
/// The watchdog restarts the board if it is not fed for this long.
const WATCHDOG_MS: f64 = 500.0;

/// The answer of [`Board::timing`](super::Board::timing) as Markdown.
#[must_use]
pub fn table(timing: &Value) -> String {
    let number = |value: &Value| value.as_f64().unwrap_or_default();
    let hclk_mhz = number(&timing["hclk_hz"]) / 1e6;
    let (base, stall) = (&timing["cycles_per_instruction"], &timing["flash_stall_per_instruction"]);
    let entry = &timing["exception_cycles"];
    let mut text = format!(
        "Cycles are instructions, counted, times {base}, and {stall} more for the flash (both assumed: no board has measured \
         them);\n{entry} for an exception each way. {hclk_mhz} MHz.\n\n\
         | in a frame of {PERIOD_MS} ms | least, cycles | mean | most | mean share | most share |\n|---|---|---|---|---|---|\n"
    );
    let frame_cycles = hclk_mhz * 1e3 * PERIOD_MS;
    for name in ["guidance", "link", "planner", "interrupts", "sleep"] {
        let [least, mean, most] = ["least", "mean", "most"].map(|key| number(&timing["per_frame"][name][key]));
        let [mean_share, most_share] = [mean, most].map(|cycles| 100.0 * cycles / frame_cycles);
        let _ =
            writeln!(text, "| {name} | {least:.0} | {mean:.0} | {most:.0} | {mean_share:.2} % | {most_share:.2} % |");
    }
    text.push_str("\n| from its start to its end, without what interrupts it | times | least, cycles | mean | most | most, ms |\n");
    text.push_str("|---|---|---|---|---|---|\n");
    for name in ["guidance", "link", "planner"] {
        let row = &timing["per_activation"][name];
        let [count, least, mean, most] = ["count", "least", "mean", "most"].map(|key| number(&row[key]));
        let most_ms = most / hclk_mhz / 1e3;
        let _ = writeln!(text, "| {name} | {count:.0} | {least:.0} | {mean:.0} | {most:.0} | {most_ms:.2} |");
    }
    let longest_ms = number(&timing["watchdog_longest_us"]) / 1e3;
    let _ = write!(text, "\nLongest time between two feeds of the watchdog: {longest_ms:.1} ms of {WATCHDOG_MS:.0}.");
    text
}
