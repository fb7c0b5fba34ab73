//! What the kernel knows of a TCP connection that another process has written to.

use std::mem::{MaybeUninit, offset_of};
use std::os::fd::{AsRawFd as _, BorrowedFd};

/// How many bytes of this connection its partner's system has confirmed so far; `None` if it is no TCP connection, or
/// the kernel is too old to count them.
#[must_use]
pub fn confirmed_bytes(socket: BorrowedFd<'_>) -> Option<u64> {
    let mut info = MaybeUninit::<libc::tcp_info>::zeroed();
    let mut len = size_of::<libc::tcp_info>() as libc::socklen_t;
    // SAFETY: the kernel writes at most `len` bytes into `info`, and tells how many.
    let answer = unsafe {
        let option = info.as_mut_ptr().cast();
        libc::getsockopt(socket.as_raw_fd(), libc::IPPROTO_TCP, libc::TCP_INFO, option, &raw mut len)
    };
    let enough = offset_of!(libc::tcp_info, tcpi_bytes_acked) + size_of::<u64>();
    if answer != 0 || (len as usize) < enough {
        return None;
    }
    // SAFETY: all fields are numbers, for which zeros are values as well.
    Some(unsafe { info.assume_init() }.tcpi_bytes_acked)
}
