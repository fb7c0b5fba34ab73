//! What the sockets of the process have in common: when a lost partner is noticed, the pause without descriptors.

use std::net::SocketAddr;
use std::os::fd::{AsFd, OwnedFd};
use std::time::Duration;

use rustix::event::PollFlags;
use rustix::io::Errno;
use rustix::net::{SocketFlags, acceptfrom_with, sockopt};

/// Time without accepting after the system had no descriptor left: the callers keep the sockets ready, and the loop
/// would run without a pause.
pub(crate) const PAUSE: Duration = Duration::from_millis(200);

/// Who calls, on a socket that sends at once; `None`: nobody, or somebody who has hung up again.
///
/// # Errors
/// The system has no descriptor or memory left.
pub(crate) fn accept(listener: impl AsFd) -> Result<Option<(OwnedFd, SocketAddr)>, Errno> {
    let (socket, peer) = match acceptfrom_with(listener, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK) {
        Err(Errno::AGAIN | Errno::CONNABORTED | Errno::INTR) => return Ok(None),
        accepted => accepted?,
    };
    let _ = sockopt::set_tcp_nodelay(&socket, true);
    keep_alive(&socket);
    Ok(peer.and_then(|peer| Some((socket, peer.try_into().ok()?))))
}

/// A lost partner is noticed after a minute.
pub(crate) fn keep_alive(socket: &OwnedFd) {
    // A connection also works without these options, but a dead partner is noticed later.
    let _ = sockopt::set_socket_keepalive(socket, true);
    let _ = sockopt::set_tcp_keepidle(socket, Duration::from_secs(30));
    let _ = sockopt::set_tcp_keepintvl(socket, Duration::from_secs(10));
    let _ = sockopt::set_tcp_keepcnt(socket, 3);
}

/// Whether the partner has broken the connection off. The system says so again and again, also to those who do not wait
/// for data.
pub(crate) fn is_broken(ready: PollFlags) -> bool {
    ready.intersects(PollFlags::HUP | PollFlags::ERR)
}
