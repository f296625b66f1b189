//! `fly --report`, `companion --report`: the page holds the flight, and a browser shows it. `cargo xtask test`
//! installs the browser.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;

use foxhound_tests::{Autopilot, checked_by, qemu_image, root, run_json, take_machine, text};
use serde_json::Value;

use crate::packed;

/// Largest page of the built-in mission.
const PAGE_BYTES: usize = 300_000;
/// Largest page of an hour of flight.
const HOUR_BYTES: usize = 5_000_000;

/// A flight's page, its records, and what was printed.
struct Flown {
    page: String,
    records: Vec<Value>,
    printed: Value,
}

impl Flown {
    /// In a scenario.
    fn of(scenario: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scenario.json");
        std::fs::write(&path, scenario).unwrap();
        Self::with(&["--scenario", &text(&path)])
    }

    /// Onto a pad.
    fn landing() -> Self {
        Self::with(&["--scenario", &text(&root().join("scenarios/landing_pad.json"))])
    }

    fn with(arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.html");
        let all = [&["fly", "--json", "--report", path.to_str().unwrap()], arguments].concat();
        let (_, printed) = run_json(&all);
        Self::read(&path, printed)
    }

    fn read(path: &Path, printed: Value) -> Self {
        let page = std::fs::read_to_string(path).unwrap();
        let records = packed::records(&page);
        Self { page, records, printed }
    }

    fn of_kind(&self, kind: &str) -> impl Iterator<Item = &Value> {
        self.records.iter().filter(move |record| record["kind"] == kind)
    }
}

pub(crate) fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(number).collect()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The HTML report contains the flight that was flown.
#[test]
fn the_page_holds_the_flight_that_was_flown() {
    let flown = Flown::with(&[]);
    let (_, alone) = run_json(&["fly", "--json"]);
    assert_eq!(flown.printed, alone, "watching changes nothing");
    assert!(flown.page.len() < PAGE_BYTES, "{} bytes", flown.page.len());

    let kinds: Vec<&str> = flown.records.iter().map(|record| record["kind"].as_str().unwrap()).collect();
    assert_eq!((kinds[0], kinds[kinds.len() - 1]), ("begin", "end"));
    assert_eq!(kinds.iter().filter(|kind| ["begin", "end"].contains(kind)).count(), 2);
    let (begin, end) = (&flown.records[0], &flown.records[flown.records.len() - 1]);
    assert_eq!(end["report"], flown.printed);
    assert!(begin["command"].as_str().unwrap().starts_with("foxhound fly --json --report "));

    // Every step is there, once.
    let steps: Vec<&Value> = flown.of_kind("step").collect();
    assert_eq!(end["steps"], steps.len());
    assert!((number(&flown.printed["time_s"]) - 0.02 * steps.len() as f64).abs() < 1e-9);
    for (index, step) in steps.iter().enumerate() {
        assert!((number(&step["time_s"]) - 0.02 * index as f64).abs() < 1e-9, "step {index}");
    }
    assert_eq!(flown.of_kind("plan").count() as u64, flown.printed["replans"].as_u64().unwrap());

    // The printed values follow from the steps.
    let places: Vec<Vec<f64>> = steps.iter().map(|step| numbers(&step["place_m"])).collect();
    let length_m: f64 = places.windows(2).map(|pair| distance(&pair[0], &pair[1])).sum();
    assert!((length_m - number(&flown.printed["path_length_m"])).abs() < 0.05, "{length_m} m");
    let clearance_m = steps.iter().map(|step| number(&step["clearance_m"])).fold(f64::INFINITY, f64::min);
    assert!((clearance_m - number(&flown.printed["min_clearance_m"])).abs() < 0.005, "{clearance_m} m");
    let errors: Vec<f64> = steps
        .iter()
        .filter(|step| step["heard"]["valid"] == true && !step["heard"]["bearing_deg"].is_null())
        .map(|step| number(&step["heard"]["bearing_deg"]) - number(&step["truth_deg"]))
        .collect();
    let rms_deg = (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt();
    assert!((rms_deg - number(&flown.printed["bearing_rms_deg"])).abs() < 0.005, "{rms_deg} deg");
}

/// Eq. 41-45 of the main paper, with the planner's bound on the proximity.
fn cost(plan: &Value, sample: &Value, radius_m: f64) -> f64 {
    let target = numbers(&plan["target_m"]);
    let mut places = vec![numbers(&plan["start_m"])];
    places.extend(sample["waypoints_m"].as_array().unwrap().iter().map(numbers));
    let steps: Vec<[f64; 2]> =
        places.windows(2).map(|pair| [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]]).collect();
    let moves: Vec<&[f64; 2]> = steps.iter().filter(|step| step[0].hypot(step[1]) > 2e-3).collect();
    let length_m: f64 = steps.iter().map(|step| step[0].hypot(step[1])).sum();
    let turn = |a: &[f64; 2], b: &[f64; 2]| (a[0] * b[1] - a[1] * b[0]).atan2(a[0] * b[0] + a[1] * b[1]).abs();
    let turns_rad: f64 = moves.windows(2).map(|pair| turn(pair[0], pair[1])).sum();
    let near = |circle: &Value, place: &Vec<f64>| {
        let circle = numbers(circle);
        distance(&circle, place) - circle[2] - radius_m
    };
    let circles = plan["circles_m"].as_array().unwrap();
    let nearest_m = circles
        .iter()
        .flat_map(|circle| places[1..].iter().map(move |place| near(circle, place)))
        .fold(f64::INFINITY, f64::min);
    length_m + distance(&places[places.len() - 1], &target) + turns_rad + (1.0 / nearest_m.max(0.01)).min(5.0)
}

