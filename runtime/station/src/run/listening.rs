//! The sockets of links: bound here, before anything is started, and handed to their processes.

use std::io;
use std::net::SocketAddr;
use std::os::fd::OwnedFd;
use std::path::Path;

use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType, bind, connect, socket_with, sockopt};

use super::failure::Failure;
use crate::exit::Exit;
use ob1_access::settings::ConnectionType;
use ob1_station_file::{LinkKind, Station, StationLink};

/// Connections that may wait to be accepted.
const CALLERS: i32 = 128;
/// Connections that may wait at the tap of a link.
const TAP_CALLERS: i32 = 4;

/// The sockets of all links: the listening one first, then those of connections.
pub(super) fn listen(station: &Station, rundir: &Path) -> Result<Vec<Vec<OwnedFd>>, Failure> {
    let refused = |link: &StationLink, listen: SocketAddr, error: &io::Error| {
        let remedy = match error.kind() {
            io::ErrorKind::PermissionDenied => {
                "ports below 1024 need CAP_NET_BIND_SERVICE (systemd: AmbientCapabilities), or take another port"
            }
            io::ErrorKind::AddrInUse => "end the program that has it (ss -tlnp), or take another port",
            _ => "name an address of this machine: 127.0.0.1, or 0.0.0.0 for all",
        };
        let name = &link.name;
        Failure(Exit::System, format!("ob1: link \"{name}\" cannot listen on {listen}: {error}\n  = {remedy}\n"))
    };
    let sockets_of = |link: &StationLink| {
        let mut sockets = Vec::new();
        if let Some(listen) = link.listen {
            sockets.push(tcp(listen).map_err(|error| refused(link, listen, &error))?);
        }
        for connection in link.connections() {
            let Some((listen, port)) = link.listen.zip(connection.port) else { continue };
            let at = SocketAddr::new(listen.ip(), port);
            let bound = if connection.kind == ConnectionType::Udp { udp(at, connection.partner) } else { tcp(at) };
            sockets.push(bound.map_err(|error| refused(link, at, &error))?);
        }
        if link.kind == LinkKind::S7 {
            let tap = tap(&rundir.join(format!("{}.trace", link.name)));
            sockets.push(tap.map_err(|error| Failure::system("the tap of a link", &error))?);
        }
        Ok(sockets)
    };
    station.links.iter().map(sockets_of).collect()
}

fn tcp(at: SocketAddr) -> io::Result<OwnedFd> {
    let socket = bound(at, SocketType::STREAM)?;
    rustix::net::listen(&socket, CALLERS)?;
    Ok(socket)
}

fn udp(at: SocketAddr, partner: Option<SocketAddr>) -> io::Result<OwnedFd> {
    let socket = bound(at, SocketType::DGRAM)?;
    // Telegrams from others do not fill its queue. As long as there is no way to the partner, the process of the link
    // alone tells them apart.
    match partner.map(|partner| connect(&socket, &partner)) {
        Some(Err(Errno::AFNOSUPPORT)) => Err(Errno::AFNOSUPPORT.into()),
        _ => Ok(socket),
    }
}

/// A socket at this address, also while the machine does not have it: after a power failure a station may be up before
/// the network. The socket is there for the address as soon as it comes (IP_FREEBIND, ip(7)); the check of the station
/// file has warned of it.
fn bound(at: SocketAddr, kind: SocketType) -> io::Result<OwnedFd> {
    let family = if at.is_ipv4() { AddressFamily::INET } else { AddressFamily::INET6 };
    let socket = socket_with(family, kind, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK, None)?;
    if kind == SocketType::STREAM {
        // A station that is started again gets its port at once, although connections of the last one still end.
        sockopt::set_socket_reuseaddr(&socket, true)?;
    }
    // A kernel that does not have it says below that the address is missing.
    let _ =
        if at.is_ipv4() { sockopt::set_ip_freebind(&socket, true) } else { sockopt::set_ipv6_freebind(&socket, true) };
    bind(&socket, &at)?;
    Ok(socket)
}

/// The socket for those who listen to a link (docs/trace.md).
fn tap(path: &Path) -> io::Result<OwnedFd> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
    bind(&socket, &SocketAddrUnix::new(path)?)?;
    rustix::net::listen(&socket, TAP_CALLERS)?;
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use std::net::{TcpListener, TcpStream, UdpSocket};

    use super::*;

    /// Addresses for documentation (RFC 5737, RFC 3849): no machine has them.
    #[test]
    fn a_socket_is_there_before_its_address() {
        for at in ["192.0.2.7:0", "[2001:db8::7]:0"] {
            let at: SocketAddr = at.parse().expect("an address");
            let partner = SocketAddr::new(at.ip(), 9);
            for socket in [tcp(at), udp(at, Some(partner))] {
                match socket {
                    Ok(socket) => assert_eq!(UdpSocket::from(socket).local_addr().expect("bound").ip(), at.ip()),
                    // A machine without IPv6.
                    Err(error) => assert_eq!(error.raw_os_error(), Some(Errno::AFNOSUPPORT.raw_os_error()), "{at}"),
                }
            }
        }
    }

    #[test]
    fn a_socket_listens_and_its_port_is_taken() {
        let here = SocketAddr::from(([127, 0, 0, 1], 0));
        let listener = TcpListener::from(tcp(here).expect("a port"));
        let at = listener.local_addr().expect("bound");
        TcpStream::connect(at).expect("it listens");
        assert_eq!(tcp(at).map(drop).map_err(|error| error.kind()), Err(io::ErrorKind::AddrInUse));
        let other = udp(here, Some(SocketAddr::from(([0, 0, 0, 0, 0, 0, 0, 1], 9))));
        assert_eq!(other.map(drop).map_err(|error| error.raw_os_error()), Err(Some(Errno::AFNOSUPPORT.raw_os_error())));
    }
}
