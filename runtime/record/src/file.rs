//! The file of a recording: a magic, then blocks, each with its length and a checksum. It only grows, and what was
//! written before a cut can be read. docs/record.md describes every byte.

use std::io::{self, Read};

use ob1_cpu::ObRun;
use ob1_time::{Instant, Span};

use crate::row::COLUMNS;
use crate::{Event, Head, Row};

/// The first bytes of a recording: a name and the version of the format.
pub const MAGIC: [u8; 8] = *b"OB1REC\x01\n";

/// A longer block is not read, in bytes.
const LONGEST: u32 = 4 << 20;
/// Length and kind before the content, checksum behind it.
const BEFORE: usize = 5;
const AFTER: usize = 8;
/// Values of a row at most: those of a link's share.
const MOST_SIGNALS: usize = 8192;

const HEAD: u8 = 0;
const ROWS: u8 = 1;
const RUNS: u8 = 2;
const EVENTS: u8 = 3;
const LINE: u8 = 4;

/// Why a recording cannot be read on.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// It does not begin as one.
    #[error("this is not a recording of signals (docs/record.md)")]
    Foreign,
    /// Another version of the format.
    #[error("its format has version {0}, this ob1 reads version 1")]
    Version(u8),
    /// A block that was changed: what comes before it can be read.
    #[error("damaged at byte {0}: what comes before can be read")]
    Damaged(u64),
    /// The system refused to read.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// One thing that was recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Entry {
    /// A cycle control point.
    Row(Row),
    /// A run of an organization block.
    Run(ObRun),
    /// Something that happened.
    Event(Event),
    /// A record of the tap with this number (docs/trace.md).
    Line(u8, Vec<u8>),
}

fn put(out: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

fn get(bytes: &mut &[u8]) -> Option<u64> {
    let mut number = 0;
    for shift in (0..64).step_by(7) {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= u64::from(byte & 0x7F) << shift;
        if byte & 0x80 == 0 {
            return Some(number);
        }
    }
    None
}

/// A difference: small for small steps either way.
const fn zigzag(step: u64) -> u64 {
    step << 1 ^ if step >> 63 == 1 { u64::MAX } else { 0 }
}

const fn unzigzag(step: u64) -> u64 {
    step >> 1 ^ if step & 1 == 1 { u64::MAX } else { 0 }
}

/// A block with its length, kind and checksum.
fn block(out: &mut Vec<u8>, kind: u8, content: &[u8]) {
    let begin = out.len();
    out.extend_from_slice(&(content.len() as u32).to_le_bytes());
    out.push(kind);
    out.extend_from_slice(content);
    let sum = ob1_process::files::checksum(out[begin..].iter().copied());
    out.extend_from_slice(&sum.to_le_bytes());
}

/// Makes the blocks of a recording.
#[derive(Debug, Default)]
pub struct Writer {
    previous: Vec<u64>,
    changed: Vec<u8>,
    steps: Vec<u8>,
    rows: Vec<u8>,
    runs: Vec<u8>,
    last_run: u64,
    events: Vec<Event>,
}

impl Writer {
    /// The beginning of a file.
    pub fn begin(head: &Head) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        // A head can be serialized.
        block(&mut out, HEAD, &serde_json::to_vec(head).unwrap_or_default());
        out
    }

    /// Takes a row.
    pub fn row(&mut self, row: &Row) {
        let columns = COLUMNS + row.values.len();
        self.previous.resize(columns, 0);
        self.changed.clear();
        self.changed.resize(columns.div_ceil(8), 0);
        self.steps.clear();
        for (at, (before, now)) in self.previous.iter_mut().zip(row.columns()).enumerate() {
            if *before != now {
                self.changed[at / 8] |= 1 << (at % 8);
                put(&mut self.steps, zigzag(now.wrapping_sub(*before)));
                *before = now;
            }
        }
        self.rows.extend_from_slice(&self.changed);
        self.rows.extend_from_slice(&self.steps);
    }

    /// Takes a run of an organization block.
    pub fn run(&mut self, run: &ObRun) {
        put(&mut self.runs, run.ob.into());
        put(&mut self.runs, zigzag(run.began.nanos().wrapping_sub(self.last_run)));
        put(&mut self.runs, run.whole.nanos());
        put(&mut self.runs, run.own.nanos());
        self.last_run = run.began.nanos();
    }

    /// Takes an event. Rows taken before it come before it in the file.
    pub fn event(&mut self, event: Event, out: &mut Vec<u8>) {
        self.take(out);
        self.events.push(event);
        self.take(out);
    }

    /// Bytes that wait for [`Writer::take`].
    pub fn waiting(&self) -> usize {
        self.rows.len() + self.runs.len()
    }

    /// The record of a tap.
    pub fn line(number: u8, record: &[u8], out: &mut Vec<u8>) {
        block(out, LINE, &[&[number], record].concat());
    }

    /// Appends the blocks of what was taken.
    pub fn take(&mut self, out: &mut Vec<u8>) {
        for (kind, content) in [(ROWS, &mut self.rows), (RUNS, &mut self.runs)] {
            if !content.is_empty() {
                block(out, kind, content);
                content.clear();
            }
        }
        // Each block can be read by itself.
        self.previous.clear();
        self.last_run = 0;
        if !self.events.is_empty() {
            block(out, EVENTS, &serde_json::to_vec(&self.events).unwrap_or_default());
            self.events.clear();
        }
    }
}

/// Reads a recording from its beginning, or from the middle of a growing one.
#[derive(Debug)]
pub struct Reader<R> {
    input: R,
    head: Head,
    /// Bytes read and understood.
    at: u64,
    entries: std::vec::IntoIter<Entry>,
    cut: bool,
}

