//! USEND, URCV, BSEND, BRCV, GET, PUT and C_CNTRL: S7 connections. They have no LADDR: the connections of a station
//! have numbers of their own, and the station file says at which CP each is.

use std::fmt::Write as _;

use ob1_sdk::types::{Any, Bool, Byte, Word};
use ob1_sdk::{Abort, Block, Cx, Formal, In, InOut, Kind, Out, Param, STATION, Static, interface};
use ob1_words::boxes::{Service, status};

use ob1_any::Span;

use crate::area::remote;
use crate::job::{End, Wanted, cancel, turn};
use crate::state::CpState;

/// Most bytes of a BSEND over a CP.
const BSEND_MAX: u32 = 32_768;

/// Where the CP of a connection is.
fn module_of(cx: &mut Cx<'_, CpState>, id: u16) -> Result<Option<u32>, Abort> {
    struct Name([u8; 24], usize);
    impl std::fmt::Write for Name {
        fn write_str(&mut self, text: &str) -> std::fmt::Result {
            for byte in text.bytes() {
                *self.0.get_mut(self.1).ok_or(std::fmt::Error)? = byte;
                self.1 += 1;
            }
            Ok(())
        }
    }
    let mut name = Name([0; 24], 0);
    let fits = write!(name, "connection.{id}").is_ok();
    let text = name.0.get(..name.1).and_then(|bytes| str::from_utf8(bytes).ok()).filter(|_| fits);
    let Some(text) = text else { return Ok(None) };
    Ok(cx.setting_int(STATION, text)?.ok().and_then(|address| u32::try_from(address).ok()))
}

/// The instance, as no other block has it.
fn owner(cx: &mut Cx<'_, CpState>) -> Result<u64, Abort> {
    Ok(cx.instance()?.map_or(0, |at| u64::from(at.db) << 32 | u64::from(at.offset) | 1 << 62))
}

fn failure(end: End) -> Option<u16> {
    Some(match end {
        End::Idle | End::Running | End::Done(_) => return None,
        End::Failed(status) => status,
        End::NoModule | End::Absent => status::CONNECTION,
        End::Full => status::FULL,
        End::Memory(_) => status::LOCAL,
    })
}

/// Outputs every such block has.
struct Outputs {
    /// DONE or NDR.
    end: Formal<Bool, Out>,
    error: Formal<Bool, Out>,
    status: Formal<Word, Out>,
}

impl Outputs {
    /// Of a call: done, or an error, or a warning.
    fn set(&self, cx: &mut Cx<'_, CpState>, end: End, failed: Option<u16>, warning: u16) -> Result<(), Abort> {
        cx.set(self.end, failed.is_none() && matches!(end, End::Done(_)))?;
        cx.set(self.error, failed.is_some())?;
        cx.set(self.status, failed.unwrap_or(warning))?;
        cx.set_br(failed.is_none())
    }
}

/// A block that sends, or fetches, at a rising edge of REQ.
struct Sender {
    req: Formal<Bool, In>,
    memory: Static<Byte>,
    outputs: Outputs,
}

