//! A recording as a trace for Perfetto (docs/record.md says which tracks there are).
//!
//! One packet sequence, on CLOCK_MONOTONIC. Packets come in the order of their times: what happened is known a little
//! later than the rows around it, so packets wait until nothing older can come.

use std::collections::BTreeMap;
use std::io::{self, Write};

use ob1_access::{Item, Reading};
use ob1_model::OperatingState;
use ob1_record::{Entry, Event, Head, Row, number};
use ob1_time::Instant;
use ob1_timing::snapshot::LateEntry;
use prost::Message as _;

use super::lines::{Lines, ORDERS, Told};
use super::proto::{
    BEGIN, BOOTTIME, BY_RANK, CLEARED, COUNTER, Clock, ClockSnapshot, CounterDescriptor, DebugAnnotation, END, INSTANT,
    InternedData, InternedName, MONOTONIC, NEEDS, ProcessDescriptor, REALTIME, Trace, TracePacket, TracePacketDefaults,
    TrackDescriptor, TrackEvent,
};

/// The only sequence.
const SEQUENCE: u32 = 1;
/// The track of the station, above all others.
const STATION: u64 = 1;
/// Older than the newest row by this, in nanoseconds, nothing comes any more.
const WAIT: u64 = 10_000_000_000;

/// Names that were sent once and have a number since.
#[derive(Default)]
struct Interned {
    numbers: BTreeMap<String, u64>,
    new: Vec<InternedName>,
}

impl Interned {
    fn number(&mut self, name: &str) -> u64 {
        if let Some(number) = self.numbers.get(name) {
            return *number;
        }
        let number = self.numbers.len() as u64 + 1;
        self.numbers.insert(name.to_owned(), number);
        self.new.push(InternedName { iid: Some(number), name: Some(name.to_owned()) });
        number
    }
}

/// Writes a trace.
pub(super) struct Perfetto<W: Write> {
    out: W,
    /// CLOCK_MONOTONIC when the clock of the recording showed 0.
    zero: u64,
    items: Vec<Item>,
    /// The tracks so far, by parent and name.
    tracks: BTreeMap<(u64, String), u64>,
    annotations: Interned,
    names: Interned,
    /// Packets that wait, by their time and their turn among those of the same time.
    waiting: BTreeMap<(u64, u64), TrackEvent>,
    turn: u64,
    newest: u64,
    signals: Vec<u64>,
    values: Vec<Option<u32>>,
    /// The last scan that has its slices.
    scan: Option<u64>,
    lost: u64,
    state: Option<OperatingState>,
    lines: Lines,
}

impl<W: Write> Perfetto<W> {
    /// Begins a trace with its clocks and the tracks of the signals.
    pub(super) fn new(out: W, head: &Head) -> io::Result<Self> {
        let items = head.items().map_err(|why| io::Error::new(io::ErrorKind::InvalidData, why))?;
        let mut this = Self {
            out,
            zero: head.clocks.monotonic_ns,
            values: vec![None; items.len()],
            items,
            tracks: BTreeMap::new(),
            annotations: Interned::default(),
            names: Interned::default(),
            waiting: BTreeMap::new(),
            turn: 0,
            newest: 0,
            signals: Vec::new(),
            scan: None,
            lost: 0,
            state: None,
            lines: Lines::new(head.clocks.unix_ns),
        };
        let at = |clock_id, zero: u64| Clock { clock_id: Some(clock_id), timestamp: Some(zero + head.begun_ns) };
        let clocks = vec![
            at(MONOTONIC, head.clocks.monotonic_ns),
            at(BOOTTIME, head.clocks.boottime_ns),
            at(REALTIME, head.clocks.unix_ns),
        ];
        this.send(TracePacket {
            sequence_flags: Some(CLEARED),
            trace_packet_defaults: Some(TracePacketDefaults { timestamp_clock_id: Some(MONOTONIC) }),
            clock_snapshot: Some(ClockSnapshot { clocks, primary_trace_clock: Some(MONOTONIC as i32) }),
            ..TracePacket::default()
        })?;
        let process = ProcessDescriptor {
            pid: Some(head.pid.max(1) as i32),
            process_name: Some(format!("ob1 station {}", head.station)),
        };
        let station = TrackDescriptor {
            uuid: Some(STATION),
            process: Some(process),
            child_ordering: Some(BY_RANK),
            ..TrackDescriptor::default()
        };
        this.send(TracePacket { track_descriptor: Some(station), ..TracePacket::default() })?;
        let (scan, signals) = (this.track(STATION, "scan")?, this.track(STATION, "signals")?);
        for part in ["inputs", "outputs"] {
            this.track(scan, part)?;
        }
        for at in 0..this.items.len() {
            let (name, unit) = (this.items[at].name.clone(), this.items[at].ty.name());
            let track = this.new_track(signals, &name, Some(unit))?;
            this.signals.push(track);
        }
        Ok(this)
    }

