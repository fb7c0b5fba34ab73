//! Which records are in flight, and which have arrived.

use std::collections::VecDeque;

/// Maximum of QoS 1 publishes in flight.
pub(crate) const WINDOW: usize = 100;

/// The publishes of one connection, in the order they were requested. A broker acknowledges in that order; with one
/// that does not, nothing is lost, because a record counts as arrived only when all before it have.
#[derive(Debug, Default)]
pub(crate) struct Flow {
    window: VecDeque<InFlight>,
}

#[derive(Debug)]
struct InFlight {
    /// Its packet identifier, once it is on the wire.
    packet: Option<u16>,
    arrived: bool,
    /// Whether it is the next record of the store; others are the connection's own messages.
    stored: bool,
}

impl Flow {
    /// Records of the store in flight.
    pub(crate) fn stored(&self) -> usize {
        self.window.iter().filter(|publish| publish.stored).count()
    }

    /// Whether there is room for one more.
    pub(crate) fn has_room(&self) -> bool {
        self.window.len() < WINDOW
    }

    /// A publish has been requested.
    pub(crate) fn asked(&mut self, stored: bool) {
        self.window.push_back(InFlight { packet: None, arrived: false, stored });
    }

    /// The next publish is on the wire.
    pub(crate) fn sent(&mut self, packet: u16) {
        if let Some(publish) = self.window.iter_mut().find(|publish| publish.packet.is_none()) {
            publish.packet = Some(packet);
        }
    }

    /// A publish is acknowledged: returns how many records of the store have now arrived.
    pub(crate) fn acknowledged(&mut self, packet: u16) -> usize {
        if let Some(publish) = self.window.iter_mut().find(|publish| publish.packet == Some(packet) && !publish.arrived)
        {
            publish.arrived = true;
        }
        let mut arrived = 0;
        while self.window.front().is_some_and(|publish| publish.arrived) {
            arrived += usize::from(self.window.pop_front().is_some_and(|publish| publish.stored));
        }
        arrived
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_has_arrived_when_all_before_it_have() {
        let mut flow = Flow::default();
        flow.asked(false);
        (0..3).for_each(|_| flow.asked(true));
        (1..=4).for_each(|packet| flow.sent(packet));
        assert_eq!(flow.stored(), 3);
        assert_eq!((flow.acknowledged(3), flow.acknowledged(2)), (0, 0));
        assert_eq!((flow.acknowledged(9), flow.acknowledged(3)), (0, 0), "unknown, twice");
        assert_eq!((flow.acknowledged(1), flow.stored()), (2, 1));
        assert_eq!((flow.acknowledged(4), flow.stored()), (1, 0));
    }

    #[test]
    fn the_window_is_bounded() {
        let mut flow = Flow::default();
        (0..WINDOW).for_each(|_| flow.asked(true));
        assert!(!flow.has_room());
        flow.sent(1);
        assert_eq!(flow.acknowledged(1), 1);
        assert!(flow.has_room());
    }
}
