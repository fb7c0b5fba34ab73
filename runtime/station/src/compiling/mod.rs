//! Machine code without a pause: the station starts on the reference engine at once; a process of its own compiles, and
//! what it hands over takes the program over between two scans.
//!
//! The runtime's part is a thread that starts the process, looks at what comes (a sealed file of code, refused unless
//! it is made for this order), maps it, and puts the engine into a ring. The scan takes it out between two cycles and
//! gives the old one back through another ring: no lock, no allocation, no system call there. Whatever goes wrong here,
//! the station goes on with the engine it has, and says so once. (docs/engines.md)

mod child;
mod listing;
mod request;

use std::fmt;
use std::io::{self, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use ob1_backplane::handover;
use ob1_cpu::Cpu;
use ob1_cpu::engine::{Engine, Plan};
use ob1_host::driver::kept_environment;
use ob1_native::{Native, Order, Tier, fingerprint, memory_file};
use rtrb::{Consumer, Producer, RingBuffer};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;

pub use child::run as compile_blocks;
pub use listing::listing;
pub use request::Request;

/// What is compiled, in this order.
const TIERS: [Tier; 2] = [Tier::Fast, Tier::Optimised];
/// The command of this executable that is the process.
const COMMAND: &str = "compile-blocks";
/// The longest wait for engines that the scan gives back.
const LOOK: Duration = Duration::from_millis(250);

/// The scan's end: engines that take over, and the way back for those that ran before.
pub struct Successors {
    come: Consumer<Box<dyn Engine>>,
    gone: Producer<Box<dyn Engine>>,
}

impl fmt::Debug for Successors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Successors").field("waiting", &self.come.slots()).finish_non_exhaustive()
    }
}

impl Successors {
    /// The newest engine takes over, when one has come: its name. Between two cycles only. It allocates and frees
    /// nothing, takes no lock and makes no system call.
    pub fn take_over(&mut self, cpu: &mut Cpu) -> Option<&'static str> {
        let mut name = None;
        while let Ok(engine) = self.come.pop() {
            ob1_native::synchronise();
            let old = match cpu.exchange_engine(engine) {
                Ok(old) => {
                    name = Some(cpu.engine());
                    old
                }
                // Of another plan. It was looked at before.
                Err(refused) => refused,
            };
            // There is room for all that ever come.
            let _ = self.gone.push(old);
        }
        name
    }
}

