//! Simulated flights: one, or all of a suite.

use std::collections::BTreeMap;

use foxhound_core::doa::bearing::Estimator;
use foxhound_core::planning::planner;
use foxhound_papers::apf;
use foxhound_sim::drive::flight::{Mission, Moment, Record, fly_until};
use foxhound_sim::drive::suite::{self, Flight, Flown, Selection};
use foxhound_sim::record::table::{COLUMNS, Values};
use foxhound_sim::scenario::Scenario;
use foxhound_sim::scenario::input::{InputError, check};
use foxhound_sim::scenario::params::Given;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{Column, Source, Table, from_json, refused, work};

/// A step of a flight.
struct Step {
    sample: foxhound_sim::drive::flight::Sample,
    output: foxhound_core::guidance::Output,
}

/// A planner by its name.
fn planner(name: &str) -> Result<planner::Config, InputError> {
    let unknown = || InputError::new(format!("planner = {name:?}: expected one of {}", apf::NAMES.join(", ")));
    apf::named(name).ok_or_else(unknown)
}

/// Flies one mission, as `foxhound fly` does: the dictionary that its `--json` prints, and two tables more.
///
/// `scenario` is a file, a dictionary with the keys of such a file, or nothing for the built-in forest; `params` are
/// parameters by name. `path` has a row for each step: the place, what was heard and what was commanded, north, east
/// and down. `obstacles` has the true pillars at the start.
#[pyfunction]
#[pyo3(signature = (scenario=None, *, seed=1, snr_db=None, planner="foxhound", params=None))]
pub(crate) fn fly<'py>(
    py: Python<'py>,
    scenario: Option<&Bound<'py, PyAny>>,
    seed: u64,
    snr_db: Option<f64>,
    planner: &str,
    params: Option<BTreeMap<String, f64>>,
) -> PyResult<Bound<'py, PyDict>> {
    let source = scenario.map(Source::of).transpose()?;
    let (record, steps) = work(py, |stop| {
        let mut scenario = match source {
            None => Scenario::built_in(),
            Some(Source::File(path)) => Scenario::read(&path, seed)?,
            Some(Source::Json(text)) => Scenario::parse(&text)?.drawn(seed)?,
        };
        if let Some(snr_db) = snr_db {
            scenario.bearing.set_snr_db("snr_db", snr_db)?;
        }
        let planner = self::planner(planner)?;
        let mut mission = Mission { scenario, seed, planner, estimator: Estimator::default() };
        let mut given = Given::default();
        params.iter().flatten().try_for_each(|(name, value)| given.set(name, *value))?;
        let (_, mut computer) = mission.with_parameters(&given)?;
        let mut steps = Vec::new();
        let watch = |moment: &Moment<'_>| steps.push(Step { sample: *moment.sample, output: *moment.output });
        let record = fly_until(&mission, &mut computer, None, stop, watch);
        Ok((record.map_err(|error| InputError::new(error.to_string()))?, steps))
    })?;
    let flight = from_json(py, &record.report)?;
    flight.set_item("path", path(py, &steps)?)?;
    flight.set_item("obstacles", obstacles(py, &record)?)?;
    Ok(flight)
}

fn path<'py>(py: Python<'py>, steps: &[Step]) -> PyResult<Bound<'py, PyDict>> {
    let table = Table::new(py);
    let numbers: [Column<Step>; 11] = [
        ("time_s", |step| Some(step.sample.time_s)),
        ("north_m", |step| Some(step.sample.position.north)),
        ("east_m", |step| Some(step.sample.position.east)),
        ("down_m", |step| Some(step.sample.down_m)),
        ("yaw_rad", |step| Some(step.sample.yaw_rad)),
        ("speed_mps", |step| Some(step.sample.speed_mps)),
        ("bearing_ned_rad", |step| step.output.bearing_ned_rad.map(f64::from)),
        ("setpoint_north_mps", |step| Some(step.output.setpoint.velocity_ned_mps.north.into())),
        ("setpoint_east_mps", |step| Some(step.output.setpoint.velocity_ned_mps.east.into())),
        ("setpoint_down_mps", |step| Some(step.output.setpoint.velocity_ned_mps.down.into())),
        ("setpoint_yaw_rate_radps", |step| Some(step.output.setpoint.yaw_rate_radps.into())),
    ];
    for (name, of) in numbers {
        table.numbers(name, steps.iter().map(of))?;
    }
    table.add("outcome", "O", steps.iter().map(|step| step.sample.outcome.name()))?;
    Ok(table.0)
}