impl Sender {
    /// `fill` says what is wanted, or which STATUS its parameters have.
    fn call(
        &self,
        cx: &mut Cx<'_, CpState>,
        service: Service,
        (id, r_id): (u16, u32),
        fill: impl FnOnce(&mut Cx<'_, CpState>, &mut Wanted) -> Result<Result<(), u16>, Abort>,
    ) -> Result<End, Abort> {
        let req = cx.get(self.req)?;
        let edge = req && cx.load(self.memory)? == 0;
        cx.store(self.memory, u8::from(req))?;
        let Some(laddr) = module_of(cx, id)? else {
            self.outputs.set(cx, End::Idle, edge.then_some(status::CONNECTION), 0)?;
            return Ok(End::Idle);
        };
        let mut wanted = Wanted::new(laddr, owner(cx)?, service, id);
        wanted.r_id = r_id;
        let filled = fill(cx, &mut wanted)?;
        let was_running = edge && turn_is_busy(cx, &wanted)?;
        wanted.begins = edge && filled.is_ok();
        let end = turn(cx, &mut wanted)?;
        let failed = match (end, filled) {
            (End::Idle, Err(why)) if edge => Some(why),
            _ => failure(end),
        };
        let warning = match end {
            End::Running if was_running => status::BUSY,
            End::Running => status::RUNNING,
            _ => 0,
        };
        self.outputs.set(cx, end, failed, warning)?;
        Ok(end)
    }
}

fn turn_is_busy(cx: &mut Cx<'_, CpState>, wanted: &Wanted) -> Result<bool, Abort> {
    let Ok(state) = cx.module_state(wanted.laddr)? else { return Ok(false) };
    Ok(state.slot(wanted.owner, false).is_some_and(|(_, slot)| slot.phase() != crate::state::Phase::Idle))
}

/// How many items, and their lengths.
fn lengths(wanted: &mut Wanted, len: u32) {
    wanted.put_front(&[1]);
    wanted.put_front(&(len as u16).to_be_bytes());
}

/// Fills in what PUT and GET say to the partner: one item, its length, and the pointer to it. The result is the area of
/// the CPU that the data come from or go to; both areas must have one length.
fn one_item(
    cx: &mut Cx<'_, CpState>,
    wanted: &mut Wanted,
    (here, there): (Formal<Any, InOut>, Formal<Any, InOut>),
) -> Result<Result<Span, u16>, Abort> {
    let (span, there) = (Span::of(cx, here)?, remote(cx, there)?);
    let (Some(span), Some((pointer, len))) = (span, there) else { return Ok(Err(status::AREA)) };
    if span.len != len {
        return Ok(Err(status::AREA));
    }
    lengths(wanted, len);
    wanted.put_front(&pointer);
    Ok(Ok(span))
}

interface! {
    /// USEND.
    pub(crate) mod usend {
        /// A rising edge begins a job.
        in     REQ: Bool;
        /// The connection.
        in     ID: Word;
        /// Which URCV of the partner it is for.
        in     R_ID: DWord;
        /// The data are out: for one call.
        out    DONE: Bool;
        /// They could not be sent: for one call.
        out    ERROR: Bool;
        /// Why; 11: a job is still under way, 25: it is under way.
        out    STATUS: Word;
        /// The data.
        in_out SD_1: Any;
        /// REQ of the last call.
        static MEMORY: Byte;
    }
}

/// FB 8.
pub(crate) struct Usend;

impl Block for Usend {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 8;
    const NAME: &'static str = "USEND";
    const PARAMS: &'static [Param] = usend::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let outputs = Outputs { end: usend::DONE, error: usend::ERROR, status: usend::STATUS };
        let at = (cx.get(usend::ID)?, cx.get(usend::R_ID)?);
        let sender = Sender { req: usend::REQ, memory: usend::MEMORY, outputs };
        sender.call(cx, Service::Usend, at, |cx, wanted| {
            let Some(span) = Span::of(cx, usend::SD_1)? else { return Ok(Err(status::AREA)) };
            wanted.source = span;
            lengths(wanted, span.len);
            Ok(Ok(()))
        })?;
        Ok(())
    }
}

interface! {
    /// BSEND.
    pub(crate) mod bsend {
        /// A rising edge begins a job.
        in     REQ: Bool;
        /// 1 gives a job up.
        in     R: Bool;
        /// The connection.
        in     ID: Word;
        /// Which BRCV of the partner it is for.
        in     R_ID: DWord;
        /// The partner's BRCV has the data: for one call.
        out    DONE: Bool;
        /// It does not: for one call.
        out    ERROR: Bool;
        /// Why; 11: a job is still under way, 25: it is under way.
        out    STATUS: Word;
        /// The data.
        in_out SD_1: Any;
        /// Bytes of it; 0: all.
        in_out LEN: Word;
        /// REQ of the last call.
        static MEMORY: Byte;
    }
}

/// FB 12.
pub(crate) struct Bsend;

impl Block for Bsend {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 12;
    const NAME: &'static str = "BSEND";
    const PARAMS: &'static [Param] = bsend::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let outputs = Outputs { end: bsend::DONE, error: bsend::ERROR, status: bsend::STATUS };
        let at = (cx.get(bsend::ID)?, cx.get(bsend::R_ID)?);
        if cx.get(bsend::R)? {
            let req = cx.get(bsend::REQ)?;
            cx.store(bsend::MEMORY, u8::from(req))?;
            let had_job = match module_of(cx, at.0)? {
                Some(laddr) => {
                    let owner = owner(cx)?;
                    cancel(cx, laddr, owner)?
                }
                None => false,
            };
            return outputs.set(cx, End::Idle, had_job.then_some(status::RESET), 0);
        }
        let sender = Sender { req: bsend::REQ, memory: bsend::MEMORY, outputs };
        sender.call(cx, Service::Bsend, at, |cx, wanted| {
            let len = u32::from(cx.get(bsend::LEN)?);
            let Some(span) = Span::of(cx, bsend::SD_1)? else { return Ok(Err(status::AREA)) };
            let len = if len == 0 { span.len } else { len };
            if len > span.len || len > BSEND_MAX {
                return Ok(Err(status::AREA));
            }
            wanted.source = span.first(len);
            Ok(Ok(()))
        })?;
        Ok(())
    }
}

