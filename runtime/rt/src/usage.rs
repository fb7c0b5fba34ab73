//! What the kernel knows about this process and its threads, for reports, and about a driver's, for its supervisor.

use std::fs::{self, File};

use ob1_time::Span;

/// Time of a tick in `/proc/PID/stat` (USER_HZ is 100 on every Linux).
const TICK: Span = Span::from_millis(10);

/// Memory of the process, in KiB, from `/proc/self/status`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// Memory that is resident (`VmRSS`).
    pub resident_kib: u64,
    /// Highest resident so far (`VmHWM`).
    pub peak_kib: u64,
    /// Memory that is locked (`VmLck`).
    pub locked_kib: u64,
    /// Number of threads of the process.
    pub threads: u64,
}

/// Reads the memory figures; zeros where `/proc` is not there.
#[must_use]
pub fn memory() -> Memory {
    fs::read_to_string("/proc/self/status").map(|text| parse_status(&text)).unwrap_or_default()
}

fn parse_status(text: &str) -> Memory {
    let figure = |key: &str| {
        text.lines()
            .find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))
            .and_then(|rest| rest.split_whitespace().next()?.parse().ok())
            .unwrap_or(0)
    };
    Memory {
        resident_kib: figure("VmRSS"),
        peak_kib: figure("VmHWM"),
        locked_kib: figure("VmLck"),
        threads: figure("Threads"),
    }
}

/// What a process is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProcessState {
    /// `R` runs or waits for a core, `S` sleeps, `D` is held by the kernel, `T` is stopped; and others, as in proc(5).
    pub state: char,
    /// Time it has had on a core, in steps of 10 ms.
    pub ran: Span,
}

/// Looks at a process; `None` where it or `/proc` is not there.
#[must_use]
pub fn process_state(pid: u32) -> Option<ProcessState> {
    parse_stat(&fs::read_to_string(format!("/proc/{pid}/stat")).ok()?)
}

/// Fields 3, 14 and 15; the name in field 2 may hold blanks and brackets.
fn parse_stat(stat: &str) -> Option<ProcessState> {
    let (_, rest) = stat.rsplit_once(')')?;
    let mut fields = rest.split_whitespace();
    let state = fields.next()?.chars().next()?;
    let user: u64 = fields.nth(10)?.parse().ok()?;
    let system: u64 = fields.next()?.parse().ok()?;
    Some(ProcessState { state, ran: TICK.times(user.saturating_add(system)) })
}

/// The kernel's number of the calling thread.
#[must_use]
pub fn thread_id() -> u32 {
    rustix::thread::gettid().as_raw_nonzero().get().unsigned_abs()
}

/// What the scheduler has counted for a thread since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ThreadTimes {
    /// On a core. For a running thread this is up to a tick of the kernel old.
    pub ran: Span,
    /// Ready to run, and waiting for a core. Entered when it gets one.
    pub waited: Span,
}

impl ThreadTimes {
    /// From the text of a `schedstat`: time on a core and on a run queue, in nanoseconds, and how often it ran.
    #[must_use]
    pub fn parse(schedstat: &[u8]) -> Option<Self> {
        let text = std::str::from_utf8(schedstat).ok()?;
        let mut figures = text.split_ascii_whitespace().map(str::parse);
        let (ran, waited) = (figures.next()?.ok()?, figures.next()?.ok()?);
        Some(Self { ran: Span::from_nanos(ran), waited: Span::from_nanos(waited) })
    }
}

/// A thread's own look at its [`ThreadTimes`]: one system call, nothing allocated.
#[derive(Debug, Default)]
pub struct ThreadLook(Option<File>);

impl ThreadLook {
    /// For the calling thread. Without `schedstat` in `/proc` it sees nothing.
    #[must_use]
    pub fn open() -> Self {
        let look = Self(File::open("/proc/thread-self/schedstat").ok());
        // The first look makes the kernel find the memory it writes the text in.
        let _ = look.times();
        look
    }

    /// The times up to now.
    #[must_use]
    pub fn times(&self) -> Option<ThreadTimes> {
        let mut text = [0; 64];
        let read = rustix::io::pread(self.0.as_ref()?, &mut text, 0).ok()?;
        ThreadTimes::parse(text.get(..read)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_lines_are_found_by_their_whole_name() {
        let text = "Name:\tob1\nVmHWM:\t   5000 kB\nVmLck:\t     12 kB\nVmRSS:\t   4321 kB\nThreads:\t4\n";
        let expected = Memory { resident_kib: 4321, peak_kib: 5000, locked_kib: 12, threads: 4 };
        assert_eq!(parse_status(text), expected);
        assert_eq!(parse_status("VmRSS without a number"), Memory::default());
    }

    #[test]
    fn state_and_time_of_a_process() {
        let stat = "5035 (ob1) cp) D 1 5035 1 0 -1 4194304 120 0 3 0 7 12 0 0 20 0 1 0 99 1 2 3";
        assert_eq!(parse_stat(stat), Some(ProcessState { state: 'D', ran: 19 * TICK }));
        assert_eq!((parse_stat(""), parse_stat("1 (x) S 1 2")), (None, None));
        assert_eq!(process_state(std::process::id()).map(|process| process.state == 'Z'), Some(false));
        assert_eq!(process_state(u32::MAX), None);
    }

    #[test]
    fn times_of_a_thread() {
        let (ran, waited) = (Span::from_nanos(166_022), Span::from_nanos(6820));
        assert_eq!(ThreadTimes::parse(b"166022 6820 2\n"), Some(ThreadTimes { ran, waited }));
        assert_eq!(
            (ThreadTimes::parse(b""), ThreadTimes::parse(b"5"), ThreadTimes::parse(b"\xff 1 2")),
            (None, None, None)
        );
        assert_eq!(ThreadLook::default().times(), None);
        // A look is the calling thread's own, and it continues.
        let look = ThreadLook::open();
        let before = look.times().expect("a kernel with schedstat");
        while look.times().expect("the same file").ran < before.ran + Span::MILLISECOND {
            std::hint::spin_loop();
        }
        let other = std::thread::spawn(ThreadLook::open).join().expect("a thread");
        assert!(
            other.times().is_none_or(|other| other.ran < before.ran + Span::MILLISECOND),
            "of the thread that opened it"
        );
    }

    #[test]
    fn this_process_has_memory() {
        assert!(memory().resident_kib > 0);
    }
}
