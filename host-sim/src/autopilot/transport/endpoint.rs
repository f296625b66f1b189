//! The address of a socket.

use std::fmt;

/// A host by name or number, and a port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// Name or number.
    pub host: String,
    /// Port.
    pub port: u16,
}

/// Reads `HOST:PORT`.
pub(super) fn endpoint(text: &str, port_min: u32) -> Result<Endpoint, String> {
    let (host, port) = text.rsplit_once(':').ok_or_else(|| format!("`{text}` has no port: expected HOST:PORT"))?;
    let host = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    if host.is_empty() {
        return Err("the host is missing: expected HOST:PORT".to_owned());
    }
    let port: u32 = port.parse().map_err(|_| format!("port `{port}` is not a number in {port_min}..=65535"))?;
    match u16::try_from(port) {
        Ok(number) if port >= port_min => Ok(Endpoint { host: host.to_owned(), port: number }),
        _ => Err(format!("port {port} is outside {port_min}..=65535")),
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.host.contains(':') {
            true => write!(f, "[{}]:{}", self.host, self.port),
            false => write!(f, "{}:{}", self.host, self.port),
        }
    }
}
