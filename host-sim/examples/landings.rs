//! Flights to their very end; prints the table of `docs/landing.md`. `cargo xtask landings` runs it. So many of each scene,
//! and only where the name contains the second argument.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::process::ExitCode;

use foxhound_sim::landings::{SCENES, row};

/// The first seed: the landing's constants were chosen on others.
const FROM: u64 = 2001;

fn main() -> ExitCode {
    let flights: u64 = std::env::args().nth(1).and_then(|flights| flights.parse().ok()).unwrap_or(200);
    let only = std::env::args().nth(2).unwrap_or_default();
    println!(
        "| scene | flights | collisions | on the pad, to 0.15 m | beside it | handed over (within 1.5 m of the beacon) | unfinished | from the pad's middle, m: median, 99 %, most | mean time, s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for scene in SCENES.iter().filter(|scene| scene.name.contains(&only)) {
        match row(scene, FROM..FROM + flights) {
            Ok(row) => {
                let handed_over: Vec<String> =
                    row.handed_over.iter().map(|(reason, [all, near])| format!("{reason} {all} ({near})")).collect();
                let pad_m =
                    row.pad_m.map_or("-".to_owned(), |[median, most, all]| format!("{median:.3}, {most:.3}, {all:.3}"));
                let (collided, beside, unfinished) = (row.collided.len(), row.beside.len(), row.unfinished.len());
                println!(
                    "| {} | {} | {collided} | {} | {beside} | {} | {unfinished} | {pad_m} | {:.1} |",
                    row.scene,
                    row.flights,
                    row.on_pad,
                    handed_over.join(", "),
                    row.time_s
                );
                for (what, seeds) in
                    [("collided", &row.collided), ("beside", &row.beside), ("unfinished", &row.unfinished)]
                {
                    if !seeds.is_empty() {
                        eprintln!("{}: {what}: {seeds:?}", row.scene);
                    }
                }
            }
            Err(error) => {
                eprintln!("landings: {}: {error}", scene.name);
                return ExitCode::FAILURE;
            }
        }
    }
    ExitCode::SUCCESS
}
