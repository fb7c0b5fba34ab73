//! The late scans so far: by class, and those worth keeping one by one.

use std::collections::BTreeMap;

use ob1_cpu::ScanRecord;
use ob1_time::Instant;

use super::cause::{Cause, Class, Evidence};
use super::snapshot::{ClassTotal, LateEntry, LateReport};

/// Longest and newest entries that are kept, each.
const KEPT: usize = 32;

#[derive(Debug, Default)]
pub(super) struct Ledger {
    classes: BTreeMap<Class, ClassTotal>,
    worst: Vec<LateEntry>,
    newest: Vec<LateEntry>,
    unexplained: Vec<LateEntry>,
    /// Those in which the watchdog expired.
    watchdogs: Vec<LateEntry>,
    /// Late scans that came too fast to be recorded.
    lost: u64,
}

impl Ledger {
    pub(super) fn enter(&mut self, record: &ScanRecord, evidence: &Evidence, cause: Cause) {
        let total = self.classes.entry(cause.class).or_default();
        total.scans += 1;
        total.time_ns = total.time_ns.saturating_add(cause.size.nanos());
        total.worst_ns = total.worst_ns.max(cause.size.nanos());
        let entry = LateEntry::new(record, evidence, cause);
        keep(&mut self.newest, &entry);
        if entry.class == Class::Unexplained {
            keep(&mut self.unexplained, &entry);
        }
        if record.flags.watchdog {
            keep(&mut self.watchdogs, &entry);
        }
        keep_worst(&mut self.worst, entry);
    }

    /// Of those that are kept the ones after this scan.
    pub(super) fn after(&self, scan: u64) -> Vec<LateEntry> {
        self.newest.iter().filter(|entry| entry.scan > scan).cloned().collect()
    }

    /// Why the scan was late in which the watchdog expired at this time, if that has been explained.
    pub(super) fn watchdog(&self, expired: Instant) -> Option<&LateEntry> {
        self.watchdogs.iter().rev().find(|entry| {
            let start = entry.planned_ns + entry.lateness_ns;
            (start..=start + entry.execution_ns).contains(&expired.nanos())
        })
    }

    pub(super) fn lose(&mut self, count: u64) {
        self.lost += count;
    }

    /// `late`: late scans by the accounts; those that are not explained yet are `pending`.
    pub(super) fn report(&self, late: u64) -> LateReport {
        let told: u64 = self.classes.values().map(|total| total.scans).sum();
        LateReport {
            scans: late,
            pending: late.saturating_sub(told + self.lost),
            lost: self.lost,
            unexplained_share: unexplained_share(&self.classes),
            classes: Class::ALL.iter().filter_map(|class| Some((*class, *self.classes.get(class)?))).collect(),
            worst: self.worst.clone(),
            newest: self.newest.clone(),
            unexplained: self.unexplained.clone(),
        }
    }
}

/// Share of the explained late scans that nothing explains.
fn unexplained_share(classes: &BTreeMap<Class, ClassTotal>) -> f64 {
    let told: u64 = classes.values().map(|total| total.scans).sum();
    let unexplained = classes.get(&Class::Unexplained).map_or(0, |total| total.scans);
    if told == 0 { 0.0 } else { unexplained as f64 / told as f64 }
}

impl LateReport {
    /// Takes over the late scans of another station. Of the newest, which have no order between stations, the last
    /// ones stay.
    pub(super) fn merge(&mut self, other: &Self) {
        self.scans = self.scans.saturating_add(other.scans);
        self.pending = self.pending.saturating_add(other.pending);
        self.lost = self.lost.saturating_add(other.lost);
        for (class, more) in &other.classes {
            let total = self.classes.entry(*class).or_default();
            total.scans = total.scans.saturating_add(more.scans);
            total.time_ns = total.time_ns.saturating_add(more.time_ns);
            total.worst_ns = total.worst_ns.max(more.worst_ns);
        }
        self.unexplained_share = unexplained_share(&self.classes);
        other.worst.iter().for_each(|entry| keep_worst(&mut self.worst, entry.clone()));
        other.newest.iter().for_each(|entry| keep(&mut self.newest, entry));
        other.unexplained.iter().for_each(|entry| keep(&mut self.unexplained, entry));
    }
}

/// Enters an entry if it is one of the longest.
fn keep_worst(worst: &mut Vec<LateEntry>, entry: LateEntry) {
    let at = worst.partition_point(|kept| kept.size_ns >= entry.size_ns);
    if at < KEPT {
        worst.insert(at, entry);
        worst.truncate(KEPT);
    }
}

/// Appends the entry; the oldest is dropped.
fn keep(kept: &mut Vec<LateEntry>, entry: &LateEntry) {
    if kept.len() == KEPT {
        kept.remove(0);
    }
    kept.push(entry.clone());
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_cpu::Flags;
    use ob1_time::Span;

    const fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    #[test]
    fn totals_and_the_longest() {
        let mut ledger = Ledger::default();
        for scan in 1..=100 {
            let class = if scan % 4 == 0 { Class::Unexplained } else { Class::Program };
            let record = ScanRecord { scan, ..ScanRecord::default() };
            let size = Span::from_nanos((scan * 37) % 101);
            ledger.enter(&record, &Evidence::default(), Cause { class, what: String::new(), size });
        }
        let flags = Flags { watchdog: true, ..Flags::default() };
        let record =
            ScanRecord { scan: 100, planned: at(500), start: at(600), end: at(900), flags, ..ScanRecord::default() };
        let cause = Cause { class: Class::Kernel, what: "no core".into(), size: Span::from_nanos(300) };
        let mut expired = Ledger::default();
        expired.enter(&record, &Evidence::default(), cause);
        let found = |time| expired.watchdog(at(time)).map(|entry| entry.what.as_str());
        assert_eq!([found(599), found(600), found(900), found(901)], [None, Some("no core"), Some("no core"), None]);
        assert!(ledger.watchdog(Instant::START).is_none(), "scans without a watchdog");
        ledger.lose(3);
        let report = ledger.report(105);
        assert_eq!((report.scans, report.pending, report.lost), (105, 2, 3));
        assert!((report.unexplained_share - 0.25).abs() < 1e-9);
        assert_eq!(report.classes[&Class::Program].scans, 75);
        assert_eq!((report.newest.len(), report.newest[KEPT - 1].scan), (KEPT, 100));
        let unexplained: Vec<u64> = report.unexplained.iter().map(|entry| entry.scan).collect();
        assert_eq!(unexplained, (1..=25).map(|fourth| fourth * 4).collect::<Vec<_>>());
        let sizes: Vec<u64> = report.worst.iter().map(|entry| entry.size_ns).collect();
        assert!(sizes.is_sorted_by(|a, b| a >= b) && sizes[0] == 100 && sizes.len() == KEPT, "{sizes:?}");
    }
}
