//! RK 512: FC 2 FETCH_RK512, FC 3 SEND_RK512, FC 4 S/R_ALL_RK512 [S0 "RK512 communication - Handling blocks"], on the
//! registers of `docs/cp240-registers.md`, "RK 512".

mod all;
mod fetch;
mod job;
mod order;
mod send;

use std::cell::Cell;

use ob1_sdk::{Abort, Cx};

use crate::registers::{BLOCK_BYTES, Count, Module, TX, tx_count};
use crate::state::{Claim, CpState};

pub(crate) use all::All;
pub(crate) use fetch::Fetch;
pub(crate) use send::SendRk;

#[cfg(test)]
pub(crate) use all::{Evaluated, Header, evaluate};
#[cfg(test)]
pub(crate) use job::{Job, Phase, Step};

pub(crate) use ob1_words::cp240::{OWN_ORDER as OWN, PARTNER_ORDER as PARTNER};

use ob1_words::cp240::{COUNT_BITS as COUNT, KIND, RK512_HEADER_BYTES, RK512_RESULT_BYTES};

/// Bytes of a header.
pub(crate) const HEADER_BYTES: u16 = RK512_HEADER_BYTES as u16;
/// Bytes before the data of a result and of an answer.
pub(crate) const RESULT_BYTES: u16 = RK512_RESULT_BYTES as u16;
/// Longest order in words: 1024 bytes [S0 "Error message CP Byte 0"].
pub(crate) const WORDS_MAX: i16 = 512;

/// ANZW, byte 1 [S0 "Content and structure of the indicator word ANZW"].
const RUNNING: u16 = 0x0002;
const DONE: u16 = 0x0004;
const FAILED: u16 = 0x0008;

/// Error codes of the CP that the blocks also report themselves, in ANZW byte 0.
const FRAME_ERROR: u8 = 0x0C;
const TOO_LONG: u8 = 0x17;
const INITIALISED: u8 = 0x00;

/// ANZW of an order that has failed.
const fn failed(code: u8) -> u16 {
    (code as u16) << 8 | FAILED
}

/// A block that has not been called for this time loses its claims: the reaction monitoring time of the CP [S0 L1678].
const GIVEN_UP: u64 = 5_000_000_000;

ob1_sdk::state! {
    /// What the blocks store for the two roles.
    #[derive(Debug, Default)]
    pub(crate) struct Rk512State {
        /// The running order of this CPU.
        pub(crate) order: Claim,
        /// The mark of that order, and the time of the last call of its block.
        token: Cell<u8>,
        order_seen: Cell<u64>,
        /// The order of the partner that FC 4 is serving.
        pub(crate) partner: Claim,
        /// The error number of its answer, its coordination flag as in the header, its length in bytes.
        refusal: Cell<u8>,
        coordination: Cell<u16>,
        length: Cell<u16>,
        /// The content of `RX echo`.
        echo: Cell<u16>,
        /// The role that has a telegram in `TX`: 0, [`OWN`] or [`PARTNER`]; and the time of its last call.
        tx: Cell<u16>,
        tx_seen: Cell<u64>,
    }
}

impl Rk512State {
    /// FC 9 has synchronised: no order runs, all words are 0.
    pub(crate) fn clear(&self) {
        self.order.release();
        self.partner.release();
        self.echo.set(0);
        self.tx.set(0);
    }

    /// Takes or keeps `TX` for a telegram; false while the other role uses it.
    fn take_tx(&self, framing: u16, now: u64) -> bool {
        let other = self.tx.get() != 0 && self.tx.get() != framing;
        if other && now.saturating_sub(self.tx_seen.get()) < GIVEN_UP {
            return false;
        }
        self.tx.set(framing);
        self.tx_seen.set(now);
        true
    }

    /// Whether FC 2, FC 3 or FC 4 has a telegram in `TX`.
    pub(crate) fn uses_tx(&self) -> bool {
        self.tx.get() != 0
    }

