//! The driver under test in its place: a segment whose CPU side is the kit, a doorbell, a process, a line.

use std::fmt::Display;
use std::io;
use std::os::fd::{AsFd as _, BorrowedFd, OwnedFd};
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};

use ob1_backplane::{CpuSide, CpuState, Event, EventKind, Fault, Segment};
use ob1_host::driver::{Doorbell, DriverCommand, Process};
use ob1_host::supervisor::{Exit, Times};
use ob1_params::CpKind;
use ob1_rt::{MonotonicClock, process_state};
use ob1_time::{Instant, Span, WatchedTime};
use rustix::fs::{FlockOperation, fcntl_lock};
use rustix::io::{Errno, ioctl_fionread};
use rustix::process::{Pid, Signal, kill_process, kill_process_group, test_kill_process_group};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use super::line::Line;
use super::rules::Rule;
use super::watch::{Watch, offset, set, word};

/// How long a driver may take for what it does at once; a busy machine needs more than a driver.
pub(super) const SOON: Span = Span::from_secs(5);
/// How long it may take to end.
const END: Span = Span::from_secs(2);
/// How long the kit watches that something does not happen.
pub(super) const WHILE: Span = Span::from_millis(60);
/// Turns of a loop in which the kit waits for what a driver does at once.
const TURNS: u32 = 20_000;
/// A gap between two looks that counts for a driver's patience: the machine has stood still.
const GAP: Span = Span::from_millis(500);
/// A driver that waits for a core gets its time this often again.
const STARVED: u64 = 6;

/// The parameters of a CP 240 in the kit: ASCII, 115200 8N1, ZVZ 20 ms, five receive buffers.
const ASCII: [u8; 16] = [0x0E, 0x01, 0x13, 0, 0, 1, 5, 0, 0, 0, 0, 0, 0, 0, 0, 0];

/// Why a test has ended early.
#[derive(Debug)]
pub(super) enum Breach {
    /// The driver has broken a rule; what was found.
    Rule(Rule, String),
    /// The system refused what the kit needs.
    System(String),
    /// Enough was found elsewhere.
    Enough,
}

/// The outcome of a check.
pub(super) type Checked<T = ()> = Result<T, Breach>;

impl Breach {
    pub(super) fn of<T>(rule: Rule, found: impl Display) -> Checked<T> {
        Err(Self::Rule(rule, found.to_string()))
    }

    fn system(error: impl Display) -> Self {
        Self::System(error.to_string())
    }
}

impl From<io::Error> for Breach {
    fn from(error: io::Error) -> Self {
        Self::system(error)
    }
}

/// A test bench for one seed.
pub(super) struct Rig<'a> {
    command: &'a DriverCommand,
    enough: &'a AtomicBool,
    pub(super) kind: CpKind,
    pub(super) segment: Segment,
    cpu: CpuSide,
    bell: Option<Doorbell>,
    ear: OwnedFd,
    driver: Option<Process>,
    is_attached: bool,
    is_stopped: bool,
    pub(super) line: Line,
    clock: MonotonicClock,
    watched: WatchedTime,
    pub(super) watch: Watch,
    beat: (u64, Instant),
    pub(super) rng: fastrand::Rng,
    /// Each step is printed.
    pub(super) tells: bool,
    /// What happens, for the report.
    pub(super) step: String,
    pub(super) steps: u64,
    /// Number of the last start-up of this process.
    pub(super) number: u16,
    pub(super) outputs: [u8; 16],
    /// Counters as they must be: orders, telegrams, bytes out, bytes in.
    pub(super) account: [u64; 4],
}

impl<'a> Rig<'a> {
    pub(super) fn new(command: &'a DriverCommand, kind: CpKind, seed: u64, enough: &'a AtomicBool) -> Checked<Self> {
        let segment = Segment::create_shared().map_err(Breach::system)?;
        let cpu = CpuSide::create(&segment, 16).map_err(Breach::system)?;
        let (bell, ear) = Doorbell::new()?;
        Ok(Self {
            command,
            enough,
            kind,
            watch: Watch::new(&segment),
            segment,
            cpu,
            bell: Some(bell),
            ear,
            driver: None,
            is_attached: false,
            is_stopped: false,
            line: Line::new()?,
            clock: MonotonicClock::start(),
            watched: WatchedTime::new(Instant::START, GAP),
            beat: (0, Instant::START),
            rng: fastrand::Rng::with_seed(seed),
            tells: false,
            step: String::new(),
            steps: 0,
            number: 0,
            outputs: [0; 16],
            account: [0; 4],
        })
    }

