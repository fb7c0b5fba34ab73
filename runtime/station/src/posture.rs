//! What a station asks of the operating system for its scan: asked for in one place, by `run` and by
//! `check --posture` alike.

use std::fmt;
use std::fs::File;

use ob1_rt::{Grant, Outcome, Posture};
use ob1_time::Span;

use crate::access::protocol::GrantStatus;
use crate::exit::Exit;
use ob1_station_file::finding::{Finding, Level};
use ob1_station_file::findings::STARVES;
use ob1_station_file::{Realtime, Station};

/// The priority of a new station's scan: above the kernel's threads of low priority, below its watchdogs.
const PRIORITY: u8 = 50;

/// The table of a new station: the best there is. What the system refuses a user is told at each start, and the station
/// runs without it, so the same file has all of it as a service.
#[must_use]
pub fn best_table(isolated: &[usize]) -> String {
    let affinity = match isolated.first() {
        Some(core) => format!("affinity = [{core}]                  # an isolated core\n"),
        None => "# affinity = [1]                # once a core is its own: boot with isolcpus=1\n".to_owned(),
    };
    format!(
        "[cpu.realtime]                  # for exact times: docs/timing.md of ob1. What the system refuses is told\n\
         priority = {PRIORITY}                   # SCHED_FIFO\n\
         lock_memory = true              # nothing of it is swapped out\n\
         keep_awake = true               # idle cores do not sleep deeply; costs power\n\
         {affinity}"
    )
}

/// Asks once for what [`best_table`] asks for, on a thread of its own, and says in one line what is missing.
#[must_use]
pub fn best(isolated: &[usize], file: &str) -> String {
    let affinity = isolated.first().into_iter().copied().collect();
    let asked =
        Realtime { priority: Some(PRIORITY), affinity, lock_memory: true, keep_awake: true, ..Realtime::default() };
    match ask(&asked) {
        Some(grants) => missing(&grants, file).unwrap_or_else(|| "real time: this user may have all of it".into()),
        None => "real time: not known, the system gives no thread".into(),
    }
}

/// What was not granted, in one line with what to do about it.
fn missing(grants: &[Grant], file: &str) -> Option<String> {
    let short = grants.iter().filter_map(|grant| match grant.outcome {
        Outcome::Refused => Some(grant.what.clone()),
        Outcome::Partly => Some(format!("{} (in part)", grant.what)),
        Outcome::Granted | Outcome::Noted | Outcome::Costs => None,
    });
    let short: Vec<String> = short.collect();
    if short.is_empty() {
        return None;
    }
    let short = short.join(", ");
    Some(format!("real time, not granted: {short}. How to get it: ob1 check {file} --posture, or run it as a service"))
}

/// Asks for everything on a thread of its own, which ends with what it was granted. None: the system gives no thread.
fn ask(asked: &Realtime) -> Option<Posture> {
    let (mut grants, held) = ask_process(asked);
    let realtime = asked.clone();
    let more = ob1_rt::spawn("ob1-posture", move || ask_thread(&realtime)).map(std::thread::JoinHandle::join);
    drop(held);
    grants.extend(more.ok()?.ok()?);
    Some(grants)
}

/// What is asked for the whole process, and what has to be held for it.
#[must_use]
pub fn ask_process(asked: &Realtime) -> (Posture, Option<File>) {
    let mut grants = Vec::new();
    if asked.lock_memory {
        grants.push(ob1_rt::lock_memory());
    }
    if !asked.keep_awake {
        return (grants, None);
    }
    let (grant, held) = ob1_rt::keep_awake();
    grants.push(grant);
    (grants, held)
}

/// What is asked for the calling thread, which is to be the one that scans.
#[must_use]
pub fn ask_thread(asked: &Realtime) -> Posture {
    let mut grants = vec![ob1_rt::set_timer_slack()];
    if !asked.affinity.is_empty() {
        grants.push(ob1_rt::pin_to(&asked.affinity));
    }
    if let Some(priority) = asked.priority {
        grants.push(ob1_rt::raise_priority(priority));
    }
    grants
}

/// A scan that would leave nothing of its core to others: free-running, or spinning more than half of its cycle,
/// with a real-time priority, on a core that is not its own. The kernel throttles such a thread for tens of
/// milliseconds each second.
#[must_use]
pub fn starves(station: &Station, isolated: &[usize], file: &str) -> Option<Finding> {
    let asked = &station.realtime;
    asked.priority?;
    let own_core = !asked.affinity.is_empty() && asked.affinity.iter().all(|core| isolated.contains(core));
    let cycle = station.cpu.min_cycle;
    let (what, remedy) = match (cycle, asked.spin) {
        _ if own_core => return None,
        (Span::ZERO, _) => ("a free-running scan", "set min_cycle"),
        (cycle, spin) if spin > cycle / 2 => ("a scan that spins for more than half of its cycle", "make spin shorter"),
        _ => return None,
    };
    let message = format!("{what} with a real-time priority would starve its core, and be throttled by the kernel");
    let remedy =
        format!("{remedy}, leave priority out, or bind it to an isolated core (boot with isolcpus=N; affinity = [N])");
    Some(Finding::whole(Level::Error, STARVES, file, message, remedy))
}

/// Asks for everything, and prints what was granted and which settings of the system matter.
#[must_use]
pub fn check(station: &Station, json: bool) -> Exit {
    let Some(mut grants) = ask(&station.realtime) else { return Exit::System };
    let refused = grants.iter().any(|grant| grant.outcome != Outcome::Granted);
    grants.extend(ob1_rt::system_facts(&station.realtime.affinity));
    let grants: Vec<GrantStatus> = grants.iter().map(GrantStatus::from).collect();
    if json {
        match serde_json::to_string_pretty(&grants) {
            Ok(text) => say!("{text}"),
            Err(_) => return Exit::System,
        }
    } else {
        says!("{}", text(&grants));
    }
    if refused { Exit::Usage } else { Exit::Ok }
}