fn obstacles<'py>(py: Python<'py>, record: &Record) -> PyResult<Bound<'py, PyDict>> {
    let table = Table::new(py);
    let pillars = || record.world.pillars.iter();
    table.numbers("north_m", pillars().map(|pillar| Some(pillar.center.north)))?;
    table.numbers("east_m", pillars().map(|pillar| Some(pillar.center.east)))?;
    table.numbers("radius_m", pillars().map(|pillar| Some(pillar.radius_m)))?;
    Ok(table.0)
}

/// A suite: maps with start/goal pairs, each of which is one flight. A file, or a dictionary with the keys of one.
#[pyclass(frozen, module = "foxhound")]
pub(crate) struct Suite(suite::Suite);

#[pymethods]
impl Suite {
    #[new]
    fn new(suite: &Bound<'_, PyAny>) -> PyResult<Self> {
        let read = match Source::of(suite)? {
            Source::File(path) => suite::Suite::read(&path),
            Source::Json(text) => suite::Suite::parse(&text),
        };
        read.map(Self).map_err(refused)
    }

    /// Flies it, `jobs` flights at a time, as `foxhound suite` does: the dictionary that its `--json` prints, with
    /// `rows` and `all`, and `flights`, the table of its `--csv`.
    ///
    /// `only` is `[row]`, `[row, instance]` or `[row, instance, pair]`; `pairs` the number of pairs of each map.
    #[pyo3(signature = (*, seed=1, jobs=None, planner="foxhound", only=Vec::new(), pairs=None, snr_db=None, bearing_sigma_deg=None))]
    #[expect(clippy::too_many_arguments, reason = "they have names in Python")]
    fn run<'py>(
        &self,
        py: Python<'py>,
        seed: u64,
        jobs: Option<usize>,
        planner: &str,
        only: Vec<u32>,
        pairs: Option<u32>,
        snr_db: Option<f64>,
        bearing_sigma_deg: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let flown = work(py, |stop| {
            let mut suite = self.0.clone();
            if let Some(sigma_deg) = bearing_sigma_deg {
                suite.bearing.set_sigma_deg("bearing_sigma_deg", sigma_deg)?;
            }
            if let Some(snr_db) = snr_db {
                suite.bearing.set_snr_db("snr_db", snr_db)?;
            }
            let selection = Selection { only, pairs, shard: None };
            suite.count(&selection)?;
            let (planner, estimator) = (self::planner(planner)?, Estimator::default());
            let jobs = jobs.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
            check("jobs", jobs as f64, 1.0, 1024.0)?;
            let flights = suite.flights(seed, &selection);
            let flights: Vec<(usize, &Flight)> = flights.iter().enumerate().collect();
            suite::fly_until(&flights, planner, estimator, jobs, stop, |_, _| Ok(()))
        })?;
        let flown: Vec<Flown> = flown.into_iter().flatten().collect();
        let result = from_json(py, &suite::Report::of(&flown))?;
        let table = Table::new(py);
        for column in COLUMNS {
            match column.values(&flown) {
                Values::Whole(values) => table.add(column.name, "i8", values.into_iter())?,
                Values::Number(values) => table.numbers(column.name, values.into_iter())?,
                Values::Text(values) => table.add(column.name, "O", values.into_iter())?,
            }
        }
        result.set_item("flights", table.0)?;
        Ok(result)
    }
}
