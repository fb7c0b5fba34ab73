//! What the blocks for S7 connections have in common: USEND, URCV, BSEND, BRCV, PUT, GET. They have no LADDR: an ID is
//! unique in the station, and the station file says to which CP the connection belongs.
//!
//! On an S7-300 they are FBs with one area, on an S7-400 SFBs with four ([`FOUR`]). Both share one implementation.

use std::fmt::Write as _;

use ob1_sdk::types::{Any, Bool, Byte, DWord};
use ob1_sdk::{Abort, Cx, Formal, In, InOut, Kind, STATION, Static};
use ob1_words::boxes::{Service, status};

use ob1_siemens::any::Span;

use crate::area::{Spans, is_open, remote};
use crate::job::{End, Wanted, cancel, turn};
use crate::state::{CpState, Phase};
use ob1_siemens::outputs::Outputs;

/// The blocks of an S7-400: SFBs with four areas, and an instance that SFC 62 can evaluate.
pub(crate) const FOUR: bool = true;

/// The kind of a block.
pub(crate) const fn kind(four: bool) -> Kind {
    if four { Kind::Sfb } else { Kind::Fb }
}

/// The mark in the initial instance of SFB `number`, by which SFC 62 recognises it.
pub(crate) const fn mark(number: u8) -> u32 {
    u32::from_be_bytes([b'S', b'F', b'B', number])
}

