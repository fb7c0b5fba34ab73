//! What an engine asks of the outside.

use std::fmt::Write as _;

use ob1_model::Fault;

use crate::engine::Entry;
use crate::engine::plan::{Caller, Plan};
use crate::engine::regs::Interrupted;

/// What an engine asks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Question {
    SafePoint(Caller),
    Fault(Caller, Fault, Interrupted),
    Native(u32, Caller, Entry),
    /// Peripheral bytes: address and how many.
    Read(u32, u8),
    Write(u32, u8, [u8; 4]),
}

impl Question {
    /// The question in words, with its place.
    pub(super) fn text(&self, plan: &Plan) -> String {
        let place = |at: &Caller| plan.site(*at).map_or_else(String::new, |site| format!(" at {site}"));
        let mut text = String::new();
        // Writing to a string does not fail.
        let _ = match self {
            Question::SafePoint(at) => write!(text, "a safe point{}", place(at)),
            Question::Fault(at, fault, _) => {
                write!(text, "fault {:04X}h of {}{}", fault.kind.number(), fault.number, place(at))
            }
            Question::Native(_, at, _) => write!(text, "a native block{}", place(at)),
            Question::Read(address, len) => write!(text, "{len} peripheral bytes from {address}"),
            Question::Write(address, len, bytes) => {
                write!(text, "peripheral bytes {:02X?} to {address}", &bytes[..usize::from(*len).min(bytes.len())])
            }
        };
        text
    }

    /// The statement that asks, where it is known.
    pub(super) const fn at(&self) -> Option<Caller> {
        match self {
            Question::SafePoint(at) | Question::Fault(at, ..) | Question::Native(_, at, _) => Some(*at),
            Question::Read(..) | Question::Write(..) => None,
        }
    }
}
