//! Where the time of an order goes: what a driver says of its last orders and telegrams, and the runtime's account.

use crate::cells::TimesCells;
use crate::layout::TIMES_SLOTS;
use crate::sync::{AtomicU64, Ordering, fence};

/// A moment in the life of an order. Times are CLOCK_MONOTONIC in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(usize)]
pub enum Stage {
    /// The block wrote its first part: beginning of that scan.
    Posted,
    /// The driver took the whole order over.
    Taken,
    /// The first character left.
    FirstOut,
    /// The last character left.
    LastOut,
    /// The first character came.
    FirstIn,
    /// The last character came.
    LastIn,
    /// The driver showed the end, or the telegram, to the CPU.
    Given,
    /// The program could see it: end of the first scan that began after that. The driver does not say it.
    Seen,
}

impl Stage {
    /// All, in their order.
    pub const ALL: [Self; 8] = [
        Self::Posted,
        Self::Taken,
        Self::FirstOut,
        Self::LastOut,
        Self::FirstIn,
        Self::LastIn,
        Self::Given,
        Self::Seen,
    ];

    /// Its name, as reports print it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Posted => "posted",
            Self::Taken => "taken",
            Self::FirstOut => "first_out",
            Self::LastOut => "last_out",
            Self::FirstIn => "first_in",
            Self::LastIn => "last_in",
            Self::Given => "given",
            Self::Seen => "seen",
        }
    }
}

/// The times of one order or telegram.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OrderTimes {
    /// An order of the CPU; otherwise a telegram of the partner.
    pub is_order: bool,
    /// Bytes of user data; at most 2^24 - 1.
    pub bytes: u32,
    at: [u64; 8],
}

impl OrderTimes {
    /// Nothing is said yet.
    pub fn new(is_order: bool, bytes: usize) -> Self {
        Self { is_order, bytes: u32::try_from(bytes).unwrap_or(u32::MAX).min(0xFF_FFFF), at: [0; 8] }
    }

    /// When this was, CLOCK_MONOTONIC in nanoseconds; `None`: not said.
    pub fn at(&self, stage: Stage) -> Option<u64> {
        Some(self.at[stage as usize]).filter(|at| *at != 0)
    }

    /// Says when this was; 0: not said.
    pub fn say(&mut self, stage: Stage, at: u64) {
        self.at[stage as usize] = at;
    }

    /// How long each stage took that is said: from the one said before it, in nanoseconds. A clock that went back, or a
    /// driver that says nonsense, counts as 0.
    pub fn stages(&self) -> impl Iterator<Item = (Stage, u64)> {
        let said = Stage::ALL.into_iter().filter_map(|stage| Some((stage, self.at(stage)?)));
        let before = said.clone();
        said.skip(1).zip(before).map(|((stage, at), (_, before))| (stage, at.saturating_sub(before)))
    }

    fn to_words(self) -> [u64; 8] {
        let [posted, taken, first_out, last_out, first_in, last_in, given, _] = self.at;
        let kind = if self.is_order { 1 } else { 2 };
        [kind | u64::from(self.bytes) << 8, posted, taken, first_out, last_out, first_in, last_in, given]
    }

    /// A kind without meaning is no entry.
    fn from_words([head, posted, taken, first_out, last_out, first_in, last_in, given]: [u64; 8]) -> Option<Self> {
        let is_order = match head & 0xff {
            1 => true,
            2 => false,
            _ => return None,
        };
        let at = [posted, taken, first_out, last_out, first_in, last_in, given, 0];
        Some(Self { is_order, bytes: (head >> 8) as u32 & 0xFF_FFFF, at })
    }
}

/// The driver's end of the ring.
pub(crate) fn enter(cells: &TimesCells, times: OrderTimes) {
    let number = cells.written.load(Ordering::Relaxed);
    // Pairs with the reader's fence: a reader of a word below also reads the number that says it is overwritten.
    fence(Ordering::Release);
    for (cell, word) in slot(cells, number).iter().zip(times.to_words()) {
        cell.store(word, Ordering::Relaxed);
    }
    cells.written.store(number.wrapping_add(1), Ordering::Release);
}

fn slot(cells: &TimesCells, number: u64) -> &[AtomicU64; 8] {
    &cells.entries[(number % TIMES_SLOTS as u64) as usize].0
}

/// An entry, if it is still whole.
pub(crate) fn entry(cells: &TimesCells, number: u64) -> Option<OrderTimes> {
    let words = slot(cells, number).each_ref().map(|cell| cell.load(Ordering::Relaxed));
    fence(Ordering::Acquire);
    let ahead = cells.written.load(Ordering::Relaxed).wrapping_sub(number);
    (1..TIMES_SLOTS as u64).contains(&ahead).then(|| OrderTimes::from_words(words)).flatten()
}

/// A time that far after the beginning of a scan is nonsense of a driver: the entry does not wait for it.
const SCAN_MOST: u64 = 60_000_000_000;

/// Buckets of a [`Spread`]: up to 10 us, 100 us, 1 ms, 10 ms, 100 ms, 1 s, 10 s, and longer.
pub const SPREAD_BOUNDS: [u64; 7] =
    [10_000, 100_000, 1_000_000, 10_000_000, 100_000_000, 1_000_000_000, 10_000_000_000];

/// How long one stage took, of all orders so far.
#[derive(Debug, Default)]
struct StageCells {
    buckets: [core::sync::atomic::AtomicU64; 8],
    total: core::sync::atomic::AtomicU64,
}

