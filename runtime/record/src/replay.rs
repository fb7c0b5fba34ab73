//! Replay: the inputs of a recording drive a CPU in virtual time, scan by scan, and its values are compared.
//!
//! A row is the memory after its scan. So the scan of a row is given the inputs that the row shows, and what links have
//! written since the row before. Each scan begins when it began, and its statements take the time they took, so that
//! timers run out where they did.

use std::io::Read;

use ob1_access::{Item, text};
use ob1_model::{Area, Cell, OperatingState};
use ob1_time::{Instant, Span};

use crate::{Entry, FormatError, Head, Reader, Row};

/// Differences of one signal that are told one by one.
const TOLD: usize = 3;

/// When a scan begins, and how long its statements take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pace {
    /// When it began.
    pub start: Instant,
    /// From then to the start of OB 1, without interrupts.
    pub inputs: Span,
    /// What a statement takes.
    pub statement: Span,
}

/// A CPU that a recording is replayed on.
pub trait Stage {
    /// Gives the process an input; the memory has it with the next scan.
    ///
    /// # Errors
    /// There is no such input, in words.
    fn sense(&mut self, item: &Item, bits: u32) -> Result<(), String>;
    /// Sets a cell of the memory.
    ///
    /// # Errors
    /// It cannot be set, in words.
    fn set(&mut self, item: &Item, bits: u32) -> Result<(), String>;
    /// The bits of a cell; `None`: it is not there.
    fn get(&mut self, item: &Item) -> Option<u32>;
    /// Starts the CPU, so that its first scan can begin then.
    ///
    /// # Errors
    /// It does not go to RUN, in words.
    fn start(&mut self, at: Instant) -> Result<(), String>;
    /// Runs the next scan.
    ///
    /// # Errors
    /// It has gone to STOP: why, in words.
    fn scan(&mut self, pace: Pace) -> Result<(), String>;
    /// Runs the interrupts between two scans that are due until then; timers read now show their time then.
    ///
    /// # Errors
    /// It has gone to STOP: why, in words.
    fn wait(&mut self, until: Instant) -> Result<(), String>;
}

/// A value that was another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The scan of the recording after which it was seen.
    pub scan: u64,
    /// When that scan began, by the clock of the recording.
    pub time: Instant,
    /// What was recorded; `None`: the cell was not there.
    pub recorded: Option<u32>,
    /// What the replay has.
    pub found: Option<u32>,
}

/// The differences of one signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Differences {
    /// The signal.
    pub item: Item,
    /// In how many scans it differed.
    pub count: u64,
    /// The first of them.
    pub first: Vec<Difference>,
}

impl Differences {
    /// The first difference in words: `Motor: recorded 1, found 0 after scan 17, 0.016 s`.
    pub fn text(&self) -> String {
        let Some(first) = self.first.first() else { return String::new() };
        let bits = |bits: Option<u32>| bits.map_or_else(|| "nothing".into(), |bits| text::of_bits(&self.item, bits));
        let (recorded, found) = (bits(first.recorded), bits(first.found));
        let (scan, time) = (first.scan, first.time.since_start().as_secs_f64());
        let more = match self.count {
            1 => String::new(),
            count => format!(" ({count} scans in all)"),
        };
        format!("{}: recorded {recorded}, found {found} after scan {scan}, {time:.6} s{more}", self.item.name)
    }
}

/// What a replay has shown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Replayed {
    /// Scans replayed.
    pub scans: u64,
    /// Times the memory was set anew: after rows that are missing, and at the beginning of a part.
    pub anew: u64,
    /// Signals that differ, in the order of the recording.
    pub differences: Vec<Differences>,
    /// Signals that cannot be set and had a value at such a beginning: what depends on them may differ.
    pub not_set: Vec<String>,
    /// Why it ended before the recording did: a STOP, for instance.
    pub ended: Option<String>,
}

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// It cannot be read.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// Its signals, or those that were named.
    #[error("{0}")]
    Signals(String),
    /// Nothing in it can be replayed.
    #[error("the recording has no two rows of scans that follow each other in RUN")]
    Nothing,
}

/// A recording to be replayed.
#[derive(Debug)]
pub struct Replay<R> {
    reader: Reader<R>,
    items: Vec<Item>,
    driven: Vec<bool>,
    compared: Vec<bool>,
}

/// Inputs come from the process.
const fn is_input(item: &Item) -> bool {
    matches!(item.cell, Cell::Area(Area::Input, _) | Cell::Peripheral(_))
}

