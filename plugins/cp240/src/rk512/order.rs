//! What FC 2 and FC 3 have in common: an order of this CPU, from the call that starts it to the call that reports its
//! end.

use ob1_sdk::types::{Byte, Word};
use ob1_sdk::{Abort, Area, Cx, Formal, Out};

use super::job::{Job, Phase, Step};
use super::telegram::{
    COUNT, DONE, FRAME_ERROR, HEADER_BYTES, KIND, OWN, RESULT_BYTES, RUNNING, TOO_LONG, WORDS_MAX, failed, write_echo,
    write_tx,
};
use crate::module::Module;
use crate::pafe::Pafe;
use crate::reception::put;
use crate::registers::{BLOCK_BYTES, BlockBytes, Words};
use crate::state::CpState;
use crate::turn::{Key, Role, Take};
use crate::tx::{Left, acquire};

/// The order in the parameters of the block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wish {
    pub(crate) adr: i16,
    /// Data block and first word in the partner.
    pub(crate) remote: (u16, i32),
    /// Data block and first word in this CPU.
    pub(crate) local: (u16, i32),
    /// LANG: length in words, as the program gives it.
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

    /// What tells this order from those of other calls.
    fn key(&self, command: u8) -> Key {
        let (local, remote) = (self.local.1 as u16, self.remote.0 as u8);
        Key::new(
            Role::Order,
            u64::from(command) << 40 | u64::from(remote) << 32 | u64::from(self.local.0) << 16 | u64::from(local),
        )
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
    /// Number of the block.
    const NUMBER: u16;
    /// Third byte of the header.
    const COMMAND: u8;
    const ANZW: Formal<Word, Out>;
    const PAFE: Formal<Byte, Out>;

    fn wish(cx: &mut Cx<'_, CpState>) -> Result<Wish, Abort>;
    fn load(cx: &mut Cx<'_, CpState>) -> Result<Job, Abort>;
    fn store(cx: &mut Cx<'_, CpState>, job: Job) -> Result<(), Abort>;
}

/// The owner of `TX` while FC 2 or FC 3 passes an order to the CP.
const TX_OWNER: Key = Key::new(Role::Order, 0);

/// A call of FC 2 or FC 3: its order, then PAFE.
pub(crate) fn call<O: Order>(cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
    let pafe = run::<O>(cx)?;
    cx.set(O::PAFE, pafe as u8)
}

fn run<O: Order>(cx: &mut Cx<'_, CpState>) -> Result<Pafe, Abort> {
    let wish = O::wish(cx)?;
    let job = O::load(cx)?;
    if job.phase == Phase::Idle {
        // "Delete: when the according order is triggered for a second time" [S0 L1315], [S0 L1320]. Bit 1 follows "when
        // the CP received the order" [S0 L1307]: until then, and while PAFE is not 0, nothing runs and nothing is done.
        cx.set(O::ANZW, 0)?;
    }
    let Some((module, words, block)) = Module::block(cx, wish.adr)? else { return Ok(Pafe::Ok) };
    let now = cx.now();
    if job.phase == Phase::Idle {
        return start::<O>(cx, &module, &wish, words, now);
    }
    let state = &module.state.rk512;
    let (claim, tx) = (&state.order.claim, &module.state.tx.turn.claim);
    let continues = claim.continues(wish.key(O::COMMAND), u32::from(job.token), &module.info, now);
    let has_tx = job.phase != Phase::Sending || tx.continues(TX_OWNER, 1, &module.info, now);
    if !continues || !has_tx || module.is_closed(words) {
        if continues {
            release(&module);
        }
        state.cut_off.set(false);
        O::store(cx, Job::default())?;
        return cx.set(O::ANZW, failed(Job::LOST)).map(|()| Pafe::Ok);
    }
    if job.phase == Phase::Waiting && words.rx == 0 && state.echo.get() & COUNT != 0 {
        // The end of a result that belonged to no order, or of an order of the partner that FC 4 has not ended: the CP
        // shows nothing new before both sides are at 0.
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
    let key = wish.key(O::COMMAND);
    let ended = match wish.words {
        // Nothing to transfer: ended without error (ours).
        0 => Some(DONE),
        1..=WORDS_MAX => None,
        _ => Some(failed(TOO_LONG)),
    };
    if let Some(anzw) = ended {
        leave(module, key);
        return cx.set(O::ANZW, anzw).map(|()| Pafe::Ok);
    }
    let pafe = wish.check(cx)?;
    module.tell_pafe(cx, O::NUMBER, wish.local.0, pafe)?;
    if pafe != Pafe::Ok {
        leave(module, key);
    }
    // A CP whose process is down, or that is not synchronised, accepts nothing: the order waits.
    if pafe != Pafe::Ok || !module.info.present || module.is_closed(words) {
        return Ok(pafe);
    }
    // "SEND/FETCH blocked" [S0 "Content and structure of the indicator word ANZW"].
    cx.set(O::ANZW, RUNNING)?;
    let (state, tx) = (&module.state.rk512, &module.state.tx);
    match state.order.take(key, &module.info, now) {
        Take::No => return Ok(Pafe::Ok),
        Take::Over if tx.turn.claim.is_of(TX_OWNER) && !tx.has_command(&module.info) => {
            // The order before has been given up in the middle: the CP discards it when `TX` is 0.
            tx.turn.claim.note(0);
            let word = if let Left::Word(word) = Left::of(words) { word } else { 0 };
            return write_tx(cx, module, word, &[]).map(|_| Pafe::Ok);
        }
        Take::Over | Take::Yes => {}
    }
    if !acquire(cx, module, words, TX_OWNER, now)? {
        return Ok(Pafe::Ok);
    }
    // First clear what an abandoned order has left.
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
        Step::Handed => module.state.tx.turn.claim.release(),
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
    // The claims hold for the order that has begun.
    module.state.rk512.order.claim.note(u32::from(job.token));
    if job.phase == Phase::Sending {
        module.state.tx.turn.claim.note(1);
    }
    O::store(cx, job).map(|()| Pafe::Ok)
}

/// The order has ended.
fn release(module: &Module<'_>) {
    module.state.rk512.order.claim.release();
    if module.state.tx.turn.claim.is_of(TX_OWNER) {
        module.state.tx.turn.claim.release();
    }
}

/// An order that has waited for its turn does not begin: the others do not wait for it.
fn leave(module: &Module<'_>, key: Key) {
    if module.state.rk512.order.leave(key) {
        module.state.tx.turn.leave(TX_OWNER);
    }
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
