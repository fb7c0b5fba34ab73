//! What FC 2 and FC 3 have in common: an order of this CPU, from the call that starts it to the call that reports its
//! end.

use ob1_sdk::types::{Byte, Word};
use ob1_sdk::{Abort, Area, Cx, Formal, Out};

use super::job::{Job, Phase, Step};
use super::state::GIVEN_UP;
use super::telegram::{
    COUNT, DONE, FRAME_ERROR, HEADER_BYTES, KIND, OWN, RESULT_BYTES, RUNNING, TOO_LONG, WORDS_MAX, failed, write_echo,
    write_tx,
};
use crate::module::Module;
use crate::reception::put;
use crate::registers::{BLOCK_BYTES, BlockBytes, Count, FAILED, Pafe, Words, tx_count};
use crate::state::CpState;

/// The order in the parameters of the block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wish {
    pub(crate) adr: i16,
    /// Data block and first word in the partner.
    pub(crate) remote: (u16, i32),
    /// Data block and first word in this CPU.
    pub(crate) local: (u16, i32),
    /// LANG.
    pub(crate) words: i16,
    /// KOOR: flag byte and bit, FFFFh for none.
    pub(crate) koor: u16,
}

impl Wish {
    fn bytes(&self) -> u16 {
        self.words.unsigned_abs().saturating_mul(2)
    }

    /// First byte in this CPU.
    fn from(&self) -> u16 {
        u16::try_from(self.local.1.saturating_mul(2)).unwrap_or(u16::MAX)
    }

    /// The header as in the registers [S0 "Structure of the output message"].
    fn header(&self, command: u8, token: u8) -> [u8; HEADER_BYTES as usize] {
        let [high, low] = self.words.to_be_bytes();
        let [flag, bit] = self.koor.to_be_bytes();
        [0, token, command, b'D', self.remote.0 as u8, self.remote.1 as u8, high, low, flag, bit]
    }

    /// PAFE as far as it can be checked without the partner: on the line its data blocks have numbers 1 to 255 and
    /// words 0 to 255.
    fn check(&self, cx: &mut Cx<'_, CpState>) -> Result<Pafe, Abort> {
        if !(1..=255).contains(&self.remote.0) {
            return Ok(Pafe::Number);
        }
        if !(0..=255).contains(&self.remote.1) || self.local.1 < 0 {
            return Ok(Pafe::Short);
        }
        let len = cx.len(Area::Db(self.local.0));
        Pafe::check(len, self.from(), self.bytes())
    }
}

/// The difference between the two blocks.
pub(crate) trait Order {
    /// Third byte of the header.
    const COMMAND: u8;
    const ANZW: Formal<Word, Out>;
    const PAFE: Formal<Byte, Out>;