/// The thread that starts the process and takes what comes from it. Dropping it ends both.
#[derive(Debug)]
pub struct Compiling {
    /// Closed to end the thread.
    stop: Option<OwnedFd>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Compiling {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Compiling {
    /// Starts the thread. The process is this executable.
    ///
    /// # Errors
    /// What the system says when it has no thread or descriptor left.
    pub fn start(request: Request, plan: &Arc<Plan>) -> io::Result<(Self, Successors)> {
        let (come, successors) = rings();
        let (stopped, stop) = io::pipe()?;
        let plan = Arc::clone(plan);
        let work = move || {
            let mut work = Work { plan, rings: come, sent: 0, stopped: stopped.into() };
            match work.run(&request) {
                Ok(Outcome::Stopped) => {}
                Ok(Outcome::Done) => work.bury(),
                Err(why) => {
                    tracing::warn!("machine code: {why}; the station goes on without it");
                    work.bury();
                }
            }
        };
        let thread = ob1_rt::spawn("ob1-compiling", work)?;
        Ok((Self { stop: Some(stop.into()), thread: Some(thread) }, successors))
    }
}

/// The thread's ends of the rings.
struct Ends {
    to_scan: Producer<Box<dyn Engine>>,
    from_scan: Consumer<Box<dyn Engine>>,
}

fn rings() -> (Ends, Successors) {
    let (to_scan, come) = RingBuffer::new(TIERS.len());
    let (gone, from_scan) = RingBuffer::new(TIERS.len());
    (Ends { to_scan, from_scan }, Successors { come, gone })
}

/// How the work has ended.
enum Outcome {
    /// All tiers have come.
    Done,
    /// The station ends.
    Stopped,
}

/// The process, and our end of its socket.
struct Process {
    child: Child,
    socket: OwnedFd,
}

impl Drop for Process {
    fn drop(&mut self) {
        // Without effect on one that has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Process {
    fn start(request: &[u8], order: &Order) -> io::Result<Self> {
        let mut file = memory_file()?;
        file.write_all(request)?;
        io::Seek::rewind(&mut file)?;
        let (socket, stdin) = handover::pair()?;
        handover::send(&socket, &order.bytes(), &[file.as_fd()])?;
        let child = Command::new(std::env::current_exe()?)
            .arg(COMMAND)
            .env_clear()
            .envs(kept_environment())
            .stdin(Stdio::from(stdin))
            .stdout(Stdio::null())
            // Out of reach of Ctrl-C: the runtime ends it.
            .process_group(0)
            .current_dir("/")
            .spawn()?;
        Ok(Self { child, socket })
    }

    /// What it has died of.
    fn death(&mut self) -> String {
        match self.child.wait() {
            Ok(status) => status.signal().map_or_else(
                || format!("it has ended with exit code {}", status.code().unwrap_or(-1)),
                |signal| format!("it was ended by signal {signal}"),
            ),
            Err(error) => error.to_string(),
        }
    }
}

/// The thread's work.
struct Work {
    plan: Arc<Plan>,
    rings: Ends,
    /// Engines that were given to the scan.
    sent: usize,
    stopped: OwnedFd,
}

impl Work {
    fn run(&mut self, request: &Request) -> Result<Outcome, String> {
        let secret = secret().map_err(|error| format!("no secret for the code: {error}"))?;
        let order = Order { fingerprint: fingerprint(&self.plan), secret };
        let request = request.write()?;
        let process = Process::start(&request, &order);
        let mut process = process.map_err(|error| format!("the process that compiles cannot be started: {error}"))?;
        drop(request);
        for _ in TIERS {
            let Some(file) = self.next(&mut process)? else { return Ok(Outcome::Stopped) };
            let engine = Native::of_file(&self.plan, &order, file.as_fd());
            let engine = engine.map_err(|why| format!("a file of code is refused: {why}"))?;
            tracing::info!("machine code: {}", engine.told());
            // There is room for one of each tier.
            let _ = self.rings.to_scan.push(Box::new(engine));
            self.sent += 1;
        }
        Ok(Outcome::Done)
    }

    /// The next file of code; `None`: the station ends.
    fn next(&self, process: &mut Process) -> Result<Option<OwnedFd>, String> {
        loop {
            match handover::receive(&process.socket, &mut [0; 1]) {
                Ok(Some((0, _))) => return Err(format!("the process that compiles is gone: {}", process.death())),
                Ok(Some((_, files))) => {
                    return files.into_iter().next().map(Some).ok_or_else(|| "a message without code has come".into());
                }
                Ok(None) => {}
                Err(error) => return Err(format!("the process that compiles cannot be heard: {error}")),
            }
            let mut fds = [PollFd::new(&self.stopped, PollFlags::IN), PollFd::new(&process.socket, PollFlags::IN)];
            let _ = poll(&mut fds, None);
            if !fds[0].revents().is_empty() {
                return Ok(None);
            }
        }
    }

    /// Waits for the engines that the scan gives back, and gives back their memory.
    fn bury(&mut self) {
        loop {
            while self.rings.from_scan.pop().is_ok() {
                self.sent -= 1;
            }
            if self.sent == 0 {
                return;
            }
            let mut fds = [PollFd::new(&self.stopped, PollFlags::IN)];
            let _ = poll(&mut fds, Timespec::try_from(LOOK).ok().as_ref());
            if !fds[0].revents().is_empty() || self.rings.from_scan.is_abandoned() {
                return;
            }
        }
    }
}

fn secret() -> io::Result<[u8; 16]> {
    let mut secret = [0; 16];
    io::Read::read_exact(&mut std::fs::File::open("/dev/urandom")?, &mut secret)?;
    Ok(secret)
}