impl<R: Read> Reader<R> {
    /// Reads the head.
    ///
    /// # Errors
    /// [`FormatError`]: no recording, another version, or cut off before anything was recorded.
    pub fn new(mut input: R) -> Result<Self, FormatError> {
        let mut magic = [0; MAGIC.len()];
        input.read_exact(&mut magic).map_err(|_| FormatError::Foreign)?;
        if magic[..6] != MAGIC[..6] || magic[7] != MAGIC[7] {
            return Err(FormatError::Foreign);
        }
        if magic[6] != MAGIC[6] {
            return Err(FormatError::Version(magic[6]));
        }
        let at = MAGIC.len() as u64;
        let mut reader = Self { input, head: Head::default(), at, entries: Vec::new().into_iter(), cut: false };
        let head = match reader.block()? {
            Some((HEAD, content)) => serde_json::from_slice(&content).ok(),
            _ => None,
        };
        reader.head = head.filter(|head: &Head| head.signals.len() <= MOST_SIGNALS).ok_or(FormatError::Damaged(at))?;
        Ok(reader)
    }

    /// The head.
    pub const fn head(&self) -> &Head {
        &self.head
    }

    /// What is read, for whoever waits for more of it.
    pub const fn input(&self) -> &R {
        &self.input
    }

    /// The file ended within a block: it was cut off, or still grows.
    pub const fn is_cut(&self) -> bool {
        self.cut
    }

    /// Entries that were read and not taken yet: [`Reader::next_entry`] does not wait for them.
    pub fn has_more(&self) -> bool {
        self.entries.len() > 0
    }

    /// Bytes of the file up to the end of the last whole block.
    pub const fn whole_bytes(&self) -> u64 {
        self.at
    }

    /// The next entry; `None` at the end of the last whole block.
    ///
    /// # Errors
    /// [`FormatError`]: a block was changed, or the system refuses to read.
    pub fn next_entry(&mut self) -> Result<Option<Entry>, FormatError> {
        loop {
            if let Some(entry) = self.entries.next() {
                return Ok(Some(entry));
            }
            let at = self.at;
            let Some((kind, content)) = self.block()? else { return Ok(None) };
            let entries = self.entries_of(kind, &content).ok_or(FormatError::Damaged(at))?;
            self.entries = entries.into_iter();
        }
    }

    /// The kind and content of the next whole block.
    fn block(&mut self) -> Result<Option<(u8, Vec<u8>)>, FormatError> {
        let mut bytes = [0; BEFORE].to_vec();
        if !self.fill(&mut bytes, 0)? {
            return Ok(None);
        }
        let [a, b, c, d, kind] = bytes[..] else { return Ok(None) };
        let length = u32::from_le_bytes([a, b, c, d]);
        if length > LONGEST {
            return Err(FormatError::Damaged(self.at));
        }
        let end = BEFORE + length as usize;
        // As much as there is: a length that lies costs no memory.
        let wanted = (length as usize + AFTER) as u64;
        let got = (&mut self.input).take(wanted).read_to_end(&mut bytes)?;
        if (got as u64) < wanted {
            self.cut = true;
            return Ok(None);
        }
        let sum = bytes.get(end..).and_then(|sum| sum.first_chunk()).map(|sum| u64::from_le_bytes(*sum));
        bytes.truncate(end);
        if sum != Some(ob1_process::files::checksum(bytes.iter().copied())) {
            return Err(FormatError::Damaged(self.at));
        }
        self.at += (end + AFTER) as u64;
        bytes.drain(..BEFORE);
        Ok(Some((kind, bytes)))
    }

    /// False at the end of the input; what is there of `bytes` by then was cut off.
    fn fill(&mut self, bytes: &mut [u8], mut have: usize) -> io::Result<bool> {
        while have < bytes.len() {
            match self.input.read(&mut bytes[have..]) {
                Ok(0) => {
                    self.cut = have > 0;
                    return Ok(false);
                }
                Ok(count) => have += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(true)
    }

    fn entries_of(&self, kind: u8, mut bytes: &[u8]) -> Option<Vec<Entry>> {
        let mut entries = Vec::new();
        match kind {
            ROWS => {
                let mut columns = vec![0_u64; COLUMNS + self.head.signals.len()];
                while !bytes.is_empty() {
                    let (changed, rest) = bytes.split_at_checked(columns.len().div_ceil(8))?;
                    bytes = rest;
                    for (at, column) in columns.iter_mut().enumerate() {
                        if changed[at / 8] >> (at % 8) & 1 == 1 {
                            *column = column.wrapping_add(unzigzag(get(&mut bytes)?));
                        }
                    }
                    entries.push(Entry::Row(Row::from_columns(&columns)?));
                }
            }
            RUNS => {
                let mut began = 0_u64;
                while !bytes.is_empty() {
                    let ob = get(&mut bytes)? as u16;
                    began = began.wrapping_add(unzigzag(get(&mut bytes)?));
                    let whole = Span::from_nanos(get(&mut bytes)?);
                    let own = Span::from_nanos(get(&mut bytes)?);
                    entries.push(Entry::Run(ObRun { ob, began: Instant::from_nanos(began), whole, own }));
                }
            }
            EVENTS => {
                let events: Vec<Event> = serde_json::from_slice(bytes).ok()?;
                entries.extend(events.into_iter().map(Entry::Event));
            }
            LINE => {
                let (number, record) = bytes.split_first()?;
                entries.push(Entry::Line(*number, record.to_vec()));
            }
            // A newer ob1 may have kinds we do not know.
            _ => {}
        }
        Some(entries)
    }
}
