//! The state of an order of this CPU between two calls of FC 2 or FC 3: pure steps over control bits and registers.

use super::telegram::{COUNT, FRAME_ERROR, INITIALISED, KIND, OWN, RESULT_BYTES, Rx, Tx, last_count};
use crate::registers::{BlockBytes, Words};

/// The phase of an order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Phase {
    /// No order: a call with these control bits starts one.
    #[default]
    Idle,
    /// Header and data are being passed to the CP.
    Sending,
    /// The CP has the order; the block waits for the result.
    Waiting,
    /// The result is being received.
    Receiving,
    /// The result is complete; the CP must see the last echo.
    Closing,
}

/// An order between two calls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Job {
    pub(crate) phase: Phase,
    /// Mark of the order, 1 to 31.
    pub(crate) token: u8,
    /// Length of the telegram in bytes.
    pub(crate) total: u16,
    /// Bytes of the telegram transferred so far; while closing: the error code.
    pub(crate) gese: u16,
    /// The order has failed.
    pub(crate) failed: bool,
}

/// What a call does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing: the CP has to act.
    Wait,
    /// Write this block of the telegram.
    Post { from: u16, len: u16, word: u16 },
    /// Write only the count word of `TX`.
    Word(u16),
    /// The CP has the whole order: `TX` is free.
    Handed,
    /// Store these bytes of the result, then echo the word.
    Take { from: u16, len: u16, word: u16 },
    /// The result of an abandoned order: echo the word, store nothing.
    Drain(u16),
    /// The order has ended; `Err`: the code for ANZW. `TX` and `RX echo` are set to the given words.
    Ended { outcome: Result<(), u8>, tx: Option<u16>, echo: Option<u16> },
}

impl Job {
    /// The order that the parameters hold, with mark and count in ANZ.
    pub(crate) fn of(phase: Phase, anz: u16, gese: u16, failed: bool) -> Self {
        Self { phase, token: (anz >> 11) as u8, total: anz & COUNT, gese, failed }
    }

    /// The parameter ANZ: mark and count.
    pub(crate) fn anz(self) -> u16 {
        u16::from(self.token) << 11 | self.total & COUNT
    }

    /// Starts an order of `total` bytes.
    pub(crate) fn start(token: u8, total: u16) -> (Self, Step) {
        let job = Job { phase: Phase::Sending, token, total, gese: 0, failed: false };
        (job, Self::step_of(Tx::next(OWN, total, 0)))
    }

    fn step_of(tx: Tx) -> Step {
        match tx {
            Tx::Wait => Step::Wait,
            Tx::Post { from, len, word } => Step::Post { from, len, word },
            Tx::Close => Step::Word(0),
            Tx::Taken => Step::Handed,
            Tx::Refused(code) => Step::Ended { outcome: Err(code), tx: Some(crate::registers::FAILED), echo: None },
            Tx::Broken => Step::Ended { outcome: Err(FRAME_ERROR), tx: Some(0), echo: None },
        }
    }

    /// The order is running, and the CP has not restarted since.
    pub(crate) fn go_on(self, words: Words, block: &BlockBytes) -> (Self, Step) {
        let rx = words.rx;
        match self.phase {
            Phase::Idle => (self, Step::Wait),
            Phase::Sending => {
                let (gese, tx) = Tx::go_on(words.tx_echo, OWN, self.total, self.gese);
                let phase = if tx == Tx::Taken { Phase::Waiting } else { Phase::Sending };
                (Job { phase, gese, ..self }, Self::step_of(tx))
            }
            Phase::Waiting if rx & KIND != OWN || rx & COUNT == 0 => (self, Step::Wait),
            Phase::Waiting if rx & COUNT < RESULT_BYTES || block[1] != self.token => (self, Step::Drain(rx)),
            Phase::Waiting => {
                let job = Job { phase: Phase::Receiving, total: rx & COUNT, gese: 0, ..self };
                job.go_on(words, block)
            }
            Phase::Receiving => match Rx::go_on(rx, OWN, self.total, self.gese) {
                Rx::Wait => (self, Step::Wait),
                Rx::Take { from, len, word } => (self, Step::Take { from, len, word }),
                Rx::Broken => {
                    let echo = (rx == 0).then_some(0);
                    (self, Step::Ended { outcome: Err(FRAME_ERROR), tx: None, echo })
                }
            },
            Phase::Closing if rx == OWN | last_count(self.total) => (self, Step::Wait),
            Phase::Closing => {
                let outcome = if self.failed { Err(self.gese as u8) } else { Ok(()) };
                // The CP shows something else: its echo belongs to another block.
                (self, Step::Ended { outcome, tx: None, echo: (rx == 0).then_some(0) })
            }
        }
    }

    /// Bytes of the result have been stored; `code`: the error code, if this was the first block.
    pub(crate) fn taken(self, len: u16, code: Option<u8>) -> Self {
        let gese = self.gese + len;
        let failed = self.failed || code.is_some_and(|code| code != 0);
        if gese < self.total {
            return Job { gese, failed, ..self };
        }
        // The code of the only block, or a frame error because the lengths differ.
        let code = if failed { code.filter(|code| *code != 0).unwrap_or(FRAME_ERROR) } else { 0 };
        Job { phase: Phase::Closing, gese: u16::from(code), failed, ..self }
    }

    /// The CP has restarted since it got the order [S0 "Error message CP Byte 0"]: "the CP had to reinitialize the
    /// connection".
    pub(crate) const LOST: u8 = INITIALISED;
}
