//! `foxhound calibrate`: from frames of a known source to a calibration in the array file.
//!
//! The source's direction is known, or it feeds all channels through a splitter. The other keys of the array file
//! and its comments are kept. If each frame has a yaw, the vehicle turned on the spot before one source: then the
//! order of the channels is checked too, and if the yaws cover the whole circle, the deviation is fitted to the
//! bearings of the calibrated array. A frame without information about some channel is refused, and nothing is
//! written.

use foxhound_core::base::adc::CHANNELS;
use foxhound_core::doa::array::{self, Entry, TABLE_ENTRIES, Table};
use foxhound_core::doa::bearing;
use foxhound_core::doa::calibration::deviation::Deviation;
use foxhound_core::doa::calibration::order::{Check, Order};
use foxhound_core::doa::calibration::record::Calibration;
use foxhound_core::doa::calibration::{Calibrator, Source, Taken};
use foxhound_core::signal::phase::{self, Phasors};
use serde::Serialize;
use toml_edit::{Array, ArrayOfTables, DocumentMut, Item, Value};

use super::frames::{ArrayDescription, Recording};
use crate::scenario::input::{AZIMUTH_DEG, ELEVATION_DEG, InputError, RANGE_M, TEMPERATURE_C, check_within};
use crate::world::wrap_pi;

mod fit;
use fit::{Spin, take_skew};

/// Two frequencies closer than this, relative to their value, are the same entry.
const SAME_FREQUENCY: f32 = 0.02;
/// Frames whose phases differ by more are not of channels that are sampled in step.
const SPREAD_MAX_DEG: f64 = 45.0;
/// Frames of one source that stands differ by less.
pub const SPREAD_DOUBTFUL_DEG: f64 = 10.0;

/// What is known about the source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// Azimuth of the source at yaw zero, from the nose and clockwise; `None` for a splitter.
    pub azimuth_deg: Option<f64>,
    /// Its elevation.
    pub elevation_deg: f64,
    /// Its distance; `None` for a plane wave.
    pub range_m: Option<f64>,
    /// Yaw of each frame, rad; empty if the array did not turn.
    pub yaw_rad: Vec<f64>,
    /// Temperature of the receiver.
    pub temperature_c: Option<f64>,
    /// Add this frequency to the table instead of replacing it.
    pub add: bool,
    /// Determine sampling delays from the table, which needs two frequencies or more.
    pub skew: bool,
}

/// The result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Frames used.
    pub frames: usize,
    /// The tone's frequency in the samples.
    pub frequency_hz: f64,
    /// Mean signal-to-noise ratio per sample.
    pub snr_db: f64,
    /// Amplitude of each channel relative to their mean.
    pub gain: [f64; CHANNELS],
    /// Phase of each channel relative to their common phase.
    pub phase_deg: [f64; CHANNELS],
    /// Remaining standard deviation of a channel's phase.
    pub residual_deg: f64,
    /// The same of a single frame.
    pub spread_deg: f64,
    /// All frequencies of the table.
    pub table_hz: Vec<f64>,
    /// Sampling delays, if requested.
    pub skew_s: Option<[f64; CHANNELS]>,
    /// Largest deviation over the circle, if the frames cover all of it.
    pub deviation_max_deg: Option<f64>,
    /// Frames in which another line is within 10 dB of the tone or disturbs it.
    pub interferer_frames: usize,
    /// Check sum of the table.
    pub crc: String,
}

