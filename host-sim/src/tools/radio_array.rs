//! The description (TOML) of an array of 2 to 8 antennas with another receiver than our own AD converters.
//!
//! ```toml
//! wavelength_m = 0.1229
//! antennas_m = [[0.06, 0.0], [0.0, 0.06], [-0.06, 0.0]]   # or side_m, for a square of four
//! sample_rate_hz = 2e6
//! tone_hz = 250e3             # --switched: of the tone at base band
//! tone_band_hz = [-5e4, 5e4]  # --iq: the occupied band
//! sigma_floor_deg = 4.0       # optional: smallest sigma of a bearing
//!
//! [switch]                    # --switched
//! slot_s = 4e-6               # from the beginning of a slot to that of the next
//! pattern = [1, 2, 3]         # the antenna of each slot, repeated; 0 for a slot that is not used
//! ```

use std::path::Path;

use foxhound_core::base::adc::ANTENNAS_MAX;
use foxhound_core::doa::{array, beam};
use foxhound_core::signal::switched::{self, SLOTS_MAX};
use serde::Deserialize;

use crate::scenario::input::{Exactly, InputError, check, parse_strictly, read_text, refuse_lists_for_tables};

/// Every key.
const KEYS: [&str; 10] = [
    "wavelength_m",
    "side_m",
    "antennas_m",
    "sample_rate_hz",
    "tone_hz",
    "tone_band_hz",
    "sigma_floor_deg",
    "switch",
    "switch.slot_s",
    "switch.pattern",
];

#[derive(Clone, Debug, Deserialize)]
struct File {
    wavelength_m: f64,
    side_m: Option<f64>,
    antennas_m: Option<Vec<Exactly<f64, 2>>>,
    sample_rate_hz: f64,
    tone_hz: Option<f64>,
    tone_band_hz: Option<Exactly<f64, 2>>,
    sigma_floor_deg: Option<f64>,
    switch: Option<Switch>,
}

#[derive(Clone, Debug, Deserialize)]
struct Switch {
    slot_s: f64,
    pattern: Vec<i64>,
}

/// The content of such a file, as configurations of the core.
#[derive(Clone, Debug, PartialEq)]
pub struct RadioArray {
    /// Geometry.
    pub beam: beam::Config,
    /// Rate of the complex samples.
    pub sample_rate_hz: f64,
    /// The tone's frequency in the samples.
    pub tone_hz: Option<f64>,
    /// The occupied band in the samples.
    pub band_hz: Option<[f64; 2]>,
    /// Least sigma.
    pub sigma_floor_rad: Option<f32>,
    /// Schedule of the switch.
    pub switch: Option<switched::Config>,
}

impl RadioArray {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// Names the file and the key.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(&read_text(path)?).map_err(|error| error.in_file(path))
    }

    /// Checks the text of a file.
    ///
    /// # Errors
    /// Names the key.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        refuse_lists_for_tables(text, &["switch"])?;
        let document = toml::Deserializer::parse(text).map_err(|error| InputError::new(error.to_string()))?;
        let file: File = parse_strictly(document, &KEYS)?;
        let beam = file.beam()?;
        beam.build()?;
        check("sample_rate_hz", file.sample_rate_hz, 1e3, 1e8)?;
        let nyquist_hz = file.sample_rate_hz / 2.0;
        if let Some(tone_hz) = file.tone_hz {
            check("tone_hz", tone_hz, -nyquist_hz, nyquist_hz)?;
        }
        if file.tone_band_hz.is_some() && file.switch.is_some() {
            return Err(InputError::new("tone_band_hz: is of no use with [switch]"));
        }
        if let Some(Exactly([low_hz, high_hz])) = file.tone_band_hz {
            check("tone_band_hz[0]", low_hz, -nyquist_hz, nyquist_hz)?;
            check("tone_band_hz[1]", high_hz, low_hz, nyquist_hz)?;
            if let Some(tone_hz) = file.tone_hz {
                check("tone_hz, beside tone_band_hz,", tone_hz, low_hz, high_hz)?;
            }
        }
        if let Some(floor_deg) = file.sigma_floor_deg {
            check("sigma_floor_deg", floor_deg, 0.0, 30.0)?;
        }
        let switch = file.switch.as_ref().map(|switch| file.schedule(switch, beam.count)).transpose()?;
        Ok(Self {
            beam,
            sample_rate_hz: file.sample_rate_hz,
            tone_hz: file.tone_hz,
            band_hz: file.tone_band_hz.map(|band_hz| band_hz.0),
            sigma_floor_rad: file.sigma_floor_deg.map(|floor_deg| (floor_deg as f32).to_radians()),
            switch,
        })
    }
}

impl File {
    fn beam(&self) -> Result<beam::Config, InputError> {
        check("wavelength_m", self.wavelength_m, 1e-3, 1e3)?;
        let wavelength_m = self.wavelength_m as f32;
        let given = match (self.side_m, &self.antennas_m) {
            (Some(side_m), None) => {
                check("side_m", side_m, 1e-4, 1e3)?;
                array::Config::square(wavelength_m, side_m as f32).antennas_m.to_vec()
            }
            (None, Some(antennas_m)) => antennas_m.iter().map(|xy| xy.0.map(|coordinate| coordinate as f32)).collect(),
            (Some(_), Some(_)) => return Err(InputError::new("side_m and antennas_m: give only one of the two")),
            (None, None) => return Err(InputError::new("side_m or antennas_m: one of the two is missing")),
        };
        if !(2..=ANTENNAS_MAX).contains(&given.len()) {
            let count = given.len();
            return Err(InputError::new(format!("antennas_m: {count} antennas is outside 2..={ANTENNAS_MAX}")));
        }
        let mut antennas_m = [[0.0; 2]; ANTENNAS_MAX];
        for (place, antenna_m) in antennas_m.iter_mut().zip(&given) {
            *place = *antenna_m;
        }
        Ok(beam::Config { wavelength_m, antennas_m, count: given.len() })
    }

    fn schedule(&self, switch: &Switch, antennas: usize) -> Result<switched::Config, InputError> {
        check("switch.slot_s", switch.slot_s, 1e-7, 1.0)?;
        let pattern_slots = switch.pattern.len();
        if !(1..=SLOTS_MAX).contains(&pattern_slots) {
            return Err(InputError::new(format!("switch.pattern: {pattern_slots} slots is outside 1..={SLOTS_MAX}")));
        }
        let mut pattern = [0; SLOTS_MAX];
        for (at, (slot, antenna)) in pattern.iter_mut().zip(&switch.pattern).enumerate() {
            check(&format!("switch.pattern[{at}]"), *antenna as f64, 0.0, antennas as f64)?;
            *slot = *antenna as u8;
        }
        let Some(tone_hz) = self.tone_hz else {
            return Err(InputError::new("tone_hz: missing; with [switch] it is the frequency of the tone"));
        };
        Ok(switched::Config {
            antennas,
            sample_rate_hz: self.sample_rate_hz as f32,
            tone_hz: tone_hz as f32,
            slot_s: switch.slot_s as f32,
            pattern,
            pattern_slots,
        })
    }
}
