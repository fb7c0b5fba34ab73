//! What is shown of a station: the newest answers, and what has changed since the ones before.

use std::collections::VecDeque;

use super::watch::Watched;
use crate::bus::text::Before;
use crate::statistics::{quantile, since};
use ob1_station::access::protocol::{BusStatus, CellValue, CpBuffer, Diagnostic, LinkStatus, ModuleStatus, Status};
use ob1_timing::Timing;
use ob1_timing::snapshot::Spread;

/// Telegrams that are kept.
const TELEGRAMS: usize = 500;

/// The answers to one round of questions.
#[derive(Clone, Debug)]
pub(super) struct Look {
    /// The CPU, its modules, its posture.
    pub(super) status: Status,
    /// The accounts, with all buckets.
    pub(super) timing: Timing,
    /// The CPU's diagnostic buffer, newest first.
    pub(super) diagnostics: Vec<Diagnostic>,
    /// Those of the CPs that have one of their own.
    pub(super) cp_buffers: Vec<CpBuffer>,
    /// The buses with their couplers and slaves.
    pub(super) buses: Vec<BusStatus>,
    /// The links with their connections.
    pub(super) links: Vec<LinkStatus>,
    /// The variable table, or why a cell cannot be read.
    pub(super) values: Vec<(Watched, Result<CellValue, String>)>,
}

/// What is known of the station now, and at the look before.
#[derive(Debug)]
pub(super) struct Data {
    pub(super) now: Look,
    before: Option<Look>,
    /// Lines about what went over the CPs' lines, newest last.
    pub(super) telegrams: VecDeque<String>,
    /// The statements of a block, as they ran.
    pub(super) program: String,
}

impl Data {
    pub(super) fn new(first: Look) -> Self {
        Self { now: first, before: None, telegrams: VecDeque::new(), program: String::new() }
    }

    /// The next round of answers.
    pub(super) fn update(&mut self, look: Look) {
        self.before = Some(std::mem::replace(&mut self.now, look));
    }

    /// What went over a line.
    pub(super) fn heard(&mut self, text: &str) {
        self.telegrams.extend(text.lines().map(str::to_owned));
        let over = self.telegrams.len().saturating_sub(TELEGRAMS);
        self.telegrams.drain(..over);
    }

    /// Time between the two looks in seconds; 0 at the first one, and when somebody has reset the statistics in
    /// between.
    fn seconds(&self) -> f64 {
        let (now, before) = (&self.now.timing, self.before.as_ref().map(|look| &look.timing));
        let same = before.filter(|before| before.since_ns == now.since_ns);
        same.map_or(0.0, |before| now.time_ns.saturating_sub(before.time_ns) as f64 / 1e9)
    }

    /// The buses of the look before, and the seconds since.
    pub(super) fn buses_before(&self) -> Before<'_> {
        Some((&self.before.as_ref()?.buses, self.seconds()))
    }

    /// Scans a second since the look before; `None`: there was none.
    pub(super) fn scan_rate(&self) -> Option<f64> {
        self.rate(|look| look.timing.scans)
    }

    /// The rate a second of a count that only grows.
    fn rate(&self, count: impl Fn(&Look) -> u64) -> Option<f64> {
        let seconds = self.seconds();
        let before = self.before.as_ref().filter(|_| seconds > 0.0)?;
        Some(count(&self.now).saturating_sub(count(before)) as f64 / seconds)
    }

    /// Telegrams a second of a module: sent and received.
    pub(super) fn telegram_rates(&self, module: usize) -> Option<(f64, f64)> {
        let of = |name: &'static str| {
            self.rate(move |look| look.status.modules.get(module).map_or(0, |module| counter(module, name)))
        };
        Some((of("telegrams_sent")?, of("telegrams_received")?))
    }

    /// The buckets of a distribution since the look before; all of them at the first one.
    pub(super) fn newest(&self, of: impl Fn(&Timing) -> &Spread) -> Vec<(u64, u64)> {
        let now = &of(&self.now.timing).buckets;
        match &self.before {
            Some(before) if self.seconds() > 0.0 => since(now, &of(&before.timing).buckets),
            _ => now.clone(),
        }
    }
}

/// A counter of a module.
pub(super) fn counter(module: &ModuleStatus, name: &str) -> u64 {
    module.counters.get(name).copied().unwrap_or(0)
}

