//! Flights in gusts, on held-out seeds: the page `docs/results/gusts.md`. With `development`, on development seeds.

use std::fmt::Write as _;
use std::ops::Range;

use super::{Row, SCENES, STRONG, Scene, WANDERING, WEATHERS, Weather, roomy, row};
use crate::scenario::input::InputError;
use crate::study::{Campaign, seeds};

/// Flights of each scene in each weather of the tables.
const IN_THE_TABLE: u64 = 100;

/// Flies all of it and writes the page.
///
/// # Errors
/// A scenario is refused, or a flight cannot be flown.
pub fn page(settings: &Campaign) -> Result<String, InputError> {
    let &Campaign { flights, is_development, tell } = settings;
    let seeds = |count| if is_development { seeds::development(count) } else { seeds::test(count) };
    let range = if is_development { "development" } else { "test" };
    let mut text = format!(
        "# Flights in gusts\n\n\
         `cargo xtask gusts` writes this page. Flights have the whole chain from the antennas' codes on, a beacon at 20 dB, and a vehicle that\n\
         follows as a real autopilot was recorded to; what the drone does about gusts is in [how it works](../concepts.md#7-guard). Flights have\n\
         the first seeds of the {range} range ({}): `host-sim/src/study/seeds.rs`. A part of the flights is in every run of the tests (`tests/flight/gusts.rs`).\n\n\
         ## What is modelled\n\n\
         The wind has a mean of 3 m/s and gusts on top of it, in each of both directions: Dryden's longitudinal turbulence of a given standard\n\
         deviation, which lasts about 2 s. With a standard deviation of 1 m/s, gusts of 3 m/s are those of three sigma. Air that\n\
         moves pushes with 0.3 1/s of its speed, the drag of a small multicopter, which is an assumption. The wind is horizontal and the same\n\
         everywhere: pillars give no lee.\n\n\
         What the autopilot does about it is in `host-sim/src/world/deviation.rs`, with its sources. ArduCopter in GUIDED under velocity setpoints\n\
         holds a position, which it moves along with the setpoint; PX4 in OFFBOARD holds none, so that a gust leaves it elsewhere. The gains are\n\
         the defaults of both.\n\n\
         ## Past walls, gaps and random pillars\n\n\
         With a standard deviation of 2.5 m/s on a mean of 3 m/s, by scan and waveforms, beside ArduCopter's model. Walls are 2 to 5 m\n\
         long, gaps 1.5 to 2.5 m wide, two of them on 12 m; random pillars are at least 0.6 m apart.\n\n{HEAD}",
        seeds(1).start,
    );
    let (mut sum, mut named) = ([0; 3], String::new());
    for scene in roomy() {
        let row = line(&mut text, tell, scene, &STRONG, seeds(flights))?;
        sum = [sum[0] + row.flights, sum[1] + row.collided.len() as u32, sum[2] + row.reached];
        if !row.collided.is_empty() {
            let _ = writeln!(named, "\n{}: collisions with the seeds {:?}.", scene.name, row.collided);
        }
    }
    let _ = writeln!(text, "| all | | {} | {} | {} | | |\n{named}", sum[0], sum[1], sum[2]);

    let _ = write!(text, "## Over the gusts' strength\n\n{HEAD}");
    for scene in &SCENES {
        for weather in &WEATHERS {
            line(&mut text, tell, scene, weather, seeds(IN_THE_TABLE.min(flights)))?;
        }
    }

    let _ = write!(text, "\n## Where the position wanders\n\n{WANDERS}\n\n{HEAD}");
    for scene in SCENES.iter().filter(|scene| AMONG_PILLARS.contains(&scene.name)) {
        for weather in &WANDERING {
            line(&mut text, tell, scene, weather, seeds(IN_THE_TABLE.min(flights)))?;
        }
    }
    Ok(text)
}

/// Where obstacles leave the view while they are passed.
const AMONG_PILLARS: [&str; 3] = ["pillars, scan", "forest, scan", "thicket, scan"];
const WANDERS: &str = "In calm air, with 1 cm of noise in every position, and an error that wanders with this standard deviation and a time constant of 20 s: a \
                       random\nwalk of 3, 6 and 10 cm in the root of a second, which the velocities do not tell. What has left the view is by then \
                       somewhere else.";
const HEAD: &str = "| scene | weather | flights | collisions | reached | mean time, s | clearance, m: least, tenth percentile |\n\
                    |---|---|---|---|---|---|---|\n";

fn line(
    text: &mut String,
    tell: fn(&str),
    scene: &Scene,
    weather: &Weather,
    seeds: Range<u64>,
) -> Result<Row, InputError> {
    let row = row(scene, weather, seeds)?;
    tell(&format!("{row:?}"));
    let ([least_m, tenth_m], collided) = (row.clearance_m, row.collided.len());
    let what = format!("{} | {collided} | {} | {:.1}", row.flights, row.reached, row.time_s);
    let _ = writeln!(text, "| {} | {} | {what} | {least_m:.3}, {tenth_m:.3} |", row.scene, row.weather);
    Ok(row)
}
