//! A difference between two engines, in words.

use super::question::Question;
use crate::arena::Range;
use crate::engine::plan::{Caller, Plan};
use crate::machine::Machine;

/// What differs after the second engine's run.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum What {
    /// A byte of the arena: what the reference engine and the other one have there.
    Byte(usize, u8, u8),
    /// The timer with this number.
    Timer(usize),
    /// The counter with this number.
    Counter(usize),
    /// Statements executed: by the reference engine, by the other one.
    Statements(u32, u32),
    /// What they ask of the outside; `None`: nothing more.
    Question(Option<Question>, Option<Question>),
    /// Whether the block ran to its end.
    End { reference: bool, other: bool },
    /// The stacks after the run.
    Stacks,
}

/// A difference and its place: after the last point where the engines agreed, before the next one.
#[derive(Clone, Debug)]
pub(super) struct Difference {
    pub(super) what: What,
    pub(super) from: Option<Caller>,
    pub(super) to: Option<Caller>,
    /// Answers from outside until then.
    pub(super) events: usize,
}

impl Difference {
    /// The difference in one sentence.
    pub(super) fn text(&self, plan: &Plan, m: &Machine) -> String {
        let asked = |question: &Option<Question>| question.as_ref().map_or("nothing".into(), |q| q.text(plan));
        match &self.what {
            What::Byte(at, reference, other) => {
                format!("{} is {other:02X}h instead of {reference:02X}h", name(*at, plan, m))
            }
            What::Timer(number) => format!("T {number}"),
            What::Counter(number) => format!("Z {number}"),
            What::Statements(reference, other) => format!("{other} statements instead of {reference}"),
            What::Question(reference, other) => format!("{} instead of {}", asked(other), asked(reference)),
            What::End { reference, .. } => format!("only one comes to its end, the reference: {reference}"),
            What::Stacks => "local data or references are not given back".into(),
        }
    }
}

/// A byte of the arena as programs call it.
fn name(at: usize, plan: &Plan, m: &Machine) -> String {
    let within = |range: Range| range.bytes().contains(&at).then(|| at - range.at.index());
    let areas = &plan.areas;
    for (area, range) in [
        ("EB ", areas.inputs),
        ("AB ", areas.outputs),
        ("MB ", areas.memory),
        ("byte of local data ", areas.local),
        ("byte of the scratch of calls ", areas.scratch),
        ("byte of constants ", areas.constants),
    ] {
        if let Some(byte) = within(range) {
            return format!("{area}{byte}");
        }
    }
    let db = m.memory.dbs.iter().find_map(|db| within(db.range()).map(|byte| (db.number, byte)));
    db.map_or_else(|| format!("byte {at} of the arena"), |(number, byte)| format!("DB{number}.DBB {byte}"))
}