/// The costs in the report are those of the trajectories that it draws.
#[test]
fn the_costs_are_those_of_the_trajectories_that_are_drawn() {
    let flown = Flown::with(&[]);
    let radius_m = number(&flown.records[0]["scenario"]["drone_radius"]);
    let (mut compared, mut chosen) = (0, 0);
    for plan in flown.of_kind("plan") {
        for sample in plan["samples"].as_array().unwrap() {
            let (ours, recorded) = (cost(plan, sample, radius_m), number(&sample["cost"]));
            // Places are rounded to a millimetre: which way a step of a few of them turns is lost.
            let places: Vec<Vec<f64>> = sample["waypoints_m"].as_array().unwrap().iter().map(numbers).collect();
            let is_short = |pair: &[Vec<f64>]| (1e-9..0.02).contains(&distance(&pair[0], &pair[1]));
            if places.windows(2).any(is_short) {
                continue;
            }
            assert!((ours - recorded).abs() < 0.05 + 0.02 * recorded, "plan {}: {ours} for {recorded}", plan["id"]);
            compared += 1;
        }
        if let Some(index) = plan["chosen"].as_u64() {
            let sample = &plan["samples"][index as usize];
            assert_eq!((&sample["waypoints_m"], &sample["feasible"]), (&plan["waypoints_m"], &Value::Bool(true)));
            assert_eq!((&sample["cost"], &sample["gains"]), (&plan["cost"], &plan["gains"]));
            chosen += 1;
        }
    }
    assert!(compared > 150 && chosen > 15, "{compared} {chosen}");
}

/// Eq. 33 and 36 of the main paper; `None` close to an obstacle and inside, where the field is continued differently.
fn potential(plan: &Value, gains: &Value, place: [f64; 2], radius_m: f64) -> Option<(f64, f64)> {
    let clear = |circle: &Value| distance(&numbers(circle), &place) - number(&circle[2]) - radius_m;
    let clear_m: Vec<f64> = plan["circles_m"].as_array().unwrap().iter().map(clear).collect();
    let gain = |name: &str| number(&gains[name]);
    let push = |metres: &f64| gain("k_rep") * -(metres / gain("influence_m")).min(1.0).ln();
    let attraction = 0.5 * gain("k_att") * distance(&place, &numbers(&plan["target_m"])).powi(2);
    clear_m.iter().all(|metres| *metres > 0.02).then(|| (attraction, clear_m.iter().map(push).sum()))
}

