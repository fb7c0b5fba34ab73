//! The doorbell of a driver: a non-blocking pipe whose read end is the driver's stdin.
//!
//! The pipe lives as long as the module, not as long as one driver process: a restarted driver gets the same read end. So the scan
//! thread writes to one descriptor for ever, without a lock and without the danger that the number means another file. The read end
//! is also kept here, so a ring while no driver lives is not an error; when the runtime goes, the write end goes, and the driver reads
//! end of file.

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;

use rustix::pipe::{PipeFlags, pipe_with};

/// The ringing end. Clones ring the same bell; the driver reads end of file when the last one is dropped.
#[derive(Clone, Debug)]
pub struct Doorbell {
    write_end: Arc<OwnedFd>,
}

impl Doorbell {
    /// Rings: one `write` of one byte. Never blocks; a full pipe has rung already, and a bell nobody hears is no error.
    pub fn ring(&self) {
        let _ = rustix::io::write(self.write_end.as_fd(), &[1]);
    }
}

/// Makes a doorbell: the ringing end, and the end that becomes a driver's stdin (duplicate it for each start). Both are non-blocking and
/// closed on exec.
///
/// # Errors
/// What the system says when no descriptor is left.
pub fn doorbell() -> io::Result<(Doorbell, OwnedFd)> {
    let (read_end, write_end) = pipe_with(PipeFlags::CLOEXEC | PipeFlags::NONBLOCK)?;
    Ok((Doorbell { write_end: Arc::new(write_end) }, read_end))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_never_block_and_the_end_is_seen() {
        let (bell, ear) = doorbell().expect("a pipe");
        // More than any pipe holds: the surplus is dropped.
        for _ in 0..100_000 {
            bell.ring();
        }
        let mut buffer = [0; 65536];
        assert!(rustix::io::read(&ear, &mut buffer).expect("rung") > 0);
        drop(bell);
        while rustix::io::read(&ear, &mut buffer).expect("no more than the end") > 0 {}
    }

    #[test]
    fn an_unheard_ring_is_no_error() {
        let (bell, ear) = doorbell().expect("a pipe");
        drop(ear);
        bell.ring();
    }
}
