//! S5 timers and counters as functions: `S_ODT(T_NO := T3, S := x, TV := t, R := r, BI := b, Q := q)`.

use ob1_ir::{Number, Op};
use ob1_model::{DataType, TimerKind};
use ob1_stl::front::Span;

use crate::check::Checker;
use crate::code::Code;
use crate::messages;
use crate::syntax::Arg;
use crate::tree::{Check, Kind, Stage, Timed, Typed};
use crate::types::{BOOL, COUNTER, S5TIME, TIMER, WORD};

const TIMERS: [(&str, TimerKind); 5] = [
    ("S_PULSE", TimerKind::Pulse),
    ("S_PEXT", TimerKind::ExtendedPulse),
    ("S_ODT", TimerKind::OnDelay),
    ("S_ODTS", TimerKind::RetentiveOnDelay),
    ("S_OFFDT", TimerKind::OffDelay),
];
const COUNTERS: [&str; 3] = ["S_CU", "S_CD", "S_CUD"];

impl<'c> Checker<'c> {
    /// A timer or counter as a function, by its name in capitals. `None`: another name.
    pub(crate) fn timed(&mut self, name: &str, args: &[Arg], span: Span) -> Option<Option<Typed<'c>>> {
        if let Some((_, kind)) = TIMERS.iter().find(|(known, _)| *known == name) {
            return Some(self.timer(name, *kind, args, span));
        }
        COUNTERS.contains(&name).then(|| self.counter(name, args, span))
    }

    fn timer(&mut self, name: &str, kind: TimerKind, args: &[Arg], span: Span) -> Option<Typed<'c>> {
        let [number, start, time, reset, rest, state] =
            self.named_values(name, ["T_NO", "S", "TV", "R", "BI", "Q"], args, span)?;
        let number = self.number_of(name, number.as_ref(), &TIMER, span)?;
        let time = match time {
            Some(time) => self.coerced(time, &S5TIME)?,
            None => Typed::new(Kind::Constant(0), &S5TIME, span),
        };
        let mut stages = Vec::new();
        if let Some(start) = start {
            stages.push(Stage { bit: self.coerced(start, &BOOL)?, load: Some(time), op: Op::StartTimer(kind, number) });
        }
        if let Some(reset) = reset {
            stages.push(Stage { bit: self.coerced(reset, &BOOL)?, load: None, op: Op::ResetTimer(number) });
        }
        let mut outputs = Vec::new();
        self.gives(rest, loaded(Op::LoadTimer(number), &WORD, span), &mut outputs)?;
        self.gives(state, Typed::new(Kind::Timer(number), &BOOL, span), &mut outputs)?;
        let timed = Timed { stages, outputs, result: Op::LoadTimerBcd(number) };
        Some(Typed::new(Kind::Timed(Box::new(timed)), &S5TIME, span))
    }

    fn counter(&mut self, name: &str, args: &[Arg], span: Span) -> Option<Typed<'c>> {
        let names = ["C_NO", "CU", "CD", "S", "PV", "R", "CV", "Q"];
        let [number, up, down, set, value, reset, count, state] = self.named_values(name, names, args, span)?;
        let number = self.number_of(name, number.as_ref(), &COUNTER, span)?;
        let value = match value {
            Some(value) => self.coerced(value, &WORD)?,
            None => Typed::new(Kind::Constant(0), &WORD, span),
        };
        let mut stages = Vec::new();
        let all = [
            (up, Op::CountUp(number), None),
            (down, Op::CountDown(number), None),
            (set, Op::SetCounter(number), Some(value)),
            (reset, Op::ResetCounter(number), None),
        ];
        for (bit, op, load) in all {
            if let Some(bit) = bit {
                stages.push(Stage { bit: self.coerced(bit, &BOOL)?, load, op });
            }
        }
        let mut outputs = Vec::new();
        self.gives(count, loaded(Op::LoadCounter(number), &WORD, span), &mut outputs)?;
        self.gives(state, Typed::new(Kind::Counter(number), &BOOL, span), &mut outputs)?;
        let timed = Timed { stages, outputs, result: Op::LoadCounterBcd(number) };
        Some(Typed::new(Kind::Timed(Box::new(timed)), &WORD, span))
    }

    /// Parameters by their names; what is left out is `None`. The outer `None`: reported.
    fn named_values<const N: usize>(
        &mut self,
        function: &str,
        names: [&str; N],
        args: &[Arg],
        span: Span,
    ) -> Option<[Option<Typed<'c>>; N]> {
        let mut out: [Option<Typed<'c>>; N] = std::array::from_fn(|_| None);
        for arg in args {
            let name = arg.name.map_or("", |name| self.name(name));
            let at = names.iter().position(|known| known.eq_ignore_ascii_case(name));
            let value = arg.value.as_ref().map(|value| self.expr(value));
            match (at.and_then(|at| out.get_mut(at)), value) {
                (Some(_), Some(value)) if value.is_bad() => return None,
                (Some(slot @ None), Some(value)) => *slot = Some(value),
                _ => {
                    let message = format!("{function} takes {}, each by its name", names.join(", "));
                    self.report(span, &messages::FUNCTION_ARGUMENTS, message);
                    return None;
                }
            }
        }
        Some(out)
    }

    fn number_of(&mut self, name: &str, value: Option<&Typed<'c>>, ty: &DataType, span: Span) -> Option<Number> {
        match value.map(|v| &v.kind) {
            Some(Kind::Timer(number)) if *ty == TIMER => return Some(*number),
            Some(Kind::Counter(number)) if *ty == COUNTER => return Some(*number),
            Some(Kind::Flexible(constant)) => {
                if let Some(number) = Self::whole(constant).and_then(|n| u16::try_from(n).ok()) {
                    return Some(Number::Fixed(number));
                }
            }
            _ => {}
        }
        let what = if *ty == TIMER { "T_NO takes a timer: T3" } else { "C_NO takes a counter: C3" };
        self.report(span, &messages::FUNCTION_ARGUMENTS, format!("{name}: {what}"));
        None
    }

    /// A value that goes to the variable of an output.
    fn gives(
        &mut self,
        target: Option<Typed<'c>>,
        value: Typed<'c>,
        outputs: &mut Vec<(Typed<'c>, Typed<'c>)>,
    ) -> Option<()> {
        let Some(target) = target else { return Some(()) };
        if !matches!(target.kind, Kind::Var(_)) {
            self.report(target.span, &messages::NOT_WRITABLE, "an output takes a variable");
            return None;
        }
        self.mark_written(&target);
        let value = self.coerced(value, target.ty)?;
        outputs.push((target, value));
        Some(())
    }
}

/// What one operation loads.
fn loaded<'c>(op: Op, ty: &'c DataType, span: Span) -> Typed<'c> {
    let nothing = Typed::new(Kind::Constant(0), ty, span);
    Typed::new(Kind::Convert(vec![op], Check::Never, Box::new(nothing)), ty, span)
}

impl Code {
    /// Starts, counts and resets in this order, hands over the outputs and loads the value in BCD.
    pub(crate) fn timed(&mut self, timed: &Timed<'_>) {
        for Stage { bit, load, op } in &timed.stages {
            // What takes more than a load would change the RLO.
            let kept = load.as_ref().filter(|v| !v.is_leaf()).map(|value| {
                self.value(value);
                self.keep()
            });
            self.bits(bit);
            match (kept, load) {
                (Some(kept), _) => self.op(Op::Load(kept)),
                (None, Some(value)) => self.value(value),
                (None, None) => {}
            }
            self.op(op.clone());
        }
        for (target, value) in &timed.outputs {
            match &target.kind {
                Kind::Var(var) => self.assign(var, target.ty, value),
                _ => self.lose(),
            }
        }
        self.op(timed.result.clone());
    }
}