/// The potential in the report is the paper's, around the obstacles that the planner knew.
#[test]
fn the_potential_is_the_one_of_the_paper_around_the_obstacles_that_the_planner_knew() {
    let flown = Flown::with(&[]);
    let begin = &flown.records[0];
    let radius_m = number(&begin["scenario"]["drone_radius"]);
    let (mut repelled, mut compared) = (0, 0);
    for plan in flown.of_kind("plan") {
        let field = &plan["field"];
        let (south_west, step_m) = (numbers(&field["south_west_m"]), number(&field["step_m"]));
        let columns = field["columns"].as_u64().unwrap() as usize;
        for (name, gains) in [("followed", &plan["gains"]), ("mean", &begin["gains"])] {
            let values = numbers(&field[name]);
            assert_eq!(values.len(), columns * columns);
            for (index, value) in values.iter().enumerate() {
                let (row, column) = ((index / columns) as f64, (index % columns) as f64);
                let place = [south_west[0] + column * step_m, south_west[1] + row * step_m];
                let Some((attraction, repulsion)) = potential(plan, gains, place, radius_m) else { continue };
                let ours = attraction + repulsion;
                assert!((ours - value).abs() < 0.02 + 0.01 * value, "plan {}: {ours} for {value}", plan["id"]);
                repelled += usize::from(repulsion > 0.05);
                compared += 1;
            }
        }
    }
    assert!(compared > 10_000 && repelled > 200, "{compared} {repelled}");
}

/// The position estimate in the report is the one that guidance used.
#[test]
fn the_belief_is_the_one_that_guidance_flies_by() {
    let flown = Flown::with(&[]);
    let steps: Vec<&Value> = flown.of_kind("step").collect();
    let mut compared = 0;
    for plan in flown.of_kind("plan") {
        let Some(covariance) = plan["belief"].get("covariance_m2").map(numbers) else { continue };
        // It is published with the plan, which takes effect five steps later.
        let at = (number(&plan["time_s"]) / 0.02).round() as usize + 5;
        let Some(step) = steps.get(at).filter(|step| step.get("source_sigma_m").is_some()) else { continue };
        let (half_sum, half_difference) =
            ((covariance[0] + covariance[2]) / 2.0, (covariance[0] - covariance[2]) / 2.0);
        let sigma_m = (half_sum + half_difference.hypot(covariance[1])).sqrt();
        let published_m = number(&step["source_sigma_m"]);
        assert!((sigma_m - published_m).abs() < 0.01 + 0.01 * published_m, "{sigma_m} for {published_m} m");
        compared += 1;
    }
    assert!(compared > 15, "{compared}");
}

/// Every planner, and a world with moving obstacles, has a report.
#[test]
fn every_planner_and_a_world_that_moves_have_a_report() {
    let movers = root().join("tests/traps/movers.json");
    for (planner, origins) in [
        ("foxhound", &["sampled", "straight", "bent", "brake"][..]),
        ("paper", &["sampled", "brake"]),
        ("standard", &["initial"]),
    ] {
        let flown = Flown::with(&["--planner", planner, "--scenario", movers.to_str().unwrap()]);
        assert_eq!(flown.records[0]["planner"], planner);
        assert_eq!(flown.records[flown.records.len() - 1]["report"], flown.printed);
        let plans: Vec<&Value> = flown.of_kind("plan").collect();
        assert!(plans.len() > 3, "{planner}");
        for plan in plans {
            assert!(origins.contains(&plan["origin"].as_str().unwrap()), "{planner}: {}", plan["origin"]);
            assert_eq!(
                plan["samples"].as_array().unwrap().is_empty(),
                planner == "standard" || plan["origin"] == "bent"
            );
        }
    }
}

