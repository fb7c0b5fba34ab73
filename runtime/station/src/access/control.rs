//! The control socket's own door to the broker: it asks and waits, because it serves one request at a time.
//!
//! What is asked for is watched, all of it at once, for as long as somebody asks; nobody who asks costs the scan more
//! than that copy.

use std::time::{Duration, Instant};

use ob1_access::door::{Answer, Ask, Door, News, NotYet, Reading, Refusal, Refused};
use ob1_access::{Cell, CellWidth, Piece, Put};
use ob1_cpu::GROUP_ENTRIES;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// Pause between two looks at the window, while a snapshot is waited for.
const LOOK: Duration = Duration::from_micros(200);
/// How often what nobody asks for any more is looked for.
const TICK: Duration = Duration::from_secs(1);

/// A cell and how much of it.
pub(super) type Wanted = (Cell, CellWidth);

pub(super) struct Control {
    door: Door,
    answer_time: Duration,
    reading: Reading,
    ticked: Instant,
}

impl Control {
    pub(super) fn new(door: Door, answer_time: Duration) -> Self {
        Self { door, answer_time, reading: Reading::new(), ticked: Instant::now() }
    }

    /// To be called when nothing is asked: what was asked for long ago is let go.
    pub(super) fn tick(&mut self) {
        while self.ticked.elapsed() >= TICK {
            self.ticked += TICK;
            self.door.tick();
        }
        // A door that is gone says so at the next question.
        let _ = self.door.pump();
        while self.door.take_news().is_some() {}
    }

    /// The bits of these cells, all of one cycle control point after this call has begun.
    pub(super) fn read(&mut self, wanted: &[Wanted]) -> Result<Vec<Result<u32, Refusal>>, String> {
        if wanted.is_empty() {
            return Ok(Vec::new());
        }
        let pieces: Vec<Piece> = wanted.iter().map(|(cell, width)| piece(*cell, *width)).collect();
        // What lies there already may have been taken long ago.
        let seen = self.door.newest_scan();
        let give_up = Instant::now() + self.answer_time;
        loop {
            self.pump()?;
            match self.door.read(&pieces, &mut self.reading) {
                Ok(()) if self.reading.scan > seen => break,
                Ok(()) | Err(NotYet::Coming | NotYet::Busy) => {}
                Err(NotYet::TooMuch) if wanted.len() > 1 => {
                    // More than can be watched at a time: one part after the other.
                    let (first, rest) = wanted.split_at(wanted.len() / 2);
                    let mut values = self.read(first)?;
                    values.extend(self.read(rest)?);
                    return Ok(values);
                }
                Err(NotYet::TooMuch) => return Err("the cell cannot be watched".into()),
            }
            self.wait(LOOK, give_up)?;
        }
        let value = |(index, (cell, width)): (usize, &Wanted)| {
            let value = self.reading.value(index)?;
            // A bit in memory comes with its byte.
            let bit = *width == CellWidth::Bit && cell.block().is_some();
            Ok(if bit { value >> (cell.bit() % 8) & 1 } else { value })
        };
        Ok(wanted.iter().enumerate().map(value).collect())
    }

    /// Writes: up to [`GROUP_ENTRIES`] of them land at one cycle control point, or none does. The error names the
    /// entry. A read after this sees what was written.
    pub(super) fn write(&mut self, puts: Vec<Put>) -> Result<Result<(), (usize, Refusal)>, String> {
        let mut puts = puts.into_iter().peekable();
        let mut before = 0;
        while puts.peek().is_some() {
            let part: Vec<Put> = puts.by_ref().take(GROUP_ENTRIES).collect();
            let count = part.len();
            let written = self.door.write(0, part).map_err(|error| error.to_string())?;
            let outcome = self.until(|news| match news {
                News::Written { ticket, outcome, .. } if ticket == written => Some(outcome),
                _ => None,
            })?;
            match outcome {
                Err(Refused { why: Refusal::Silent, .. }) => return Err(Refusal::Silent.to_string()),
                Err(Refused { entry, why }) => return Ok(Err((before + entry as usize, why))),
                Ok(_) => before += count,
            }
        }
        Ok(Ok(()))
    }

    /// Asks and waits for the answer.
    pub(super) fn ask(&mut self, ask: Ask) -> Result<Answer, String> {
        let asked = self.door.ask(0, ask);
        let answer = self.until(|news| match news {
            News::Answer { ticket, answer, .. } if ticket == asked => Some(answer),
            _ => None,
        })?;
        match answer {
            Answer::Refused(why) => Err(why.to_string()),
            answer => Ok(answer),
        }
    }

    /// Waits for what `wanted` takes; others are of a request that was given up.
    fn until<T>(&mut self, wanted: impl Fn(News) -> Option<T>) -> Result<T, String> {
        // The broker gives up first, and says so.
        let give_up = Instant::now() + self.answer_time * 2;
        loop {
            self.pump()?;
            while let Some(news) = self.door.take_news() {
                if let Some(found) = wanted(news) {
                    return Ok(found);
                }
            }
            self.wait(self.answer_time, give_up)?;
        }
    }

    fn pump(&mut self) -> Result<(), String> {
        self.door.pump().map_err(|error| error.to_string())
    }

    fn wait(&mut self, time: Duration, give_up: Instant) -> Result<(), String> {
        self.pump()?;
        let left = give_up.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(Refusal::Silent.to_string());
        }
        let time = time.min(left);
        let timeout = Timespec { tv_sec: time.as_secs() as i64, tv_nsec: i64::from(time.subsec_nanos()) };
        let mut flags = PollFlags::IN;
        flags.set(PollFlags::OUT, self.door.wants_write());
        // An interrupted poll is a short wait.
        let _ = poll(&mut [PollFd::from_borrowed_fd(self.door.fd(), flags)], Some(&timeout));
        Ok(())
    }
}

/// The bytes a cell lies in, or its value.
fn piece(cell: Cell, width: CellWidth) -> Piece {
    match cell.block() {
        Some(_) => Piece::Bytes { at: cell.at_bit(cell.byte() * 8), len: u32::from(width.bytes()) },
        None => Piece::Value(cell, width),
    }
}
