//! Reading users' input: an error names the file, the field, the value and what would be accepted.

use std::fmt;
use std::ops::RangeInclusive;
use std::path::Path;

use serde::Deserialize;
use serde::de::{DeserializeOwned, Deserializer, Error as _};

/// Range of an option: radius of a vehicle.
pub const DRONE_RADIUS_M: RangeInclusive<f64> = 0.01..=5.0;
/// Range of an option: signal-to-noise ratio per sample.
pub const SNR_DB: RangeInclusive<f64> = -30.0..=80.0;
/// Range of an option: noise of a bearing.
pub const SIGMA_DEG: RangeInclusive<f64> = 0.0..=180.0;
/// Range of an option: horizontal speed of the fastest setpoint.
pub const V_MAX_MPS: RangeInclusive<f64> = 0.1..=20.0;
/// Range of an option: after how long a program in real time ends.
pub const MAX_TIME_S: RangeInclusive<f64> = 0.1..=1e6;
/// Range of an option: speed of a flight as a multiple of real time.
pub const SPEED: RangeInclusive<f64> = 0.05..=1000.0;
/// Range of an option: azimuth of a known source.
pub const AZIMUTH_DEG: RangeInclusive<f64> = -360.0..=360.0;
/// Range of an option: its elevation.
pub const ELEVATION_DEG: RangeInclusive<f64> = -85.0..=85.0;
/// Range of an option: its distance.
pub const RANGE_M: RangeInclusive<f64> = 0.1..=1e6;
/// Range of an option: temperature of a receiver.
pub const TEMPERATURE_C: RangeInclusive<f64> = -100.0..=200.0;

/// A refused input. Its text is meant for the user and names the field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputError(String);

impl InputError {
    /// An error with this text.
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }

    /// The same error, with the file that it is about.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Self {
        Self(format!("{}: {}", path.display(), self.0))
    }
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for InputError {}

impl From<foxhound_core::ConfigError> for InputError {
    fn from(error: foxhound_core::ConfigError) -> Self {
        Self::new(error.to_string())
    }
}

/// Reads a text file.
///
/// # Errors
/// Names the file.
pub fn read_text(path: &Path) -> Result<String, InputError> {
    std::fs::read_to_string(path).map_err(|error| InputError::new(error.to_string()).in_file(path))
}

/// Reads a file.
///
/// # Errors
/// Names the file.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, InputError> {
    std::fs::read(path).map_err(|error| InputError::new(error.to_string()).in_file(path))
}

/// Reads a document, refusing unknown keys at every level; `known` lists every valid key with its path, where `[]`
/// stands for any element of a list.
///
/// # Errors
/// The path of the first key that is unknown or has a value of the wrong type.
pub fn parse_strictly<'de, T, D>(document: D, known: &[&str]) -> Result<T, InputError>
where
    T: DeserializeOwned,
    D: Deserializer<'de>,
    D::Error: fmt::Display,
{
    let mut unknown = None;
    let mut note_unknown = |path: serde_ignored::Path<'_>| {
        unknown.get_or_insert(path.to_string());
    };
    let mut track = serde_path_to_error::Track::new();
    let tracked = serde_path_to_error::Deserializer::new(document, &mut track);
    let parsed = T::deserialize(serde_ignored::Deserializer::new(tracked, &mut note_unknown));
    let parsed = parsed.map_err(|error| match track.path().to_string().trim_end_matches(['.', '?']) {
        "" => InputError::new(error.to_string()),
        path => InputError::new(format!("{path}: {error}")),
    })?;
    match unknown {
        Some(path) => Err(unknown_key(&path, known)),
        None => Ok(parsed),
    }
}

/// A list of exactly `N` values: TOML's reader would drop surplus values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exactly<T, const N: usize>(pub [T; N]);

