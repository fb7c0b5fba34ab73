//! Threads beside the scan.

use std::io;
use std::os::fd::OwnedFd;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use crate::stack::spawn;

/// A thread that works until this is dropped. The drop lets it finish what it does, and waits for it.
///
/// `S` is the end that the owner holds. The thread has the other one and sees that the owner's is closed.
#[derive(Debug)]
pub struct SideThread<S> {
    stop: Option<S>,
    thread: Option<JoinHandle<()>>,
}

impl SideThread<OwnedFd> {
    /// For a thread that polls: it ends when its descriptor is at end of file.
    ///
    /// # Errors
    /// What the system says when it has no thread or descriptor left.
    pub fn polling(name: &str, body: impl FnOnce(OwnedFd) + Send + 'static) -> io::Result<Self> {
        let (stopped, stop) = io::pipe()?;
        let thread = spawn(name, move || body(stopped.into()))?;
        Ok(Self { stop: Some(stop.into()), thread: Some(thread) })
    }
}

impl SideThread<Sender<()>> {
    /// For a thread that looks at intervals: it ends when its receiver is disconnected.
    ///
    /// # Errors
    /// What the system says when it has no thread left.
    pub fn looking(name: &str, body: impl FnOnce(Receiver<()>) + Send + 'static) -> io::Result<Self> {
        let (stop, stopped) = channel();
        let thread = spawn(name, move || body(stopped))?;
        Ok(Self { stop: Some(stop), thread: Some(thread) })
    }
}

impl<S> SideThread<S> {
    /// Closes the owner's end, and does not wait: for an owner that must wake the thread besides.
    pub fn ask_to_end(&mut self) {
        drop(self.stop.take());
    }
}

impl<S> Drop for SideThread<S> {
    fn drop(&mut self) {
        self.ask_to_end();
        if let Some(thread) = self.thread.take() {
            // A panic has been reported by its hook; the owner continues.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    #[test]
    fn the_drop_waits_until_the_thread_has_finished() {
        for polls in [true, false] {
            let finished = Arc::new(AtomicBool::new(false));
            let flag = Arc::clone(&finished);
            if polls {
                drop(SideThread::polling("polling", move |stopped| {
                    assert_eq!(rustix::io::read(&stopped, &mut [0; 1]), Ok(0), "end of file");
                    flag.store(true, Ordering::Relaxed);
                }));
            } else {
                drop(SideThread::looking("looking", move |stopped| {
                    assert!(stopped.recv().is_err(), "disconnected");
                    flag.store(true, Ordering::Relaxed);
                }));
            }
            assert!(finished.load(Ordering::Relaxed), "polls: {polls}");
        }
    }

    #[test]
    fn a_panic_of_the_thread_does_not_reach_its_owner() {
        drop(SideThread::looking("panicking", |_| panic!("as wished")));
    }
}
