//! Why a scan was late: from its record and what the kernel says, a class, a size and the evidence. Pure.

use ob1_cpu::{Nanos, ScanRecord};
use serde::{Deserialize, Serialize};

/// Who made a scan late.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// The kernel gave the core to something else, or had to find memory: waiting for a core, a quota, page faults,
    /// steal.
    Kernel,
    /// The process was stopped by a signal and continued.
    Stopped,
    /// An organization block.
    Program,
    /// A block of a plugin.
    Plugin,
    /// The exchange with the modules: registers, events, doorbells.
    Driver,
    /// The scan before, which is accounted for by itself.
    Carried,
    /// The scan thread was asleep beyond its deadline, neither waiting for a core nor on one: the timer's interrupt
    /// came late. Its core was waking from a deep sleep, or the kernel or the host held interrupts back; no counter
    /// tells which.
    Timer,
    /// Nothing here explains it: the host of a virtual machine, firmware or hardware is suspected.
    Unexplained,
}

impl Class {
    /// All, in the order of reports.
    pub const ALL: [Self; 8] = [
        Self::Kernel,
        Self::Stopped,
        Self::Program,
        Self::Plugin,
        Self::Driver,
        Self::Carried,
        Self::Timer,
        Self::Unexplained,
    ];

    /// As printed.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Kernel => "kernel",
            Self::Stopped => "stopped by a signal",
            Self::Program => "program",
            Self::Plugin => "plugin",
            Self::Driver => "driver",
            Self::Carried => "carried over",
            Self::Timer => "timer late",
            Self::Unexplained => "unexplained (host suspected)",
        }
    }
}

/// What is known about the time around a scan. But for `measured`, it is of a window: up to two looks of the observer
/// wide, so these are upper bounds for the scan itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Evidence {
    /// The scan before was late too, and when it had been noted down this one was due: the thread had not slept.
    pub no_sleep: bool,
    /// Width of the window.
    pub window_ns: Nanos,
    /// What the scan's own look says, where the kernel has `schedstat`.
    pub measured: Option<Measured>,
    /// Time the host took from the cores this process may use, in ticks of 10 ms.
    pub steal_ns: Nanos,
    /// Time these cores were at interrupts, in ticks of 10 ms.
    pub interrupts_ns: Nanos,
    /// Time the quotas of control groups (`cpu.max`) held back threads of this process and its neighbours.
    pub throttled_ns: Nanos,
    /// Times the scan thread was taken off its core.
    pub switches: u64,
    /// Page faults that needed no disk.
    pub minor_faults: u64,
    /// Page faults that did.
    pub major_faults: u64,
    /// The process was continued by SIGCONT between the scan's deadline and its end.
    pub stopped: bool,
    /// How much later than planned the observer itself came to look.
    pub observer_late_ns: Nanos,
    /// What a statement of this program usually takes.
    pub ns_per_statement: Nanos,
}

/// The scan thread's times between the last look before the scan began and the scan's own look at its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Measured {
    /// From that look to the scan's end.
    pub window_ns: Nanos,
    /// Waiting for a core although ready to run.
    pub waited_ns: Nanos,
    /// On a core.
    pub ran_ns: Nanos,
    /// Other scans that lie in this time.
    pub others: u64,
    /// What those can have had of the waiting: of the time they have lost, beginning late and off their core, as much
    /// as is usual for scans on time.
    pub others_ns: Nanos,
}

impl Measured {
    /// So long at least this scan waited for a core.
    #[must_use]
    pub const fn waited_at_least(&self) -> Nanos {
        self.waited_ns.saturating_sub(self.others_ns)
    }
}

/// The answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cause {
    /// Who.
    pub class: Class,
    /// What exactly, in words.
    pub what: String,
    /// How much of the delay it is.
    pub size: Nanos,
}

/// A minor fault takes about so long.
const MINOR_FAULT: Nanos = 1_000;
/// A time on a core may be so old.
const KERNEL_TICK: Nanos = 10_000_000;
/// A program is believed to have taken a time when its statements usually take at least an eighth of it.
const PLAUSIBLE: u64 = 8;

/// The part of a scan that made it late.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Wake,
    Carried,
    Between,
    Program,
    Plugins,
    Exchange,
}

