//! From the rows of a CPU to the blocks of a file: history, trigger, length, parts.
//!
//! Its memory for rows is made at its start. It knows no file and no clock.

use std::collections::VecDeque;

use ob1_cpu::{ObRun, Rows};
use ob1_time::Instant;

use crate::trigger::Watching;
use crate::{Event, Row, Settings, Writer};

/// Bytes of rows that wait for a block at most.
const BLOCK: usize = 64 * 1024;
/// Runs of organization blocks that are kept for each row of history.
const RUNS: usize = 4;
/// Events that are kept before a trigger.
const EVENTS: usize = 256;

/// What became of the rows that were taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It goes on.
    More,
    /// The last part is complete.
    Complete,
}

/// A recording under way.
#[derive(Debug)]
pub struct Capture {
    settings: Settings,
    watching: Watching,
    writer: Writer,
    /// Rows before the trigger, and rows to be used again.
    history: VecDeque<Row>,
    spare: Vec<Row>,
    runs: VecDeque<ObRun>,
    events: VecDeque<Event>,
    bytes: Vec<u8>,
    /// The part that is being written: when its trigger fired.
    part: Option<Instant>,
    /// From the history of the newest part to its end: what happened in it may become known later.
    span: Option<(Instant, Instant)>,
    parts: u64,
    rows: u64,
    lost: u64,
    /// Rows that were taken, and found no room with whoever writes them.
    dropped: u64,
}

impl Capture {
    /// Begins; the memory for the history is made here.
    pub fn new(settings: Settings) -> Self {
        let signals = settings.signals.len();
        let spare = std::iter::repeat_with(|| Row { values: Vec::with_capacity(signals), ..Row::default() });
        Self {
            watching: Watching::new(settings.trigger.clone()),
            writer: Writer::default(),
            history: VecDeque::with_capacity(settings.history),
            runs: VecDeque::with_capacity(settings.history * RUNS),
            spare: spare.take(settings.history + 1).collect(),
            events: VecDeque::with_capacity(EVENTS),
            bytes: Vec::with_capacity(8),
            part: None,
            span: None,
            parts: 0,
            rows: 0,
            lost: 0,
            dropped: 0,
            settings,
        }
    }

    /// Rows written, and rows lost.
    pub const fn count(&self) -> (u64, u64) {
        (self.rows, self.lost + self.dropped)
    }

    /// How many parts have begun.
    pub const fn parts(&self) -> u64 {
        self.parts
    }

    /// A part is being written.
    pub const fn is_open(&self) -> bool {
        self.part.is_some()
    }

    /// Takes an event: it is written while a part is, and may begin one.
    pub fn event(&mut self, event: Event, out: &mut Vec<u8>) {
        self.watching.event(&event);
        let time = Instant::from_nanos(event.time_ns());
        if self.span.is_some_and(|(from, to)| (from..=to).contains(&time)) {
            self.writer.event(event, out);
        } else if self.part.is_none() {
            if self.events.len() == EVENTS {
                self.events.pop_front();
            }
            self.events.push_back(event);
        }
    }

    /// Takes all rows and runs there are. `room`: whether another block finds room with whoever writes; rows that do
    /// not are counted as lost.
    pub fn take(&mut self, rows: &mut Rows, out: &mut Vec<u8>, room: &dyn Fn(usize) -> bool) -> Taken {
        let mut row = self.spare.pop().unwrap_or_default();
        let mut taken = Taken::More;
        while taken == Taken::More
            && rows.take(|found| row.set(&found, &self.settings.items, &mut self.bytes)).is_some()
        {
            let complete;
            (row, complete) = self.row(row, out, room(out.len()));
            if complete {
                taken = Taken::Complete;
            }
            while let Some(run) = rows.take_run() {
                self.run(run);
            }
        }
        self.spare.push(row);
        taken
    }

    /// Takes a run of an organization block.
    fn run(&mut self, run: ObRun) {
        if self.part.is_some() {
            self.writer.run(&run);
        } else if self.settings.history > 0 {
            if self.runs.len() == self.settings.history * RUNS {
                self.runs.pop_front();
            }
            self.runs.push_back(run);
        }
    }

