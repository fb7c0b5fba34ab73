//! A row of a recording: what the memory held at a cycle control point, and the scan that had ended before it.

use ob1_access::Item;
use ob1_cpu::{Flags, ScanRecord};
use ob1_model::{Head as Word, OperatingState};
use ob1_time::{Instant, Span};

/// The scan before a cycle control point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Scan {
    /// Its number since load, from 1; 0: there was none.
    pub number: u64,
    /// When it began.
    pub start: Instant,
    /// From its deadline to its start.
    pub lateness: Span,
    /// From its start to its end.
    pub execution: Span,
    /// Back plane and process image before OB 1.
    pub inputs: Span,
    /// All organization blocks.
    pub program: Span,
    /// All blocks of plugins.
    pub plugins: Span,
    /// Process image and back plane after OB 1.
    pub outputs: Span,
    /// Statements executed.
    pub statements: u64,
    /// Deadlines skipped after it.
    pub missed: u64,
    /// Why it counts as late, if it does.
    pub flags: Flags,
}

impl From<&ScanRecord> for Scan {
    fn from(record: &ScanRecord) -> Self {
        Self {
            number: record.scan,
            start: record.start,
            lateness: record.lateness(),
            execution: record.execution(),
            inputs: record.inputs,
            program: record.program,
            plugins: record.plugins,
            outputs: record.outputs,
            statements: record.statements,
            missed: record.missed,
            flags: record.flags,
        }
    }
}

/// One cycle control point.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Row {
    /// Its number, those in STOP and HOLD included.
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
    pub scan: Scan,
    /// The signals, as [`ob1_model::Head`] words: bits, or why there are none.
    pub values: Vec<u64>,
}

/// Columns before the values.
pub(crate) const COLUMNS: usize = 16;

impl Row {
    /// Fills this row from one of the CPU, and keeps its memory.
    pub fn set(&mut self, row: &ob1_cpu::Row<'_>, items: &[Item], bytes: &mut Vec<u8>) {
        (self.point, self.time, self.state) = (row.point, row.time, row.state);
        (self.lost, self.lost_runs, self.scan) = (row.lost, row.lost_runs, Scan::from(&row.scan));
        self.values.clear();
        for (index, item) in items.iter().enumerate() {
            bytes.clear();
            let read = row.read(index, bytes).map(|()| item.bits(bytes));
            self.values.push(Word::of(read).word());
        }
    }

    /// The bits of a signal; `None`: it was not there.
    pub fn bits(&self, signal: usize) -> Option<u32> {
        let word = Word::from_word(*self.values.get(signal)?);
        word.error.is_none().then_some(word.number)
    }

    pub(crate) fn columns(&self) -> impl Iterator<Item = u64> {
        let scan = &self.scan;
        let flags = [scan.flags.began_late, scan.flags.took_long, scan.flags.overran, scan.flags.watchdog];
        let flags = flags.iter().enumerate().fold(0, |word, (bit, set)| word | u64::from(*set) << bit);
        let fixed: [u64; COLUMNS] = [
            self.point,
            self.time.nanos(),
            self.state.number().into(),
            self.lost,
            self.lost_runs,
            scan.number,
            scan.start.nanos(),
            scan.lateness.nanos(),
            scan.execution.nanos(),
            scan.inputs.nanos(),
            scan.program.nanos(),
            scan.plugins.nanos(),
            scan.outputs.nanos(),
            scan.statements,
            scan.missed,
            flags,
        ];
        fixed.into_iter().chain(self.values.iter().copied())
    }

    pub(crate) fn from_columns(columns: &[u64]) -> Option<Self> {
        let (fixed, values) = columns.split_first_chunk::<COLUMNS>()?;
        let span = |at: usize| Span::from_nanos(fixed[at]);
        let bit = |n: u32| fixed[15] >> n & 1 == 1;
        Some(Self {
            point: fixed[0],
            time: Instant::from_nanos(fixed[1]),
            state: OperatingState::of(fixed[2]),
            lost: fixed[3],
            lost_runs: fixed[4],
            scan: Scan {
                number: fixed[5],
                start: Instant::from_nanos(fixed[6]),
                lateness: span(7),
                execution: span(8),
                inputs: span(9),
                program: span(10),
                plugins: span(11),
                outputs: span(12),
                statements: fixed[13],
                missed: fixed[14],
                flags: Flags { began_late: bit(0), took_long: bit(1), overran: bit(2), watchdog: bit(3) },
            },
            values: values.to_vec(),
        })
    }
}
