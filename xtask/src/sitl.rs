//! Flights of `foxhound companion` beside ArduCopter and PX4 in their own simulators: docs/sitl.md.
//!
//! A flight is `tests/peers/sitl/flight.py`, which starts a fresh autopilot and the companion, plays the pilot, makes the fault and
//! measures. This hands out flights, ends their processes and writes the table. The autopilots are programs that the caller has.

use std::fmt::Write as _;
use std::fs;
use std::io::Read as _;
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use clap::Args;
use serde_json::{Value, json};

use crate::build::{Image, cargo, workspace};
use crate::{Failure, attend, board, test};

/// Each with what it is, and how it should end.
const CELLS: [(&str, &str); 17] = [
    ("calm", "posts from a file, calm air; reached"),
    ("hidden", "posts that only a sensor of the vehicle sees, calm air; reached"),
    (
        "lidar",
        "ArduPilot's own simulated lidar, told as eight sectors of 45 degrees; a post of 1 m radius between start and beacon; every other flight without ArduPilot's own avoidance (`AVOID_ENABLE` 5 instead of 7), two of four without `--obstacles`; reached",
    ),
    ("wind", "8 m/s with gusts; reached"),
    ("gps_glitch", "ArduPilot: GPS 5.6 m off for 4 s; PX4: no satellites for 4 s; reached"),
    ("ekf_reset", "the estimate is moved by 3 m or more; reached"),
    ("mode_stolen", "the pilot holds for 5 s and gives back; reached"),
    ("link_dropped", "nothing passes between companion and autopilot for 3 s; reached"),
    ("autopilot_restarted", "killed in flight, started anew, taken off, given back; reached"),
    (
        "companion_restarted",
        "killed in flight, started anew after 2 s; PX4 leaves and enters the mode by itself; stands until its pilot enters it again; reached",
    ),
    ("battery", "critical, the autopilot's own action off: holds"),
    ("fence", "breached; ArduPilot only tells, PX4 holds: stands"),
    ("signing", "both sides sign; every frame of the companion is signed; reached"),
    (
        "landing",
        "`FH_LND_MODE` 1 and `FH_LND_REQ` 1, no post within 1.5 m of the beacon; reached, landed by the autopilot, disarmed",
    ),
    ("pad", "`FH_LND_MODE` 2 and `FH_LND_REQ` 1, a simulated camera (`--pad`); reached, landed on the pad, disarmed"),
    ("landing_qemu", "the same as `landing` by the firmware in QEMU"),
    ("pad_qemu", "the same as `pad` by the firmware in QEMU"),
];
/// Ends the name of a cell that is flown by the firmware.
const BY_FIRMWARE: &str = "_qemu";
const AUTOPILOTS: [(&str, [&str; 2]); 2] = [
    ("ardupilot", ["examples/ardupilot.parm", "tests/peers/sitl/ardupilot.parm"]),
    ("px4", ["examples/px4.params", "tests/peers/sitl/px4.params"]),
];
/// What the page has from here on is written by this command, what is above by hand.
const MEASURED: &str = "## Measured\n";
/// In a flight's folder.
const RESULT: &str = "result.json";
/// Ends a flight that is stuck.
const TIME_MAX_S: u32 = 270;

#[derive(Args)]
pub(crate) struct Campaign {
    /// `ArduCopter` as built for SITL: build/sitl/bin/arducopter
    #[arg(long, value_name = "FILE")]
    arducopter: Option<PathBuf>,
    /// PX4 as built for SITL, with its folder `etc` beside that of the program: `build/px4_sitl_default/bin/px4`
    #[arg(long, value_name = "FILE")]
    px4: Option<PathBuf>,
    /// Flights of each cell on each autopilot
    #[arg(long, default_value_t = 2)]
    seeds: u64,
    /// Flights at a time, in real time
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=i64::from(INSTANCES)))]
    jobs: u16,
    /// Keep the results of an earlier run of the same programs, which are in target/sitl
    #[arg(long)]
    resume: bool,
    /// Only these; the table is printed, not written
    #[arg(long, value_delimiter = ',')]
    cells: Vec<String>,
}

/// Flights by the firmware at a time: QEMU does not keep up on a busy processor.
const FIRMWARE_JOBS: u16 = 2;
/// What PX4 has. The last ones are taken: lower ones are left to who flies by hand.
const INSTANCES: u16 = 10;