    /// Takes one row; returns one that can be used again, and whether the last part is complete.
    fn row(&mut self, mut row: Row, out: &mut Vec<u8>, room: bool) -> (Row, bool) {
        row.lost += self.dropped;
        self.lost = row.lost - self.dropped;
        // A trigger is seen also while a part is written: an edge in it does not fire after it.
        let fires = self.watching.row(&row, &self.settings.items);
        if self.part.is_none()
            && let Some(why) = fires
        {
            self.parts += 1;
            self.part = Some(row.time);
            let number = self.parts;
            self.writer.event(Event::Part { number, time_ns: row.time.nanos(), why }, out);
            self.write_history(row.time.saturating_sub(self.settings.before), out);
        }
        let Some(began) = self.part else { return (self.keep(row), false) };
        if !room {
            self.dropped += 1;
            return (row, false);
        }
        self.write(&row);
        if self.writer.waiting() >= BLOCK {
            self.writer.take(out);
        }
        let length = self.settings.length;
        if length.is_zero() || row.time.since(began) < length {
            return (row, false);
        }
        self.part = None;
        self.span = self.span.map(|(from, _)| (from, row.time));
        self.writer.event(Event::Complete { number: self.parts, time_ns: row.time.nanos() }, out);
        (row, self.parts == self.settings.repeat)
    }

    fn write(&mut self, row: &Row) {
        self.writer.row(row);
        self.rows += 1;
    }

    fn write_history(&mut self, from: Instant, out: &mut Vec<u8>) {
        self.span = Some((from, Instant::NEVER));
        while let Some(row) = self.history.pop_front() {
            if row.time >= from {
                self.write(&row);
            }
            self.spare.push(row);
        }
        for run in self.runs.drain(..).filter(|run| run.began >= from) {
            self.writer.run(&run);
        }
        for event in self.events.drain(..).filter(|event| event.time_ns() >= from.nanos()) {
            self.writer.event(event, out);
        }
    }

    /// Puts a row into the history; returns one that can be used again.
    fn keep(&mut self, row: Row) -> Row {
        if self.settings.history == 0 {
            return row;
        }
        let oldest = if self.history.len() == self.settings.history { self.history.pop_front() } else { None };
        self.history.push_back(row);
        oldest.or_else(|| self.spare.pop()).unwrap_or_default()
    }

    /// Writes what waits for a block.
    pub fn flush(&mut self, out: &mut Vec<u8>) {
        self.writer.take(out);
    }

    /// Ends the recording.
    pub fn end(&mut self, why: &str, now: Instant, out: &mut Vec<u8>) {
        let (rows, lost) = self.count();
        self.writer.event(Event::End { time_ns: now.nanos(), why: why.into(), rows, lost }, out);
    }
}

#[cfg(test)]
mod tests {
    use ob1_access::Names;
    use ob1_cpu::Flags;
    use ob1_time::Span;

    use super::*;
    use crate::{Entry, Head, Order, Reader, Scan};

    const MS: u64 = 1_000_000;

    /// A row each millisecond; `MW0` counts them, `M10.0` is 1 from `from` to `to`.
    fn rows(count: u64, pulse: std::ops::Range<u64>, late: u64) -> impl Iterator<Item = Row> {
        (0..count).map(move |at| Row {
            point: at + 1,
            time: Instant::from_nanos(at * MS),
            scan: Scan { number: at, flags: Flags { took_long: at == late, ..Flags::default() }, ..Scan::default() },
            values: vec![at, u64::from(pulse.contains(&at))],
            ..Row::default()
        })
    }

