//! What a CP waits for, or what has failed: one reason out of what it shows and what has happened to it.

use ob1_protocols::{Event, Instant, Span, What};
pub(crate) use ob1_words::{Reason, Why};

use crate::port::{Cp, CpEvent, counted};

/// What was received has not been fetched for this long: the program does not call its block. Longer than any scan.
/// (ours)
const NOT_FETCHED: Span = Span::from_secs(1);

/// How long an attempt of the partner that failed is told. What nobody repeats would otherwise be told for ever. (ours)
const RECEIVE_ERROR: Span = Span::from_secs(60);

/// What was received and waits for the CPU.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Waiting {
    /// Telegrams, or orders of the partner.
    pub telegrams: usize,
    /// Changes when the CPU takes a part of one.
    pub progress: u32,
    /// Number of the FC that fetches them (CP 240), otherwise 0.
    pub block: u16,
    /// The CPU is not in STOP.
    pub cpu_runs: bool,
}

/// What has failed at a CP, and since when its CPU takes nothing. The owner of the CP tells it each [`CpEvent`].
#[derive(Debug, Default)]
pub struct Troubles {
    orders: Option<(Instant, Reason)>,
    full: Option<(Instant, Reason)>,
    receives: Option<(Instant, Reason)>,
    /// What waits, and since when nothing of it has been taken.
    stuck: Option<(Instant, Waiting)>,
}

impl Troubles {
    /// Takes an event of the CP.
    pub fn event(&mut self, now: Instant, event: &CpEvent<'_>) {
        match *event {
            CpEvent::Startup { .. } | CpEvent::Working | CpEvent::NoParameters(_) => *self = Self::default(),
            CpEvent::Sent => self.orders = None,
            CpEvent::SendFailed(code) | CpEvent::OrderDiscarded { code: Some(code) } => self.failed(now, code.into()),
            CpEvent::JobFailed(status) => self.failed(now, status),
            CpEvent::Received(_) | CpEvent::Changed(_) | CpEvent::Asked(..) => self.receives = None,
            CpEvent::Protocol(Event { what: What::NoBuffer, .. }) => self.rejected(now),
            CpEvent::Protocol(event) if counted(event.what).is_some() => {
                self.unreadable(now, event.number().unwrap_or(0));
            }
            CpEvent::Rk512(event) => self.entry(now, event.number().unwrap_or(0)),
            CpEvent::Entry(number) => self.entry(now, number),
            _ => {}
        }
    }

    /// Entries of a CP 341 and events of RK 512. Of class 8: 0801h is information, and the states 080Dh and 0818h are
    /// told as long as they last.
    fn entry(&mut self, now: Instant, number: u16) {
        match number {
            0x0801 | 0x080D | 0x0818 => {}
            0x080A => self.rejected(now),
            0x0600..=0x06FF | 0x0800..=0x08FF => self.unreadable(now, number),
            _ => {}
        }
    }

    fn failed(&mut self, now: Instant, number: u16) {
        let before = self.orders.map_or(0, |(_, before)| if before.number == number { before.count } else { 0 });
        self.orders = Some((now, Reason { why: Why::OrderFailed, number, count: before.saturating_add(1) }));
    }

    fn rejected(&mut self, now: Instant) {
        let before = self.full.map_or(0, |(_, before)| before.count);
        self.full = Some((now, Reason { why: Why::Full, number: 0, count: before.saturating_add(1) }));
    }

    fn unreadable(&mut self, now: Instant, number: u16) {
        let before = self.receives.map_or(0, |(_, before)| before.count);
        self.receives = Some((now, Reason { why: Why::ReceiveError, number, count: before.saturating_add(1) }));
    }

    /// The reason now. Call it after steps, and from time to time between them.
    pub fn reason(&mut self, now: Instant, cp: &dyn Cp) -> Option<Reason> {
        let waiting = cp.waiting();
        self.full = self.full.filter(|_| waiting.telegrams > 0);
        self.receives = self.receives.filter(|(last, _)| now < *last + RECEIVE_ERROR);
        let is_same = |(_, before): &(Instant, Waiting)| {
            before.progress == waiting.progress && before.telegrams > 0 && before.cpu_runs == waiting.cpu_runs
        };
        self.stuck = self.stuck.filter(is_same).or(Some((now, waiting)));
        // Of two at the same time, the first.
        let troubles = [self.receives, self.full, self.orders].into_iter().flatten();
        let newest = || troubles.max_by_key(|(last, _)| *last).map(|(_, reason)| reason);
        cp.waits_for().or_else(newest).or_else(|| self.not_fetched(now, waiting))
    }

    fn not_fetched(&self, now: Instant, waiting: Waiting) -> Option<Reason> {
        let is_long = waiting.cpu_runs && self.stuck.is_some_and(|(since, _)| now >= since + NOT_FETCHED);
        let count = u32::try_from(waiting.telegrams).unwrap_or(u32::MAX);
        (is_long && count > 0).then_some(Reason { why: Why::NotFetched, number: waiting.block, count })
    }
}
