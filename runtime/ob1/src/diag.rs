//! `ob1 diag`: the diagnostic buffers of a running station, the CPU's and those of its CPs, with text and remedy.

use chrono::{Local, TimeZone};
use clap::Args;
use ob1_model::BlockKind;
use serde::Serialize;

use crate::debug::{local, registers, stack};
use crate::exit::Exit;
use crate::remote::{ask, print_json};
use ob1_station::access::client::AccessError;
use ob1_station::access::debug::DebugWanted;
use ob1_station::access::protocol::{CpBuffer, Diagnostic, Op};

/// Print the diagnostic buffers of a running station
///
/// The buffer of the CPU, and those of its CPs (of a CP 240 and a CP 040 a list that the module itself does not have):
/// newest entry first, each with its date and time of day here, its time since the start of the runtime, its number,
/// what it means, where (block, line, file) and, in the line below, what helps. Above the entries of a CP stands what
/// it waits for or what has failed. The buffer of a CP outlives its driver. Below, the system data blocks that a
/// programming device has loaded: none of them is used.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 diag press.toml\n  ob1 diag press cp --count 5\n  ob1 diag press 272 --json\n  ob1 diag press --stack\n\n\
    Exit codes: 0 printed, 1 no such CP, 5 the station does not run, 8 it does not answer.\n\nMore: docs/access.md, docs/cp341-events.md."
)]
pub struct DiagArgs {
    /// A running station: its name or its file
    pub station: String,
    /// Only this CP's buffer: its name or its logical address
    pub cp: Option<String>,
    /// At most so many entries of each buffer
    #[arg(long, short = 'n', value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    pub count: u32,
    /// The stacks instead: the blocks the program was in when the CPU went to STOP or HOLD, registers, local data
    #[arg(long, conflicts_with_all = ["cp", "count"])]
    pub stack: bool,
    /// As JSON: {"cpu": [...], "cps": [{name, type, address, driver, entries}]}
    #[arg(long)]
    pub json: bool,
}

#[derive(Serialize)]
struct Buffers<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    cpu: Option<&'a [Diagnostic]>,
    cps: &'a [CpBuffer],
}

/// Prints the buffers, newest entry first.
pub fn diag(args: &DiagArgs) -> Result<Exit, AccessError> {
    if args.stack {
        return stacks(args);
    }
    let response = ask(&args.station, Op::Diag { count: args.count })?;
    let cpu = response.diagnostics.unwrap_or_default();
    let mut cps = response.cps.unwrap_or_default();
    if let Some(wanted) = &args.cp {
        let names: Vec<String> = cps.iter().map(|cp| format!("{} at {}", cp.name, cp.address)).collect();
        cps.retain(|cp| cp.name == *wanted || wanted.parse() == Ok(cp.address));
        if cps.is_empty() {
            let there = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            err!("ob1: \"{wanted}\" is not a CP with a diagnostic buffer\n  = this station has: {there}");
            return Ok(Exit::Usage);
        }
    }
    let cpu = args.cp.is_none().then_some(cpu.as_slice());
    if args.json {
        return Ok(print_json(&Buffers { cpu, cps: &cps }));
    }
    says!("{}", text(cpu, &cps));
    let kept = if cpu.is_some() { system_data(&args.station) } else { Vec::new() };
    if !kept.is_empty() {
        say!(
            "{}: kept for programming devices, nothing of it is used: the station file says what there is",
            kept.join(", ")
        );
    }
    Ok(Exit::Ok)
}

/// In what the program was interrupted.
fn stacks(args: &DiagArgs) -> Result<Exit, AccessError> {
    let wanted = Op::Debug(DebugWanted::Stack { level: 0 });
    let status = ask(&args.station, wanted)?.debug.unwrap_or_default();
    if args.json {
        return Ok(print_json(&status));
    }
    match (status.outcome.as_str(), status.stack.is_empty()) {
        ("runs", _) => say!("the CPU runs: it has stacks in STOP and in HOLD"),
        (_, true) => say!("the CPU is in STOP, and no block was interrupted: it was stopped between two scans"),
        _ => {
            say!("blocks, the innermost first");
            stack(&status);
            say!("registers");
            registers(&status);
            say!("local data of the innermost block");
            local(&status);
        }
    }
    Ok(Exit::Ok)
}

/// The system data blocks that were downloaded. A station that does not tell its status has none to tell.
fn system_data(station: &str) -> Vec<String> {
    let status = ask(station, Op::Status).ok().and_then(|response| response.status);
    let all = status.into_iter().flat_map(|status| status.downloads);
    let kept = all.filter(|one| one.block.starts_with(BlockKind::Sdb.name()) && one.what != "deleted");
    kept.map(|one| one.block).collect()
}

/// A moment in the time zone of this machine.
pub(crate) fn date(unix_ns: u64) -> String {
    date_in(&Local, unix_ns)
}

fn date_in<Z: TimeZone<Offset: std::fmt::Display>>(zone: &Z, unix_ns: u64) -> String {
    let moment = zone.timestamp_nanos(i64::try_from(unix_ns).unwrap_or(i64::MAX));
    moment.format("%Y-%m-%d %H:%M:%S%.3f %:z").to_string()
}