/// What flights are flown with.
struct Programs {
    python: PathBuf,
    autopilots: [Option<PathBuf>; 2],
    /// The firmware, if a cell needs it.
    image: Option<Image>,
    resume: bool,
}

/// Flights that wait, by number.
struct Queue {
    waiting: Vec<usize>,
    next: AtomicUsize,
}

impl Queue {
    const fn new(waiting: Vec<usize>) -> Self {
        Self { waiting, next: AtomicUsize::new(0) }
    }

    fn take(&self) -> Option<usize> {
        self.waiting.get(self.next.fetch_add(1, Ordering::Relaxed)).copied()
    }
}

struct Flight {
    cell: &'static str,
    autopilot: usize,
    seed: u64,
}

/// Flies, and writes or prints the table.
pub(crate) fn run(campaign: &Campaign) -> Result<(), Failure> {
    let binaries = [&campaign.arducopter, &campaign.px4];
    if binaries.iter().all(|binary| binary.is_none()) {
        println!("SKIPPED: no autopilot was flown; name one by --arducopter FILE or --px4 FILE (docs/sitl.md)");
        return Ok(());
    }
    let absolute =
        |file: &PathBuf| file.canonicalize().map_err(|error| Failure(format!("{}: {error}", file.display())));
    let binaries = [binaries[0].as_ref().map(absolute).transpose()?, binaries[1].as_ref().map(absolute).transpose()?];
    if let Some(unknown) = campaign.cells.iter().find(|name| CELLS.iter().all(|(cell, _)| cell != name)) {
        let names = CELLS.map(|(cell, _)| cell).join(", ");
        return Err(Failure(format!("--cells {unknown}: there are {names}")));
    }
    attend(cargo().args(["build", "--release", "--package", "foxhound-sim"]))?;
    let python = test::python_with_pymavlink()?;

    let mut flights = Vec::new();
    for seed in 1..=campaign.seeds {
        for (cell, _) in
            CELLS.iter().filter(|(cell, _)| campaign.cells.is_empty() || campaign.cells.iter().any(|name| name == cell))
        {
            let with = (0..AUTOPILOTS.len()).filter(|autopilot| binaries[*autopilot].is_some());
            flights.extend(with.map(|autopilot| Flight { cell, autopilot, seed }));
        }
    }
    let by_firmware = flights.iter().any(|flight| flight.cell.ends_with(BY_FIRMWARE));
    let image = by_firmware.then(|| Image::build(board::TWIN, "foxhound-firmware")).transpose()?;
    let programs = Programs { python, autopilots: binaries, image, resume: campaign.resume };
    let results = fly_all(&flights, campaign.jobs, &programs)?;
    let table = table(&flights, &results);
    print!("{table}");
    if campaign.cells.is_empty() && programs.autopilots.iter().all(Option::is_some) {
        write(&table)?;
    }
    let wrong = results.iter().filter(|result| result["wrong"].is_string()).count();
    if wrong == 0 {
        Ok(())
    } else {
        Err(Failure(format!("{wrong} of {} flights did not end as they should", flights.len())))
    }
}