/// Measures the calibration; returns the new text of the array file.
///
/// # Errors
/// A field of the array file or an option, or a frame that cannot be used, with its number and what is wrong with it.
pub fn calibrate(recording: &Recording, text: &str, options: &Options) -> Result<(String, Report), InputError> {
    let description = ArrayDescription::parse(text)?;
    let before = description.array.calibration.unwrap_or(Table::EMPTY);
    let wavelength_m = description.array.wavelength_m;
    if options.add && before.entries().is_empty() {
        return Err(InputError::new(
            "--add: the array file holds no valid [calibration] with a frequency_hz to add to",
        ));
    }
    if options.add && before.wavelength_m() != wavelength_m {
        return Err(InputError::new(format!(
            "--add: the table is for wavelength_m = {}, the array for {wavelength_m}",
            before.wavelength_m()
        )));
    }
    let plain =
        array::Config { channel_gain: None, calibration: None, require_calibration: false, ..description.array };
    let bare = plain.build()?;
    let sources = sources(options, recording.frames().len())?;
    let looks = listen(recording, &description.phase)?;

    let mut calibrator = Calibrator::default();
    let mut order = Check::over_a_spin();
    for (frame, ((phasors, clipped), source)) in looks.iter().zip(&sources).enumerate() {
        if let Some(channel) = clipped {
            return Err(InputError::new(format!("--adc: frame {frame}: channel {} is clipped", channel + 1)));
        }
        let why = match calibrator.step(&bare, *source, phasors) {
            Taken::Yes => {
                order.step(&bare, *source, phasors);
                continue;
            }
            Taken::NoTone => "contains no tone".to_owned(),
            Taken::Clipped => "is clipped".to_owned(),
            Taken::Dead(channel) => format!("channel {} is dead (dead_{})", channel + 1, channel + 1),
            Taken::OtherFrequency => {
                format!("the tone is at {:.0} Hz, not where it was in the frames before", phasors.frequency_hz)
            }
        };
        return Err(InputError::new(format!("--adc: frame {frame}: {why}")));
    }
    if !options.yaw_rad.is_empty() {
        match order.order() {
            Order::AsConfigured => (),
            wrong => return Err(InputError::new(format!("--adc: {wrong}"))),
        }
    }
    let measured = calibrator
        .entry(options.temperature_c.map(|temperature_c| temperature_c as f32))
        .ok_or_else(|| InputError::new("--adc: no frames"))?;
    // The residual is that of the mean of all frames.
    let spread_deg = f64::from(measured.residual_rad).to_degrees() * (looks.len() as f64).sqrt();
    if spread_deg > SPREAD_MAX_DEG {
        return Err(InputError::new(format!(
            "--adc: the channels' phases differ by {spread_deg:.0} deg from frame to frame: they are not sampled in step, or a cable is loose"
        )));
    }

    let mut entries: Vec<Entry> = if options.add { before.entries().to_vec() } else { Vec::new() };
    let apart =
        |entry: &Entry| (entry.frequency_hz - measured.frequency_hz).abs() > SAME_FREQUENCY * measured.frequency_hz;
    entries.retain(apart);
    entries.push(measured);
    if entries.len() > TABLE_ENTRIES {
        return Err(InputError::new(format!("--add: the table holds {TABLE_ENTRIES} frequencies already")));
    }
    entries.sort_by(|a, b| a.frequency_hz.total_cmp(&b.frequency_hz));
    let skew_s = if options.skew {
        let found = take_skew(&mut entries).ok_or_else(|| {
            InputError::new("--skew: the table holds one frequency; add another with --add and a tone there")
        })?;
        Some(std::array::from_fn(|m| found[m] + description.phase.skew_s[m]))
    } else {
        None
    };
    for entry in &mut entries {
        // The file uses degrees.
        entry.residual_rad = entry.residual_rad.to_degrees().to_radians();
    }
    let table = Table::new(wavelength_m, &entries)?;

    // What an older table left over is none of the new one's.
    let mut deviation = if options.add { description.deviation } else { Deviation::default() };
    let mut deviation_max_deg = None;
    if !options.yaw_rad.is_empty() {
        let array = array::Config { calibration: Some(table), ..plain }.build()?.at(measured.frequency_hz);
        let estimator = bearing::Config::default().build(array)?;
        let mut spin = Spin::default();
        for ((phasors, _), source) in looks.iter().zip(&sources) {
            if let Source::Direction { azimuth_rad, .. } = source {
                spin.step(&estimator.estimate(phasors), *azimuth_rad);
            }
        }
        if let Some(found) = spin.deviation() {
            deviation = found;
            let largest =
                (0..360).map(|degree| found.at((degree as f32 - 179.0).to_radians()).abs()).fold(0.0, f32::max);
            deviation_max_deg = Some(f64::from(largest.to_degrees()));
        }
    }

    let calibration = Calibration { table, deviation };
    let text = write(text, &calibration, skew_s)?;
    // Reading the file back must give what was written.
    let read = ArrayDescription::parse(&text)?;
    if read.array.calibration != Some(table) || read.deviation != deviation {
        return Err(InputError::new("[calibration]: the array file would be invalid with this table"));
    }
    let snr_db = looks.iter().map(|(phasors, _)| f64::from(phasors.snr_db)).sum::<f64>() / looks.len() as f64;
    let report = Report {
        frames: looks.len(),
        frequency_hz: f64::from(measured.frequency_hz),
        snr_db,
        gain: measured.gain.map(f64::from),
        phase_deg: measured.phase_rad.map(|phase_rad| f64::from(phase_rad).to_degrees()),
        residual_deg: f64::from(measured.residual_rad).to_degrees(),
        spread_deg,
        table_hz: table.entries().iter().map(|entry| f64::from(entry.frequency_hz)).collect(),
        skew_s: skew_s.map(|skew_s| skew_s.map(f64::from)),
        deviation_max_deg,
        interferer_frames: looks.iter().filter(|(phasors, _)| phasors.interferer).count(),
        crc: format!("{:#010x}", calibration.crc()),
    };
    Ok((text, report))
}

