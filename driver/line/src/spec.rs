//! The text that names a line in the station file: `serial:/dev/ttyUSB0`, `pty:PATH`, `tcp:HOST:PORT`,
//! `tcp-listen:PORT`, `sim:PATH`.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The kind and address of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LineSpec {
    /// `serial:/dev/ttyUSB0`: a serial device, or a pty created by another program.
    Serial(PathBuf),
    /// `pty:PATH`: create a pty and publish its other end as the symbolic link PATH.
    Pty(PathBuf),
    /// `tcp:HOST:PORT`: connect to a terminal server.
    Tcp {
        /// Host name or address (IPv6 in brackets).
        host: String,
        /// Port, 1 to 65535.
        port: u16,
    },
    /// `tcp-listen:PORT` or `tcp-listen:ADDR:PORT`: wait for one client.
    ///
    /// Without an address only this machine can connect (127.0.0.1): an omission must not open a line to a plant to the
    /// network. Port 0 takes any free port.
    Listen(SocketAddr),
    /// `sim:PATH`: a place on a simulated line, whose process listens at PATH.
    Sim(PathBuf),
}

/// Why a text is not a line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SpecError {
    /// No known kind before the colon.
    #[error(
        "line \"{0}\": unknown kind; a line is serial:DEVICE, pty:PATH, tcp:HOST:PORT, tcp-listen:PORT or tcp-listen:ADDR:PORT"
    )]
    Kind(String),
    /// Nothing after the colon.
    #[error("line \"{0}\": nothing after the colon")]
    Empty(String),
    /// The path of a device or pty is relative.
    #[error("line \"{0}\": the path must be absolute, because a driver does not run in the station's folder")]
    Relative(String),
    /// The port is missing or not a number.
    #[error("line \"{0}\": \"{1}\" is not a port; a port is a number from {2} to 65535")]
    Port(String, String, u16),
    /// The address to listen on is not an IP address.
    #[error(
        "line \"{0}\": \"{1}\" is not an IP address of this machine, such as 0.0.0.0 (all) or 127.0.0.1 (only itself)"
    )]
    Address(String, String),
    /// No host before the port.
    #[error("line \"{0}\": tcp needs HOST:PORT")]
    Host(String),
}

impl FromStr for LineSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let whole = || text.to_owned();
        let (kind, rest) = text.split_once(':').ok_or_else(|| SpecError::Kind(whole()))?;
        if !matches!(kind, "serial" | "pty" | "tcp" | "tcp-listen" | "sim") {
            return Err(SpecError::Kind(whole()));
        }
        if rest.is_empty() {
            return Err(SpecError::Empty(whole()));
        }
        match kind {
            "serial" => Ok(Self::Serial(absolute(text, rest)?)),
            "pty" => Ok(Self::Pty(absolute(text, rest)?)),
            "sim" => Ok(Self::Sim(absolute(text, rest)?)),
            "tcp" => {
                let (host, port) = rest.rsplit_once(':').ok_or_else(|| SpecError::Host(whole()))?;
                let host = host.strip_prefix('[').and_then(|h| h.strip_suffix(']')).unwrap_or(host);
                if host.is_empty() {
                    return Err(SpecError::Host(whole()));
                }
                Ok(Self::Tcp { host: host.to_owned(), port: number(text, port, 1)? })
            }
            _ => {
                let (address, port) = match rest.rsplit_once(':') {
                    None => (IpAddr::V4(Ipv4Addr::LOCALHOST), rest),
                    Some((address, port)) => {
                        let bare = address.strip_prefix('[').and_then(|a| a.strip_suffix(']')).unwrap_or(address);
                        let address = bare.parse().map_err(|_| SpecError::Address(whole(), address.to_owned()))?;
                        (address, port)
                    }
                };
                Ok(Self::Listen(SocketAddr::new(address, number(text, port, 0)?)))
            }
        }
    }
}

fn absolute(text: &str, path: &str) -> Result<PathBuf, SpecError> {
    let path = Path::new(path);
    if path.is_absolute() { Ok(path.to_owned()) } else { Err(SpecError::Relative(text.to_owned())) }
}

fn number(text: &str, port: &str, least: u16) -> Result<u16, SpecError> {
    match port.parse() {
        Ok(n) if n >= least => Ok(n),
        _ => Err(SpecError::Port(text.to_owned(), port.to_owned(), least)),
    }
}

impl fmt::Display for LineSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(path) => write!(f, "serial:{}", path.display()),
            Self::Pty(path) => write!(f, "pty:{}", path.display()),
            Self::Tcp { host, port } if host.contains(':') => write!(f, "tcp:[{host}]:{port}"),
            Self::Tcp { host, port } => write!(f, "tcp:{host}:{port}"),
            Self::Listen(address) => write!(f, "tcp-listen:{address}"),
            Self::Sim(path) => write!(f, "sim:{}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_parses_and_prints_itself() {
        for (text, printed) in [
            ("serial:/dev/ttyUSB0", "serial:/dev/ttyUSB0"),
            ("pty:/tmp/a b", "pty:/tmp/a b"),
            ("sim:/run/a.line", "sim:/run/a.line"),
            ("tcp:plc.local:4001", "tcp:plc.local:4001"),
            ("tcp:[::1]:4001", "tcp:[::1]:4001"),
            ("tcp-listen:4001", "tcp-listen:127.0.0.1:4001"),
            ("tcp-listen:0.0.0.0:4001", "tcp-listen:0.0.0.0:4001"),
            ("tcp-listen:[::]:4001", "tcp-listen:[::]:4001"),
        ] {
            let spec: LineSpec = text.parse().unwrap();
            assert_eq!(spec.to_string(), printed);
            assert_eq!(printed.parse::<LineSpec>().unwrap(), spec);
        }
    }

    #[test]
    fn mistakes_are_named() {
        for (text, says) in [
            ("/dev/ttyUSB0", "unknown kind"),
            ("rs232:/dev/x", "unknown kind"),
            ("serial:", "nothing after"),
            ("serial:ttyUSB0", "absolute"),
            ("pty:x", "absolute"),
            ("tcp:4001", "HOST:PORT"),
            ("tcp::4001", "HOST:PORT"),
            ("tcp:h:0", "not a port"),
            ("tcp:h:70000", "not a port"),
            ("tcp-listen:x", "not a port"),
            ("tcp-listen:host:1", "not an IP address"),
        ] {
            let error = text.parse::<LineSpec>().unwrap_err().to_string();
            assert!(error.contains(says), "{text}: {error}");
        }
    }
}