fn fly_all(flights: &[Flight], jobs: u16, programs: &Programs) -> Result<Vec<Value>, Failure> {
    let (firmware, others): (Vec<usize>, Vec<usize>) =
        (0..flights.len()).partition(|number| flights[*number].cell.ends_with(BY_FIRMWARE));
    let (firmware, others) = (Queue::new(firmware), Queue::new(others));
    let results = Mutex::new(vec![Value::Null; flights.len()]);
    let work = |job: u16| -> Result<(), Failure> {
        loop {
            let next = if job < FIRMWARE_JOBS { firmware.take().or_else(|| others.take()) } else { others.take() };
            let Some(number) = next else { return Ok(()) };
            let flight = &flights[number];
            let instance = INSTANCES - jobs + job;
            let mut result = fly(flight, instance, programs, programs.resume)?;
            if result["wrong"].is_string() && result["took_off"] == false && result["again"].is_null() {
                let again = result["wrong"].clone();
                result = fly(flight, instance, programs, false)?;
                result["again"] = again;
            }
            fs::write(folder(flight).join(RESULT), result.to_string())
                .map_err(|error| Failure(format!("{}: {error}", folder(flight).display())))?;
            let word = result["wrong"].as_str().or(result["skipped"].as_str()).unwrap_or("as it should");
            eprintln!("{} {} {}: {word}", flight.cell, AUTOPILOTS[flight.autopilot].0, flight.seed);
            results.lock().unwrap_or_else(PoisonError::into_inner)[number] = result;
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs).map(|job| scope.spawn(move || work(job))).collect();
        workers
            .into_iter()
            .try_for_each(|worker| worker.join().unwrap_or_else(|_| Err(Failure("a worker died".to_owned()))))
    })?;
    Ok(results.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Where a flight's files are.
fn folder(flight: &Flight) -> PathBuf {
    let name = AUTOPILOTS[flight.autopilot].0;
    workspace().join(format!("target/sitl/{}-{name}-{}", flight.cell, flight.seed))
}

/// One flight, in a process group that is gone afterwards; or, to `resume`, its result of an earlier run.
fn fly(flight: &Flight, instance: u16, programs: &Programs, resume: bool) -> Result<Value, Failure> {
    let Programs { python, autopilots, image, .. } = programs;
    let (name, files) = AUTOPILOTS[flight.autopilot];
    let folder = folder(flight);
    let unwritable = |error: std::io::Error| Failure(format!("{}: {error}", folder.display()));
    if let Some(result) = fs::read_to_string(folder.join(RESULT))
        .ok()
        .filter(|_| resume)
        .and_then(|text| serde_json::from_str(&text).ok())
    {
        return Ok(result);
    }
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(unwritable)?;
    }
    fs::create_dir_all(&folder).map_err(unwritable)?;
    let via = image.as_ref().filter(|_| flight.cell.ends_with(BY_FIRMWARE));
    let spec = json!({
        "autopilot": name, "cell": flight.cell, "seed": flight.seed, "instance": instance, "folder": folder,
        "binary": autopilots[flight.autopilot], "via": via.map_or("host".to_owned(), |image| format!("qemu:{}", image.elf.display())),
        "parameters": files.map(|file| workspace().join(file)),
        "foxhound": workspace().join("target/release/foxhound"), "time_max_s": TIME_MAX_S,
    });
    fs::write(folder.join("flight.json"), spec.to_string()).map_err(unwritable)?;
    let errors = fs::File::create(folder.join("errors.log")).map_err(unwritable)?;
    let mut command = Command::new(python);
    command.arg("-B").arg(workspace().join("tests/peers/sitl/flight.py")).arg(folder.join("flight.json"));
    // It ends all when its input does: so it does not outlive this program, whatever ends that.
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(errors).process_group(0).spawn();
    let child = child.as_mut().map_err(|error| Failure(format!("{}: {error}", python.display())))?;
    let mut said = String::new();
    if let Some(mut output) = child.stdout.take() {
        output.read_to_string(&mut said).map_err(unwritable)?;
    }
    // What it has started may still run.
    let group = format!("-{}", child.id());
    let _ = Command::new("kill").args(["-KILL", "--", &group]).stderr(Stdio::null()).status();
    child.wait().map_err(unwritable)?;
    let result = said.lines().last().and_then(|line| serde_json::from_str(line).ok());
    Ok(result.unwrap_or_else(
        || json!({ "wrong": format!("the flight broke off: {}", folder.join("errors.log").display()) }),
    ))
}

