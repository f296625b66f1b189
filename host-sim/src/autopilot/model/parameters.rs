//! The few parameters that matter to a companion, with the defaults of their software.
//!
//! ArduPilot casts every value to a float; PX4 puts an integer's bytes into it, which read as a float give a number
//! like 1.4e-45 \[src\]. Unknown names are not answered \[mem\].

use foxhound_link::dialect::{PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA};

use super::{AUTOPILOT, Autopilot, is_for_us};
use crate::scenario::Software;

/// `MAV_PARAM_TYPE`.
const INT8: u8 = 2;
const INT32: u8 = 6;
const REAL32: u8 = 9;

#[derive(Clone, Debug)]
struct Parameter {
    name: &'static str,
    value: f64,
    kind: u8,
}

#[derive(Clone, Debug)]
pub(super) struct Parameters {
    by_bytes: bool,
    all: Vec<Parameter>,
}

impl Parameters {
    pub(super) fn of(software: Software) -> Self {
        let all: &[(&'static str, f64, u8)] = match software {
            // GUID_TIMEOUT: 3.0 s, 0.1 to 5 [src].
            Software::ArduCopter => &[
                ("GUID_TIMEOUT", 3.0, REAL32),
                ("RTL_ALT", 1500.0, INT32),
                ("FS_GCS_ENABLE", 0.0, INT8),
                ("FENCE_ENABLE", 0.0, INT8),
                ("AVOID_ENABLE", 3.0, INT8),
            ],
            // [src: commander_params, mavlink module.yaml]; RTL_RETURN_ALT of 60 m is more than a test can wait for.
            Software::Px4 => &[
                ("COM_OF_LOSS_T", 1.0, REAL32),
                ("COM_OBL_RC_ACT", 0.0, INT32),
                ("COM_RC_OVERRIDE", 1.0, INT32),
                ("COM_RCL_EXCEPT", 0.0, INT32),
                ("RTL_RETURN_ALT", 15.0, REAL32),
                ("MIS_TAKEOFF_ALT", 2.5, REAL32),
                ("MAV_1_FORWARD", 0.0, INT32),
            ],
        };
        let all = all.iter().map(|(name, value, kind)| Parameter { name, value: *value, kind: *kind }).collect();
        Self { by_bytes: software == Software::Px4, all }
    }

    /// The value; zero for an unknown parameter.
    pub(super) fn get(&self, name: &str) -> f64 {
        self.all.iter().find(|parameter| parameter.name == name).map_or(0.0, |parameter| parameter.value)
    }

    fn index(&self, name: &str) -> Option<usize> {
        self.all.iter().position(|parameter| parameter.name == name)
    }

    fn message(&self, index: usize) -> PARAM_VALUE_DATA {
        let parameter = &self.all[index];
        let param_value = match (self.by_bytes, parameter.kind) {
            (true, INT8 | INT32) => f32::from_bits(parameter.value as i32 as u32),
            _ => parameter.value as f32,
        };
        PARAM_VALUE_DATA {
            param_id: parameter.name.into(),
            param_value,
            param_type: parameter.kind,
            param_count: self.all.len() as u16,
            param_index: index as u16,
        }
    }

    fn decoded(&self, index: usize, value: f32) -> f64 {
        match (self.by_bytes, self.all[index].kind) {
            (true, INT8 | INT32) => f64::from(value.to_bits() as i32),
            _ => f64::from(value),
        }
    }
}

impl Autopilot {
    /// Sets a parameter; false for an unknown one.
    pub fn set_parameter(&mut self, name: &str, value: f64) -> bool {
        let index = self.parameters.index(name);
        if let Some(index) = index {
            self.parameters.all[index].value = value;
        }
        index.is_some()
    }

    pub(super) fn obey_parameter_request(&mut self, request: &PARAM_REQUEST_READ_DATA) {
        if !is_for_us(request.target_system, request.target_component) {
            return;
        }
        let index = match usize::try_from(request.param_index) {
            Ok(index) => (index < self.parameters.all.len()).then_some(index),
            Err(_) => request.param_id.to_str().ok().and_then(|name| self.parameters.index(name)),
        };
        self.say_parameter(index);
    }

    pub(super) fn obey_parameter_list_request(&mut self, request: &PARAM_REQUEST_LIST_DATA) {
        if is_for_us(request.target_system, request.target_component) {
            (0..self.parameters.all.len()).for_each(|index| self.say_parameter(Some(index)));
        }
    }

    pub(super) fn obey_parameter_wish(&mut self, wish: &PARAM_SET_DATA) {
        if !is_for_us(wish.target_system, wish.target_component) {
            return;
        }
        let index = wish.param_id.to_str().ok().and_then(|name| self.parameters.index(name));
        if let Some(index) = index {
            let value = self.parameters.decoded(index, wish.param_value);
            if value.is_finite() {
                self.parameters.all[index].value = value;
            }
        }
        self.say_parameter(index);
    }

    fn say_parameter(&mut self, index: Option<usize>) {
        if let Some(index) = index {
            let value = self.parameters.message(index);
            self.send(AUTOPILOT, &value);
        }
    }
}
