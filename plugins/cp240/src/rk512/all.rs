//! FC 4 S/R_ALL_RK512: serves the SEND and FETCH orders of the partner [S0 "S/R\\_ALL\\_RK512 (FC 4)"].
//!
//! SEND goes to data blocks; FETCH reads data blocks, inputs, outputs, bit memory, timers and counters. Orders that
//! cannot be served are refused with the error numbers of RK 512 (ours if the manual names none): 0Ch coordination
//! flag, 10h area, 14h data block or range, 32h locked.

use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param, interface};

use super::telegram::{
    COUNT, DONE, FRAME_ERROR, HEADER_BYTES, INITIALISED, KIND, OWN, PARTNER, RESULT_BYTES, RUNNING, Rx, Tx, WORDS_MAX,
    failed, last_count, write_echo, write_tx,
};
use crate::module::Module;
use crate::pafe::Pafe;
use crate::registers::{BLOCK_BYTES, BlockBytes, Words};
use crate::state::CpState;
use crate::turn::{Key, Role};
use crate::tx::acquire;

interface! {
    /// The parameters, in the manual's order.
    pub(crate) mod all {
        /// Logical address of the CP.
        in     ADR: Int;
        /// Indicator word of the last order of the partner. The manual's table says "in", but the block writes it.
        in_out ANZW: Word;
        /// Error of the data block of the last order: 1 not present, 2 too short, 3 number outside the valid range.
        out    PAFE: Byte;
        /// Bytes of the telegram transferred so far.
        in_out GESE: Word;
        /// Length of the telegram in bytes.
        in_out ANZ: Word;
        /// Area letter and data block number of the order.
        in_out DB_KOPF: Word;
        /// Number of the order in the CP, and first data word (or byte, timer, counter).
        in_out ABF_KOPF: Word;
        /// The header has been evaluated.
        in_out KOPF_AUSGEW: Bool;
        /// The last block has been transferred.
        in_out LETZTER_BLOCK: Bool;
        /// The answer is being passed to the CP.
        in_out SENDE_LAEUFT | SENDEN_LAEUFT: Bool;
        /// The order is being received.
        in_out EMPF_LAEUFT: Bool;
        /// The CP has the whole answer.
        in_out ENDE_KOM | ENDE_KOMM: Bool;
        /// The order is a FETCH: data are sent to the partner.
        in_out SEND_ALL: Bool;
        /// The order is a SEND: data are received from the partner.
        in_out RECEIV_ALL | RECEIVE_ALL: Bool;
        /// The last order was refused or aborted.
        in_out FEHLER: Bool;
    }
}

/// The owner of `TX` while FC 4 answers, and of the order of the partner that it serves.
const ANSWERS: Key = Key::new(Role::Answer, 0);
const PARTNERS: Key = ANSWERS;

/// Error numbers of a reaction message.
const OK: u8 = 0x00;
const FLAG: u8 = 0x0C;
const AREA: u8 = 0x10;
const RANGE: u8 = 0x14;
const LOCKED: u8 = 0x32;
/// Instead of the number of an order: no answer is expected.
const NOTICE: u8 = 0;
/// Highest byte of a coordination flag.
const FLAG_BYTE_MAX: u8 = 199;
/// Longest order in bytes. The CP refuses longer ones itself.
const BYTES_MAX: u16 = 2 * WORDS_MAX.unsigned_abs();

/// The header of an order, as in the registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    /// Number of the order in the CP.
    pub(crate) job: u8,
    /// `E`: FETCH; otherwise SEND.
    pub(crate) fetch: bool,
    /// D, X, E, A, M, Z, T; X for a SEND to a DX.
    pub(crate) area: u8,
    pub(crate) db: u8,
    pub(crate) start: u8,
    /// In units of the area.
    pub(crate) length: u16,
    pub(crate) coordination: u16,
}

impl Header {
    pub(crate) fn of(block: &BlockBytes) -> Self {
        let [_, job, command, letter, db, start, high, low, flag, bit, ..] = *block;
        let area = if command == b'O' { b'X' } else { letter };
        let (length, coordination) = (u16::from_be_bytes([high, low]), u16::from_be_bytes([flag, bit]));
        Self { job, fetch: command == b'E', area, db, start, length, coordination }
    }