interface! {
    /// PUT.
    pub(crate) mod put {
        /// A rising edge begins a job.
        in     REQ: Bool;
        /// The connection.
        in     ID: Word;
        /// The partner has written the data: for one call.
        out    DONE: Bool;
        /// It has not: for one call.
        out    ERROR: Bool;
        /// Why; 11: a job is still under way, 25: it is under way.
        out    STATUS: Word;
        /// Where in the partner.
        in_out ADDR_1: Any;
        /// The data.
        in_out SD_1: Any;
        /// REQ of the last call.
        static MEMORY: Byte;
    }
}

/// FB 15.
pub(crate) struct Put;

impl Block for Put {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 15;
    const NAME: &'static str = "PUT";
    const PARAMS: &'static [Param] = put::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let outputs = Outputs { end: put::DONE, error: put::ERROR, status: put::STATUS };
        let at = (cx.get(put::ID)?, 0);
        Sender { req: put::REQ, memory: put::MEMORY, outputs }.call(cx, Service::Put, at, |cx, wanted| {
            Ok(one_item(cx, wanted, (put::SD_1, put::ADDR_1))?.map(|span| wanted.source = span))
        })?;
        Ok(())
    }
}

interface! {
    /// GET.
    pub(crate) mod get {
        /// A rising edge begins a job.
        in     REQ: Bool;
        /// The connection.
        in     ID: Word;
        /// The data are there: for one call.
        out    NDR: Bool;
        /// There are none: for one call.
        out    ERROR: Bool;
        /// Why; 11: a job is still under way, 25: it is under way.
        out    STATUS: Word;
        /// Where in the partner.
        in_out ADDR_1: Any;
        /// Room for the data.
        in_out RD_1: Any;
        /// REQ of the last call.
        static MEMORY: Byte;
    }
}

/// FB 14.
pub(crate) struct Get;

impl Block for Get {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 14;
    const NAME: &'static str = "GET";
    const PARAMS: &'static [Param] = get::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let outputs = Outputs { end: get::NDR, error: get::ERROR, status: get::STATUS };
        let at = (cx.get(get::ID)?, 0);
        Sender { req: get::REQ, memory: get::MEMORY, outputs }.call(cx, Service::Get, at, |cx, wanted| {
            Ok(one_item(cx, wanted, (get::RD_1, get::ADDR_1))?.map(|span| wanted.target = span))
        })?;
        Ok(())
    }
}

/// A block that waits as long as EN_R is 1; the bytes that have come.
fn receive(
    cx: &mut Cx<'_, CpState>,
    service: Service,
    (enabled, id, r_id): (bool, u16, u32),
    span: Option<Span>,
    outputs: &Outputs,
) -> Result<Option<u32>, Abort> {
    let Some(laddr) = module_of(cx, id)? else {
        outputs.set(cx, End::Idle, enabled.then_some(status::CONNECTION), 0)?;
        return Ok(None);
    };
    let owner = owner(cx)?;
    if !enabled {
        cancel(cx, laddr, owner)?;
        outputs.set(cx, End::Idle, None, 0)?;
        return Ok(None);
    }
    let Some(span) = span else {
        outputs.set(cx, End::Idle, Some(status::AREA), 0)?;
        return Ok(None);
    };
    let mut wanted = Wanted::new(laddr, owner, service, id);
    (wanted.r_id, wanted.target, wanted.begins) = (r_id, span, true);
    if service == Service::Urcv {
        lengths(&mut wanted, span.len);
    }
    let end = turn(cx, &mut wanted)?;
    outputs.set(cx, end, failure(end), 0)?;
    Ok(if let End::Done(len) = end { Some(len) } else { None })
}