    /// The track with this name below another one; made when it is new.
    fn track(&mut self, parent: u64, name: &str) -> io::Result<u64> {
        match self.tracks.get(&(parent, name.to_owned())) {
            Some(track) => Ok(*track),
            None => {
                let track = self.new_track(parent, name, None)?;
                self.tracks.insert((parent, name.to_owned()), track);
                Ok(track)
            }
        }
    }

    /// `unit`: that of a counter.
    fn new_track(&mut self, parent: u64, name: &str, unit: Option<&str>) -> io::Result<u64> {
        let uuid = STATION + 1 + (self.tracks.len() + self.signals.len()) as u64;
        let descriptor = TrackDescriptor {
            uuid: Some(uuid),
            name: Some(name.to_owned()),
            parent_uuid: Some(parent),
            child_ordering: Some(BY_RANK),
            sibling_order_rank: Some(uuid as i32),
            counter: unit.map(|unit| CounterDescriptor { unit_name: Some(unit.into()) }),
            ..TrackDescriptor::default()
        };
        self.send(TracePacket { track_descriptor: Some(descriptor), ..TracePacket::default() })?;
        Ok(uuid)
    }

    fn send(&mut self, packet: TracePacket) -> io::Result<()> {
        let packet = TracePacket { trusted_packet_sequence_id: Some(SEQUENCE), ..packet };
        self.out.write_all(&Trace { packet: vec![packet] }.encode_to_vec())
    }

    fn wait(&mut self, time: Instant, event: TrackEvent) {
        self.turn += 1;
        self.waiting.insert((time.nanos(), self.turn), event);
    }

    fn slice(&mut self, track: u64, name: &str, from: Instant, to: Instant, notes: Vec<DebugAnnotation>) {
        self.event(track, BEGIN, Some(name), from, notes);
        self.event(track, END, None, to.max(from), Vec::new());
    }

    fn event(&mut self, track: u64, kind: i32, name: Option<&str>, at: Instant, notes: Vec<DebugAnnotation>) {
        let event = TrackEvent {
            r#type: Some(kind),
            track_uuid: Some(track),
            name: name.map(str::to_owned),
            debug_annotations: notes,
            ..TrackEvent::default()
        };
        self.wait(at, event);
    }

    fn number(&mut self, name: &str, value: u64) -> DebugAnnotation {
        let name_iid = Some(self.annotations.number(name));
        DebugAnnotation { name_iid, uint_value: Some(value), ..DebugAnnotation::default() }
    }

    fn text(&mut self, name: &str, value: &str) -> DebugAnnotation {
        let name_iid = Some(self.annotations.number(name));
        DebugAnnotation { name_iid, string_value: Some(value.to_owned()), ..DebugAnnotation::default() }
    }

