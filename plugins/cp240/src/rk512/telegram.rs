//! Telegrams between a block and the CP: their words, the next block of one that is passed, of one that is received.

use ob1_sdk::{Abort, Cx};
use ob1_words::cp240::{RK512_HEADER_BYTES, RK512_RESULT_BYTES};

pub(super) use ob1_words::cp240::{COUNT_BITS as COUNT, KIND};
pub(crate) use ob1_words::cp240::{OWN_ORDER as OWN, PARTNER_ORDER as PARTNER};

use crate::module::Module;
use crate::registers::{BLOCK_BYTES, Count, TX, tx_count};
use crate::state::CpState;

/// Bytes of a header.
pub(crate) const HEADER_BYTES: u16 = RK512_HEADER_BYTES as u16;
/// Bytes before the data of a result and of an answer.
pub(crate) const RESULT_BYTES: u16 = RK512_RESULT_BYTES as u16;
/// Longest order in words: 1024 bytes [S0 "Error message CP Byte 0"].
pub(crate) const WORDS_MAX: i16 = 512;

/// ANZW, byte 1 [S0 "Content and structure of the indicator word ANZW"].
pub(super) const RUNNING: u16 = 0x0002;
pub(super) const DONE: u16 = 0x0004;
pub(super) const FAILED: u16 = 0x0008;

/// Error codes of the CP that the blocks also report themselves, in ANZW byte 0.
pub(super) const FRAME_ERROR: u8 = 0x0C;
pub(super) const TOO_LONG: u8 = 0x17;
pub(super) const INITIALISED: u8 = 0x00;

/// ANZW of an order that has failed.
pub(super) const fn failed(code: u8) -> u16 {
    (code as u16) << 8 | FAILED
}

/// What to do with `TX` while a telegram is passed to the CP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Tx {
    /// The CP has not taken the last block yet.
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
    /// The CP has not shown the next block yet.
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
pub(super) fn last_count(total: u16) -> u16 {
    total.saturating_sub(1) % BLOCK_BYTES + 1
}

/// Writes `RX echo`; false if the access failed and OB 122 has handled it.
pub(super) fn write_echo(cx: &mut Cx<'_, CpState>, module: &Module<'_>, word: u16) -> Result<bool, Abort> {
    let written = module.write(cx, 0, &word.to_be_bytes())?;
    if written {
        module.state.rk512.echo.set(word);
    }
    Ok(written)
}

/// Writes a count word with its block, or only a word.
pub(super) fn write_tx(cx: &mut Cx<'_, CpState>, module: &Module<'_>, word: u16, block: &[u8]) -> Result<bool, Abort> {
    let mut registers = [0; 2 + BLOCK_BYTES as usize];
    registers[..2].copy_from_slice(&word.to_be_bytes());
    let len = block.len().min(usize::from(BLOCK_BYTES));
    registers[2..2 + len].copy_from_slice(&block[..len]);
    let bytes = if block.is_empty() { &registers[..2] } else { &registers[..] };
    module.write(cx, TX, bytes)
}