/// Direction of the source for each frame.
fn sources(options: &Options, frames: usize) -> Result<Vec<Source>, InputError> {
    if let Some(temperature_c) = options.temperature_c {
        check_within("--temperature-c", temperature_c, &TEMPERATURE_C)?;
    }
    let Some(azimuth_deg) = options.azimuth_deg else {
        return Ok(vec![Source::Splitter; frames]);
    };
    check_within("--azimuth-deg", azimuth_deg, &AZIMUTH_DEG)?;
    check_within("--elevation-deg", options.elevation_deg, &ELEVATION_DEG)?;
    if let Some(range_m) = options.range_m {
        check_within("--range-m", range_m, &RANGE_M)?;
    }
    let source = |frame: usize| {
        let yaw_rad = options.yaw_rad.get(frame).copied().unwrap_or(0.0);
        Source::Direction {
            azimuth_rad: wrap_pi(azimuth_deg.to_radians() - yaw_rad) as f32,
            elevation_rad: options.elevation_deg.to_radians() as f32,
            range_m: options.range_m.map(|range_m| range_m as f32),
        }
    };
    Ok((0..frames).map(source).collect())
}

/// The phasors of each frame, and which channel is clipped.
fn listen(recording: &Recording, config: &phase::Config) -> Result<Vec<(Phasors, Option<usize>)>, InputError> {
    match recording.block_length {
        64 => listen_in::<64>(recording, config),
        128 => listen_in::<128>(recording, config),
        256 => listen_in::<256>(recording, config),
        512 => listen_in::<512>(recording, config),
        1024 => listen_in::<1024>(recording, config),
        n => Err(InputError::new(format!("N = {n} samples a frame"))),
    }
}

fn listen_in<const N: usize>(
    recording: &Recording,
    config: &phase::Config,
) -> Result<Vec<(Phasors, Option<usize>)>, InputError> {
    let extractor = config.build::<N>()?;
    let mut state = phase::State::<N>::default();
    let looks = recording.snapshots(config.sample_rate_hz).map(|snapshot| {
        // Frames need not follow each other.
        state.reset();
        let phasors = extractor.step(&mut state, &snapshot);
        let most = snapshot.clip_count().into_iter().enumerate().max_by_key(|(_, rails)| *rails);
        (phasors, most.filter(|_| phasors.clipped).map(|(channel, _)| channel))
    });
    Ok(looks.collect())
}

