//! WAV recordings of many channels: real samples of each antenna, or I and Q of each in turn.

use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

use hound::{SampleFormat, WavReader};
use num_complex::Complex32;

use super::frames::{FRAME, Samples, frame_starts, repeated};
use crate::scenario::input::{InputError, read_bytes};

/// Format tag of a header that tells valid bits and room apart.
const EXTENSIBLE: u16 = 0xFFFE;

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
    let (bytes, valid) = of_full_width(bytes);
    let mut reader = WavReader::new(Cursor::new(&bytes[..])).map_err(unreadable)?;
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
    let width = valid.map_or_else(|| bits.to_string(), |valid| format!("{valid} in {bits} bits"));
    let repeated = repeated(count, samples);
    let steps = 2.0_f32.powi(i32::from(valid.unwrap_or(bits).clamp(1, 32)) - 1);
    let extremes = (spec.sample_format == SampleFormat::Int).then_some([-1.0, (steps - 1.0) / steps]);
    Ok(Samples {
        channels: antennas,
        samples,
        values,
        is_real,
        repeated,
        extremes,
        kind: format!("WAV {format}{width}, {sort}"),
    })
}

/// The file with as many valid bits as a sample has room for, and how many it said if these were fewer: the valid ones are the upper, and
/// hound takes the lower.
fn of_full_width(bytes: &[u8]) -> (Cow<'_, [u8]>, Option<u16>) {
    let half = |at: usize| Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?));
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let mut chunk = 12;
    while let (Some(name), Some(length)) = (bytes.get(chunk..chunk + 4), word(chunk + 4)) {
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        if name != b"fmt " {
            chunk = chunk.saturating_add(8).saturating_add(length).saturating_add(length % 2);
            continue;
        }
        let (tag, room, valid_at) = (half(chunk + 8), half(chunk + 22), chunk + 26);
        return match (room, half(valid_at)) {
            (Some(room), Some(valid)) if tag == Some(EXTENSIBLE) && length >= 40 && (1..room).contains(&valid) => {
                let mut full = bytes.to_vec();
                full[valid_at..valid_at + 2].copy_from_slice(&room.to_le_bytes());
                (full.into(), Some(valid))
            }
            _ => (bytes.into(), None),
        };
    }
    (bytes.into(), None)
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

    #[test]
    fn of_24_bits_in_32_the_upper_ones_count() {
        let values = [0x12_3456_i32, -0x12_3456, 1, -1];
        let mut file = b"RIFF".to_vec();
        file.extend((60 + 16_u32).to_le_bytes());
        file.extend(b"WAVEfmt \x28\0\0\0\xFE\xFF\x02\0");
        file.extend(1000_u32.to_le_bytes());
        file.extend(8000_u32.to_le_bytes());
        [8_u16, 32, 22, 24].iter().for_each(|field| file.extend(field.to_le_bytes()));
        file.extend(b"\0\0\0\0\x01\0\0\0\0\0\x10\0\x80\0\0\xAA\0\x38\x9B\x71data");
        file.extend(16_u32.to_le_bytes());
        values.iter().for_each(|value| file.extend((value << 8).to_le_bytes()));
        let read = parse(&file, 2, 1000.0).unwrap();
        // Channel after channel.
        let wanted = [0, 2, 1, 3].map(|at: usize| values[at] as f32 / 8_388_608.0);
        assert_eq!(read.values.iter().map(|value| value.re).collect::<Vec<_>>(), wanted);
        assert_eq!(read.kind, "WAV int24 in 32 bits, real samples");
        assert_eq!(read.extremes, Some([-1.0, 8_388_607.0 / 8_388_608.0]), "where it is clipped");
    }
}
