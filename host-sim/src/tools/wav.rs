//! WAV recordings of many channels: real samples of each antenna, or I and Q of each in turn.

use std::io::Read as _;
use std::ops::Range;
use std::path::Path;

use hound::{SampleFormat, WavReader};
use num_complex::Complex32;

use super::frames::{FRAME, Samples, frame_starts, repeated};
use crate::scenario::input::{InputError, read_bytes};

/// A longer `fmt ` chunk is none.
const FORMAT_BYTES_MAX: usize = 1 << 10;
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
    let mut chunks = Chunks::find(bytes)?;
    let valid = chunks.widen();
    let data = &bytes[chunks.data.clone()];
    // The last sample of a recording that was cut off may be in part there.
    let data = &data[..data.len() - data.len() % chunks.sample_bytes()];
    let Ok(data_bytes) = u32::try_from(data.len()) else {
        return Err(InputError::new(format!("data: {} bytes, of which 4 GiB can be read", data.len())));
    };
    let head = chunks.head(data_bytes);
    let mut reader = WavReader::new(head.as_slice().chain(data)).map_err(unreadable)?;
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

/// What of a file counts.
struct Chunks {
    format: Vec<u8>,
    data: Range<usize>,
}

impl Chunks {
    /// Finds them in a file of lengths of 32 bits, or of 64 (RF64, BW64). Samples of no known length, as a recorder leaves that is cut off or
    /// writes into a pipe, go on to the end of the file.
    fn find(bytes: &[u8]) -> Result<Self, InputError> {
        let wrong = |text: String| Err(InputError::new(text));
        let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?) as usize);
        let long = |at: usize| usize::try_from(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?)).ok();
        if !matches!(bytes.get(..4), Some(b"RIFF" | b"RF64" | b"BW64")) || bytes.get(8..12) != Some(b"WAVE") {
            return wrong("not a WAV file: it does not begin with RIFF, RF64 or BW64, and WAVE".to_owned());
        }
        let is_name =
            |at: usize| bytes.get(at..at + 4).is_some_and(|name| name.iter().all(|byte| (b' '..=b'~').contains(byte)));
        let (mut at, mut format, mut data_bytes) = (12, None, None);
        while let (Some(name), Some(length)) = (bytes.get(at..at + 4), word(at + 4)) {
            let begins = at + 8;
            let left = bytes.len() - begins;
            if name == b"data" {
                let Some(format) = format else { return wrong("no fmt chunk before the samples".to_owned()) };
                let told = if length == u32::MAX as usize { data_bytes.unwrap_or(0) } else { length };
                let is_empty = told == 0 && is_name(begins) && word(begins + 4).is_some_and(|length| length < left);
                let length = if !is_empty && (told == 0 || told > left) { left } else { told };
                let ends = begins + length;
                let rest = bytes.len() - ends;
                if rest > 1 && !is_name(ends) && !is_name(ends + 1) {
                    return wrong(format!("data: {told} bytes by its header, and {rest} follow that are no chunk"));
                }
                return Ok(Self { format, data: begins..ends });
            }
            if length > left {
                break;
            }
            match name {
                b"fmt " if length <= FORMAT_BYTES_MAX => format = Some(bytes[begins..begins + length].to_vec()),
                b"ds64" if length >= 16 => data_bytes = long(begins + 8),
                _ => {}
            }
            // Some writers do not fill up a chunk of odd length.
            at = begins + length + usize::from(length % 2 == 1 && !is_name(begins + length));
        }
        wrong("not a WAV file that can be read: no data chunk".to_owned())
    }

    /// The head of a plain file with these samples, for hound.
    fn head(&self, data_bytes: u32) -> Vec<u8> {
        let word = |length: usize| (length as u32).to_le_bytes();
        let mut head = b"RIFF".to_vec();
        head.extend((self.format.len() as u32 + 20).saturating_add(data_bytes).to_le_bytes());
        head.extend(b"WAVEfmt ");
        head.extend(word(self.format.len()));
        head.extend(&self.format);
        head.extend(b"data");
        head.extend(data_bytes.to_le_bytes());
        head
    }

    /// Bytes of a sample of all channels.
    fn sample_bytes(&self) -> usize {
        usize::from(self.field(12).unwrap_or(0)).max(1)
    }

    fn field(&self, at: usize) -> Option<u16> {
        Some(u16::from_le_bytes(self.format.get(at..at + 2)?.try_into().ok()?))
    }

    /// Lets all bits be valid that a sample has room for, and returns how many the file said if these were fewer: the valid ones are the upper,
    /// and hound takes the lower.
    fn widen(&mut self) -> Option<u16> {
        const VALID: usize = 18;
        let (room, valid) = (self.field(14)?, self.field(VALID)?);
        let is_narrow = self.field(0) == Some(EXTENSIBLE) && self.format.len() >= 40 && (1..room).contains(&valid);
        if !is_narrow {
            return None;
        }
        self.format[VALID..VALID + 2].copy_from_slice(&room.to_le_bytes());
        Some(valid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hound::{WavSpec, WavWriter};
    use std::io::Cursor;

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

    /// Two channels of 16 bits at 1 kHz; the samples are 0, 1, 2 and so on.
    fn file(riff: &[u8; 4], before: &[u8], length: u32, samples: i16, behind: &[u8]) -> Vec<u8> {
        let mut file = riff.to_vec();
        file.extend(b"\xFF\xFF\xFF\xFFWAVE");
        file.extend(before);
        file.extend(b"fmt \x10\0\0\0\x01\0\x02\0");
        file.extend(1000_u32.to_le_bytes());
        file.extend(4000_u32.to_le_bytes());
        file.extend(b"\x04\0\x10\0data");
        file.extend(length.to_le_bytes());
        (0..samples).for_each(|value| file.extend(value.to_le_bytes()));
        file.extend(behind);
        file
    }

    #[test]
    fn a_recorder_that_was_cut_off_or_wrote_long_files_or_other_chunks_is_read_to_the_end() {
        let ds64 = |length: u64| {
            let mut chunk = b"ds64\x1c\0\0\0".to_vec();
            [0, length, 0].iter().for_each(|field: &u64| chunk.extend(field.to_le_bytes()));
            chunk.extend([0; 4]);
            chunk
        };
        let list = b"LIST\x03\0\0\0abc";
        let list40 = b"LIST\x03\0\0\0abcLIST\x28\0\0\0 and all that is in a list of forty bytes.";
        let padded = [&list[..], &[0]].concat();
        let files = [
            ("plain", file(b"RIFF", b"", 400, 200, b"")),
            ("length of zero", file(b"RIFF", b"", 0, 200, b"")),
            ("no length", file(b"RIFF", b"", u32::MAX, 200, b"")),
            ("too long", file(b"RIFF", b"", 4000, 200, b"")),
            ("half a sample more", file(b"RIFF", b"", 0, 200, b"\x07\0\x07")),
            ("64 bits", file(b"RF64", &ds64(400), u32::MAX, 200, b"")),
            ("64 bits, a chunk behind", file(b"BW64", &ds64(400), u32::MAX, 200, list)),
            ("odd chunk, filled up", file(b"RIFF", &padded, 400, 200, &padded)),
            ("odd chunk, not filled up", file(b"RIFF", list, 400, 200, list)),
            ("odd chunk, not filled up, and lengths like letters", file(b"RIFF", list, 400, 200, list40)),
        ];
        for (name, file) in files {
            let read = parse(&file, 2, 1000.0).unwrap();
            let values: Vec<f32> = read.values.iter().map(|value| value.re * 32_768.0).collect();
            let wanted = [0, 1].iter().flat_map(|channel| (0..100).map(move |k| (2 * k + channel) as f32));
            assert_eq!(values, wanted.collect::<Vec<_>>(), "{name}");
        }
        let refused = [
            (file(b"RIFF", b"", 100, 200, b""), "data: 100 bytes by its header, and 300 follow that are no chunk"),
            (file(b"RIFX", b"", 400, 200, b""), "not a WAV file: it does not begin with RIFF, RF64 or BW64, and WAVE"),
            (file(b"RIFF", b"", 400, 200, b"")[..30].to_vec(), "not a WAV file that can be read: no data chunk"),
            (file(b"RIFF", b"data\x04\0\0\0abcd", 400, 200, b""), "no fmt chunk before the samples"),
        ];
        for (file, text) in refused {
            assert_eq!(parse(&file, 2, 1000.0).err().unwrap().to_string(), text);
        }
    }
}