/// The array file with this calibration in it, otherwise unchanged.
fn write(text: &str, calibration: &Calibration, skew_s: Option<[f32; CHANNELS]>) -> Result<String, InputError> {
    let mut document: DocumentMut =
        text.parse().map_err(|error: toml_edit::TomlError| InputError::new(error.to_string()))?;
    if let Some(skew_s) = skew_s {
        set(document.as_table_mut(), "skew_s", Some(list(&skew_s)));
    }
    let place = document.as_table_mut().entry("calibration").or_insert_with(toml_edit::table);
    if let Some(inline) = place.as_inline_table() {
        *place = Item::Table(inline.clone().into_table());
    }
    let Some(table) = place.as_table_mut() else { return Err(InputError::new("calibration: expected a table")) };
    let [first, further @ ..] = calibration.table.entries() else { return Ok(text.to_owned()) };
    set(table, "wavelength_m", Some(number(calibration.table.wavelength_m())));
    set_entry(table, first);
    let crc = format!("{:#010x}", calibration.crc()).parse::<Value>();
    set(table, "crc", Some(crc.map_err(|error| InputError::new(error.to_string()))?));
    if calibration.deviation == Deviation::default() {
        table.remove("deviation");
    } else {
        let Deviation { constant_rad, cosine_rad, sine_rad, sigma_rad } = calibration.deviation;
        let place = table.entry("deviation").or_insert_with(toml_edit::table);
        if let Some(inline) = place.as_inline_table() {
            *place = Item::Table(inline.clone().into_table());
        }
        if let Some(deviation) = place.as_table_mut() {
            set(deviation, "constant_rad", Some(number(constant_rad)));
            set(deviation, "cosine_rad", Some(list(&cosine_rad)));
            set(deviation, "sine_rad", Some(list(&sine_rad)));
            set(deviation, "sigma_rad", Some(number(sigma_rad)));
        }
    }
    table.remove("further");
    if !further.is_empty() {
        let mut others = ArrayOfTables::new();
        for entry in further {
            let mut other = toml_edit::Table::new();
            set_entry(&mut other, entry);
            others.push(other);
        }
        table.insert("further", Item::ArrayOfTables(others));
    }
    Ok(document.to_string())
}

fn set_entry(table: &mut toml_edit::Table, entry: &Entry) {
    set(table, "frequency_hz", Some(number(entry.frequency_hz)));
    set(table, "gain", Some(list(&entry.gain)));
    set(table, "phase_rad", Some(list(&entry.phase_rad)));
    set(table, "residual_deg", Some(number(entry.residual_rad.to_degrees())));
    set(table, "temperature_c", entry.temperature_c.map(number));
}

/// Sets or removes a key; comments about it are kept.
fn set(table: &mut toml_edit::Table, key: &str, value: Option<Value>) {
    match (value, table.get_mut(key).and_then(Item::as_value_mut)) {
        (Some(mut value), Some(old)) => {
            *value.decor_mut() = old.decor().clone();
            *old = value;
        }
        (Some(value), None) => {
            table.insert(key, Item::Value(value));
        }
        (None, _) => {
            table.remove(key);
        }
    }
}

/// The shortest decimal number that reads back as the same `f32`.
fn number(value: f32) -> Value {
    Value::from(value.to_string().parse::<f64>().unwrap_or(f64::from(value)))
}

