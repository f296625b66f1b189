//! Bearings from a live radio, for `foxhound companion --bearings`.
//!
//! | source | what sends | needs |
//! |---|---|---|
//! | `kraken:HOST[:PORT]` | the direction-finding software of a `KrakenSDR`: its CSV over HTTP, port 8081 | |
//! | `heimdall:HOST[:PORT]` | the coherent samples of a `KrakenSDR`: heimdall's stream over TCP, port 5000 | the array |
//! | `hci:DEVICE:BAUD` | a Bluetooth controller that sends IQ reports, H4 | the array |
//! | `uudf:DEVICE:BAUD` | a u-blox module that prints `+UUDF` lines | |
//! | `udp:HOST:PORT` | any program that sends JSON lines by UDP to this local port | |
//!
//! [`Live::poll`] never waits: it returns the newest bearing that is not too old, if there is one. A source that stops, or that sends
//! unreadable data, has a [`State`] that says so; the flight holds (`no_signal`) once its last bearing is older than `FH_BRG_AGE`.

use std::fmt;
use std::net::UdpSocket;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use foxhound_core::base::time;
use foxhound_core::doa::bearing::{Bearing, Flags, Quality};
use serde::Deserialize;

use super::radio_array::RadioArray;
use crate::autopilot::transport::{Address, Line};
use crate::scenario::input::InputError;

mod heimdall;
mod kraken;
mod serial;

/// A source that sends nothing for this long is silent.
const SILENT: Duration = Duration::from_secs(2);
/// Longest datagram.
const DATAGRAM_MAX: usize = 4096;

/// A source of bearings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// The directions of a `KrakenSDR`: host and port.
    Kraken(String, u16),
    /// The samples of a `KrakenSDR`: host and port.
    Heimdall(String, u16),
    /// A Bluetooth controller: device and baud rate.
    Hci(PathBuf, u32),
    /// A u-blox module: device and baud rate.
    Uudf(PathBuf, u32),
    /// JSON lines by UDP: local address and port.
    Udp(String, u16),
}

impl FromStr for Source {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let forms =
            "expected kraken:HOST[:PORT], heimdall:HOST[:PORT], hci:DEVICE:BAUD, uudf:DEVICE:BAUD or udp:HOST:PORT";
        let (kind, rest) = text.split_once(':').ok_or(forms)?;
        let host = |default: Option<u16>| {
            let (host, port) = match (rest.rsplit_once(':'), default) {
                (Some((host, port)), _) => {
                    (host, port.parse().map_err(|_| format!("port `{port}` is outside 1..=65535"))?)
                }
                (None, Some(port)) => (rest, port),
                (None, None) => return Err(forms.to_owned()),
            };
            if host.is_empty() || port == 0 {
                return Err(forms.to_owned());
            }
            Ok((host.to_owned(), port))
        };
        let serial = || match format!("serial:{rest}").parse()? {
            Address::Serial { device, baud } => Ok((device, baud)),
            _ => Err(forms.to_owned()),
        };
        match kind {
            "kraken" => host(Some(8081)).map(|(host, port)| Self::Kraken(host, port)),
            "heimdall" => host(Some(5000)).map(|(host, port)| Self::Heimdall(host, port)),
            "udp" => host(None).map(|(host, port)| Self::Udp(host, port)),
            "hci" => serial().map(|(device, baud)| Self::Hci(device, baud)),
            "uudf" => serial().map(|(device, baud)| Self::Uudf(device, baud)),
            _ => Err(forms.to_owned()),
        }
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Kraken(host, port) => write!(f, "kraken:{host}:{port}"),
            Self::Heimdall(host, port) => write!(f, "heimdall:{host}:{port}"),
            Self::Udp(host, port) => write!(f, "udp:{host}:{port}"),
            Self::Hci(device, baud) => write!(f, "hci:{}:{baud}", device.display()),
            Self::Uudf(device, baud) => write!(f, "uudf:{}:{baud}", device.display()),
        }
    }
}

/// How measurements of a source are used.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The array, for sources that send samples.
    pub array: Option<RadioArray>,
    /// The wanted transmitter, for sources that tell transmitters apart: address, frequency in Hz, or the number of a Bluetooth train or
    /// connection (its handle, and 0x1000 for a connection).
    pub emitter: Option<u64>,
    /// Direction of the array's zero, clockwise from the nose.
    pub mount_rad: f32,
    /// Sigma of bearings that come without one.
    pub sigma_rad: f32,
    /// Older bearings are not used.
    pub age_max: Duration,
}

/// State of a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// Nothing has been received yet.
    Waiting,
    /// Bearings are received.
    Hearing,
    /// Data without a bearing: no signal at the radio, another transmitter, or a radio that is calibrating itself.
    NoBearing(String),
    /// Bearings arrive too late to be used.
    Stale,
    /// Nothing was received for two seconds.
    Silent,
    /// Unreadable data.
    Refused(String),
    /// The connection failed.
    Lost(String),
}

