//! Recordings: a row of values at every cycle control point, with the record of the scan before it, and each run of an
//! organization block.
//!
//! The values are copied as those of a link's window are, into a ring made before the recording began; the scan
//! allocates nothing and never waits. A row that finds no room is lost and counted, and the next one says so. A reader
//! that is dropped ends its recording; the scan gives the memory back, to be freed elsewhere.

use std::sync::atomic::{AtomicU64, Ordering};

use ob1_model::{Frame, fits_a_share};
use ob1_time::{Instant, Span};
use rtrb::{Consumer, Producer, RingBuffer};

use crate::accounts::{ScanRecord, WORDS};
use crate::exchange::Watch;
use crate::machine::Machine;
use crate::orders::TooMuch;
use crate::{CellError, OperatingState};

/// Recordings of a CPU at one time.
pub const RECORDINGS: usize = 8;
/// Runs of organization blocks that have room for each row.
const RUNS: usize = 4;
/// Words before the record of the scan: control point, time, operating state, lost rows, lost runs.
const HEAD: usize = 5;
/// Words before the values.
const VALUES: usize = HEAD + WORDS;

/// One run of an organization block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ObRun {
    /// Its number.
    pub ob: u16,
    /// When it began.
    pub began: Instant,
    /// From its start to its end.
    pub whole: Span,
    /// The same without the organization blocks that interrupted it.
    pub own: Span,
}

/// The scan's end of one recording.
#[derive(Debug)]
struct Recorder {
    watch: Watch,
    words: usize,
    rows: Producer<AtomicU64>,
    lost: u64,
    runs: Producer<ObRun>,
    lost_runs: u64,
}

impl Recorder {
    fn row(&mut self, m: &mut Machine, point: u64, state: OperatingState) {
        let Ok(mut chunk) = self.rows.write_chunk(self.words) else {
            self.lost += 1;
            return;
        };
        // The ring holds whole rows, so each lies in one piece.
        let (words, _) = chunk.as_mut_slices();
        let Some((head, values)) = words.split_at_mut_checked(VALUES) else { return };
        let first = [point, m.hot.now.nanos(), state.number().into(), self.lost, self.lost_runs];
        let scan = m.trace.last.to_words();
        for (cell, word) in head.iter_mut().zip(first.into_iter().chain(scan)) {
            *cell.get_mut() = word;
        }
        self.watch.fill(m, values);
        chunk.commit_all();
    }
}

/// The scan's end of all recordings.
#[derive(Debug)]
pub(crate) struct Recordings {
    places: [Option<Box<Recorder>>; RECORDINGS],
    /// How many there are.
    count: usize,
    orders: Consumer<Box<Recorder>>,
    back: Producer<Box<Recorder>>,
    client: Option<RecordingClient>,
}

impl Default for Recordings {
    fn default() -> Self {
        let (to_cpu, orders) = RingBuffer::new(RECORDINGS);
        // As many as can be here and under way.
        let (back, from_cpu) = RingBuffer::new(2 * RECORDINGS);
        let client = Some(RecordingClient { orders: to_cpu, back: from_cpu });
        Self { places: [const { None }; RECORDINGS], count: 0, orders, back, client }
    }
}

impl Recordings {
    /// The end of whoever records; there is one.
    pub(crate) fn client(&mut self) -> Option<RecordingClient> {
        self.client.take()
    }

    /// Nothing is recorded, and nobody has asked for it.
    #[inline]
    pub(crate) fn is_idle(&self) -> bool {
        self.count == 0 && self.orders.is_empty()
    }

    /// The cycle control point.
    #[inline]
    pub(crate) fn control_point(&mut self, m: &mut Machine, point: u64, state: OperatingState) {
        if !self.is_idle() {
            self.rows(m, point, state);
        }
    }

    fn rows(&mut self, m: &mut Machine, point: u64, state: OperatingState) {
        while self.back.slots() > RECORDINGS
            && let Some(free) = self.places.iter_mut().find(|place| place.is_none())
            && let Ok(recorder) = self.orders.pop()
        {
            *free = Some(recorder);
            self.count += 1;
        }
        for place in &mut self.places {
            if let Some(ended) = place.take_if(|recorder| recorder.rows.is_abandoned()) {
                self.count -= 1;
                let _ = self.back.push(ended);
            } else if let Some(recorder) = place {
                recorder.row(m, point, state);
            }
        }
    }