/// Among people who walk across, the page has them at their true positions, and the tracks with their accuracy; it
/// says when the vehicle gives way, and watching changes nothing.
#[test]
fn the_page_shows_people_what_is_followed_and_how_the_vehicle_gives_way() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.json");
    let scenario = r#"{"start":[0,0],"goal":[9,0],"bounds":[-1,-6,10,6],"bearing":{"snr_db":20},"max_time_s":40,
        "people":[{"route":[[4,-7]],"heading_deg":0,"speed":1.6,"group":2},{"route":[[7,9]],"heading_deg":180,"sway_m":0.1}],
        "sensor":{"model":"scan","fov_deg":360,"range_m":5,"rays":360}}"#;
    std::fs::write(&path, scenario).unwrap();
    let flight = ["fly", "--json", "--scenario", &text(&path)];
    let flown = Flown::with(&flight[2..]);
    assert_eq!(flown.printed, run_json(&flight).1, "watching changes nothing");
    let people: Vec<&Value> = flown.of_kind("people").collect();
    assert!(people.iter().all(|record| record["circles_m"].as_array().unwrap().len() == 3));
    let (mut near, mut all) = (0, 0);
    for record in flown.of_kind("tracks") {
        let Some(truth) = people.iter().find(|people| people["time_s"] == record["time_s"]) else { continue };
        for track in record["tracks"].as_array().unwrap() {
            let (place, sigma_m) = (numbers(&track["place_m"]), numbers(&track["covariance"])[0].sqrt());
            assert!(
                (1e-3..1.5).contains(&sigma_m) && distance(&numbers(&track["velocity_mps"]), &[0.0, 0.0]) < 4.0,
                "{track}"
            );
            let off = |circle: &Value| distance(&numbers(circle), &place);
            let circles = truth["circles_m"].as_array().unwrap();
            near += usize::from(circles.iter().map(off).fold(f64::INFINITY, f64::min) < 0.3);
            all += 1;
        }
    }
    assert!(all > 20 && near * 10 > all * 8, "{near} of {all} tracks are where somebody is");
    let gives_way = flown.of_kind("step").filter(|step| step.get("evasion_mps").is_some()).count();
    assert!(gives_way > 10, "{gives_way} steps");
}

/// The report of the image in QEMU equals that of the same flight on the desktop.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn the_report_of_the_image_in_qemu_is_that_of_the_host() {
    let via = format!("qemu:{}", qemu_image());
    let (host, qemu) = (Flown::with(&[]), Flown::with(&["--via", &via]));
    assert_eq!(host.records[1..], qemu.records[1..]);
    assert_eq!(host.records[0]["parameters"], qemu.records[0]["parameters"]);
}

/// The report of a flight beside an autopilot shows the positions that the autopilot reported.
#[test]
fn a_flight_beside_an_autopilot_has_a_report_of_where_that_says_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let (path, obstacles) = (folder.path().join("flight.html"), folder.path().join("obstacles.json"));
    std::fs::write(&obstacles, r#"{"obstacles":[{"x":1.5,"y":2.1,"r":0.3}]}"#).unwrap();
    let autopilot = Autopilot::start(&[]);
    let flight = ["companion", "--json", "--source=4,3,-5", "--max-time", "60", "--autopilot", &autopilot.address];
    let files = ["--obstacles", &text(&obstacles), "--report", &text(&path)];
    let (code, printed) = run_json(&[&flight[..], &files].concat());
    assert_eq!((code, &printed["result"]), (0, &"reached".into()), "{printed}");
    let flown = Flown::read(&path, printed);
    let steps: Vec<&Value> = flown.of_kind("step").collect();
    assert_eq!(flown.records[flown.records.len() - 1]["report"], flown.printed);
    assert_eq!((&steps[0]["time_s"], flown.of_kind("plan").count() > 3), (&0.0.into(), true));
    assert!(number(&steps[steps.len() - 1]["truth_m"]) < 1.2, "it ends at the beacon");
    let farthest_m = steps.iter().map(|step| number(&step["truth_m"])).fold(0.0, f64::max);
    assert!((farthest_m - number(&flown.printed["straight_line_m"])).abs() < 0.3, "{farthest_m} m");
}

/// A flight behind a beacon that is never reached, among pillars.
fn chase(time_s: f64) -> String {
    let pillar = |row: usize| {
        let (x, y) = (1.9 * row as f64 + 2.5, 3.0 * (1.7 * row as f64).sin());
        format!(r#"{{"x":{x:.2},"y":{y:.2},"r":0.3}}"#)
    };
    let rows = (time_s / 1.9) as usize;
    let pillars: Vec<String> = (0..rows).map(pillar).collect();
    format!(
        r#"{{"start":[0,0],"goal":[{goal},0],"bounds":[-2,-9,{goal},9],"obstacles":[{pillars}],"bearing":{{"snr_db":20}},
        "sensor":{{"model":"scan"}},"max_time_s":{time_s}}}"#,
        goal = time_s + 20.0,
        pillars = pillars.join(","),
    )
}

