//! UDP. One peer at a time: the first that speaks, until it has been silent for a while.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::time::{Duration, Instant};

use super::endpoint::Endpoint;
use super::stream::frame_length;

/// A peer that was silent for so long may be replaced by another one: it may have started anew with another port.
const SILENT_AFTER: Duration = Duration::from_secs(3);
/// Most datagrams that one call reads.
const READ_MAX: usize = 1024;

#[derive(Debug)]
pub(super) struct Udp {
    socket: UdpSocket,
    /// Where to send while no peer has answered.
    home: Option<SocketAddr>,
    /// Who spoke last, and when.
    peer: Option<(SocketAddr, Instant)>,
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
        Ok(Self { socket, home: Some(home), peer: None })
    }

    pub(super) fn listen(endpoint: &Endpoint) -> io::Result<Self> {
        let socket = UdpSocket::bind((endpoint.host.as_str(), endpoint.port))?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, home: None, peer: None })
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
                    if self.live_peer().is_none_or(|peer| peer == from) {
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

    fn live_peer(&self) -> Option<SocketAddr> {
        self.peer.filter(|(_, heard)| heard.elapsed() < SILENT_AFTER).map(|(peer, _)| peer)
    }

    fn destination(&self) -> Option<SocketAddr> {
        self.live_peer().or(self.home).or(self.peer.map(|(peer, _)| peer))
    }
}
