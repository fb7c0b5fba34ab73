//! The send buffer: telegrams that wait for the line. [S1 "Daten senden und empfangen"]

use super::frame::{Bytes, FRAME_BYTES, TELEGRAM_BYTES, WAKE};

/// Telegrams the buffer takes: 2048 bytes, each telegram with its synchronization bytes and check sum.
/// [S1 "Beispiel Daten senden ohne Hantierungsbaustein"]
pub const SEND_TELEGRAMS: usize = 2048 / FRAME_BYTES;

/// What the CPU may send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outgoing {
    /// A telegram of eleven bytes.
    Telegram(Bytes),
    /// The single byte AAh.
    Wake,
}

impl Outgoing {
    /// `None`: not a length of a telegram.
    pub(super) fn of(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [WAKE] => Some(Self::Wake),
            _ => bytes.as_array::<TELEGRAM_BYTES>().map(|telegram| Self::Telegram(*telegram)),
        }
    }
}

/// First in, first out.
#[derive(Clone, Debug)]
pub(super) struct Queue {
    slots: [Outgoing; SEND_TELEGRAMS],
    first: usize,
    used: usize,
}

impl Queue {
    pub(super) const fn new() -> Self {
        Self { slots: [Outgoing::Wake; SEND_TELEGRAMS], first: 0, used: 0 }
    }

    pub(super) const fn len(&self) -> usize {
        self.used
    }

    pub(super) const fn clear(&mut self) {
        self.used = 0;
    }

    /// False: the buffer is full.
    pub(super) fn push(&mut self, outgoing: Outgoing) -> bool {
        if self.used == SEND_TELEGRAMS {
            return false;
        }
        self.slots[(self.first + self.used) % SEND_TELEGRAMS] = outgoing;
        self.used += 1;
        true
    }

    pub(super) fn pop(&mut self) -> Option<Outgoing> {
        if self.used == 0 {
            return None;
        }
        let outgoing = self.slots[self.first];
        self.first = (self.first + 1) % SEND_TELEGRAMS;
        self.used -= 1;
        Some(outgoing)
    }
}
