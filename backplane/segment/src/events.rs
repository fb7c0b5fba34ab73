//! Events of a CP: fixed records of 32 bytes in a ring. When it is full, new ones are counted and dropped.

use ob1_words::codes;

use crate::bytes::{copy_out, words_of};
use crate::cells::EventCells;
use crate::fault::Fault;
use crate::layout::{EVENT_DATA_BYTES, EVENT_SLOTS};
use crate::sync::{Ordering, Words};

codes! {
    /// What an event asks of the CPU.
    EventKind {
        /// A process interrupt: OB 40.
        ProcessInterrupt = 1,
        /// A diagnostic interrupt, the fault comes: OB 82.
        DiagnosticIncoming = 2,
        /// A diagnostic interrupt, the fault goes: OB 82.
        DiagnosticOutgoing = 3,
        /// The module is gone: OB 83.
        Removed = 4,
        /// The module is back: OB 83.
        Inserted = 5,
        /// No interrupt, an entry in the diagnostic buffer.
        Message = 6,
    }
}

/// An event as the CPU reads it from the ring.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// Time of the driver's clock, in nanoseconds since its start.
    pub time: u64,
    /// What it asks of the CPU.
    pub kind: EventKind,
    /// The firmware's number of the event.
    pub code: u32,
    len: u8,
    data: [u8; EVENT_DATA_BYTES],
}

impl Event {
    /// An event with up to 16 bytes of data; what is longer is cut.
    pub fn new(time: u64, kind: EventKind, code: u32, data: &[u8]) -> Self {
        let mut event = Self { time, kind, code, len: 0, data: [0; EVENT_DATA_BYTES] };
        for (to, from) in event.data.iter_mut().zip(data) {
            *to = *from;
            event.len += 1;
        }
        event
    }

    /// Its data: at most 16 bytes.
    pub fn data(&self) -> &[u8] {
        self.data.get(..usize::from(self.len)).unwrap_or(&self.data)
    }

    fn to_words(self) -> [u64; 4] {
        let head = self.kind as u64 | u64::from(self.len) << 16 | u64::from(self.code) << 32;
        let mut words = [self.time, head, 0, 0];
        for (word, data) in words.iter_mut().skip(2).zip(words_of(&self.data)) {
            *word = data;
        }
        words
    }

    fn from_words([time, head, low, high]: [u64; 4]) -> Result<Self, Fault> {
        let kind = u8::try_from(head & 0xffff).ok().and_then(EventKind::of).ok_or(Fault::Event(head))?;
        let len = (head >> 16 & 0xff) as u8;
        if usize::from(len) > EVENT_DATA_BYTES {
            return Err(Fault::Event(head));
        }
        let mut data = [0; EVENT_DATA_BYTES];
        copy_out(&[low, high], &mut data);
        // Bytes beyond the length are remains of an earlier record or of a careless driver.
        for byte in data.iter_mut().skip(usize::from(len)) {
            *byte = 0;
        }
        Ok(Self { time, kind, code: (head >> 32) as u32, len, data })
    }
}

fn slot(cells: &EventCells, number: u64) -> &Words<4> {
    // The remainder is always a valid index, and the compiler knows it.
    &cells.slots.0[(number % EVENT_SLOTS as u64) as usize]
}

/// The driver's end of the ring.
pub(crate) struct Producer {
    produced: u64,
}

impl Producer {
    /// The producer that follows a dead one, or the first: complete events of the dead one stay.
    pub(crate) fn resume(cells: &EventCells) -> Self {
        let consumed = cells.consumed.load(Ordering::Acquire);
        let produced = cells.produced.load(Ordering::Relaxed);
        if produced.wrapping_sub(consumed) > EVENT_SLOTS as u64 {
            cells.produced.store(consumed, Ordering::Release);
            return Self { produced: consumed };
        }
        Self { produced }
    }

    /// Puts an event into the ring. False: the ring is full (or the consumer's counter is impossible), and the event is
    /// counted as lost.
    pub(crate) fn emit(&mut self, cells: &EventCells, event: Event) -> bool {
        // Pairs with the consumer's store(Release): it has read the slot before we overwrite it.
        let consumed = cells.consumed.load(Ordering::Acquire);
        if self.produced.wrapping_sub(consumed) >= EVENT_SLOTS as u64 {
            cells.lost.store(cells.lost.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
            return false;
        }
        for (cell, word) in slot(cells, self.produced).0.iter().zip(event.to_words()) {
            cell.store(word, Ordering::Relaxed);
        }
        self.produced = self.produced.wrapping_add(1);
        // Pairs with the consumer's load(Acquire) of `produced`.
        cells.produced.store(self.produced, Ordering::Release);
        true
    }
}

/// The CPU's end of the ring.
pub(crate) struct Consumer {
    consumed: u64,
}

impl Consumer {
    /// The consumer of a fresh segment.
    pub(crate) const fn new() -> Self {
        Self { consumed: 0 }
    }

    /// Takes the oldest event. After a fault the next call continues after it.
    #[inline]
    pub(crate) fn poll(&mut self, cells: &EventCells) -> Result<Option<Event>, Fault> {
        // Pairs with the producer's store(Release) of `produced`.
        let produced = cells.produced.load(Ordering::Acquire);
        if produced == self.consumed {
            return Ok(None);
        }
        self.take(cells, produced)
    }

    fn take(&mut self, cells: &EventCells, produced: u64) -> Result<Option<Event>, Fault> {
        if produced.wrapping_sub(self.consumed) > EVENT_SLOTS as u64 {
            let fault = Fault::EventRing { produced, consumed: self.consumed };
            self.advance(cells, produced);
            return Err(fault);
        }
        let words = slot(cells, self.consumed).0.each_ref().map(|cell| cell.load(Ordering::Relaxed));
        self.advance(cells, self.consumed.wrapping_add(1));
        Event::from_words(words).map(Some)
    }

    fn advance(&mut self, cells: &EventCells, to: u64) {
        self.consumed = to;
        self.publish(cells);
    }

    /// Publishes how far the consumer is.
    pub(crate) fn publish(&self, cells: &EventCells) {
        // Pairs with the producer's load(Acquire) of `consumed`.
        cells.consumed.store(self.consumed, Ordering::Release);
    }
}
