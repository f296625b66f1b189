//! `--bearings`: a live radio instead of simulated antennas.

use std::path::{Path, PathBuf};
use std::time::{self, Duration};

use clap::Args;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Bearing;
use foxhound_sim::drive::companion::Bearings;
use foxhound_sim::scenario::input::{AZIMUTH_DEG, InputError, check_within};
use foxhound_sim::tools::live::{Live, Options, Source, State};
use foxhound_sim::tools::radio_array::RadioArray;

use super::terminal::warn;
use super::value::number;

/// Range of the sigma for bearings without one.
const SIGMA_DEG: std::ops::RangeInclusive<f64> = 0.1..=60.0;
/// Range of the largest age of a bearing.
const AGE_S: std::ops::RangeInclusive<f64> = 0.02..=10.0;
/// Changes of the state are reported no more often than that, and those of its reason alone.
const PERIOD: Duration = Duration::from_millis(500);
const REASON_PERIOD: Duration = Duration::from_secs(5);

#[derive(Args, Debug)]
pub(super) struct RadioArgs {
    /// Direction-finding radio: kraken:, heimdall:, hci:, uudf: or udp:, see below.
    #[arg(long, value_name = "SOURCE")]
    bearings: Option<Source>,
    /// Description of its array, as for `foxhound bearing`, if it sends samples.
    #[arg(long, value_name = "FILE")]
    array: Option<PathBuf>,
    /// The wanted transmitter: frequency in Hz (kraken), address (hci, uudf), or handle of the train or,
    /// of a connection, its handle plus 4096 (hci) [default: any].
    #[arg(long, value_name = "ID", value_parser = identity, requires = "bearings")]
    emitter: Option<u64>,
    /// Direction of the array's zero, clockwise from the nose.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = number(AZIMUTH_DEG), requires = "bearings")]
    mount_deg: f64,
    /// Standard deviation of bearings that come without one (kraken, uudf, udp).
    #[arg(long, value_name = "DEG", default_value_t = 8.0, value_parser = number(SIGMA_DEG), requires = "bearings")]
    sigma_deg: f64,
    /// Bearings older than this, in seconds, are not used.
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = number(AGE_S), requires = "bearings")]
    bearing_age: f64,
}

/// A number, decimal or hexadecimal after 0x, or an address of six octets with colons between them.
fn identity(text: &str) -> Result<u64, String> {
    let octets: Vec<&str> = text.split(':').collect();
    let is_octet = |octet: &&str| octet.len() == 2 && octet.bytes().all(|digit| digit.is_ascii_hexdigit());
    let number = match text.strip_prefix("0x") {
        Some(digits) => u64::from_str_radix(digits, 16),
        None if octets.len() == 6 && octets.iter().all(is_octet) => u64::from_str_radix(&octets.concat(), 16),
        None => text.parse(),
    };
    number.map_err(|_| {
        "expected a whole number, 0x and hexadecimal digits, or an address like 6C:1D:EB:A4:18:45".to_owned()
    })
}

impl RadioArgs {
    /// The description of the array.
    pub(super) fn array(&self) -> Option<&Path> {
        self.array.as_deref()
    }

    /// Name of the radio.
    pub(super) fn name(&self) -> String {
        self.bearings.as_ref().map_or_else(String::new, Source::to_string)
    }

    /// Opens the radio, if one is given.
    pub(super) fn open(&self) -> Result<Option<Radio>, InputError> {
        let Some(source) = &self.bearings else {
            // A recording needs it, too, so that it is checked here.
            return match self.array {
                Some(_) => Err(InputError::new("--array: only with --bearings")),
                None => Ok(None),
            };
        };
        check_within("--mount-deg", self.mount_deg, &AZIMUTH_DEG)?;
        check_within("--sigma-deg", self.sigma_deg, &SIGMA_DEG)?;
        check_within("--bearing-age", self.bearing_age, &AGE_S)?;
        let array = self.array.as_deref().map(RadioArray::read).transpose()?;
        let options = Options {
            array,
            emitter: self.emitter,
            mount_rad: self.mount_deg.to_radians() as f32,
            sigma_rad: self.sigma_deg.to_radians() as f32,
            age_max: Duration::from_secs_f64(self.bearing_age),
        };
        let live = Live::open(source, options)?;
        Ok(Some(Radio { live, shown: State::Waiting, told: None, heard: 0 }))
    }
}

/// A radio, and its last reported state.
pub(super) struct Radio {
    live: Live,
    shown: State,
    /// When it was reported.
    told: Option<time::Instant>,
    heard: u64,
}

impl Radio {
    /// Summary of what was received.
    pub(super) fn summary(&self) -> String {
        format!("radio: {} bearings, {} at the end", self.heard, self.live.state())
    }
}

impl Bearings for Radio {
    fn poll(&mut self, now: Instant) -> Option<Bearing> {
        let bearing = self.live.poll(now);
        self.heard += u64::from(bearing.is_some());
        let (state, shown) = (self.live.state(), &self.shown);
        let period = if state.name() == shown.name() { REASON_PERIOD } else { PERIOD };
        if state != shown && self.told.is_none_or(|told| told.elapsed() >= period) {
            self.shown = self.live.state().clone();
            self.told = Some(time::Instant::now());
            warn(&format!("radio: {}", self.shown));
        }
        bearing
    }
}

#[cfg(test)]
mod tests {
    use super::identity;

    #[test]
    fn a_transmitter_is_a_number_or_an_address() {
        for (text, number) in
            [("433920000", 433_920_000), ("0x6c1deba41845", 0x6C1D_EBA4_1845), ("6C:1D:EB:A4:18:45", 0x6C1D_EBA4_1845)]
        {
            assert_eq!(identity(text), Ok(number));
        }
        for wrong in ["", "-1", "0x", "6C:1D:EB:A4:18", "6C:1D:EB:A4:18:4", "6C:1D:EB:A4:18:+5", "6C-1D-EB-A4-18-45"] {
            assert!(identity(wrong).is_err(), "{wrong}");
        }
    }
}