    /// An organization block has ended.
    #[inline]
    pub(crate) fn ob_ran(&mut self, run: ObRun) {
        if self.count > 0 {
            for recorder in self.places.iter_mut().flatten() {
                recorder.lost_runs += u64::from(recorder.runs.push(run).is_err());
            }
        }
    }
}

/// A ring whose pages are there before the scan writes to them.
fn touched<T: Default>(room: usize) -> (Producer<T>, Consumer<T>) {
    let (mut producer, mut consumer) = RingBuffer::new(room);
    if let Ok(chunk) = producer.write_chunk(room) {
        chunk.commit_all();
    }
    if let Ok(chunk) = consumer.read_chunk(room) {
        chunk.commit_all();
    }
    (producer, consumer)
}

/// Begins recordings, and frees what ended ones have used.
#[derive(Debug)]
pub struct RecordingClient {
    orders: Producer<Box<Recorder>>,
    back: Consumer<Box<Recorder>>,
}

impl RecordingClient {
    /// Records these pieces from the next cycle control point on; `room`: rows that can wait to be taken.
    ///
    /// # Errors
    /// [`TooMuch::Watch`] for more than a link may watch; [`TooMuch::UnderWay`] with too many begun at once.
    pub fn record(&mut self, frame: Frame, room: usize) -> Result<Rows, TooMuch> {
        while self.back.pop().is_ok() {}
        if !fits_a_share(frame.pieces().iter().copied()) {
            return Err(TooMuch::Watch);
        }
        let (words, room) = (VALUES + frame.words(), room.max(2));
        let (rows, taken) = touched(words * room);
        let (runs, ran) = touched(RUNS * room);
        let watch = Watch::new(0, &frame);
        let recorder = Box::new(Recorder { watch, words, rows, lost: 0, runs, lost_runs: 0 });
        self.orders.push(recorder).map_err(|_| TooMuch::UnderWay)?;
        Ok(Rows { frame, words, rows: taken, runs: ran })
    }
}

/// What one recording has recorded. Dropping it ends the recording.
#[derive(Debug)]
pub struct Rows {
    frame: Frame,
    words: usize,
    rows: Consumer<AtomicU64>,
    runs: Consumer<ObRun>,
}

/// One row: the memory at a cycle control point, and the scan that ended before it.
#[derive(Debug)]
pub struct Row<'a> {
    /// Number of the cycle control point, those in STOP and HOLD included.
    pub point: u64,
    /// When it was.
    pub time: Instant,
    /// The operating state then.
    pub state: OperatingState,
    /// Rows lost since the recording began.
    pub lost: u64,
    /// Runs of organization blocks lost since then.
    pub lost_runs: u64,
    /// The last scan that had ended.
    pub scan: ScanRecord,
    frame: &'a Frame,
    words: &'a [AtomicU64],
}

impl Row<'_> {
    /// The bytes of a piece.
    ///
    /// # Errors
    /// [`CellError`]: what is not there.
    pub fn read(&self, piece: usize, into: &mut Vec<u8>) -> Result<(), CellError> {
        let len = self.frame.pieces().get(piece).map_or(0, |piece| piece.len());
        let word = |at: usize| self.words.get(at).map_or(0, |word| word.load(Ordering::Relaxed));
        self.frame.read(piece, 0, len, word, into)
    }
}

impl Rows {
    /// Takes the oldest row.
    pub fn take<R>(&mut self, on: impl FnOnce(Row<'_>) -> R) -> Option<R> {
        let chunk = self.rows.read_chunk(self.words).ok()?;
        let (head, words) = chunk.as_slices().0.split_at_checked(VALUES)?;
        let of = |at: usize| head.get(at).map_or(0, |word: &AtomicU64| word.load(Ordering::Relaxed));
        let row = Row {
            point: of(0),
            time: Instant::from_nanos(of(1)),
            state: OperatingState::of(of(2)),
            lost: of(3),
            lost_runs: of(4),
            scan: ScanRecord::from_words(&std::array::from_fn(|at| of(HEAD + at))),
            frame: &self.frame,
            words,
        };
        let result = on(row);
        chunk.commit_all();
        Some(result)
    }

    /// Takes the oldest run of an organization block.
    pub fn take_run(&mut self) -> Option<ObRun> {
        self.runs.pop().ok()
    }

    /// The CPU is gone, or the recording has not begun and never will.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.rows.is_abandoned()
    }
}
