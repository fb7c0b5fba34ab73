//! Boxes: flip-flops, timers, counters, what has EN and ENO, calls.

use ob1_ir::{Arg, BitTest, CallMode, Logic, Op, Operand, Place, StatusBit, Width};

use super::{Mode, Parsed, Parser};
use crate::tree::{Body, BoxNode, CallInput, Eno, Kind, Node, Value};

/// Most operations on a value in one box.
const MOST: usize = 8;

impl Parser<'_> {
    /// A box; whether its output goes on is seen behind it.
    pub(super) fn boxed(&mut self, logic: Option<Node>, start: u32) -> Parsed<Node> {
        self.deeper(|parser| {
            let input = logic.map(|logic| parser.as_argument(logic, start)).transpose()?;
            let (body, used) = match (parser.op(0), parser.op(1)) {
                (Some(Op::Set(place)), _) if input.is_some() => parser.latch(*place, true)?,
                (Some(Op::Reset(place)), _) if input.is_some() => parser.latch(*place, false)?,
                (Some(load), Some(Op::StartTimer(..))) if input.is_some() && load.loads() => parser.timer()?,
                (Some(Op::CountUp(_) | Op::CountDown(_)), _) if input.is_some() => parser.counter()?,
                _ => parser.enabled(input.is_some())?,
            };
            let kind = Kind::Box(Box::new(BoxNode { input, body, used }));
            Ok(parser.node(start, kind))
        })
    }

    /// The output of a box that is no ENO: whether it goes on.
    fn output(&mut self, test: BitTest) -> Parsed<bool> {
        if self.eat(&Op::Scan { logic: Logic::And, negate: false, test }) {
            return Ok(true);
        }
        self.expect(&Op::Nop, "no NOP 0 for an open output")?;
        Ok(false)
    }

    /// An input that is open, or logic and what it does.
    fn pin(&mut self, done: &Op) -> Parsed<Option<Node>> {
        if self.eat(&Op::Nop) {
            return Ok(None);
        }
        let node = self.argument()?;
        self.expect(done, "another operation at this input")?;
        Ok(Some(node))
    }

    fn latch(&mut self, place: Place, set_first: bool) -> Parsed<(Body, bool)> {
        self.take()?;
        let other = if set_first { Op::Reset(place) } else { Op::Set(place) };
        let second = self.pin(&other)?;
        let used = self.output(BitTest::Bit(place))?;
        Ok((Body::Latch { place, set_first, second }, used))
    }

    fn timer(&mut self) -> Parsed<(Body, bool)> {
        let (time, start) = (self.take()?, self.take()?);
        let Op::StartTimer(_, number) = start.op else { return self.wrong("no timer") };
        let reset = self.pin(&Op::ResetTimer(number))?;
        let outputs = self.values(&[Op::LoadTimer(number), Op::LoadTimerBcd(number)])?;
        let used = self.output(BitTest::Timer(number))?;
        Ok((Body::Timer { time, start, reset, outputs }, used))
    }

    fn counter(&mut self) -> Parsed<(Body, bool)> {
        let count = self.take()?;
        let (up, Some(number)) = (matches!(count.op, Op::CountUp(_)), count.op.number().copied()) else {
            return self.wrong("no counter");
        };
        let second = if self.eat(&Op::Build(101)) {
            None
        } else {
            let node = self.argument()?;
            let other = if up { Op::CountDown(number) } else { Op::CountUp(number) };
            self.expect(&other, "another operation at this input")?;
            Some(node)
        };
        let set = if self.eat(&Op::Nop) {
            self.expect(&Op::Nop, "no NOP 0 for an open PV")?;
            None
        } else {
            let node = self.argument()?;
            let value = self.value()?;
            self.expect(&Op::SetCounter(number), "another operation at this input")?;
            Some((node, value))
        };
        let reset = self.pin(&Op::ResetCounter(number))?;
        let outputs = self.values(&[Op::LoadCounter(number), Op::LoadCounterBcd(number)])?;
        let used = self.output(BitTest::Counter(number))?;
        Ok((Body::Counter { count, second, set, reset, outputs }, used))
    }

    /// The two values a timer or counter gives, each with where it goes.
    fn values(&mut self, loads: &[Op; 2]) -> Parsed<[Option<[Value; 2]>; 2]> {
        let mut outputs = [None, None];
        for (output, load) in outputs.iter_mut().zip(loads) {
            if self.eat(&Op::Nop) {
                continue;
            }
            if self.op(0) != Some(load) || !matches!(self.op(1), Some(Op::Transfer(_))) {
                return self.wrong("no NOP 0 for an open output");
            }
            *output = Some([self.take()?, self.take()?]);
        }
        Ok(outputs)
    }

    fn value(&mut self) -> Parsed<Value> {
        if self.op(0).is_some_and(Op::loads) { self.take() } else { self.wrong("no value is loaded") }
    }

    /// A box with EN and ENO.
    fn enabled(&mut self, has_input: bool) -> Parsed<(Body, bool)> {
        let jump = if has_input {
            match self.box_jump() {
                Some(to) => Some(to),
                None => return self.wrong("no box and no coil"),
            }
        } else {
            None
        };
        let mut body = match self.op(0) {
            Some(Op::Call(call)) if call.mode == CallMode::Call => self.call()?,
            _ => self.moved()?,
        };
        let (eno, used, behind) = self.eno(&body)?;
        if let Some(to) = jump {
            if to != behind {
                return self.wrong("SPBNB leads elsewhere");
            }
            *self.ends.entry(to).or_default() += 1;
        }
        let missing = !used && !self.eat(&Op::Nop);
        if missing && self.mode == Mode::Step7 {
            return self.wrong(match body {
                Body::Call { .. } => "CALL without NOP 0",
                _ => "T without NOP 0",
            });
        }
        match &mut body {
            Body::Move { eno: made, unmarked, .. } => (*made, *unmarked) = (eno, missing),
            Body::Call { unmarked, .. } => *unmarked = missing,
            _ => {}
        }
        Ok((body, used))
    }

    /// How ENO comes out, whether it goes on, and the operation its jump leads to.
    fn eno(&mut self, body: &Body) -> Parsed<(Eno, bool, u32)> {
        let overflow = Op::Scan { logic: Logic::And, negate: true, test: BitTest::Status(StatusBit::Overflow) };
        let result = BitTest::Status(StatusBit::BinaryResult);
        let goes_on = Op::Scan { logic: Logic::And, negate: false, test: result };
        let eno = match body {
            Body::Call { .. } => Eno::Open,
            _ if self.op(1) != Some(&Op::SaveRlo) => Eno::Open,
            _ if self.eat(&Op::SetRlo) => Eno::Set,
            _ if self.eat(&overflow) => Eno::NoOverflow,
            _ => Eno::Open,
        };
        if eno != Eno::Open {
            self.expect(&Op::SaveRlo, "its ENO does not go on")?;
            self.expect(&Op::ClearRlo, "its ENO does not go on")?;
        }
        let behind = match self.statement(self.at) {
            Some(statement) => statement.ops.start,
            None => self.network.statements.last().map_or(0, |statement| statement.ops.end),
        };
        let used = (eno != Eno::Open || matches!(body, Body::Call { .. })) && self.eat(&goes_on);
        if eno != Eno::Open && !used {
            return self.wrong("its ENO does not go on");
        }
        Ok((eno, used, behind))
    }

    fn moved(&mut self) -> Parsed<Body> {
        let mut loads = vec![self.value()?];
        if self.op(0).is_some_and(Op::loads) {
            loads.push(self.take()?);
        }
        let mut ops = Vec::new();
        while ops.len() < MOST && self.op(0).is_some_and(|op| works(op, loads.len() == 2 && ops.is_empty())) {
            ops.push(self.take()?);
        }
        if loads.len() == 2 && ops.is_empty() {
            return self.wrong("two values and nothing done with them");
        }
        let mut stores = Vec::new();
        while stores.len() < MOST && matches!(self.op(0), Some(Op::Transfer(_))) {
            stores.push(self.take()?);
        }
        match stores.len() {
            0 => self.wrong("a value that goes nowhere"),
            2.. if self.mode == Mode::Step7 => self.wrong("several T in one box"),
            _ => Ok(Body::Move { loads, ops, stores, eno: Eno::Open, unmarked: false }),
        }
    }

    fn call(&mut self) -> Parsed<Body> {
        let call = self.take()?;
        let mut inputs = Vec::new();
        if let Op::Call(what) = &call.op {
            for (argument, arg) in (0u16..).zip(&what.args) {
                let Arg::Operand(Operand { width: Width::Bit, place }) = arg else { continue };
                let found = self.inputs.iter().position(|(input, _)| input.carried == *place);
                if let Some((input, _)) = found.map(|at| self.inputs.remove(at)) {
                    inputs.push(CallInput { argument, input });
                }
            }
        }
        Ok(Body::Call { call, inputs, unmarked: false })
    }
}

/// What a box may do with a value in ACCU1; `two`: with that in ACCU2.
const fn works(op: &Op, two: bool) -> bool {
    match op {
        Op::Arithmetic(..) | Op::WordLogic(_, None) | Op::DWordLogic(_, None) | Op::Shift(_, None) => two,
        Op::AddConst { .. } | Op::WordLogic(..) | Op::DWordLogic(..) | Op::Shift(..) => !two,
        Op::Convert(_) | Op::Math(_) => !two,
        _ => false,
    }
}
