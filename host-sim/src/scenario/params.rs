//! Parameters as a user gives them: assignments on the command line and flat TOML files, checked like all input
//! before a flight; and the manual's page about them.

use std::fmt::Write as _;
use std::path::Path;

use foxhound_core::ConfigError;
use foxhound_core::guidance;
use foxhound_core::guidance::param::{self, Field, Id, Kind, Param, TABLE, Values};
use foxhound_link::companion;

use super::input::{InputError, read_text};
use super::{BearingModel, Scenario, SensorModel, output};

/// Longest turn of a simulated sensor, as the scenario has it.
const TURN_MAX_S: f64 = 0.1;
/// Samples in a frame; they limit how narrow a tone's band can be.
const SAMPLES: usize = 256;

/// Fields of a configuration that are refused because of others, the parameters that hold them, and those that they must fit.
const TOGETHER: [(&str, &str, &[&str]); 19] = [
    ("vehicle.radius_m + planner.margin_m", "FH_RADIUS + FH_MARGIN", &["FH_RADIUS", "FH_MARGIN"]),
    ("link.heartbeat_timeout_s", "FH_HB_TMO", &["FH_SILENT"]),
    ("link.silence_after_s", "FH_SILENT", &["FH_HB_TMO"]),
    ("side_m", "FH_ARR_SIDE", &["FH_WAVELEN"]),
    ("planner.tight_margin_m", "FH_MARGIN_TGT", &["FH_MARGIN"]),
    ("phase.tone_band_hz", "FH_TONE_LO, FH_TONE_HI", &["FH_TONE_LO", "FH_TONE_HI", "FH_SMP_RATE"]),
    ("phase.tone_hz", "FH_TONE", &["FH_SMP_RATE"]),
    ("radio", "FH_BRG_SRC", &["FH_OBS_SRC", "FH_TURN"]),
    ("turning.yaw_rate_radps", "FH_TURN_RATE", &["FH_YAWR_MAX"]),
    ("fence.radius_m", "FH_FENCE_R", &[]),
    ("fence.margin_m", "FH_FENCE_MRG", &["FH_FENCE_R"]),
    ("explore.limit_s", "FH_SRCH_TIME", &[]),
    ("vehicle_model.dead_time_s", "FH_DEAD_TIME", &[]),
    ("vehicle.radius_m", "FH_RADIUS", &["FH_OBS_MIN", "FH_OBS_FOV"]),
    ("planner.margin_m", "FH_MARGIN", &[]),
    (
        "guard.v_max_mps",
        "FH_SPD_MAX",
        &[
            "FH_ACC_MAX",
            "FH_OBS_RANGE",
            "FH_RADIUS",
            "FH_MARGIN_GRD",
            "FH_DEAD_TIME",
            "FH_LAG",
            "FH_STALL_T",
            "FH_STALL_R",
            "FH_YAWR_MAX",
        ],
    ),
    ("sensor.lag_s", "FH_OBS_LAG", &["FH_OBS_TURN", "FH_OBS_AGE"]),
    ("sensor.range_m", "FH_OBS_RANGE", &["FH_RADIUS"]),
    ("landing.pad_radius_m", "FH_PAD_R", &["FH_CAM_FOCAL"]),
];

/// The given parameters, and the full set with them.
#[derive(Clone, Debug, Default)]
pub struct Given {
    values: Values,
    ids: Vec<Id>,
}

impl From<Values> for Given {
    fn from(values: Values) -> Self {
        Self { values, ids: Id::all().collect() }
    }
}

impl Given {
    /// Takes in the `NAME = VALUE` lines of a file.
    ///
    /// # Errors
    /// The file and the line's name, with what would have been accepted.
    pub fn read(&mut self, path: &Path) -> Result<(), InputError> {
        self.parse(&read_text(path)?).map_err(|error| error.in_file(path))
    }

