//! FB 250 MBUS_READ: reads a meter into a data block, by its primary or its secondary address.

use ob1_sdk::{Abort, Block, Cx, Kind, Param};

use crate::exchange::with_exchange;
use crate::job::{Job, REQUEST, RESET, SELECTION, job_of};
use crate::response::Response;
use crate::{status, store};

/// "The address 253 shows a secondary addressing." [S0 "A field"]
pub(crate) const SELECTED: u8 = 253;
/// SND_NKE: initialises the link of the slave. [S0 "Functions"]
pub(crate) const SND_NKE: u8 = 0x40;
/// SND_UD, FCB 0: the selection.
pub(crate) const SND_UD: u8 = 0x53;
/// CI field: select slave. [S0 "CI field"]
pub(crate) const SELECT: u8 = 0x52;
/// REQ_UD2 with FCB 0 and 1. [S0 "Functions"]
pub(crate) const REQ_UD2: [u8; 2] = [0x5B, 0x7B];

with_exchange! {
    /// The instance; docs/mbus.md has the table.
    mod read {
        /// A rising edge starts.
        in     REQ: Bool;
        /// With REQ: reads the next telegram of a meter after MORE.
        in     NEXT: Bool;
        /// Logical address of the CP.
        in     ADR: Int = 256;
        /// Baud rate: B8h 300, BBh 2400, BDh 9600.
        in     BAUD: Byte = 0xBB;
        /// Primary address; 253: the meter with the secondary address below.
        in     ADDRESS: Byte = 254;
        /// Identification, eight BCD digits; Fh stands for any digit.
        in     ID: DWord = 0xFFFF_FFFF;
        /// Manufacturer; FFFFh for any.
        in     MAN: Word = 0xFFFF;
        /// Version; FFh for any.
        in     VER: Byte = 0xFF;
        /// Medium; FFh for any.
        in     MED: Byte = 0xFF;
        /// Data block for header and records.
        in     DB_NO: BlockDb;
        /// Maximum time of one order.
        in     TIMEOUT: Time = 60_000;
        /// Number of FC SEND in this station.
        in     FC_SEND: Int = 0;
        /// Number of FC RECEIVE in this station.
        in     FC_RECEIVE: Int = 1;
        /// The meter has been read; valid until the next start.
        out    DONE: Bool;
        /// The job is running.
        out    BUSY: Bool;
        /// The job failed, see STATUS; valid until the next start.
        out    ERROR: Bool;
        /// The meter has more data: continue with NEXT.
        out    MORE: Bool;
        /// 0 or an error.
        out    STATUS: Word;
        /// Records in the data block.
        out    COUNT: Int;
        static LAST_REQ: Bool;
        /// FCB of the last request.
        static FCB: Bool;
        /// The last request was answered: NEXT is possible.
        static ANSWERED: Bool;
        static STEP: Byte;
    }
}

const JOB: Job = job_of!(read);

pub(crate) struct Read;

impl Block for Read {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 250;
    const NAME: &'static str = "MBUS_READ";
    const PARAMS: &'static [Param] = read::PARAMS;
    type State = ();
    type Module = ();

    fn call(cx: &mut Cx<'_>, _state: &()) -> Result<(), Abort> {
        JOB.call(cx, start, responded, end)
    }
}

fn start(cx: &mut Cx<'_>) -> Result<(), Abort> {
    cx.set(read::MORE, false)?;
    if cx.get(read::NEXT)? {
        if !cx.load(read::ANSWERED)? {
            return end(cx, status::NO_FIRST);
        }
        // "The FCB bit alternates at successful communication." [S0 "FCB bit"]
        let fcb = !cx.load(read::FCB)?;
        return request(cx, fcb);
    }
    cx.store(read::ANSWERED, false)?;
    // Resets the meter to its first telegram, and cancels an earlier selection.
    let telegram = [cx.get(read::BAUD)?, SND_NKE, cx.get(read::ADDRESS)?];
    JOB.order(cx, RESET, &telegram)
}

fn request(cx: &mut Cx<'_>, fcb: bool) -> Result<(), Abort> {
    cx.store(read::FCB, fcb)?;
    let telegram = [cx.get(read::BAUD)?, REQ_UD2[usize::from(fcb)], cx.get(read::ADDRESS)?];
    JOB.order(cx, REQUEST, &telegram)
}

fn responded(cx: &mut Cx<'_>, step: u8, response: Response<'_>) -> Result<(), Abort> {
    let is_secondary = cx.get(read::ADDRESS)? == SELECTED;
    match (step, response) {
        (_, Response::Error(status::SHORT_CIRCUIT)) => end(cx, status::SHORT_CIRCUIT),
        // An acknowledgement is not needed here.
        (RESET, _) if is_secondary => {
            let telegram = selection(
                cx.get(read::BAUD)?,
                cx.get(read::ID)?,
                cx.get(read::MAN)?,
                cx.get(read::VER)?,
                cx.get(read::MED)?,
            );
            JOB.order(cx, SELECTION, &telegram)
        }
        (RESET, Response::Error(status)) => end(cx, status),
        (SELECTION, Response::Error(_) | Response::Fields(_)) => end(cx, status::NOT_SELECTED),
        (RESET | SELECTION, _) => request(cx, true),
        (_, Response::Error(status)) => end(cx, status),
        (_, Response::Acknowledged) => end(cx, status::NO_DATA),
        (_, Response::Fields(fields)) => {
            let db = cx.get(read::DB_NO)?;
            let written = store::write(cx, db, fields)?;
            cx.store(read::ANSWERED, true)?;
            cx.set(read::MORE, written.more)?;
            cx.set(read::COUNT, written.count as i16)?;
            end(cx, written.status)
        }
    }
}

/// SND_UD with CI 52h and the secondary address, least significant byte first. [S0 "CI field"]
pub(crate) fn selection(baud: u8, id: u32, man: u16, ver: u8, med: u8) -> [u8; 12] {
    let ([i0, i1, i2, i3], [m0, m1]) = (id.to_le_bytes(), man.to_le_bytes());
    [baud, SND_UD, SELECTED, SELECT, i0, i1, i2, i3, m0, m1, ver, med]
}

fn end(cx: &mut Cx<'_>, status: u16) -> Result<(), Abort> {
    JOB.end(cx, status)
}
