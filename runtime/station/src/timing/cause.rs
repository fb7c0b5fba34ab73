//! Why a scan was late: from its record and what the kernel says, a class, a size and the evidence. Pure.

use ob1_cpu::{Nanos, ScanRecord};
use serde::{Deserialize, Serialize};

/// Who made a scan late.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// The kernel gave the core to something else, or had to find memory: run-queue wait, involuntary switches, page
    /// faults, steal.
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
    /// Nothing here explains it: the host of a virtual machine, firmware or hardware is suspected.
    Unexplained,
}

impl Class {
    /// All, in the order of reports.
    pub const ALL: [Self; 7] =
        [Self::Kernel, Self::Stopped, Self::Program, Self::Plugin, Self::Driver, Self::Carried, Self::Unexplained];

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
        _ => unexplained(evidence, "its wake-up came late"),
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
            looked += &format!("; {name} {} {unit}", count / each).trim_end();
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

    #[test]
    fn each_class_by_its_evidence() {
        let quiet = Evidence { window_ns: 100 * MS, ns_per_statement: 20, ..Evidence::default() };
        let program = ScanRecord { statements: 400_000, ..took_long(|r| &mut r.program, 6 * MS) };
        let plugin = |mut r: ScanRecord| {
            (r.plugins, r.longest_plugin_time) = (r.program, r.program);
            r.longest_plugin = Some(BlockId::new(BlockKind::Fc, 7));
            r
        };
        let cases = [
            ("nothing", woke_late(MS), quiet, Class::Unexplained, MS),
            ("run queue", woke_late(MS), Evidence { wait_ns: MS / 2, ..quiet }, Class::Kernel, MS),
            ("some wait", woke_late(MS), Evidence { wait_ns: MS / 3, ..quiet }, Class::Unexplained, MS),
            ("steal", woke_late(MS), Evidence { steal_ns: 10 * MS, ..quiet }, Class::Kernel, MS),
            ("disk", woke_late(MS), Evidence { major_faults: 1, ..quiet }, Class::Kernel, MS),
            ("switched", woke_late(MS), Evidence { switches: 1, ..quiet }, Class::Kernel, MS),
            ("stopped", woke_late(50 * MS), Evidence { stopped: true, ..quiet }, Class::Stopped, 50 * MS),
            ("before", ScanRecord { carried: MS, ..woke_late(MS) }, quiet, Class::Carried, MS),
            ("OB 35", ScanRecord { between: MS, between_ob: 35, ..woke_late(MS) }, quiet, Class::Program, MS),
            ("program", program, quiet, Class::Program, 6 * MS),
            ("few statements", ScanRecord { statements: 4000, ..program }, quiet, Class::Unexplained, 6 * MS),
            ("program off its core", program, Evidence { wait_ns: 4 * MS, ..quiet }, Class::Kernel, 6 * MS),
            ("plugin", plugin(took_long(|r| &mut r.program, 6 * MS)), quiet, Class::Plugin, 6 * MS),
            ("inputs", took_long(|r| &mut r.inputs, 2 * MS), quiet, Class::Driver, 2 * MS),
            ("outputs", took_long(|r| &mut r.outputs, 2 * MS), quiet, Class::Driver, 2 * MS),
            (
                "faults",
                took_long(|r| &mut r.outputs, 2 * MS),
                Evidence { minor_faults: 1500, ..quiet },
                Class::Kernel,
                2 * MS,
            ),
        ];
        for (name, record, evidence, class, size) in cases {
            let cause = explain(&record, &evidence);
            assert_eq!((cause.class, cause.size), (class, size), "{name}: {}", cause.what);
        }
    }

    #[test]
    fn the_longest_part_decides() {
        let quiet = Evidence { ns_per_statement: 20, ..Evidence::default() };
        let mut record = took_long(|r| &mut r.program, 3 * MS);
        (record.statements, record.inputs, record.start) = (1_000_000, MS, record.start + 2 * MS);
        record.flags.began_late = true;
        assert_eq!(explain(&record, &quiet).class, Class::Program);
        record.start += 4 * MS;
        assert_eq!(explain(&record, &quiet).class, Class::Unexplained, "it woke up later than it ran");
        let long_in = ScanRecord { long_in: Some(BlockId::new(BlockKind::Fc, 7)), long_at_line: 12, ..record };
        let long_in = ScanRecord { start: long_in.planned, ..long_in };
        assert!(explain(&long_in, &quiet).what.contains("FC 7 line 12"));
    }
}