impl<R: Read> Replay<R> {
    /// Reads the head. `drive`: signals besides the inputs that others have written, and not the program; `compare`:
    /// the signals that are compared, if not all that are not driven.
    ///
    /// # Errors
    /// [`ReplayError`]: it is no recording, or it has no such signal.
    pub fn new(input: R, drive: &[String], compare: Option<&[String]>) -> Result<Self, ReplayError> {
        let reader = Reader::new(input)?;
        let items = reader.head().items().map_err(ReplayError::Signals)?;
        let find = |name: &String| {
            let trimmed = name.trim().trim_matches('"');
            let same = |item: &Item| item.name.trim_matches('"').eq_ignore_ascii_case(trimmed);
            let missing = || ReplayError::Signals(format!("the recording has no signal {trimmed}"));
            items.iter().position(same).ok_or_else(missing)
        };
        let mut driven: Vec<bool> = items.iter().map(is_input).collect();
        for name in drive {
            driven[find(name)?] = true;
        }
        let mut compared: Vec<bool> = driven.iter().map(|driven| !driven && compare.is_none()).collect();
        for name in compare.unwrap_or_default() {
            compared[find(name)?] = true;
        }
        Ok(Self { reader, items, driven, compared })
    }

    /// The head of the recording.
    pub const fn head(&self) -> &Head {
        self.reader.head()
    }

    /// Replays it to its end.
    ///
    /// # Errors
    /// [`ReplayError`]: it is damaged, or there is nothing to replay.
    pub fn run(mut self, stage: &mut dyn Stage) -> Result<Replayed, ReplayError> {
        let mut replayed = Replayed::default();
        let mut counts: Vec<(u64, Vec<Difference>)> = vec![(0, Vec::new()); self.items.len()];
        let mut before: Option<Row> = None;
        while let Some(entry) = self.reader.next_entry()? {
            let Entry::Row(row) = entry else { continue };
            if row.state != OperatingState::Run {
                before = None;
                continue;
            }
            // After a start-up the scans are counted on, and nothing is known of the last one.
            let follows = before.as_ref().filter(|before| match before.scan.number {
                0 => before.point + 1 == row.point,
                number => number + 1 == row.scan.number,
            });
            let ran = match follows {
                Some(before) => {
                    let ran = self.scan(stage, before, &row);
                    replayed.scans += u64::from(ran.is_ok());
                    ran.map(|()| self.compare(stage, &row, &mut counts))
                }
                None => {
                    replayed.anew += 1;
                    self.begin(stage, &row, &mut replayed.not_set)
                }
            };
            if let Err(why) = ran {
                replayed.ended = Some(format!("scan {}: {why}", row.scan.number));
                break;
            }
            before = Some(row);
        }
        if replayed.scans == 0 && replayed.ended.is_none() {
            return Err(ReplayError::Nothing);
        }
        let found = self.items.into_iter().zip(counts).filter(|(_, (count, _))| *count > 0);
        replayed.differences = found.map(|(item, (count, first))| Differences { item, count, first }).collect();
        Ok(replayed)
    }

    /// The memory is what a row shows: that after a start-up, or after a scan in the middle.
    fn begin(&self, stage: &mut dyn Stage, row: &Row, not_set: &mut Vec<String>) -> Result<(), String> {
        if row.scan.number == 0 {
            stage.start(row.time)?;
        } else {
            stage.start(row.scan.start)?;
            stage.scan(pace(row))?;
            stage.wait(row.time)?;
        }
        for (at, item) in self.items.iter().enumerate() {
            let Some(bits) = row.bits(at) else { continue };
            if is_input(item) {
                stage.sense(item, bits)?;
            }
            let is_memory = !matches!(item.cell, Cell::Peripheral(_));
            let is_right = !is_memory || stage.get(item) == Some(bits) || stage.set(item, bits).is_ok();
            if !is_right && !not_set.contains(&item.name) {
                not_set.push(item.name.clone());
            }
        }
        Ok(())
    }

    /// Runs the scan of a row.
    fn scan(&self, stage: &mut dyn Stage, before: &Row, row: &Row) -> Result<(), String> {
        for (at, item) in self.items.iter().enumerate().filter(|(at, _)| self.driven[*at]) {
            match is_input(item) {
                true => row.bits(at).map_or(Ok(()), |bits| stage.sense(item, bits))?,
                false => before.bits(at).map_or(Ok(()), |bits| stage.set(item, bits))?,
            }
        }
        stage.scan(pace(row))?;
        stage.wait(row.time)
    }

    fn compare(&self, stage: &mut dyn Stage, row: &Row, counts: &mut [(u64, Vec<Difference>)]) {
        let compared = self.items.iter().zip(counts).enumerate().filter(|(at, _)| self.compared[*at]);
        for (at, (item, (count, first))) in compared {
            let (recorded, found) = (row.bits(at), stage.get(item));
            if recorded != found {
                *count += 1;
                if first.len() < TOLD {
                    first.push(Difference { scan: row.scan.number, time: row.scan.start, recorded, found });
                }
            }
        }
    }
}

fn pace(row: &Row) -> Pace {
    let scan = &row.scan;
    let statement = Span::from_nanos(scan.program.nanos().checked_div(scan.statements).unwrap_or(0));
    Pace { start: scan.start, inputs: scan.inputs, statement }
}
