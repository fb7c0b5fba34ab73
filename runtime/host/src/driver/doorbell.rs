//! The doorbell of a driver: a non-blocking pipe whose read end is the driver's stdin.
//!
//! The pipe lives as long as the module, not as long as one driver process: a restarted driver gets the same read end.
//! So the scan thread writes to one descriptor forever, without a lock and without the danger that the number means
//! another file. The read end is also kept by the supervisor, so a ring while no driver lives is not an error; when the
//! runtime goes, the write end goes, and the driver reads end of file.

use std::io;
use std::mem::ManuallyDrop;
use std::os::fd::{AsFd, AsRawFd, FromRawFd, OwnedFd};
use std::sync::Arc;

use rustix::pipe::{PipeFlags, pipe_with};

/// The ringing end. Clones ring the same bell; the driver reads end of file when the last one is dropped or one is hung
/// up.
#[derive(Clone, Debug)]
pub struct Doorbell {
    write_end: Arc<OwnedFd>,
}

impl Doorbell {
    /// A new doorbell: the ringing end, and the end that becomes a driver's stdin (duplicate it for each start). Both
    /// are non-blocking and closed on exec.
    ///
    /// # Errors
    /// What the system says when no descriptor is left.
    pub fn new() -> io::Result<(Self, OwnedFd)> {
        let (read_end, write_end) = pipe_with(PipeFlags::CLOEXEC | PipeFlags::NONBLOCK)?;
        Ok((Self { write_end: Arc::new(write_end) }, read_end))
    }

    /// Rings: one `write` of one byte. Never blocks; a full pipe has rung already, and a closed one is not an
    /// error.
    #[inline]
    pub fn ring(&self) {
        let _ = rustix::io::write(self.write_end.as_fd(), &[1]);
    }

    /// Closes the pipe for all clones at once, so that the driver reads end of file although a scan thread that never
    /// returns (a fenced one) still holds the bell. Later rings go nowhere.
    ///
    /// `instead` takes the pipe's place under its number; a read-only descriptor makes rings an error, which is
    /// ignored.
    ///
    /// # Errors
    /// The system cannot put the descriptor in its place (dup3(2)).
    pub fn hang_up(&self, instead: impl AsFd) -> io::Result<()> {
        // SAFETY: the descriptor is open, because `write_end` owns it, and the alias is never dropped, so it is not
        // closed twice.
        let mut alias = ManuallyDrop::new(unsafe { OwnedFd::from_raw_fd(self.write_end.as_raw_fd()) });
        rustix::io::dup3(instead, &mut alias, rustix::io::DupFlags::CLOEXEC)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_never_block_and_the_end_is_seen() {
        let (bell, ear) = Doorbell::new().expect("a pipe");
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
    fn a_hung_up_bell_is_closed_for_every_clone() {
        let (bell, ear) = Doorbell::new().expect("a pipe");
        let scan = bell.clone();
        scan.ring();
        bell.hang_up(&ear).expect("a descriptor to put there");
        let mut buffer = [0; 8];
        assert_eq!(rustix::io::read(&ear, &mut buffer).expect("rung once"), 1);
        assert_eq!(rustix::io::read(&ear, &mut buffer).expect("the end"), 0);
        scan.ring();
        assert_eq!(rustix::io::read(&ear, &mut buffer).expect("the end for ever"), 0);
    }

    #[test]
    fn an_unheard_ring_is_no_error() {
        let (bell, ear) = Doorbell::new().expect("a pipe");
        drop(ear);
        bell.ring();
    }
}