    fn parse(&mut self, text: &str) -> Result<(), InputError> {
        let table: toml::Table =
            text.parse().map_err(|error: toml::de::Error| InputError::new(error.to_string().trim_end()))?;
        for (name, value) in &table {
            let value = match value {
                toml::Value::Float(value) => *value,
                toml::Value::Integer(value) => *value as f64,
                other => {
                    return Err(InputError::new(format!("{name}: expected a number, not {}", other.type_str())));
                }
            };
            self.set(name, value)?;
        }
        Ok(())
    }

    /// Takes in one `NAME=VALUE`.
    ///
    /// # Errors
    /// What is wrong with it, and what would have been accepted.
    pub fn assign(&mut self, assignment: &str) -> Result<(), InputError> {
        let (name, value) =
            assignment.split_once('=').ok_or_else(|| InputError::new(format!("{assignment}: expected NAME=VALUE")))?;
        let (name, value) = (name.trim(), value.trim());
        let number = value.parse().map_err(|_| InputError::new(format!("{name}: expected a number, not `{value}`")))?;
        self.set(name, number)
    }

    /// Takes in one value.
    ///
    /// # Errors
    /// What is wrong with it, and what would have been accepted.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), InputError> {
        let id = Id::named(name.as_bytes()).filter(|_| !name.contains('\0')).ok_or_else(|| unknown(name))?;
        let refused = |refusal| InputError::new(format!("{name} = {value} {refusal}"));
        self.values.set(id, value as f32).map_err(refused)?;
        self.ids.push(id);
        Ok(())
    }

    /// Whether none is given.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// All values: the given ones, and the defaults.
    #[must_use]
    pub fn values(&self) -> &Values {
        &self.values
    }

    /// Writes only the given parameters into a configuration of guidance. Those that belong together and are not given are as the
    /// configuration has them.
    pub fn apply(&self, config: &mut guidance::Config) {
        let mut values = Values::of(config);
        self.overrule(&mut values);
        self.ids.iter().for_each(|id| values.apply_one(*id, config));
    }

    /// The given parameters, with all others as a configuration has them.
    #[must_use]
    pub fn beside(&self, config: &guidance::Config) -> Self {
        let mut values = Values::of(config);
        self.overrule(&mut values);
        Self { values, ids: self.ids.clone() }
    }

    /// Refuses parameters of the link that are not the defaults, for a computer that is given a configuration of guidance only.
    ///
    /// # Errors
    /// The first of them.
    pub fn refuse_of_link(&self) -> Result<(), InputError> {
        let is_of_link = |id: &&Id| TABLE.get(id.index()).is_some_and(|row| matches!(row.field, Field::Link));
        let differs = |id: &&Id| self.values.get(**id) != id.default();
        self.ids.iter().filter(is_of_link).find(differs).map_or(Ok(()), |id| {
            let why = "is a parameter of the link, which the image in QEMU has as built";
            Err(InputError::new(format!("--params: {} {why}", id.name())))
        })
    }

    /// The value of a parameter, given or not.
    fn of(&self, name: &str) -> Option<f32> {
        Id::named(name.as_bytes()).map(|id| self.values.get(id))
    }

    /// Writes what the given parameters say of the vehicle and its obstacle sensor into the simulated ones.
    pub fn describe(&self, scenario: &mut Scenario) {
        let given = |name: &str| self.ids.iter().find(|id| id.name() == name).map(|id| self.values.get(*id));
        let Scenario { drone_radius, sensor, .. } = scenario;
        let bearing = &mut scenario.bearing;
        if given("FH_OBS_SRC") == Some(1.0) {
            sensor.model = SensorModel::Lidar;
        }
        let was_radio = matches!(bearing.model, Some(BearingModel::Uudf | BearingModel::Hci));
        match given("FH_BRG_SRC") {
            Some(1.0) => bearing.model = Some(BearingModel::Uudf),
            Some(2.0) => bearing.model = Some(BearingModel::Hci),
            Some(_) if was_radio => bearing.model = None,
            _ => {}
        }
        // The number that was written, which one of 32 bits only comes near to.
        let write = |value: f32, field: &mut f64| *field = value.to_string().parse().unwrap_or(*field);
        for (name, field) in [
            ("FH_RADIUS", drone_radius),
            ("FH_OBS_RANGE", &mut sensor.range_m),
            ("FH_OBS_FOV", &mut sensor.fov_deg),
            ("FH_OBS_TURN", &mut sensor.turn_s),
            ("FH_OBS_LAG", &mut sensor.lag_s),
        ] {
            if let Some(value) = given(name) {
                write(value, field);
            }
        }
        if matches!(bearing.model, Some(BearingModel::Uudf | BearingModel::Hci)) {
            // A radio that the scenario has not is wholly that of the parameters, which have defaults.
            let of_radio = |name: &str| given(name).or((!was_radio).then(|| self.of(name)).flatten());
            for (name, field) in [("FH_BRG_YAW", &mut bearing.mount_deg), ("FH_BRG_SIGMA", &mut bearing.sigma_deg)] {
                if let Some(value) = of_radio(name) {
                    write(value, field);
                }
            }
            if let Some(tag) = of_radio("FH_BRG_TAG") {
                bearing.tag = tag as u32;
            }
        }
        // A simulated turn takes no longer, and goes the usual way round.
        sensor.turn_s = sensor.turn_s.clamp(0.0, TURN_MAX_S);
    }

    /// Writes only the given parameters over other values.
    pub fn overrule(&self, values: &mut Values) {
        for id in &self.ids {
            // It was accepted when it was given.
            let _ = values.set(*id, self.values.get(*id));
        }
    }

    /// Checks whether all values fit together.
    ///
    /// # Errors
    /// The field that does not.
    pub fn check(&self) -> Result<(), InputError> {
        let mut config = guidance::Config::default();
        self.values.apply(&mut config);
        config.build::<SAMPLES>().map_err(|error| self.named(error))?;
        self.check_link()
    }

    /// The error in the words of the parameters, with the values of those that the refused one must fit.
    #[must_use]
    pub fn named(&self, error: ConfigError) -> InputError {
        let is_given = |names: &[&str]| self.ids.iter().any(|id| names.contains(&id.name()));
        let found = TOGETHER.iter().find(|(field, ..)| *field == error.field);
        // What no given parameter has to do with is the fault of a scenario.
        let Some((_, _, others)) = found.filter(|(_, name, others)| is_given(&[name]) || is_given(others)) else {
            return error.into();
        };
        let words = |text: String, (field, name, _): &(&str, &str, _)| text.replace(field, name);
        let text = TOGETHER.iter().fold(error.to_string(), words);
        let other = |name: &&str| Some(format!("{name} = {}", self.values.get(Id::named(name.as_bytes())?)));
        let others: Vec<String> = others.iter().filter_map(other).collect();
        InputError::new(if others.is_empty() { text } else { format!("{text} ({})", others.join(", ")) })
    }

    /// Checks whether those of the link fit together; those of guidance are checked with the rest of its
    /// configuration.
    ///
    /// # Errors
    /// The field that does not.
    pub fn check_link(&self) -> Result<(), InputError> {
        companion::Config {
            setpoint_age_max_s: self.values.get(param::FH_SP_AGE),
            heartbeat_timeout_s: self.values.get(param::FH_HB_TMO),
            silence_after_s: self.values.get(param::FH_SILENT),
            ..companion::Config::default()
        }
        .build()
        .map_err(|error| self.named(error))?;
        Ok(())
    }
}