/// A block of both families: its interface as an FB, its interface as an SFB with more areas, and the block itself,
/// whose calls go to `run`.
macro_rules! both {
    (
        $(#[$doc:meta])*
        $block:ident = $name:literal $number:literal: mod $one:ident, $four:ident { $($head:tt)* }
        in_out $one_areas:tt
        in_out $four_areas:tt
    ) => {
        $crate::partner::both! { @one $(#[$doc])* $one { $($head)* } $one_areas }
        $crate::partner::both! { @four $(#[$doc])* $four $number { $($head)* } $four_areas }

        $(#[$doc])*
        pub(crate) struct $block<const FOUR: bool>;

        impl<const FOUR: bool> $block<FOUR> {
            const MEMORY: $crate::partner::Memory = if FOUR {
                $crate::partner::Memory { req: $four::MEMORY, called: Some($four::CALLED) }
            } else {
                $crate::partner::Memory { req: $one::MEMORY, called: None }
            };
        }

        impl<const FOUR: bool> ob1_sdk::Block for $block<FOUR> {
            const KIND: ob1_sdk::Kind = $crate::partner::kind(FOUR);
            const NUMBER: u16 = $number;
            const NAME: &'static str = $name;
            const PARAMS: &'static [ob1_sdk::Param] = if FOUR { $four::PARAMS } else { $one::PARAMS };
            type State = ();
            type Module = $crate::state::CpState;

            fn call(cx: &mut ob1_sdk::Cx<'_, $crate::state::CpState>, _state: &()) -> Result<(), ob1_sdk::Abort> {
                Self::run(cx)
            }
        }
    };
    (@one $(#[$doc:meta])* $one:ident { $($head:tt)* } { $($area:ident: $ty:ident;)* }) => {
        ob1_sdk::interface! {
            $(#[$doc])*
            pub(crate) mod $one {
                $($head)*
                $(in_out $area: $ty;)*
                /// REQ at the last call.
                static MEMORY: Byte;
            }
        }
    };
    (@four $(#[$doc:meta])* $four:ident $number:literal { $($head:tt)* } { $($area:ident: $ty:ident;)* }) => {
        ob1_sdk::interface! {
            $(#[$doc])*
            pub(crate) mod $four {
                $($head)*
                $(in_out $area: $ty;)*
                /// REQ at the last call.
                static MEMORY: Byte;
                /// The mark of the SFB.
                static BLOCK: DWord = $crate::partner::mark($number);
                /// The start-up in which the SFB was called last.
                static CALLED: DWord;
            }
        }
    };
}
pub(crate) use both;

/// The address of the CP of a connection.
pub(crate) fn module_of(cx: &mut Cx<'_, CpState>, id: u16) -> Result<Option<u32>, Abort> {
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

/// The number of the current start-up, never 0.
pub(crate) fn start_up(cx: &mut Cx<'_, CpState>) -> Result<u32, Abort> {
    let now = cx.now();
    Ok(cx.module_state(STATION)?.map_or(0, |state| state.start_up(now)))
}

/// The instance as a number that no other block has.
pub(crate) fn owner(cx: &mut Cx<'_, CpState>) -> Result<u64, Abort> {
    Ok(cx.instance()?.map_or(0, |at| u64::from(at.db) << 32 | u64::from(at.offset) | 1 << 62))
}

pub(crate) fn failure(end: End) -> Option<u16> {
    Some(match end {
        End::Idle | End::Running | End::Done(_) => return None,
        End::Failed(status) => status,
        End::NoModule | End::Absent => status::CONNECTION,
        End::Full => status::FULL,
        End::Length => status::AREA,
        End::Memory(_) => status::LOCAL,
    })
}

/// What a block stores in its instance.
#[derive(Clone, Copy)]
pub(crate) struct Memory {
    pub(crate) req: Static<Byte>,
    /// Only for an SFB.
    pub(crate) called: Option<Static<DWord>>,
}

impl Memory {
    /// Notes that the block was called.
    pub(crate) fn note(self, cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
        let Some(called) = self.called else { return Ok(()) };
        let start_up = start_up(cx)?;
        cx.store(called, start_up)
    }
}

/// A block that sends or fetches at a rising edge of REQ.
pub(crate) struct Sender {
    pub(crate) req: Formal<Bool, In>,
    pub(crate) memory: Memory,
    pub(crate) outputs: Outputs,
}

impl Sender {
    /// One call. `fill` completes the request, or returns the STATUS of invalid parameters.
    pub(crate) fn call(
        &self,
        cx: &mut Cx<'_, CpState>,
        service: Service,
        (id, r_id): (u16, u32),
        fill: impl FnOnce(&mut Cx<'_, CpState>, &mut Wanted) -> Result<Result<(), u16>, Abort>,
    ) -> Result<End, Abort> {
        self.memory.note(cx)?;
        let req = cx.get(self.req)?;
        let edge = req && cx.load(self.memory.req)? == 0;
        cx.store(self.memory.req, u8::from(req))?;
        let Some(laddr) = module_of(cx, id)? else {
            self.outputs.set(cx, false, edge.then_some(status::CONNECTION), 0)?;
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
        self.outputs.set(cx, matches!(end, End::Done(_)), failed, warning)?;
        Ok(end)
    }
}

fn turn_is_busy(cx: &mut Cx<'_, CpState>, wanted: &Wanted) -> Result<bool, Abort> {
    let Ok(state) = cx.module_state(wanted.laddr)? else { return Ok(false) };
    Ok(state.slot(wanted.owner, false).is_some_and(|(_, slot)| slot.phase() != Phase::Idle))
}

/// Writes the number of areas and their lengths before the data.
pub(crate) fn lengths(wanted: &mut Wanted, spans: &Spans) -> Result<(), u16> {
    wanted.put_front(&[spans.iter().count() as u8]);
    for span in spans.iter() {
        let len = u16::try_from(span.len).map_err(|_| status::AREA)?;
        wanted.put_front(&len.to_be_bytes());
    }
    Ok(())
}

/// An area in this CPU, and the corresponding area in the partner.
pub(crate) type Pair = (Formal<Any, InOut>, Formal<Any, InOut>);

/// Writes the header of PUT and GET: the number of items; for each item its length and the pointer to it. Returns the
/// areas in this CPU. The pairs are used from the first on; both areas of a pair must have the same length.
pub(crate) fn items(
    cx: &mut Cx<'_, CpState>,
    wanted: &mut Wanted,
    pairs: &[Pair],
) -> Result<Result<Spans, u16>, Abort> {
    let mut spans = Spans::NONE;
    let mut ended = false;
    // The number comes first, but is known only at the end.
    wanted.put_front(&[0]);
    for (here, there) in pairs {
        if is_open(cx, *here)? && is_open(cx, *there)? {
            ended = true;
            continue;
        }
        let (span, there) = (Span::of(cx, *here)?, remote(cx, *there)?);
        let (Some(span), Some((pointer, len)), false) = (span, there, ended) else { return Ok(Err(status::AREA)) };
        let Some(length) = u16::try_from(len).ok().filter(|_| span.len == len) else { return Ok(Err(status::AREA)) };
        wanted.put_front(&length.to_be_bytes());
        wanted.put_front(&pointer);
        spans.push(span);
    }
    let count = spans.iter().count();
    if let Some(first) = wanted.front.0.first_mut() {
        *first = count as u8;
    }
    Ok(if count > 0 { Ok(spans) } else { Err(status::AREA) })
}

/// A block that receives while EN_R is 1; returns the number of bytes received.
pub(crate) fn receive(
    cx: &mut Cx<'_, CpState>,
    service: Service,
    (enabled, id, r_id): (bool, u16, u32),
    spans: Option<Spans>,
    outputs: &Outputs,
) -> Result<Option<u32>, Abort> {
    let Some(laddr) = module_of(cx, id)? else {
        outputs.set(cx, false, enabled.then_some(status::CONNECTION), 0)?;
        return Ok(None);
    };
    let owner = owner(cx)?;
    if !enabled {
        cancel(cx, laddr, owner)?;
        outputs.set(cx, false, None, 0)?;
        return Ok(None);
    }
    let mut wanted = Wanted::new(laddr, owner, service, id);
    let fits = spans.filter(|spans| service != Service::Urcv || lengths(&mut wanted, spans).is_ok());
    let Some(spans) = fits else {
        outputs.set(cx, false, Some(status::AREA), 0)?;
        return Ok(None);
    };
    (wanted.r_id, wanted.target, wanted.begins) = (r_id, spans, true);
    let end = turn(cx, &mut wanted)?;
    outputs.set(cx, matches!(end, End::Done(_)), failure(end), 0)?;
    Ok(if let End::Done(len) = end { Some(len) } else { None })
}
