//! Common parts of both ends of a TCP line: the options of the connection, reading and writing.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use rustix::net::sockopt;

/// Time without an answer after which a partner that vanished without closing counts as gone.
const SILENT: Duration = Duration::from_secs(10);

/// Small telegrams are sent at once; a partner that lost its power is noticed.
pub(super) fn set_options(stream: &TcpStream) -> io::Result<()> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    sockopt::set_socket_keepalive(stream, true)?;
    sockopt::set_tcp_keepidle(stream, Duration::from_secs(4))?;
    sockopt::set_tcp_keepintvl(stream, Duration::from_secs(2))?;
    sockopt::set_tcp_keepcnt(stream, 3)?;
    sockopt::set_tcp_user_timeout(stream, SILENT.as_millis() as u32)?;
    Ok(())
}

pub(super) fn read(stream: Option<&TcpStream>, buffer: &mut [u8]) -> io::Result<usize> {
    stream.ok_or(io::ErrorKind::NotConnected)?.read(buffer)
}

pub(super) fn write(stream: Option<&TcpStream>, bytes: &[u8]) -> io::Result<usize> {
    stream.ok_or(io::ErrorKind::NotConnected)?.write(bytes)
}
