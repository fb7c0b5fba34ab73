//! Couplers with TCP connections, all in one thread: fast enough not to affect the measurement.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{self, Duration};

use ob1_time::{Instant, Span};

use ob1_line::sim::SplitMix64;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::super::peer::Failure;
use crate::coupler::{Coupler, Stream, framed};

/// Maximum pause between an output that has followed and the next input.
const PAUSE: Span = Span::from_millis(30);
/// Maximum wait, which limits the time until the end is noticed.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };

/// The measured values.
#[derive(Clone, Debug, Default)]
pub(super) struct Seen {
    /// Telegrams.
    pub(super) requests: u64,
    /// Nanoseconds between two reads of a coupler, for all couplers.
    pub(super) periods: Vec<u64>,
    /// Nanoseconds from an input of the first coupler to the output that follows it.
    pub(super) latencies: Vec<u64>,
}

/// Waits.
pub(super) fn pause(time: Duration) -> Result<(), Failure> {
    let time = Timespec { tv_sec: time.as_secs() as i64, tv_nsec: i64::from(time.subsec_nanos()) };
    poll(&mut [], Some(&time))?;
    Ok(())
}

/// The running couplers; they end when this is dropped.
pub(super) struct Bank {
    pub(super) ports: Vec<u16>,
    seen: Arc<Mutex<Seen>>,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Bank {
    /// Starts `count` couplers with `words` words in each direction.
    pub(super) fn start(count: usize, words: usize) -> Result<Self, Failure> {
        let mut all = Vec::new();
        for _ in 0..count {
            let listener = TcpListener::bind("127.0.0.1:0")?;
            listener.set_nonblocking(true)?;
            let mut coupler = Coupler::new(255, words);
            // The value that the other client expects.
            coupler.driven[0] = 0x1234;
            all.push(One { listener, connections: Vec::new(), coupler, read: None });
        }
        let ports = all.iter().map(|one| Ok(one.listener.local_addr()?.port())).collect::<std::io::Result<_>>()?;
        let (seen, ends) = (Arc::<Mutex<Seen>>::default(), Arc::<AtomicBool>::default());
        let mut server = Server {
            all,
            seen: Arc::clone(&seen),
            start: time::Instant::now(),
            probe: Probe { value: 0, at: None, next: Instant::START, rng: SplitMix64::new(17) },
        };
        let over = Arc::clone(&ends);
        let thread = std::thread::spawn(move || {
            while !over.load(Ordering::Relaxed) {
                if let Err(why) = server.turn() {
                    eprintln!("bench: the couplers: {why}");
                    return;
                }
            }
        });
        Ok(Self { ports, seen, ends, thread: Some(thread) })
    }

    /// The values measured in this time from now.
    pub(super) fn watch(&self, time: Duration) -> Result<Seen, Failure> {
        let take = || self.seen.lock().map(|mut seen| std::mem::take(&mut *seen)).map_err(|_| "the couplers are gone");
        take()?;
        pause(time)?;
        Ok(take()?)
    }
}

impl Drop for Bank {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

struct One {
    listener: TcpListener,
    connections: Vec<(TcpStream, Stream)>,
    coupler: Coupler,
    read: Option<Instant>,
}

/// An input of the first coupler whose output is expected.
struct Probe {
    value: u16,
    at: Option<Instant>,
    next: Instant,
    rng: SplitMix64,
}

struct Server {
    all: Vec<One>,
    seen: Arc<Mutex<Seen>>,
    start: time::Instant,
    probe: Probe,
}

impl Server {
    fn now(&self) -> Instant {
        Instant::START + self.start.elapsed().into()
    }

    fn turn(&mut self) -> std::io::Result<()> {
        let mut fds = Vec::new();
        for one in &self.all {
            fds.push(PollFd::new(&one.listener, PollFlags::IN));
            fds.extend(one.connections.iter().map(|(connection, _)| PollFd::new(connection, PollFlags::IN)));
        }
        let wait = if self.probe.at.is_some() { LOOK.tv_nsec } else { (PAUSE / 30).nanos() as i64 };
        poll(&mut fds, Some(&Timespec { tv_sec: 0, tv_nsec: wait }))?;
        let ready: Vec<bool> = fds.iter().map(|fd| !fd.revents().is_empty()).collect();
        drop(fds);
        let mut ready = ready.into_iter();
        let now = self.now();
        let Ok(mut seen) = self.seen.lock() else { return Ok(()) };
        for one in &mut self.all {
            let called = ready.next() == Some(true);
            let mut gone = Vec::new();
            for (n, (connection, stream)) in one.connections.iter_mut().enumerate() {
                if ready.next() == Some(true) && !answer(connection, stream, &mut one.coupler, now, &mut seen) {
                    gone.push(n);
                }
            }
            gone.into_iter().rev().for_each(|n| drop(one.connections.remove(n)));
            if one.coupler.reads > 0 {
                one.coupler.reads = 0;
                seen.periods.extend(one.read.replace(now).map(|before| (now - before).nanos()));
            }
            one.coupler.writes.clear();
            if called && let Ok((connection, _)) = one.listener.accept() {
                connection.set_nonblocking(true)?;
                connection.set_nodelay(true)?;
                one.connections.push((connection, Stream::default()));
                one.read = None;
            }
        }
        if let Some(first) = self.all.first_mut() {
            self.probe.look(now, &mut first.coupler, &mut seen);
        }
        Ok(())
    }
}

/// Answers a request; whether the connection still exists.
fn answer(
    connection: &mut TcpStream,
    stream: &mut Stream,
    coupler: &mut Coupler,
    now: Instant,
    seen: &mut Seen,
) -> bool {
    let mut buffer = [0; 1024];
    let mut out = Vec::new();
    match connection.read(&mut buffer) {
        Ok(0) => false,
        Ok(len) => {
            let fine = stream.take(&buffer[..len], |transaction, telegram| {
                seen.requests += 1;
                if let Some(answer) = coupler.hear(now, telegram) {
                    out.extend(framed(transaction, &answer));
                }
            });
            fine && connection.write_all(&out).is_ok()
        }
        Err(why) => matches!(why.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
    }
}

impl Probe {
    fn look(&mut self, now: Instant, coupler: &mut Coupler, seen: &mut Seen) {
        match self.at {
            Some(at) if coupler.driven[0] == self.value => {
                seen.latencies.push((now - at).nanos());
                (self.at, self.next) = (None, now + self.rng.span_below(PAUSE));
            }
            None if now >= self.next => {
                self.value = self.value.wrapping_add(1) | 0x8000;
                (self.at, coupler.sensed[0]) = (Some(now), self.value);
            }
            _ => {}
        }
    }
}
