//! Stores the parameters of the computer in this process in a file that people write, too.

use std::path::{Path, PathBuf};

use foxhound_computer::flight::ParameterStore;
use foxhound_core::guidance;
use foxhound_core::guidance::param::Values;

use super::HostComputer;
use crate::scenario::input::{InputError, read_text};
use crate::scenario::params::{self, Given};

/// A file of parameters, and the values for those that it does not have.
#[derive(Clone, Debug)]
pub(super) struct Store {
    path: PathBuf,
    base: guidance::Config,
}

impl HostComputer {
    /// A computer that has just been switched on, with the parameters of a file, which override the configuration.
    /// Parameters stored by `MAV_CMD_PREFLIGHT_STORAGE` are written to that file.
    ///
    /// # Errors
    /// What is wrong with the file, or the field of the configuration that is refused.
    pub fn with_store(config: &guidance::Config, path: &Path) -> Result<Self, InputError> {
        let mut computer = Self::new(config)?;
        let store = Store { path: path.to_owned(), base: *config };
        // What a power cut left of what was stored would be all defaults.
        if read_text(path)?.trim().is_empty() {
            return Err(InputError::new("is empty: expected lines NAME = VALUE").in_file(path));
        }
        let values = store.read()?;
        computer.parts().0.run_with(values).map_err(|error| Given::from(values).named(error).in_file(path))?;
        computer.store = Some(store);
        Ok(computer)
    }
}

impl Store {
    /// The parameters with those of the file.
    fn read(&self) -> Result<Values, InputError> {
        let mut given = Given::default();
        given.read(&self.path)?;
        let mut config = self.base;
        given.apply(&mut config);
        let mut values = Values::of(&config);
        given.overrule(&mut values);
        Ok(values)
    }
}

impl ParameterStore for Store {
    fn save(&mut self, values: &Values) -> bool {
        params::write(&self.path, values).is_ok()
    }

    fn load(&mut self) -> Option<Values> {
        self.read().ok()
    }

    fn reset(&mut self) -> bool {
        self.save(&Values::DEFAULT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::computer::Computer as _;
    use foxhound_core::base::time::Instant;
    use foxhound_core::guidance::FrontEnd;
    use foxhound_core::guidance::param::{self, Id};
    use foxhound_link::dialect::{COMMAND_LONG_DATA, MavMessage, PARAM_SET_DATA};
    use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode_data};
    use foxhound_link::{CharArray, MessageData};

    const PREFLIGHT_STORAGE: u16 = 245;

    #[test]
    fn an_empty_file_is_not_taken_for_all_defaults() {
        let path = std::env::temp_dir().join(format!("foxhound-empty-{}.toml", std::process::id()));
        std::fs::write(&path, "\n").unwrap();
        let refused = HostComputer::with_store(&guidance::Config::default(), &path).unwrap_err().to_string();
        assert!(refused.contains("is empty: expected lines NAME = VALUE"), "{refused}");
        std::fs::remove_file(path).unwrap();
    }

    /// Sends a message to the computer as a ground station, and returns the answer to its command.
    fn tell<D: MessageData>(computer: &mut HostComputer, now: &mut Instant, data: &D) -> Option<u8> {
        let mut frame = [0; FRAME_MAX];
        let length = encode_data(Header { system_id: 255, component_id: 190, sequence: 0 }, data, &mut frame);
        let (mut framer, mut result) = (Framer::new(), None);
        for step in 0..100 {
            *now = now.plus_micros(20_000);
            let rx = if step == 0 { &frame[..length] } else { &[] };
            let tx = &computer.step(*now, FrontEnd::Nothing, None, rx).unwrap().tx;
            framer.each(tx, |frame| {
                if let Some(MavMessage::COMMAND_ACK(answer)) = frame.message() {
                    result = Some(answer.result);
                }
            });
        }
        result
    }

    fn storage(param1: f32) -> COMMAND_LONG_DATA {
        let (target_system, target_component) = (1, 191);
        COMMAND_LONG_DATA { target_system, target_component, command: PREFLIGHT_STORAGE, param1, ..Default::default() }
    }

    fn set(id: Id, param_value: f32) -> PARAM_SET_DATA {
        PARAM_SET_DATA {
            target_system: 1,
            target_component: 191,
            param_id: CharArray::new(*id.padded_name()),
            param_type: 9,
            param_value,
        }
    }

    #[test]
    fn what_a_station_sets_and_stores_stands_in_the_file_and_holds_after_the_next_start() {
        let path = std::env::temp_dir().join(format!("foxhound-store-test-{}.toml", std::process::id()));
        std::fs::write(&path, "FH_RADIUS = 0.3\nFH_SILENT = 7\n").unwrap();
        let mut config = guidance::Config::default();
        config.guard.v_max_mps = 2.5;
        let mut now = Instant(0);
        let mut computer = HostComputer::with_store(&config, &path).unwrap();
        let read = |computer: &HostComputer| {
            let values = computer.companion.parameters();
            [param::FH_SPD_MAX, param::FH_RADIUS, param::FH_SILENT, param::FH_LND_OUT].map(|id| values.get(id))
        };
        assert_eq!(read(&computer), [2.5, 0.3, 7.0, 0.0], "the file overrules, for the link, too");
        tell(&mut computer, &mut now, &set(param::FH_SPD_MAX, 1.7));
        tell(&mut computer, &mut now, &set(param::FH_LND_OUT, 1.0));
        assert_eq!(read(&computer), [1.7, 0.3, 7.0, 1.0]);
        assert_eq!(computer.config.guard.v_max_mps, 1.7);
        assert_eq!(tell(&mut computer, &mut now, &storage(1.0)), Some(0), "saved");
        let mut again = HostComputer::with_store(&config, &path).unwrap();
        assert_eq!(again.companion.parameters(), computer.companion.parameters());

        tell(&mut again, &mut now, &set(param::FH_SPD_MAX, 0.9));
        assert_eq!(tell(&mut again, &mut now, &storage(0.0)), Some(0), "loaded");
        assert_eq!(read(&again), [1.7, 0.3, 7.0, 1.0]);
        assert_eq!(again.config.guard.v_max_mps, 1.7);
        assert_eq!(tell(&mut again, &mut now, &storage(2.0)), Some(0), "reset");
        assert_eq!(again.companion.parameters(), &Values::DEFAULT);
        let given = HostComputer::with_store(&config, &path).unwrap();
        assert_eq!(given.companion.parameters(), &Values::DEFAULT);

        // A damaged file is not loaded, and the parameters stay as they were.
        std::fs::write(&path, "FH_SPD_MAX = 99\n").unwrap();
        assert_ne!(tell(&mut again, &mut now, &storage(0.0)), Some(0));
        assert_eq!(again.companion.parameters(), &Values::DEFAULT);
        std::fs::remove_file(&path).unwrap();
        assert!(HostComputer::with_store(&config, &path).unwrap_err().to_string().contains("foxhound-store-test"));
        assert_ne!(
            tell(&mut HostComputer::new(&config).unwrap(), &mut now, &storage(1.0)),
            Some(0),
            "there is no file"
        );
    }
}