    /// Begins a step; it is named when a rule is broken.
    pub(super) fn step(&mut self, what: impl Display) {
        self.step = what.to_string();
        if self.tells {
            say!("{:10.3} ms  {}", self.now().since_start().as_millis_f64(), self.step);
        }
        self.steps += 1;
    }

    /// Time without that in which the machine stood still.
    pub(super) fn now(&mut self) -> Instant {
        self.watched.look(self.clock.time())
    }

    /// Lets time pass.
    pub(super) fn sleep(&mut self, span: Span) {
        self.clock.sleep_until(self.clock.time() + span);
    }

    /// The next start-up may show the number of the last one that was seen: there were others between.
    pub(super) fn number_may_repeat(&mut self) {
        self.number = 0;
    }

    /// One look at everything that holds at every moment.
    pub(super) fn look(&mut self) -> Checked {
        if self.enough.load(Ordering::Relaxed) {
            return Err(Breach::Enough);
        }
        self.line.take();
        let now = self.now();
        let Some(driver) = &mut self.driver else { return Ok(()) };
        if let Some(exit) = driver.ended() {
            self.driver = None;
            let rule = if self.is_attached { Rule::Lives } else { Rule::Attaches };
            return Breach::of(rule, format!("it has ended: {exit}"));
        }
        if self.is_attached && !self.is_stopped {
            let beat = self.cpu.monitor().cp_heartbeat();
            if beat != self.beat.0 {
                driver.has_beaten();
                self.beat = (beat, now);
            } else if now.since(self.beat.1) > Times::DEFAULT.hang {
                if !driver.is_starved() {
                    return Breach::of(Rule::Heartbeat, format!("cp.heartbeat has been {beat} for more than a second"));
                }
                self.beat.1 = now;
            }
        }
        self.watch.look(now, self.is_attached)
    }

    /// Looks until `found` finds something. A driver that has not made it so in time has broken the rule.
    pub(super) fn until<T>(
        &mut self,
        rule: Rule,
        patience: Span,
        what: impl Display,
        mut found: impl FnMut(&mut Self) -> Option<T>,
    ) -> Checked<T> {
        let begin = self.now();
        let (mut end, last) = (begin + patience, begin + STARVED * patience);
        loop {
            self.look()?;
            if let Some(found) = found(self) {
                return Ok(found);
            }
            let now = self.now();
            if now >= end {
                let is_starved = self.driver.as_mut().is_some_and(Process::is_starved);
                if !is_starved || now >= last {
                    return Breach::of(rule, format!("{what}; {}", self.picture()));
                }
                end = now + patience.over(4);
            }
            self.pause(now.since(begin));
        }
    }

    /// Looks for a while that something stays as it is.
    pub(super) fn hold(&mut self, rule: Rule, what: impl Display, mut holds: impl FnMut(&mut Self) -> bool) -> Checked {
        let begin = self.now();
        loop {
            self.look()?;
            if !holds(self) {
                return Breach::of(rule, format!("{what}; {}", self.picture()));
            }
            let passed = self.now().since(begin);
            if passed > WHILE {
                return Ok(());
            }
            self.pause(passed);
        }
    }

    /// Between two looks: the longer it takes, the less often. The driver may need the core.
    fn pause(&mut self, waited: Span) {
        if waited < Span::from_micros(300) {
            std::thread::yield_now();
        } else {
            self.sleep(waited.over(20).min(Span::from_millis(2)));
        }
    }

    /// The words that say most, for the report.
    fn picture(&mut self) -> String {
        let (rx, tx) = self.words();
        let out = &self.outputs;
        let state = word(&self.segment, "cp.state", 0);
        format!(
            "RX {rx:04X}h, TX echo {tx:04X}h, RX echo {:02X}{:02X}h, TX {:02X}{:02X}h, cp.state {}",
            out[0], out[1], out[2], out[3], state as u32
        )
    }

