//! Settings of the system that affect wake-up times, whatever this process asks for: facts, what they cost, and what
//! would change them.

use std::fs::{self, File};
use std::io::Write as _;

use crate::posture::{Grant, Outcome, Posture};

const DMA_LATENCY: &str = "/dev/cpu_dma_latency";

/// A file of one line, without the line end.
fn line(path: &str) -> Option<String> {
    fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

fn noted(what: &str, detail: String, remedy: Option<&'static str>) -> Grant {
    Grant { what: what.into(), outcome: Outcome::Noted, detail, remedy }
}

fn costs(what: &str, detail: String, remedy: &'static str) -> Grant {
    Grant { what: what.into(), outcome: Outcome::Costs, detail, remedy: Some(remedy) }
}

/// The facts, for a scan on these cores (empty: any).
#[must_use]
pub fn system_facts(cores: &[usize]) -> Posture {
    let core = cores.first().copied().unwrap_or(0);
    let governor = line(&format!("/sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor"));
    let fair = line(&format!("/sys/kernel/debug/sched/fair_server/cpu{core}/runtime"));
    let clock = line("/sys/devices/system/clocksource/clocksource0/current_clocksource");
    let realtime = line("/sys/kernel/realtime").is_some_and(|text| text == "1");
    let version = line("/proc/version").unwrap_or_default();
    let virtual_machine = line("/proc/cpuinfo").is_some_and(|text| text.contains(" hypervisor"));
    vec![
        kernel(realtime, &version),
        clock_source(clock.as_deref()),
        throttle(line("/proc/sys/kernel/sched_rt_runtime_us").and_then(|text| text.parse().ok())),
        fair_server(fair.and_then(|text| text.parse().ok())),
        frequency(governor.as_deref()),
        isolation(cores, &isolated_cores()),
        host(virtual_machine),
    ]
}

/// Cores the kernel keeps free of everything that is not put there (`isolcpus=`).
#[must_use]
pub fn isolated_cores() -> Vec<usize> {
    line("/sys/devices/system/cpu/isolated").map(|text| core_list(&text)).unwrap_or_default()
}

/// A list of cores as the kernel writes it: `1,3-5`.
fn core_list(text: &str) -> Vec<usize> {
    let number = |text: &str| text.trim().parse::<usize>().ok();
    let mut cores = Vec::new();
    for part in text.split(',') {
        match part.split_once('-') {
            Some((first, last)) => cores.extend(number(first).zip(number(last)).into_iter().flat_map(|(a, b)| a..=b)),
            None => cores.extend(number(part)),
        }
    }
    cores
}

fn kernel(realtime: bool, version: &str) -> Grant {
    const REMEDY: &str = "a kernel with PREEMPT_RT, or boot with preempt=full";
    if realtime {
        return noted("kernel", "PREEMPT_RT".into(), None);
    }
    let kind = ["PREEMPT_DYNAMIC", "PREEMPT_LAZY", "PREEMPT"].into_iter().find(|kind| version.contains(kind));
    costs("kernel", format!("{}: a wake-up can wait for code of the kernel", kind.unwrap_or("no preemption")), REMEDY)
}

fn clock_source(name: Option<&str>) -> Grant {
    match name {
        Some("tsc" | "kvm-clock" | "arch_sys_counter") => noted("clock source", name.unwrap_or_default().into(), None),
        Some(other) => costs(
            "clock source",
            format!("{other}: each reading of the clock is a system call"),
            "boot with tsc=reliable, or: echo tsc > /sys/devices/system/clocksource/clocksource0/current_clocksource",
        ),
        None => noted("clock source", "unknown".into(), None),
    }
}

fn throttle(runtime_us: Option<i64>) -> Grant {
    match runtime_us {
        Some(-1) => noted("real-time throttling", "off".into(), None),
        Some(us) => noted(
            "real-time throttling",
            format!("SCHED_FIFO threads get {:.0} ms of each second at most", us as f64 / 1000.0),
            Some("only with an isolated core: sysctl kernel.sched_rt_runtime_us=-1"),
        ),
        None => noted("real-time throttling", "unknown".into(), None),
    }
}

fn fair_server(runtime_ns: Option<u64>) -> Grant {
    match runtime_ns {
        Some(0) => noted("fair server", "off".into(), None),
        Some(ns) => noted(
            "fair server",
            format!("takes up to {:.0} ms of each second from SCHED_FIFO when others starve", ns as f64 / 1e6),
            Some("only with an isolated core: echo 0 > /sys/kernel/debug/sched/fair_server/cpuN/runtime"),
        ),
        None => noted("fair server", "unknown: debugfs is not there or cannot be read".into(), None),
    }
}

fn frequency(governor: Option<&str>) -> Grant {
    match governor {
        Some("performance") => noted("frequency governor", "performance".into(), None),
        Some(other) => costs(
            "frequency governor",
            format!("{other}: the core slows down between two scans"),
            "cpupower frequency-set -g performance",
        ),
        None => noted("frequency governor", "none: this kernel does not scale the frequency".into(), None),
    }
}

fn isolation(cores: &[usize], isolated: &[usize]) -> Grant {
    let ours: Vec<usize> = cores.iter().copied().filter(|core| isolated.contains(core)).collect();
    if !cores.is_empty() && ours.len() == cores.len() {
        return noted("isolated cores", format!("{ours:?}"), None);
    }
    let detail = if cores.is_empty() { "the scan is bound to none" } else { "other work runs on the scan's cores too" };
    costs("isolated cores", detail.into(), "boot with isolcpus=N nohz_full=N rcu_nocbs=N, and name N in affinity")
}

fn host(virtual_machine: bool) -> Grant {
    if virtual_machine {
        return costs(
            "host",
            "a virtual machine: its host can take the core away, and the counters here may not show it".into(),
            "pin the virtual processors on the host, or run on bare metal",
        );
    }
    noted("host", "bare metal".into(), None)
}

/// Keeps idle cores from sleeping deeply as long as the file is held: `/dev/cpu_dma_latency` at 0.
#[must_use]
pub fn keep_awake() -> (Grant, Option<File>) {
    let what = "no deep sleep of idle cores (/dev/cpu_dma_latency)".to_owned();
    let held = File::options().write(true).open(DMA_LATENCY).and_then(|mut file| {
        file.write_all(&0i32.to_ne_bytes())?;
        Ok(file)
    });
    match held {
        Ok(file) => (Grant { what, outcome: Outcome::Granted, detail: String::new(), remedy: None }, Some(file)),
        Err(error) => {
            let remedy = Some("start as root, or: chmod 660 and chgrp /dev/cpu_dma_latency to a group of this user");
            (Grant { what, outcome: Outcome::Refused, detail: error.to_string(), remedy }, None)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_cores() {
        assert_eq!((core_list("1,3-5\n"), core_list("")), (vec![1, 3, 4, 5], vec![]));
        assert_eq!(core_list("2-x,7"), [7]);
    }

    #[test]
    fn what_costs_something_names_a_remedy() {
        let facts = system_facts(&[0]);
        assert_eq!(facts.len(), 7);
        for fact in facts.iter().filter(|fact| fact.outcome == Outcome::Costs) {
            assert!(fact.remedy.is_some() && !fact.detail.is_empty(), "{fact:?}");
        }
        assert_eq!(isolation(&[2, 3], &[1, 2, 3]).outcome, Outcome::Noted);
        assert_eq!(isolation(&[0, 2], &[1, 2, 3]).outcome, Outcome::Costs);
        assert_eq!(clock_source(Some("hpet")).outcome, Outcome::Costs);
        assert_eq!(frequency(Some("powersave")).outcome, Outcome::Costs);
        assert_eq!(kernel(true, "").outcome, Outcome::Noted);
        assert!(throttle(Some(950_000)).detail.contains("950 ms"));
    }

    #[test]
    fn idle_states_are_held_or_refused_with_a_remedy() {
        let (grant, file) = keep_awake();
        assert_eq!(file.is_some(), grant.outcome == Outcome::Granted, "{grant:?}");
        assert_eq!(file.is_some(), grant.remedy.is_none(), "{grant:?}");
    }
}