impl State {
    /// Name of the state in reports.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Hearing => "hearing",
            Self::NoBearing(_) => "no_bearing",
            Self::Stale => "stale",
            Self::Silent => "silent",
            Self::Refused(_) => "refused",
            Self::Lost(_) => "lost",
        }
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoBearing(why) | Self::Refused(why) | Self::Lost(why) => write!(f, "{}: {why}", self.name()),
            _ => f.write_str(self.name()),
        }
    }
}

/// One message of a source.
#[derive(Clone, Debug, PartialEq)]
enum Event {
    /// A bearing.
    Measured(Measurement),
    /// The source works and has no usable signal; why.
    Nothing(String),
    Refused(String),
    Lost(String),
}

/// A bearing in the frame of the antennas.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Measurement {
    at: Instant,
    azimuth_rad: f32,
    /// `None` if the source does not give it.
    sigma_rad: Option<f32>,
    flags: Flags,
    quality: Quality,
}

impl Measurement {
    /// From a source that gives an angle and nothing else.
    fn plain(at: Instant, azimuth_rad: f32, sigma_rad: Option<f32>) -> Self {
        let quality = Quality { wavenumber: 1.0, ..Quality::default() };
        Self { at, azimuth_rad, sigma_rad, flags: Flags::default(), quality }
    }

    fn of(bearing: &Bearing, at: Instant) -> Event {
        if !bearing.valid {
            return Event::Nothing("the radio hears nothing with a direction".to_owned());
        }
        let Bearing { azimuth_rad, sigma_rad, flags, quality, .. } = *bearing;
        Event::Measured(Self { at, azimuth_rad, sigma_rad: Some(sigma_rad), flags, quality })
    }
}

enum Kind {
    Thread(Receiver<Event>),
    Serial(Box<serial::Serial>),
    Udp(UdpSocket),
}

/// An open source.
pub struct Live {
    kind: Kind,
    options: Options,
    state: State,
    /// When the last message came, and when one with a bearing that could be used.
    last: Instant,
    measured: Option<Instant>,
    /// Why there has been no bearing since.
    nothing: Option<String>,
}

impl Live {
    /// Opens a source. A network source that does not answer yet is not an error: the connection is tried again.
    ///
    /// # Errors
    /// The array is missing or refused by the core, or the device or port cannot be opened.
    pub fn open(source: &Source, options: Options) -> Result<Self, InputError> {
        let needs = |kind: &str| {
            let array = options.array.clone();
            let array = array.ok_or_else(|| {
                InputError::new(format!("--bearings {kind}: needs --array: it gives samples, not angles"))
            })?;
            array.beam.build()?.refuse_line()?;
            Ok::<_, InputError>(array)
        };
        // What would have no effect is refused.
        let useless = match source {
            Source::Heimdall(..) => options.emitter.map(|_| ("--emitter", "tells no transmitters apart")),
            Source::Udp(..) if options.emitter.is_some() => Some(("--emitter", "tells no transmitters apart")),
            Source::Kraken(..) | Source::Uudf(..) | Source::Udp(..) => {
                options.array.as_ref().map(|_| ("--array", "gives angles, not samples"))
            }
            Source::Hci(..) => None,
        };
        if let Some((option, why)) = useless {
            return Err(InputError::new(format!("{option}: not with --bearings {source}, which {why}")));
        }
        let failed = |what: String, error: std::io::Error| InputError::new(format!("--bearings {what}: {error}"));
        let line = |device: &PathBuf, baud: u32| {
            let address = Address::Serial { device: device.clone(), baud };
            Line::open(&address).map_err(|error| failed(address.to_string(), error))
        };
        let kind = match source {
            Source::Kraken(host, port) => Kind::Thread(kraken::start(host, *port, options.emitter)),
            Source::Heimdall(host, port) => Kind::Thread(heimdall::start(host, *port, needs("heimdall")?)?),
            Source::Hci(device, baud) => {
                let reports = serial::Reports::new(&needs("hci")?)?;
                Kind::Serial(Box::new(serial::Serial::reports(line(device, *baud)?, reports)))
            }
            Source::Uudf(device, baud) => Kind::Serial(Box::new(serial::Serial::angles(line(device, *baud)?))),
            Source::Udp(host, port) => {
                let named = |error| failed(format!("udp:{host}:{port}"), error);
                let socket = UdpSocket::bind((host.as_str(), *port)).map_err(named)?;
                socket.set_nonblocking(true).map_err(named)?;
                Kind::Udp(socket)
            }
        };
        Ok(Self { kind, options, state: State::Waiting, last: Instant::now(), measured: None, nothing: None })
    }

    /// The local UDP port.
    #[must_use]
    pub fn port(&self) -> Option<u16> {
        match &self.kind {
            Kind::Udp(socket) => socket.local_addr().ok().map(|address| address.port()),
            _ => None,
        }
    }

    /// The present state.
    #[must_use]
    pub const fn state(&self) -> &State {
        &self.state
    }

    /// What comes without a bearing counts once the last bearing is too old to be used: another transmitter, in between, does not mean that
    /// the wanted one is not heard.
    fn miss(&mut self, here: Instant) {
        let is_recent = |measured: Instant| here.saturating_duration_since(measured) <= self.options.age_max;
        let hears = self.state == State::Hearing && self.measured.is_some_and(is_recent);
        if let Some(why) = self.nothing.take_if(|_| !hears) {
            self.state = State::NoBearing(why);
        }
    }

