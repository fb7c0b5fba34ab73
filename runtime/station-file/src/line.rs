//! Where the serial line of a CP leads to.

use std::fmt;
use std::path::{Path, PathBuf};

/// A line of the station file. The driver gets its text form; paths in it are absolute.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Line {
    /// `serial:/dev/ttyUSB0`: a serial device.
    Serial(PathBuf),
    /// `pty:PATH`: a pseudo terminal the driver creates and publishes as PATH.
    Pty(PathBuf),
    /// `tcp:HOST:PORT`: connects, again and again until somebody listens.
    Tcp(String),
    /// `tcp-listen:PORT`, `tcp-listen:ADDRESS:PORT`: waits for one client.
    Listen(String),
    /// `sim:NAME`: a simulated line, described in a table `[[simulated_line]]`.
    Sim(String),
}

/// Why a line is invalid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// No kind in front, or an unknown one.
    #[error("\"{0}\" is not a kind of line")]
    Kind(String),
    /// Nothing after the colon.
    #[error("nothing follows \"{0}:\"")]
    Empty(&'static str),
    /// No port number, or one that cannot be.
    #[error("\"{0}\" is not a port number (1 to 65535)")]
    Port(String),
    /// No host before the port.
    #[error("\"{0}\" names no host")]
    Host(String),
}

/// The remedy for a wrong line.
pub(super) const REMEDY: &str = "a line is \"serial:DEVICE\", \"pty:PATH\", \"tcp:HOST:PORT\", \"tcp-listen:PORT\", \
     \"tcp-listen:ADDRESS:PORT\" or \"sim:NAME\"";

impl Line {
    /// Reads a line; relative paths start from `folder`, which is made absolute if it can be.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str, folder: &Path) -> Result<Self, LineError> {
        let (kind, rest) = text.split_once(':').ok_or_else(|| LineError::Kind(text.to_owned()))?;
        let known = ["serial", "pty", "tcp", "tcp-listen", "sim"].into_iter().find(|k| *k == kind);
        let kind = known.ok_or_else(|| LineError::Kind(kind.to_owned()))?;
        if rest.is_empty() {
            return Err(LineError::Empty(kind));
        }
        Ok(match kind {
            "serial" => Self::Serial(absolute(folder, rest)),
            "pty" => Self::Pty(absolute(folder, rest)),
            "tcp" => {
                let (host, port) = rest.rsplit_once(':').ok_or_else(|| LineError::Port(rest.to_owned()))?;
                if host.is_empty() {
                    return Err(LineError::Host(rest.to_owned()));
                }
                check_port(port)?;
                Self::Tcp(rest.to_owned())
            }
            "tcp-listen" => {
                check_port(rest.rsplit_once(':').map_or(rest, |(_, port)| port))?;
                Self::Listen(rest.to_owned())
            }
            _ => Self::Sim(rest.to_owned()),
        })
    }
}

fn check_port(text: &str) -> Result<(), LineError> {
    match text.parse::<u16>() {
        Ok(port) if port > 0 => Ok(()),
        _ => Err(LineError::Port(text.to_owned())),
    }
}

fn absolute(folder: &Path, path: &str) -> PathBuf {
    let joined = folder.join(path);
    std::path::absolute(&joined).unwrap_or(joined)
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(path) => write!(f, "serial:{}", path.display()),
            Self::Pty(path) => write!(f, "pty:{}", path.display()),
            Self::Tcp(address) => write!(f, "tcp:{address}"),
            Self::Listen(address) => write!(f, "tcp-listen:{address}"),
            Self::Sim(name) => write!(f, "sim:{name}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_go_both_ways() {
        for text in
            ["serial:/dev/ttyS0", "pty:/tmp/x.pty", "tcp:box:4001", "tcp:[::1]:4001", "tcp-listen:4001", "sim:a"]
        {
            assert_eq!(Line::parse(text, Path::new("/s")).map(|l| l.to_string()), Ok(text.to_owned()));
        }
        assert_eq!(Line::parse("pty:x.pty", Path::new("/s")), Ok(Line::Pty(PathBuf::from("/s/x.pty"))));
    }

    #[test]
    fn wrong_lines() {
        let wrong = |text| Line::parse(text, Path::new("/s")).expect_err(text);
        assert_eq!(wrong("/dev/ttyS0"), LineError::Kind("/dev/ttyS0".into()));
        assert_eq!(wrong("usb:x"), LineError::Kind("usb".into()));
        assert_eq!(wrong("pty:"), LineError::Empty("pty"));
        assert_eq!(wrong("tcp:4001"), LineError::Port("4001".into()));
        assert_eq!(wrong("tcp::1"), LineError::Host(":1".into()));
        assert_eq!(wrong("tcp:box:0"), LineError::Port("0".into()));
        assert_eq!(wrong("tcp-listen:70000"), LineError::Port("70000".into()));
    }
}
