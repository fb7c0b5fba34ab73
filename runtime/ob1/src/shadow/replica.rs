//! A CPU that runs the program on the inputs that were read.
//!
//! Between two readings the rack has scanned several times, and nobody knows in which of them an input changed. So
//! there are several replicas, each with another answer; what one of them explains is no difference.

use std::collections::VecDeque;

use ob1_cpu::{Cell, Command, OperatingState, Width};
use ob1_model::Area;
use ob1_time::{Instant, Span};

use super::rack::Whole;
use super::subject::{Inputs, Subject};
use crate::testing::bench::Bench;

/// Where the changes between two readings are placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Placing {
    /// All at the second reading.
    Late,
    /// All at the first.
    Early,
    /// One after the other, by their addresses.
    Upwards,
    Downwards,
    /// Those that rise first.
    RisingFirst,
    FallingFirst,
    /// In an order of its own each time: where two such gaps follow each other, a fixed order is right in one of them.
    Mixed(u8),
}

/// Replicas with mixed orders.
const MIXED: u8 = 10;

impl Placing {
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        use Placing::{Downwards, Early, FallingFirst, Late, RisingFirst, Upwards};
        [Late, Early, Upwards, Downwards, RisingFirst, FallingFirst].into_iter().chain((0..MIXED).map(Self::Mixed))
    }
}

/// Something that changes at once: a bit, or a word of an analog module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Change {
    /// Its byte, the bits of it that change, and what they become; a word changes as a whole.
    byte: u32,
    mask: u8,
    to: [u8; 2],
    rises: bool,
    analog: bool,
}

/// What differs between two readings of the inputs, one after the other in the order of `ranges`.
pub(crate) fn changes(ranges: &[Inputs], before: &[u8], after: &[u8]) -> Vec<Change> {
    let mut changes = Vec::new();
    let mut at = 0;
    for range in ranges {
        let (size, len) = (if range.analog { 2 } else { 1 }, range.bytes as usize);
        let of = |bytes: &'_ [u8]| bytes.get(at..at + len).unwrap_or_default().to_vec();
        for (index, (old, new)) in of(before).chunks(size).zip(of(after).chunks(size)).enumerate() {
            let (byte, rises) = (range.first + (index * size) as u32, new > old);
            if range.analog {
                let to = new.first_chunk().copied().unwrap_or_default();
                changes.extend((old != new).then_some(Change { byte, mask: u8::MAX, to, rises, analog: true }));
                continue;
            }
            let [old, new] = [old, new].map(|bytes| bytes.first().copied().unwrap_or_default());
            let bits = (0..8).map(|bit| 1 << bit).filter(|mask| (old ^ new) & mask != 0);
            let to = [new, 0];
            changes.extend(bits.map(|mask| Change { byte, mask, to, rises: new & mask != 0, analog: false }));
        }
        at += len;
    }
    changes
}

/// One of the replicas.
pub(crate) struct Replica {
    bench: Bench,
    placing: Placing,
    /// Values of all cells, at each time at which one has changed.
    log: VecDeque<(Instant, Vec<u32>)>,
}

impl Replica {
    pub(crate) fn new(subject: &Subject, placing: Placing, date: u64) -> Result<Self, String> {
        let mut bench = subject.bench(date)?;
        bench.start(Command::Warm);
        Ok(Self { bench, placing, log: VecDeque::new() })
    }

    /// Scans until `to`, while the inputs change as they do from `from` on.
    pub(crate) fn advance(
        &mut self,
        subject: &Subject,
        changes: &[Change],
        (from, to): (Instant, Instant),
        keep: Span,
    ) {
        let mut order = changes.to_vec();
        match self.placing {
            Placing::Downwards => order.reverse(),
            Placing::RisingFirst => order.sort_by_key(|change| !change.rises),
            Placing::FallingFirst => order.sort_by_key(|change| change.rises),
            Placing::Mixed(number) => {
                let gap = from.nanos().to_le_bytes();
                order.sort_by_cached_key(|change| {
                    let of = change.byte.to_le_bytes().into_iter().chain([change.mask, number]);
                    ob1_process::files::checksum(of.chain(gap))
                });
            }
            Placing::Late | Placing::Early | Placing::Upwards => {}
        }
        let part = to.since(from).nanos() / (order.len() as u64 + 1);
        for (index, change) in order.iter().enumerate() {
            let at = match self.placing {
                Placing::Late => to,
                Placing::Early => from,
                _ => from.saturating_add(Span::from_nanos(part * (index as u64 + 1))),
            };
            self.run_until(subject, at, keep);
            self.change(*change);
        }
        self.run_until(subject, to, keep);
    }

    fn change(&mut self, Change { byte, mask, to, analog, .. }: Change) {
        let byte = byte as usize;
        if analog {
            return self.bench.write_input(byte, &to);
        }
        let old = self.bench.input(byte);
        self.bench.write_input(byte, &[old & !mask | to[0] & mask]);
    }

