//! What the belief about the source says of its own errors, in flight.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_core::doa::bearing::Estimator;
use foxhound_core::localize::source::Estimate;
use foxhound_core::planning::planner;
use foxhound_sim::drive::computer::HostComputer;
use foxhound_sim::drive::flight::{self, Mission};
use foxhound_sim::scenario::Scenario;
use foxhound_sim::study::seeds;
use foxhound_tests::root;
use serde_json::{Value, json};

const FLIGHTS: u64 = 40;
/// Among walls a flight has few samples, which are off together: the median of 40 flights would be that of a few.
const AMONG_WALLS: u64 = 200;
/// A position is compared as often as this, where its range is known to this share.
const EVERY_S: f64 = 0.5;
const RANGE_KNOWN: f32 = 0.3;

#[derive(Debug, Default)]
struct Row {
    /// Normalised squared errors of the position, over its two degrees of freedom, and the errors themselves.
    nees: Vec<f64>,
    errors_m: Vec<f64>,
    /// Normalised squared innovations of the leading filter, as it averages them.
    nis: Vec<f64>,
    /// Time of each flight until the position was known, and known to a metre.
    one_metre_s: Vec<f64>,
}

impl Row {
    /// Flies a scenario on held-out seeds, with other fields where `over` has them.
    fn fly(file: &str, over: &Value, flights: u64) -> Self {
        let mut world: Value = serde_json::from_str(&std::fs::read_to_string(root().join(file)).unwrap()).unwrap();
        world.as_object_mut().unwrap().extend(over.as_object().unwrap().clone());
        let scenario = Scenario::parse(&world.to_string()).unwrap();
        let mut row = Self::default();
        seeds::test(flights).for_each(|seed| row.fly_once(scenario.clone(), seed));
        row
    }

    fn fly_once(&mut self, scenario: Scenario, seed: u64) {
        let [east_m, north_m] = scenario.goal;
        let mission =
            Mission { scenario, seed, planner: planner::Config::default(), estimator: Estimator::CrossSpectrum };
        let mut computer = HostComputer::new(&mission.guidance()).unwrap();
        let (mut due_s, mut is_found) = (0.0, false);
        flight::fly(&mission, &mut computer, None, |moment| {
            let time_s = moment.sample.time_s;
            if time_s < due_s {
                return;
            }
            due_s = time_s + EVERY_S;
            let known = moment.computer.inside().and_then(|one| one.state().belief().direct());
            let known = known.filter(|known| known.range_sigma_ratio < RANGE_KNOWN);
            if let Some((known, (_, nis))) = known.zip(moment.output.source_share_and_nis) {
                let (nees, error_m) = normalised(&known, north_m, east_m);
                self.nees.push(nees);
                self.errors_m.push(error_m);
                self.nis.push(f64::from(nis));
                if error_m < 1.0 && !is_found {
                    is_found = true;
                    self.one_metre_s.push(time_s);
                }
            }
        })
        .unwrap();
    }
}

/// The normalised squared error of a position, over its degrees of freedom, and the error.
fn normalised(estimate: &Estimate, north_m: f64, east_m: f64) -> (f64, f64) {
    let [nn, ne, ee] = estimate.covariance_m2.map(f64::from);
    let [n, e] = [f64::from(estimate.place_ned_m.north) - north_m, f64::from(estimate.place_ned_m.east) - east_m];
    ((ee * n * n - 2.0 * ne * n * e + nn * e * e) / (nn * ee - ne * ne) / 2.0, n.hypot(e))
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Asked for are normalised squared errors of 0.8 to 1.25 in the mean. In line of sight they are below 1.25, and below 2 where two
/// of five bearings are from anywhere; below 0.8 where bearings are good: the filter allows for errors of the vehicle's own
/// position, which these flights do not have. Among walls, where errors by other paths last for metres, their median is about one, but
/// some are far larger and so is the mean: NOT reached.
#[test]
fn in_line_of_sight_the_belief_errs_as_much_as_it_says() {
    let good = json!({"sensor": {"model": "scan"}, "bearing": {"snr_db": 20}});
    let poor = json!({"sensor": {"model": "scan"}, "bearing": {"sigma_deg": 5}});
    let outliers = json!({"sensor": {"model": "scan"},
        "bearing": {"sigma_deg": 5, "outlier": {"rate": 0.4, "anywhere": true}}});
    let as_it_is = json!({});
    let (open, forest) = ("tests/scenarios/open_field.json", "scenarios/random_forest.json");
    // Most that the mean of the normalised squared errors may be, and the median of the errors.
    let rows = [
        ("open, 20 dB", open, &good, 1.25, 0.1),
        ("open, sigma 5 deg", open, &poor, 1.25, 0.5),
        ("open, two of five from anywhere", open, &outliers, 2.0, 0.6),
        ("forest, 20 dB", forest, &good, 1.25, 0.2),
        ("forest, sigma 5 deg", forest, &poor, 1.25, 0.8),
        ("forest, two of five from anywhere", forest, &outliers, 2.0, 1.0),
    ];
    let among_walls = [
        ("corridor", "tests/scenarios/corridor.json", &as_it_is, 3.0, 2.0),
        ("around the corner", "scenarios/around_the_corner.json", &as_it_is, 25.0, 2.0),
    ];
    let rows = rows.map(|row| (row, FLIGHTS)).into_iter().chain(among_walls.map(|row| (row, AMONG_WALLS)));
    let mut broken = Vec::new();
    for ((name, file, over, mean_max, error_max_m), flights) in rows {
        let row = Row::fly(file, over, flights);
        println!(
            "| {name} | {} | {:.2} | {:.2} | {:.2} | {:.2} | {} of {flights} | {:.1} |",
            row.nees.len(),
            mean(&row.nees),
            median(&row.nees),
            mean(&row.nis),
            median(&row.errors_m),
            row.one_metre_s.len(),
            median(&row.one_metre_s)
        );
        let holds = mean(&row.nees) <= mean_max && median(&row.nees) <= 1.25 && median(&row.errors_m) <= error_max_m;
        broken.extend((!holds).then_some(name));
    }
    assert!(broken.is_empty(), "{broken:?}");
}
