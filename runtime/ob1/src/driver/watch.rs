//! What holds at every moment: the words of others, sequences, counters, the ring.

use std::sync::atomic::{Ordering, fence};

use ob1_backplane::Segment;
use ob1_backplane::layout::{BUFFER_SLOTS, COUNTER_WORDS, EVENT_SLOTS, FIELDS, Writer};
use ob1_time::{Instant, Span};

use super::rig::{Breach, Checked};
use super::rules::Rule;

/// How long a write may take: a driver is held up by the system in the middle of one.
const WRITE: Span = Span::SECOND;

/// The offset of a field of the memory map.
pub(super) fn offset(name: &str) -> usize {
    FIELDS.iter().find(|field| field.name == name).map_or(0, |field| field.offset)
}

/// A word of the segment.
pub(super) fn word(segment: &Segment, name: &str, index: usize) -> u64 {
    segment.peek(offset(name) + 8 * index).unwrap_or(0)
}

/// Sets a word, as a predecessor or a CPU that has lost its mind would.
pub(super) fn set(segment: &Segment, name: &str, index: usize, to: u64) {
    segment.poke(offset(name) + 8 * index, to);
}

/// The contents of a driver that have a sequence: its name, and the words after it.
const SEQUENCES: [(&str, usize); 4] =
    [("inputs.sequence", 8), ("send_to_cpu.sequence", 8), ("receive_to_cpu.sequence", 8), ("diagnosis.sequence", 32)];

/// The names of the sequences of a driver.
pub(super) fn sequences() -> impl Iterator<Item = &'static str> {
    SEQUENCES.iter().map(|(name, _)| *name)
}

/// A content under its sequence, as it was seen last.
struct Content {
    at: usize,
    name: &'static str,
    words: usize,
    sequence: u64,
    last: Vec<u64>,
    odd_since: Option<Instant>,
}

/// What is remembered from one look to the next.
pub(super) struct Watch {
    segment: Segment,
    /// Offsets of the words that no driver writes.
    foreign: Vec<usize>,
    /// Their content.
    theirs: Vec<u64>,
    contents: Vec<Content>,
    growing: Vec<(String, usize, u64)>,
    generation: u64,
}

impl Watch {
    pub(super) fn new(segment: &Segment) -> Self {
        let own = |at: usize| {
            let field = FIELDS.iter().find(|field| (field.offset..field.offset + field.size).contains(&at));
            field.is_some_and(|field| matches!(field.writer, Writer::Cp | Writer::Both))
        };
        let mut growing: Vec<(String, usize, u64)> =
            (0..COUNTER_WORDS).map(|n| (format!("counter {n}"), offset("counters") + 8 * n, 0)).collect();
        for name in ["events.produced", "events.lost", "buffer.written"] {
            growing.push((name.into(), offset(name), 0));
        }
        let contents = SEQUENCES.iter().map(|(name, words)| Content {
            at: offset(name),
            name,
            words: *words,
            sequence: 0,
            last: Vec::new(),
            odd_since: None,
        });
        let mut watch = Self {
            segment: segment.clone(),
            foreign: (0..segment.bytes()).step_by(8).filter(|at| !own(*at)).collect(),
            theirs: Vec::new(),
            contents: contents.collect(),
            growing,
            generation: 0,
        };
        watch.forget();
        watch
    }

    /// The segment was changed by the kit in the driver's place: everything is as it is now.
    pub(super) fn forget(&mut self) {
        self.accept();
        for content in &mut self.contents {
            (content.sequence, content.odd_since) = (self.segment.peek(content.at).unwrap_or(0), None);
            content.last.clear();
        }
        for (_, at, last) in &mut self.growing {
            *last = self.segment.peek(*at).unwrap_or(0);
        }
        self.generation = word(&self.segment, "cp.generation", 0);
    }

    /// A driver has attached.
    pub(super) fn attached(&mut self) {
        self.generation = word(&self.segment, "cp.generation", 0);
        for (name, at, last) in &mut self.growing {
            if name == "events.produced" {
                *last = self.segment.peek(*at).unwrap_or(0);
            }
        }
    }

    /// The CPU's side has written.
    pub(super) fn accept(&mut self) {
        self.theirs = self.foreign.iter().map(|at| self.segment.peek(*at).unwrap_or(0)).collect();
    }

    /// Whether the words of others are untouched.
    pub(super) fn foreign(&self) -> Checked {
        for (at, was) in self.foreign.iter().zip(&self.theirs) {
            let is = self.segment.peek(*at).unwrap_or(0);
            if is != *was {
                return Breach::of(Rule::OwnWords, format!("the word at {at:#06x} was {was:#x} and is {is:#x}"));
            }
        }
        Ok(())
    }

    /// One look at everything. A driver that has not attached yet owns nothing.
    pub(super) fn look(&mut self, now: Instant, is_attached: bool) -> Checked {
        self.foreign()?;
        if !is_attached {
            return Ok(());
        }
        let state = word(&self.segment, "cp.state", 0) & 0xffff_ffff;
        if !(1..=5).contains(&state) {
            return Breach::of(Rule::State, format!("cp.state is {state}"));
        }
        let generation = word(&self.segment, "cp.generation", 0);
        if generation != self.generation {
            let was = self.generation;
            return Breach::of(Rule::Generation, format!("it was {was} and is {generation} without a start"));
        }
        for content in &mut self.contents {
            content.look(&self.segment, now)?;
        }
        for (name, at, last) in &mut self.growing {
            let is = self.segment.peek(*at).unwrap_or(0);
            if is.wrapping_sub(*last) > u64::MAX / 2 {
                return Breach::of(Rule::Counters, format!("{name} was {last} and is {is}"));
            }
            *last = is;
        }
        let (produced, consumed) =
            (word(&self.segment, "events.produced", 0), word(&self.segment, "events.consumed", 0));
        if produced.wrapping_sub(consumed) > EVENT_SLOTS as u64 {
            return Breach::of(Rule::Ring, format!("produced is {produced}, consumed {consumed}"));
        }
        Ok(())
    }

    /// The words of the ring and of the diagnostic buffer.
    pub(super) fn words_of(&self, name: &str) -> Vec<u64> {
        let count = if name == "buffer.entries" { BUFFER_SLOTS } else { EVENT_SLOTS * 4 };
        (0..count).map(|index| word(&self.segment, name, index)).collect()
    }
}

impl Content {
    fn look(&mut self, segment: &Segment, now: Instant) -> Checked {
        let before = segment.peek(self.at).unwrap_or(0);
        if before.wrapping_sub(self.sequence) > u64::MAX / 2 {
            let text = format!("{} was {} and is {before}", self.name, self.sequence);
            return Breach::of(Rule::Sequences, text);
        }
        if before % 2 == 1 {
            let since = *self.odd_since.get_or_insert(now);
            if before == self.sequence && now.since(since) > WRITE {
                return Breach::of(Rule::Odd, format!("{} stays {before}", self.name));
            }
            if before != self.sequence {
                (self.sequence, self.odd_since) = (before, Some(now));
                self.last.clear();
            }
            return Ok(());
        }
        self.odd_since = None;
        let words: Vec<u64> = (0..self.words).map(|index| segment.peek(self.at + 8 + 8 * index).unwrap_or(0)).collect();
        fence(Ordering::Acquire);
        if segment.peek(self.at) != Some(before) {
            return Ok(());
        }
        if before == self.sequence && !self.last.is_empty() && self.last != words {
            return Breach::of(Rule::Sequences, format!("the content has changed while {} was {before}", self.name));
        }
        (self.sequence, self.last) = (before, words);
        Ok(())
    }
}
