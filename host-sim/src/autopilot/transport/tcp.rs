//! TCP, as a client and as a server.
//!
//! Connections are made by a thread of their own, since that may take long. The kernel's buffer for an autopilot that
//! does not read is small, and one that does not acknowledge for five seconds counts as disconnected.

use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs as _};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{sleep, spawn};
use std::time::Duration;

use rustix::net::sockopt;

use super::endpoint::Endpoint;
use super::stream::Stream;

const CALL_TIMEOUT: Duration = Duration::from_secs(3);
const CALL_AGAIN_AFTER: Duration = Duration::from_millis(200);
const SEND_BUFFER_BYTES: usize = 8192;
#[cfg(target_os = "linux")]
const UNACKNOWLEDGED_MAX_MS: u32 = 5_000;

#[derive(Debug)]
pub(super) struct Tcp {
    stream: Option<Stream<TcpStream>>,
    /// Nothing could be written to it: the next read hangs up.
    is_broken: bool,
    source: Source,
}

/// The source of the next connection.
#[derive(Debug)]
enum Source {
    Calls { addresses: Vec<SocketAddr>, underway: Receiver<TcpStream> },
    Listener(TcpListener),
}

impl Tcp {
    pub(super) fn call(endpoint: &Endpoint) -> io::Result<Self> {
        let addresses: Vec<_> = (endpoint.host.as_str(), endpoint.port).to_socket_addrs()?.collect();
        let underway = call(addresses.clone());
        Ok(Self { stream: None, is_broken: false, source: Source::Calls { addresses, underway } })
    }

    pub(super) fn listen(endpoint: &Endpoint) -> io::Result<Self> {
        let listener = TcpListener::bind((endpoint.host.as_str(), endpoint.port))?;
        listener.set_nonblocking(true)?;
        Ok(Self { stream: None, is_broken: false, source: Source::Listener(listener) })
    }

    pub(super) fn port(&self) -> io::Result<u16> {
        match &self.source {
            Source::Listener(listener) => Ok(listener.local_addr()?.port()),
            Source::Calls { .. } => Err(io::ErrorKind::Unsupported.into()),
        }
    }

    pub(super) fn is_open(&self) -> bool {
        self.stream.is_some() && !self.is_broken
    }

    /// A peer that hangs up, and one that follows it at once, are never in one call: in between it is not open.
    pub(super) fn read(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        if self.stream.is_none() {
            self.connect();
        }
        if let Some(stream) = &mut self.stream
            && (self.is_broken || stream.read(&mut bytes).is_err())
        {
            self.hang_up();
        }
        bytes
    }

    pub(super) fn write(&mut self, frames: &[u8]) {
        if let Some(stream) = &mut self.stream
            && stream.write(frames).is_err()
        {
            self.is_broken = true;
        }
    }

    fn connect(&mut self) {
        let connected = match &self.source {
            Source::Calls { underway, .. } => underway.try_recv().ok(),
            Source::Listener(listener) => listener.accept().ok().map(|(stream, _)| stream),
        };
        self.stream = connected.filter(|stream| prepare(stream).is_ok()).map(Stream::new);
    }

    fn hang_up(&mut self) {
        (self.stream, self.is_broken) = (None, false);
        if let Source::Calls { addresses, underway } = &mut self.source {
            *underway = call(addresses.clone());
        }
    }
}

fn prepare(stream: &TcpStream) -> io::Result<()> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    sockopt::set_socket_send_buffer_size(stream, SEND_BUFFER_BYTES)?;
    // Elsewhere the system's own patience, which is longer.
    #[cfg(target_os = "linux")]
    sockopt::set_tcp_user_timeout(stream, UNACKNOWLEDGED_MAX_MS)?;
    Ok(())
}

/// Tries to connect until a peer answers, or the caller is gone.
fn call(addresses: Vec<SocketAddr>) -> Receiver<TcpStream> {
    let (sender, receiver): (SyncSender<TcpStream>, _) = sync_channel(0);
    spawn(move || {
        loop {
            for address in &addresses {
                if let Ok(stream) = TcpStream::connect_timeout(address, CALL_TIMEOUT) {
                    // Taken at once, or by nobody any more.
                    let _ = sender.send(stream);
                    return;
                }
            }
            sleep(CALL_AGAIN_AFTER);
        }
    });
    receiver
}