interface! {
    /// URCV.
    pub(crate) mod urcv {
        /// 1: data are taken.
        in     EN_R: Bool;
        /// The connection.
        in     ID: Word;
        /// Which USEND of the partner it is for.
        in     R_ID: DWord;
        /// New data are there: for one call.
        out    NDR: Bool;
        /// They could not be taken: for one call.
        out    ERROR: Bool;
        /// Why.
        out    STATUS: Word;
        /// Room for the data.
        in_out RD_1: Any;
        /// Not used.
        static MEMORY: Byte;
    }
}

/// FB 9.
pub(crate) struct Urcv;

impl Block for Urcv {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 9;
    const NAME: &'static str = "URCV";
    const PARAMS: &'static [Param] = urcv::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let outputs = Outputs { end: urcv::NDR, error: urcv::ERROR, status: urcv::STATUS };
        let at = (cx.get(urcv::EN_R)?, cx.get(urcv::ID)?, cx.get(urcv::R_ID)?);
        let span = Span::of(cx, urcv::RD_1)?;
        receive(cx, Service::Urcv, at, span, &outputs).map(drop)
    }
}

interface! {
    /// BRCV.
    pub(crate) mod brcv {
        /// 1: data are taken.
        in     EN_R: Bool;
        /// The connection.
        in     ID: Word;
        /// Which BSEND of the partner it is for.
        in     R_ID: DWord;
        /// New data are there: for one call.
        out    NDR: Bool;
        /// They could not be taken: for one call.
        out    ERROR: Bool;
        /// Why.
        out    STATUS: Word;
        /// Room for the data.
        in_out RD_1: Any;
        /// Bytes that have come.
        in_out LEN: Word;
        /// Not used.
        static MEMORY: Byte;
    }
}

/// FB 13.
pub(crate) struct Brcv;

impl Block for Brcv {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 13;
    const NAME: &'static str = "BRCV";
    const PARAMS: &'static [Param] = brcv::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let outputs = Outputs { end: brcv::NDR, error: brcv::ERROR, status: brcv::STATUS };
        let at = (cx.get(brcv::EN_R)?, cx.get(brcv::ID)?, cx.get(brcv::R_ID)?);
        let span = Span::of(cx, brcv::RD_1)?;
        if let Some(len) = receive(cx, Service::Brcv, at, span, &outputs)? {
            cx.set(brcv::LEN, len as u16)?;
        }
        Ok(())
    }
}

interface! {
    /// C_CNTRL.
    pub(crate) mod cntrl {
        /// 1: the state is asked for.
        in     EN_R: Bool;
        /// The connection.
        in     ID: Word;
        /// 0, or the STATUS.
        ret    RET_VAL: Int;
        /// The state could not be had.
        out    ERROR: Bool;
        /// Why.
        out    STATUS: Word;
        /// The connection is established.
        out    C_CONN: Bool;
        /// 0000h it is down, 0001h it comes, 0002h it is up, 00FFh there is none.
        out    C_STATUS: Word;
    }
}

/// FC 62.
pub(crate) struct Status;

impl Block for Status {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 62;
    const NAME: &'static str = "C_CNTRL";
    const PARAMS: &'static [Param] = cntrl::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        if !cx.get(cntrl::EN_R)? {
            cx.set(cntrl::ERROR, false)?;
            cx.set(cntrl::STATUS, 0)?;
            return cx.set(cntrl::RET_VAL, 0);
        }
        let id = cx.get(cntrl::ID)?;
        let mut failed = None;
        let mut found = None;
        match module_of(cx, id)? {
            None => found = Some(0x00FF),
            Some(laddr) => {
                let mut wanted = Wanted::new(laddr, 1 << 61 | u64::from(id), Service::Status, id);
                wanted.begins = true;
                let end = turn(cx, &mut wanted)?;
                failed = failure(end);
                if matches!(end, End::Done(_)) {
                    found = Some(u16::from_be_bytes([wanted.small[0], wanted.small[1]]));
                }
            }
        }
        // Between two answers of the CP the outputs stay as they are.
        if let Some(state) = found {
            cx.set(cntrl::C_STATUS, state)?;
            cx.set(cntrl::C_CONN, state == 2)?;
        }
        if failed.is_some() {
            cx.set(cntrl::C_CONN, false)?;
        }
        cx.set(cntrl::ERROR, failed.is_some())?;
        cx.set(cntrl::STATUS, failed.unwrap_or(0))?;
        cx.set(cntrl::RET_VAL, failed.unwrap_or(0) as i16)
    }
}