fn table(flights: &[Flight], results: &[Value]) -> String {
    let mut text = String::from(
        "| cell | autopilot | flights | as they should | least clearance, m | longest gap, s | to the beacon, m \
         | estimate off, m | mode entered again |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    let (mut wrongs, mut agains) = (String::new(), String::new());
    for (cell, autopilot) in
        CELLS.iter().flat_map(|(cell, _)| (0..AUTOPILOTS.len()).map(move |autopilot| (*cell, autopilot)))
    {
        let of = flights.iter().zip(results).filter(|(flight, _)| flight.cell == cell && flight.autopilot == autopilot);
        let of: Vec<_> = of.collect();
        let name = AUTOPILOTS[autopilot].0;
        let flown: Vec<&Value> =
            of.iter().map(|(_, result)| *result).filter(|result| !result["skipped"].is_string()).collect();
        if let Some(why) = of.iter().find_map(|(_, result)| result["skipped"].as_str()) {
            let _ = writeln!(text, "| {cell} | {name} | skipped: {why} | | | | | | |");
        }
        if flown.is_empty() {
            continue;
        }
        let values = |key: &str| flown.iter().filter_map(|result| result[key].as_f64()).collect::<Vec<f64>>();
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.2}"));
        let most = |key: &str| number(values(key).into_iter().reduce(f64::max));
        let fine = flown.iter().filter(|result| result["wrong"].is_null()).count();
        let clearance = number(values("clearance_m").into_iter().reduce(f64::min));
        let counts = |key: &str| flown.iter().filter_map(|result| result[key].as_u64()).sum::<u64>();
        let again = counts("reentries") + counts("given_back");
        let (gap, beacon, off) = (most("longest_gap_s"), most("to_beacon_m"), most("off_m"));
        let _ = writeln!(
            text,
            "| {cell} | {name} | {} | {fine} | {clearance} | {gap} | {beacon} | {off} | {again} |",
            flown.len()
        );
        for (flight, result) in of {
            if let Some(again) = result["again"].as_str() {
                let _ = writeln!(agains, "- {cell}, {name}, seed {}: {again}", flight.seed);
            }
            if let Some(wrong) = result["wrong"].as_str() {
                let _ = writeln!(wrongs, "- {cell}, {name}, seed {}: {wrong}", flight.seed);
            }
        }
    }
    for (title, list) in
        [("Flown again, because the autopilot did not take off", agains), ("Not as they should", wrongs)]
    {
        if !list.is_empty() {
            let _ = write!(text, "\n{title}:\n\n{list}");
        }
    }
    text
}

/// Replaces what the page has under [`MEASURED`], up to the next heading.
fn write(table: &str) -> Result<(), Failure> {
    let page = workspace().join("docs/sitl.md");
    let unreadable = |error: std::io::Error| Failure(format!("{}: {error}", page.display()));
    let text = fs::read_to_string(&page).map_err(unreadable)?;
    let (kept, old) = text.split_once(MEASURED).ok_or_else(|| Failure(format!("{}: no {MEASURED}", page.display())))?;
    let mut cells = String::from("| cell | what happens; how it should end |\n|---|---|\n");
    for (cell, about) in CELLS {
        let _ = writeln!(cells, "| {cell} | {about} |");
    }
    let next = old.find("\n## ").and_then(|at| old.get(at..)).unwrap_or_default();
    fs::write(&page, format!("{kept}{MEASURED}\n{}\n{cells}\n{table}{next}", include_str!("sitl.md")))
        .map_err(unreadable)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: of two flights the least clearance, the largest of the others, and the sum of entries; a skipped one is not flown.
    #[test]
    fn a_row_has_the_worst_of_its_flights_and_names_those_that_went_wrong() {
        let flight = |cell, autopilot, seed| Flight { cell, autopilot, seed };
        let flights = [flight("calm", 0, 1), flight("calm", 0, 2), flight("fence", 1, 1)];
        let result = |wrong: Option<&str>, clearance_m: f64, gap_s: f64| {
            json!({ "wrong": wrong, "clearance_m": clearance_m, "longest_gap_s": gap_s, "to_beacon_m": gap_s, "off_m": 0.1,
                    "reentries": 1, "given_back": 2 })
        };
        let results =
            [result(None, 0.5, 0.061), result(Some("fell"), 0.25, 3.0), json!({ "skipped": "no parameter X" })];
        let text = table(&flights, &results);
        assert!(text.contains("| calm | ardupilot | 2 | 1 | 0.25 | 3.00 | 3.00 | 0.10 | 6 |\n"), "{text}");
        assert!(text.contains("| fence | px4 | skipped: no parameter X | | | | | | |\n"), "{text}");
        assert!(text.ends_with("\n- calm, ardupilot, seed 2: fell\n"), "{text}");
    }

    /// The page has the line below which it is written, and its cells are those that are flown.
    #[test]
    fn the_page_names_every_cell() {
        let page = include_str!("../../docs/sitl.md");
        let (_, measured) = page.split_once(MEASURED).unwrap();
        for (cell, about) in CELLS {
            assert!(measured.contains(&format!("| {cell} | {about} |\n")), "{cell}");
        }
    }
}
