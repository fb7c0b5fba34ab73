//! The diagnostic buffer: the last hundred events, newest first, as a fixed ring. After them come the last STOPs and
//! what led to them; a flood of other events does not overwrite these.

use std::fmt;

use ob1_model::{Event, FaultKind, Site};

use ob1_time::Instant;

use crate::wall_clock::Wall;

/// Entries the buffer holds, whatever they are.
pub const DIAG_ENTRIES: usize = 100;
/// Entries it keeps besides: the last STOPs and what led to each.
pub const DIAG_STOPS: usize = 10;
/// Bytes of text an entry holds.
pub const DIAG_TEXT: usize = 80;

/// A short text of fixed size, cut at a character boundary.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct ShortText {
    len: u8,
    bytes: [u8; DIAG_TEXT],
}

impl ShortText {
    /// As much of `text` as fits.
    #[must_use]
    pub fn new(text: &str) -> Self {
        Self::join(&[text])
    }

    /// The pieces one after the other, as much as fits.
    pub(crate) fn join(pieces: &[&str]) -> Self {
        let mut joined = Self::default();
        for piece in pieces {
            let at = usize::from(joined.len);
            let mut end = piece.len().min(DIAG_TEXT - at);
            while !piece.is_char_boundary(end) {
                end -= 1;
            }
            joined.bytes[at..at + end].copy_from_slice(&piece.as_bytes()[..end]);
            joined.len = (at + end) as u8;
        }
        joined
    }

    /// The text, at most as long as an entry has room for.
    #[must_use]
    pub fn as_str(&self) -> &str {
        std::str::from_utf8(&self.bytes[..usize::from(self.len)]).unwrap_or("")
    }
}

impl Default for ShortText {
    fn default() -> Self {
        Self { len: 0, bytes: [0; DIAG_TEXT] }
    }
}

impl fmt::Debug for ShortText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

/// An entry of the diagnostic buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiagEntry {
    /// Counts all entries since the CPU was built, from 1.
    pub number: u64,
    /// When it happened, by the runtime's clock.
    pub time: Instant,
    /// What happened: the event and its number.
    pub event: Event,
    /// The statement, for errors of the program.
    pub site: Option<Site>,
    /// ACCU1 and ACCU2 at that statement.
    pub accus: [u32; 2],
    /// What the event is about: a block, timer or byte number, a module address, a time in milliseconds.
    pub data: u32,
    /// More about it in words; empty: nothing.
    pub text: ShortText,
}

impl DiagEntry {
    /// An entry without a statement; the buffer gives it its number.
    pub(crate) const fn new(time: Instant, event: Event, data: u32, text: ShortText) -> Self {
        Self { number: 0, time, event, site: None, accus: [0; 2], data, text }
    }
}

impl fmt::Display for DiagEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}h {}", self.event.0, self.event.text())?;
        if let Some(site) = self.site {
            write!(f, " ({site}, ACCU1 {:08X}, ACCU2 {:08X}", self.accus[0], self.accus[1])?;
            match FaultKind::from_number(self.event.0).map(FaultKind::counts) {
                Some("") => {}
                Some(what) => write!(f, ", {what} {}", self.data)?,
                None => write!(f, ", number {}", self.data)?,
            }
            write!(f, ")")?;
        }
        if !self.text.as_str().is_empty() {
            write!(f, ": {}", self.text.as_str())?;
        }
        Ok(())
    }
}

/// An entry, and the clock as it was set then: what has happened keeps its date.
#[derive(Clone, Copy, Debug)]
struct Dated {
    entry: DiagEntry,
    wall: Wall,
}

/// The diagnostic buffer: a ring, and what led to the last STOPs.
#[derive(Debug)]
pub struct DiagBuffer {
    entries: Box<[Dated]>,
    written: u64,
    /// Places of their own for STOPs, in ascending order of their numbers; `stops` of them are in use.
    kept: Box<[Dated]>,
    stops: usize,
}

impl DiagBuffer {
    pub(crate) fn new() -> Self {
        let entry = DiagEntry::new(Instant::START, Event(0), 0, ShortText::default());
        let blank = Dated { entry, wall: Wall::new(0) };
        Self {
            entries: vec![blank; DIAG_ENTRIES].into_boxed_slice(),
            written: 0,
            kept: vec![blank; DIAG_STOPS].into_boxed_slice(),
            stops: 0,
        }
    }

    /// Enters `entry`, and `wall`, the clock as it is set now; the buffer gives the entry its number.
    pub(crate) fn push(&mut self, mut entry: DiagEntry, wall: Wall) {
        self.written += 1;
        entry.number = self.written;
        let slot = (self.written - 1) as usize % DIAG_ENTRIES;
        self.entries[slot] = Dated { entry, wall };
    }

