//! FB 251 MBUS_SEARCH: finds the meters on the bus by their secondary addresses.
//!
//! The search selects a pattern of addresses and then requests data. No answer: no meter matches. A valid answer: one
//! meter, whose address is in the answer. An invalid answer: several meters answered at the same time; then the search
//! sets one more digit of the pattern to each of 0 to 9. The response of the CP does not distinguish a corrupted
//! acknowledgement from none, so down to DEPTH digits the search continues even without an acknowledgement.

use crate::records::{Answer, Header};
use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param};

use crate::exchange::with_exchange;
use crate::job::{Job, REQUEST, RESET, SELECTION, job_of};
use crate::read::{REQ_UD2, SELECTED, SND_NKE, selection};
use crate::response::Response;
use crate::status;
use crate::walk::Walk;

with_exchange! {
    /// The instance; docs/mbus.md has the table.
    mod search {
        /// A rising edge starts.
        in     REQ: Bool;
        /// Logical address of the CP.
        in     ADR: Int = 256;
        /// Baud rate: B8h 300, BBh 2400, BDh 9600.
        in     BAUD: Byte = 0xBB;
        /// The range to search: digits Fh are searched, the others are fixed.
        in     ID: DWord = 0xFFFF_FFFF;
        /// Manufacturer; FFFFh for any.
        in     MAN: Word = 0xFFFF;
        /// Version; FFh for any.
        in     VER: Byte = 0xFF;
        /// Medium; FFh for any.
        in     MED: Byte = 0xFF;
        /// Number of digits that are tried even without an acknowledgement.
        in     DEPTH: Int = 1;
        /// Data block for the meters found.
        in     DB_NO: BlockDb;
        /// Maximum time of one order.
        in     TIMEOUT: Time = 60_000;
        /// Number of FC SEND in this station.
        in     FC_SEND: Int = 0;
        /// Number of FC RECEIVE in this station.
        in     FC_RECEIVE: Int = 1;
        /// The search has ended; valid until the next start.
        out    DONE: Bool;
        /// The search is running.
        out    BUSY: Bool;
        /// The search failed, see STATUS; valid until the next start.
        out    ERROR: Bool;
        /// 0 or an error.
        out    STATUS: Word;
        /// Number of meters found so far.
        out    COUNT: Int;
        /// The pattern that is tried, eight digits; Fh is any.
        out    CURRENT: DWord;
        static LAST_REQ: Bool;
        static STEP: Byte;
        static LEVEL: Byte;
        static BASE: DWord;
        /// Patterns with several meters that no digit distinguishes.
        static COLLISIONS: Int;
    }
}

const JOB: Job = job_of!(search);

/// Bytes of the list's header: COUNT, COLLISIONS.
const LIST_AT: u32 = 4;
/// Bytes of a secondary address in the list: ID, MAN, VER, MED.
const ENTRY_BYTES: u32 = 8;

pub(crate) struct Search;

impl Block for Search {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 251;
    const NAME: &'static str = "MBUS_SEARCH";
    const PARAMS: &'static [Param] = search::PARAMS;
    type State = ();
    type Module = ();

    fn call(cx: &mut Cx<'_>, _state: &()) -> Result<(), Abort> {
        JOB.call(cx, start, responded, end)
    }
}

fn start(cx: &mut Cx<'_>) -> Result<(), Abort> {
    cx.store(search::COLLISIONS, 0)?;
    let base = cx.get(search::ID)?;
    attempt(cx, Walk::new(base))
}

fn walk(cx: &mut Cx<'_>) -> Result<Walk, Abort> {
    Ok(Walk { base: cx.load(search::BASE)?, id: cx.get(search::CURRENT)?, level: cx.load(search::LEVEL)? })
}

/// Tries a pattern. Starts with SND_NKE, which cancels an earlier selection.
fn attempt(cx: &mut Cx<'_>, walk: Walk) -> Result<(), Abort> {
    cx.store(search::BASE, walk.base)?;
    cx.set(search::CURRENT, walk.id)?;
    cx.store(search::LEVEL, walk.level)?;
    let telegram = [cx.get(search::BAUD)?, SND_NKE, SELECTED];
    JOB.order(cx, RESET, &telegram)
}

fn responded(cx: &mut Cx<'_>, step: u8, response: Response<'_>) -> Result<(), Abort> {
    match (step, response) {
        (_, Response::Error(status @ (status::SHORT_CIRCUIT | status::UNDEFINED))) => end(cx, status),
        (RESET, _) => {
            let telegram = selection(
                cx.get(search::BAUD)?,
                cx.get(search::CURRENT)?,
                cx.get(search::MAN)?,
                cx.get(search::VER)?,
                cx.get(search::MED)?,
            );
            JOB.order(cx, SELECTION, &telegram)
        }
        (SELECTION, Response::Acknowledged) => {
            let telegram = [cx.get(search::BAUD)?, REQ_UD2[1], SELECTED];
            JOB.order(cx, REQUEST, &telegram)
        }
        (SELECTION, Response::Error(_)) => {
            let mut walk = walk(cx)?;
            let goes_on = i16::from(walk.level) < cx.get(search::DEPTH)? && walk.narrow() || walk.go_on();
            advance(cx, walk, goes_on)
        }
        (REQUEST, Response::Fields(fields)) => match Answer::parse(fields) {
            Ok(Answer { header, .. }) => found(cx, header),
            // The answer does not contain the address: only the pattern is known.
            Err(_) => several(cx),
        },
        // Several acknowledgements or answers at the same time.
        _ => several(cx),
    }
}

fn several(cx: &mut Cx<'_>) -> Result<(), Abort> {
    let mut walk = walk(cx)?;
    if walk.narrow() {
        return attempt(cx, walk);
    }
    let collisions = cx.load(search::COLLISIONS)?;
    cx.store(search::COLLISIONS, collisions.saturating_add(1))?;
    let goes_on = walk.go_on();
    advance(cx, walk, goes_on)
}

fn found(cx: &mut Cx<'_>, header: Header) -> Result<(), Abort> {
    let (db, count) = (cx.get(search::DB_NO)?, cx.get(search::COUNT)?);
    let mut entry = [0; ENTRY_BYTES as usize];
    entry[..4].copy_from_slice(&header.identification.to_be_bytes());
    entry[4..6].copy_from_slice(&header.manufacturer.to_be_bytes());
    entry[6..].copy_from_slice(&[header.version, header.medium]);
    let at = LIST_AT + ENTRY_BYTES * u32::from(count.unsigned_abs());
    if cx.write(Area::Db(db), at, &entry)?.is_err() {
        return end(cx, status::DB_FULL);
    }
    cx.set(search::COUNT, count + 1)?;
    let mut walk = walk(cx)?;
    let goes_on = walk.go_on();
    advance(cx, walk, goes_on)
}

fn advance(cx: &mut Cx<'_>, walk: Walk, goes_on: bool) -> Result<(), Abort> {
    if goes_on { attempt(cx, walk) } else { end(cx, status::OK) }
}

fn end(cx: &mut Cx<'_>, status: u16) -> Result<(), Abort> {
    let (db, count, collisions) = (cx.get(search::DB_NO)?, cx.get(search::COUNT)?, cx.load(search::COLLISIONS)?);
    let ([c0, c1], [s0, s1]) = (count.to_be_bytes(), collisions.to_be_bytes());
    let written = cx.write(Area::Db(db), 0, &[c0, c1, s0, s1])?;
    let status = if written.is_err() { status::NO_DB } else { status };
    JOB.end(cx, status)
}