    fn wish(cx: &mut Cx<'_, CpState>) -> Result<Wish, Abort>;
    fn load(cx: &mut Cx<'_, CpState>) -> Result<Job, Abort>;
    fn store(cx: &mut Cx<'_, CpState>, job: Job) -> Result<(), Abort>;
}

/// One call.
pub(crate) fn call<O: Order>(cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
    let pafe = run::<O>(cx)?;
    cx.set(O::PAFE, pafe as u8)
}

fn run<O: Order>(cx: &mut Cx<'_, CpState>) -> Result<Pafe, Abort> {
    let wish = O::wish(cx)?;
    let Some((module, words, block)) = Module::block(cx, wish.adr)? else { return Ok(Pafe::Ok) };
    let (job, now) = (O::load(cx)?, cx.now());
    let state = &module.state.rk512;
    if job.phase == Phase::Idle {
        return start::<O>(cx, &module, &wish, words, now);
    }
    if words.not_ready() || !state.order.holds(&module.info) || state.token.get() != job.token {
        if state.token.get() == job.token {
            release(&module);
        }
        O::store(cx, Job::default())?;
        return cx.set(O::ANZW, failed(Job::LOST)).map(|()| Pafe::Ok);
    }
    state.order_seen.set(now);
    if job.phase == Phase::Sending {
        state.tx_seen.set(now);
    }
    if job.phase == Phase::Waiting && words.rx == 0 && state.echo.get() & KIND == OWN {
        // The end of a result that belonged to no order.
        return write_echo(cx, &module, 0).map(|_| Pafe::Ok);
    }
    let (next, step) = job.go_on(words, &block);
    act::<O>(cx, &module, &wish, next, step, &block)
}

/// "If the control bits are reset a new order is released." [S0 "SEND\\_RK512"]
fn start<O: Order>(
    cx: &mut Cx<'_, CpState>,
    module: &Module<'_>,
    wish: &Wish,
    words: Words,
    now: u64,
) -> Result<Pafe, Abort> {
    if wish.words == 0 {
        // Nothing to transfer: ended without error (ours).
        return cx.set(O::ANZW, DONE).map(|()| Pafe::Ok);
    }
    if !(1..=WORDS_MAX).contains(&wish.words) {
        return cx.set(O::ANZW, failed(TOO_LONG)).map(|()| Pafe::Ok);
    }
    let pafe = wish.check(cx)?;
    // A CP whose process is down, or that is not synchronised, accepts nothing: the order waits.
    if pafe != Pafe::Ok || !module.info.present || words.not_ready() {
        return Ok(pafe);
    }
    let state = &module.state.rk512;
    let taken = state.order.holds(&module.info) && now.saturating_sub(state.order_seen.get()) < GIVEN_UP;
    if taken || module.state.line.holds(&module.info) || !state.take_tx(OWN, now) {
        // "SEND/FETCH blocked" [S0 "Content and structure of the indicator word ANZW"].
        return cx.set(O::ANZW, RUNNING).map(|()| Pafe::Ok);
    }
    // First clear what an abandoned order has left.
    let left = match tx_count(words.tx_echo) {
        Count::Failed(_) => Some(FAILED),
        _ if words.tx_echo != 0 => Some(0),
        _ => None,
    };
    if let Some(word) = left {
        return write_tx(cx, module, word, &[]).map(|_| Pafe::Ok);
    }
    if words.rx & KIND == OWN && words.rx & COUNT != 0 {
        return write_echo(cx, module, words.rx).map(|_| Pafe::Ok);
    }
    if words.rx == 0 && state.echo.get() & KIND == OWN && !write_echo(cx, module, 0)? {
        return Ok(Pafe::Ok);
    }
    let token = state.token.get() % 31 + 1;
    let data = if O::COMMAND == b'A' { wish.bytes() } else { 0 };
    let (job, step) = Job::start(token, HEADER_BYTES + data);
    state.token.set(token);
    state.order.take(&module.info);
    state.order_seen.set(now);
    // Bit 1 is set, bits 2 and 3 are reset: "when the according order is triggered for a second time".
    cx.set(O::ANZW, RUNNING)?;
    act::<O>(cx, module, wish, job, step, &[0; BLOCK_BYTES as usize])
}

fn act<O: Order>(
    cx: &mut Cx<'_, CpState>,
    module: &Module<'_>,
    wish: &Wish,
    mut job: Job,
    step: Step,
    block: &BlockBytes,
) -> Result<Pafe, Abort> {
    match step {
        Step::Wait => return Ok(Pafe::Ok),
        Step::Post { from, len, word } => {
            let mut bytes = [0; BLOCK_BYTES as usize];
            let part = &mut bytes[..usize::from(len)];
            if let Err(refused) = source(cx, wish, O::COMMAND, job.token, from, part)? {
                return Ok(Pafe::of(refused).unwrap_or(Pafe::Short));
            }
            if !write_tx(cx, module, word, part)? {
                return Ok(Pafe::Ok);
            }
        }
        Step::Word(word) => {
            if !write_tx(cx, module, word, &[])? {
                return Ok(Pafe::Ok);
            }
        }
        Step::Handed => module.state.rk512.release_tx(OWN),
        Step::Drain(word) => return write_echo(cx, module, word).map(|_| Pafe::Ok),
        Step::Take { from, len, word } => {
            let code = (from == 0).then(|| verdict(wish, O::COMMAND, job.total, block));
            if code.is_none_or(|code| code == 0)
                && !job.failed
                && let Err(pafe) = store_data(cx, wish, from, &block[..usize::from(len)])?
            {
                return Ok(pafe);
            }
            if !write_echo(cx, module, word)? {
                return Ok(Pafe::Ok);
            }
            job = job.taken(len, code);
        }
        Step::Ended { outcome, tx, echo } => {
            if let Some(word) = tx
                && !write_tx(cx, module, word, &[])?
            {
                return Ok(Pafe::Ok);
            }
            if let Some(word) = echo
                && !write_echo(cx, module, word)?
            {
                return Ok(Pafe::Ok);
            }
            release(module);
            O::store(cx, Job { failed: outcome.is_err(), ..Job::default() })?;
            return cx.set(O::ANZW, outcome.map_or_else(failed, |()| DONE)).map(|()| Pafe::Ok);
        }
    }
    O::store(cx, job).map(|()| Pafe::Ok)
}

fn release(module: &Module<'_>) {
    module.state.rk512.order.release();
    module.state.rk512.release_tx(OWN);
}

/// Bytes of the telegram: header, then the data of a SEND.
fn source(
    cx: &mut Cx<'_, CpState>,
    wish: &Wish,
    command: u8,
    token: u8,
    from: u16,
    into: &mut [u8],
) -> ob1_sdk::Reply<()> {
    let header = wish.header(command, token);
    let in_header = header.get(usize::from(from)..).unwrap_or(&[]);
    let n = in_header.len().min(into.len());
    into[..n].copy_from_slice(&in_header[..n]);
    let data = &mut into[n..];
    if data.is_empty() {
        return Ok(Ok(()));
    }
    let at = from.saturating_sub(HEADER_BYTES);
    cx.read(Area::Db(wish.local.0), u32::from(wish.from()) + u32::from(at), data)
}

/// The error code in the first block of a result, or 0. A wrong number of data bytes is a frame error.
fn verdict(wish: &Wish, command: u8, total: u16, block: &BlockBytes) -> u8 {
    let [_, _, by, code, ..] = *block;
    let data = if command == b'E' { wish.bytes() } else { 0 };
    match (by, code) {
        (0, 0) if total != RESULT_BYTES.saturating_add(data) => FRAME_ERROR,
        (_, code) => code,
    }
}

/// Stores the data in a block of the result.
fn store_data(cx: &mut Cx<'_, CpState>, wish: &Wish, from: u16, block: &[u8]) -> Result<Result<(), Pafe>, Abort> {
    let skip = RESULT_BYTES.saturating_sub(from);
    let data = block.get(usize::from(skip)..).unwrap_or(&[]);
    if data.is_empty() {
        return Ok(Ok(()));
    }
    let at = u32::from(wish.from()) + u32::from(from + skip - RESULT_BYTES);
    put(cx, wish.local.0, at, data)
}