fn longest_part(record: &ScanRecord) -> (Part, Nanos) {
    let flags = record.flags;
    let began = |time: Nanos| if flags.began_late || !flags.took_long { time } else { 0 };
    let took = |time: Nanos| if flags.took_long || flags.overran || flags.watchdog { time } else { 0 };
    let wake = record.lateness().saturating_sub(record.carried.max(record.between));
    let parts = [
        (Part::Wake, began(wake)),
        (Part::Carried, began(record.carried)),
        (Part::Between, began(record.between)),
        (Part::Program, took(record.program.saturating_sub(record.plugins))),
        (Part::Plugins, took(record.plugins)),
        (Part::Exchange, took(record.inputs + record.outputs)),
    ];
    parts.into_iter().max_by_key(|(_, time)| *time).unwrap_or((Part::Wake, 0))
}

/// Says why a scan was late.
#[must_use]
pub fn explain(record: &ScanRecord, evidence: &Evidence) -> Cause {
    let (part, size) = longest_part(record);
    let system = kernel(evidence, record, size, part);
    let (class, what) = match part {
        // These are exact: no counter says it better.
        Part::Carried => (Class::Carried, format!("scan {} had not ended", record.scan.saturating_sub(1))),
        Part::Between => (Class::Program, format!("OB {} between two scans", record.between_ob)),
        _ => system.unwrap_or_else(|| own(part, record, evidence, size)),
    };
    Cause { class, what, size }
}

/// What the scan itself was at.
fn own(part: Part, record: &ScanRecord, evidence: &Evidence, size: Nanos) -> (Class, String) {
    match part {
        Part::Program if plausible(record, evidence, size) => (Class::Program, program(record)),
        Part::Program => {
            let usual = record.statements.saturating_mul(evidence.ns_per_statement) as f64 / 1000.0;
            let statements = record.statements;
            unexplained(evidence, &format!("OB {}: its {statements} statements take {usual:.1} µs", record.longest_ob))
        }
        Part::Plugins => {
            let block = record.longest_plugin.map_or_else(String::new, |block| block.to_string());
            let time = record.longest_plugin_time as f64 / 1000.0;
            (Class::Plugin, format!("{block}, one call of {time:.1} µs"))
        }
        Part::Exchange => {
            let (inputs, outputs) = (record.inputs as f64 / 1000.0, record.outputs as f64 / 1000.0);
            (Class::Driver, format!("inputs {inputs:.1} µs, outputs {outputs:.1} µs"))
        }
        _ => match evidence.measured {
            // What it waited at all is not half of it: it slept.
            Some(m) if m.waited_ns < size / 2 => {
                let (late, waited) = (size as f64 / 1e6, m.waited_ns as f64 / 1e6);
                (
                    Class::Timer,
                    format!("woken {late:.3} ms after the deadline, of that at most {waited:.3} ms waiting for a core"),
                )
            }
            _ => unexplained(evidence, "it began late"),
        },
    }
}

/// What the kernel counted, when it explains at least half of the delay.
fn kernel(evidence: &Evidence, record: &ScanRecord, size: Nanos, part: Part) -> Option<(Class, String)> {
    let explains = |time: Nanos| time > 0 && time >= size / 2;
    let ms = |time: Nanos| time as f64 / 1e6;
    let said = |text: String| Some((Class::Kernel, text));
    if evidence.stopped {
        return Some((Class::Stopped, "SIGSTOP and SIGCONT".into()));
    }
    if explains(evidence.throttled_ns) {
        return said(format!("the CPU quota of its control group was used up for {:.1} ms", ms(evidence.throttled_ns)));
    }
    let measured = evidence.measured.unwrap_or_default();
    if explains(measured.waited_at_least()) {
        return said(format!("waited {:.3} ms for a core", ms(measured.waited_ns.min(size))));
    }
    // Neither on a core nor waiting for one: only a scan that runs can be held.
    let held = match (part, evidence.measured) {
        (Part::Wake, _) => 0,
        (_, Some(m)) => record.execution().saturating_sub(m.ran_ns).saturating_sub(m.waited_ns).min(size),
        (_, None) => size,
    };
    if evidence.major_faults > 0 && explains(held) {
        return said(format!("{} page faults from the disk", evidence.major_faults));
    }
    if part == Part::Program && evidence.measured.is_some() && explains(held.saturating_sub(KERNEL_TICK)) {
        return said(format!("held by the kernel for {:.1} ms", ms(held)));
    }
    if part == Part::Wake && evidence.no_sleep {
        let before = record.scan.saturating_sub(1);
        return Some((Class::Carried, format!("scan {before} was late as well; this one began at once after it")));
    }
    if explains(evidence.steal_ns) {
        return said(format!("steal {:.0} ms", ms(evidence.steal_ns)));
    }
    if part != Part::Wake && explains(evidence.minor_faults * MINOR_FAULT) {
        return said(format!("{} page faults", evidence.minor_faults));
    }
    None
}