    /// Bytes of one unit.
    fn unit(area: u8) -> u16 {
        if matches!(area, b'E' | b'A' | b'M') { 1 } else { 2 }
    }

    fn bytes(&self) -> u16 {
        self.length.saturating_mul(Self::unit(self.area))
    }

    /// First byte of the area; for timers and counters the first number.
    fn from(&self) -> u32 {
        u32::from(self.start) * if self.area == b'D' { 2 } else { 1 }
    }

    /// The coordination flag: `Some(None)` without one, `None` if it is not valid.
    fn flag(coordination: u16) -> Option<Option<(u32, u8)>> {
        let [byte, bit] = coordination.to_be_bytes();
        match (byte, bit & 0x0F) {
            (0xFF, 0x0F) => Some(None),
            (byte, bit) if byte <= FLAG_BYTE_MAX && bit <= 7 => Some(Some((u32::from(byte), bit))),
            _ => None,
        }
    }
}

/// The result of checking an order against the memory of the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Evaluated {
    /// Error number of the answer.
    pub(crate) code: u8,
    pub(crate) pafe: Pafe,
}

/// Evaluates a header. `locked`: the coordination flag (`None`: outside the bit memory); `db`: the error of the data
/// block; `room`: whether the area contains all data of the order.
pub(crate) fn evaluate(header: &Header, locked: Option<bool>, db: Pafe, room: bool) -> Evaluated {
    let refuse = |code| Evaluated { code, pafe: Pafe::Ok };
    match header.area {
        b'D' => {}
        b'E' | b'A' | b'M' | b'T' | b'Z' if header.fetch => {}
        // "FC 4 serves D; E A M T Z on FETCH" (ours); no DX, because this CPU has none.
        _ => return refuse(AREA),
    }
    match locked {
        None => return refuse(FLAG),
        // [S0 "Coordination flags"]: data are not accepted (or transferred), 32h.
        Some(true) => return refuse(LOCKED),
        Some(false) => {}
    }
    if header.area == b'D' && db != Pafe::Ok {
        return Evaluated { code: RANGE, pafe: db };
    }
    refuse(if room { OK } else { RANGE })
}

/// The state of an order between two calls, as the program keeps it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Job {
    gese: u16,
    anz: u16,
    db_kopf: u16,
    abf_kopf: u16,
    evaluated: bool,
    last: bool,
    sends: bool,
    receives: bool,
    end: bool,
    is_fetch: bool,
    is_send: bool,
    failed: bool,
}

pub(crate) struct All;

impl Block for All {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 4;
    const NAME: &'static str = "S/R_ALL_RK512";
    const PARAMS: &'static [Param] = all::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let adr = cx.get(all::ADR)?;
        let Some((module, words, block)) = Module::block(cx, adr)? else { return cx.set(all::PAFE, 0) };
        run(cx, &module, words, &block)?;
        let pafe = standing(cx, &module)?;
        cx.set(all::PAFE, pafe as u8)
    }
}

/// The error of the data block of the last order, as long as its cause stands: "after elimination of the error cause,
/// the byte is set back to 0" [S0 L1262].
fn standing(cx: &mut Cx<'_, CpState>, module: &Module<'_>) -> Result<Pafe, Abort> {
    let state = &module.state.rk512;
    if !state.bad.get() {
        return Ok(Pafe::Ok);
    }
    let db_len = cx.len(Area::Db(state.bad_db.get()));
    let pafe = Pafe::check(db_len, state.bad_from.get(), state.bad_bytes.get())?;
    state.bad.set(pafe != Pafe::Ok);
    module.tell_pafe(cx, All::NUMBER, state.bad_db.get(), pafe)?;
    Ok(pafe)
}