/// Reports what was not granted, in one line. A run does so at its start: its summary may come hours later.
pub(crate) fn tell(grants: &[Grant], file: &str) {
    if let Some(line) = missing(grants, file) {
        tracing::warn!("{line}");
    }
}

/// One line a grant, and below it what would change it.
#[must_use]
pub fn text(grants: &[GrantStatus]) -> String {
    let mut out = String::new();
    for GrantStatus { what, outcome, detail, remedy } in grants {
        let detail = if detail.is_empty() { String::new() } else { format!(": {detail}") };
        out += &format!("{outcome:<8} {what}{detail}\n");
        if let Some(remedy) = remedy {
            out += &format!("           = {remedy}\n");
        }
    }
    out
}

impl fmt::Display for GrantStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, outcome, detail, .. } = self;
        write!(f, "{what}: {outcome}")?;
        if detail.is_empty() { Ok(()) } else { write!(f, ": {detail}") }
    }
}

impl From<&Grant> for GrantStatus {
    fn from(grant: &Grant) -> Self {
        let outcome = match grant.outcome {
            Outcome::Granted => "granted",
            Outcome::Partly => "partly",
            Outcome::Refused => "refused",
            Outcome::Noted => "noted",
            Outcome::Costs => "costs",
        };
        Self {
            what: grant.what.clone(),
            outcome: outcome.into(),
            detail: grant.detail.clone(),
            remedy: grant.remedy.map(str::to_owned),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn station(cpu: &str, realtime: &str) -> Station {
        let text = format!("[station]\nname = \"x\"\n[cpu]\n{cpu}\n[cpu.realtime]\n{realtime}\n");
        ob1_station_file::parse(&text, "x.toml", Path::new("")).unwrap_or_else(|findings| panic!("{findings:?}"))
    }

    #[test]
    fn a_scan_that_would_starve_its_core_is_refused_unless_the_core_is_its_own() {
        let free = "min_cycle = \"0ms\"";
        let cases = [
            (free, "priority = 50", false),
            (free, "priority = 50\naffinity = [1, 3]", true),
            (free, "priority = 50\naffinity = [0, 1]", false),
            (free, "spin = \"1ms\"", true),
            ("", "priority = 50\nspin = \"500us\"", true),
            ("", "priority = 50\nspin = \"501us\"", false),
            ("", "priority = 50\nspin = \"501us\"\naffinity = [3]", true),
        ];
        for (cpu, realtime, good) in cases {
            let finding = starves(&station(cpu, realtime), &[1, 2, 3], "x.toml");
            assert_eq!(finding.is_none(), good, "{cpu} {realtime}");
            assert!(finding.is_none_or(|finding| finding.to_string().contains("C014")));
        }
    }

    #[test]
    fn what_became_of_a_request_is_said_once() {
        for (outcome, detail, told) in [
            ("granted", "", "lock memory: granted"),
            ("refused", "not permitted", "lock memory: refused: not permitted"),
            ("partly", "later mappings are not", "lock memory: partly: later mappings are not"),
        ] {
            let (what, remedy) = ("lock memory".to_owned(), None);
            let grant = GrantStatus { what, outcome: outcome.to_owned(), detail: detail.to_owned(), remedy };
            assert_eq!(grant.to_string(), told);
        }
    }

    #[test]
    fn the_best_table_asks_for_everything_and_is_no_error() {
        for (isolated, affinity) in [(&[][..], vec![]), (&[2, 3], vec![2])] {
            let text = format!("[station]\nname = \"x\"\n\n{}", best_table(isolated));
            let station = ob1_station_file::parse(&text, "x.toml", Path::new(""));
            let asked = station.unwrap_or_else(|findings| panic!("{text}: {findings:?}")).realtime;
            assert!(asked.priority == Some(PRIORITY) && asked.lock_memory && asked.keep_awake, "{asked:?}");
            assert_eq!(asked.affinity, affinity);
        }
    }

    #[test]
    fn what_is_missing_is_one_line_with_the_way_to_it() {
        let grant = |what: &str, outcome, detail: &str| Grant {
            what: what.into(),
            outcome,
            detail: detail.into(),
            remedy: Some("not in the line"),
        };
        let granted = grant("timer slack", Outcome::Granted, "");
        assert_eq!(missing(std::slice::from_ref(&granted), "x.toml"), None);
        let all = [granted, grant("SCHED_FIFO", Outcome::Refused, "no"), grant("lock memory", Outcome::Partly, "some")];
        let line = "real time, not granted: SCHED_FIFO, lock memory (in part). How to get it: ob1 check x.toml --posture, \
                    or run it as a service";
        assert_eq!(missing(&all, "x.toml").as_deref(), Some(line));
        assert!(best(&[], "x.toml").starts_with("real time") && !best(&[], "x.toml").contains('\n'));
    }

    #[test]
    fn every_grant_is_a_line_with_its_remedy() {
        let grants = ask_thread(&station("", "affinity = [1000]").realtime.clone());
        let grants: Vec<GrantStatus> = grants.iter().map(GrantStatus::from).collect();
        assert_eq!(grants.len(), 2);
        let text = text(&grants);
        assert!(text.starts_with("granted  timer slack 1 ns\n") && text.contains("refused"), "{text}");
        assert!(text.contains("\n           = name cores that exist"), "{text}");
    }
}