    /// The CPU has gone to STOP: keeps the newest entry, and the one before it, unless that is a change of state too.
    pub(crate) fn keep_stop(&mut self) {
        let cause = self.dated(1).filter(|dated| dated.entry.event.state_change().is_none()).copied();
        for dated in cause.into_iter().chain(self.dated(0).copied()) {
            if self.kept[..self.stops].iter().any(|kept| kept.entry.number >= dated.entry.number) {
                continue;
            }
            if self.stops == DIAG_STOPS {
                self.kept.copy_within(1.., 0);
                self.stops -= 1;
            }
            self.kept[self.stops] = dated;
            self.stops += 1;
        }
    }

    /// The `back`th entry, 0 the newest: first those of the ring, then what is kept of those that are gone from it.
    #[must_use]
    pub fn get(&self, back: usize) -> Option<&DiagEntry> {
        self.dated(back).map(|dated| &dated.entry)
    }

    fn dated(&self, back: usize) -> Option<&Dated> {
        if back < DIAG_ENTRIES {
            let number = self.written.checked_sub(back as u64).filter(|number| *number > 0)?;
            return self.entries.get((number - 1) as usize % DIAG_ENTRIES);
        }
        let oldest = self.written.checked_sub(DIAG_ENTRIES as u64)?;
        self.kept[..self.stops].iter().rev().filter(|kept| kept.entry.number <= oldest).nth(back - DIAG_ENTRIES)
    }

    /// All entries, newest first; then the kept STOPs.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &DiagEntry> {
        (0..DIAG_ENTRIES + DIAG_STOPS).map_while(|back| self.get(back))
    }

    /// The same with date and time, by the clock as it was set then.
    pub(crate) fn with_dates(&self) -> impl Iterator<Item = (&DiagEntry, [u8; 8])> {
        let dated = (0..DIAG_ENTRIES + DIAG_STOPS).map_while(|back| self.dated(back));
        dated.map(|dated| (&dated.entry, dated.wall.bytes(dated.entry.time)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_the_newest_hundred() {
        let mut buffer = DiagBuffer::new();
        assert!(buffer.get(0).is_none());
        let mut entry = DiagEntry::new(Instant::START, Event::RUN, 0, ShortText::new("x"));
        for time in 0..250 {
            entry.time = Instant::from_nanos(time);
            buffer.push(entry, Wall::new(0));
        }
        let times: Vec<_> = buffer.iter().map(|e| e.time).collect();
        assert_eq!(times, (150..250).rev().map(Instant::from_nanos).collect::<Vec<_>>());
        assert_eq!(buffer.get(0).map(|e| e.number), Some(250));
    }

    #[test]
    fn a_flood_leaves_the_last_stops() {
        let mut buffer = DiagBuffer::new();
        let entry = |event| DiagEntry::new(Instant::START, event, 0, ShortText::default());
        buffer.keep_stop();
        let mut stops = Vec::new();
        for round in 1..=7 {
            buffer.push(entry(Event::RUN), Wall::new(0));
            // Every second STOP has a cause.
            if round % 2 == 0 {
                buffer.push(entry(Event::OB_NOT_LOADED), Wall::new(0));
                stops.push((buffer.written, Event::OB_NOT_LOADED));
            }
            buffer.push(entry(Event::STOP_SEQUENCE_ERROR), Wall::new(0));
            stops.push((buffer.written, Event::STOP_SEQUENCE_ERROR));
            buffer.keep_stop();
            buffer.keep_stop();
            let seen: Vec<_> = buffer.iter().map(|e| e.number).collect();
            assert!(seen.windows(2).all(|pair| pair[0] > pair[1]), "{seen:?}");
            for _ in 0..250 {
                buffer.push(entry(Event::SEGMENT_GARBAGE), Wall::new(0));
            }
        }
        stops.reverse();
        let kept: Vec<_> = buffer.iter().skip(DIAG_ENTRIES).map(|e| (e.number, e.event)).collect();
        assert_eq!(kept, stops[..DIAG_STOPS]);
        assert_eq!(buffer.iter().count(), DIAG_ENTRIES + DIAG_STOPS);
    }

    #[test]
    fn texts_are_cut_between_characters() {
        let text = ShortText::new(&"ä".repeat(60));
        assert_eq!(text.as_str(), "ä".repeat(40));
        assert_eq!(ShortText::new(&format!("x{}", "ä".repeat(60))).as_str().len(), 79);
    }
}