impl<'de, T: Deserialize<'de>, const N: usize> Deserialize<'de> for Exactly<T, N> {
    fn deserialize<D: Deserializer<'de>>(document: D) -> Result<Self, D::Error> {
        let values = Vec::<T>::deserialize(document)?;
        let count = values.len();
        let exact = <[T; N]>::try_from(values);
        exact.map(Self).map_err(|_| D::Error::custom(format_args!("{count} values, {N} are expected")))
    }
}

/// Refuses a list where a TOML file should have a table, which a derived reader would take field after field. `[]` behind a
/// name stands for every element.
///
/// # Errors
/// The path of the first one that is not a table.
pub fn refuse_lists_for_tables(text: &str, paths: &[&str]) -> Result<(), InputError> {
    // Text that is not TOML is refused by the reader, with its position.
    let Ok(document) = text.parse::<toml::Table>() else { return Ok(()) };
    for path in paths {
        let mut places = vec![(String::new(), toml::Value::Table(document.clone()))];
        for key in path.split('.') {
            let (name, each) = key.strip_suffix("[]").map_or((key, false), |name| (name, true));
            let inside = |(at, value): (String, toml::Value)| {
                let at = if at.is_empty() { name.to_owned() } else { format!("{at}.{name}") };
                match value.get(name).cloned() {
                    Some(toml::Value::Array(values)) if each => {
                        values.into_iter().enumerate().map(|(n, value)| (format!("{at}[{n}]"), value)).collect()
                    }
                    value => value.map(|value| (at, value)).into_iter().collect::<Vec<_>>(),
                }
            };
            places = places.into_iter().flat_map(inside).collect();
        }
        if let Some((path, other)) = places.into_iter().find(|(_, value)| !value.is_table()) {
            return Err(InputError::new(format!("{path}: expected a table, not {}", other.type_str())));
        }
    }
    Ok(())
}

fn unknown_key(path: &str, known: &[&str]) -> InputError {
    // serde_ignored writes `a.0.b` and `a.?.b`; a user writes `a[0].b`.
    let mut shown = String::new();
    let mut general = String::new();
    for part in path.split('.').filter(|part| *part != "?") {
        if part.parse::<usize>().is_ok() {
            shown.push_str(&format!("[{part}]"));
            general.push_str("[]");
        } else {
            let dot = if shown.is_empty() { "" } else { "." };
            shown.push_str(&format!("{dot}{part}"));
            general.push_str(&format!("{dot}{part}"));
        }
    }
    let (parent, key) = general.rsplit_once('.').unwrap_or(("", &general));
    let siblings: Vec<&str> = known
        .iter()
        .filter_map(|path| {
            let (its_parent, name) = path.rsplit_once('.').unwrap_or(("", path));
            (its_parent == parent).then_some(name)
        })
        .collect();
    let nearest = siblings
        .iter()
        .map(|name| (strsim::jaro_winkler(key, name), *name))
        .filter(|(likeness, _)| *likeness > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let hint = match nearest {
        Some((_, name)) => format!("did you mean `{name}`?"),
        None => format!("known here: {}", siblings.join(", ")),
    };
    InputError::new(format!("{shown}: unknown key; {hint}"))
}

/// Accepts a finite number inside the range.
///
/// # Errors
/// Names the field, the value and the range.
pub fn check_within(field: &str, value: f64, range: &RangeInclusive<f64>) -> Result<(), InputError> {
    check(field, value, *range.start(), *range.end())
}

/// Accepts a finite number inside `[min, max]`.
///
/// # Errors
/// Names the field, the value and the range.
pub fn check(field: &str, value: f64, min: f64, max: f64) -> Result<(), InputError> {
    if value.is_finite() && value >= min && value <= max {
        return Ok(());
    }
    // Without hundreds of digits.
    let shown = if value.abs() < 1e16 { value.to_string() } else { format!("{value:e}") };
    Err(InputError::new(format!("{field} = {shown} is outside {min}..={max}")))
}
