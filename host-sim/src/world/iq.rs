//! IQ reports of an antenna array behind a switch, as a Bluetooth controller sends them over a serial line (H4).

use std::f64::consts::TAU;

use foxhound_computer::iq::Array;
use foxhound_link::radio::hci::REFERENCE;

/// Slots of a constant tone extension with slots of 2 us: 160 us, 4 of them guard, 8 the reference.
const SLOTS: u8 = 37;
/// Samples of full scale have 127.
const AMPLITUDE: f64 = 100.0;

/// The packet by which the controller says that it has synchronised with a transmitter of this address.
#[must_use]
pub fn synchronised(handle: u8, address: u64) -> Vec<u8> {
    let mut packet = vec![4, 0x3E, 16, 0x0E, 0, handle, 0, 0, 0];
    packet.extend(&address.to_le_bytes()[..6]);
    packet.extend([1, 80, 0, 0]);
    packet
}

/// The packet with the report of a transmitter in this direction from the array's zero, whose frequency is off by this much.
#[must_use]
pub fn report(array: &Array, handle: u8, azimuth_rad: f64, offset_hz: f64) -> Vec<u8> {
    let count = REFERENCE as u8 + SLOTS;
    let mut packet = vec![4, 0x3E, 13 + 2 * count, 0x15, handle, 0, 17, 0x18, 0xFD, 0, 0, 2, 0, 1, 0, count];
    let (pattern, slot_s) = (&array.switch.pattern[..array.switch.pattern_slots], f64::from(array.switch.slot_s));
    let reference = (0..REFERENCE).map(|k| (0, (4.5 + k as f64) * 1e-6));
    let slots =
        (0..usize::from(SLOTS)).map(|s| (usize::from(pattern[s % pattern.len()]) - 1, 15e-6 + slot_s * s as f64));
    for (antenna, time_s) in reference.chain(slots) {
        let [forward, right] = array.beam.antennas_m[antenna].map(f64::from);
        let ahead_m = forward * libm::cos(azimuth_rad) + right * libm::sin(azimuth_rad);
        let tone_hz = f64::from(array.switch.tone_hz) + offset_hz;
        let (im, re) = libm::sincos(TAU * (ahead_m / f64::from(array.beam.wavelength_m) + tone_hz * time_s));
        packet.extend([re, im].map(|part| (AMPLITUDE * part) as i8 as u8));
    }
    packet
}
