//! What the sockets of the process have in common: when a lost partner is noticed, the pause without descriptors.

use std::os::fd::OwnedFd;
use std::time::Duration;

use rustix::event::PollFlags;
use rustix::net::sockopt;

/// Time without accepting after the system had no descriptor left: the callers keep the sockets ready, and the loop
/// would run without a pause.
pub(crate) const PAUSE: Duration = Duration::from_millis(200);

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
