//! Flights in gusts; prints the table of `docs/gusts.md`. `cargo xtask gusts` runs it. So many in each scene and weather, and
//! only where the name contains the second argument.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::process::ExitCode;

use foxhound_sim::gusts::{SCENES, WEATHERS, row};

fn main() -> ExitCode {
    let flights = std::env::args().nth(1).and_then(|flights| flights.parse().ok()).unwrap_or(200);
    let only = std::env::args().nth(2).unwrap_or_default();
    println!(
        "| scene | weather | flights | collisions | reached | mean time, s | clearance, m: least, tenth percentile |"
    );
    println!("|---|---|---|---|---|---|---|");
    for scene in &SCENES {
        for weather in &WEATHERS {
            if !format!("{} {}", scene.name, weather.name).contains(&only) {
                continue;
            }
            match row(scene, weather, 1..flights + 1) {
                Ok(row) => {
                    let [least_m, tenth_m] = row.clearance_m;
                    let (flights, collided, reached) = (row.flights, row.collided.len(), row.reached);
                    let what = format!("{flights} | {collided} | {reached} | {:.1}", row.time_s);
                    println!("| {} | {} | {what} | {least_m:.3}, {tenth_m:.3} |", row.scene, row.weather);
                }
                Err(error) => {
                    eprintln!("gusts: {} in {}: {error}", scene.name, weather.name);
                    return ExitCode::FAILURE;
                }
            }
        }
    }
    ExitCode::SUCCESS
}
