//! From readings of a station to its report: differences, intervals, ledgers. Pure.

use super::report::{Brief, CellLedger, CpLedger, Interval, Report, Role, percentiles};
use super::verdict::Ended;
use crate::statistics::{quantile, since};
use ob1_station::access::protocol::Status;
use ob1_timing::Timing;
use ob1_timing::snapshot::Spread;

/// What is known of a station at one moment.
#[derive(Clone, Debug)]
pub(super) struct Reading {
    /// When, from the beginning of the measurement.
    pub(super) time_ns: u64,
    /// The accounts, with the buckets of all distributions.
    pub(super) timing: Timing,
    pub(super) status: Status,
    /// Values of the cells, in their order.
    pub(super) cells: Vec<f64>,
    /// Resident memory of the station's process.
    pub(super) rss_bytes: u64,
    /// Open descriptors of the station's process.
    pub(super) fds: u64,
    /// Resident memory of its drivers.
    pub(super) drivers_rss_bytes: u64,
}

/// A measurement under way.
#[derive(Debug)]
pub(super) struct Measurement {
    /// What is known so far; [`super::judge::judge`] completes it.
    pub(super) report: Report,
    first: Reading,
    /// At the end of the last interval.
    before: Reading,
}

impl Measurement {
    /// Begins with a reading that was taken right after the statistics had been reset. `cells` are the names and roles
    /// of its cells.
    pub(super) fn begin(mut report: Report, first: &Reading, cells: &[(String, Role)]) -> Self {
        let cell = |((name, role), value): (&(String, Role), &f64)| CellLedger {
            name: name.clone(),
            role: *role,
            first: *value,
            last: *value,
        };
        report.cells = cells.iter().zip(&first.cells).map(cell).collect();
        report.ended = Ended::UnderWay;
        let mut measurement = Self { report, before: first.clone(), first: first.clone() };
        measurement.update(first);
        measurement
    }

    /// The station when it began.
    pub(super) fn first(&self) -> &Status {
        &self.first.status
    }

    /// The end of an interval.
    pub(super) fn interval(&mut self, reading: Reading) {
        let (now, before) = (&reading.timing, &self.before.timing);
        let more = |now: u64, before: u64| now.saturating_sub(before);
        let done =
            |reading: &Reading| reading.status.modules.iter().filter_map(|m| m.counters.get("telegrams_sent")).sum();
        self.report.intervals.push(Interval {
            end_ns: reading.time_ns,
            scans: more(now.scans, before.scans),
            late: more(now.late.scans, before.late.scans),
            missed: more(now.missed, before.missed),
            cycle: brief(&now.cycle, &before.cycle),
            wake: brief(&now.wake, &before.wake),
            execution: brief(&now.execution, &before.execution),
            rss_bytes: reading.rss_bytes,
            fds: reading.fds,
            drivers_rss_bytes: reading.drivers_rss_bytes,
            done: more(done(&reading), done(&self.before)),
        });
        self.update(&reading);
        self.before = reading;
    }

    /// The last reading, which may come in the middle of an interval: one of less than half its length says nothing
    /// about the trend.
    pub(super) fn finish(&mut self, reading: Reading) {
        if (reading.time_ns - self.before.time_ns) * 2 >= self.report.interval_ns {
            self.interval(reading);
        } else {
            self.update(&reading);
        }
    }

    fn update(&mut self, reading: &Reading) {
        let report = &mut self.report;
        report.measured_ns = reading.time_ns;
        report.reset_outside |= reading.timing.since_ns != self.first.timing.since_ns;
        report.percentiles = percentiles(&reading.timing);
        for (cell, value) in report.cells.iter_mut().zip(&reading.cells) {
            cell.last = *value;
        }
        report.telegrams = ledgers(&self.first.status, &reading.status);
        report.timing = Some(reading.timing.clone());
    }
}

/// What the CPs have counted between two answers.
pub(super) fn ledgers(first: &Status, last: &Status) -> Vec<CpLedger> {
    let cps = last.modules.iter().zip(&first.modules).filter(|(last, _)| last.driver.is_some());
    cps.map(|(last, first)| CpLedger::between(first, last)).collect()
}

/// A distribution since an earlier reading of it.
fn brief(now: &Spread, before: &Spread) -> Brief {
    let new = since(&now.buckets, &before.buckets);
    Brief {
        p50_ns: quantile(&new, 0.5),
        p99_ns: quantile(&new, 0.99),
        max_ns: new.last().map_or(0, |(value, _)| *value),
    }
}
