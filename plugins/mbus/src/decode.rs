//! FC 250 MBUS_DECODE: decodes an answer as stored by FC 1, response byte first, into records.

use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param, interface};

use crate::response::{RESPONSE_MAX, Response, read as meaning};
use crate::{status, store};

interface! {
    pub(crate) mod decode {
        /// Data block with the answer.
        in     SRC_DB: BlockDb;
        /// First byte in it: the response byte.
        in     SRC_AT: Word;
        /// Length of the answer, from ANZ of FC 1.
        in     SRC_LEN: Word;
        /// Data block for header and records.
        in     DB_NO: BlockDb;
        /// Records in the data block.
        out    COUNT: Int;
        /// 0 or an error.
        ret    RET_VAL: Word;
    }
}

pub(crate) struct Decode;

impl Block for Decode {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 250;
    const NAME: &'static str = "MBUS_DECODE";
    const PARAMS: &'static [Param] = decode::PARAMS;
    type State = ();
    type Module = ();

    fn call(cx: &mut Cx<'_>, _state: &()) -> Result<(), Abort> {
        let (count, status) = run(cx)?;
        cx.set(decode::COUNT, count as i16)?;
        cx.set(decode::RET_VAL, status)
    }
}

fn run(cx: &mut Cx<'_>) -> Result<(u16, u16), Abort> {
    let (db, at, len) = (cx.get(decode::SRC_DB)?, cx.get(decode::SRC_AT)?, cx.get(decode::SRC_LEN)?);
    let mut buffer = [0; RESPONSE_MAX];
    let Some(source) = buffer.get_mut(..len.into()) else { return Ok((0, status::MALFORMED)) };
    if cx.read(Area::Db(db), at.into(), source)?.is_err() {
        return Ok((0, status::NO_DB));
    }
    match meaning(source) {
        Response::Acknowledged => Ok((0, status::NO_DATA)),
        Response::Error(status) => Ok((0, status)),
        Response::Fields(fields) => {
            let into = cx.get(decode::DB_NO)?;
            let written = store::write(cx, into, fields)?;
            Ok((written.count, written.status))
        }
    }
}
