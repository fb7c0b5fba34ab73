//! The pins of each kind of box, of ladder and function plan alike.

use ob1_ir::{Call, Number, Op, Target};
use ob1_stl::Mnemonics;

use super::frame::{At, Frame, Pin};
use super::names::Names;
use super::signs;
use crate::tree::{Body, BoxNode, Node, Value};

/// How a view draws logic at an input.
pub(crate) type Logic<'l> = dyn Fn(&Node) -> At + 'l;

/// A box of the tree, ready to be drawn. `logic` is asked for its inputs.
pub(crate) fn frame(names: &Names<'_>, node: &Node, inner: &BoxNode, logic: &Logic<'_>) -> Frame {
    let german = names.options.mnemonics != Mnemonics::International;
    let of = |node: Option<&Node>| node.map_or(At::Open, logic);
    let first = || of(inner.input.as_ref());
    let values = |pair: &Option<[Value; 2]>| pair.as_ref().map_or(At::Open, |[_, to]| value(names, to));
    let mut frame = Frame { used: inner.used, ..Frame::new(node.id, String::new()) };
    match &inner.body {
        Body::Latch { set_first, second, .. } => {
            let pins = if *set_first { ["S", "R"] } else { ["R", "S"] };
            frame.title = if *set_first { "SR" } else { "RS" }.to_owned();
            frame.inputs = vec![Pin::new(pins[0], first()), Pin::new(pins[1], of(second.as_ref()))];
            frame.outputs = vec![Pin::new("Q", At::Open)];
            frame.statement = behind(inner.input.as_ref(), node);
            frame.above = names.above(frame.statement);
        }
        Body::Timer { time, start, reset, outputs } => {
            let [tv, r, bi, bcd] = signs::timer_pins(german);
            if let Op::StartTimer(kind, _) = start.op {
                frame.title = signs::timer(kind, german)[0].to_owned();
            }
            let inputs = [("S", first()), (tv, value(names, time)), (r, of(reset.as_ref()))];
            frame.inputs = inputs.into_iter().map(|(name, at)| Pin::new(name, at)).collect();
            let outputs = [("Q", At::Open), (bi, values(&outputs[0])), (bcd, values(&outputs[1]))];
            frame.outputs = outputs.into_iter().map(|(name, at)| Pin::new(name, at)).collect();
            frame.statement = start.statement;
            frame.above = names.above(start.statement);
        }
        Body::Counter { count, second, set, reset, outputs } => {
            let [cu, cd, s, pv, r, cv, bcd] = signs::counter_pins(german);
            let up = matches!(count.op, Op::CountUp(_));
            frame.title = signs::counter(up, second.is_some(), german).to_owned();
            let (one, other) = if up { (cu, cd) } else { (cd, cu) };
            frame.inputs.push(Pin::new(one, first()));
            if let Some(second) = second {
                frame.inputs.push(Pin::new(other, logic(second)));
            }
            let (set, preset) = set.as_ref().map_or((None, At::Open), |(node, v)| (Some(node), value(names, v)));
            let inputs = [(s, of(set)), (pv, preset), (r, of(reset.as_ref()))];
            frame.inputs.extend(inputs.into_iter().map(|(name, at)| Pin::new(name, at)));
            let outputs = [("Q", At::Open), (cv, values(&outputs[0])), (bcd, values(&outputs[1]))];
            frame.outputs = outputs.into_iter().map(|(name, at)| Pin::new(name, at)).collect();
            frame.statement = count.statement;
            frame.above = names.above(count.statement);
        }
        Body::Move { loads, ops, stores, .. } => {
            frame.title = moved(ops);
            frame.inputs = vec![Pin::new("EN", first())];
            frame.inputs.extend(operands(names, loads, ops));
            frame.outputs = vec![Pin::new("ENO", At::Open)];
            frame.outputs.extend(stores.iter().map(|to| Pin::new("OUT", value(names, to))));
            frame.statement = loads.first().map_or(0, |value| value.statement);
        }
        Body::Call { call, inputs, .. } => {
            frame.inputs = vec![Pin::new("EN", first())];
            frame.outputs = vec![Pin::new("ENO", At::Open)];
            for actual in names.actuals(call.statement) {
                let carried = inputs.iter().find(|input| input.argument == actual.argument);
                let at = match carried {
                    Some(carried) => logic(&carried.input.logic),
                    None => At::Value(names.actual(actual), call.statement),
                };
                let pins = if actual.is_output { &mut frame.outputs } else { &mut frame.inputs };
                pins.push(Pin::new(&actual.name, at));
            }
            frame.statement = call.statement;
            if let Op::Call(what) = &call.op {
                (frame.title, frame.above) = called(names, what, call.statement);
            }
        }
    }
    frame
}

/// The `S` or `R` of a latch: behind its first input.
pub(crate) fn behind(input: Option<&Node>, node: &Node) -> u32 {
    input.map_or(node.statements.start, |input| input.statements.end)
}

fn value(names: &Names<'_>, value: &Value) -> At {
    At::Value(names.value(value.statement), value.statement)
}

/// The name of a box that moves a value.
pub(crate) fn moved(ops: &[Value]) -> String {
    if ops.is_empty() {
        return "MOVE".to_owned();
    }
    ops.iter().map(|value| signs::operation(&value.op)).collect::<Vec<_>>().join(" ")
}

/// The values that come into it.
fn operands(names: &Names<'_>, loads: &[Value], ops: &[Value]) -> Vec<Pin> {
    let constant = ops.iter().find(|op| {
        matches!(
            op.op,
            Op::AddConst { .. } | Op::WordLogic(_, Some(_)) | Op::DWordLogic(_, Some(_)) | Op::Shift(_, Some(_))
        )
    });
    let shifts = ops.iter().any(|op| matches!(op.op, Op::Shift(..)));
    match (loads, constant) {
        ([one], None) => vec![Pin::new("IN", value(names, one))],
        ([one], Some(op)) if shifts => vec![Pin::new("IN", value(names, one)), Pin::new("N", value(names, op))],
        // The number of places is loaded first.
        ([places, one], _) if shifts => vec![Pin::new("IN", value(names, one)), Pin::new("N", value(names, places))],
        _ => {
            let all = loads.iter().chain(constant).enumerate();
            all.map(|(at, one)| Pin::new(&format!("IN{}", at + 1), value(names, one))).collect()
        }
    }
}

/// The title of a call, and its instance.
fn called(names: &Names<'_>, call: &Call, statement: u32) -> (String, Vec<String>) {
    let symbol = names.network.statements.get(statement as usize).map_or("", |s| s.symbol.as_str());
    let operand = names.network.statements.get(statement as usize).map_or("", |s| s.operand.as_str());
    let (title, instance) = match call.target {
        Target::Block(id) => (id.to_string(), None),
        Target::Local(id, _) => (id.to_string(), Some(operand.rsplit(", ").next().unwrap_or(operand).to_owned())),
        Target::Indirect(kind, _) => (kind.name().to_owned(), Some(operand.to_owned())),
    };
    let above = match (instance, call.instance) {
        (Some(name), _) => vec![name],
        (None, Some(Number::Fixed(n))) => vec![format!("DB {n}")],
        (None, _) => Vec::new(),
    };
    let title = if symbol.is_empty() { title } else { format!("{title} {symbol}") };
    (title, above)
}
