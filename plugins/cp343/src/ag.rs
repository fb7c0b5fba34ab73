//! AG_SEND, AG_RECV, AG_LSEND, AG_LRECV, AG_LOCK, AG_UNLOCK, AG_CNTRL: TCP, UDP and ISO-on-TCP connections.

use ob1_sdk::{Abort, Block, Cx, Kind, Param, STATION, interface};
use ob1_words::boxes::Service;
use ob1_words::boxes::status::{COMMAND, LENGTH};

use crate::area::Spans;
use crate::job::{End, Wanted, turn};
use crate::state::CpState;
use ob1_siemens::any::Span;
use ob1_siemens::any::status::{NO_MODULE, SOURCE, TARGET, of_memory};
use ob1_siemens::outputs::Outputs;

/// STATUS: the job is running.
const RUNNING: u16 = 0x8181;
/// STATUS of AG_RECV: no data yet.
const NO_DATA: u16 = 0x8180;
/// STATUS: SEND, RECV or CMD is not valid.
const PARAMETER: u16 = COMMAND;
/// STATUS: the CP does not answer.
const ABSENT: u16 = 0x80C0;
/// STATUS: too many jobs.
const FULL: u16 = 0x80C3;
/// Maximum data length of a job; the second for AG_SEND and AG_RECV of an S7-400, which has AG_LSEND and AG_LRECV for
/// longer data.
const LEN_MAX: i16 = 8192;
const LEN_MAX_400: i16 = 240;
/// The setting of the station that names the family of its CPU.
const FAMILY: &str = "family";

/// Maximum data length of FC `number` in this CPU.
fn most(cx: &mut Cx<'_, CpState>, number: u16) -> Result<i16, Abort> {
    let is_short = number < 50 && cx.setting_int(STATION, FAMILY)?.ok() == Some(400);
    Ok(if is_short { LEN_MAX_400 } else { LEN_MAX })
}

/// Jobs of a connection that cannot run at the same time have the same owner.
fn owner(class: u64, id: i16) -> u64 {
    1 << 63 | class << 16 | u64::from(id as u16)
}

fn status(end: End, outside: u16) -> Option<u16> {
    Some(match end {
        End::Idle | End::Running | End::Done(_) => return None,
        End::Failed(status) => status,
        End::NoModule => NO_MODULE,
        End::Absent => ABSENT,
        End::Full => FULL,
        End::Length => LENGTH,
        End::Memory(refused) => of_memory(refused, outside),
    })
}

interface! {
    /// Parameters of AG_SEND and AG_LSEND, in the manual's order.
    pub(crate) mod snd {
        /// 1: starts a job, if none is running.
        in     ACT: Bool;
        /// Number of the connection, as the station file gives it.
        in     ID: Int;
        /// Logical base address of the CP.
        in     LADDR: Word;
        /// The data to send.
        in     SEND: Any;
        /// Bytes of it, 1 to 8192.
        in     LEN: Int;
        /// For one call: the telegram has been sent.
        out    DONE: Bool;
        /// For one call: the telegram could not be sent.
        out    ERROR: Bool;
        /// The error, or 8181h while the job is running.
        out    STATUS: Word;
    }
}

/// FC 5, FC 50.
pub(crate) struct Send<const NUMBER: u16>;

impl<const NUMBER: u16> Block for Send<NUMBER> {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = NUMBER;
    const NAME: &'static str = if NUMBER == 5 { "AG_SEND" } else { "AG_LSEND" };
    const PARAMS: &'static [Param] = snd::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (act, id, laddr) = (cx.get(snd::ACT)?, cx.get(snd::ID)?, cx.get(snd::LADDR)?);
        let mut wanted = Wanted::new(u32::from(laddr), owner(1, id), Service::Send, id as u16);
        let len = cx.get(snd::LEN)?;
        let span = Span::of(cx, snd::SEND)?;
        let most = most(cx, NUMBER)?;
        let wrong = match span {
            None => Some(PARAMETER),
            Some(span) if !(1..=most).contains(&len) || len as u32 > span.len => Some(LENGTH),
            Some(span) => {
                wanted.source = span.first(len as u32).into();
                None
            }
        };
        wanted.begins = act && wrong.is_none();
        let end = turn(cx, &mut wanted)?;
        let status = match end {
            End::Idle => wrong.filter(|_| act),
            end => status(end, SOURCE),
        };
        let outputs = Outputs { end: snd::DONE, error: snd::ERROR, status: snd::STATUS };
        outputs.set(cx, matches!(end, End::Done(_)), status, if end == End::Running { RUNNING } else { 0 })
    }
}

interface! {
    /// Parameters of AG_RECV and AG_LRECV, in the manual's order.
    pub(crate) mod rcv {
        /// Number of the connection, as the station file gives it.
        in     ID: Int;
        /// Logical base address of the CP.
        in     LADDR: Word;
        /// Memory for the data; a TCP connection fills it completely.
        in     RECV: Any;
        /// For one call: new data have been stored.
        out    NDR: Bool;
        /// For one call: data could not be stored.
        out    ERROR: Bool;
        /// The error, or 8180h while there are no data, 8181h while they are being received.
        out    STATUS: Word;
        /// Bytes received, while NDR is 1.
        out    LEN: Int;
    }
}