    fn release_tx(&self, framing: u16) {
        if self.tx.get() == framing {
            self.tx.set(0);
        }
    }
}

/// What to do with `TX` while a telegram is passed to the CP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Tx {
    /// Nothing yet.
    Wait,
    /// Write the block that begins at this byte of the telegram, and the count word.
    Post { from: u16, len: u16, word: u16 },
    /// All blocks have been passed: write 0.
    Close,
    /// The CP has the telegram.
    Taken,
    /// The CP has refused the telegram.
    Refused(u8),
    /// The CP shows an unexpected word.
    Broken,
}

impl Tx {
    /// The next block of a telegram of `total` bytes, of which the CP has `done`.
    pub(crate) fn next(framing: u16, total: u16, done: u16) -> Self {
        let rest = total.saturating_sub(done);
        let len = rest.min(BLOCK_BYTES);
        if rest == 0 { Tx::Close } else { Tx::Post { from: done, len, word: framing | rest } }
    }

    /// The next step according to `TX echo`; also returns the number of bytes the CP now has.
    pub(crate) fn go_on(echo: u16, framing: u16, total: u16, done: u16) -> (u16, Self) {
        if let Count::Failed(code) = tx_count(echo) {
            return (done, Tx::Refused(code));
        }
        let rest = total.saturating_sub(done);
        if rest == 0 {
            let last = framing | last_count(total);
            return (
                done,
                if echo == 0 {
                    Tx::Taken
                } else if echo == last {
                    Tx::Wait
                } else {
                    Tx::Broken
                },
            );
        }
        if echo == framing | rest {
            let done = done + rest.min(BLOCK_BYTES);
            return (done, Self::next(framing, total, done));
        }
        let before = if done == 0 { 0 } else { framing | (rest + BLOCK_BYTES) };
        (done, if echo == before { Tx::Wait } else { Tx::Broken })
    }
}

/// What to do with `RX` while a telegram is being received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rx {
    /// Nothing yet.
    Wait,
    /// Store `len` bytes, which begin at byte `from` of the telegram, then echo the word.
    Take { from: u16, len: u16, word: u16 },
    /// The CP shows an unexpected word: it has withdrawn the telegram.
    Broken,
}

impl Rx {
    /// The next step according to `RX`, with `done` of `total` bytes stored; not for a complete telegram.
    pub(crate) fn go_on(rx: u16, framing: u16, total: u16, done: u16) -> Self {
        let rest = total.saturating_sub(done);
        if rest > 0 && rx == framing | rest {
            Rx::Take { from: done, len: rest.min(BLOCK_BYTES), word: rx }
        } else if done > 0 && rx == framing | (rest + BLOCK_BYTES) {
            Rx::Wait
        } else {
            Rx::Broken
        }
    }
}

/// Count of the last block of a telegram.
fn last_count(total: u16) -> u16 {
    total.saturating_sub(1) % BLOCK_BYTES + 1
}

/// Writes `RX echo`; false if the access failed and OB 122 has handled it.
fn write_echo(cx: &mut Cx<'_, CpState>, module: &Module<'_>, word: u16) -> Result<bool, Abort> {
    let written = module.write(cx, 0, &word.to_be_bytes())?;
    if written {
        module.state.rk512.echo.set(word);
    }
    Ok(written)
}

/// Writes a count word with its block, or only a word.
fn write_tx(cx: &mut Cx<'_, CpState>, module: &Module<'_>, word: u16, block: &[u8]) -> Result<bool, Abort> {
    let mut registers = [0; 2 + BLOCK_BYTES as usize];
    registers[..2].copy_from_slice(&word.to_be_bytes());
    let len = block.len().min(usize::from(BLOCK_BYTES));
    registers[2..2 + len].copy_from_slice(&block[..len]);
    let bytes = if block.is_empty() { &registers[..2] } else { &registers[..] };
    module.write(cx, TX, bytes)
}