/// What was looked at, for a scan that nothing explains.
fn unexplained(evidence: &Evidence, what: &str) -> (Class, String) {
    let mut looked = match evidence.measured {
        Some(m) => format!(
            "waited for a core {:.1} µs, of that {} other scans at most {:.1} µs; on a core {:.1} µs",
            m.waited_ns as f64 / 1e3,
            m.others,
            m.others_ns as f64 / 1e3,
            m.ran_ns as f64 / 1e3
        ),
        None => "no schedstat".to_owned(),
    };
    let counts = [
        ("steal", evidence.steal_ns, "ms", 1_000_000),
        ("interrupts", evidence.interrupts_ns, "ms", 1_000_000),
        ("quota", evidence.throttled_ns, "ms", 1_000_000),
        ("page faults", evidence.minor_faults, "", 1),
        ("page faults from the disk", evidence.major_faults, "", 1),
        ("observer late", evidence.observer_late_ns, "ms", 1_000_000),
    ];
    for (name, count, unit, each) in counts {
        if count > 0 {
            looked += format!("; {name} {} {unit}", count / each).trim_end();
        }
    }
    (Class::Unexplained, format!("{what} ({looked})"))
}

/// Whether the statements that were executed can have taken that long.
fn plausible(record: &ScanRecord, evidence: &Evidence, size: Nanos) -> bool {
    // The first scans have no usual time yet: then 10 ns a statement are taken.
    let each = evidence.ns_per_statement.max(10);
    record.statements.saturating_mul(each).saturating_mul(PLAUSIBLE) >= size
}

