//! The missions that the image can fly: it has its built-in configuration, changed by FH_ parameters.

use foxhound_core::guidance;
use foxhound_core::guidance::param::{Id, Values};

use crate::drive::flight::Mission;
use crate::scenario::input::InputError;
use crate::scenario::{BearingModel, SensorModel, Software};

/// What a mission needs before take-off.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Needs {
    parameters: Vec<(Id, f32)>,
    /// The simulated flight begins in the air: a board that starts then is silent towards PX4 until it is told to continue.
    pub(super) continues: bool,
}

impl Needs {
    /// The parameters to be set over MAVLink before take-off for this mission, whose configuration may have been
    /// overridden, with these parameters. A sensor of circles is replaced by one of scans, which are sent as `OBSTACLE_DISTANCE`; a lidar is
    /// kept.
    ///
    /// # Errors
    /// The key of a setting without a parameter.
    pub fn of(mission: &mut Mission, config: &guidance::Config, values: &Values) -> Result<Self, InputError> {
        if mission.scenario.sensor.model == SensorModel::Circles {
            mission.scenario.sensor.model = SensorModel::Scan;
        }
        let scenario = &mission.scenario;
        let refuse = |key: &str, why: &str| Err(InputError::new(format!("--via g474: {key}: {why}")));
        if scenario.bearing_model() == BearingModel::Noise {
            return refuse(
                "bearing.model",
                "the image needs waveforms (rf; --snr-db selects them) or the bytes of a radio (uudf, hci)",
            );
        }
        if scenario.faults.nan_bearing.is_some() {
            return refuse("faults.nan_bearing", "the image accepts no bearings from outside");
        }
        if scenario.faults.clock_back_s.is_some() {
            return refuse("faults.clock_back_s", "the board keeps its own time");
        }
        let reached = reached_with(*values, config);
        match first_difference(config, &reached) {
            Some(key) => refuse(key, "no parameter of the image sets this"),
            None => Ok(Self {
                continues: scenario.vehicle.autopilot == Software::Px4,
                parameters: Id::all()
                    .map(|id| (id, values.get(id)))
                    .filter(|(id, value)| value.to_bits() != Values::DEFAULT.get(*id).to_bits())
                    .collect(),
            }),
        }
    }

    /// Parameters that differ from the default.
    #[must_use]
    pub fn parameters(&self) -> &[(Id, f32)] {
        &self.parameters
    }
}

/// The image's configuration with these values. It has its own seeds.
fn reached_with(values: Values, wanted: &guidance::Config) -> guidance::Config {
    let mut reached = guidance::Config::default();
    values.apply(&mut reached);
    reached.seed = wanted.seed;
    if let (Some(reached), Some(wanted)) = (&mut reached.planner.explore, &wanted.planner.explore) {
        reached.seed = wanted.seed;
    }
    reached
}

/// The key of a mission in which they differ.
fn first_difference(wanted: &guidance::Config, reached: &guidance::Config) -> Option<&'static str> {
    let keys = [
        ("--planner", wanted.planner.kind != reached.planner.kind),
        ("--estimator", wanted.bearing.estimator != reached.bearing.estimator),
        ("bearing.only", wanted.known_source_ned_m != reached.known_source_ned_m),
        ("antenna", wanted.turning != reached.turning),
        ("landing", wanted.landing != reached.landing),
        ("explore_s", wanted.planner.explore != reached.planner.explore),
        ("limits", wanted.guard != reached.guard),
        ("vehicle", wanted.vehicle_model != reached.vehicle_model),
        ("scenario", wanted != reached),
    ];
    keys.into_iter().find(|(_, differs)| *differs).map(|(key, _)| key)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;
    use foxhound_core::doa::bearing::Estimator;
    use foxhound_core::guidance::param;
    use foxhound_core::planning::planner;

    fn mission(text: Option<&str>) -> Mission {
        let scenario = text.map_or_else(Scenario::built_in, |text| Scenario::parse(text).unwrap());
        Mission { scenario, seed: 3, planner: planner::Config::default(), estimator: Estimator::default() }
    }

    fn needs(mission: &mut Mission) -> Result<Needs, String> {
        let config = mission.guidance();
        Needs::of(mission, &config, &Values::of(&config)).map_err(|error| error.to_string())
    }

    #[test]
    fn the_built_in_mission_needs_nothing_and_what_parameters_set_is_set() {
        assert_eq!(needs(&mut mission(None)), Ok(Needs::default()));
        let mut slow = mission(Some(
            r#"{"bearing":{"snr_db":20},"vehicle":{"model":"arducopter"},"limits":{"v_max":0.7},"sensor":{"range_m":4}}"#,
        ));
        let set = needs(&mut slow).unwrap();
        assert_eq!(set.parameters(), [(param::FH_SPD_MAX, 0.7), (param::FH_OBS_RANGE, 4.0)]);
        assert_eq!(slow.scenario.sensor.model, SensorModel::Scan, "circles are no message");
    }

    #[test]
    fn what_the_image_cannot_know_is_refused_by_its_key() {
        let refused = |text| needs(&mut mission(Some(text))).unwrap_err();
        assert!(refused(r#"{"bearing":{"sigma_deg":2}}"#).contains("bearing.model"));
        assert!(refused(r#"{"bearing":{"snr_db":20,"only":false}}"#).contains("bearing.only"));
        assert!(refused(r#"{"bearing":{"snr_db":20},"faults":{"clock_back_s":4}}"#).contains("faults.clock_back_s"));
        let mut paper = mission(None);
        paper.planner = foxhound_papers::apf::named("paper").unwrap();
        assert!(needs(&mut paper).unwrap_err().contains("--planner"));
    }
}
