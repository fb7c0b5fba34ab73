//! The recordings of a station (docs/record.md): its own traces into files, and those that `ob1 record` asks for over a
//! socket. One thread takes the rows that the scan has put into their rings; nothing here is ever waited for by the
//! scan, and whoever reads or writes slowly loses rows that are counted.

mod files;
mod happenings;
mod stream;

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ob1_access::Names;
use ob1_access::door::Door;
use ob1_cpu::{RecordingClient, Rows};
use ob1_ir::Program;
use ob1_record::{Capture, Clocks, Event, Head, Order, Settings, Taken, Writer};
use ob1_rt::SideThread;
use ob1_station_file::finding::{Finding, Level};
use ob1_station_file::findings::TRACE;
use ob1_station_file::{Station, StationTrace};
use ob1_time::{Instant, Span};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::rundir::RECORD;
use crate::view::StationView;
use crate::wall_clock::unix_now;
use files::Files;
use happenings::Happenings;
use stream::{Caller, Stream};

/// Time between two looks into the rings while something is recorded.
const LOOK: Duration = Duration::from_millis(5);
/// Time between two looks at the socket while nothing is.
const IDLE: Duration = Duration::from_secs(1);
/// The causes of late scans are known after this time: so long a complete recording waits for them.
const AFTERMATH: Span = Span::from_millis(300);
/// What was recorded is in a block, and with whoever writes it, after this time.
const FLUSH: Span = Span::from_millis(200);

/// The thread of the recordings. Dropping it ends them, each with its last block.
#[derive(Debug)]
pub(crate) struct Recordings {
    _thread: SideThread<OwnedFd>,
}

impl Recordings {
    /// Opens the socket in the runtime directory (mode 0600), and begins the traces of the station file. `door` hears
    /// what happens in the station.
    ///
    /// # Errors
    /// The socket cannot be made, a trace names a signal that does not exist, or no thread can be started.
    pub(crate) fn start(
        cpu: Option<RecordingClient>,
        door: Door,
        view: &StationView,
        station: &Station,
        rundir: &Path,
    ) -> io::Result<Self> {
        let cpu = cpu.ok_or_else(|| io::Error::other("the recordings are taken already"))?;
        let socket = rundir.join(RECORD);
        let listener = bind(&socket)?;
        let happenings = Happenings::new(door, view.clone());
        let min_cycle = station.cpu.min_cycle;
        let mut recording =
            Recording { cpu, view: view.clone(), min_cycle, happenings, jobs: Vec::new(), bytes: Vec::new() };
        for trace in &station.traces {
            recording.trace(trace, &station.state).map_err(io::Error::other)?;
        }
        let thread = SideThread::polling("ob1-record", move |stopped| {
            recording.run(listener, &socket, &stopped);
            let _ = std::fs::remove_file(socket);
        })?;
        Ok(Self { _thread: thread })
    }
}