fn flown_for(time_s: f64) -> Flown {
    Flown::of(&chase(time_s))
}

/// The file of a long flight is thinned, says how many records of each kind it holds, and an hour of it is at most 5 MB.
#[test]
fn a_long_flight_is_thinned_as_the_page_says_and_an_hour_of_it_is_small() {
    let (short, flown) = (flown_for(10.0), flown_for(330.0));
    let of_records = (flown.page.len() - short.page.len()) as f64 / (number(&flown.printed["time_s"]) - 10.0);
    let hour_bytes = short.page.len() + (3600.0 * of_records) as usize;
    assert!(hour_bytes < HOUR_BYTES, "{hour_bytes} bytes an hour");
    assert!(short.of_kind("thinned").next().is_none());
    let thinned = flown.of_kind("thinned").next().unwrap();
    let of = |name: &str| {
        let row = thinned["what"].as_array().unwrap().iter().find(|row| row["what"] == name).unwrap();
        (row["all"].as_u64().unwrap() as usize, row["kept"].as_u64().unwrap() as usize)
    };
    let steps: Vec<&Value> = flown.of_kind("step").collect();
    let (all, kept) = of("steps");
    assert_eq!((all as u64, kept), (flown.records[flown.records.len() - 1]["steps"].as_u64().unwrap(), steps.len()));
    assert!(kept * 4 < all, "{kept} of {all}");
    let times_s: Vec<f64> = steps.iter().map(|step| number(&step["time_s"])).collect();
    assert!(times_s.windows(2).all(|pair| pair[0] < pair[1] && pair[1] - pair[0] < 0.2));
    assert!((times_s[0], (times_s[kept - 1] - number(&flown.printed["time_s"])).abs() < 0.03) == (0.0, true));
    let least_m = steps.iter().map(|step| number(&step["clearance_m"])).fold(f64::INFINITY, f64::min);
    assert!((least_m - number(&flown.printed["min_clearance_m"])).abs() < 0.005, "{least_m} m");
    // No plan is missing; some have no details.
    let plans: Vec<&Value> = flown.of_kind("plan").collect();
    assert_eq!(plans.len() as u64, flown.printed["replans"].as_u64().unwrap());
    let detailed = plans.iter().filter(|plan| plan.get("field").is_some()).count();
    assert_eq!((plans.len(), detailed), of("details of plans"));
    assert!(
        plans
            .iter()
            .all(|plan| plan.get("thinned").is_some_and(|thinned| *thinned == true) == plan.get("field").is_none())
    );
    assert!((50..80).contains(&detailed), "{detailed}");
}

/// The phases of the tone at the antennas are those of a plane wave from the beacon, and the spectrum is loudest at the tone.
#[test]
fn the_phases_are_those_of_a_wave_from_the_beacon() {
    let flown = Flown::with(&[]);
    let begin = &flown.records[0];
    let array = foxhound_core::doa::array::Config::default();
    let steps: Vec<&Value> = flown.of_kind("step").collect();
    let (mut squares, mut count) = (0.0, 0);
    for signal in flown.of_kind("signal") {
        let Some(tone) = signal.get("tone") else { continue };
        let spectrum = numbers(&signal["spectrum_db"]);
        let loudest = spectrum.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let bin = (number(&tone["frequency_hz"]) / number(&begin["bin_hz"])) as usize;
        assert!(spectrum[bin] > loudest - 3.0, "bin {bin}");
        let step = steps[(number(&signal["time_s"]) / 0.02).round() as usize];
        let ahead_rad = (number(&step["truth_deg"]) - number(&step["yaw_deg"])).to_radians();
        let down_m = number(&step["height_m"]) - number(&begin["beacon_height_m"]);
        let level = number(&step["truth_m"]) / number(&step["truth_m"]).hypot(down_m);
        // An antenna nearer to the beacon hears the wave earlier.
        let phase_rad = |[forward, right]: [f32; 2]| {
            let nearer_m = f64::from(forward) * ahead_rad.cos() + f64::from(right) * ahead_rad.sin();
            std::f64::consts::TAU * level * nearer_m / f64::from(array.wavelength_m)
        };
        let antennas = array.antennas_m;
        for (antenna, heard_deg) in antennas.into_iter().zip(numbers(&tone["phases_deg"])).skip(1) {
            let expected_deg = (phase_rad(antenna) - phase_rad(antennas[0])).to_degrees();
            let off_deg = (heard_deg - expected_deg + 540.0).rem_euclid(360.0) - 180.0;
            squares += off_deg * off_deg;
            count += 1;
        }
    }
    let rms_deg = f64::sqrt(squares / f64::from(count));
    assert!(count > 100 && rms_deg < 3.0, "{rms_deg} deg in {count}");
}