    // ---- the process ----

    /// Starts a process on another file than the segment, or a second one on the segment; returns how it ends.
    pub(super) fn start_beside(&mut self, file: BorrowedFd<'_>, rule: Rule) -> Checked<Exit> {
        let mut process = Process::start(self.command, file, &self.ear, None, Stdio::null())?;
        let group = Pid::from_raw(process.id().cast_signed());
        let end = self.now() + SOON;
        loop {
            if let Some(exit) = process.ended() {
                let _ = group.map(|group| kill_process_group(group, Signal::KILL));
                return Ok(exit);
            }
            let enough = self.enough.load(Ordering::Relaxed);
            if enough || self.now() > end && !process.is_starved() {
                process.kill();
                process.wait();
                return if enough { Err(Breach::Enough) } else { Breach::of(rule, "it has not ended after 5 s") };
            }
            self.sleep(Span::from_micros(500));
        }
    }

    /// The descriptor of the segment.
    pub(super) fn descriptor(&self) -> Checked<OwnedFd> {
        let descriptor = self.segment.descriptor().ok_or(io::Error::from(io::ErrorKind::Unsupported))?;
        Ok(descriptor.try_clone_to_owned()?)
    }

    /// Starts the driver and waits for it to attach; looks at `cleared` the moment it has.
    pub(super) fn start(&mut self, mut cleared: impl FnMut(&mut Self) -> Checked) -> Checked {
        let before = word(&self.segment, "cp.generation", 0);
        self.line.clear();
        let file = self.descriptor()?;
        self.driver = Some(Process::start(self.command, file.as_fd(), &self.ear, None, Stdio::null())?);
        self.number = 0;
        let begin = self.now();
        loop {
            let generation = word(&self.segment, "cp.generation", 0);
            if generation != before {
                cleared(self)?;
                if generation != before.wrapping_add(1).max(1) {
                    return Breach::of(Rule::Generation, format!("{before} became {generation}"));
                }
                break;
            }
            self.look()?;
            let now = self.now();
            let is_starved = self.driver.as_mut().is_some_and(Process::is_starved);
            if now.since(begin) > SOON && (!is_starved || now.since(begin) > STARVED * SOON) {
                return Breach::of(Rule::Attaches, "cp.generation has not changed");
            }
            std::thread::yield_now();
        }
        if self.is_unlocked() {
            return Breach::of(Rule::Lock, "another process gets the lock");
        }
        self.is_attached = true;
        self.watch.attached();
        self.beat = (self.cpu.monitor().cp_heartbeat(), self.now());
        Ok(())
    }

    /// Whether the lock is free; it is taken for a moment to see that.
    pub(super) fn is_unlocked(&self) -> bool {
        let Some(file) = self.segment.descriptor() else { return true };
        let free = fcntl_lock(file, FlockOperation::NonBlockingLockExclusive) != Err(Errno::AGAIN);
        if free {
            let _ = fcntl_lock(file, FlockOperation::Unlock);
        }
        free
    }

    fn pid(&self) -> Option<Pid> {
        Pid::from_raw(i32::try_from(self.driver.as_ref()?.id()).ok()?)
    }

    /// The entries of a folder of the process in `/proc`.
    pub(super) fn descriptors(&self) -> usize {
        let Some(pid) = self.pid() else { return 0 };
        std::fs::read_dir(format!("/proc/{}/fd", pid.as_raw_nonzero())).map_or(0, Iterator::count)
    }

    /// Whether the process sleeps in the kernel.
    pub(super) fn sleeps(&self) -> bool {
        self.driver.as_ref().and_then(|driver| process_state(driver.id())).is_some_and(|of| of.state == 'S')
    }

    pub(super) fn signal(&mut self, signal: Signal) {
        if let Some(pid) = self.pid() {
            let _ = kill_process(pid, signal);
        }
    }

    /// Stops the process for a while.
    pub(super) fn stop(&mut self, span: Span) {
        self.signal(Signal::STOP);
        self.is_stopped = true;
        self.sleep(span);
        self.signal(Signal::CONT);
        self.is_stopped = false;
        self.beat.1 = self.now();
    }

