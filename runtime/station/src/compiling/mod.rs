//! Machine code without a pause: the station starts on the reference engine at once; a process of its own compiles, and
//! its code takes over between two scans.
//!
//! The runtime's part is a thread that starts the process, checks what comes (a sealed file of code, refused unless it
//! is made for this order), maps it, and puts the engine into a ring. The scan takes it out between two cycles and
//! gives the old one back through another ring: no lock, no allocation, no system call there. Whatever goes wrong here,
//! the station continues with the engine it has, and says so once. (docs/engines.md)

mod child;
mod listing;
mod request;

use std::fmt;
use std::io::{self, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use ob1_cpu::Cpu;
use ob1_cpu::engine::{Engine, Plan};
use ob1_host::driver::kept_environment;
use ob1_native::{Native, Order, fingerprint, is_large, memory_file};
use ob1_rt::SideThread;
use ob1_socket::handover;
use rtrb::{Consumer, Producer, RingBuffer};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;

use crate::engine::InUse;
use crate::kept_process::own_program;

pub use child::run as compile_blocks;
pub use listing::listing;
use request::FILES;
pub use request::Request;

/// The command of this executable that runs as the process.
const COMMAND: &str = "compile-blocks";
/// Pauses before a process that ended too soon is started again: it is the first that the kernel kills when memory
/// runs out.
const AGAIN: [Duration; 4] =
    [Duration::from_secs(1), Duration::from_secs(10), Duration::from_secs(60), Duration::from_secs(600)];
/// A process that has made nothing for so long is told of, once.
const SILENT: Duration = Duration::from_secs(300);
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
    /// Lets the newest engine take over, if one has come; returns its name. Between two cycles only. It allocates and
    /// frees nothing, takes no lock and makes no system call.
    pub fn take_over(&mut self, cpu: &mut Cpu) -> Option<&'static str> {
        let mut name = None;
        while let Ok(engine) = self.come.pop() {
            ob1_native::synchronise();
            let old = match cpu.exchange_engine(engine) {
                Ok(old) => {
                    name = Some(cpu.engine());
                    old
                }
                // Made for another plan; this was checked before.
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
    _thread: SideThread<OwnedFd>,
}

impl Compiling {
    /// Starts the thread. The process is this executable.
    ///
    /// # Errors
    /// What the system says when it has no thread or descriptor left.
    pub fn start(request: Request, plan: &Arc<Plan>, in_use: &Arc<InUse>) -> io::Result<(Self, Successors)> {
        let (sender, successors) = EngineSender::pair();
        Ok((Self::giving(request, plan, sender, in_use)?, successors))
    }

    /// The same for a scan that has the other end of `sender` already.
    ///
    /// # Errors
    /// The system refuses a socket or a thread, as with [`Compiling::start`].
    pub fn giving(request: Request, plan: &Arc<Plan>, sender: EngineSender, in_use: &Arc<InUse>) -> io::Result<Self> {
        let (plan, in_use) = (Arc::clone(plan), Arc::clone(in_use));
        let work = move |stopped| {
            let mut work = Work { plan, sender, sent: 0, stopped, optimised: None, refused: Vec::new() };
            in_use.lack(None);
            let mut again = AGAIN.into_iter();
            loop {
                match work.run(&request) {
                    Ok(Outcome::Stopped) => return,
                    Ok(Outcome::Done) => {
                        in_use.lack((!work.refused.is_empty()).then(|| work.refused.join("; ")));
                        return work.take_back_all();
                    }
                    Err(Failed::Ended(why)) if let Some(pause) = again.next() => {
                        tracing::warn!("machine code: {why}; it is tried again in {} s", pause.as_secs());
                        in_use.lack(Some(why));
                        if work.pause(pause) {
                            return;
                        }
                    }
                    Err(Failed::Ended(why) | Failed::For(why)) => {
                        tracing::warn!("machine code: {why}; the station continues without it");
                        in_use.lack(Some(why));
                        return work.take_back_all();
                    }
                }
            }
        };
        Ok(Self { _thread: SideThread::polling("ob1-compiling", work)? })
    }
}

/// The other end: gives engines to the scan and takes back those that ran before.
pub struct EngineSender {
    to_scan: Producer<Box<dyn Engine>>,
    from_scan: Consumer<Box<dyn Engine>>,
}

impl fmt::Debug for EngineSender {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EngineSender").field("room", &self.to_scan.slots()).finish_non_exhaustive()
    }
}

impl EngineSender {
    /// Both ends, with room for all engines that come for a program.
    #[must_use]
    pub fn pair() -> (Self, Successors) {
        let (to_scan, come) = RingBuffer::new(FILES);
        let (gone, from_scan) = RingBuffer::new(FILES);
        (Self { to_scan, from_scan }, Successors { come, gone })
    }

    /// Hands an engine to the scan, which finds it after its current cycle.
    ///
    /// # Errors
    /// There is no room; the engine is returned.
    pub fn give(&mut self, engine: Box<dyn Engine>) -> Result<(), Box<dyn Engine>> {
        self.to_scan.push(engine).map_err(|rtrb::PushError::Full(engine)| engine)
    }

    /// An engine that ran before.
    pub fn take_back(&mut self) -> Option<Box<dyn Engine>> {
        self.from_scan.pop().ok()
    }
}

/// How the work has ended.
enum Outcome {
    /// The last file has come.
    Done,
    /// The station ends; nothing more is wanted.
    Stopped,
}

/// Why there is no machine code.
#[derive(Debug)]
enum Failed {
    /// The process has ended too soon.
    Ended(String),
    /// For good, for this reason: a new attempt would not help.
    For(String),
}

impl From<String> for Failed {
    fn from(why: String) -> Self {
        Self::For(why)
    }
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
        let (socket, stdin) = handover::pair()?;
        send(&socket, &order.bytes(), request)?;
        let child = Command::new(own_program()?)
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

    /// Why it has ended.
    fn death(&mut self) -> String {
        // One that has ended keeps its exit status; one that has only closed its socket is not waited for.
        let _ = self.child.kill();
        match self.child.wait() {
            Ok(status) => status.signal().map_or_else(
                || format!("it has ended with exit code {}", status.code().unwrap_or(-1)),
                |signal| format!("it was ended by signal {signal}"),
            ),
            Err(error) => error.to_string(),
        }
    }
}

/// Sends a message with a file of these bytes.
fn send(socket: &OwnedFd, message: &[u8], bytes: &[u8]) -> io::Result<()> {
    let mut file = memory_file()?;
    file.write_all(bytes)?;
    io::Seek::rewind(&mut file)?;
    handover::send(socket, message, &[file.as_fd()])
}

/// What the thread needs for its work.
struct Work {
    plan: Arc<Plan>,
    sender: EngineSender,
    /// Engines that were given to the scan.
    sent: usize,
    stopped: OwnedFd,
    /// Optimised blocks of the engine that was given last.
    optimised: Option<usize>,
    /// Blocks without code in the newest engine, each with the reason.
    refused: Vec<String>,
}

impl Work {
    fn run(&mut self, request: &Request) -> Result<Outcome, Failed> {
        let secret = secret().map_err(|error| format!("no secret for the code: {error}"))?;
        let order = Order { fingerprint: fingerprint(&self.plan), secret };
        let request = request.write()?;
        let failed = |error| Failed::Ended(format!("the process that compiles cannot be started: {error}"));
        let mut process = Process::start(&request, &order).map_err(failed)?;
        drop(request);
        self.take(&mut process, &order)
    }

    /// Takes the files of code that come, and hands each as an engine to the scan.
    fn take(&mut self, process: &mut Process, order: &Order) -> Result<Outcome, Failed> {
        for count in 1..=FILES {
            let Some(file) = self.next(process)? else { return Ok(Outcome::Stopped) };
            let engine = Native::of_file(&self.plan, order, file.as_fd());
            let engine = engine.map_err(|why| format!("a file of code is refused: {why}"))?;
            tracing::info!("machine code: {}", engine.told());
            self.refused = engine.refused().to_vec();
            for refused in &self.refused {
                tracing::warn!("machine code of {refused}; the reference engine runs this block");
            }
            let is_last = engine.is_optimised();
            // A process that was started again begins anew.
            if self.optimised.is_none_or(|before| before < engine.optimised()) {
                self.optimised = Some(engine.optimised());
                // There is room for all that come.
                let _ = self.sender.give(Box::new(engine));
                self.sent += 1;
            }
            if is_last {
                return Ok(Outcome::Done);
            }
            if count == 1 && is_large(&self.plan) {
                // The process waits for the account. What the scan has executed so far predicts what it will execute.
                let account = request::account(&self.plan.executed.read());
                send(&process.socket, &[0], &account).map_err(|error| {
                    Failed::Ended(format!("the process that compiles is not reached: {error}; {}", process.death()))
                })?;
            }
        }
        Err(Failed::For("files of code have come, but none with all blocks optimised".into()))
    }

    /// The next file of code; `None`: the station ends.
    fn next(&self, process: &mut Process) -> Result<Option<OwnedFd>, Failed> {
        let gone =
            |process: &mut Process| Failed::Ended(format!("the process that compiles is gone: {}", process.death()));
        let mut silent = Timespec::try_from(SILENT).ok();
        loop {
            match handover::receive(&process.socket, &mut [0; 1]) {
                Ok(Some((0, _))) => return Err(gone(process)),
                Ok(Some((_, files))) => {
                    let file = files.into_iter().next().map(Some);
                    return file.ok_or_else(|| Failed::For("a message without code has come".into()));
                }
                Ok(None) => {}
                // It has not even read the request.
                Err(error) if error.kind() == io::ErrorKind::ConnectionReset => return Err(gone(process)),
                Err(error) => return Err(Failed::For(format!("the process that compiles cannot be heard: {error}"))),
            }
            let mut fds = [PollFd::new(&self.stopped, PollFlags::IN), PollFd::new(&process.socket, PollFlags::IN)];
            if poll(&mut fds, silent.as_ref()) == Ok(0) {
                let (pid, minutes) = (process.child.id(), SILENT.as_secs() / 60);
                tracing::warn!("machine code: process {pid}, which compiles, has made nothing for {minutes} min");
                silent = None;
            }
            if !fds[0].revents().is_empty() {
                return Ok(None);
            }
        }
    }

    /// Waits; true when the station ends meanwhile. Frees the engines that the scan gives back.
    fn pause(&mut self, time: Duration) -> bool {
        let end = std::time::Instant::now() + time;
        loop {
            while self.sender.take_back().is_some() {
                self.sent -= 1;
            }
            let left = end.saturating_duration_since(std::time::Instant::now());
            if left.is_zero() {
                return false;
            }
            let mut fds = [PollFd::new(&self.stopped, PollFlags::IN)];
            let _ = poll(&mut fds, Timespec::try_from(left).ok().as_ref());
            if !fds[0].revents().is_empty() {
                return true;
            }
        }
    }

    /// Waits for the engines that the scan gives back, and frees their memory.
    fn take_back_all(&mut self) {
        loop {
            while self.sender.take_back().is_some() {
                self.sent -= 1;
            }
            if self.sent == 0 {
                return;
            }
            let mut fds = [PollFd::new(&self.stopped, PollFlags::IN)];
            let _ = poll(&mut fds, Timespec::try_from(LOOK).ok().as_ref());
            if !fds[0].revents().is_empty() || self.sender.from_scan.is_abandoned() {
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

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_cpu::{Command as Wish, CpuConfig, Still};
    use ob1_ir::Program;
    use ob1_native::{Compiler, Target, Tier};

    fn cpu() -> Cpu {
        let text = "ORGANIZATION_BLOCK OB 1\nBEGIN\nL MW 2;\n+ 1;\nT MW 2;\nEND_ORGANIZATION_BLOCK\n";
        let source = ob1_stl::Source { name: "p.awl".into(), bytes: text.as_bytes().to_vec() };
        let program: Program =
            ob1_stl::compile(&[source], &ob1_stl::Library::new(), &ob1_stl::Options::default()).program;
        let auto = crate::engine::factory(ob1_station_file::EngineChoice::Auto);
        let mut cpu = Cpu::new(CpuConfig::default(), &program, Vec::new(), Vec::new(), auto).expect("it loads");
        cpu.request(Wish::Run);
        cpu
    }

    fn file(cpu: &Cpu, order: &Order, tier: Tier) -> OwnedFd {
        let image = Compiler::new(Target::Host, tier).expect("this processor").image(cpu.plan());
        ob1_native::seal(memory_file().expect("memory"), &image.file(order)).expect("memory")
    }

    #[test]
    fn each_tier_takes_over_and_gives_back_what_ran_before() {
        let mut cpu = cpu();
        let (mut sender, mut successors) = EngineSender::pair();
        let order = Order { fingerprint: fingerprint(cpu.plan()), secret: [5; 16] };
        let mut scans = 0;
        let mut run = |cpu: &mut Cpu| {
            cpu.cycle(&mut Still);
            scans += 1;
            assert_eq!(cpu.bit_memory()[2..4], u16::to_be_bytes(scans));
        };
        run(&mut cpu);
        assert_eq!(successors.take_over(&mut cpu), None);
        for (tier, name, before) in [
            (Tier::Fast, ob1_native::NAME_FAST, "reference"),
            (Tier::Optimised, ob1_native::NAME, ob1_native::NAME_FAST),
        ] {
            let file = file(&cpu, &order, tier);
            let engine = Native::of_file(cpu.plan(), &order, file.as_fd()).expect("a good file");
            assert!(sender.give(Box::new(engine)).is_ok());
            assert_eq!(successors.take_over(&mut cpu), Some(name));
            assert_eq!(sender.take_back().map(|engine| engine.name()), Some(before));
            run(&mut cpu);
        }
    }

    /// Hands over files as a process would: how many engines the scan has then, and the end.
    fn taken(cpu: &Cpu, order: &Order, files: &[OwnedFd]) -> (usize, String) {
        let (sender, successors) = EngineSender::pair();
        let (stopped, _stop) = io::pipe().expect("a pipe");
        let (socket, theirs) = handover::pair().expect("a socket");
        for file in files {
            handover::send(&theirs, &[0], &[file.as_fd()]).expect("it is sent");
        }
        drop(theirs);
        let child = Command::new("/bin/true").spawn().expect("a process");
        let (plan, stopped) = (Arc::clone(cpu.plan()), stopped.into());
        let mut work = Work { plan, sender, sent: 0, stopped, optimised: None, refused: Vec::new() };
        let ended = match work.take(&mut Process { child, socket }, order) {
            Ok(Outcome::Done) => "done".to_owned(),
            Ok(Outcome::Stopped) => "stopped".to_owned(),
            Err(Failed::Ended(why) | Failed::For(why)) => why,
        };
        (successors.come.slots(), ended)
    }

    #[test]
    fn a_process_that_sends_too_much_or_something_else_changes_nothing_more() {
        let cpu = cpu();
        let order = Order { fingerprint: fingerprint(cpu.plan()), secret: [5; 16] };
        let fast = || file(&cpu, &order, Tier::Fast);
        let other = file(&cpu, &Order { secret: [6; 16], ..order }, Tier::Optimised);
        assert_eq!(taken(&cpu, &order, &[fast(), file(&cpu, &order, Tier::Optimised), fast()]), (2, "done".into()));
        let (engines, why) = taken(&cpu, &order, &[fast(), fast(), fast(), fast()]);
        assert!(engines == 1 && why.contains("none with all blocks optimised"), "{engines}: {why}");
        let (engines, why) = taken(&cpu, &order, &[fast(), other, fast()]);
        assert!(engines == 1 && why.contains("a file of code is refused"), "{engines}: {why}");
        let (engines, why) = taken(&cpu, &order, &[fast()]);
        assert!(engines == 1 && why.contains("the process that compiles is gone"), "{engines}: {why}");
    }

    #[test]
    fn an_engine_of_another_program_does_not_take_over() {
        let (mut one, other) = (cpu(), cpu());
        let (mut sender, mut successors) = EngineSender::pair();
        let plain = ob1_cpu::engine::PLAIN.engine(other.plan()).expect("it runs everything");
        assert!(sender.give(plain).is_ok());
        assert_eq!((successors.take_over(&mut one), one.engine()), (None, "reference"));
        assert_eq!(sender.take_back().map(|engine| engine.name()), Some("plain"));
    }

    #[test]
    fn a_file_that_can_be_changed_or_is_not_ours_is_refused() {
        let cpu = cpu();
        let order = Order { fingerprint: fingerprint(cpu.plan()), secret: [5; 16] };
        let image = Compiler::new(Target::Host, Tier::Fast).expect("this processor").image(cpu.plan());
        let why = |file: &OwnedFd, order: &Order| Native::of_file(cpu.plan(), order, file.as_fd()).map(|_| ()).err();
        // Good, but not sealed: whoever wrote it could change it while it runs.
        let mut open = memory_file().expect("memory");
        open.write_all(&image.file(&order)).expect("memory");
        assert!(why(&open.into(), &order).is_some_and(|why| why.contains("not sealed")));
        let good = file(&cpu, &order, Tier::Fast);
        assert_eq!(why(&good, &order), None);
        assert!(why(&good, &Order { secret: [6; 16], ..order }).is_some_and(|why| why.contains("digest")));
        let mut bytes = image.file(&order);
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        let damaged = ob1_native::seal(memory_file().expect("memory"), &bytes).expect("memory");
        assert!(why(&damaged, &order).is_some_and(|why| why.contains("digest")));
    }
}