fn program(record: &ScanRecord) -> String {
    let mut text = format!("OB {}, {} statements", record.longest_ob, record.statements);
    if let Some(block) = record.long_in {
        text += &format!("; in {block} line {} when it had become long", record.long_at_line);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_cpu::Flags;
    use ob1_model::{BlockId, BlockKind};

    const MS: Nanos = 1_000_000;

    fn woke_late(by: Nanos) -> ScanRecord {
        let flags = Flags { began_late: true, ..Flags::default() };
        ScanRecord {
            scan: 9,
            planned: 100 * MS,
            start: 100 * MS + by,
            end: 100 * MS + by + 10_000,
            flags,
            ..ScanRecord::default()
        }
    }

    fn took_long(part: fn(&mut ScanRecord) -> &mut Nanos, time: Nanos) -> ScanRecord {
        let flags = Flags { took_long: true, overran: true, ..Flags::default() };
        let mut record = ScanRecord { scan: 9, planned: 100 * MS, start: 100 * MS, flags, ..ScanRecord::default() };
        *part(&mut record) = time;
        (record.longest_ob, record.longest_ob_time, record.end) = (1, time, record.start + time + 5000);
        record
    }

    /// The scan was alone in its window, and the thread waited and ran so long.
    fn alone(waited_ns: Nanos, ran_ns: Nanos) -> Evidence {
        let measured = Some(Measured { window_ns: 100 * MS, waited_ns, ran_ns, ..Measured::default() });
        Evidence { window_ns: 100 * MS, measured, ns_per_statement: 20, ..Evidence::default() }
    }

    #[test]
    fn a_scan_that_began_late() {
        let quiet = alone(0, 0);
        let blind = Evidence { measured: None, ..quiet };
        let beside = |waited_ns, others_ns| {
            let measured = Some(Measured { waited_ns, others: 9, others_ns, ..Measured::default() });
            Evidence { measured, ..quiet }
        };
        let cases = [
            ("asleep", quiet, Class::Timer),
            ("run queue", alone(MS / 2, 0), Class::Kernel),
            ("some wait", alone(MS / 3, 0), Class::Timer),
            ("others waited", beside(MS, MS * 3 / 4), Class::Unexplained),
            ("others waited less", beside(MS, MS / 4), Class::Kernel),
            ("others waited, but not much", beside(MS / 3, MS / 4), Class::Timer),
            ("no schedstat", blind, Class::Unexplained),
            ("steal", Evidence { steal_ns: 10 * MS, ..quiet }, Class::Kernel),
            ("quota", Evidence { throttled_ns: 30 * MS, ..quiet }, Class::Kernel),
            ("stopped", Evidence { stopped: true, ..alone(MS, 0) }, Class::Stopped),
            ("no sleep", Evidence { no_sleep: true, ..quiet }, Class::Carried),
            ("no sleep, no core", Evidence { no_sleep: true, ..alone(MS, 0) }, Class::Kernel),
            // A thread that sleeps touches no page.
            ("disk", Evidence { major_faults: 3, ..quiet }, Class::Timer),
            ("disk, no schedstat", Evidence { major_faults: 3, ..blind }, Class::Unexplained),
            ("faults", Evidence { minor_faults: 5000, ..quiet }, Class::Timer),
        ];
        for (name, evidence, class) in cases {
            let cause = explain(&woke_late(MS), &evidence);
            assert_eq!((cause.class, cause.size), (class, MS), "{name}: {}", cause.what);
        }
        let before = ScanRecord { carried: MS, ..woke_late(MS) };
        assert_eq!(explain(&before, &alone(MS, 0)).class, Class::Carried, "the record says it exactly");
        let between = ScanRecord { between: MS, between_ob: 35, ..woke_late(MS) };
        assert_eq!(explain(&between, &alone(MS, 0)).class, Class::Program, "the record says it exactly");
    }

    #[test]
    fn a_scan_that_took_long() {
        let ran = alone(0, 6 * MS);
        let blind = Evidence { measured: None, ..ran };
        let program = ScanRecord { statements: 400_000, ..took_long(|r| &mut r.program, 6 * MS) };
        let few = ScanRecord { statements: 4000, ..program };
        let longer = ScanRecord { statements: 4_000_000, ..took_long(|r| &mut r.program, 60 * MS) };
        let plugin = {
            let mut record = took_long(|r| &mut r.program, 6 * MS);
            (record.plugins, record.longest_plugin_time) = (record.program, record.program);
            ScanRecord { longest_plugin: Some(BlockId::new(BlockKind::Fc, 7)), ..record }
        };
        let outputs = took_long(|r| &mut r.outputs, 2 * MS);
        let cases = [
            ("program", program, ran, Class::Program),
            ("program, no schedstat", program, blind, Class::Program),
            ("few statements", few, ran, Class::Unexplained),
            ("program off its core", program, alone(4 * MS, 2 * MS), Class::Kernel),
            ("program that waited a little", program, alone(2 * MS, 4 * MS), Class::Program),
            ("program, faults", program, Evidence { major_faults: 2, ..alone(0, MS) }, Class::Kernel),
            ("program, faults of others", program, Evidence { major_faults: 2, ..ran }, Class::Program),
            ("program, faults, no schedstat", program, Evidence { major_faults: 2, ..blind }, Class::Kernel),
            // A time on a core may be a tick old.
            ("program, held a little", program, alone(0, MS), Class::Program),
            ("program, held", longer, alone(0, 5 * MS), Class::Kernel),
            ("plugin", plugin, ran, Class::Plugin),
            ("plugin that sleeps", plugin, alone(0, 0), Class::Plugin),
            ("plugin off its core", plugin, alone(5 * MS, MS), Class::Kernel),
            ("inputs", took_long(|r| &mut r.inputs, 2 * MS), alone(0, 2 * MS), Class::Driver),
            ("outputs", outputs, alone(0, 2 * MS), Class::Driver),
            ("faults", outputs, Evidence { minor_faults: 1500, ..alone(0, 2 * MS) }, Class::Kernel),
            ("quota", program, Evidence { throttled_ns: 5 * MS, ..ran }, Class::Kernel),
            ("little quota", program, Evidence { throttled_ns: MS, ..ran }, Class::Program),
            ("interrupts are looked at only", few, Evidence { interrupts_ns: 90 * MS, ..ran }, Class::Unexplained),
        ];
        for (name, record, evidence, class) in cases {
            let cause = explain(&record, &evidence);
            assert_eq!(cause.class, class, "{name}: {}", cause.what);
        }
        let looked = explain(&few, &Evidence { interrupts_ns: 90 * MS, ..ran }).what;
        assert!(looked.contains("interrupts 90 ms") && looked.contains("on a core 6000.0"), "{looked}");
    }

    #[test]
    fn the_longest_part_decides() {
        let quiet = alone(0, 0);
        let mut record = took_long(|r| &mut r.program, 3 * MS);
        (record.statements, record.inputs, record.start) = (1_000_000, MS, record.start + 2 * MS);
        record.flags.began_late = true;
        assert_eq!(explain(&record, &quiet).class, Class::Program);
        record.start += 4 * MS;
        assert_eq!(explain(&record, &quiet).class, Class::Timer, "it woke up later than it ran");
        let long_in = ScanRecord { long_in: Some(BlockId::new(BlockKind::Fc, 7)), long_at_line: 12, ..record };
        let long_in = ScanRecord { start: long_in.planned, ..long_in };
        assert!(explain(&long_in, &quiet).what.contains("FC 7 line 12"));
    }
}
