//! The state of a connection: C_CNTRL names the connection by its ID, CONTROL by the instance of an SFB.

use ob1_sdk::export::bit_address;
use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param, Refused, interface};
use ob1_words::boxes::{Service, status};

use crate::job::{End, Wanted, turn};
use crate::partner::{failure, mark, module_of, start_up};
use crate::state::CpState;
use crate::telegrams::{brcv4, bsend4, urcv4, usend4};
use crate::variables::{get4, put4};

/// C_STATUS: the connection is established; there is no connection with this ID.
const UP: u16 = 2;
const NONE: u16 = 0x00FF;

/// Asks the CP for the C_STATUS of a connection, which is not available in every call; or returns a STATUS.
fn ask(cx: &mut Cx<'_, CpState>, id: u16) -> Result<Result<Option<u16>, u16>, Abort> {
    let Some(laddr) = module_of(cx, id)? else { return Ok(Ok(Some(NONE))) };
    let mut wanted = Wanted::new(laddr, 1 << 61 | u64::from(id), Service::Status, id);
    wanted.begins = true;
    let end = turn(cx, &mut wanted)?;
    let [high, low, ..] = wanted.small;
    Ok(match failure(end) {
        Some(failed) => Err(failed),
        None if matches!(end, End::Done(_)) => Ok(Some(u16::from_be_bytes([high, low]))),
        None => Ok(None),
    })
}

interface! {
    /// Parameters of FC 62 C_CNTRL, in the manual's order.
    pub(crate) mod cntrl {
        /// 1: requests the state.
        in     EN_R: Bool;
        /// Number of the connection, as the station file gives it.
        in     ID: Word;
        /// 0, or the STATUS.
        ret    RET_VAL: Int;
        /// The state could not be read.
        out    ERROR: Bool;
        /// The error, 0 without one; docs/cp343.md lists the numbers.
        out    STATUS: Word;
        /// The connection is established.
        out    C_CONN: Bool;
        /// 0000h not established, 0001h being established, 0002h established, 00FFh no such connection.
        out    C_STATUS: Word;
    }
}

pub(crate) struct Status;

impl Block for Status {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 62;
    const NAME: &'static str = "C_CNTRL";
    const PARAMS: &'static [Param] = cntrl::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let failed = if cx.get(cntrl::EN_R)? {
            let id = cx.get(cntrl::ID)?;
            let found = ask(cx, id)?;
            // The outputs do not change between two answers of the CP.
            if let Ok(Some(state)) = found {
                cx.set(cntrl::C_STATUS, state)?;
                cx.set(cntrl::C_CONN, state == UP)?;
            }
            if found.is_err() {
                cx.set(cntrl::C_CONN, false)?;
            }
            found.err()
        } else {
            None
        };
        cx.set(cntrl::ERROR, failed.is_some())?;
        cx.set(cntrl::STATUS, failed.unwrap_or(0))?;
        cx.set(cntrl::RET_VAL, failed.unwrap_or(0) as i16)
    }
}

interface! {
    /// Parameters of SFC 62 CONTROL, in the manual's order.
    pub(crate) mod control {
        /// 1: requests the state.
        in     EN_R: Bool;
        /// The instance data block.
        in     I_DB: BlockDb;
        /// First byte of the instance in it; not 0 for a multi-instance.
        in     OFFSET: Word;
        /// 0, or the STATUS.
        ret    RET_VAL: Int;
        /// The state could not be read.
        out    ERROR: Bool;
        /// The error, 0 without one; docs/cp343.md lists the numbers.
        out    STATUS: Word;
        /// Type of the SFB.
        out    I_TYP: Byte;
        /// 0: the SFB has not been called since the last start.
        out    I_STATE: Byte;
        /// The connection of the SFB is established.
        out    I_CONN: Bool;
        /// STATUS of the SFB.
        out    I_STATUS: Word;
    }
}

/// I_TYP if there is no instance of an SFB.
const NO_SFB: u8 = 0xFF;

