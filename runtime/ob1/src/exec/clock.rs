//! The clock of `ob1 exec`: virtual or real, with the limits of both.

use std::fmt;
use std::time::{self, Duration};

use ob1_cpu::{Attention, Clock};
use ob1_rt::MonotonicClock;
use ob1_time::{Instant, Span};

use super::args::ExecArgs;
use crate::virtual_clock::VirtualClock;

/// Where time is virtual, a run also ends after so much real time.
pub(super) const WALL_LIMIT: Duration = Duration::from_secs(120);
/// Looks of the CPU at its clock (every 1000 statements, and at the end of a cycle) between two readings of real time.
const LOOKS: u32 = 64;

#[derive(Debug)]
enum Time {
    Virtual(VirtualClock),
    Real(MonotonicClock),
}

/// The real time a run has taken. A value of its own so that a test can say when the limit is over.
pub(super) struct WallTime(Box<dyn FnMut() -> Duration + Send>);

impl WallTime {
    pub(super) fn start() -> Self {
        let start = time::Instant::now();
        Self(Box::new(move || start.elapsed()))
    }

    fn is_over(&mut self) -> bool {
        (self.0)() >= WALL_LIMIT
    }
}

impl fmt::Debug for WallTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("WallTime")
    }
}

/// A clock that ends the run. The limit is checked between two cycles; a cycle that does not end is halted when it
/// exceeds the limit by the cycle monitoring time, or when real time is up.
#[derive(Debug)]
pub(super) struct ExecClock {
    time: Time,
    limit: Instant,
    halt_at: Instant,
    wall: Option<WallTime>,
    looks: u32,
    wall_over: bool,
    halted: bool,
    attention: Attention,
}

impl ExecClock {
    /// `wall` limits the run where time is virtual.
    pub(super) fn new(args: &ExecArgs, attention: Attention, wall: WallTime) -> Self {
        let limit = Instant::START + args.limit;
        let time = if args.real_time {
            Time::Real(MonotonicClock::start())
        } else {
            Time::Virtual(VirtualClock::new(Span::from_nanos(args.ns_per_statement)))
        };
        let wall = (!args.real_time).then_some(wall);
        let halt_at = limit.saturating_add(args.watchdog);
        Self { time, limit, halt_at, wall, looks: 0, wall_over: false, halted: false, attention }
    }

    /// The next cycle is due then; time is let pass, or waited for.
    pub(super) fn wait_until(&mut self, deadline: Instant) {
        match &mut self.time {
            Time::Virtual(clock) => clock.advance_to(deadline),
            Time::Real(clock) => clock.sleep_until(deadline.min(self.limit)),
        }
    }

    /// A limit is reached.
    pub(super) fn is_over(&mut self) -> bool {
        self.wall_over || self.now() >= self.limit
    }

    /// Real time was up first.
    pub(super) fn wall_is_over(&self) -> bool {
        self.wall_over
    }

    /// A cycle was halted.
    pub(super) fn has_halted(&self) -> bool {
        self.halted
    }

    fn look_at_limits(&mut self) {
        self.looks += 1;
        if self.looks >= LOOKS {
            self.looks = 0;
            self.wall_over = self.wall_over || self.wall.as_mut().is_some_and(WallTime::is_over);
        }
        if !self.halted && (self.wall_over || self.now() >= self.halt_at) {
            self.halted = true;
            self.attention.halt();
        }
    }
}

impl Clock for ExecClock {
    fn now(&mut self) -> Instant {
        match &mut self.time {
            Time::Virtual(clock) => clock.now(),
            Time::Real(clock) => clock.now(),
        }
    }

    fn executed(&mut self, statements: u64) {
        if let Time::Virtual(clock) = &mut self.time {
            clock.executed(statements);
        }
        self.look_at_limits();
    }

    fn statements_in(&self, time: Span) -> Option<u64> {
        match &self.time {
            Time::Virtual(clock) => clock.statements_in(time),
            Time::Real(_) => None,
        }
    }

    fn wait(&mut self, deadline: Instant) {
        if let Time::Virtual(clock) = &mut self.time {
            clock.wait(deadline);
        }
        self.look_at_limits();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::super::{Engines, compile, load, run};
    use super::*;
    use crate::exit::ExecExit;

    /// Runs OB 1 with a real time that takes a second between two looks: the exit, whether real time was up, and the
    /// seconds taken.
    fn exec(code: &str, words: &[&str]) -> (ExecExit, bool, u64) {
        let folder = tempfile::tempdir().expect("a directory");
        let path = folder.path().join("p.awl");
        let text = format!("ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n{code}\nEND_ORGANIZATION_BLOCK\n");
        std::fs::write(&path, text).expect("writable");
        let args = ExecArgs::of_words([&[path.to_str().expect("UTF-8")], words].concat());
        let program = compile(&args, &[]).expect("it compiles");
        let (mut cpu, _) = load(&args, &[], &program.0).expect("it loads");
        let seconds = Arc::new(AtomicU64::new(0));
        let count = seconds.clone();
        let wall = WallTime(Box::new(move || Duration::from_secs(count.fetch_add(1, Ordering::Relaxed) + 1)));
        let mut clock = ExecClock::new(&args, cpu.attention(), wall);
        let mut engines = Engines::new(&args, &cpu, None);
        let exit = run(&mut cpu, &mut clock, args.start, &mut engines);
        (exit, clock.wall_is_over(), seconds.load(Ordering::Relaxed))
    }

    #[test]
    fn real_time_ends_a_virtual_run() {
        // Between cycles, and within one that does not end.
        assert_eq!(exec("NOP 0;", &["--limit", "24h"]), (ExecExit::Limit, true, 120));
        assert_eq!(exec("m: SPA m;", &["--limit", "24h", "--watchdog", "0ms"]), (ExecExit::Limit, true, 120));
        // The limit of virtual time comes first.
        let (exit, wall, seconds) = exec("NOP 0;", &["--limit", "1s"]);
        assert_eq!((exit, wall), (ExecExit::Limit, false));
        assert!(seconds > 1 && seconds < 120, "{seconds}");
        // Where time is real, the limit given is the only one.
        assert_eq!(exec("NOP 0;", &["--limit", "2ms", "--real-time"]), (ExecExit::Limit, false, 0));
    }
}
