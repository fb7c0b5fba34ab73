//! An own order between two calls, as FC 2 and FC 3 keep it: pure steps over control bits and registers.

use super::{COUNT, FRAME_ERROR, INITIALISED, KIND, OWN, RESULT_BYTES, Rx, Tx, last_count};
use crate::registers::{BLOCK_BYTES, Words};

/// Where an order is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Phase {
    /// There is none: a call with these control bits is the order.
    #[default]
    Idle,
    /// Header and data go to the CP.
    Sending,
    /// The CP has it; the result is awaited.
    Waiting,
    /// The result comes.
    Receiving,
    /// The result is here; the CP has to see the last echo.
    Closing,
}

/// An order between two calls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Job {
    pub(crate) phase: Phase,
    /// Mark of the order, 1 to 31.
    pub(crate) token: u8,
    /// Bytes of the telegram that goes or comes.
    pub(crate) total: u16,
    /// Bytes of it that are through; while closing: the error code.
    pub(crate) gese: u16,
    /// The order has failed.
    pub(crate) failed: bool,
}

/// What a call does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing: it is the CP's turn.
    Wait,
    /// Write this block of the telegram.
    Post { from: u16, len: u16, word: u16 },
    /// Write `TX`.
    Word(u16),
    /// The CP has the order: `TX` is free.
    Handed,
    /// Take these bytes of the result, then echo the word.
    Take { from: u16, len: u16, word: u16 },
    /// A result of an order that was given up: echo the word, keep nothing.
    Drain(u16),
    /// Over; `Err`: the code for ANZW. `TX` and `RX echo` go to what is given.
    Ended { outcome: Result<(), u8>, tx: Option<u16>, echo: Option<u16> },
}

impl Job {
    /// The parameter ANZ: mark and count.
    pub(crate) fn anz(self) -> u16 {
        u16::from(self.token) << 11 | self.total & COUNT
    }

    /// An order of `total` bytes begins.
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

    /// The order runs, on the CP it was given to.
    pub(crate) fn go_on(self, words: Words, block: &[u8; BLOCK_BYTES as usize]) -> (Self, Step) {
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
                // Something else on show: its echo is not ours.
                (self, Step::Ended { outcome, tx: None, echo: (rx == 0).then_some(0) })
            }
        }
    }

    /// Bytes of the result have been taken; `code`: what the first block says, if it was that.
    pub(crate) fn taken(self, len: u16, code: Option<u8>) -> Self {
        let gese = self.gese + len;
        let failed = self.failed || code.is_some_and(|code| code != 0);
        if gese < self.total {
            return Job { gese, failed, ..self };
        }
        // Whole lengths differ, or the code of the only block.
        let code = if failed { code.filter(|code| *code != 0).unwrap_or(FRAME_ERROR) } else { 0 };
        Job { phase: Phase::Closing, gese: u16::from(code), failed, ..self }
    }

    /// The CP is no longer the one the order was given to [S0 "Error message CP Byte 0"]: "the CP had to reinitialize
    /// the connection".
    pub(crate) const LOST: u8 = INITIALISED;
}
