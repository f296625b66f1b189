//! The antenna array whose packets a board takes, beside the switch of its Bluetooth controller.
//!
//! For another array change these numbers, build and flash. They are those of the array file of `foxhound bearing --switched`: the
//! test `the_array_of_the_image_is_that_of_its_file` compares them with `tests/computer/ring.toml`.

use foxhound_core::base::adc::ANTENNAS_MAX;
use foxhound_core::doa::beam;
use foxhound_core::signal::switched::{self, SLOTS_MAX};

use super::{Array, REFERENCE_HZ};

/// The antenna of each slot, from 1 on, repeated over the packet. The controller takes the reference period with its first
/// antenna, so the slots begin with the second.
const PATTERN: [u8; 8] = [2, 3, 4, 5, 6, 7, 8, 1];

/// A ring of eight, 12 cm across, clockwise as seen from above, the first towards the nose; slots of 2 us.
pub const ARRAY: Array = Array {
    beam: beam::Config {
        wavelength_m: 0.1229,
        antennas_m: [
            [0.06, 0.0],
            [0.042_43, 0.042_43],
            [0.0, 0.06],
            [-0.042_43, 0.042_43],
            [-0.06, 0.0],
            [-0.042_43, -0.042_43],
            [0.0, -0.06],
            [0.042_43, -0.042_43],
        ],
        count: ANTENNAS_MAX,
    },
    switch: switched::Config {
        antennas: ANTENNAS_MAX,
        sample_rate_hz: REFERENCE_HZ,
        tone_hz: 250e3,
        slot_s: 4e-6,
        pattern: pattern(),
        pattern_slots: PATTERN.len(),
    },
};

const fn pattern() -> [u8; SLOTS_MAX] {
    let mut pattern = [0; SLOTS_MAX];
    let mut slot = 0;
    while slot < PATTERN.len() {
        pattern[slot] = PATTERN[slot];
        slot += 1;
    }
    pattern
}
