//! The broker's thread, and what others hand to it.

use std::io;
use std::os::fd::OwnedFd;
use std::sync::mpsc::{Receiver, Sender, channel};

use ob1_cpu::Clock;
use ob1_rt::SideThread;

use crate::Broker;

/// To hand new connections over. Clones lead to the same broker.
#[derive(Clone, Debug)]
pub struct Handle {
    connections: Sender<(usize, OwnedFd)>,
    wake: std::sync::Arc<OwnedFd>,
}

impl Handle {
    /// The process of a link has been started, with the other end of this socket.
    pub fn connect(&self, link: usize, socket: OwnedFd) {
        if self.connections.send((link, socket)).is_ok() {
            let _ = rustix::io::write(&*self.wake, &[1]);
        }
    }
}

/// A broker at work. Dropping it ends its thread and closes all doors.
#[derive(Debug)]
pub struct RunningBroker {
    thread: SideThread<Sender<()>>,
    handle: Handle,
}

impl RunningBroker {
    /// To hand new connections over.
    #[must_use]
    pub fn handle(&self) -> Handle {
        self.handle.clone()
    }
}

impl Drop for RunningBroker {
    fn drop(&mut self) {
        self.thread.ask_to_end();
        let _ = rustix::io::write(&*self.handle.wake, &[1]);
    }
}

impl Broker {
    /// Gives the broker its thread.
    ///
    /// # Errors
    /// What the system says when it has no thread or descriptor left.
    pub fn start(self, clock: impl Clock + Send + 'static) -> io::Result<RunningBroker> {
        let (awake, wake) = io::pipe()?;
        let (awake, wake) = (OwnedFd::from(awake), OwnedFd::from(wake));
        rustix::io::ioctl_fionbio(&awake, true)?;
        rustix::io::ioctl_fionbio(&wake, true)?;
        let (connections, new) = channel();
        let thread = SideThread::looking("ob1-broker", move |stopped| self.run(clock, &awake, &new, &stopped))?;
        let handle = Handle { connections, wake: std::sync::Arc::new(wake) };
        Ok(RunningBroker { handle, thread })
    }

    fn run(mut self, mut clock: impl Clock, awake: &OwnedFd, new: &Receiver<(usize, OwnedFd)>, stopped: &Receiver<()>) {
        let mut bytes = [0; 64];
        while stopped.try_recv() != Err(std::sync::mpsc::TryRecvError::Disconnected) {
            let now = clock.now();
            while let Ok((link, socket)) = new.try_recv() {
                self.connect(link, socket, now);
            }
            self.step(now);
            self.wait(awake);
            let _ = rustix::io::read(awake, &mut bytes);
        }
    }
}
