//! SigMF recordings: `NAME.sigmf-meta` (JSON) describes `NAME.sigmf-data`, with interleaved samples of all
//! channels.
//!
//! Frames are 1024 samples long, the last one ends with the recording. It reads `core:datatype` `ci16_le`, `ci8`, `cu8`
//! and `cf32_le`, `core:num_channels` and `core:sample_rate` of `global`.

use std::path::Path;

use num_complex::Complex32;
use serde_json::Value;

use super::frames::{FRAME, Samples, frame_starts, repeated};
use super::radio_array::RadioArray;
use crate::scenario::input::{InputError, read_bytes, read_text};

const LIGHT_M_S: f64 = 299_792_458.0;
/// A carrier may be off the array's wavelength by this share.
const UNLIKE: f64 = 0.05;

/// Whether the samples about a frequency may hold a source of a wavelength, which is anywhere in them.
pub(super) fn is_of_wavelength(hz: f64, wavelength_m: f32, sample_rate_hz: f64) -> bool {
    let carrier_hz = LIGHT_M_S / f64::from(wavelength_m);
    (hz - carrier_hz).abs() <= UNLIKE * carrier_hz + 0.5 * sample_rate_hz
}

/// Reads a recording.
///
/// # Errors
/// Names the file, the key and its value.
pub(super) fn read(path: &Path, array: &RadioArray) -> Result<Samples, InputError> {
    let (meta, data) = (path.with_extension("sigmf-meta"), path.with_extension("sigmf-data"));
    let about = Meta::parse(&read_text(&meta)?, array.sample_rate_hz, array.beam.wavelength_m)
        .map_err(|error| error.in_file(&meta))?;
    let bytes = read_bytes(&data)?;
    about.frames(&bytes).map_err(|error| error.in_file(&data))
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Datatype {
    I16,
    I8,
    U8,
    F32,
}

impl Datatype {
    /// The least and the largest value.
    const fn extremes(self) -> Option<[f32; 2]> {
        match self {
            Self::I16 => Some([-1.0, 32_767.0 / 32_768.0]),
            Self::I8 => Some([-1.0, 127.0 / 128.0]),
            Self::U8 => Some([-1.0, 1.0]),
            Self::F32 => None,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::I16 => "SigMF ci16_le",
            Self::I8 => "SigMF ci8",
            Self::U8 => "SigMF cu8",
            Self::F32 => "SigMF cf32_le",
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Meta {
    datatype: Datatype,
    channels: usize,
}

impl Meta {
    fn parse(text: &str, sample_rate_hz: f64, wavelength_m: f32) -> Result<Self, InputError> {
        let document: Value = serde_json::from_str(text).map_err(|error| InputError::new(error.to_string()))?;
        let Some(global) = document["global"].as_object() else {
            return Err(InputError::new("global: missing; not a SigMF description"));
        };
        let shown = |key: &str| global.get(key).map_or_else(|| "missing".to_owned(), Value::to_string);
        let refuse = |key: &str, wanted: &str| Err(InputError::new(format!("{key} = {}: {wanted}", shown(key))));
        let datatype = match global.get("core:datatype").and_then(Value::as_str) {
            Some("ci16_le") => Datatype::I16,
            Some("ci8") => Datatype::I8,
            Some("cu8") => Datatype::U8,
            Some("cf32_le") => Datatype::F32,
            _ => return refuse("core:datatype", "expected one of ci16_le, ci8, cu8, cf32_le"),
        };
        let channels = match global.get("core:num_channels") {
            None => Some(1),
            Some(value) => value.as_u64().and_then(|channels| usize::try_from(channels).ok()),
        };
        let Some(channels) = channels.filter(|channels| (2..=8).contains(channels)) else {
            return refuse("core:num_channels", "expected 2 to 8 coherent channels");
        };
        if let Some(rate) = global.get("core:sample_rate")
            && rate.as_f64().is_none_or(|rate_hz| (rate_hz - sample_rate_hz).abs() > 1e-6 * sample_rate_hz)
        {
            return refuse("core:sample_rate", &format!("the array file has sample_rate_hz = {sample_rate_hz}"));
        }
        for key in ["core:metadata_only", "core:dataset", "core:trailing_bytes"] {
            if global.get(key).is_some_and(|value| *value != false && *value != 0) {
                return refuse(key, "not supported");
            }
        }
        let captures = match document.get("captures") {
            None => &[][..],
            Some(Value::Array(captures)) => captures,
            Some(other) => return Err(InputError::new(format!("captures = {other}: expected a list"))),
        };
        if captures.len() > 1 {
            let text =
                format!("captures: {} segments; a frame would span two, cut the recording there", captures.len());
            return Err(InputError::new(text));
        }
        for (at, capture) in captures.iter().enumerate() {
            if let Some(bytes) = capture.get("core:header_bytes").filter(|bytes| **bytes != 0) {
                return Err(InputError::new(format!("captures[{at}].core:header_bytes = {bytes}: not supported")));
            }
            let Some(frequency) = capture.get("core:frequency").filter(|frequency| **frequency != 0) else { continue };
            let carrier_hz = LIGHT_M_S / f64::from(wavelength_m);
            let fits = |hz: f64| hz == 0.0 || is_of_wavelength(hz, wavelength_m, sample_rate_hz);
            if !frequency.as_f64().is_some_and(fits) {
                let text = format!(
                    "captures[{at}].core:frequency = {frequency}: the array file has wavelength_m = {wavelength_m}"
                );
                return Err(InputError::new(format!("{text}, which is {:.1} MHz", carrier_hz / 1e6)));
            }
        }
        Ok(Self { datatype, channels })
    }

    fn frames(self, bytes: &[u8]) -> Result<Samples, InputError> {
        let item = match self.datatype {
            Datatype::I16 => 4,
            Datatype::I8 | Datatype::U8 => 2,
            Datatype::F32 => 8,
        };
        let one = item * self.channels;
        if bytes.is_empty() || !bytes.len().is_multiple_of(one) {
            let (held, channels) = (bytes.len(), self.channels);
            return Err(InputError::new(format!("truncated: {held} bytes, {one} a sample of {channels} channels")));
        }
        let part = |bytes: &[u8]| match (self.datatype, bytes) {
            (Datatype::I16, &[a, b]) => f32::from(i16::from_le_bytes([a, b])) / 32_768.0,
            (Datatype::I8, &[a]) => f32::from(i8::from_le_bytes([a])) / 128.0,
            (Datatype::U8, &[a]) => (f32::from(a) - 127.5) / 127.5,
            (Datatype::F32, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
            _ => f32::NAN,
        };
        let samples = (bytes.len() / one).min(FRAME);
        let mut values = Vec::with_capacity(bytes.len() / item);
        for frame in frame_starts(bytes.len() / one, samples).map(|start| &bytes[one * start..one * (start + samples)])
        {
            for channel in 0..self.channels {
                values.extend(frame.chunks_exact(one).map(|sample| {
                    let (re, im) = sample[channel * item..(channel + 1) * item].split_at(item / 2);
                    Complex32::new(part(re), part(im))
                }));
            }
        }
        let Self { datatype, channels } = self;
        let repeated = repeated(bytes.len() / one, samples);
        Ok(Samples {
            channels,
            samples,
            values,
            is_real: false,
            repeated,
            extremes: datatype.extremes(),
            kind: datatype.name().to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(captures: &str) -> Option<String> {
        let global = r#"{"core:datatype": "cf32_le", "core:num_channels": 4, "core:sample_rate": 1e6}"#;
        let text = format!("{{\"global\": {global}, \"captures\": {captures}}}");
        Meta::parse(&text, 1e6, 0.6909).err().map(|error| error.to_string())
    }

    #[test]
    fn a_header_that_is_not_skipped_is_refused_by_name() {
        assert_eq!(refused("[]"), None);
        assert_eq!(refused(r#"[{"core:header_bytes": 0, "core:sample_start": 0}]"#), None);
        for bytes in ["48", "\"48\"", "48.0", "-48", "null", "[48]"] {
            let text = refused(&format!("[{{\"core:header_bytes\": {bytes}}}]"));
            assert_eq!(text, Some(format!("captures[0].core:header_bytes = {bytes}: not supported")));
        }
        assert_eq!(refused("{}"), Some("captures = {}: expected a list".to_owned()));
    }

    #[test]
    fn a_carrier_that_contradicts_the_wavelength_is_refused() {
        let told = |frequency: &str| refused(&format!("[{{\"core:frequency\": {frequency}}}]"));
        for frequency in ["433.92e6", "450e6", "0", "0.0"] {
            assert_eq!(told(frequency), None);
        }
        let text = told("868e6").unwrap();
        assert!(
            text.contains("core:frequency = 868000000.0: the array file has wavelength_m = 0.6909, which is 433.9 MHz"),
            "{text}"
        );
        assert!(told("\"433.92e6\"").is_some() && told("400e6").is_some());
    }
}