fn run(cx: &mut Cx<'_, CpState>, module: &Module<'_>, words: Words, block: &BlockBytes) -> Result<(), Abort> {
    let (job, now) = (load(cx)?, cx.now());
    let state = &module.state.rk512;
    if job.receives || job.sends {
        if module.is_closed(words) || !state.partner.continues(PARTNERS, 1, &module.info, now) {
            return broken_off(cx, module, INITIALISED);
        }
        return if job.receives { receive(cx, module, job, words, block) } else { answer(cx, module, job, words) };
    }
    if module.is_closed(words) || !module.info.present {
        return Ok(());
    }
    match (words.rx & KIND, words.rx & COUNT) {
        (PARTNER, count) if count >= HEADER_BYTES && state.echo.get() == PARTNER => match *block {
            [code, NOTICE, ..] => refused_by_cp(cx, module, words.rx, code),
            _ => begin(cx, module, count, block),
        },
        // The result of an order whose block is no longer called: nothing of the partner comes before it is fetched.
        (OWN, 1..) if !state.order.claim.is_alive(&module.info, now) => {
            if write_echo(cx, module, words.rx)? {
                state.order.claim.abandon();
            }
            Ok(())
        }
        // No order: show that FC 4 is being called. While `RX` shows a result, FC 2 or FC 3 uses the echo.
        (0, 0) if state.echo.get() != PARTNER => write_echo(cx, module, PARTNER).map(drop),
        _ => Ok(()),
    }
}

/// The CP shows an order of the partner: evaluates its header.
fn begin(cx: &mut Cx<'_, CpState>, module: &Module<'_>, count: u16, block: &BlockBytes) -> Result<(), Abort> {
    let header = Header::of(block);
    let locked = match Header::flag(header.coordination) {
        None => None,
        Some(None) => Some(false),
        Some(Some((byte, bit))) => cx.bit(Area::Memory, byte, bit)?.ok(),
    };
    let db = match header.area {
        b'D' => {
            let len = cx.len(Area::Db(u16::from(header.db)));
            Pafe::check(len, header.from() as u16, header.bytes())?
        }
        _ => Pafe::Ok,
    };
    let room = header.bytes() <= BYTES_MAX && has_room(cx, &header)?;
    let Evaluated { code, pafe } = evaluate(&header, locked, db, room);
    let state = &module.state.rk512;
    state.partner.take(PARTNERS, &module.info, cx.now());
    state.partner.note(1);
    state.bad.set(pafe != Pafe::Ok);
    state.bad_db.set(u16::from(header.db));
    state.bad_from.set(header.from() as u16);
    state.bad_bytes.set(header.bytes());
    state.refusal.set(code);
    state.coordination.set(header.coordination);
    state.length.set(header.bytes());
    let job = Job {
        gese: 0,
        anz: count,
        db_kopf: u16::from_be_bytes([header.area, header.db]),
        abf_kopf: u16::from_be_bytes([header.job, header.start]),
        evaluated: true,
        receives: true,
        is_fetch: header.fetch,
        is_send: !header.fetch,
        ..Job::default()
    };
    cx.set(all::ANZW, RUNNING)?;
    receive(cx, module, job, Words { rx: PARTNER | count, tx_echo: 0 }, block)
}

/// Whether the requested inputs, outputs, bit memory, timers or counters exist.
fn has_room(cx: &mut Cx<'_, CpState>, header: &Header) -> Result<bool, Abort> {
    let last = header.from() + u32::from(header.length.max(1)) - 1;
    Ok(match (area_of(header.area, header.db), u16::try_from(last)) {
        (Some(area), _) if header.area != b'D' => cx.len(area)?.is_ok_and(|len| last < len),
        (None, Ok(last)) if header.area == b'T' => cx.timer(last)?.is_ok(),
        (None, Ok(last)) if header.area == b'Z' => cx.counter(last)?.is_ok(),
        _ => true,
    })
}

fn area_of(letter: u8, db: u8) -> Option<Area> {
    Some(match letter {
        b'D' => Area::Db(u16::from(db)),
        b'E' => Area::Input,
        b'A' => Area::Output,
        b'M' => Area::Memory,
        _ => return None,
    })
}

