//! Timers and counters. What each statement does is defined in `ob1_cpu::engine::{Timer, Counter}`.

use std::mem::offset_of;

use cranelift_codegen::ir::{InstBuilder, Value, condcodes::IntCC, types};
use ob1_cpu::engine::{Counter, Hot, Timer};
use ob1_ir::{Number, Op};
use ob1_model::{S5Time, TimerKind};

use super::Translation;
use super::state::{self, Accu, Bit};
use crate::run::Run;

/// Delays are the kinds whose number has bit 1, and pulses those before them.
const _: () = {
    use TimerKind::{ExtendedPulse, OffDelay, OnDelay, Pulse, RetentiveOnDelay};
    assert!(OnDelay as u8 & 2 != 0 && RetentiveOnDelay as u8 & 2 != 0);
    assert!((Pulse as u8 | ExtendedPulse as u8 | OffDelay as u8) & 2 == 0);
    assert!((Pulse as u8) < OnDelay as u8 && (ExtendedPulse as u8) < OnDelay as u8);
    assert!(RetentiveOnDelay as u8 >= OnDelay as u8 && OffDelay as u8 >= OnDelay as u8);
};

/// The largest value of a counter.
const MOST: i64 = 999;

const fn fixed(number: Number) -> usize {
    match number {
        Number::Fixed(n) => n as usize,
        // The others are left to the reference.
        _ => 0,
    }
}

impl Translation<'_, '_> {
    fn timers(&mut self) -> Value {
        self.load_state(types::I64, self.hot, offset_of!(Hot, timers))
    }

    fn counters(&mut self) -> Value {
        self.load_state(types::I64, self.hot, offset_of!(Hot, counters))
    }

    fn byte(&mut self, value: i64) -> Value {
        self.b.iconst(types::I8, value)
    }

    /// `running` and how the time compares with that of its end.
    fn time(&mut self, timers: Value, at: usize, how: IntCC) -> (Value, Value) {
        let running = self.load_state(types::I8, timers, at + offset_of!(Timer, running));
        let end = self.load_state(types::I64, timers, at + offset_of!(Timer, end));
        let now = self.load_state(types::I64, self.hot, offset_of!(Hot, now));
        (running, self.b.ins().icmp(how, now, end))
    }

    /// `U T n`: what a scan of the timer gives.
    pub(crate) fn timer_output(&mut self, number: Number) -> Bit {
        let at = fixed(number) * size_of::<Timer>();
        let timers = self.timers();
        let (running, runs) = self.time(timers, at, IntCC::UnsignedLessThan);
        let kind = self.load_state(types::I8, timers, at + offset_of!(Timer, kind));
        let latched = self.load_state(types::I8, timers, at + offset_of!(Timer, latched));
        // A delay shows what has run out, the others what runs.
        let one = self.byte(1);
        let delay = self.b.ins().ushr(kind, one);
        let delay = self.b.ins().band(delay, one);
        let shown = self.b.ins().bxor(runs, delay);
        let shown = self.b.ins().band(running, shown);
        let other = self.byte(TimerKind::OnDelay as i64);
        let no_pulse = self.b.ins().icmp(IntCC::UnsignedGreaterThanOrEqual, kind, other);
        let held = self.b.ins().band(latched, no_pulse);
        Bit::Val(self.b.ins().bor(shown, held))
    }

    /// `U Z n`: whether the count is other than 0.
    pub(crate) fn counter_output(&mut self, number: Number) -> Bit {
        let counters = self.counters();
        let at = fixed(number) * size_of::<Counter>() + offset_of!(Counter, value);
        let value = self.load_state(types::I16, counters, at);
        let zero = self.b.iconst(types::I16, 0);
        Bit::Val(self.b.ins().icmp(IntCC::NotEqual, value, zero))
    }

    /// `SI SV SE SS SA` with a time that is a constant: its digits need no check. False for everything else.
    pub(crate) fn started_timer(&mut self, op: &Op) -> bool {
        let Op::StartTimer(kind, Number::Fixed(number)) = op else { return false };
        if self.now.a[0] == Accu::Var {
            return false;
        }
        self.need(crate::flow::RLO);
        let low = self.accu_low(0);
        let Some(time) = state::constant(&self.b, low).map(|time| time as u16) else { return false };
        if *number >= self.plan.timers || S5Time(time).digits().is_none() {
            return false;
        }
        let at = usize::from(*number) * size_of::<Timer>();
        let rlo = self.rlo().value(self.vars.rlo, &mut self.b);
        let timers = self.timers();
        let (running, over) = self.time(timers, at, IntCC::UnsignedGreaterThanOrEqual);
        let before = self.load_state(types::I8, timers, at + offset_of!(Timer, start_rlo));
        let known = self.load_state(types::I8, timers, at + offset_of!(Timer, kind));
        // Nothing to do without an edge, while the time runs.
        let edge = self.b.ins().bxor(rlo, before);
        let wanted = self.byte(*kind as i64);
        let other = self.b.ins().icmp(IntCC::NotEqual, known, wanted);
        let ended = self.b.ins().band(running, over);
        let mut work = self.b.ins().bor(edge, other);
        work = self.b.ins().bor(work, ended);
        if matches!(kind, TimerKind::Pulse | TimerKind::OnDelay) {
            let latched = self.load_state(types::I8, timers, at + offset_of!(Timer, latched));
            let active = self.b.ins().bor(running, latched);
            let stops = self.b.ins().band_not(active, rlo);
            work = self.b.ins().bor(work, stops);
        }
        let (works, next) = (self.b.create_block(), self.b.create_block());
        self.b.ins().brif(work, works, &[], next, &[]);
        self.b.seal_block(works);
        self.b.switch_to_block(works);
        let wide = self.b.ins().uextend(types::I32, rlo);
        let which = self.word(u32::from(*number) << 16 | (*kind as u32) << 1);
        let which = self.b.ins().bor(which, wide);
        let time = self.word(u32::from(time));
        let answer = self.call_helper(offset_of!(Run, timer), which, time);
        self.ways.aborts = true;
        self.b.ins().brif(answer, self.abort, &[], next, &[]);
        self.b.seal_block(next);
        self.b.switch_to_block(next);
        self.chain_is_over();
        true
    }