/// Writes all values to a file, completely or not at all.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, values: &Values) -> Result<(), InputError> {
    let text = Id::all().fold(String::new(), |mut text, id| {
        let _ = writeln!(text, "{} = {}", id.name(), values.get(id));
        text
    });
    output::write(path, text.as_bytes())
}

fn unknown(name: &str) -> InputError {
    let likeness = |row: &Param| strsim::jaro_winkler(&name.to_uppercase(), row.name);
    let nearest = TABLE.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
    InputError::new(match nearest.filter(|row| likeness(row) > 0.8) {
        Some(row) => format!("{name}: unknown parameter; did you mean `{}`?", row.name),
        None => format!("{name}: unknown parameter; `foxhound params` lists them"),
    })
}

/// The range of a row as text.
#[must_use]
pub fn range(row: &Param) -> String {
    match (row.kind, row.min, row.max) {
        (Kind::Whole, 0.0, 1.0) => "0 or 1".to_owned(),
        (_, min, max) => format!("{min} to {max}"),
    }
}

/// The manual's page.
#[must_use]
pub fn page() -> String {
    let mut page = format!(
        "# Parameters

A ground station lists and sets these {} parameters on component 191; `foxhound params` lists them too and checks a file
of them. This page is what `foxhound params --markdown` prints.

A parameter is a float of 32 bits (`REAL32`). A value outside its range, one that is not whole where it must be, one that
does not fit the others, and any while the vehicle seeks is refused: the station hears the old value and a text that says
why. A value that is accepted holds at once. `MAV_CMD_PREFLIGHT_STORAGE` to component 191 stores what holds (`param1` 1), goes back
to what is stored (0), or erases everything that is stored, the calibration and the signing key too (2), after which the defaults hold:
the [factory reset](maintenance.md).

| name | default | unit | range | what it does |
| --- | ---: | --- | --- | --- |
",
        TABLE.len()
    );
    for row in TABLE {
        let _ = writeln!(page, "| `{}` | {} | {} | {} | {} |", row.name, row.default, row.unit, range(row), row.doc);
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_simulated_radio_is_the_one_that_the_given_parameters_describe() {
        let described = |text: &str, model: Option<BearingModel>| {
            let mut given = Given::default();
            given.parse(text).unwrap();
            let mut scenario = Scenario::default();
            (scenario.bearing.model, scenario.bearing.sigma_deg) = (model, 3.0);
            given.describe(&mut scenario);
            let bearing = scenario.bearing;
            (bearing.model, bearing.sigma_deg, bearing.mount_deg, bearing.tag)
        };
        let (uudf, hci) = (Some(BearingModel::Uudf), Some(BearingModel::Hci));
        assert_eq!(described("FH_BRG_SRC = 1", None), (uudf, 8.0, 0.0, 0), "the parameters' defaults");
        assert_eq!(described("FH_BRG_SRC = 1\nFH_BRG_YAW = -90\nFH_BRG_TAG = 7", None), (uudf, 8.0, -90.0, 7));
        assert_eq!(described("FH_BRG_SIGMA = 5", hci), (hci, 5.0, 0.0, 0), "and else those of the scenario");
        assert_eq!(described("FH_BRG_YAW = 10", None), (None, 3.0, 0.0, 0), "without a radio");
        assert_eq!(described("FH_BRG_SRC = 0", uudf).0, None);
    }

    #[test]
    fn the_simulated_vehicle_is_the_one_that_the_given_parameters_describe() {
        let mut given = Given::default();
        given.parse("FH_RADIUS = 0.25\nFH_OBS_FOV = 180").unwrap();
        let mut scenario = Scenario { drone_radius: 0.2, ..Scenario::default() };
        let range_m = scenario.sensor.range_m;
        given.describe(&mut scenario);
        assert_eq!((scenario.drone_radius, scenario.sensor.fov_deg, scenario.sensor.range_m), (0.25, 180.0, range_m));
        assert!(given.refuse_of_link().is_ok());
        given.set("FH_RC_CH", 7.0).unwrap();
        assert!(given.refuse_of_link().unwrap_err().to_string().contains("FH_RC_CH"));
    }
}
