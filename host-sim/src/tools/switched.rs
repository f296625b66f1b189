//! `foxhound bearing --switched`: from recorded packets of an array behind a switch to bearings.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use foxhound_core::base::time::Instant;
use foxhound_core::doa::switched::{self, Emitter, Estimator, Group};
use foxhound_core::signal::phase::Complex;
use foxhound_core::signal::switched::{SAMPLES_MAX, SLOTS_MAX};
use num_complex::Complex32;

use super::bearings::{ArrayLine, mark_clipped};
use super::frames::read_npy;
use super::hci;
use super::hci::Packet;
use super::radio_array::RadioArray;
use crate::scenario::input::{InputError, read_bytes};

/// Packets of slots of complex samples, and the transmitter of each.
#[derive(Clone, Debug, PartialEq)]
pub struct Packets {
    /// Samples of a slot.
    samples: usize,
    packets: Vec<Packet>,
    taken: String,
}

impl Packets {
    /// Reads complex64 of shape (packets, slots, samples of a slot), or Bluetooth IQ reports for an array: a btsnoop file, or the
    /// bytes of a serial line (H4). `emitters` is int32 of shape (packets,).
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn read(path: &Path, emitters: Option<&Path>, array: &RadioArray) -> Result<Self, InputError> {
        let bytes = read_bytes(path)?;
        let is_npy = bytes.starts_with(b"\x93NUMPY") || path.extension().is_some_and(|extension| extension == "npy");
        let read = if is_npy { Self::parse(&bytes) } else { Self::of_reports(&bytes, array) };
        let mut read = read.map_err(|error| error.in_file(path))?;
        if let Some(path) = emitters {
            read.set_emitters(&read_bytes(path)?).map_err(|error| error.in_file(path))?;
        }
        Ok(read)
    }

    /// Reads the bytes of a `.npy` file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(bytes: &[u8]) -> Result<Self, InputError> {
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
                InputError::new(format!(
                    "{name} = {value} is outside {least}..={most}, shape (packets, slots, samples)"
                ))
            })
        };
        let (slots, samples) = (within("slots", slots, 2..=SLOTS_MAX)?, within("samples", samples, 1..=SAMPLES_MAX)?);
        let taken = format!("{packets} packets of {slots} slots of {samples} samples, complex64");
        let packet = |values: &[Complex32]| Packet {
            values: values.iter().map(|value| Complex { re: value.re, im: value.im }).collect(),
            ..Packet::default()
        };
        Ok(Self { samples, packets: values.chunks_exact(slots * samples).map(packet).collect(), taken })
    }

    /// Says which transmitter sent each packet: the bytes of a `.npy` file, int32 of shape (packets,).
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn set_emitters(&mut self, bytes: &[u8]) -> Result<(), InputError> {
        let numbers = parse_emitters(bytes, self.count())?;
        for (packet, number) in self.packets.iter_mut().zip(numbers) {
            packet.emitter = number;
        }
        Ok(())
    }

    fn of_reports(bytes: &[u8], array: &RadioArray) -> Result<Self, InputError> {
        let hci::Reports { packets, taken } = hci::read(bytes, array)?;
        Ok(Self { samples: 1, packets, taken })
    }

    /// Number of packets.
    #[must_use]
    pub fn count(&self) -> usize {
        self.packets.len()
    }

    /// Number of transmitters.
    #[must_use]
    pub fn transmitters(&self) -> usize {
        self.packets.iter().map(|packet| packet.emitter).collect::<HashSet<_>>().len()
    }

    /// What was read.
    #[must_use]
    pub fn taken(&self) -> &str {
        &self.taken
    }
}

fn parse_emitters(bytes: &[u8], packets: usize) -> Result<Vec<i32>, InputError> {
    let (shape, emitters) = read_npy::<i32>(bytes, "int32")?;
    if shape != [packets as u64] {
        return Err(InputError::new(format!("shape {shape:?}: expected one number a packet, ({packets},)")));
    }
    Ok(emitters)
}

/// What a group was made of.
#[derive(Default)]
struct Taken {
    packets: usize,
    samples: usize,
    clipped: usize,
}

/// The estimators of an array, one for each number of slots that packets have had.
struct Estimators {
    array: RadioArray,
    samples: usize,
    by_slots: HashMap<usize, Estimator>,
}

impl Estimators {
    fn new(array: &RadioArray, samples: usize) -> Self {
        Self { array: array.clone(), samples, by_slots: HashMap::new() }
    }

    /// The estimator for packets of this number of slots.
    fn of(&mut self, slots: usize) -> Result<&Estimator, InputError> {
        use std::collections::hash_map::Entry;
        match self.by_slots.entry(slots) {
            Entry::Occupied(entry) => Ok(entry.into_mut()),
            Entry::Vacant(entry) => {
                let Some(switch) = self.array.switch else {
                    return Err(InputError::new("switch: missing; --switched needs [switch] with slot_s and pattern"));
                };
                let reader = switch.build(slots, self.samples)?;
                let default = switched::Config::default();
                let config = switched::Config { floor_rad: self.array.sigma_floor_rad.unwrap_or(default.floor_rad) };
                Ok(entry.insert(config.build(self.array.beam.build()?, reader)?))
            }
        }
    }
}

/// The results, and how many packets were left over from the last group.
///
/// # Errors
/// A key of the array file that is missing or that the core refuses.
pub fn find(packets: &Packets, array: &RadioArray, looks: usize) -> Result<(Vec<ArrayLine>, usize), InputError> {
    find_watched(packets, array, looks, |_| ())
}

/// The results, as [`find`] has them; `watch` sees the group of each.
pub(super) fn find_watched(
    packets: &Packets,
    array: &RadioArray,
    looks: usize,
    mut watch: impl FnMut(&Group),
) -> Result<(Vec<ArrayLine>, usize), InputError> {
    let mut estimators = Estimators::new(array, packets.samples);
    let mut states: HashMap<i32, (Emitter, Group, Taken)> = HashMap::new();
    let mut lines = Vec::with_capacity(packets.count() / looks);
    // A packet without samples counts as one of the longest.
    let longest = packets.packets.iter().map(|packet| packet.values.len()).max().unwrap_or_default() / packets.samples;
    for (frame, packet) in packets.packets.iter().enumerate() {
        let slots = packet.values.len() / packets.samples;
        let estimator = estimators.of(if slots == 0 { longest } else { slots })?;
        let (emitter, group, taken) = states.entry(packet.emitter).or_default();
        if slots == 0 {
            estimator.miss(group);
        } else {
            estimator.take_with(emitter, group, &packet.reference, &packet.values);
            taken.clipped += packet.clipped;
            taken.samples += packet.reference.len() + packet.values.len();
        }
        taken.packets += 1;
        if taken.packets == looks {
            let mut arrival = estimator.bearing(group, Instant(frame as u64));
            mark_clipped(&mut arrival.bearing, taken.clipped, taken.samples, array.beam.count);
            lines.push(ArrayLine::new(frame, Some(packet.emitter), &arrival));
            watch(group);
            (*group, *taken) = (Group::default(), Taken::default());
        }
    }
    Ok((lines, states.values().map(|(_, _, taken)| taken.packets).sum()))
}
