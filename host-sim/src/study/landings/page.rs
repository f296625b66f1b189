//! Flights to their very end, on held-out seeds: the page `docs/results/landings.md`. With `development`, on development seeds.

use std::fmt::Write as _;

use super::{Row, SCENES, row};
use crate::scenario::input::InputError;
use crate::study::{Campaign, seeds};

/// Flies all of it and writes the page.
///
/// # Errors
/// A scenario is refused, or a flight cannot be flown.
pub fn page(settings: &Campaign) -> Result<String, InputError> {
    let &Campaign { flights, is_development, tell } = settings;
    let (range, seeds) =
        if is_development { ("development", seeds::development(flights)) } else { ("test", seeds::test(flights)) };
    let mut text = format!(
        "# Landings\n\n\
         `cargo xtask landings` writes this page. [The last metres](../landing.md) says what is flown. Flights have the first\n\
         seeds of the {range} range ({}): `host-sim/src/study/seeds.rs`.\n\n\
         | scene | flights | collisions | on the pad, to 0.15 m | beside it | handed over (within 1.5 m of the beacon) \
         | unfinished | from the pad's middle, m: median, 99 %, most | mean time, s |\n|---|---|---|---|---|---|---|---|---|\n",
        seeds.start,
    );
    let mut named = String::new();
    for scene in &SCENES {
        tell(scene.name);
        let row = row(scene, seeds.clone())?;
        line(&mut text, &row);
        for (what, seeds) in [("collided", &row.collided), ("beside", &row.beside), ("unfinished", &row.unfinished)] {
            if !seeds.is_empty() {
                let _ = writeln!(named, "\n{}: {what} with the seeds {seeds:?}.", row.scene);
            }
        }
    }
    Ok(text + &named)
}

fn line(text: &mut String, row: &Row) {
    let handed_over: Vec<String> =
        row.handed_over.iter().map(|(reason, [all, near])| format!("`{reason}` {all} ({near})")).collect();
    let pad_m = row.pad_m.map_or("-".to_owned(), |[median, most, all]| format!("{median:.3}, {most:.3}, {all:.3}"));
    let _ = writeln!(
        text,
        "| {} | {} | {} | {} | {} | {} | {} | {pad_m} | {:.1} |",
        row.scene,
        row.flights,
        row.collided.len(),
        row.on_pad,
        row.beside.len(),
        handed_over.join(", "),
        row.unfinished.len(),
        row.time_s
    );
}
