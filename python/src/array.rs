//! The array of antennas, and the bearings of what it recorded.

use std::path::PathBuf;

use foxhound_core::doa::bearing::Estimator;
use foxhound_sim::scenario::input::{InputError, check, read_text};
use foxhound_sim::tools::bearings::{ArrayLine, Line, Options, find, refuse_left};
use foxhound_sim::tools::frames::{ArrayDescription, Recording, npy_type, parse_yaw};
use foxhound_sim::tools::iq::{self, Frames};
use foxhound_sim::tools::radio_array::RadioArray;
use foxhound_sim::tools::switched::{self, Packets};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};
use serde_json::{Map, Value};

use crate::{Column, Table, npy, refused, to_json, work};

/// Keys that only an array with another receiver than our own has.
const RADIO_KEYS: [&str; 2] = ["sigma_floor_deg", "switch"];

/// An array of antennas and its receiver: the keys of an array file (`foxhound bearing --help`).
///
///     Array(wavelength_m=0.345, side_m=0.138, sample_rate_hz=102_400)
///     Array.from_file("array.toml")
#[pyclass(frozen, module = "foxhound")]
pub(crate) struct Array {
    text: String,
    /// The array for recorded codes of four converters, or why it is none.
    codes: Result<ArrayDescription, InputError>,
    /// The array for complex samples or packets, or why it is none.
    radio: Result<RadioArray, InputError>,
}

impl Array {
    /// An array has to be one of the two at least.
    fn parse(text: String) -> Result<Self, InputError> {
        let (codes, radio) = (ArrayDescription::parse(&text), RadioArray::parse(&text));
        match (&codes, &radio) {
            (Err(_), Err(error)) if RADIO_KEYS.iter().any(|key| text.contains(key)) => Err(error.clone()),
            (Err(error), Err(_)) => Err(error.clone()),
            _ => Ok(Self { text, codes, radio }),
        }
    }
}

#[pymethods]
impl Array {
    #[new]
    #[pyo3(signature = (**keys))]
    fn new(py: Python<'_>, keys: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let wrong = |error: String| PyValueError::new_err(error);
        let keys = keys.cloned().unwrap_or_else(|| PyDict::new(py));
        let mut keys: Map<String, Value> =
            serde_json::from_str(&to_json(&keys)?).map_err(|error| wrong(error.to_string()))?;
        keys.retain(|_, value| !value.is_null());
        let keys = toml::Table::try_from(keys).map_err(|error| wrong(error.to_string()))?;
        Self::parse(keys.to_string()).map_err(refused)
    }

    /// Reads an array file (TOML).
    #[classmethod]
    fn from_file(_class: &Bound<'_, PyType>, path: PathBuf) -> PyResult<Self> {
        let parsed = read_text(&path).and_then(|text| Self::parse(text).map_err(|error| error.in_file(&path)));
        parsed.map_err(refused)
    }

    /// The text of its array file.
    #[getter]
    fn toml(&self) -> &str {
        &self.text
    }

    fn __repr__(&self) -> String {
        format!("Array({})", self.text.trim_end().replace('\n', ", "))
    }
}

/// What was recorded: a file, or the bytes of a `.npy` file.
enum Recorded {
    File(PathBuf),
    Npy(Vec<u8>),
}

impl Recorded {
    fn of(given: &Bound<'_, PyAny>) -> PyResult<Self> {
        if let Ok(path) = given.extract() {
            return Ok(Self::File(path));
        }
        let array = given.py().import("numpy")?.call_method1("asarray", (given,))?;
        let dtype = array.getattr("dtype")?.str()?.to_string();
        let wanted = match dtype.as_str() {
            "int16" | "int8" => None,
            "complex64" | "complex128" => Some("complex64"),
            _ => {
                let text = format!(
                    "samples: dtype {dtype}: expected int16 (frames, 4, N), complex (frames, channels, N), or int16 or int8 \
                     (frames, channels, N, 2)"
                );
                return Err(PyValueError::new_err(text));
            }
        };
        Ok(Self::Npy(npy(&array, wanted)?.as_bytes().to_vec()))
    }