/// FC 6, FC 60.
pub(crate) struct Receive<const NUMBER: u16>;

impl<const NUMBER: u16> Block for Receive<NUMBER> {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = NUMBER;
    const NAME: &'static str = if NUMBER == 6 { "AG_RECV" } else { "AG_LRECV" };
    const PARAMS: &'static [Param] = rcv::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (id, laddr) = (cx.get(rcv::ID)?, cx.get(rcv::LADDR)?);
        let mut wanted = Wanted::new(u32::from(laddr), owner(2, id), Service::Receive, id as u16);
        let most = most(cx, NUMBER)? as u32;
        let span = Span::of(cx, rcv::RECV)?.map(|span| span.first(span.len.min(most)));
        wanted.target = span.map_or(Spans::NONE, Spans::from);
        wanted.begins = span.is_some();
        // Without memory for them, data stay in the CP.
        let end = if span.is_some() { turn(cx, &mut wanted)? } else { End::Idle };
        let status = if span.is_none() { Some(PARAMETER) } else { status(end, TARGET) };
        let len = if let End::Done(len) = end { Some(len) } else { None };
        cx.set(rcv::LEN, len.unwrap_or(0) as i16)?;
        let outputs = Outputs { end: rcv::NDR, error: rcv::ERROR, status: rcv::STATUS };
        outputs.set(cx, len.is_some(), status, if len.is_some() { 0 } else { NO_DATA })
    }
}

interface! {
    /// Parameters of AG_LOCK and AG_UNLOCK, in the manual's order.
    pub(crate) mod lock {
        /// 1: starts a job.
        in     ACT: Bool;
        /// Number of the connection, as the station file gives it.
        in     ID: Int;
        /// Logical base address of the CP.
        in     LADDR: Word;
        /// For one call: the job ended without error.
        out    DONE: Bool;
        /// For one call: the job failed.
        out    ERROR: Bool;
        /// The error, or 8181h while the job is running.
        out    STATUS: Word;
    }
}

/// FC 7 AG_LOCK, FC 8 AG_UNLOCK.
pub(crate) struct Lock<const NUMBER: u16>;

impl<const NUMBER: u16> Block for Lock<NUMBER> {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = NUMBER;
    const NAME: &'static str = if NUMBER == 7 { "AG_LOCK" } else { "AG_UNLOCK" };
    const PARAMS: &'static [Param] = lock::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (act, id, laddr) = (cx.get(lock::ACT)?, cx.get(lock::ID)?, cx.get(lock::LADDR)?);
        let service = if NUMBER == 7 { Service::Lock } else { Service::Unlock };
        let mut wanted = Wanted::new(u32::from(laddr), owner(u64::from(NUMBER), id), service, id as u16);
        wanted.begins = act;
        let end = turn(cx, &mut wanted)?;
        let status = status(end, PARAMETER);
        let outputs = Outputs { end: lock::DONE, error: lock::ERROR, status: lock::STATUS };
        outputs.set(cx, matches!(end, End::Done(_)), status, if end == End::Running { RUNNING } else { 0 })
    }
}

interface! {
    /// Parameters of AG_CNTRL, in the manual's order.
    pub(crate) mod cntrl {
        /// 1: starts a job.
        in     ACT: Bool;
        /// Number of the connection, as the station file gives it.
        in     ID: Int;
        /// Logical base address of the CP.
        in     LADDR: Word;
        /// 0 nothing, 1 state of the connection, 2 reset it, 3 and 4 the same for all connections, 5 and 6 remove
        /// locks.
        in     CMD: Int;
        /// For one call: the job ended without error.
        out    DONE: Bool;
        /// For one call: the job failed.
        out    ERROR: Bool;
        /// The error, or 8181h while the job is running.
        out    STATUS: Word;
        /// CMD 1: state of the connection; CMD 3: of connections 1 to 32, one bit each. (docs/cp343.md)
        out    RESULT1: DWord;
        /// CMD 3: the same of the connections from 33 on. (docs/cp343.md)
        out    RESULT2: DWord;
    }
}

pub(crate) struct Control;

impl Block for Control {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 10;
    const NAME: &'static str = "AG_CNTRL";
    const PARAMS: &'static [Param] = cntrl::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (act, id, laddr) = (cx.get(cntrl::ACT)?, cx.get(cntrl::ID)?, cx.get(cntrl::LADDR)?);
        let mut wanted = Wanted::new(u32::from(laddr), owner(10, id), Service::Control, id as u16);
        wanted.put_front(&cx.get(cntrl::CMD)?.to_be_bytes());
        wanted.begins = act;
        let end = turn(cx, &mut wanted)?;
        let status = status(end, PARAMETER);
        let is_done = matches!(end, End::Done(_));
        let [a, b, c, d, e, f, g, h] = if is_done { wanted.small } else { [0; 8] };
        cx.set(cntrl::RESULT1, u32::from_be_bytes([a, b, c, d]))?;
        cx.set(cntrl::RESULT2, u32::from_be_bytes([e, f, g, h]))?;
        let outputs = Outputs { end: cntrl::DONE, error: cntrl::ERROR, status: cntrl::STATUS };
        outputs.set(cx, is_done, status, if end == End::Running { RUNNING } else { 0 })
    }
}
