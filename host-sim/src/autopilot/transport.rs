//! The line between companion and autopilot in real time: TCP, UDP, a serial port or a pseudo-terminal.
//!
//! Nothing here ever waits. A line that breaks is reopened, for as long as it takes; until then written bytes are
//! lost, as on a wire. Bytes that a line cannot take at once are dropped by whole frames: for setpoints a newer frame
//! is worth more than an older one, and a queue of old ones is dangerous.
//!
//! | address | the other end |
//! |---|---|
//! | `tcp:HOST:PORT` | listens there; is called again when it hangs up |
//! | `udp:HOST:PORT`, `udpin:` | sends to this local port; the first sender is answered, and all others are ignored |
//! | `udpout:HOST:PORT` | listens there; the answers may come from another port of it |
//! | `serial:DEVICE:BAUD` | is wired to a serial port: 8 data bits, no parity, no flow control |
//!
//! The schemes have the meaning that they have in pymavlink, MAVSDK and `QGroundControl`. If `udp:` names a host that
//! is not this machine, or a port at which another program listens, it can only mean `udpout:`, and is read as that
//! ([`Line::turned`]).

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::str::FromStr;

mod endpoint;
/// What the other systems have, for the test of its refusal.
#[cfg(test)]
#[expect(dead_code, reason = "only its refusal can be tested")]
pub mod no_serial;
#[cfg_attr(not(unix), path = "transport/no_serial.rs")]
pub mod serial;
mod stream;
mod tcp;
mod udp;

pub use endpoint::Endpoint;
use endpoint::endpoint;
use tcp::Tcp;
use udp::Udp;

/// Address of the autopilot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// It listens for TCP.
    Tcp(Endpoint),
    /// It sends by UDP to this port of ours.
    UdpIn(Endpoint),
    /// It listens for UDP.
    UdpOut(Endpoint),
    /// It is behind a serial port.
    Serial {
        /// The device file.
        device: PathBuf,
        /// Bits a second.
        baud: u32,
    },
}

/// Address at which a modelled autopilot serves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Listen {
    /// By TCP; port 0 is any free one.
    Tcp(Endpoint),
    /// By UDP; port 0 is any free one.
    Udp(Endpoint),
    /// As if by a serial port, at a pseudo-terminal.
    Pty,
}

const SCHEMES: [&str; 5] = ["tcp", "udp", "udpin", "udpout", "serial"];
/// Baud rates of a serial port.
pub const BAUDS: std::ops::RangeInclusive<u32> = 1_200..=12_000_000;

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(meant) = meant(text) {
            return Err(format!("did you mean `{meant}`?"));
        }
        let (scheme, rest) = text.split_once(':').ok_or_else(|| forms().to_owned())?;
        match scheme {
            "tcp" => Ok(Self::Tcp(endpoint(rest, 1)?)),
            "udp" | "udpin" => Ok(Self::UdpIn(endpoint(rest, 1)?)),
            "udpout" => Ok(Self::UdpOut(endpoint(rest, 1)?)),
            "serial" => {
                // The names of devices may hold colons.
                let (device, baud) = rest.rsplit_once(':').ok_or("expected serial:DEVICE:BAUD")?;
                if device.is_empty() {
                    return Err("expected serial:DEVICE:BAUD".to_owned());
                }
                let baud = baud.parse().map_err(|_| format!("baud rate `{baud}` is not a number"))?;
                if !BAUDS.contains(&baud) {
                    return Err(format!("baud rate {baud} is outside {}..={}", BAUDS.start(), BAUDS.end()));
                }
                Ok(Self::Serial { device: device.into(), baud })
            }
            _ => Err(unknown_scheme(scheme, &SCHEMES)),
        }
    }
}

impl FromStr for Listen {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            None if text == "pty" => Ok(Self::Pty),
            Some(("tcp", rest)) => Ok(Self::Tcp(endpoint(rest, 0)?)),
            Some(("udp", rest)) => Ok(Self::Udp(endpoint(rest, 0)?)),
            Some((scheme, _)) if !["tcp", "udp"].contains(&scheme) => Err(unknown_scheme(scheme, &["tcp", "udp"])),
            _ => Err("expected tcp:HOST:PORT, udp:HOST:PORT or pty".to_owned()),
        }
    }
}

/// The address meant by a form that other programs accept.
fn meant(text: &str) -> Option<String> {
    let (scheme, rest) = text.split_once(':').unwrap_or((text, ""));
    if text.starts_with("/dev/") {
        let (device, baud) = text.rsplit_once([':', ',']).unwrap_or((text, "115200"));
        return Some(format!("serial:{device}:{baud}"));
    }
    if let Some(rest) = rest.strip_prefix("//") {
        // Without a host MAVSDK means every address of this machine.
        let any = if rest.starts_with(':') { "0.0.0.0" } else { "" };
        return SCHEMES.contains(&scheme).then(|| format!("{scheme}:{any}{rest}"));
    }
    let is_host = scheme == "localhost" || scheme.contains('.');
    (is_host && rest.parse::<u16>().is_ok()).then(|| format!("tcp:{text}"))
}

