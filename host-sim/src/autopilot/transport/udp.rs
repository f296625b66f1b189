//! UDP. One peer at a time: the first that speaks MAVLink, until it has been silent for a while. An autopilot takes the place of a
//! peer through which none has been heard, as of a ground station. Once an autopilot has been heard, the companion's end takes another peer
//! only where it begins with a frame of the same system: an autopilot or a router that has started anew, with another port. Who is
//! called answers from its own address.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::time::{Duration, Instant};

use super::endpoint::Endpoint;
use super::stream::frame_length;

/// A peer that was silent for so long may be replaced by another one: it may have started anew with another port.
const SILENT_AFTER: Duration = Duration::from_secs(3);
/// `MAV_COMP_ID_AUTOPILOT1`.
const AUTOPILOT: u8 = 1;
/// Most datagrams that one call reads.
const READ_MAX: usize = 1024;

#[derive(Debug)]
pub(super) struct Udp {
    socket: UdpSocket,
    /// Where to send while no peer has answered.
    home: Option<SocketAddr>,
    /// Who spoke last, and when.
    peer: Option<(SocketAddr, Instant)>,
    /// The system of the autopilot, once it has been heard.
    system: Option<u8>,
    is_loyal: bool,
    /// It was to listen.
    is_turned: bool,
}

impl Udp {
    pub(super) fn call(endpoint: &Endpoint) -> io::Result<Self> {
        let mut addresses = (endpoint.host.as_str(), endpoint.port).to_socket_addrs()?;
        let home = addresses.next().ok_or(io::ErrorKind::AddrNotAvailable)?;
        let any = if home.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
        let socket = UdpSocket::bind(SocketAddr::new(any, 0))?;
        socket.set_nonblocking(true)?;
        // An autopilot behind a broadcast address answers from its own.
        socket.set_broadcast(home.is_ipv4())?;
        Ok(Self { socket, home: Some(home), peer: None, system: None, is_loyal: true, is_turned: false })
    }

    pub(super) fn listen(endpoint: &Endpoint) -> io::Result<Self> {
        let socket = UdpSocket::bind((endpoint.host.as_str(), endpoint.port))?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, home: None, peer: None, system: None, is_loyal: false, is_turned: false })
    }

    /// The companion's end: listens, or calls where it cannot because somebody listens there already or it is another machine.
    pub(super) fn listen_or_call(endpoint: &Endpoint) -> io::Result<Self> {
        match Self::listen(endpoint) {
            Ok(udp) => Ok(Self { is_loyal: true, ..udp }),
            Err(error) if matches!(error.kind(), io::ErrorKind::AddrInUse | io::ErrorKind::AddrNotAvailable) => {
                Ok(Self { is_turned: true, ..Self::call(endpoint)? })
            }
            Err(error) => Err(error),
        }
    }

    pub(super) fn turned(&self) -> Option<String> {
        self.home.filter(|_| self.is_turned).map(|home| format!("udpout:{home}"))
    }

    pub(super) fn port(&self) -> io::Result<u16> {
        Ok(self.socket.local_addr()?.port())
    }

    pub(super) fn is_open(&self) -> bool {
        self.destination().is_some()
    }

    pub(super) fn read(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut datagram = [0; 4096];
        for _ in 0..READ_MAX {
            match self.socket.recv_from(&mut datagram) {
                Ok((count, from)) => {
                    if self.may_speak(from, &datagram[..count]) {
                        self.peer = Some((from, Instant::now()));
                        bytes.extend_from_slice(&datagram[..count]);
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                // Some systems tell of datagrams here that reached nobody.
                Err(_) => {}
            }
        }
        bytes
    }

    /// A datagram a frame.
    pub(super) fn write(&mut self, mut frames: &[u8]) {
        let Some(destination) = self.destination() else { return };
        while !frames.is_empty() {
            let (frame, rest) = frames.split_at(frame_length(frames));
            // What cannot be sent is lost, as datagrams are.
            let _ = self.socket.send_to(frame, destination);
            frames = rest;
        }
    }

    fn may_speak(&mut self, from: SocketAddr, datagram: &[u8]) -> bool {
        let (peer, sender) = (self.live_peer(), sender(datagram));
        let autopilot = sender.filter(|(_, component)| *component == AUTOPILOT).map(|(system, _)| system);
        let may = if peer == Some(from) {
            true
        } else if peer.is_some() && !(self.is_loyal && self.system.is_none() && autopilot.is_some()) {
            false
        } else {
            let is_called = self.home.is_none_or(|home| home.ip() == from.ip() || is_open(home.ip()));
            let is_known = |(system, _)| !self.is_loyal || self.system.is_none_or(|known| known == system);
            is_called && sender.is_some_and(is_known)
        };
        if may && self.system.is_none() {
            self.system = autopilot;
        }
        may
    }

    fn live_peer(&self) -> Option<SocketAddr> {
        self.peer.filter(|(_, heard)| heard.elapsed() < SILENT_AFTER).map(|(peer, _)| peer)
    }

    fn destination(&self) -> Option<SocketAddr> {
        self.live_peer().or(self.home).or(self.peer.map(|(peer, _)| peer))
    }
}

/// Any address of this machine, or those of a network: the last number of the broadcast addresses that are in use.
fn is_open(address: IpAddr) -> bool {
    address.is_unspecified() || matches!(address, IpAddr::V4(address) if address.octets()[3] == u8::MAX)
}

/// As which system and component the first frame of a datagram of MAVLink, of either version, speaks.
fn sender(datagram: &[u8]) -> Option<(u8, u8)> {
    let at = match datagram.first()? {
        0xFD => 5,
        0xFE => 3,
        _ => return None,
    };
    Some((*datagram.get(at)?, *datagram.get(at + 1)?))
}
