//! `foxhound bearing --switched`: from recorded packets of an array behind a switch to bearings.

use std::collections::HashMap;
use std::path::Path;

use foxhound_core::base::time::Instant;
use foxhound_core::doa::switched::{self, Emitter, Group};
use foxhound_core::signal::phase::Complex;
use foxhound_core::signal::switched::{SAMPLES_MAX, SLOTS_MAX};
use num_complex::Complex32;

use super::bearings::ArrayLine;
use super::frames::read_npy;
use super::radio_array::RadioArray;
use crate::scenario::input::InputError;

/// Packets of slots of complex samples, and the transmitter of each.
#[derive(Clone, Debug, PartialEq)]
pub struct Packets {
    slots: usize,
    samples: usize,
    values: Vec<Complex>,
    emitters: Option<Vec<i32>>,
}

impl Packets {
    /// Reads complex64 of shape (packets, slots, samples of a slot), and int32 of shape (packets,).
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn read(packets: &Path, emitters: Option<&Path>) -> Result<Self, InputError> {
        let mut read = parse(&bytes_of(packets)?).map_err(|error| error.in_file(packets))?;
        if let Some(path) = emitters {
            let count = read.count();
            read.emitters = Some(parse_emitters(&bytes_of(path)?, count).map_err(|error| error.in_file(path))?);
        }
        Ok(read)
    }

    /// Number of packets.
    #[must_use]
    pub fn count(&self) -> usize {
        self.values.len() / (self.slots * self.samples)
    }
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, InputError> {
    std::fs::read(path).map_err(|error| InputError::new(error.to_string()).in_file(path))
}

fn parse(bytes: &[u8]) -> Result<Packets, InputError> {
    let (shape, values) = read_npy::<Complex32>(bytes, "complex64")?;
    let [packets, slots, samples] = shape[..] else {
        return Err(InputError::new(format!("shape {shape:?}: expected (packets, slots, samples of a slot)")));
    };
    if packets == 0 {
        return Err(InputError::new(format!("no packets: shape {shape:?}")));
    }
    let within = |name: &str, value: u64, range: std::ops::RangeInclusive<usize>| {
        let size = usize::try_from(value).ok().filter(|size| range.contains(size));
        size.ok_or_else(|| {
            let (least, most) = (range.start(), range.end());
            InputError::new(format!("{name} = {value} is outside {least}..={most}, shape (packets, slots, samples)"))
        })
    };
    let (slots, samples) = (within("slots", slots, 2..=SLOTS_MAX)?, within("samples", samples, 1..=SAMPLES_MAX)?);
    let values = values.iter().map(|value| Complex { re: value.re, im: value.im }).collect();
    Ok(Packets { slots, samples, values, emitters: None })
}

fn parse_emitters(bytes: &[u8], packets: usize) -> Result<Vec<i32>, InputError> {
    let (shape, emitters) = read_npy::<i32>(bytes, "int32")?;
    if shape != [packets as u64] {
        return Err(InputError::new(format!("shape {shape:?}: expected one number a packet, ({packets},)")));
    }
    Ok(emitters)
}

/// The results, and how many packets were left over from the last group.
///
/// # Errors
/// A key of the array file that is missing or that the core refuses.
pub fn find(packets: &Packets, array: &RadioArray, looks: usize) -> Result<(Vec<ArrayLine>, usize), InputError> {
    let Some(switch) = array.switch else {
        return Err(InputError::new("switch: missing; --switched needs [switch] with slot_s and pattern"));
    };
    let reader = switch.build(packets.slots, packets.samples)?;
    let default = switched::Config::default();
    let config = switched::Config { floor_rad: array.sigma_floor_rad.unwrap_or(default.floor_rad) };
    let estimator = config.build(array.beam.build()?, reader)?;
    let mut states: HashMap<i32, (Emitter, Group, usize)> = HashMap::new();
    let mut lines = Vec::with_capacity(packets.count() / looks);
    for (frame, samples) in packets.values.chunks_exact(packets.slots * packets.samples).enumerate() {
        let number = packets.emitters.as_ref().and_then(|emitters| emitters.get(frame)).copied().unwrap_or(0);
        let (emitter, group, taken) = states.entry(number).or_default();
        estimator.take(emitter, group, samples);
        *taken += 1;
        if *taken == looks {
            let arrival = estimator.bearing(group, Instant(frame as u64));
            lines.push(ArrayLine::new(frame, Some(number), &arrival));
            (*group, *taken) = (Group::default(), 0);
        }
    }
    Ok((lines, states.values().map(|(_, _, taken)| taken).sum()))
}