/// A landing in the report: the height goes down to the ground in the landing's stages, the pad is seen, and the camera's pictures are
/// there; wherever the guard acts it says why.
#[test]
fn a_landing_is_in_the_report_with_its_heights_stages_pictures_and_the_guards_reasons() {
    let flown = Flown::landing();
    let steps: Vec<&Value> = flown.of_kind("step").collect();
    let highest_m = steps.iter().map(|step| number(&step["height_m"])).fold(0.0, f64::max);
    assert!((2.5..3.5).contains(&highest_m), "{highest_m} m");
    let end = steps[steps.len() - 1];
    assert_eq!((&end["landing"]["stage"], number(&end["height_m"]).abs() < 0.05), (&"landed".into(), true), "{end}");
    let mut stages: Vec<&str> = steps.iter().filter_map(|step| step["landing"]["stage"].as_str()).collect();
    stages.dedup();
    assert!(stages.windows(2).any(|pair| pair == ["centring", "descending"]), "{stages:?}");
    let descends = steps.iter().filter(|step| step["landing"]["stage"] == "descending");
    let (seen, all) =
        descends.fold((0, 0), |(seen, all), step| (seen + i32::from(step["landing"]["sees_pad"] == true), all + 1));
    assert!(all > 100 && seen * 10 > all * 9, "{seen} of {all}");
    let pictures: Vec<&Value> = flown.of_kind("picture").collect();
    assert!(pictures.len() > 30, "{}", pictures.len());
    // The first bytes of every PNG file, in Base64.
    assert!(pictures.iter().all(|picture| picture["png"].as_str().unwrap().starts_with("iVBORw0KGgo")));
    assert!(pictures.iter().any(|picture| picture["seen"] == "the pad" && picture.get("pad").is_some()));
    for step in steps {
        assert_eq!(step["guard"] == "passed", step.get("guard_reason").is_none(), "{step}");
    }
}

/// Has a browser look at a page; with `--briefly` without its controls, which are the same for every flight.
fn look_at(page: &str, more: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let path = text(&folder.path().join("flight.html"));
    std::fs::write(&path, page).unwrap();
    let said = checked_by("report_page.py", &[&[path.as_str()], more].concat());
    said.lines().filter(|line| line.contains("first picture")).for_each(|line| println!("{line}"));
}

/// A browser shows the report, its controls work, and it requests nothing from the network.
#[test]
#[ignore = "needs a browser: cargo xtask test"]
fn a_browser_shows_the_page_moves_through_it_and_asks_nobody() {
    let _machine = take_machine();
    look_at(&Flown::with(&[]).page, &[]);
}

/// A browser shows a landing and a long flight, which it moves through as fluently.
#[test]
#[ignore = "needs a browser: cargo xtask test"]
fn a_browser_shows_a_landing_and_a_long_flight() {
    let _machine = take_machine();
    look_at(&Flown::landing().page, &["--briefly"]);
    look_at(&flown_for(330.0).page, &["--briefly"]);
}

/// A flight that fails, in a scenario whose name is HTML, is shown correctly and its markup is not executed.
#[test]
#[ignore = "needs a browser: cargo xtask test"]
fn a_flight_that_goes_wrong_under_a_name_that_is_markup_is_shown_as_well() {
    let _machine = take_machine();
    let scenario = r#"{"name":"</script><img src=x onerror=alert(1)>","bearing":{"snr_db":20,"dropout":[2,99]},
        "obstacles":[{"x":3,"y":3,"r":0.4,"vx":0.1,"vy":-0.1}],"max_time_s":9}"#;
    let flown = Flown::of(scenario);
    assert_eq!((&flown.printed["result"], &flown.printed["reason"]), (&"hold".into(), &"no_signal".into()));
    look_at(&flown.page, &["--briefly"]);
}
