//! Why a scan was late: from its record and what the kernel says, a class, a size and the evidence. Pure.

use ob1_coupler::config::nanos;
use ob1_cpu::ScanRecord;
use ob1_model::named;
use ob1_time::Span;
use serde::{Deserialize, Serialize};

named! {
    /// The cause of a late scan, in the order of reports, named as it is printed.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Class {
        /// The kernel gave the core to something else, or had to find memory: waiting for a core, a quota, page faults,
        /// steal.
        Kernel = "kernel",
        /// The process was stopped by a signal and continued.
        Stopped = "stopped by a signal",
        /// An organization block took long; it is named.
        Program = "program",
        /// A block of a plugin.
        Plugin = "plugin",
        /// The exchange with the modules: registers, events, doorbells.
        Driver = "driver",
        /// The scan before, which is accounted for by itself.
        Carried = "carried over",
        /// The scan thread was asleep beyond its deadline, neither waiting for a core nor on one: the timer's interrupt
        /// came late. Its core was waking from a deep sleep, or the kernel or the host held interrupts back; no counter
        /// tells which.
        Timer = "timer late",
        /// Nothing here explains it: the host of a virtual machine, firmware or hardware is suspected.
        Unexplained = "unexplained (host suspected)",
    }
}

impl Class {
    /// What helps against it, where the program is not what it was about.
    pub const fn remedy(self) -> Option<&'static str> {
        match self {
            Self::Kernel | Self::Timer | Self::Unexplained => Some(
                "The PC did not give this CPU its core in time; the program is not the cause. Give the station real time \
                 ([cpu.realtime]), or take load off the PC: `ob1 check FILE --posture` says what it is granted.",
            ),
            Self::Stopped => Some("The process was stopped by a signal (SIGSTOP, a debugger): let it run."),
            Self::Plugin => Some("A block of a plugin took the time: `ob1 ctl NAME recorder` names it."),
            Self::Program | Self::Driver | Self::Carried => None,
        }
    }
}

#[cfg(test)]
mod remedies {
    use super::Class;

    #[test]
    fn a_host_that_gives_no_core_is_not_answered_with_a_shorter_program() {
        for class in [Class::Kernel, Class::Timer, Class::Unexplained] {
            let remedy = class.remedy().expect("one");
            assert!(remedy.contains("[cpu.realtime]") && !remedy.contains("shorten"), "{remedy}");
        }
        assert_eq!(Class::Program.remedy(), None, "that of the event");
    }
}

/// What is known about the time around a scan. Except `measured`, the figures are those of a window up to two looks of
/// the observer wide, so they are upper bounds for the scan itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Evidence {
    /// The scan before was late too, and when it had been noted down this one was due: the thread had not slept.
    pub no_sleep: bool,
    /// Width of the window.
    #[serde(rename = "window_ns", with = "nanos")]
    pub window: Span,
    /// What the scan's own look says, where the kernel has `schedstat`.
    pub measured: Option<Measured>,
    /// Time the host took from the cores this process may use, in ticks of 10 ms.
    #[serde(rename = "steal_ns", with = "nanos")]
    pub steal: Span,
    /// Time these cores were at interrupts, in ticks of 10 ms.
    #[serde(rename = "interrupts_ns", with = "nanos")]
    pub interrupts: Span,
    /// Time the quotas of control groups (`cpu.max`) held back threads of this process and its neighbours.
    #[serde(rename = "throttled_ns", with = "nanos")]
    pub throttled: Span,
    /// Times the scan thread was taken off its core.
    pub switches: u64,
    /// Page faults that needed no disk.
    pub minor_faults: u64,
    /// Page faults that did.
    pub major_faults: u64,
    /// The process was continued by SIGCONT between the scan's deadline and its end.
    pub stopped: bool,
    /// How much later than planned the observer itself came to look.
    #[serde(rename = "observer_late_ns", with = "nanos")]
    pub observer_late: Span,
    /// What a statement of this program usually takes.
    #[serde(rename = "ns_per_statement", with = "nanos")]
    pub per_statement: Span,
}

/// The scan thread's times between the last look before the scan began and the scan's own look at its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Measured {
    /// From that look to the scan's end.
    #[serde(rename = "window_ns", with = "nanos")]
    pub window: Span,
    /// Waiting for a core although ready to run.
    #[serde(rename = "waited_ns", with = "nanos")]
    pub waited: Span,
    /// On a core.
    #[serde(rename = "ran_ns", with = "nanos")]
    pub ran: Span,
    /// Other scans that lie in this time.
    pub others: u64,
    /// How much of the waiting may be theirs: of the time they have lost (late starts, time off their core), the share
    /// that is usual for scans on time.
    #[serde(rename = "others_ns", with = "nanos")]
    pub others_waited: Span,
}

impl Measured {
    /// How long this scan has waited for a core at least.
    pub const fn waited_at_least(&self) -> Span {
        self.waited.saturating_sub(self.others_waited)
    }
}

/// The cause that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cause {
    /// The class.
    pub class: Class,
    /// What exactly, in words.
    pub what: String,
    /// How much of the delay it is.
    pub size: Span,
}

