//! heimdall's stream of coherent samples over TCP (`KrakenSDR`, `KerberosSDR`): a header of 1024 bytes and a frame of complex64, channel after
//! channel, for each request `IQDownload`.
//!
//! The header is a C structure of little-endian numbers with their natural alignment. Frames that are not data, or
//! whose channels are not yet synchronised, give no bearing. The header's times are of the radio's clock, which need not be ours: a frame
//! counts as measured when it has come, which is late by its own length and the way.

use std::io::{Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use num_complex::Complex32;

use super::{Event, Measurement};
use crate::scenario::input::InputError;
use crate::tools::bearings::mark_clipped;
use crate::tools::frames::FRAME;
use crate::tools::iq::{Estimator, Offset};
use crate::tools::radio_array::RadioArray;
use crate::tools::sigmf::is_of_wavelength;

const HEADER_BYTES: usize = 1024;
const SYNC_WORD: u32 = 0x2BF7_B95A;
const TIMEOUT: Duration = Duration::from_secs(3);
const AGAIN: Duration = Duration::from_secs(1);
/// Samples of a channel in a frame.
const LENGTHS: std::ops::RangeInclusive<usize> = 8..=1 << 20;

/// The fields of a header that are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) is_data: bool,
    pub(super) channels: usize,
    /// Of the radio, zero if it does not tell.
    pub(super) centre_hz: u64,
    pub(super) rate_hz: u64,
    pub(super) length: usize,
    pub(super) is_overdriven: bool,
    pub(super) is_in_step: bool,
}

impl Header {
    pub(super) fn read(bytes: &[u8; HEADER_BYTES]) -> Result<Self, String> {
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        if word(0) != SYNC_WORD {
            return Err(format!("sync word {:#010x}: expected {SYNC_WORD:#010x}", word(0)));
        }
        let header = Self {
            is_data: word(4) == 0,
            channels: word(28) as usize,
            centre_hz: long(40),
            rate_hz: long(56),
            length: word(64) as usize,
            is_overdriven: word(104) != 0,
            is_in_step: word(236) == 1 && word(240) == 1 && word(248) == 0,
        };
        if header.channels > 32 {
            return Err(format!("active_ant_chs = {} is outside 0..=32", header.channels));
        }
        if header.length > *LENGTHS.end() {
            return Err(format!("cpi_length = {} is outside 0..={}", header.length, LENGTHS.end()));
        }
        if header.length > 0 && word(100) != 32 {
            return Err(format!("sample_bit_depth = {}: expected 32, complex64", word(100)));
        }
        Ok(header)
    }

    fn bytes(&self) -> usize {
        self.channels * self.length * 8
    }

    /// Why a frame gives no bearing for an array, if it does not.
    fn refuses(&self, array: &RadioArray) -> Option<Event> {
        let antennas = array.beam.count;
        if self.channels != antennas {
            return Some(Event::Refused(format!("active_ant_chs = {}: antennas_m has {antennas}", self.channels)));
        }
        let wavelength_m = array.beam.wavelength_m;
        if self.centre_hz != 0 && !is_of_wavelength(self.centre_hz as f64, wavelength_m, array.sample_rate_hz) {
            let text = format!("rf_center_freq = {}: the array file has wavelength_m = {wavelength_m}", self.centre_hz);
            return Some(Event::Refused(text));
        }
        if (self.rate_hz as f64 - array.sample_rate_hz).abs() > 1e-6 * array.sample_rate_hz {
            let own_hz = array.sample_rate_hz;
            return Some(Event::Refused(format!("sampling_freq = {}: sample_rate_hz = {own_hz}", self.rate_hz)));
        }
        let is_used = self.is_data && self.is_in_step && LENGTHS.contains(&self.length);
        (!is_used).then(|| Event::Nothing("the receiver's channels are not in step yet".to_owned()))
    }
}

pub(super) fn start(host: &str, port: u16, array: RadioArray) -> Result<Receiver<Event>, InputError> {
    // An array that cannot be used is refused before the flight.
    Estimator::new(&array, FRAME, false, false)?;
    let (sender, receiver) = channel();
    let host = host.to_owned();
    std::thread::spawn(move || {
        loop {
            let why = match listen(&host, port, &array, &sender) {
                Ok(()) => return,
                Err(why) => format!("tcp:{host}:{port}: {why}"),
            };
            if sender.send(Event::Lost(why)).is_err() {
                return;
            }
            std::thread::sleep(AGAIN);
        }
    });
    Ok(receiver)
}

/// Reads the stream until the receiver is dropped or the stream fails.
fn listen(host: &str, port: u16, array: &RadioArray, sender: &Sender<Event>) -> Result<(), String> {
    let text = |error: std::io::Error| error.to_string();
    let address = (host, port).to_socket_addrs().map_err(text)?.next().ok_or("no such host")?;
    let mut stream = TcpStream::connect_timeout(&address, TIMEOUT).map_err(text)?;
    stream.set_read_timeout(Some(TIMEOUT)).map_err(text)?;
    stream.set_write_timeout(Some(TIMEOUT)).map_err(text)?;
    stream.write_all(b"streaming").map_err(text)?;
    let mut estimator: Option<(usize, Estimator)> = None;
    loop {
        let mut bytes = [0; HEADER_BYTES];
        stream.read_exact(&mut bytes).map_err(text)?;
        let header = Header::read(&bytes)?;
        let mut payload = vec![0; header.bytes()];
        stream.read_exact(&mut payload).map_err(text)?;
        let at = Instant::now();
        let event = match header.refuses(array) {
            Some(event) => event,
            None => {
                let samples = header.length.min(FRAME);
                if estimator.as_ref().is_none_or(|(length, _)| *length != samples) {
                    estimator = Some((
                        samples,
                        Estimator::new(array, samples, false, false).map_err(|error| error.to_string())?,
                    ));
                }
                let Some((_, estimator)) = &mut estimator else { return Ok(()) };
                estimate(estimator, &payload, &header, at)
            }
        };
        if sender.send(event).is_err() {
            return Ok(());
        }
        stream.write_all(b"IQDownload").map_err(text)?;
    }
}

/// The bearing of a frame, from the sum of the covariances of its pieces.
fn estimate(estimator: &mut Estimator, payload: &[u8], header: &Header, at: Instant) -> Event {
    let samples: Vec<Complex32> = payload
        .chunks_exact(8)
        .map(|b| {
            Complex32::new(f32::from_le_bytes([b[0], b[1], b[2], b[3]]), f32::from_le_bytes([b[4], b[5], b[6], b[7]]))
        })
        .collect();
    let piece = header.length.min(FRAME);
    let begins = (0..=header.length - piece).step_by(piece);
    let pieces = |begin: usize| samples.chunks_exact(header.length).map(move |channel| &channel[begin..begin + piece]);
    let mut offset = Offset::new(header.channels, header.length / piece);
    begins.clone().for_each(|begin| offset.add(pieces(begin)));
    let means = offset.means();
    for begin in begins {
        estimator.add(&pieces(begin).collect::<Vec<_>>().concat(), &means, 1.0);
    }
    let mut bearing = estimator.take(0).bearing;
    if header.is_overdriven {
        // How many samples are clipped is not told.
        mark_clipped(&mut bearing, samples.len(), samples.len(), header.channels);
    }
    Measurement::of(&bearing, at)
}