    /// Whether these are codes, int16 of three axes. Complex samples in int16 have one more.
    fn is_codes(&self) -> bool {
        let kind = match self {
            Self::File(path) => std::fs::read(path).ok().and_then(|bytes| npy_type(&bytes)),
            Self::Npy(bytes) => npy_type(bytes),
        };
        kind.is_some_and(|(name, shape)| name == "<i2" && shape.len() == 3)
    }
}

/// What to do with a recording.
struct Asked {
    looks: usize,
    emitter: Option<Vec<u8>>,
    yaw: Option<Vec<u8>>,
    independent: bool,
}

/// Results of any recording.
enum Lines {
    Codes(Vec<Line>),
    Radio(Vec<ArrayLine>),
}

/// The results, and what the user should know of them.
type Found = (Lines, Vec<String>);

impl Asked {
    fn find(&self, array: &Array, recorded: &Recorded) -> Result<Found, InputError> {
        check("looks", self.looks as f64, 1.0, 1e6)?;
        let is_switched = array.radio.as_ref().is_ok_and(|radio| radio.switch.is_some());
        let is_codes = !is_switched && recorded.is_codes();
        let needs = |name: &str, is_given: bool, what: &str| match is_given {
            true => Err(InputError::new(format!("{name}: only with {what}"))),
            false => Ok(()),
        };
        needs("emitter", self.emitter.is_some() && !is_switched, "packets of an array with a switch")?;
        needs("yaw_rad", self.yaw.is_some() && !is_codes, "codes, int16 (frames, 4, N)")?;
        needs("independent", self.independent && !is_codes, "codes, int16 (frames, 4, N)")?;
        if is_codes {
            return self.codes(array.codes.as_ref().map_err(Clone::clone)?, recorded);
        }
        let radio = array.radio.as_ref().map_err(Clone::clone)?;
        if is_switched { self.switched(radio, recorded) } else { self.iq(radio, recorded) }
    }

    fn codes(&self, array: &ArrayDescription, recorded: &Recorded) -> Result<Found, InputError> {
        let recording = match recorded {
            Recorded::File(path) => Recording::read(path),
            Recorded::Npy(bytes) => Recording::parse(bytes),
        }?;
        let frames = recording.frames().len();
        let yaw_rad = self.yaw.as_ref().map_or(Ok(Vec::new()), |bytes| parse_yaw(bytes, frames))?;
        let (looks, independent) = (self.looks, self.independent);
        let options = Options { estimator: Estimator::default(), looks, yaw_rad, independent };
        let lines = find(&recording, array, &options)?;
        self.refuse_left(frames % looks, frames, "frames")?;
        Ok((Lines::Codes(lines), array.warnings()?.into_iter().map(str::to_owned).collect()))
    }

    fn iq(&self, array: &RadioArray, recorded: &Recorded) -> Result<Found, InputError> {
        let frames = match recorded {
            Recorded::File(path) => Frames::read(path, array),
            Recorded::Npy(bytes) => Frames::parse(bytes, array),
        }?;
        let lines = iq::find(&frames, array, self.looks)?;
        self.refuse_left(frames.count() % self.looks, frames.count(), "frames")?;
        Ok((Lines::Radio(lines), frames.warning().into_iter().collect()))
    }

    fn switched(&self, array: &RadioArray, recorded: &Recorded) -> Result<Found, InputError> {
        let mut packets = match recorded {
            Recorded::File(path) => Packets::read(path, None, array),
            Recorded::Npy(bytes) => Packets::parse(bytes),
        }?;
        if let Some(bytes) = &self.emitter {
            packets.set_emitters(bytes)?;
        }
        let (lines, left) = switched::find(&packets, array, self.looks)?;
        let (count, looks) = (packets.count(), self.looks);
        let mut warnings = Vec::new();
        // Nobody chooses who sends when: an incomplete group of a transmitter is no error.
        if (self.emitter.is_none() && packets.transmitters() < 2) || lines.is_empty() {
            self.refuse_left(left, count, "packets")?;
        } else if left != 0 {
            warnings.push(format!("{left} of {count} packets make no group of {looks} of one transmitter"));
        }
        Ok((Lines::Radio(lines), warnings))
    }