/// The rows of the table of times: name, all values, values since the look before.
pub(super) fn rows(data: &Data) -> Vec<(String, Figures, Figures)> {
    let t = &data.now.timing;
    let row = |name: &str, spread: &Spread, newest: Vec<(u64, u64)>| {
        (name.to_owned(), Figures::of(&spread.buckets), Figures::of(&newest))
    };
    let mut rows = vec![
        row("cycle", &t.cycle, data.newest(|t| &t.cycle)),
        row("wake-up", &t.wake, data.newest(|t| &t.wake)),
        row("execution", &t.execution, data.newest(|t| &t.execution)),
        row("inputs", &t.inputs, data.newest(|t| &t.inputs)),
        row("outputs", &t.outputs, data.newest(|t| &t.outputs)),
    ];
    if t.links.count > 0 {
        rows.push(row("links", &t.links, data.newest(|t| &t.links)));
    }
    for (at, ob) in t.obs.iter().enumerate().filter(|(_, ob)| ob.execution.count > 0) {
        let newest = data.newest(|t| t.obs.get(at).map_or(&t.cycle, |ob| &ob.execution));
        rows.push(row(&format!("OB {}", ob.ob), &ob.execution, newest));
    }
    for (at, block) in t.blocks.iter().enumerate().filter(|(_, block)| block.execution.count > 0) {
        let newest = data.newest(|t| t.blocks.get(at).map_or(&t.cycle, |block| &block.execution));
        rows.push(row(&format!("{} {}", block.block, block.name), &block.execution, newest));
    }
    rows
}

/// A distribution in four figures, in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Figures {
    pub(super) count: u64,
    pub(super) p50: u64,
    pub(super) p99: u64,
    pub(super) max: u64,
}

impl Figures {
    pub(super) fn of(buckets: &[(u64, u64)]) -> Self {
        Self {
            count: buckets.iter().map(|(_, n)| n).sum(),
            p50: quantile(buckets, 0.5),
            p99: quantile(buckets, 0.99),
            max: buckets.last().map_or(0, |(value, _)| *value),
        }
    }
}

