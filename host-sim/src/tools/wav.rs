//! WAV recordings of many channels: real samples of each antenna, or I and Q of each in turn.

use std::io::Cursor;
use std::path::Path;

use hound::{SampleFormat, WavReader};
use num_complex::Complex32;

use super::frames::{FRAME, Samples, frame_starts};
use crate::scenario::input::{InputError, read_bytes};

/// Reads a recording of an array: one channel per antenna is real samples, two per antenna are I and Q.
///
/// # Errors
/// Names the file, and the field of its header that does not fit.
pub(super) fn read(path: &Path, antennas: usize, sample_rate_hz: f64) -> Result<Samples, InputError> {
    let bytes = read_bytes(path)?;
    parse(&bytes, antennas, sample_rate_hz).map_err(|error| error.in_file(path))
}

fn parse(bytes: &[u8], antennas: usize, sample_rate_hz: f64) -> Result<Samples, InputError> {
    let unreadable = |error: hound::Error| InputError::new(format!("not a WAV file that can be read: {error}"));
    let mut reader = WavReader::new(Cursor::new(bytes)).map_err(unreadable)?;
    let spec = reader.spec();
    let channels = usize::from(spec.channels);
    if channels != antennas && channels != 2 * antennas {
        let iq = 2 * antennas;
        return Err(InputError::new(format!(
            "channels = {channels}: antennas_m has {antennas}, so {antennas} (real) or {iq} (I and Q)"
        )));
    }
    let rate_hz = f64::from(spec.sample_rate);
    if (rate_hz - sample_rate_hz).abs() > 1e-6 * sample_rate_hz {
        return Err(InputError::new(format!(
            "sample_rate = {rate_hz}: the array file has sample_rate_hz = {sample_rate_hz}"
        )));
    }
    let bits = spec.bits_per_sample;
    let full = 2.0_f32.powi(i32::from(bits.clamp(1, 32)) - 1);
    let all: Vec<f32> = match spec.sample_format {
        SampleFormat::Float => reader.samples::<f32>().collect::<Result<_, _>>().map_err(unreadable)?,
        SampleFormat::Int => {
            let samples = reader.samples::<i32>().map(|sample| sample.map(|value| value as f32 / full));
            samples.collect::<Result<_, _>>().map_err(unreadable)?
        }
    };
    let is_real = channels == antennas;
    let width = if is_real { 1 } else { 2 };
    let count = all.len() / channels;
    let samples = count.min(FRAME);
    if samples == 0 {
        return Err(InputError::new("no samples"));
    }
    let mut values = Vec::with_capacity(all.len() / width);
    for frame in frame_starts(count, samples).map(|start| &all[channels * start..channels * (start + samples)]) {
        for antenna in 0..antennas {
            values.extend(frame.chunks_exact(channels).map(|sample| match &sample[antenna * width..][..width] {
                [re, im] => Complex32::new(*re, *im),
                other => Complex32::new(other[0], 0.0),
            }));
        }
    }
    let sort = if is_real { "real samples" } else { "I and Q" };
    let format = if spec.sample_format == SampleFormat::Float { "float" } else { "int" };
    Ok(Samples { channels: antennas, samples, values, is_real, kind: format!("WAV {format}{bits}, {sort}") })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hound::{WavSpec, WavWriter};

    #[test]
    fn no_sample_is_left_out() {
        let spec = WavSpec { channels: 2, sample_rate: 1000, bits_per_sample: 16, sample_format: SampleFormat::Int };
        let mut bytes = Vec::new();
        let mut writer = WavWriter::new(Cursor::new(&mut bytes), spec).unwrap();
        (0..2 * 2500_i16).for_each(|value| writer.write_sample(value).unwrap());
        writer.finalize().unwrap();
        let Samples { samples, values, .. } = parse(&bytes, 2, 1000.0).unwrap();
        assert_eq!((samples, values.len()), (FRAME, 3 * 2 * FRAME));
        assert_eq!(values.last().unwrap().re, 4999.0 / 32_768.0);
    }
}
