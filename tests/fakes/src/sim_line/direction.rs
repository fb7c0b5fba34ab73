//! One direction of the line: characters that one end has sent and the other has not yet received.

use std::collections::VecDeque;

use ob1_line::sim::{Fate, SplitMix64};
use ob1_line::{Instant, LineFault, Span};

use super::{SimConfig, SimEvent};

/// A character in transit, or its fault.
#[derive(Debug, Clone, Copy)]
struct Item {
    /// When its transmission began.
    begin: Instant,
    /// When its last bit arrives.
    arrival: Instant,
    what: What,
}

#[derive(Debug, Clone, Copy)]
enum What {
    Byte(u8),
    Fault(LineFault),
    Cts(bool),
}

#[derive(Debug, Clone, Default)]
pub(super) struct Direction {
    items: VecDeque<Item>,
    /// When the last bit handed over has been sent.
    busy_until: Instant,
    /// The writer has not yet been told that everything has been sent.
    owes_done: bool,
    /// Arrival of the last item: nothing arrives out of order.
    last_arrival: Instant,
}

impl Direction {
    pub(super) fn is_sending(&self, now: Instant) -> bool {
        now < self.busy_until
    }

    /// When everything has been sent; [`Instant::NEVER`] if the writer has been told, or there is nothing.
    pub(super) fn next_done(&self) -> Instant {
        if self.owes_done { self.busy_until } else { Instant::NEVER }
    }

    pub(super) fn take_done(&mut self) {
        self.owes_done = false;
    }

    /// When the next items are delivered: the first, and those within `coalesce` after it. [`Instant::NEVER`] if there
    /// are none.
    pub(super) fn next_arrival(&self, coalesce: Span) -> Instant {
        match (self.items.front(), self.items.back()) {
            (Some(first), _) if coalesce.is_zero() => first.arrival,
            (Some(first), Some(last)) => last.arrival.min(first.arrival.saturating_add(coalesce)),
            _ => Instant::NEVER,
        }
    }

    pub(super) fn write(
        &mut self,
        config: &SimConfig,
        rng: &mut SplitMix64,
        now: Instant,
        bytes: &[u8],
        cut: bool,
        collides: bool,
    ) {
        let mut begin = self.busy_until.max(now);
        self.items.reserve(bytes.len());
        for &byte in bytes {
            let fate = if cut {
                Fate::Lost
            } else if collides {
                Fate::Unreadable(LineFault::Framing)
            } else if begin >= config.faults_until {
                Fate::Whole
            } else {
                Fate::of(&config.faults, rng)
            };
            let time = config.char_time;
            match fate {
                Fate::Whole => self.push(begin, time, Span::ZERO, What::Byte(byte)),
                Fate::Flip(mask) => self.push(begin, time, Span::ZERO, What::Byte(byte ^ mask)),
                Fate::Lost => {}
                Fate::Doubled => {
                    self.push(begin, time, Span::ZERO, What::Byte(byte));
                    self.push(begin, time, Span::ZERO, What::Byte(byte));
                }
                Fate::Late(delay) => self.push(begin, time, delay, What::Byte(byte)),
                Fate::Unreadable(fault) => self.push(begin, time, Span::ZERO, What::Fault(fault)),
            }
            begin += time;
        }
        self.busy_until = begin;
        self.owes_done = true;
    }

    /// No two characters arrive within less than a character time.
    fn push(&mut self, begin: Instant, time: Span, delay: Span, what: What) {
        let arrival = (begin + time).max(self.last_arrival + time) + delay;
        self.last_arrival = arrival;
        self.items.push_back(Item { begin, arrival, what });
    }

    pub(super) fn set_rts(&mut self, now: Instant, on: bool) {
        // A level does not wait for the characters on the line.
        let place = self.items.partition_point(|item| item.arrival <= now);
        self.items.insert(place, Item { begin: now, arrival: now, what: What::Cts(on) });
    }

    pub(super) fn take_back(&mut self, now: Instant, char_time: Span) -> usize {
        let waiting = self.busy_until.since(now) / char_time.max(Span::from_nanos(1));
        self.busy_until -= waiting * char_time;
        while self.items.back().is_some_and(|item| item.begin >= self.busy_until && !matches!(item.what, What::Cts(_)))
        {
            self.items.pop_back();
        }
        if waiting > 0 {
            self.last_arrival = self.items.back().map_or(now, |item| item.arrival);
        }
        waiting as usize
    }

    /// Characters that have arrived by `limit`, up to the first other event; or that event, if it comes first.
    pub(super) fn take_arrivals(&mut self, limit: Instant, buffer: &mut [u8]) -> SimEvent {
        let mut taken = 0;
        while let Some(item) = self.items.front().filter(|item| item.arrival <= limit) {
            match item.what {
                What::Byte(byte) => match buffer.get_mut(taken) {
                    Some(place) => *place = byte,
                    None => break,
                },
                _ if taken > 0 => break,
                What::Fault(fault) => {
                    self.items.pop_front();
                    return SimEvent::Fault(fault);
                }
                What::Cts(on) => {
                    self.items.pop_front();
                    return SimEvent::Cts(on);
                }
            }
            taken += 1;
            self.items.pop_front();
        }
        SimEvent::Rx(taken)
    }
}