    /// Kills the driver, and does in the segment what the runtime does then.
    pub(super) fn kill(&mut self) -> Checked {
        self.watch.foreign()?;
        let pid = self.pid();
        if let Some(mut driver) = self.driver.take() {
            let _ = pid.map(|pid| kill_process_group(pid, Signal::KILL));
            driver.wait();
        }
        self.is_attached = false;
        self.cpu.monitor().driver_gone();
        self.watch.forget();
        Ok(())
    }

    /// Ends the driver in order.
    pub(super) fn end(&mut self, rule: Rule) -> Checked {
        self.watch.foreign()?;
        let Some(mut driver) = self.driver.take() else { return Ok(()) };
        let (pid, mut end) = (Pid::from_raw(driver.id().cast_signed()), self.now() + END);
        let last = self.now() + STARVED * END;
        if rule == Rule::Terminate {
            let _ = pid.map(|pid| kill_process(pid, Signal::TERM));
        } else {
            self.bell = None;
        }
        let exit = loop {
            if let Some(exit) = driver.ended() {
                break exit;
            }
            let now = self.now();
            if now >= end {
                if !driver.is_starved() || now >= last {
                    driver.kill();
                    driver.wait();
                    return Breach::of(rule, "it has not ended after 2 s");
                }
                end = now + END;
            }
            self.sleep(Span::from_micros(500));
        };
        if exit != Exit::Code(0) {
            return Breach::of(rule, exit);
        }
        let begin = self.now();
        while pid.is_some_and(|pid| test_kill_process_group(pid).is_ok()) {
            if self.now().since(begin) > Span::SECOND {
                let _ = pid.map(|pid| kill_process_group(pid, Signal::KILL));
                return Breach::of(Rule::Alone, format!("a process of the group {} is there", driver.id()));
            }
            self.sleep(Span::from_millis(1));
        }
        self.watch.foreign()
    }

    // ---- the CPU's side ----

    /// Writes as the CPU does.
    pub(super) fn cpu<T>(&mut self, act: impl FnOnce(&mut CpuSide) -> T) -> Checked<T> {
        self.watch.foreign()?;
        let done = act(&mut self.cpu);
        self.watch.accept();
        Ok(done)
    }

    /// Ends a scan: time, heartbeat, doorbell.
    pub(super) fn scan(&mut self) -> Checked {
        let now = self.clock.time().nanos();
        let rings = self.cpu(|cpu| {
            cpu.set_time(now);
            cpu.beat();
            cpu.take_doorbell()
        })?;
        if rings {
            self.ring();
        }
        Ok(())
    }

    /// Driver and kit on cores of their own, if there are two: what happens at the same time needs them.
    pub(super) fn apart<T>(&mut self, play: impl FnOnce(&mut Self) -> T) -> T {
        let mine = sched_getaffinity(None).unwrap_or_default();
        let mut cores: Vec<usize> = (0..CpuSet::MAX_CPU).filter(|core| mine.is_set(*core)).collect();
        self.rng.shuffle(&mut cores);
        let driver = self.pid();
        let settle = |all: [&CpuSet; 2]| {
            // A system that refuses makes the moments rarer.
            let _ = sched_setaffinity(None, all[0]);
            let _ = driver.map(|driver| sched_setaffinity(Some(driver), all[1]));
        };
        if let [first, second, ..] = cores[..] {
            let of = |core| {
                let mut set = CpuSet::new();
                set.set(core);
                set
            };
            settle([&of(first), &of(second)]);
        }
        let played = play(self);
        settle([&mine; 2]);
        played
    }

    /// Wakes a driver that sleeps, without news, and writes `TX` so many turns of a loop after it shows that it is
    /// awake; true: it had announced its sleep before. Nothing else is done between: moments are tens of nanoseconds.
    pub(super) fn put_drowsy(&mut self, delay: u32, tx: u16) -> Checked<bool> {
        self.look()?;
        self.outputs[2..4].copy_from_slice(&tx.to_be_bytes());
        let (outputs, segment) = (self.outputs, self.segment.clone());
        let Some(sleeping) = segment.word(offset("doorbell.sleeping")) else { return Ok(false) };
        let sleeps = |wanted: u64| (0..TURNS).any(|_| sleeping.load(Ordering::Relaxed) == wanted);
        sleeps(1);
        self.ring();
        sleeps(0);
        for turn in 0..delay {
            std::hint::black_box(turn);
        }
        let slept = self.cpu.post(&outputs);
        if slept {
            self.ring();
        }
        self.watch.accept();
        (0..TURNS).any(|_| self.words().1 == tx);
        Ok(slept)
    }