/// The order is being received.
fn receive(
    cx: &mut Cx<'_, CpState>,
    module: &Module<'_>,
    mut job: Job,
    words: Words,
    block: &BlockBytes,
) -> Result<(), Abort> {
    let state = &module.state.rk512;
    if job.last {
        if words.rx == PARTNER | last_count(job.anz) {
            return Ok(());
        }
        if words.rx == 0 && !write_echo(cx, module, PARTNER)? {
            return Ok(());
        }
        // All data are stored. The flag is set before the partner gets the answer. [S0 "Coordination flags"]
        if state.refusal.get() == OK {
            mark(cx, module, true)?;
        }
        let data = if job.is_fetch && state.refusal.get() == OK { state.length.get() } else { 0 };
        job = Job { gese: 0, anz: RESULT_BYTES + data, receives: false, sends: true, last: false, ..job };
        store(cx, job)?;
        return answer(cx, module, job, words);
    }
    match Rx::go_on(words.rx, PARTNER, job.anz, job.gese) {
        Rx::Wait => Ok(()),
        Rx::Take { from, len, word } => {
            if job.is_send && state.refusal.get() == OK {
                let skip = HEADER_BYTES.saturating_sub(from);
                let data = block.get(usize::from(skip)..usize::from(len)).unwrap_or(&[]);
                let [_, db] = job.db_kopf.to_be_bytes();
                let [_, start] = job.abf_kopf.to_be_bytes();
                let at = u32::from(start) * 2 + u32::from((from + skip).saturating_sub(HEADER_BYTES));
                if !data.is_empty() && cx.write(Area::Db(u16::from(db)), at, data)?.is_err() {
                    // The data block was deleted, shortened or write-protected after the header was evaluated.
                    state.refusal.set(RANGE);
                }
            }
            if !write_echo(cx, module, word)? {
                return Ok(());
            }
            job.gese += len;
            job.last = job.gese >= job.anz;
            store(cx, job)
        }
        // Meanwhile the CP has refused the order.
        Rx::Broken => broken_off(cx, module, FRAME_ERROR),
    }
}

/// Sets or resets the coordination flag of the order, if it has one.
fn mark(cx: &mut Cx<'_, CpState>, module: &Module<'_>, on: bool) -> Result<(), Abort> {
    if let Some(Some((byte, bit))) = Header::flag(module.state.rk512.coordination.get()) {
        // The flag exists: it was read when the header was evaluated.
        let _there = cx.set_bit(Area::Memory, byte, bit, on)?;
    }
    Ok(())
}

/// The answer is being passed to the CP.
fn answer(cx: &mut Cx<'_, CpState>, module: &Module<'_>, mut job: Job, words: Words) -> Result<(), Abort> {
    let (state, now) = (&module.state.rk512, cx.now());
    let claim = &module.state.tx.turn.claim;
    let tx = if job.evaluated {
        if !acquire(cx, module, words, ANSWERS, now)? {
            return Ok(());
        }
        Tx::next(PARTNER, job.anz, 0)
    } else if claim.continues(ANSWERS, 1, &module.info, now) {
        let (gese, tx) = Tx::go_on(words.tx_echo, PARTNER, job.anz, job.gese);
        job.gese = gese;
        tx
    } else {
        // Another block has got `TX`, because this one was not called.
        return broken_off(cx, module, FRAME_ERROR);
    };
    match tx {
        Tx::Wait => Ok(()),
        Tx::Post { from, len, word } => {
            let mut bytes = [0; BLOCK_BYTES as usize];
            let part = &mut bytes[..usize::from(len)];
            if !compose(cx, &job, state.refusal.get(), from, part)? {
                // The data are gone since the header was evaluated: the answer begins again, as a refusal. The 0 makes
                // the CP drop the blocks it has.
                if !write_tx(cx, module, 0, &[])? {
                    return Ok(());
                }
                state.refusal.set(RANGE);
                claim.note(0);
                mark(cx, module, false)?;
                return store(cx, Job { gese: 0, anz: RESULT_BYTES, evaluated: true, last: false, ..job });
            }
            if !write_tx(cx, module, word, part)? {
                return Ok(());
            }
            claim.note(1);
            job.evaluated = false;
            job.last = job.anz.saturating_sub(job.gese) <= BLOCK_BYTES;
            store(cx, job)
        }
        Tx::Close => {
            if !write_tx(cx, module, 0, &[])? {
                return Ok(());
            }
            store(cx, Job { end: true, ..job })
        }
        Tx::Taken => {
            let code = state.refusal.get();
            state.partner.release();
            claim.release();
            store(cx, Job { failed: code != OK, ..Job::default() })?;
            cx.set(all::ANZW, if code == OK { DONE } else { failed(code) })
        }
        // The order ended before the answer was complete.
        Tx::Refused(_) | Tx::Broken => {
            let (word, code) = match tx {
                Tx::Refused(code) => (crate::registers::FAILED, code),
                _ => (0, FRAME_ERROR),
            };
            if !write_tx(cx, module, word, &[])? {
                return Ok(());
            }
            broken_off(cx, module, code)
        }
    }
}