fn bind(socket: &Path) -> io::Result<UnixListener> {
    let listener = UnixListener::bind(socket)?;
    std::fs::set_permissions(socket, std::fs::Permissions::from_mode(0o600))?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

/// Where the blocks of a recording go.
enum Sink {
    Files(Files),
    Stream(Stream),
}

impl Sink {
    /// Takes these bytes; false: nobody takes any more.
    fn put(&mut self, bytes: &mut Vec<u8>) -> bool {
        match self {
            Self::Files(files) => files.put(bytes),
            Self::Stream(stream) => stream.put(bytes),
        }
    }

    /// Whether so many more bytes find room.
    fn has_room(&self, bytes: usize) -> bool {
        match self {
            // The disk is waited for: what comes meanwhile stays in the ring.
            Self::Files(_) => true,
            Self::Stream(stream) => stream.has_room(bytes),
        }
    }

    fn is_gone(&self) -> bool {
        matches!(self, Self::Stream(stream) if stream.is_gone())
    }
}

/// One recording under way.
struct Job {
    capture: Capture,
    rows: Rows,
    sink: Sink,
    flushed: Instant,
    /// Its last part was complete then.
    complete: Option<Instant>,
}

struct Recording {
    cpu: RecordingClient,
    view: StationView,
    min_cycle: Span,
    happenings: Happenings,
    jobs: Vec<Job>,
    /// Blocks on their way.
    bytes: Vec<u8>,
}

impl Recording {
    fn run(&mut self, mut listener: UnixListener, socket: &Path, stopped: &OwnedFd) {
        let mut callers: Vec<Caller> = Vec::new();
        loop {
            let busy = !self.jobs.is_empty() || !callers.is_empty();
            let time = if busy { LOOK } else { IDLE };
            let mut fds = vec![PollFd::new(stopped, PollFlags::IN), PollFd::new(&listener, PollFlags::IN)];
            fds.extend(self.happenings.fd().map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN)));
            let timeout = Timespec { tv_sec: time.as_secs() as i64, tv_nsec: i64::from(time.subsec_nanos()) };
            // An interrupted poll is a short sleep.
            let _ = poll(&mut fds, Some(&timeout));
            let ends = fds.first().is_some_and(|stopped| !stopped.revents().is_empty());
            drop(fds);
            while let Ok((client, _)) = listener.accept() {
                callers.extend(Caller::new(client));
            }
            callers.retain_mut(|caller| match caller.order() {
                Ok(None) => true,
                Ok(Some(order)) => {
                    self.call(order, caller);
                    false
                }
                Err(()) => false,
            });
            self.look();
            if ends {
                self.end("station");
                return;
            }
            // Others may have removed the runtime directory.
            if !busy
                && std::fs::symlink_metadata(socket).is_err()
                && let Ok(again) = bind(socket)
            {
                listener = again;
            }
        }
    }

    /// Begins what somebody at the socket has asked for, or says why not.
    fn call(&mut self, order: Result<Order, String>, caller: &mut Caller) {
        let began = order.and_then(|order| {
            let known = self.view.known.get();
            let settings = order.settle(&known.names, self.min_cycle)?;
            let rows = settings.start(&mut self.cpu, self.min_cycle)?;
            Ok((order, settings, rows))
        });
        match began {
            Ok((order, settings, rows)) => {
                let head = self.head(&order, &settings);
                let stream = Stream::new(caller, Writer::begin(&head));
                self.begin(settings, rows, Sink::Stream(stream));
            }
            Err(why) => caller.refuse(&why),
        }
    }

    /// Begins a trace of the station file.
    fn trace(&mut self, trace: &StationTrace, folder: &Path) -> Result<(), String> {
        let told = |why: String| format!("[[trace]] \"{}\": {why}", trace.name);
        let order = order_of(trace);
        let settings = order.settle(&self.view.known.get().names, self.min_cycle).map_err(told)?;
        let rows = settings.start(&mut self.cpu, self.min_cycle).map_err(told)?;
        let head = Writer::begin(&self.head(&order, &settings));
        let path = PathBuf::from(folder);
        let files = Files::new(path, trace, head);
        self.begin(settings, rows, Sink::Files(files));
        Ok(())
    }

    fn begin(&mut self, settings: Settings, rows: Rows, sink: Sink) {
        if self.jobs.is_empty() {
            self.happenings.forget();
        }
        let flushed = self.view.clock.time();
        self.jobs.push(Job { capture: Capture::new(settings), rows, sink, flushed, complete: None });
    }

    fn head(&self, order: &Order, settings: &Settings) -> Head {
        let now = self.view.clock.time();
        let [monotonic, boottime] = self.view.clock.at_zero();
        let unix_ns = unix_now().saturating_sub(now.nanos());
        Head {
            station: self.view.name.clone(),
            pid: std::process::id(),
            begun_ns: now.nanos(),
            clocks: Clocks { monotonic_ns: monotonic.nanos(), boottime_ns: boottime.nanos(), unix_ns },
            min_cycle_ns: self.min_cycle.nanos(),
            trigger: order.trigger.clone(),
            before_ns: order.before_ns,
            signals: settings.signals.clone(),
        }
    }

    /// Takes what is there of each recording.
    fn look(&mut self) {
        let now = self.view.clock.time();
        let happened: Vec<Event> = if self.jobs.is_empty() {
            self.happenings.forget();
            Vec::new()
        } else {
            self.happenings.take()
        };
        let bytes = &mut self.bytes;
        self.jobs.retain_mut(|job| {
            let sink = &job.sink;
            if job.complete.is_none() {
                let taken = job.capture.take(&mut job.rows, bytes, &|waiting| sink.has_room(waiting));
                job.complete = (taken == Taken::Complete).then_some(now);
            }
            for event in &happened {
                job.capture.event(event.clone(), bytes);
            }
            let over = job.rows.is_over() || job.complete.is_some_and(|complete| now.since(complete) >= AFTERMATH);
            if over {
                job.capture.end("complete", now, bytes);
            } else if now.since(job.flushed) >= FLUSH {
                job.capture.flush(bytes);
                job.flushed = now;
            }
            let goes_on = job.sink.put(bytes) && !job.sink.is_gone();
            bytes.clear();
            goes_on && !over
        });
    }

    fn end(&mut self, why: &str) {
        let now = self.view.clock.time();
        for mut job in self.jobs.drain(..) {
            self.bytes.clear();
            job.capture.take(&mut job.rows, &mut self.bytes, &|_| true);
            job.capture.end(why, now, &mut self.bytes);
            job.sink.put(&mut self.bytes);
        }
    }
}

/// What is wrong with the traces of a station that has this program.
pub(crate) fn findings(program: &Program, station: &Station) -> Vec<Finding> {
    if station.traces.is_empty() {
        return Vec::new();
    }
    let names = Names::new(program);
    let one = |trace: &StationTrace| {
        let why = order_of(trace).settle(&names, station.cpu.min_cycle).err()?;
        let remedy = "docs/record.md has the names of signals and the triggers".to_owned();
        Some(trace.spot.finding(Level::Error, TRACE, format!("the trace \"{}\": {why}", trace.name), remedy))
    };
    station.traces.iter().filter_map(one).collect()
}

/// A trace of the station file as an order.
fn order_of(trace: &StationTrace) -> Order {
    Order {
        signals: trace.signals.clone(),
        trigger: trace.trigger.clone(),
        before_ns: trace.before.nanos(),
        for_ns: trace.length.nanos(),
        repeat: trace.repeat,
    }
}
