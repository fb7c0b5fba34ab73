//! The counters of a CP: they only grow, across all restarts of its driver, and tell what became of each telegram, and
//! with which numbers orders have failed.

pub use ob1_words::Counter;

use crate::layout::{COUNTER_WORDS, ENDS};
use crate::sync::{AtomicU64, Ordering, Words};

const _: () = assert!(Counter::ALL.len() <= COUNTER_WORDS);

/// All counters at one time. They are read one by one, so two of them may differ by a telegram.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters([u64; Counter::ALL.len()]);

impl Counters {
    /// The counter's value since the segment was made.
    pub fn get(&self, counter: Counter) -> u64 {
        self.0.get(counter as usize).copied().unwrap_or(0)
    }

    /// Orders the CP has accepted and not finished yet: in its buffers or on the line. If the driver dies now, they
    /// are lost in the CP.
    pub fn open_orders(&self) -> u64 {
        use Counter::{OrdersAborted, OrdersAccepted, OrdersLost, SendErrors, TelegramsSent};
        self.open(OrdersAccepted, [TelegramsSent, SendErrors, OrdersAborted, OrdersLost])
    }

    /// Telegrams received and not yet delivered to the CPU. If the driver dies now, they are lost in the CP.
    pub fn open_receives(&self) -> u64 {
        use Counter::{ReceiveAborted, ReceiveLost, TelegramsDelivered, TelegramsReceived};
        self.open(TelegramsReceived, [TelegramsDelivered, ReceiveAborted, ReceiveLost])
    }

    fn open<const N: usize>(&self, begun: Counter, ended: [Counter; N]) -> u64 {
        ended.into_iter().fold(self.get(begun), |open, counter| open.saturating_sub(self.get(counter)))
    }

    pub(crate) fn read(cells: &Words<COUNTER_WORDS>) -> Self {
        let mut values = [0; Counter::ALL.len()];
        for (value, cell) in values.iter_mut().zip(&cells.0) {
            *value = cell.load(Ordering::Relaxed);
        }
        Self(values)
    }
}

fn cell(cells: &Words<COUNTER_WORDS>, counter: Counter) -> Option<&AtomicU64> {
    cells.0.get(counter as usize)
}

/// Adds to one counter. There is one writer at a time, so no read-modify-write instruction is needed.
#[inline]
pub(crate) fn add(cells: &Words<COUNTER_WORDS>, counter: Counter, count: u64) {
    if let Some(cell) = cell(cells, counter) {
        cell.store(cell.load(Ordering::Relaxed).wrapping_add(count), Ordering::Relaxed);
    }
}

/// Books what a dead driver had in its buffers as lost. Doing it twice changes nothing.
pub(crate) fn book_lost(cells: &Words<COUNTER_WORDS>) {
    let now = Counters::read(cells);
    add(cells, Counter::OrdersLost, now.open_orders());
    add(cells, Counter::ReceiveLost, now.open_receives());
}

/// Orders that ended with an error number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ends {
    /// The number: a code of the indicator word, or a STATUS; [`Ends::OTHERS`] for all that found no room.
    pub number: u16,
    /// How many orders ended with it; at most 2^48 - 1.
    pub count: u64,
}

impl Ends {
    /// Stands for all numbers without a word of their own.
    pub const OTHERS: u16 = 0xFFFF;

    fn of(word: u64) -> Option<Self> {
        (word != 0).then_some(Self { number: word as u16, count: word >> 16 })
    }
}

/// Counts an order that ended with this number: in the word of the number, or in the first that is free; in the last
/// word if there is none.
pub(crate) fn add_end(cells: &Words<ENDS>, number: u16) {
    let Some((last, own)) = cells.0.split_last() else { return };
    let is_free_or_its =
        |cell: &&AtomicU64| Ends::of(cell.load(Ordering::Relaxed)).is_none_or(|ends| ends.number == number);
    let (cell, number) = own.iter().find(is_free_or_its).map_or((last, Ends::OTHERS), |cell| (cell, number));
    let count = (cell.load(Ordering::Relaxed) >> 16).wrapping_add(1);
    cell.store(count << 16 | u64::from(number), Ordering::Relaxed);
}

/// The numbers with which orders have ended.
pub(crate) fn ends(cells: &Words<ENDS>) -> impl Iterator<Item = Ends> {
    cells.0.iter().filter_map(|cell| Ends::of(cell.load(Ordering::Relaxed)))
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn what_is_open_when_the_driver_dies_is_lost_once() {
        let cells = Words::default();
        add(&cells, Counter::OrdersAccepted, 10);
        add(&cells, Counter::TelegramsSent, 6);
        add(&cells, Counter::SendErrors, 1);
        add(&cells, Counter::OrdersAborted, 1);
        add(&cells, Counter::TelegramsReceived, 5);
        add(&cells, Counter::TelegramsDelivered, 4);
        let before = Counters::read(&cells);
        assert_eq!((before.open_orders(), before.open_receives()), (2, 1));
        book_lost(&cells);
        book_lost(&cells);
        let after = Counters::read(&cells);
        assert_eq!((after.get(Counter::OrdersLost), after.get(Counter::ReceiveLost)), (2, 1));
        assert_eq!((after.open_orders(), after.open_receives()), (0, 0));
    }

    #[test]
    fn counters_that_contradict_each_other_are_no_panic() {
        let cells = Words::default();
        add(&cells, Counter::TelegramsSent, u64::MAX);
        add(&cells, Counter::SendErrors, u64::MAX);
        add(&cells, Counter::TelegramsSent, 2);
        book_lost(&cells);
        assert_eq!(Counters::read(&cells).open_orders(), 0);
    }

    #[test]
    fn each_number_has_a_word_as_long_as_there_are_some() {
        let cells = Words::default();
        for number in [0x07, 0x0708, 0x07, 0] {
            add_end(&cells, number);
        }
        let told: Vec<_> = ends(&cells).map(|ends| (ends.number, ends.count)).collect();
        assert_eq!(told, [(0x07, 2), (0x0708, 1), (0, 1)]);
        for number in 0x0800..0x0820 {
            add_end(&cells, number);
        }
        assert_eq!(ends(&cells).count(), ENDS);
        assert_eq!(ends(&cells).last(), Some(Ends { number: Ends::OTHERS, count: 32 - (ENDS as u64 - 4) }));
        assert_eq!(ends(&cells).map(|ends| ends.count).sum::<u64>(), 36);
    }

    #[test]
    fn names_are_distinct() {
        for (index, counter) in Counter::ALL.iter().enumerate() {
            assert_eq!(*counter as usize, index);
            assert!(Counter::ALL.iter().skip(index + 1).all(|other| other.name() != counter.name()));
        }
    }
}