    /// The chain ends, but STA stays.
    fn chain_is_over(&mut self) {
        self.now.fc = Bit::Known(false);
        self.now.or = Bit::Known(false);
    }

    /// True when the statement is one of timers or counters.
    pub(crate) fn timer_statement(&mut self, op: &Op) -> bool {
        match op {
            Op::LoadTimer(n) => self.load_timer(*n),
            Op::LoadCounter(n) => {
                let counters = self.counters();
                let at = fixed(*n) * size_of::<Counter>() + offset_of!(Counter, value);
                let value = self.load_state(types::I16, counters, at);
                let value = self.b.ins().uextend(types::I32, value);
                self.load(Accu::Full(value));
            }
            Op::ResetTimer(n) => self.reset_timer(*n),
            Op::CountUp(n) => self.count_edge(*n, true),
            Op::CountDown(n) => self.count_edge(*n, false),
            Op::ResetCounter(n) => {
                let rlo = self.rlo().value(self.vars.rlo, &mut self.b);
                let counters = self.counters();
                let at = fixed(*n) * size_of::<Counter>() + offset_of!(Counter, value);
                let value = self.load_state(types::I16, counters, at);
                let zero = self.b.iconst(types::I16, 0);
                let value = self.b.ins().select(rlo, zero, value);
                self.store_state(value, counters, at);
                self.chain_is_over();
            }
            _ => return false,
        }
        true
    }

    /// `L T n`: the remaining time in binary.
    fn load_timer(&mut self, number: Number) {
        let at = fixed(number) * size_of::<Timer>();
        let timers = self.timers();
        let running = self.load_state(types::I8, timers, at + offset_of!(Timer, running));
        let rest = self.load_state(types::I16, timers, at + offset_of!(Timer, rest));
        let rest = self.b.ins().uextend(types::I32, rest);
        let (runs, next) = (self.b.create_block(), self.b.create_block());
        let value = self.b.append_block_param(next, types::I32);
        self.b.ins().brif(running, runs, &[], next, &[rest.into()]);
        self.b.seal_block(runs);
        self.b.switch_to_block(runs);
        let (which, none) = (self.word(fixed(number) as u32), self.word(0));
        let left = self.call_helper(offset_of!(Run, time_left), which, none);
        self.b.ins().jump(next, &[left.into()]);
        self.b.seal_block(next);
        self.b.switch_to_block(next);
        self.load(Accu::Full(value));
    }

    /// `R T n`: with RLO 1 the timer stops and shows 0.
    fn reset_timer(&mut self, number: Number) {
        let rlo = self.rlo().value(self.vars.rlo, &mut self.b);
        let at = fixed(number) * size_of::<Timer>();
        let timers = self.timers();
        for field in [offset_of!(Timer, running), offset_of!(Timer, latched)] {
            let value = self.load_state(types::I8, timers, at + field);
            let value = self.b.ins().band_not(value, rlo);
            self.store_state(value, timers, at + field);
        }
        let rest = self.load_state(types::I16, timers, at + offset_of!(Timer, rest));
        let zero = self.b.iconst(types::I16, 0);
        let rest = self.b.ins().select(rlo, zero, rest);
        self.store_state(rest, timers, at + offset_of!(Timer, rest));
        self.chain_is_over();
    }

    /// `ZV`, `ZR`: one step at a rising edge, within the limits.
    fn count_edge(&mut self, number: Number, up: bool) {
        let rlo = self.rlo().value(self.vars.rlo, &mut self.b);
        let counters = self.counters();
        let at = fixed(number) * size_of::<Counter>();
        let edge = at + if up { offset_of!(Counter, up_rlo) } else { offset_of!(Counter, down_rlo) };
        let before = self.load_state(types::I8, counters, edge);
        let value = self.load_state(types::I16, counters, at + offset_of!(Counter, value));
        let limit = self.b.iconst(types::I16, if up { MOST } else { 0 });
        let how = if up { IntCC::UnsignedLessThan } else { IntCC::NotEqual };
        let free = self.b.ins().icmp(how, value, limit);
        let rising = self.b.ins().band_not(rlo, before);
        let counts = self.b.ins().band(rising, free);
        let step = self.b.ins().uextend(types::I16, counts);
        let value = if up { self.b.ins().iadd(value, step) } else { self.b.ins().isub(value, step) };
        self.store_state(value, counters, at + offset_of!(Counter, value));
        self.store_state(rlo, counters, edge);
        self.chain_is_over();
    }
}
