//! P_PRINT of the CP 340 and P_PRT341 of the CP 341: prints a format string with up to four variables.
//! [TIA help "PtP data link CP 341"]
//!
//! DB_NO and DBB_NO name a pointer data block. For each of four variables, and then for the format string, it has three
//! words: the number of the data block (0: none), the first byte in it, the length.

use std::marker::PhantomData;

use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param, interface};

use super::CpState;

use ob1_words::channels::Job as Order;

use super::send::{self, Data, Job, Params, wrong_db};

/// Longest variable, and longest format string. [TIA help "PtP data link CP 341"]
const VARIABLE_MAX: u16 = 32;
const FORMAT_MAX: u16 = 150;

/// Variables and format string.
const POINTERS: usize = 5;

/// Bytes of the pointers, and maximum DBB_NO: the pointers must be within 8192 bytes. [TIA help "PtP data link CP 341"]
const POINTER_BYTES: usize = 6 * POINTERS;
const DBB_NO_MAX: i16 = 8162;

/// Bytes of a job: the five lengths, the variables and the format string.
const JOB_MAX: usize = 2 * POINTERS + 4 * VARIABLE_MAX as usize + FORMAT_MAX as usize;

/// STATUS: no pointer to a format string. (docs/cp341-events.md)
const NO_FORMAT: u16 = 0x1E43;

interface! {
    /// The parameters, in the manual's order.
    pub mod prt {
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// 1 aborts the job and disables the block.
        in     R: Bool;
        /// Logical base address of the CP.
        in     LADDR: Int;
        /// Number of the pointer data block.
        in     DB_NO: Int;
        /// First byte of the pointers in it, 0 to 8162.
        in     DBB_NO: Int;
        /// For one call: the job ended without error.
        out    DONE: Bool;
        /// For one call: the job ended with an error.
        out    ERROR: Bool;
        /// Event class and number while ERROR is 1.
        out    STATUS: Word;
        /// RET_VAL of WR_REC after 1E0Fh.
        static SFCERR: Word;
        /// The state between two calls.
        static MEMORY: Bytes<34>;
    }
}

/// Number and name of such a block.
pub trait Name {
    /// Number of the FB.
    const NUMBER: u16;
    /// Name of the FB.
    const NAME: &'static str;
    /// STATUS: the length of a variable or of the format string is wrong.
    const LENGTH_WRONG: u16;
}

/// The block with this number and name.
#[derive(Debug)]
pub struct Print<N>(PhantomData<N>);

/// A pointer: where a variable or the format string is.
#[derive(Clone, Copy, Default)]
struct Pointer {
    db: u16,
    byte: u16,
    len: u16,
}

type Pointers = [Pointer; POINTERS];

/// Reads the pointers. A variable without a data block is absent: its length is 0.
fn pointers<N: Name>(cx: &mut Cx<'_, CpState>, db: u16, byte: u16) -> Result<Result<Pointers, u16>, Abort> {
    let mut bytes = [0; POINTER_BYTES];
    if let Err(refused) = cx.read(Area::Db(db), byte.into(), &mut bytes)? {
        return wrong_db(cx, refused, db, byte.into(), false).map(Err);
    }
    let mut pointers = Pointers::default();
    for (pointer, bytes) in pointers.iter_mut().zip(bytes.chunks_exact(6)) {
        let word = |at: usize| u16::from_be_bytes([bytes[at], bytes[at + 1]]);
        *pointer = Pointer { db: word(0), byte: word(2), len: if word(0) == 0 { 0 } else { word(4) } };
    }
    let [variables @ .., format] = &pointers;
    if format.db == 0 {
        return Ok(Err(NO_FORMAT));
    }
    let is_wrong = |pointer: &Pointer| pointer.db != 0 && !(1..=VARIABLE_MAX).contains(&pointer.len);
    if variables.iter().any(is_wrong) || !(1..=FORMAT_MAX).contains(&format.len) {
        return Ok(Err(N::LENGTH_WRONG));
    }
    Ok(Ok(pointers))
}

fn bytes_of(pointers: &Pointers) -> u16 {
    2 * POINTERS as u16 + pointers.iter().map(|pointer| pointer.len).sum::<u16>()
}

impl<N: Name> Job for Print<N> {
    const PARAMS: Params = crate::send_params!(prt);

    fn check(cx: &mut Cx<'_, CpState>) -> Result<Result<(), u16>, Abort> {
        Ok(Self::begin(cx)?.map(|_| ()))
    }

    fn begin(cx: &mut Cx<'_, CpState>) -> Result<Result<Data, u16>, Abort> {
        let (db, byte) = (cx.get(prt::DB_NO)? as u16, cx.get(prt::DBB_NO)?);
        if !(0..=DBB_NO_MAX).contains(&byte) {
            return Ok(Err(send::DB_WRONG));
        }
        let byte = byte as u16;
        Ok(pointers::<N>(cx, db, byte)?.map(|pointers| Data { db, byte, len: bytes_of(&pointers) }))
    }

    fn order(_: &mut Cx<'_, CpState>) -> Result<Order, Abort> {
        Ok(Order { sf: Order::PRINT, ..Order::default() })
    }

    /// The data are composed again for each piece, because the instance has no room for them. If the pointers change
    /// while a job is running, the job ends with an error.
    fn read(cx: &mut Cx<'_, CpState>, data: Data, from: u16, into: &mut [u8]) -> Result<Result<(), u16>, Abort> {
        let pointers = match pointers::<N>(cx, data.db, data.byte)? {
            Ok(pointers) if bytes_of(&pointers) == data.len => pointers,
            Ok(_) => return Ok(Err(N::LENGTH_WRONG)),
            Err(status) => return Ok(Err(status)),
        };
        let mut job = [0; JOB_MAX];
        let mut at = 2 * POINTERS;
        for (place, pointer) in (0..).zip(&pointers) {
            job[2 * place..2 * place + 2].copy_from_slice(&pointer.len.to_be_bytes());
            let end = at + usize::from(pointer.len);
            if pointer.len > 0
                && let Err(refused) = cx.read(Area::Db(pointer.db), pointer.byte.into(), &mut job[at..end])?
            {
                return wrong_db(cx, refused, pointer.db, pointer.byte.into(), false).map(Err);
            }
            at = end;
        }
        let from = usize::from(from);
        let len = into.len();
        into.copy_from_slice(&job[from..from + len]);
        Ok(Ok(()))
    }
}

impl<N: Name> Block for Print<N> {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = N::NUMBER;
    const NAME: &'static str = N::NAME;
    const PARAMS: &'static [Param] = prt::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        send::call::<Self>(cx)
    }
}