    /// Takes what was recorded.
    pub(super) fn take(&mut self, entry: &Entry) -> io::Result<()> {
        match entry {
            Entry::Row(row) => {
                self.row(row)?;
                self.newest = self.newest.max(row.time.nanos());
                self.release(self.newest.saturating_sub(WAIT))?;
            }
            Entry::Run(run) => {
                let track = self.track(STATION, &format!("OB {}", run.ob))?;
                let own = self.number("own_ns", run.own.nanos());
                self.slice(track, &format!("OB {}", run.ob), run.began, run.began + run.whole, vec![own]);
            }
            Entry::Event(event) => self.happened(event)?,
            Entry::Line(number, record) => {
                let told = self.lines.read(*number, record);
                self.told(told)?;
            }
        }
        Ok(())
    }

    fn row(&mut self, row: &Row) -> io::Result<()> {
        let scan = &row.scan;
        if scan.number > 0 && self.scan != Some(scan.number) {
            self.scan = Some(scan.number);
            let track = self.track(STATION, "scan")?;
            let end = scan.start + scan.execution;
            let notes = vec![
                self.number("number", scan.number),
                self.number("lateness_ns", scan.lateness.nanos()),
                self.number("program_ns", scan.program.nanos()),
                self.number("plugins_ns", scan.plugins.nanos()),
                self.number("statements", scan.statements),
            ];
            self.slice(track, "scan", scan.start, end, notes);
            let (inputs, outputs) = (self.track(track, "inputs")?, self.track(track, "outputs")?);
            self.slice(inputs, "inputs", scan.start, scan.start + scan.inputs, Vec::new());
            self.slice(outputs, "outputs", end.saturating_sub(scan.outputs), end, Vec::new());
        }
        if self.state != Some(row.state) {
            let track = self.track(STATION, "operating state")?;
            if self.state.is_some() {
                self.event(track, END, None, row.time, Vec::new());
            }
            self.state = Some(row.state);
            self.event(track, BEGIN, Some(row.state.name()), row.time, Vec::new());
        }
        if row.lost > self.lost {
            let track = self.track(STATION, "recording")?;
            let count = self.number("rows", row.lost - self.lost);
            self.lost = row.lost;
            self.event(track, INSTANT, Some("rows lost"), row.time, vec![count]);
        }
        for at in 0..self.items.len() {
            let bits = row.bits(at);
            if bits != self.values[at] {
                self.values[at] = bits;
                self.count(at, bits, row.time);
            }
        }
        Ok(())
    }