    fn write_inputs(&mut self, subject: &Subject, inputs: &[u8]) {
        let mut rest = inputs;
        for range in &subject.inputs {
            let (bytes, after) = rest.split_at_checked(range.bytes as usize).unwrap_or_default();
            self.bench.write_input(range.first as usize, bytes);
            rest = after;
        }
    }

    /// Why it has left RUN, if it has.
    pub(crate) fn stopped(&self, subject: &Subject) -> Option<String> {
        let cpu = &self.bench.cpu;
        let entry = cpu.diagnostics().next().filter(|_| cpu.state() != OperatingState::Run)?;
        Some(subject.told(entry))
    }

    fn run_until(&mut self, subject: &Subject, to: Instant, keep: Span) {
        while self.bench.is_due_until(to) {
            self.bench.cycle();
            self.note(subject, keep);
        }
        self.bench.run_until(to);
    }

    fn note(&mut self, subject: &Subject, keep: Span) {
        let now = self.bench.now;
        let cpu = &mut self.bench.cpu;
        let values = subject.cells.iter().map(|watched| cpu.read(watched.item.cell, watched.item.width).unwrap_or(0));
        let mut spare = match self.log.get(1) {
            Some((time, _)) if time.saturating_add(keep) < now => self.log.pop_front().map(|(_, values)| values),
            _ => None,
        }
        .unwrap_or_default();
        spare.clear();
        spare.extend(values);
        if self.log.back().is_none_or(|(_, last)| *last != spare) {
            self.log.push_back((now, spare));
        }
    }

    /// The byte with the clock pulses is the rack's.
    pub(crate) fn set_clock_memory(&mut self, byte: u16, value: u8) {
        let _ = self.bench.cpu.write(Cell::Area(Area::Memory, u32::from(byte) * 8), Width::Byte, value.into());
    }

    /// Whether a cell had this value at some time of the window.
    pub(crate) fn had(&self, cell: usize, value: u32, (from, to): (Instant, Instant)) -> bool {
        let begin = self.log.partition_point(|(time, _)| *time <= from).saturating_sub(1);
        let inside = self.log.iter().skip(begin).take_while(|(time, _)| *time <= to);
        inside.into_iter().any(|(_, values)| values.get(cell) == Some(&value))
    }

    /// The value of a cell now.
    pub(crate) fn value(&self, cell: usize) -> Option<u32> {
        self.log.back().and_then(|(_, values)| values.get(cell).copied())
    }

    /// Becomes as another one is.
    pub(crate) fn take_state_of(&mut self, other: &Self) {
        if self.bench.cpu.take_memory_of(&other.bench.cpu) {
            self.log.clone_from(&other.log);
        }
    }

    /// Becomes as the rack is, as far as that can be read. A timer without a rest has run out if its statement would
    /// start it now; so one scan tells.
    pub(crate) fn load(&mut self, subject: &Subject, whole: &Whole) {
        self.run_until(subject, whole.at, Span::ZERO);
        self.write_inputs(subject, &whole.inputs);
        self.load_memory(subject, whole);
        for (number, time) in &whole.timers {
            let kind = subject.kinds.get(number).copied().unwrap_or(ob1_model::TimerKind::OnDelay);
            self.bench.cpu.adopt_timer(*number, kind, *time);
        }
        self.run_until(subject, whole.at.saturating_add(subject.cycle()), Span::ZERO);
        for (number, _) in whole.timers.iter().filter(|(_, time)| time & 0x0FFF == 0) {
            self.bench.cpu.elapse_timer(*number);
        }
        self.load_memory(subject, whole);
        self.log.clear();
        self.note(subject, Span::ZERO);
    }

    fn load_memory(&mut self, subject: &Subject, whole: &Whole) {
        let cpu = &mut self.bench.cpu;
        let mut bytes = |cell: &dyn Fn(u32) -> Cell, bytes: &[u8]| {
            for (byte, value) in (0u32..).zip(bytes) {
                // What cannot be written (READ_ONLY) has its value.
                let _ = cpu.write(cell(byte * 8), Width::Byte, u32::from(*value));
            }
        };
        bytes(&|bit| Cell::Area(Area::Memory, bit), &whole.memory);
        for (number, data) in &whole.data {
            bytes(&|bit| Cell::Db(*number, bit), data);
        }
        // Latches may lie in outputs.
        for (watched, value) in subject.cells.iter().zip(&whole.values) {
            if let (Cell::Area(Area::Output, _), Some(value)) = (watched.item.cell, value) {
                let _ = cpu.write(watched.item.cell, watched.item.width, *value);
            }
        }
        for (number, count) in &whole.counters {
            let _ = self.bench.cpu.write(Cell::Counter(*number), Width::Word, u32::from(*count));
        }
    }
}