/// A histogram in `bins` logarithmic bins from the least to the greatest value: the upper end of each in nanoseconds,
/// and its count.
pub(super) fn bins(buckets: &[(u64, u64)], bins: usize) -> Vec<(u64, u64)> {
    let (Some((least, _)), Some((greatest, _))) = (buckets.first(), buckets.last()) else { return Vec::new() };
    let (from, to) = ((*least).max(1) as f64, (*greatest).max(2) as f64 * 1.001);
    let step = ((to / from).ln() / bins.max(1) as f64).max(1e-3);
    let mut all: Vec<(u64, u64)> =
        (1..=bins.max(1)).map(|bin| ((from * (step * bin as f64).exp()) as u64, 0)).collect();
    let last = all.len() - 1;
    for (value, count) in buckets {
        let bin = (((*value).max(1) as f64 / from).ln() / step) as usize;
        all[bin.min(last)].1 += count;
    }
    all
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use ob1_backplane::BufferEntry;
    use serde_json::json;

    /// A station with a CP, after so many seconds and scans.
    pub(in super::super) fn look(seconds: u64, scans: u64) -> Look {
        let spread = |value: u64| {
            json!({"count": scans, "min_ns": 1, "mean_ns": 1.0, "p50_ns": value, "p90_ns": value, "p99_ns": value,
            "p999_ns": value, "p9999_ns": value, "max_ns": value * 9, "buckets": [[value, scans - 1], [value * 9, 1]]})
        };
        let timing = json!({"schema": 1, "time_ns": seconds * 1_000_000_000, "since_ns": 0, "min_cycle_ns": 1_000_000, "missed_rule": "now",
            "late_from_ns": 100_000, "long_from_ns": 1_000_000, "scans": scans, "statements": 1, "overruns": 2, "missed": 3, "watchdogs": 0,
            "cycle": spread(1_000_000), "wake": spread(20_000), "deadlines": spread(20_000), "execution": spread(8_000),
            "inputs": spread(500), "outputs": spread(400),
            "obs": [{"ob": 1, "priority": 1, "runs": scans, "overruns": 0, "execution": spread(7_000), "lateness": spread(20_000)}],
            "blocks": [{"block": "FC 0", "name": "SEND", "execution": spread(90)}],
            "late": {"scans": 1, "pending": 0, "lost": 0, "unexplained_share": 0.5, "classes": {"kernel": {"scans": 1, "time_ns": 5, "worst_ns": 5}},
                "worst": [], "newest": []}});
        let times =
            json!({"count": 1, "min_ns": 1, "mean_ns": 1.0, "p50_ns": 1, "p99_ns": 1, "p999_ns": 1, "max_ns": 1});
        let status = json!({"station": "press", "pid": 42, "state": "RUN", "runtime_ns": seconds * 1_000_000_000, "scans": scans, "statements": 1, "engine": "native",
            "overruns": 2, "missed": 3, "late": 1, "watchdogs": 0, "cycle": times, "wake": times, "execution": times,
            "modules": [{"name": "cp", "type": "cp240", "address": 256, "present": true, "leds": ["PW", "TxD"],
                "driver": {"pid": 43, "starts": 1, "losses": 0, "state": "ready"},
                "counters": {"telegrams_sent": scans / 100, "telegrams_received": scans / 200, "orders_accepted": scans / 100 + 1}}],
            "posture": [], "memory": {"resident_kib": 6500, "peak_kib": 6600, "locked_kib": 0, "threads": 7}});
        let value = CellValue {
            item: "MW10".into(),
            type_name: "WORD".into(),
            value: json!(258),
            hex: "0102".into(),
            text: "258".into(),
        };
        Look {
            status: serde_json::from_value(status).expect("a status"),
            timing: serde_json::from_value(timing).expect("accounts"),
            diagnostics: vec![Diagnostic {
                number: 1,
                time_ns: 5_000_000,
                event: "4302h".into(),
                text: "4302h: RUN".into(),
                ..Diagnostic::default()
            }],
            cp_buffers: vec![CpBuffer {
                name: "cp".into(),
                type_name: "cp341".into(),
                address: 272,
                driver: "ready".into(),
                reason: None,
                entries: (3..8).map(|number| BufferEntry { number, incoming: true, time_ms: 10 }.into()).collect(),
            }],
            buses: vec![crate::bus::text::tests::bus(scans)],
            links: serde_json::from_value(json!([{"name": "panel", "up": true, "connections": [
                {"partner": "10.0.0.7:50000", "name": "03.02", "state": "up", "pdu": 480, "jobs": 17, "errors": 2}]},
                {"name": "page", "up": false}]))
            .expect("links"),
            values: vec![
                (Watched::parse("MW10:hex"), Ok(value)),
                (Watched::parse("DB99.DBW0"), Err("there is no DB 99".into())),
            ],
        }
    }

    #[test]
    fn what_has_changed_is_told_by_second() {
        let mut data = Data::new(look(10, 10_000));
        assert_eq!((data.scan_rate(), data.telegram_rates(0)), (None, None));
        assert_eq!(data.newest(|t| &t.wake), [(20_000, 9_999), (180_000, 1)]);
        data.update(look(12, 12_000));
        assert_eq!((data.scan_rate(), data.telegram_rates(0)), (Some(1000.0), Some((10.0, 5.0))));
        assert_eq!(data.newest(|t| &t.wake), [(20_000, 2_000)]);
        let mut reset = look(13, 500);
        reset.timing.since_ns = 12_500_000_000;
        data.update(reset);
        assert_eq!(data.scan_rate(), None);
        let rows = rows(&data);
        assert_eq!(
            rows.iter().map(|row| row.0.as_str()).collect::<Vec<_>>(),
            ["cycle", "wake-up", "execution", "inputs", "outputs", "OB 1", "FC 0 SEND"]
        );
        assert_eq!(rows[1].1, Figures { count: 500, p50: 20_000, p99: 20_000, max: 180_000 });
    }

    #[test]
    fn bins_hold_every_value() {
        let buckets = [(10, 5), (100, 7), (1_000, 1), (10_000, 2)];
        let four = bins(&buckets, 4);
        assert_eq!(four.iter().map(|(_, n)| n).sum::<u64>(), 15);
        assert_eq!((four[0].1, four[3].1), (5, 2));
        assert!(four.windows(2).all(|pair| pair[0].0 < pair[1].0) && four[3].0 >= 10_000);
        assert_eq!(bins(&[], 4), []);
        assert_eq!(bins(&[(7, 3)], 5).iter().map(|(_, n)| n).sum::<u64>(), 3);
    }

    #[test]
    fn only_the_newest_telegrams_are_kept() {
        let mut data = Data::new(look(1, 100));
        for number in 0..TELEGRAMS + 10 {
            data.heard(&format!("{number}\n"));
        }
        assert_eq!((data.telegrams.len(), data.telegrams.front().map(String::as_str)), (TELEGRAMS, Some("10")));
    }
}
