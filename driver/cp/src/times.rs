//! Where the time of an order goes: what the pump has seen of the orders and telegrams under way.

use ob1_backplane::{OrderTimes, Stage};
use ob1_firmware::Instant;

/// Telegrams that wait to be fetched, of which the times are kept; those of further ones are not said.
const WAITING: usize = 16;

/// The times of what is under way.
#[derive(Debug, Default)]
pub(crate) struct Tracker {
    /// CLOCK_MONOTONIC at the zero of the driver's clock; `None`: nothing is said.
    pub(crate) origin: Option<u64>,
    /// When the first block of an order was posted that is not complete.
    posted: Option<u64>,
    /// The order that the protocol has.
    order: Option<OrderTimes>,
    /// First and last character since the last telegram.
    heard: Option<(u64, u64)>,
    telegrams: [OrderTimes; WAITING],
    waiting: usize,
}

impl Tracker {
    fn at(&self, now: Instant) -> u64 {
        self.origin.map_or(0, |origin| origin.saturating_add(now.nanos()))
    }

    /// The CPU shows a part of an order.
    pub(crate) fn posted(&mut self, at: u64) {
        self.posted.get_or_insert(at);
    }

    /// No order is being handed over.
    pub(crate) fn none(&mut self) {
        self.posted = None;
    }

    /// An order is complete.
    pub(crate) fn taken(&mut self, now: Instant, bytes: usize) {
        let mut order = OrderTimes::new(true, bytes);
        order.say(Stage::Posted, self.posted.take().unwrap_or(0));
        order.say(Stage::Taken, self.at(now));
        self.order = Some(order);
    }

    /// Characters go out.
    pub(crate) fn out(&mut self, now: Instant) {
        let at = self.at(now);
        if let Some(order) = &mut self.order
            && order.at(Stage::FirstOut).is_none()
        {
            order.say(Stage::FirstOut, at);
        }
    }

    /// The last bit of what went out has left.
    pub(crate) fn left(&mut self, now: Instant) {
        let at = self.at(now);
        if let Some(order) = &mut self.order {
            order.say(Stage::LastOut, at);
            order.say(Stage::FirstIn, 0);
            order.say(Stage::LastIn, 0);
        }
    }

    /// Characters have come.
    pub(crate) fn heard(&mut self, now: Instant) {
        let at = self.at(now);
        let (first, _) = self.heard.unwrap_or((at, at));
        self.heard = Some((first, at));
        if let Some(order) = self.order.as_mut().filter(|order| order.at(Stage::LastOut).is_some()) {
            if order.at(Stage::FirstIn).is_none() {
                order.say(Stage::FirstIn, at);
            }
            order.say(Stage::LastIn, at);
        }
    }

    /// The order has ended; its times.
    pub(crate) fn ended(&mut self, now: Instant) -> Option<OrderTimes> {
        let at = self.at(now);
        let mut order = self.order.take()?;
        order.say(Stage::Given, at);
        self.origin.map(|_| order)
    }

    /// A telegram has come.
    pub(crate) fn received(&mut self, bytes: usize) {
        let mut telegram = OrderTimes::new(false, bytes);
        let (first, last) = self.heard.take().unwrap_or_default();
        telegram.say(Stage::FirstIn, first);
        telegram.say(Stage::LastIn, last);
        if let Some(place) = self.telegrams.get_mut(self.waiting) {
            *place = telegram;
            self.waiting += 1;
        }
    }

    /// The oldest telegram was handed over; its times.
    pub(crate) fn delivered(&mut self, now: Instant) -> Option<OrderTimes> {
        self.waiting = self.waiting.checked_sub(1)?;
        self.telegrams.rotate_left(1);
        let mut telegram = self.telegrams[WAITING - 1];
        telegram.say(Stage::Given, self.at(now));
        self.origin.map(|_| telegram)
    }

    /// A start-up: what was under way is gone.
    pub(crate) fn forget(&mut self) {
        *self = Self { origin: self.origin, ..Self::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_has_all_its_times() {
        let mut tracker = Tracker { origin: Some(1_000_000), ..Tracker::default() };
        let at = Instant::from_micros;
        tracker.posted(1_000_100);
        tracker.posted(1_000_200);
        tracker.taken(at(1), 30);
        tracker.heard(at(2));
        tracker.out(at(3));
        tracker.out(at(4));
        tracker.left(at(5));
        tracker.heard(at(6));
        tracker.heard(at(7));
        let order = tracker.ended(at(8)).expect("an order");
        let stages: Vec<_> = Stage::ALL.into_iter().map(|stage| order.at(stage)).collect();
        let us = |us: u64| Some(1_000_000 + 1000 * us);
        assert_eq!(stages, [Some(1_000_100), us(1), us(3), us(5), us(6), us(7), us(8), None]);
        assert_eq!(tracker.ended(at(9)), None);
    }

    #[test]
    fn telegrams_keep_their_order() {
        let mut tracker = Tracker { origin: Some(1), ..Tracker::default() };
        for n in 0..20 {
            tracker.heard(Instant::from_micros(n));
            tracker.received(n as usize);
        }
        let bytes: Vec<u32> =
            std::iter::from_fn(|| tracker.delivered(Instant::from_micros(50))).map(|times| times.bytes).collect();
        assert_eq!(bytes, (0..16).collect::<Vec<u32>>());
    }
}
