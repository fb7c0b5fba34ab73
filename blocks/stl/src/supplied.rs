//! Parameters of function blocks that lead nowhere without an actual, and that no call of an instance supplies:
//! composed in/outs, timers, counters, blocks. STEP 7 requires them; each other one has a value in the instance.

use std::collections::BTreeSet;

use ob1_ir::{Arg, Call, CallMode, CodeBlock, Number, Op, Place, Target};
use ob1_model::{BlockId, Param};

use crate::diagnostic::Sink;
use crate::messages;
use crate::token::Span;
use crate::world::{World, called};

/// What an instance lies in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Within {
    /// A data block, by its number.
    Data(u16),
    /// The instance of a function block that calls it.
    Block(BlockId),
}

/// A call with an instance.
#[derive(Debug)]
pub(crate) struct Use {
    callee: BlockId,
    within: Within,
    /// Where the instance begins, in bits.
    start: u32,
    /// For each formal whether it is supplied.
    supplied: Vec<bool>,
    file: usize,
    span: Span,
}

impl Use {
    /// `None`: a call without an instance, or with one that is known at run time only.
    pub(crate) fn of(caller: BlockId, call: &Call, file: usize, span: Span) -> Option<Self> {
        if call.mode != CallMode::Call {
            return None;
        }
        let (callee, within, start) = match (call.target, call.instance) {
            (Target::Block(id), Some(Number::Fixed(db))) => (id, Within::Data(db), 0),
            (Target::Local(id, at), Some(Number::Fixed(db))) => (id, Within::Data(db), at.0),
            (Target::Local(id, at), None) => (id, Within::Block(caller), at.0),
            _ => return None,
        };
        let supplied = call.args.iter().map(|arg| *arg != Arg::Open).collect();
        Some(Self { callee, within, start, supplied, file, span })
    }
}

/// Reports, at the first call of each instance, the parameters that no call supplies and the program does not write
/// there itself.
pub(crate) fn report(uses: &[Use], code: &[CodeBlock], world: &World, sink: &mut Sink) {
    let mut given = BTreeSet::new();
    for one in uses {
        let places = one.supplied.iter().enumerate().filter(|(_, supplied)| **supplied);
        given.extend(places.map(|(at, _)| (one.within, one.start, at)));
    }
    let written = written(code);
    let mut told = BTreeSet::new();
    for one in uses {
        let instance = (one.within, one.start);
        let Some(info) = world.blocks.get(&one.callee).filter(|_| told.insert(instance)) else { continue };
        let left_out = |at: usize, formal: &Param| {
            let from = one.start + formal.at.0;
            let to = from + formal.passed_bits(true);
            needs_an_actual(formal)
                && !given.contains(&(one.within, one.start, at))
                && written.range((one.within, from)..(one.within, to)).next().is_none()
                && !has_load_value(world, one.within, from, to)
        };
        let formals = info.interface.formals().enumerate();
        let names = formals.filter_map(|(at, formal)| left_out(at, formal).then_some(formal.name.as_str()));
        let names = names.collect::<Vec<_>>().join(", ");
        if names.is_empty() {
            continue;
        }
        let of = called(one.callee, info);
        let message = match instance {
            (Within::Data(db), 0) => format!("no call of {of} with DB {db} supplies {names}"),
            _ => format!("no call of this instance of {of} supplies {names}"),
        };
        sink.report(one.file, one.span, &messages::NEVER_SUPPLIED, message);
    }
}

/// What the program transfers into instances, by the bit where it begins; the POINTERs that calls make are among it.
fn written(code: &[CodeBlock]) -> BTreeSet<(Within, u32)> {
    let mut written = BTreeSet::new();
    for block in code {
        for stmt in &block.code {
            let Op::Transfer(to) = &stmt.op else { continue };
            written.extend(match to.place {
                Place::InDb(db, at) | Place::InDi(db, at) => Some((Within::Data(db), at.0)),
                Place::Instance(at) => Some((Within::Block(block.id), at.0)),
                _ => None,
            });
        }
    }
    written
}

const fn needs_an_actual(formal: &Param) -> bool {
    formal.is_pointer() || formal.ty.is_parameter_type()
}

fn has_load_value(world: &World, within: Within, from: u32, to: u32) -> bool {
    let Within::Data(db) = within else { return false };
    let image = world.data.get(&db).and_then(|data| data.image.get(from as usize / 8..to as usize / 8));
    image.is_some_and(|bytes| bytes.iter().any(|byte| *byte != 0))
}