    /// The number in `MW0` of each row written, by parts, and what became of the capture.
    fn capture(order: Order, given: impl Iterator<Item = Row>) -> (Vec<Vec<u64>>, bool) {
        let order = Order { signals: vec!["MW0".into(), "M10.0".into()], ..order };
        let settings = order.settle(&Names::default(), Span::MILLISECOND).expect("an order");
        let mut file = Writer::begin(&Head { signals: settings.signals.clone(), ..Head::default() });
        let (mut capture, mut complete) = (Capture::new(settings), false);
        for mut row in given {
            let time_ns = row.time.nanos();
            if time_ns == 70 * MS {
                let event = Event::Diagnosis { time_ns, number: "4562h".into(), text: String::new() };
                capture.event(event, &mut file);
            }
            row.state = ob1_model::OperatingState::Run;
            complete |= capture.row(row, &mut file, true).1;
            capture.run(ObRun { ob: 1, began: Instant::from_nanos(time_ns), ..ObRun::default() });
            if complete {
                break;
            }
        }
        capture.flush(&mut file);
        let mut reader = Reader::new(&file[..]).expect("a recording");
        let (mut parts, mut counted) = (Vec::new(), 0);
        while let Some(entry) = reader.next_entry().expect("whole") {
            match entry {
                Entry::Event(Event::Part { .. }) => parts.push(Vec::new()),
                Entry::Row(row) => {
                    counted += 1;
                    parts.last_mut().expect("a part").push(row.values[0]);
                }
                _ => {}
            }
        }
        assert_eq!(capture.count(), (counted, 0));
        (parts, complete)
    }

    fn order(trigger: &str, before: u64, length: u64, repeat: u64) -> Order {
        Order { signals: Vec::new(), trigger: trigger.into(), before_ns: before * MS, for_ns: length * MS, repeat }
    }

    #[test]
    fn parts_begin_with_their_history() {
        let numbers = |range: std::ops::RangeInclusive<u64>| range.collect::<Vec<u64>>();
        let taken =
            |trigger, before, length, repeat| capture(order(trigger, before, length, repeat), rows(200, 50..60, 120));
        assert_eq!(taken("", 0, 10, 1), (vec![numbers(0..=10)], true));
        assert_eq!(taken("M10.0 rising", 5, 3, 1), (vec![numbers(45..=53)], true));
        assert_eq!(taken("M10.0 falling", 0, 3, 0), (vec![numbers(60..=63)], false));
        // An edge while a part is written begins none.
        assert_eq!(taken("MW0 > 49 rising", 2, 0, 1).0, vec![numbers(48..=199)]);
        assert_eq!(taken("late", 2, 2, 1), (vec![numbers(118..=122)], true));
        assert_eq!(taken("diag 4562h", 2, 2, 0), (vec![numbers(68..=72)], false));
        assert_eq!(taken("diag 4563h", 2, 2, 1), (vec![], false));
        let many = rows(200, 0..0, 0).map(|row| Row { values: vec![row.values[0], row.point / 10 % 2], ..row });
        let (parts, complete) = capture(order("M10.0 rising", 3, 4, 4), many);
        assert_eq!((parts.len(), complete), (4, true));
        assert!(parts.iter().zip([9, 29, 49, 69]).all(|(part, at)| *part == numbers(at - 3..=at + 4)), "{parts:?}");
        // A history longer than what has been.
        assert_eq!(taken("MW0 = 3 rising", 50, 1, 1).0, vec![numbers(0..=4)]);
    }

    #[test]
    fn the_memory_for_a_history_has_a_limit() {
        let refused = order("late", 24 * 3600 * 1000, 1, 1).settle(&Names::default(), Span::MILLISECOND);
        assert!(refused.is_err_and(|why| why.contains("shorten `before`")));
        let unknown = Order { signals: vec!["Nothing".into()], ..Order::default() };
        assert!(unknown.settle(&Names::default(), Span::MILLISECOND).is_err());
    }

    #[test]
    fn what_finds_no_room_is_counted() {
        let settings = Order { signals: vec!["MW0".into(), "M10.0".into()], ..Order::default() };
        let settings = settings.settle(&Names::default(), Span::MILLISECOND).expect("an order");
        let mut file = Writer::begin(&Head { signals: settings.signals.clone(), ..Head::default() });
        let mut capture = Capture::new(settings);
        for row in rows(100, 0..0, 200) {
            let room = !(30..60).contains(&row.scan.number);
            assert!(!capture.row(row, &mut file, room).1);
        }
        capture.end("time", Instant::START, &mut file);
        let mut reader = Reader::new(&file[..]).expect("a recording");
        let (mut last, mut end) = (0, None);
        while let Some(entry) = reader.next_entry().expect("whole") {
            match entry {
                Entry::Row(row) => last = row.lost,
                Entry::Event(Event::End { rows, lost, .. }) => end = Some((rows, lost)),
                _ => {}
            }
        }
        assert_eq!((last, end), (30, Some((70, 30))));
    }
}