/// A minor fault takes about this long.
const MINOR_FAULT: Span = Span::MICROSECOND;
/// A time on a core may be out of date by this much.
const KERNEL_TICK: Span = Span::from_millis(10);
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

fn longest_part(record: &ScanRecord) -> (Part, Span) {
    let flags = record.flags;
    let began = |time: Span| if flags.began_late || !flags.took_long { time } else { Span::ZERO };
    let took = |time: Span| if flags.took_long || flags.overran || flags.watchdog { time } else { Span::ZERO };
    let wake = record.lateness().saturating_sub(record.carried.max(record.between));
    let parts = [
        (Part::Wake, began(wake)),
        (Part::Carried, began(record.carried)),
        (Part::Between, began(record.between)),
        (Part::Program, took(record.program.saturating_sub(record.plugins))),
        (Part::Plugins, took(record.plugins)),
        (Part::Exchange, took(record.inputs + record.outputs)),
    ];
    parts.into_iter().max_by_key(|(_, time)| *time).unwrap_or((Part::Wake, Span::ZERO))
}

/// Says why a scan was late.
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

/// The cause within the scan itself.
fn own(part: Part, record: &ScanRecord, evidence: &Evidence, size: Span) -> (Class, String) {
    match part {
        Part::Program if plausible(record, evidence, size) => (Class::Program, program(record)),
        Part::Program => {
            let usual = evidence.per_statement.times(record.statements).as_micros_f64();
            let statements = record.statements;
            unexplained(evidence, &format!("OB {}: its {statements} statements take {usual:.1} µs", record.longest_ob))
        }
        Part::Plugins => {
            let block = record.longest_plugin.map_or_else(String::new, |block| block.to_string());
            let time = record.longest_plugin_time.as_micros_f64();
            (Class::Plugin, format!("{block}, one call of {time:.1} µs"))
        }
        Part::Exchange => {
            let (inputs, outputs) = (record.inputs.as_micros_f64(), record.outputs.as_micros_f64());
            (Class::Driver, format!("inputs {inputs:.1} µs, outputs {outputs:.1} µs"))
        }
        _ => match evidence.measured {
            // All its waiting is less than half of the delay: it slept.
            Some(m) if m.waited < size / 2 => {
                let (late, waited) = (size.as_millis_f64(), m.waited.as_millis_f64());
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
fn kernel(evidence: &Evidence, record: &ScanRecord, size: Span, part: Part) -> Option<(Class, String)> {
    let explains = |time: Span| !time.is_zero() && time >= size / 2;
    let ms = Span::as_millis_f64;
    let said = |text: String| Some((Class::Kernel, text));
    if evidence.stopped {
        return Some((Class::Stopped, "SIGSTOP and SIGCONT".into()));
    }
    if explains(evidence.throttled) {
        return said(format!("the CPU quota of its control group was used up for {:.1} ms", ms(evidence.throttled)));
    }
    let measured = evidence.measured.unwrap_or_default();
    if explains(measured.waited_at_least()) {
        return said(format!("waited {:.3} ms for a core", ms(measured.waited.min(size))));
    }
    // Neither on a core nor waiting for one: only a scan that runs can be held.
    let held = match (part, evidence.measured) {
        (Part::Wake, _) => Span::ZERO,
        (_, Some(m)) => record.execution().saturating_sub(m.ran).saturating_sub(m.waited).min(size),
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
    if explains(evidence.steal) {
        return said(format!("steal {:.0} ms", ms(evidence.steal)));
    }
    if part != Part::Wake && explains(MINOR_FAULT * evidence.minor_faults) {
        return said(format!("{} page faults", evidence.minor_faults));
    }
    None
}

/// What was checked, for a scan that nothing explains.
fn unexplained(evidence: &Evidence, what: &str) -> (Class, String) {
    let mut looked = match evidence.measured {
        Some(m) => format!(
            "waited for a core {:.1} µs, of that {} other scans at most {:.1} µs; on a core {:.1} µs",
            m.waited.as_micros_f64(),
            m.others,
            m.others_waited.as_micros_f64(),
            m.ran.as_micros_f64()
        ),
        None => "no schedstat".to_owned(),
    };
    let time = |name, time: Span| (!time.is_zero()).then(|| format!("; {name} {} ms", time.millis()));
    let count = |name, count: u64| (count > 0).then(|| format!("; {name} {count}"));
    let also = [
        time("steal", evidence.steal),
        time("interrupts", evidence.interrupts),
        time("quota", evidence.throttled),
        count("page faults", evidence.minor_faults),
        count("page faults from the disk", evidence.major_faults),
        time("observer late", evidence.observer_late),
    ];
    looked.extend(also.into_iter().flatten());
    (Class::Unexplained, format!("{what} ({looked})"))
}

/// Whether the statements that were executed can have taken that long.
fn plausible(record: &ScanRecord, evidence: &Evidence, size: Span) -> bool {
    // The first scans have no usual time yet: then 10 ns a statement are taken.
    let each = evidence.per_statement.max(Span::from_nanos(10));
    each.times(record.statements).times(PLAUSIBLE) >= size
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
    use ob1_time::Instant;

    const MS: Span = Span::MILLISECOND;
    const NONE: Span = Span::ZERO;

    const DUE: Instant = Instant::from_millis(100);

    fn woke_late(by: Span) -> ScanRecord {
        let flags = Flags { began_late: true, ..Flags::default() };
        ScanRecord {
            scan: 9,
            planned: DUE,
            start: DUE + by,
            end: DUE + by + Span::from_micros(10),
            flags,
            ..ScanRecord::default()
        }
    }

    fn took_long(part: fn(&mut ScanRecord) -> &mut Span, time: Span) -> ScanRecord {
        let flags = Flags { took_long: true, overran: true, ..Flags::default() };
        let mut record = ScanRecord { scan: 9, planned: DUE, start: DUE, flags, ..ScanRecord::default() };
        *part(&mut record) = time;
        (record.longest_ob, record.longest_ob_time, record.end) =
            (1, time, record.start + time + 5 * Span::MICROSECOND);
        record
    }

    /// The scan was alone in its window, and the thread waited and ran so long.
    fn alone(waited: Span, ran: Span) -> Evidence {
        let measured = Some(Measured { window: 100 * MS, waited, ran, ..Measured::default() });
        Evidence { window: 100 * MS, measured, per_statement: Span::from_nanos(20), ..Evidence::default() }
    }

    #[test]
    fn a_scan_that_began_late() {
        let quiet = alone(NONE, NONE);
        let blind = Evidence { measured: None, ..quiet };
        let beside = |waited, others_waited| {
            let measured = Some(Measured { waited, others: 9, others_waited, ..Measured::default() });
            Evidence { measured, ..quiet }
        };
        let cases = [
            ("asleep", quiet, Class::Timer),
            ("run queue", alone(MS / 2, NONE), Class::Kernel),
            ("some wait", alone(MS / 3, NONE), Class::Timer),
            ("others waited", beside(MS, MS * 3 / 4), Class::Unexplained),
            ("others waited less", beside(MS, MS / 4), Class::Kernel),
            ("others waited, but not much", beside(MS / 3, MS / 4), Class::Timer),
            ("no schedstat", blind, Class::Unexplained),
            ("steal", Evidence { steal: 10 * MS, ..quiet }, Class::Kernel),
            ("quota", Evidence { throttled: 30 * MS, ..quiet }, Class::Kernel),
            ("stopped", Evidence { stopped: true, ..alone(MS, NONE) }, Class::Stopped),
            ("no sleep", Evidence { no_sleep: true, ..quiet }, Class::Carried),
            ("no sleep, no core", Evidence { no_sleep: true, ..alone(MS, NONE) }, Class::Kernel),
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
        assert_eq!(explain(&before, &alone(MS, NONE)).class, Class::Carried, "the record says it exactly");
        let between = ScanRecord { between: MS, between_ob: 35, ..woke_late(MS) };
        assert_eq!(explain(&between, &alone(MS, NONE)).class, Class::Program, "the record says it exactly");
    }

    #[test]
    fn a_scan_that_took_long() {
        let ran = alone(NONE, 6 * MS);
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
            ("program, faults", program, Evidence { major_faults: 2, ..alone(NONE, MS) }, Class::Kernel),
            ("program, faults of others", program, Evidence { major_faults: 2, ..ran }, Class::Program),
            ("program, faults, no schedstat", program, Evidence { major_faults: 2, ..blind }, Class::Kernel),
            // A time on a core may be a tick old.
            ("program, held a little", program, alone(NONE, MS), Class::Program),
            ("program, held", longer, alone(NONE, 5 * MS), Class::Kernel),
            ("plugin", plugin, ran, Class::Plugin),
            ("plugin that sleeps", plugin, alone(NONE, NONE), Class::Plugin),
            ("plugin off its core", plugin, alone(5 * MS, MS), Class::Kernel),
            ("inputs", took_long(|r| &mut r.inputs, 2 * MS), alone(NONE, 2 * MS), Class::Driver),
            ("outputs", outputs, alone(NONE, 2 * MS), Class::Driver),
            ("faults", outputs, Evidence { minor_faults: 1500, ..alone(NONE, 2 * MS) }, Class::Kernel),
            ("quota", program, Evidence { throttled: 5 * MS, ..ran }, Class::Kernel),
            ("little quota", program, Evidence { throttled: MS, ..ran }, Class::Program),
            ("interrupts are looked at only", few, Evidence { interrupts: 90 * MS, ..ran }, Class::Unexplained),
        ];
        for (name, record, evidence, class) in cases {
            let cause = explain(&record, &evidence);
            assert_eq!(cause.class, class, "{name}: {}", cause.what);
        }
        let looked = explain(&few, &Evidence { interrupts: 90 * MS, ..ran }).what;
        assert!(looked.contains("interrupts 90 ms") && looked.contains("on a core 6000.0"), "{looked}");
    }

    #[test]
    fn the_longest_part_decides() {
        let quiet = alone(NONE, NONE);
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