fn list(values: &[f32]) -> Value {
    Value::Array(values.iter().map(|value| number(*value)).collect::<Array>())
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "# The array of the first prototype.\nwavelength_m = 0.345 # 868 MHz\nside_m = 0.138\n\
        sample_rate_hz = 102400.0\nskew_s = [0.0, 0.0, 1e-7, 0.0] # as measured in May\n\n# Field, 3 June.\n[calibration]\n\
        gain = [1, 1, 1, 1] # hand-made\nphase_rad = [0, 0, 0, 0]\n";

    fn entry(frequency_hz: f32) -> Entry {
        Entry {
            frequency_hz,
            gain: [1.1, 0.7, 1.05, 1.15],
            phase_rad: [0.1, -0.9, 3.0, -2.2],
            residual_rad: 0.037_f32.to_radians(),
            temperature_c: None,
        }
    }

    fn calibration(entries: &[Entry]) -> Calibration {
        Calibration { table: Table::new(0.345, entries).unwrap(), deviation: Deviation::default() }
    }

    #[test]
    fn what_is_written_is_read_back_bit_for_bit_and_all_else_stays() {
        let deviation =
            Deviation { constant_rad: 0.011, cosine_rad: [0.1, 0.2, 0.3, 0.4], sine_rad: [-0.1; 4], sigma_rad: 1e-3 };
        for calibration in [
            calibration(&[entry(14_800.123)]),
            calibration(&[entry(1e4), Entry { temperature_c: Some(21.3), ..entry(2e4) }, entry(3e4), entry(4e4)]),
            Calibration { deviation, ..calibration(&[entry(1e4), entry(2e4)]) },
        ] {
            for before in [FILE, "wavelength_m = 0.345\nside_m = 0.138\nsample_rate_hz = 102400.0"] {
                let text = write(before, &calibration, None).unwrap();
                // Written again it stays the same.
                assert_eq!(write(&text, &calibration, None).unwrap(), text);
                let read = ArrayDescription::parse(&text).unwrap();
                assert_eq!(read.array.calibration, Some(calibration.table), "{text}");
                assert_eq!(read.deviation, calibration.deviation);
                assert_eq!(read.phase, ArrayDescription::parse(before).unwrap().phase);
            }
        }
        let text = write(FILE, &calibration(&[entry(14_800.0)]), Some([1e-6, 0.0, 0.0, -1e-6])).unwrap();
        for comment in
            ["# The array of the first prototype.", "# 868 MHz", "# Field, 3 June.", "# hand-made", "# as measured"]
        {
            assert!(text.contains(comment), "{comment}: {text}");
        }
        assert!(!text.contains("temperature_c"), "the old one is not the new one's: {text}");
        assert_eq!(ArrayDescription::parse(&text).unwrap().phase.skew_s, [1e-6, 0.0, 0.0, -1e-6]);
    }

    #[test]
    fn a_table_in_one_line_becomes_a_table() {
        let before = "wavelength_m = 0.345\nside_m = 0.138\nsample_rate_hz = 102400.0\n\
            calibration = { gain = [1.0, 1.0, 1.0, 1.0], phase_rad = [0.0, 0.0, 0.0, 0.0] }\nrequire_calibration = true\n";
        let calibration = calibration(&[entry(1e4), entry(2e4)]);
        let read = ArrayDescription::parse(&write(before, &calibration, None).unwrap()).unwrap();
        assert_eq!(read.array.calibration, Some(calibration.table));
        assert!(read.array.require_calibration);
    }

    #[test]
    fn a_table_that_was_changed_afterwards_holds_nowhere() {
        let text = write(FILE, &calibration(&[entry(14_800.0)]), None).unwrap();
        let damaged = [("0.7,", "0.8,"), ("14800.0", "14801.0"), ("crc = 0x", "crc = 0x1")];
        for (from, to) in damaged {
            let changed = text.replacen(from, to, 1);
            assert_ne!(changed, text);
            match ArrayDescription::parse(&changed) {
                Ok(read) => {
                    assert_eq!(read.array.calibration, Some(Table::EMPTY), "{from}");
                    assert!(read.array.build().unwrap().is_uncalibrated());
                }
                Err(error) => panic!("{from}: {error}"),
            }
        }
        // Without a checksum it is accepted as it is.
        let crc = text.lines().find(|line| line.starts_with("crc")).unwrap();
        let read = ArrayDescription::parse(&text.replace(crc, "")).unwrap();
        assert_eq!(read.array.calibration, Some(calibration(&[entry(14_800.0)]).table));
    }

    #[test]
    fn bad_tables_are_refused_by_name() {
        let good = write(FILE, &calibration(&[entry(1e4), entry(2e4)]), None).unwrap();
        let refused = |from: &str, to: &str| {
            ArrayDescription::parse(&good.replacen(from, to, 1))
                .err()
                .map(|error| error.to_string())
                .unwrap_or_default()
        };
        assert!(refused("frequency_hz = 20000.0", "frequency_hz = 10000.0").contains("calibration.frequency_hz"));
        assert!(refused("frequency_hz = 10000.0", "frequency_hz = -1").contains("calibration.frequency_hz"));
        assert!(refused("frequency_hz = 10000.0\n", "").contains("calibration.frequency_hz"));
        assert!(refused("frequency_hz = 20000.0", "frequncy_hz = 20000.0").contains("frequency_hz"));
        assert!(refused("residual_deg = ", "residual_deg = 90").contains("calibration.residual"));
        assert!(refused("[1.1, 0.7", "[1.1, nan").contains("calibration.gain"));
    }
}