/// Offsets in the instance of an SFB, in bytes, of the values that CONTROL reads.
struct Place {
    number: u8,
    /// I_TYP of the block: which of the SFBs it is.
    code: u8,
    block: u32,
    called: u32,
    id: u32,
    status: u32,
}

macro_rules! place {
    ($module:ident, $number:literal, $code:literal) => {
        Place {
            number: $number,
            code: $code,
            block: $module::BLOCK.bit_address() / 8,
            called: $module::CALLED.bit_address() / 8,
            id: bit_address($module::PARAMS, $module::ID.index() as usize) / 8,
            status: bit_address($module::PARAMS, $module::STATUS.index() as usize) / 8,
        }
    };
}

const PLACES: [Place; 6] = [
    place!(usend4, 8, 0x00),
    place!(urcv4, 9, 0x01),
    place!(bsend4, 12, 0x04),
    place!(brcv4, 13, 0x05),
    place!(get4, 14, 0x06),
    place!(put4, 15, 0x07),
];

/// The SFB whose instance begins at this byte, or a STATUS.
fn instance(cx: &mut Cx<'_, CpState>, db: u16, offset: u32) -> Result<Result<&'static Place, u16>, Abort> {
    match cx.len(Area::Db(db))? {
        Ok(len) if offset < len => {}
        Ok(_) | Err(Refused::Outside) => return Ok(Err(status::LOCAL)),
        Err(_) => return Ok(Err(status::INSTANCE)),
    }
    for place in &PLACES {
        let mut bytes = [0; 4];
        let read = cx.read(Area::Db(db), offset + place.block, &mut bytes)?;
        if read.is_ok() && u32::from_be_bytes(bytes) == mark(place.number) {
            return Ok(Ok(place));
        }
    }
    Ok(Err(status::INSTANCE))
}

fn word(cx: &mut Cx<'_, CpState>, db: u16, at: u32) -> Result<u16, Abort> {
    let mut bytes = [0; 2];
    Ok(cx.read(Area::Db(db), at, &mut bytes)?.map_or(0, |()| u16::from_be_bytes(bytes)))
}

pub(crate) struct Control;

impl Block for Control {
    const KIND: Kind = Kind::Sfc;
    const NUMBER: u16 = 62;
    const NAME: &'static str = "CONTROL";
    const PARAMS: &'static [Param] = control::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let failed = if cx.get(control::EN_R)? { of_instance(cx)?.err() } else { None };
        cx.set(control::ERROR, failed.is_some())?;
        cx.set(control::STATUS, failed.unwrap_or(0))?;
        cx.set(control::RET_VAL, failed.unwrap_or(0) as i16)?;
        cx.set_br(failed.is_none())
    }
}

fn of_instance(cx: &mut Cx<'_, CpState>) -> Result<Result<(), u16>, Abort> {
    let (db, offset) = (cx.get(control::I_DB)?, u32::from(cx.get(control::OFFSET)?));
    let place = match instance(cx, db, offset)? {
        Ok(place) => place,
        Err(status) => {
            cx.set(control::I_TYP, NO_SFB)?;
            cx.set(control::I_STATE, 0)?;
            cx.set(control::I_CONN, false)?;
            cx.set(control::I_STATUS, 0)?;
            return Ok(Err(status));
        }
    };
    let mut called = [0; 4];
    let was_called = cx.read(Area::Db(db), offset + place.called, &mut called)?.is_ok();
    let is_called = was_called && u32::from_be_bytes(called) == start_up(cx)?;
    let (id, state) = (word(cx, db, offset + place.id)?, word(cx, db, offset + place.status)?);
    cx.set(control::I_TYP, place.code)?;
    cx.set(control::I_STATE, u8::from(is_called))?;
    cx.set(control::I_STATUS, state)?;
    // The output does not change between two answers of the CP.
    match ask(cx, id)? {
        Ok(None) => {}
        found => cx.set(control::I_CONN, found == Ok(Some(UP)))?,
    }
    Ok(Ok(()))
}
