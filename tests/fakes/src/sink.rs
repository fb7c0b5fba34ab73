//! Where a protocol machine puts its results: recorded, and checked against what [`Sink`] promises.

use ob1_protocols::{Event, SendError, Sink, Wire};

/// Everything a machine has put out.
#[derive(Debug)]
pub struct MachineLog {
    /// What [`Sink::room`] says, in bytes.
    pub room: usize,
    /// What was sent, a piece for each call.
    pub sent: Vec<Vec<u8>>,
    /// The telegrams it has received.
    pub telegrams: Vec<Vec<u8>>,
    /// How its orders have ended.
    pub ended: Vec<Result<(), SendError>>,
}

impl MachineLog {
    /// Of a machine whose owner has so much room, in bytes.
    #[must_use]
    pub const fn with_room(room: usize) -> Self {
        Self { room, sent: Vec::new(), telegrams: Vec::new(), ended: Vec::new() }
    }
}

impl Wire for MachineLog {
    fn transmit(&mut self, bytes: &[u8]) {
        assert!(!bytes.is_empty(), "nothing to send");
        self.sent.push(bytes.to_vec());
    }
}

impl Sink for MachineLog {
    fn room(&self) -> usize {
        self.room
    }

    fn deliver(&mut self, telegram: &[u8]) {
        assert!(!telegram.is_empty() && telegram.len() <= self.room, "{} bytes for {}", telegram.len(), self.room);
        self.telegrams.push(telegram.to_vec());
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.ended.push(outcome);
    }

    fn report(&mut self, _event: Event) {}
}