    /// The newest usable bearing since the last call, if any, in the body frame and with a time of the caller's clock.
    pub fn poll(&mut self, now: time::Instant) -> Option<Bearing> {
        let events = match &mut self.kind {
            Kind::Thread(receiver) => receiver.try_iter().collect(),
            Kind::Serial(serial) => serial.events(self.options.emitter),
            Kind::Udp(socket) => datagrams(socket),
        };
        let here = Instant::now();
        if events.is_empty() {
            let may_be_silent =
                matches!(self.state, State::Hearing | State::Stale | State::NoBearing(_) | State::Refused(_));
            if may_be_silent && here.duration_since(self.last) > SILENT {
                (self.state, self.nothing) = (State::Silent, None);
            }
            self.miss(here);
            return None;
        }
        let mut newest = None;
        for event in events {
            self.last = here;
            match event {
                Event::Measured(measured) if here.saturating_duration_since(measured.at) > self.options.age_max => {
                    (self.state, self.nothing) = (State::Stale, None);
                }
                Event::Measured(measured) => {
                    self.state = State::Hearing;
                    (self.measured, self.nothing) = (Some(here), None);
                    // Lines of a datagram, and datagrams, may come in another order.
                    if newest.as_ref().is_none_or(|newest: &Measurement| newest.at <= measured.at) {
                        newest = Some(measured);
                    }
                }
                Event::Nothing(why) => self.nothing = Some(why),
                Event::Refused(why) => (self.state, self.nothing) = (State::Refused(why), None),
                Event::Lost(why) => (self.state, self.nothing) = (State::Lost(why), None),
            }
        }
        self.miss(here);
        let measured = newest?;
        let age_us = here.saturating_duration_since(measured.at).as_micros() as u64;
        Some(Bearing {
            time: time::Instant(now.0.saturating_sub(age_us)),
            valid: true,
            azimuth_rad: foxhound_core::base::units::wrap_pi(measured.azimuth_rad + self.options.mount_rad),
            sigma_rad: measured.sigma_rad.unwrap_or(self.options.sigma_rad),
            elevation_rad: 0.0,
            elevation_sigma_rad: std::f32::consts::FRAC_PI_2,
            quality: measured.quality,
            flags: measured.flags.with(Flags::ALIKE),
        })
    }
}

/// A line of JSON. Other keys are ignored, so that lines of `foxhound bearing --json` can be sent as they are.
#[derive(Deserialize)]
struct Json {
    azimuth_deg: Option<f64>,
    sigma_deg: Option<f64>,
    valid: Option<bool>,
    mirror_deg: Option<f64>,
    age_s: Option<f64>,
}

/// The events of a datagram, one for each line.
fn parse(text: &[u8], now: Instant) -> Vec<Event> {
    let Ok(text) = std::str::from_utf8(text) else { return vec![Event::Refused("no UTF-8".to_owned())] };
    text.lines().filter(|line| !line.trim().is_empty()).map(|line| json(line, now)).collect()
}

fn json(line: &str, now: Instant) -> Event {
    let refuse = |key: &str, value: f64, range: &str| Event::Refused(format!("{key} = {value} is outside {range}"));
    let line: Json = match serde_json::from_str(line) {
        Ok(line) => line,
        Err(error) => return Event::Refused(error.to_string()),
    };
    let Some(azimuth_deg) = line.azimuth_deg.filter(|_| line.valid != Some(false)) else {
        return Event::Nothing("valid is false, or azimuth_deg null".to_owned());
    };
    if line.mirror_deg.is_some() {
        return Event::Nothing("mirror_deg: antennas on a line, and nothing says which of the two it is".to_owned());
    }
    if !(-360.0..=360.0).contains(&azimuth_deg) {
        return refuse("azimuth_deg", azimuth_deg, "-360..=360");
    }
    if let Some(sigma_deg) = line.sigma_deg.filter(|sigma_deg| !(0.01..=180.0).contains(sigma_deg)) {
        return refuse("sigma_deg", sigma_deg, "0.01..=180");
    }
    let age_s = line.age_s.unwrap_or(0.0);
    if !(0.0..=60.0).contains(&age_s) {
        return refuse("age_s", age_s, "0..=60");
    }
    let at = now.checked_sub(Duration::from_secs_f64(age_s)).unwrap_or(now);
    let radians = |degrees: f64| degrees.to_radians() as f32;
    Event::Measured(Measurement::plain(at, radians(azimuth_deg), line.sigma_deg.map(radians)))
}

fn datagrams(socket: &UdpSocket) -> Vec<Event> {
    let mut events = Vec::new();
    let mut bytes = [0; DATAGRAM_MAX];
    // Bounded, so that a flood of datagrams cannot delay the flight.
    for _ in 0..64 {
        let Ok((count, _)) = socket.recv_from(&mut bytes) else { break };
        events.extend(parse(&bytes[..count], Instant::now()));
    }
    events
}

#[cfg(test)]
mod tests;