/// Bytes of the answer: `00`, number of the order, `00`, error number, and the current data of a FETCH. False if the
/// data cannot be read.
fn compose(cx: &mut Cx<'_, CpState>, job: &Job, code: u8, from: u16, into: &mut [u8]) -> Result<bool, Abort> {
    let [number, start] = job.abf_kopf.to_be_bytes();
    let [area, db] = job.db_kopf.to_be_bytes();
    let head = [0, number, 0, code];
    let in_head = head.get(usize::from(from)..).unwrap_or(&[]);
    let n = in_head.len().min(into.len());
    into[..n].copy_from_slice(&in_head[..n]);
    let data = &mut into[n..];
    if data.is_empty() {
        return Ok(true);
    }
    let at = u32::from(from.saturating_sub(RESULT_BYTES));
    match area_of(area, db) {
        Some(place) => {
            let begin = u32::from(start) * if area == b'D' { 2 } else { 1 };
            return Ok(cx.read(place, begin + at, data)?.is_ok());
        }
        None => {
            for (n, word) in data.chunks_mut(2).enumerate() {
                let number = u16::from(start) + (at / 2) as u16 + n as u16;
                // A timer as its remaining time (S5TIME), a counter as BCD: their format in an S7 (ours).
                let value = if area == b'T' {
                    cx.timer(number)?.map_or(0, |timer| timer.remaining)
                } else {
                    cx.counter_bcd(number)?.unwrap_or(0)
                };
                word.copy_from_slice(&value.to_be_bytes()[..word.len()]);
            }
        }
    }
    Ok(true)
}

/// The CP has restarted (00h) or has withdrawn the order (0Ch): it has given the partner another answer.
fn broken_off(cx: &mut Cx<'_, CpState>, module: &Module<'_>, code: u8) -> Result<(), Abort> {
    let claim = &module.state.tx.turn.claim;
    module.state.rk512.partner.release();
    if claim.is_of(ANSWERS) {
        claim.release();
    }
    store(cx, Job { failed: true, ..Job::default() })?;
    cx.set(all::ANZW, failed(code))
}

/// The CP itself has refused an order of the partner: no answer is needed. [S0 L1298]
fn refused_by_cp(cx: &mut Cx<'_, CpState>, module: &Module<'_>, word: u16, code: u8) -> Result<(), Abort> {
    if !write_echo(cx, module, word)? {
        return Ok(());
    }
    store(cx, Job { failed: true, ..Job::default() })?;
    cx.set(all::ANZW, failed(code))
}

fn load(cx: &mut Cx<'_, CpState>) -> Result<Job, Abort> {
    Ok(Job {
        gese: cx.get(all::GESE)?,
        anz: cx.get(all::ANZ)? & COUNT,
        db_kopf: cx.get(all::DB_KOPF)?,
        abf_kopf: cx.get(all::ABF_KOPF)?,
        evaluated: cx.get(all::KOPF_AUSGEW)?,
        last: cx.get(all::LETZTER_BLOCK)?,
        sends: cx.get(all::SENDE_LAEUFT)?,
        receives: cx.get(all::EMPF_LAEUFT)?,
        end: cx.get(all::ENDE_KOM)?,
        is_fetch: cx.get(all::SEND_ALL)?,
        is_send: cx.get(all::RECEIV_ALL)?,
        failed: cx.get(all::FEHLER)?,
    })
}

fn store(cx: &mut Cx<'_, CpState>, job: Job) -> Result<(), Abort> {
    cx.set(all::GESE, job.gese)?;
    cx.set(all::ANZ, job.anz)?;
    cx.set(all::DB_KOPF, job.db_kopf)?;
    cx.set(all::ABF_KOPF, job.abf_kopf)?;
    cx.set(all::KOPF_AUSGEW, job.evaluated)?;
    cx.set(all::LETZTER_BLOCK, job.last)?;
    cx.set(all::SENDE_LAEUFT, job.sends)?;
    cx.set(all::EMPF_LAEUFT, job.receives)?;
    cx.set(all::ENDE_KOM, job.end)?;
    cx.set(all::SEND_ALL, job.is_fetch)?;
    cx.set(all::RECEIV_ALL, job.is_send)?;
    cx.set(all::FEHLER, job.failed)
}