    /// A byte into the doorbell.
    pub(super) fn ring(&self) {
        if let Some(bell) = &self.bell {
            bell.ring();
        }
    }

    /// Bytes in the doorbell.
    pub(super) fn rung(&self) -> u64 {
        ioctl_fionread(&self.ear).unwrap_or(0)
    }

    /// Writes a word that no CPU would write, and tells the driver of a change.
    pub(super) fn spoil(&mut self, words: &[(&str, usize, u64)]) -> Checked {
        self.watch.foreign()?;
        for (name, index, to) in words {
            set(&self.segment, name, *index, *to);
        }
        self.watch.accept();
        self.cpu(|cpu| cpu.set_modem_outputs(ob1_backplane::ModemOutputs::default()))?;
        self.scan()
    }

    /// The JSON text of the parameters.
    fn json(&self, line: &str) -> Vec<u8> {
        let keys = match self.kind {
            CpKind::Cp341 | CpKind::Cp340 => r#","params":{"protocol":"ascii","baud":9600}"#,
            _ => "",
        };
        let kind = self.kind.name();
        format!(r#"{{"module":"{kind}","station":"kit","name":"test","line":"serial:{line}"{keys}}}"#).into_bytes()
    }

    /// Transfers parameters.
    pub(super) fn parameters(&mut self) -> Checked {
        let json = self.json(&self.line.path);
        let bytes = if self.kind == CpKind::Cp240 { ASCII } else { [0; 16] };
        self.transfer(&bytes, &json)
    }

    pub(super) fn transfer(&mut self, bytes: &[u8; 16], json: &[u8]) -> Checked {
        self.cpu(|cpu| cpu.write_params(bytes, json))?.map_err(Breach::system)?;
        self.scan()
    }

    pub(super) fn state(&mut self, state: CpuState) -> Checked {
        self.cpu(|cpu| cpu.set_cpu_state(state))?;
        self.scan()
    }

    /// What the runtime does in the segment for a driver that is started again.
    pub(super) fn restore(&mut self) -> Checked {
        self.cpu(|cpu| cpu.restore())?;
        self.parameters()
    }

    /// Takes all events; they must be whole, and no interrupts.
    pub(super) fn events(&mut self) -> Checked<Vec<Event>> {
        let mut events = Vec::new();
        loop {
            match self.cpu(|cpu| cpu.poll_event())? {
                Ok(None) => return Ok(events),
                Ok(Some(event)) if event.kind != EventKind::Message => {
                    return Breach::of(Rule::Interrupts, format!("{event:?}"));
                }
                Ok(Some(event)) => events.push(event),
                Err(fault @ Fault::EventRing { .. }) => return Breach::of(Rule::Ring, fault),
                Err(fault) => return Breach::of(Rule::Events, fault),
            }
        }
    }

    /// `RX` and `TX echo`.
    pub(super) fn words(&mut self) -> (u16, u16) {
        let inputs = self.inputs();
        (u16::from_be_bytes([inputs[0], inputs[1]]), u16::from_be_bytes([inputs[2], inputs[3]]))
    }

    pub(super) fn inputs(&mut self) -> [u8; 16] {
        let mut inputs = [0; 16];
        let _ = self.cpu.read_inputs(&mut inputs);
        inputs
    }

    /// Waits until the state is this one.
    pub(super) fn until_state(&mut self, rule: Rule, state: u64) -> Checked {
        self.until(rule, SOON, format!("state {state} does not come"), |rig| {
            (word(&rig.segment, "cp.state", 0) & 0xffff_ffff == state).then_some(())
        })
    }
}

impl Drop for Rig<'_> {
    fn drop(&mut self) {
        if let Some(driver) = &mut self.driver {
            let pid = Pid::from_raw(driver.id().cast_signed());
            let _ = pid.map(|pid| kill_process_group(pid, Signal::KILL));
            driver.wait();
        }
    }
}
