//! The readings of a rack as a recording, for `ob1 exec --replay` and `ob1 test`: a row for each.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use ob1_access::{Item, Names};
use ob1_model::{Head as Word, OperatingState};
use ob1_record::{Head, Row, Scan, Signal, Writer};

use super::rack::Look;
use super::subject::Subject;

/// Bytes that are written at once.
const BLOCK: usize = 16 * 1024;
/// Permissions of the file.
const MODE: u32 = 0o644;

/// A file that is written.
pub(super) struct Recording {
    path: PathBuf,
    file: File,
    writer: Writer,
    rows: u64,
    /// Bytes of each signal of the inputs.
    inputs: Vec<usize>,
    /// How many compared cells follow them.
    cells: usize,
}

impl Recording {
    /// Begins a file with the inputs and what is compared from the start.
    pub(super) fn begin(path: &Path, subject: &Subject) -> Result<Self, String> {
        let names = Names::default();
        let mut inputs: Vec<Item> = Vec::new();
        for range in &subject.inputs {
            let periphery = if range.first < subject.image_bytes() { "" } else { "P" };
            let (letter, size) = if range.analog { ("W", 2) } else { ("B", 1) };
            for at in (range.first..range.first + range.bytes).step_by(size) {
                inputs.push(names.parse(&format!("{periphery}I{letter}{at}"))?);
            }
        }
        let compared = subject.cells.iter().filter(|watched| watched.compared).map(|watched| &watched.item);
        let signals: Vec<Signal> = inputs.iter().chain(compared).map(Signal::of).collect();
        let bytes: Vec<usize> = inputs.iter().map(|item| item.width.bytes() as usize).collect();
        let cells = signals.len() - bytes.len();
        let head =
            Head { station: subject.name.clone(), min_cycle_ns: subject.cycle().nanos(), signals, ..Head::default() };
        let told = |error: std::io::Error| format!("{}: {error}", path.display());
        let mut file = ob1_process::files::fresh(path, MODE).map_err(told)?;
        file.write_all(&Writer::begin(&head)).map_err(told)?;
        Ok(Self { path: path.to_owned(), file, writer: Writer::default(), rows: 0, inputs: bytes, cells })
    }

    /// A reading more.
    pub(super) fn take(&mut self, look: &Look) -> Result<(), String> {
        self.rows += 1;
        let mut rest = look.inputs.as_slice();
        let mut values = Vec::with_capacity(self.inputs.len() + self.cells);
        for bytes in &self.inputs {
            let (bytes, after) = rest.split_at_checked(*bytes).unwrap_or_default();
            rest = after;
            values.push(Word::of(Ok(bytes.iter().fold(0, |bits, byte| bits << 8 | u32::from(*byte)))).word());
        }
        let of = |value: &Option<u32>| Word::of(value.ok_or(ob1_model::CellError::Outside)).word();
        values.extend(look.values.iter().take(self.cells).map(of));
        let scan = Scan { number: self.rows, start: look.at, ..Scan::default() };
        let state = OperatingState::Run;
        self.writer.row(&Row { point: self.rows, time: look.at, state, scan, values, ..Row::default() });
        if self.writer.waiting() >= BLOCK { self.flush() } else { Ok(()) }
    }

    /// Writes what waits.
    pub(super) fn flush(&mut self) -> Result<(), String> {
        let mut out = Vec::new();
        self.writer.take(&mut out);
        self.file.write_all(&out).map_err(|error| format!("{}: {error}", self.path.display()))
    }
}