/// The account of all orders and telegrams of a CP, kept by the scan and read by any thread.
#[derive(Debug, Default)]
pub(crate) struct TimesAccount {
    /// Telegrams, then orders.
    stages: [[StageCells; 8]; 2],
}

/// How long one stage took.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spread {
    /// Of orders; otherwise of telegrams.
    pub is_order: bool,
    /// The stage, which begins with the one said before it.
    pub stage: Stage,
    /// How many took up to each of [`SPREAD_BOUNDS`], each counted once, and how many took longer.
    pub buckets: [u64; 8],
    /// The sum of all, in nanoseconds.
    pub total: u64,
}

impl TimesAccount {
    /// Adds an order. One thread does this.
    fn enter(&self, times: &OrderTimes) {
        use core::sync::atomic::Ordering::Relaxed;
        for (stage, took) in times.stages() {
            let cells = &self.stages[usize::from(times.is_order)][stage as usize];
            let bucket = SPREAD_BOUNDS.iter().position(|bound| took <= *bound).unwrap_or(SPREAD_BOUNDS.len());
            cells.buckets[bucket].fetch_add(1, Relaxed);
            cells.total.fetch_add(took, Relaxed);
        }
    }

    /// The stages of which something is known.
    pub(crate) fn spreads(&self) -> impl Iterator<Item = Spread> {
        use core::sync::atomic::Ordering::Relaxed;
        [true, false].into_iter().flat_map(move |is_order| {
            Stage::ALL.into_iter().filter_map(move |stage| {
                let cells = &self.stages[usize::from(is_order)][stage as usize];
                let buckets = cells.buckets.each_ref().map(|bucket| bucket.load(Relaxed));
                let is_known = buckets.iter().any(|count| *count != 0);
                is_known.then(|| Spread { is_order, stage, buckets, total: cells.total.load(Relaxed) })
            })
        })
    }
}

/// The runtime's end: takes entries in their order, once the program could see them.
#[derive(Debug, Default)]
pub(crate) struct TimesReader {
    read: u64,
}

impl TimesReader {
    /// Entries that a scan from `begin` to `end` could see; they are added to the account. `told` gets each of them.
    pub(crate) fn take(
        &mut self,
        cells: &TimesCells,
        (begin, end): (u64, u64),
        account: &TimesAccount,
        mut told: impl FnMut(&OrderTimes),
    ) {
        let written = cells.written.load(Ordering::Acquire);
        // More than the ring holds, or a count that went back: what is lost is lost.
        if written.wrapping_sub(self.read) >= TIMES_SLOTS as u64 {
            self.read = written.saturating_sub(TIMES_SLOTS as u64 - 1);
        }
        while self.read != written {
            if let Some(mut times) = entry(cells, self.read) {
                let given = times.at(Stage::Given).unwrap_or(0);
                if given > begin && given - begin < SCAN_MOST {
                    return;
                }
                if given != 0 {
                    times.say(Stage::Seen, end);
                }
                account.enter(&times);
                told(&times);
            }
            self.read = self.read.wrapping_add(1);
        }
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    fn order(posted: u64, given: u64) -> OrderTimes {
        let mut times = OrderTimes::new(true, 30);
        for (stage, at) in [(Stage::Posted, posted), (Stage::Taken, posted + 500), (Stage::Given, given)] {
            times.say(stage, at);
        }
        times
    }

    #[test]
    fn entries_come_back_as_long_as_the_ring_has_them() {
        let cells = TimesCells::default();
        for n in 0..40 {
            enter(&cells, order(1000 * n + 1, 1000 * n + 900));
        }
        let posted: Vec<_> = (0..41).filter_map(|number| entry(&cells, number)?.at(Stage::Posted)).collect();
        assert_eq!(posted, (25..40).map(|n| 1000 * n + 1).collect::<Vec<_>>());
    }

    #[test]
    fn a_stage_lasts_from_the_one_said_before_it() {
        let mut times = order(1000, 9000);
        times.say(Stage::Seen, 8000);
        let stages: Vec<_> = times.stages().collect();
        assert_eq!(stages, [(Stage::Taken, 500), (Stage::Given, 7500), (Stage::Seen, 0)], "back in time is 0");
    }

    #[test]
    fn the_program_sees_an_order_at_the_end_of_the_next_scan() {
        let (cells, account, mut reader) = (TimesCells::default(), TimesAccount::default(), TimesReader::default());
        enter(&cells, order(1000, 5000));
        let mut seen = Vec::new();
        reader.take(&cells, (4000, 6000), &account, |times| seen.push(times.at(Stage::Seen)));
        assert_eq!(seen, [], "this scan began before it was given");
        reader.take(&cells, (6000, 7000), &account, |times| seen.push(times.at(Stage::Seen)));
        reader.take(&cells, (8000, 9000), &account, |times| seen.push(times.at(Stage::Seen)));
        assert_eq!(seen, [Some(7000)]);
        let spread: Vec<_> = account.spreads().map(|spread| (spread.stage, spread.buckets[0], spread.total)).collect();
        assert_eq!(spread, [(Stage::Taken, 1, 500), (Stage::Given, 1, 3500), (Stage::Seen, 1, 2000)]);
    }

    #[test]
    fn nonsense_of_a_driver_is_no_entry_and_ends_the_reading() {
        let cells = TimesCells::default();
        cells.written.store(u64::MAX, Ordering::Relaxed);
        let (account, mut reader) = (TimesAccount::default(), TimesReader::default());
        reader.take(&cells, (1, 2), &account, |_| panic!("zeros are no entries"));
        assert_eq!(reader.read, u64::MAX);
    }
}
