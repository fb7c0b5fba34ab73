//! `[[trace]]`: what a station records by itself (docs/record.md).

use ob1_time::Span;

use super::findings::{CONTRADICTION, Findings, TWICE, VALUE};
use super::tables::TraceTable;
use super::values::{name, number, time};
use crate::finding::Spot;

/// Files of a trace that are kept, and bytes of each, when the file does not say it.
const KEEP: usize = 4;
const SIZE_MIB: u64 = 100;
/// Traces of a station at most: the CPU has as many places, and one at least is left for `ob1 record`.
const MOST: usize = 7;

/// A trace of the station.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StationTrace {
    /// Its name, which its files begin with.
    pub name: String,
    /// The place of the name.
    pub spot: Spot,
    /// Names of signals.
    pub signals: Vec<String>,
    /// What begins a part; empty: at once.
    pub trigger: String,
    /// History before the trigger.
    pub before: Span,
    /// Length of a part after its trigger; 0: as long as the station runs.
    pub length: Span,
    /// Parts; 0: without end.
    pub repeat: u64,
    /// Bytes of a file at most.
    pub size: u64,
    /// Files that are kept.
    pub keep: usize,
}

pub(super) fn traces(f: &mut Findings<'_>, tables: &[TraceTable]) -> Vec<StationTrace> {
    let mut traces: Vec<StationTrace> = Vec::with_capacity(tables.len());
    for table in tables {
        let named = name(f, "trace", &table.name);
        if traces.iter().any(|trace| trace.name == named) {
            let message = format!("the trace \"{named}\" is there twice");
            f.error(TWICE, table.name.span(), message, "a name for each: its files begin with it");
        }
        let trigger = table.trigger.as_ref().map(|text| text.get_ref().clone()).unwrap_or_default();
        if let (Some(before), true) = (&table.before, trigger.is_empty()) {
            let remedy = "say what begins the recording: trigger = \"late\"";
            f.error(CONTRADICTION, before.span(), "`before` without a trigger", remedy);
        }
        if traces.len() == MOST {
            let message = format!("more than {MOST} traces");
            f.error(VALUE, table.name.span(), message, "put signals together, or record with `ob1 record`");
        }
        let size: u64 = number(f, "size", table.size.as_ref(), 1..=1_048_576, SIZE_MIB);
        traces.push(StationTrace {
            name: named,
            spot: f.spot(table.name.span()),
            signals: table.signals.iter().map(|signal| signal.get_ref().clone()).collect(),
            trigger,
            before: time(f, table.before.as_ref(), Span::ZERO),
            length: time(f, table.length.as_ref(), Span::ZERO),
            repeat: number(f, "repeat", table.repeat.as_ref(), 0..=i64::from(u32::MAX), 0),
            size: size << 20,
            keep: number(f, "keep", table.keep.as_ref(), 1..=10_000, KEEP),
        });
    }
    traces
}
