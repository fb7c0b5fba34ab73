//! Ctrl-C, SIGTERM, SIGHUP, SIGQUIT, SIGPWR and SIGXCPU: the first ends the run in order; a second Ctrl-C or SIGTERM at
//! once. A terminal that is closed may send SIGHUP more than once, and a run started with `nohup` is to go on. Signals
//! that mean nothing here (SIGUSR1, a timer of a library) do nothing, instead of ending the process.

use std::io::{self, Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc;
use std::time::Duration;

use ob1_rt::SideThread;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::Signal;
use signal_hook::consts::{
    SIGALRM, SIGHUP, SIGINT, SIGIO, SIGPROF, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2, SIGVTALRM, SIGXCPU,
};

/// The exit code of a run that was ended by a second signal, as shells show SIGINT.
const SECOND_SIGNAL: i32 = 130;

/// Signals, as something to wait for.
#[derive(Debug)]
pub struct Signals {
    caught: UnixStream,
    sender: UnixStream,
}

impl Signals {
    /// Catches them from here on.
    pub fn catch() -> io::Result<Self> {
        let (caught, sender) = UnixStream::pair()?;
        for signal in [SIGINT, SIGTERM] {
            let armed = Arc::new(AtomicBool::new(false));
            // In this order: the first signal finds it unarmed.
            ob1_rt::end_at_signal(signal, SECOND_SIGNAL, Arc::clone(&armed))?;
            signal_hook::flag::register(signal, armed)?;
            signal_hook::low_level::pipe::register(signal, sender.try_clone()?)?;
        }
        let power = Signal::POWER.as_raw();
        for signal in [SIGHUP, SIGQUIT, power, SIGXCPU].into_iter().filter(|signal| !ignored(*signal)) {
            signal_hook::low_level::pipe::register(signal, sender.try_clone()?)?;
        }
        // Heard by nobody. A process that is started from here does not inherit that.
        for signal in [SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGIO] {
            signal_hook::flag::register(signal, Arc::default())?;
        }
        Ok(Self { caught, sender })
    }

    /// Treats the end of standard input as a signal, too.
    pub fn and_end_of_stdin(&self) -> io::Result<()> {
        let mut sender = self.sender.try_clone()?;
        // It ends with the process: nothing wakes it but the end of its input.
        ob1_rt::spawn("ob1-lifeline", move || {
            let _ = io::copy(&mut io::stdin().lock(), &mut io::sink());
            let _ = sender.write_all(&[0]);
        })?;
        Ok(())
    }

    /// Until this is dropped a signal ends the process at once: nothing has been started yet, and a plugin may not
    /// return from its load.
    ///
    /// # Errors
    /// What the system says when it has no thread or descriptor left.
    pub fn end_at_once(&self) -> io::Result<SideThread<OwnedFd>> {
        let caught = self.caught.try_clone()?;
        let (up, is_up) = mpsc::channel();
        let thread = SideThread::polling("ob1-starting", move |stopped| {
            // A thread that begins to run needs the lock that a library holds while it is loaded.
            let _ = up.send(());
            loop {
                let mut fds = [PollFd::new(&stopped, PollFlags::IN), PollFd::new(&caught, PollFlags::IN)];
                let _ = poll(&mut fds, None);
                if !fds[0].revents().is_empty() {
                    return;
                }
                if !fds[1].revents().is_empty() {
                    err!("ob1: ended by a signal before the station was started");
                    ob1_process::log::flush(ob1_process::log::LAST_WORDS);
                    // Without the handlers of libraries: a plugin that is just being loaded holds their lock.
                    ob1_rt::end_now(SECOND_SIGNAL);
                }
            }
        });
        let _ = is_up.recv();
        thread
    }

    /// Waits for a signal, but not longer than `time`; true when one came.
    pub fn wait(&self, time: Duration) -> bool {
        let mut byte = [0];
        self.caught.set_read_timeout(Some(time)).is_ok() && (&self.caught).read(&mut byte).is_ok_and(|n| n > 0)
    }
}

/// Whether this process was started with a signal ignored.
fn ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}