    fn refuse_left(&self, left: usize, count: usize, what: &str) -> Result<(), InputError> {
        let looks = self.looks;
        refuse_left(left, count, what, looks).map_err(|error| InputError::new(format!("looks = {looks}: {error}")))
    }
}

/// The bearings in a recording, as `foxhound bearing` finds them: a dictionary of NumPy arrays with an entry for each
/// `looks` frames. Numbers that are not known are NaN; `flags` has their names, with blanks between.
///
/// `samples` is an array or the name of a file:
///
/// - int16, (frames, 4, N): codes of four converters, -2048 to 2047; N is 64, 128, 256, 512 or 1024;
/// - complex, (frames, channels, N): samples of channels that are sampled together; or integers (frames, channels, N, 2);
/// - complex, (packets, slots, samples), where the array has a `switch`; `emitter` says who sent each packet.
///
/// `yaw_rad` is the heading at each frame of an array that turns; `independent` says that frames do not follow each
/// other in time. Both are for codes.
#[pyfunction]
#[pyo3(signature = (array, samples, *, looks=1, emitter=None, yaw_rad=None, independent=false))]
pub(crate) fn bearings<'py>(
    py: Python<'py>,
    array: &Bound<'py, Array>,
    samples: &Bound<'py, PyAny>,
    looks: usize,
    emitter: Option<&Bound<'py, PyAny>>,
    yaw_rad: Option<&Bound<'py, PyAny>>,
    independent: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let bytes = |given: Option<&Bound<'py, PyAny>>, dtype| -> PyResult<Option<Vec<u8>>> {
        given.map(|given| Ok(npy(given, Some(dtype))?.as_bytes().to_vec())).transpose()
    };
    let asked = Asked { looks, emitter: bytes(emitter, "int32")?, yaw: bytes(yaw_rad, "float64")?, independent };
    let (array, recorded) = (array.get(), Recorded::of(samples)?);
    let table = Table::new(py);
    let (lines, warnings) = work(py, |_| asked.find(array, &recorded))?;
    for text in warnings {
        py.import("warnings")?.call_method1("warn", (text,))?;
    }
    match lines {
        Lines::Codes(lines) => add_lines(&table, &lines, |line| line)?,
        Lines::Radio(lines) => {
            add_lines(&table, &lines, |line| &line.line)?;
            if asked.emitter.is_some() || lines.iter().any(|line| line.emitter.is_some()) {
                table.add("emitter", "i4", lines.iter().map(|line| line.emitter.unwrap_or_default()))?;
            }
            table.numbers("mirror_deg", lines.iter().map(|line| line.mirror_deg))?;
            table.add("ambiguities", "u1", lines.iter().map(|line| u32::from(line.ambiguities)))?;
        }
    }
    Ok(table.0)
}

/// The columns that every recording has.
fn add_lines<T>(table: &Table<'_>, lines: &[T], line: impl Fn(&T) -> &Line) -> PyResult<()> {
    table.add("frame", "i8", lines.iter().map(|one| line(one).frame))?;
    table.add("valid", "?", lines.iter().map(|one| line(one).valid))?;
    let numbers: [Column<Line>; 9] = [
        ("azimuth_deg", |line| line.azimuth_deg),
        ("sigma_deg", |line| line.sigma_deg),
        ("elevation_deg", |line| line.elevation_deg),
        ("elevation_sigma_deg", |line| line.elevation_sigma_deg),
        ("snr_db", |line| line.snr_db),
        ("freq_hz", |line| line.freq_hz),
        ("closure_chi2", |line| line.closure_chi2),
        ("coherence", |line| line.coherence),
        ("range_hint_m", |line| line.range_hint_m),
    ];
    for (name, of) in numbers {
        table.numbers(name, lines.iter().map(|one| of(line(one)).filter(|number| number.is_finite())))?;
    }
    table.add("flags", "O", lines.iter().map(|one| line(one).flags.join(" ")))
}