/// The buffers as text, with times of the time zone of this machine.
pub(crate) fn text(cpu: Option<&[Diagnostic]>, cps: &[CpBuffer]) -> String {
    told(cpu, cps, &Local)
}

fn told<Z: TimeZone<Offset: std::fmt::Display>>(cpu: Option<&[Diagnostic]>, cps: &[CpBuffer], zone: &Z) -> String {
    use std::fmt::Write as _;
    let date = |unix_ns| date_in(zone, unix_ns);
    let mut out = String::new();
    // Writing into a String does not fail.
    for (index, entry) in cpu.into_iter().flatten().enumerate() {
        if index == 0 {
            out.push_str("CPU\n");
        }
        let (date, seconds) = (date(entry.unix_ns), entry.time_ns as f64 / 1e9);
        let _ = writeln!(out, "{:>6}  {date} {seconds:>13.6} s  {}", entry.number, entry.told());
        if !entry.remedy.is_empty() {
            let _ = writeln!(out, "{:>58} {}", "=", entry.remedy);
        }
    }
    for cp in cps {
        let gap = if out.is_empty() { "" } else { "\n" };
        let _ = writeln!(out, "{gap}{} ({} at {}), driver: {}", cp.name, cp.type_name, cp.address, cp.driver);
        if let Some(reason) = &cp.reason {
            let _ = writeln!(out, "        now: {}", reason.text);
            if !reason.remedy.is_empty() {
                let _ = writeln!(out, "{:>58} {}", "=", reason.remedy);
            }
        }
        if cp.entries.is_empty() {
            out.push_str("        no entries\n");
        }
        for entry in &cp.entries {
            let gone = if entry.incoming { "" } else { "gone: " };
            let (date, seconds) = (date(entry.unix_ns), entry.time_ms as f64 / 1e3);
            let _ = writeln!(out, "        {date} {seconds:>13.3} s  {} {gone}{}", entry.number, entry.text);
            if entry.incoming && !entry.remedy.is_empty() {
                let _ = writeln!(out, "{:>58} {}", "=", entry.remedy);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use chrono::FixedOffset;
    use ob1_backplane::BufferEntry;
    use ob1_station::access::protocol::ReasonStatus;

    use super::*;

    fn buffer(entries: &[(u16, bool, u64)]) -> CpBuffer {
        let entry = |&(number, incoming, time_ms): &_| BufferEntry { number, incoming, time_ms }.into();
        CpBuffer {
            name: "cp".into(),
            type_name: "cp341".into(),
            address: 272,
            driver: "ready".into(),
            reason: None,
            entries: entries.iter().map(entry).collect(),
        }
    }

    #[test]
    fn each_entry_has_its_text_and_its_remedy() {
        let stop = Diagnostic {
            number: 3,
            time_ns: 2_000_000,
            unix_ns: 1_800_000_000_123_456_789,
            event: "253Ah".into(),
            text: "253Ah data block not loaded (OB 1, line 7, DB 99)".into(),
            place: "press.awl:7".into(),
            because: String::new(),
            remedy: "Load it.".into(),
        };
        let run = Diagnostic { number: 2, text: "4302h RUN".into(), remedy: String::new(), ..stop.clone() };
        let cpu = [stop, Diagnostic { place: String::new(), ..run }];
        let cp = buffer(&[(0x080D, false, 62_500), (0x080D, true, 61_000), (0x0003, true, 12), (0xFFFF, true, 0)]);
        let expected = "\
CPU
     3  2027-01-15 09:00:00.123 +01:00      0.002000 s  253Ah data block not loaded (OB 1, line 7, DB 99), press.awl:7
                                                         = Load it.
     2  2027-01-15 09:00:00.123 +01:00      0.002000 s  4302h RUN

cp (cp341 at 272), driver: ready
        1970-01-01 01:00:00.000 +01:00        62.500 s  080Dh gone: BREAK: the receiving line is interrupted
        1970-01-01 01:00:00.000 +01:00        61.000 s  080Dh BREAK: the receiving line is interrupted
                                                         = Connect the devices, switch the partner on; with RS 422/485 check the wires R(A), R(B).
        1970-01-01 01:00:00.000 +01:00         0.012 s  0003h The parameters were accepted
        1970-01-01 01:00:00.000 +01:00         0.000 s  FFFFh unknown event
";
        let winter = FixedOffset::east_opt(3600).expect("an hour");
        assert_eq!(told(Some(&cpu), &[cp], &winter), expected);
    }

    #[test]
    fn an_empty_buffer_says_so() {
        assert_eq!(text(None, &[buffer(&[])]), "cp (cp341 at 272), driver: ready\n        no entries\n");
        let reason = Some(ReasonStatus {
            text: "waits for P_RCV_RK".into(),
            remedy: "Call it.".into(),
            ..ReasonStatus::default()
        });
        let expected = "cp (cp341 at 272), driver: ready\n        now: waits for P_RCV_RK\n                                \
                        \u{20}                        = Call it.\n        no entries\n";
        assert_eq!(text(None, &[CpBuffer { reason, ..buffer(&[]) }]), expected);
    }
}