    /// A new value of a signal; one that is not there any more has none.
    fn count(&mut self, at: usize, bits: Option<u32>, time: Instant) {
        let (Some(bits), item) = (bits, &self.items[at]) else { return };
        let mut event =
            TrackEvent { r#type: Some(COUNTER), track_uuid: Some(self.signals[at]), ..TrackEvent::default() };
        match (item.reading, number(item, bits)) {
            (Reading::Real, value) => event.double_counter_value = Some(value),
            (_, value) => event.counter_value = Some(value as i64),
        }
        self.wait(time, event);
    }

    fn happened(&mut self, event: &Event) -> io::Result<()> {
        let time = Instant::from_nanos(event.time_ns());
        match event {
            Event::Part { number, why, .. } => {
                let (track, number) = (self.track(STATION, "recording")?, self.number("part", *number));
                let why = self.text("trigger", why);
                self.event(track, INSTANT, Some("part"), time, vec![number, why]);
                // A part begins with the values it has, whatever they were before.
                self.values.fill(None);
            }
            Event::Complete { number, .. } => {
                let (track, number) = (self.track(STATION, "recording")?, self.number("part", *number));
                self.event(track, INSTANT, Some("complete"), time, vec![number]);
            }
            Event::End { why, rows, lost, .. } => {
                let track = self.track(STATION, "recording")?;
                let notes = vec![self.text("why", why), self.number("rows", *rows), self.number("lost", *lost)];
                self.event(track, INSTANT, Some("end"), time, notes);
            }
            Event::Diagnosis { number, text, .. } => {
                let (track, notes) = (self.track(STATION, "diagnostic buffer")?, vec![self.text("text", text)]);
                self.event(track, INSTANT, Some(number), time, notes);
            }
            Event::Process { name, up, .. } => {
                let track = self.track(STATION, "drivers and links")?;
                let what = if *up { "is up" } else { "is gone" };
                self.event(track, INSTANT, Some(&format!("{name} {what}")), time, Vec::new());
            }
            Event::Order { module, took_ns, what, status, .. } => {
                let track = self.track(STATION, &format!("{module} orders"))?;
                let (notes, took) = (vec![self.number("status", (*status).into())], *took_ns);
                match took {
                    0 => self.event(track, INSTANT, Some(what), time, notes),
                    took => self.slice(track, what, time, time + ob1_time::Span::from_nanos(took), notes),
                }
            }
            Event::Late(late) => self.late(late)?,
        }
        Ok(())
    }

    /// A late scan: at its deadline, with its cause and what the kernel has counted.
    fn late(&mut self, late: &LateEntry) -> io::Result<()> {
        let track = self.track(STATION, "late scans")?;
        let mut notes = vec![
            self.number("scan", late.scan),
            self.number("lateness_ns", late.lateness_ns),
            self.number("execution_ns", late.execution_ns),
            self.text("what", &late.what),
            self.number("size_ns", late.size_ns),
        ];
        // What is evidence can be serialized.
        let evidence = serde_json::to_value(late.evidence).unwrap_or_default();
        self.evidence("", &evidence, &mut notes);
        self.event(track, INSTANT, Some(late.class.name()), Instant::from_nanos(late.planned_ns), notes);
        Ok(())
    }

    fn evidence(&mut self, name: &str, value: &serde_json::Value, notes: &mut Vec<DebugAnnotation>) {
        match value {
            serde_json::Value::Object(fields) => {
                for (field, value) in fields {
                    let name = if name.is_empty() { format!("evidence.{field}") } else { format!("{name}.{field}") };
                    self.evidence(&name, value, notes);
                }
            }
            serde_json::Value::Bool(bit) => {
                let name_iid = Some(self.annotations.number(name));
                notes.push(DebugAnnotation { name_iid, bool_value: Some(*bit), ..DebugAnnotation::default() });
            }
            value => notes.extend(value.as_u64().map(|number| self.number(name, number))),
        }
    }

    /// What was on a line: telegrams are slices, characters and remarks are instants.
    fn told(&mut self, told: Vec<Told>) -> io::Result<()> {
        for told in told {
            let track = match told.way {
                ORDERS => self.track(STATION, &format!("{} orders", told.line))?,
                way => {
                    let line = self.track(STATION, &format!("{} line", told.line))?;
                    self.track(line, way)?
                }
            };
            let notes = if told.bytes.is_empty() { Vec::new() } else { vec![self.text("bytes", &told.bytes)] };
            if told.is_telegram {
                self.slice(track, &told.text, told.begin, told.end, notes);
            } else {
                self.event(track, INSTANT, Some(&told.text), told.begin, notes);
            }
        }
        Ok(())
    }

    /// Writes what waits and is older than this.
    fn release(&mut self, until: u64) -> io::Result<()> {
        while let Some(first) = self.waiting.first_entry().filter(|first| first.key().0 < until) {
            let ((time, _), mut event) = first.remove_entry();
            if let Some(name) = event.name.take() {
                event.name_iid = Some(self.names.number(&name));
            }
            let interned = InternedData {
                event_names: std::mem::take(&mut self.names.new),
                debug_annotation_names: std::mem::take(&mut self.annotations.new),
            };
            let is_new = !interned.event_names.is_empty() || !interned.debug_annotation_names.is_empty();
            self.send(TracePacket {
                timestamp: Some(self.zero + time),
                sequence_flags: Some(NEEDS),
                interned_data: is_new.then_some(interned),
                track_event: Some(Box::new(event)),
                ..TracePacket::default()
            })?;
        }
        Ok(())
    }

    /// Writes what waits still.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        let told = self.lines.finish();
        self.told(told)?;
        if self.state.take().is_some() {
            let track = self.track(STATION, "operating state")?;
            self.event(track, END, None, Instant::from_nanos(self.newest), Vec::new());
        }
        self.release(u64::MAX)?;
        self.out.flush()
    }
}