fn forms() -> &'static str {
    "expected tcp:HOST:PORT, udp:HOST:PORT, udpout:HOST:PORT or serial:DEVICE:BAUD"
}

fn unknown_scheme(scheme: &str, known: &[&str]) -> String {
    let nearest = known
        .iter()
        .map(|name| (strsim::damerau_levenshtein(scheme, name), name))
        .min_by_key(|(distance, _)| *distance)
        .filter(|(distance, _)| *distance <= 2);
    match nearest {
        Some((_, name)) => format!("unknown scheme `{scheme}`; did you mean `{name}`?"),
        None => format!("unknown scheme `{scheme}`; valid: {}", known.join(", ")),
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(endpoint) => write!(f, "tcp:{endpoint}"),
            Self::UdpIn(endpoint) => write!(f, "udpin:{endpoint}"),
            Self::UdpOut(endpoint) => write!(f, "udpout:{endpoint}"),
            Self::Serial { device, baud } => write!(f, "serial:{}:{baud}", device.display()),
        }
    }
}

/// One end of a line.
#[derive(Debug)]
pub struct Line(Kind);

#[derive(Debug)]
enum Kind {
    Tcp(Tcp),
    Udp(Udp),
    Serial(serial::Serial),
}

impl Line {
    /// The companion's end. A peer that is not there yet is not an error.
    ///
    /// # Errors
    /// A host that cannot be found, a port that is taken, a device that is missing or is not a serial port.
    pub fn open(address: &Address) -> io::Result<Self> {
        Ok(Self(match address {
            Address::Tcp(endpoint) => Kind::Tcp(Tcp::call(endpoint)?),
            Address::UdpIn(endpoint) => Kind::Udp(Udp::listen_or_call(endpoint)?),
            Address::UdpOut(endpoint) => Kind::Udp(Udp::call(endpoint)?),
            Address::Serial { device, baud } => Kind::Serial(serial::Serial::open(device, *baud)?),
        }))
    }

    /// The autopilot's end, and the address by which a companion reaches it.
    ///
    /// # Errors
    /// A host that is not this machine, a port that is taken, no pseudo-terminal.
    pub fn listen(listen: &Listen) -> io::Result<(Self, Address)> {
        let at = |endpoint: &Endpoint, port| Endpoint { port, ..endpoint.clone() };
        Ok(match listen {
            Listen::Tcp(endpoint) => {
                let tcp = Tcp::listen(endpoint)?;
                let address = Address::Tcp(at(endpoint, tcp.port()?));
                (Self(Kind::Tcp(tcp)), address)
            }
            Listen::Udp(endpoint) => {
                let udp = Udp::listen(endpoint)?;
                let address = Address::UdpOut(at(endpoint, udp.port()?));
                (Self(Kind::Udp(udp)), address)
            }
            Listen::Pty => {
                let (serial, device) = serial::Serial::pseudo_terminal()?;
                (Self(Kind::Serial(serial)), Address::Serial { device, baud: 115_200 })
            }
        })
    }

    /// If a line could not listen and calls instead: the address that it calls.
    #[must_use]
    pub fn turned(&self) -> Option<String> {
        match &self.0 {
            Kind::Udp(udp) => udp.turned(),
            Kind::Tcp(_) | Kind::Serial(_) => None,
        }
    }

    /// Whether there is a peer to write to, as far as can be known. Reading reopens a broken line.
    pub fn is_open(&mut self) -> bool {
        match &mut self.0 {
            Kind::Tcp(tcp) => tcp.is_open(),
            Kind::Udp(udp) => udp.is_open(),
            Kind::Serial(serial) => serial.is_open(),
        }
    }

    /// How often a serial port has been opened again: who is at its other end then may have restarted.
    #[must_use]
    pub fn openings(&self) -> u32 {
        match &self.0 {
            Kind::Serial(serial) => serial.openings(),
            Kind::Tcp(_) | Kind::Udp(_) => 0,
        }
    }

    /// Everything that has come since the last call.
    pub fn read(&mut self) -> Vec<u8> {
        match &mut self.0 {
            Kind::Tcp(tcp) => tcp.read(),
            Kind::Udp(udp) => udp.read(),
            Kind::Serial(serial) => serial.read(),
        }
    }

    /// Writes whole frames, as many as the line takes at once.
    pub fn write(&mut self, frames: &[u8]) {
        match &mut self.0 {
            Kind::Tcp(tcp) => tcp.write(frames),
            Kind::Udp(udp) => udp.write(frames),
            Kind::Serial(serial) => serial.write(frames),
        }
    }
}

#[cfg(test)]
mod tests;
