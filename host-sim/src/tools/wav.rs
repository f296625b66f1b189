//! WAV recordings of many channels: real samples of each antenna, or I and Q of each in turn.

use std::io::Cursor;
use std::path::Path;

use hound::{SampleFormat, WavReader};
use num_complex::Complex32;

use super::frames::{FRAME, Samples, frame_starts, repeated};
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
    let begin = WavReader::new(Cursor::new(bytes)).map_err(unreadable)?.into_inner().position();
    let mut reader = WavReader::new(Cursor::new(bytes)).map_err(unreadable)?;
    let spec = reader.spec();
    let bits = spec.bits_per_sample;
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
    let full = 2.0_f32.powi(i32::from(bits.clamp(1, 32)) - 1);
    let all: Vec<f32> = match spec.sample_format {
        SampleFormat::Float => reader.samples::<f32>().collect::<Result<_, _>>().map_err(unreadable)?,
        SampleFormat::Int => {
            let samples = reader.samples::<i32>().map(|sample| sample.map(|value| value as f32 / full));
            samples.collect::<Result<_, _>>().map_err(unreadable)?
        }
    };
    let room = 8 * (reader.into_inner().position() - begin);
    if room != u64::from(bits) * all.len() as u64 {
        // The valid ones are the upper, and hound takes the lower.
        return Err(InputError::new(format!("samples of {bits} bits in {} cannot be read", room / all.len() as u64)));
    }
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
    let repeated = repeated(count, samples);
    let extremes = (spec.sample_format == SampleFormat::Int).then_some([-1.0, (full - 1.0) / full]);
    Ok(Samples {
        channels: antennas,
        samples,
        values,
        is_real,
        repeated,
        extremes,
        kind: format!("WAV {format}{bits}, {sort}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hound::{WavSpec, WavWriter};

    /// Two channels of 16 bits at 1 kHz; the samples are 0, 1, 2 and so on.
    fn file() -> Vec<u8> {
        let spec = WavSpec { channels: 2, sample_rate: 1000, bits_per_sample: 16, sample_format: SampleFormat::Int };
        let mut bytes = Vec::new();
        let mut writer = WavWriter::new(Cursor::new(&mut bytes), spec).unwrap();
        (0..2 * 2500_i16).for_each(|value| writer.write_sample(value).unwrap());
        writer.finalize().unwrap();
        bytes
    }

    #[test]
    fn no_sample_is_left_out() {
        let Samples { samples, values, .. } = parse(&file(), 2, 1000.0).unwrap();
        assert_eq!((samples, values.len()), (FRAME, 3 * 2 * FRAME));
        assert_eq!(values.last().unwrap().re, 4999.0 / 32_768.0);
    }

    #[test]
    fn what_hound_would_read_wrongly_or_in_part_is_refused() {
        // Two channels at 1 kHz with 24 bits in 32, of which the upper ones count.
        let mut file = b"RIFF".to_vec();
        file.extend((60 + 16_u32).to_le_bytes());
        file.extend(b"WAVEfmt \x28\0\0\0\xFE\xFF\x02\0");
        file.extend(1000_u32.to_le_bytes());
        file.extend(8000_u32.to_le_bytes());
        [8_u16, 32, 22, 24].iter().for_each(|field| file.extend(field.to_le_bytes()));
        file.extend(b"\0\0\0\0\x01\0\0\0\0\0\x10\0\x80\0\0\xAA\0\x38\x9B\x71data");
        file.extend(16_u32.to_le_bytes());
        file.extend([0; 16]);
        let refusal = |file: &[u8]| parse(file, 2, 1000.0).err().unwrap().to_string();
        assert_eq!(refusal(&file), "samples of 24 bits in 32 cannot be read");
        let cut_off = refusal(&self::file()[..5000]);
        assert!(cut_off.starts_with("not a WAV file that can be read: "), "{cut_off}");
    }
}
