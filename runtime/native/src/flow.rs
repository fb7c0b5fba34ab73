//! Data flow of a block's registers: which are needed after each statement, and what is known of them where jumps meet.
//! Values that nobody sees are not computed.

use ob1_cpu::engine::Plan;
use ob1_ir::{
    AccuOp, AddressRegister, BitTest, Convert, DbRegister, Jump, Logic, Number, NumberFormat, Op, Place, StatusBit,
    Stmt, Target,
};

use crate::place;

/// A set of registers and status bits.
pub(crate) type Set = u32;

pub(crate) const A1: Set = 1;
pub(crate) const A2: Set = 1 << 1;
pub(crate) const AR1: Set = 1 << 2;
pub(crate) const AR2: Set = 1 << 3;
pub(crate) const RLO: Set = 1 << 4;
pub(crate) const FC: Set = 1 << 5;
pub(crate) const OR: Set = 1 << 6;
pub(crate) const STA: Set = 1 << 7;
/// CC1 and CC0, which are always needed together.
pub(crate) const CC: Set = 1 << 8;
pub(crate) const OV: Set = 1 << 9;
pub(crate) const OS: Set = 1 << 10;
pub(crate) const BR: Set = 1 << 11;
/// Open brackets: the nesting stack.
pub(crate) const NEST: Set = 1 << 12;
pub(crate) const ALL: Set = (1 << 13) - 1;
/// The count of statements executed; no register of the CPU.
pub(crate) const COUNT: Set = 1 << 13;
pub(crate) const CHAIN: Set = FC | OR | STA;
/// The registers that the caller sees after a call.
pub(crate) const RESULTS: Set = A1 | A2 | AR1 | AR2 | RLO | CC | OV | BR;
/// The registers that an error organization block sees.
pub(crate) const SEEN_BY_FAULTS: Set = A1 | A2 | AR1 | AR2;

/// How a statement is executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum How {
    /// Compiled; it cannot fail.
    Plain,
    /// Compiled, after checks; if one fails, the reference runs the statement.
    Checked,
    /// By the reference engine, one statement at a time.
    Step,
    /// A call of another block.
    Call,
}

/// What the translation of a block depends on besides its statements.
#[derive(Clone, Copy)]
pub(crate) struct Env<'a> {
    pub(crate) plan: &'a Plan,
    /// The block has `MCRA`: what depends on the master control relay is left to the reference.
    pub(crate) mcr: bool,
    /// The registers that are seen when the block has ended.
    pub(crate) end: Set,
    /// The block is part of its caller: its operands lie at known places, and nothing in it fails.
    pub(crate) inlined: bool,
}

impl Env<'_> {
    fn four(&self) -> bool {
        self.plan.accumulators == 4
    }

    /// How `op` is executed.
    pub(crate) fn how(&self, op: &Op) -> How {
        let at = |place: &Place, bits: u32| match place::class(place, bits, self.plan) {
            place::Class::Slow => How::Step,
            place::Class::Checked if !self.inlined => How::Checked,
            _ => How::Plain,
        };
        let written = |place: &Place, bits: u32| if self.mcr { How::Step } else { at(place, bits) };
        let known = |there: bool| if there { How::Plain } else { How::Step };
        let timer = |n: &Number| known(matches!(n, Number::Fixed(n) if *n < self.plan.timers));
        let counter = |n: &Number| known(matches!(n, Number::Fixed(n) if *n < self.plan.counters));
        match op {
            Op::Call(_) => How::Call,
            Op::LoadTimer(n) | Op::ResetTimer(n) => timer(n),
            Op::LoadCounter(n) | Op::CountUp(n) | Op::CountDown(n) | Op::ResetCounter(n) => counter(n),
            Op::Scan { test, .. } => match test {
                BitTest::Bit(place) => at(place, 1),
                BitTest::Status(_) => How::Plain,
                BitTest::Timer(n) => timer(n),
                BitTest::Counter(n) => counter(n),
            },
            Op::Assign(place) | Op::Set(place) | Op::Reset(place) => written(place, 1),
            Op::EdgePositive(place) | Op::EdgeNegative(place) => at(place, 1),
            Op::Load(o) | Op::LoadArFrom(_, o) | Op::TransferArTo(_, o) => at(&o.place, u32::from(o.width.bits())),
            Op::Transfer(o) => written(&o.place, u32::from(o.width.bits())),
            Op::OpenDb(_, Number::Fixed(n)) if *n == 0 || place::data(self.plan, *n).is_some() => How::Plain,
            Op::OpenDb(..)
            | Op::LoadParamPointer { .. }
            | Op::LoadParamCopy { .. }
            | Op::LoadStatus
            | Op::TransferStatus
            | Op::McrActivate
            | Op::McrDeactivate
            | Op::McrOpen
            | Op::McrClose
            | Op::LoadTimerBcd(_)
            | Op::LoadCounterBcd(_)
            | Op::LoadDbLength(_)
            | Op::LoadDbNumber(_)
            // Compiled when its time is a constant.
            | Op::StartTimer(..)
            | Op::EnableTimer(_)
            | Op::SetCounter(_)
            | Op::EnableCounter(_)
            | Op::ExchangeDbs
            | Op::Shift(_, None)
            | Op::Convert(Convert::Bti | Convert::Btd | Convert::Itb | Convert::Dtb) => How::Step,
            Op::Math(f) if !matches!(f, ob1_ir::MathFn::Sqr | ob1_ir::MathFn::Sqrt) => How::Step,
            Op::Arithmetic(NumberFormat::Real, AccuOp::Mod) => How::Step,
            _ => How::Plain,
        }
    }

    /// Registers that must be right before `op`, if `after` must be right after it.
    pub(crate) fn before(&self, op: &Op, after: Set) -> Set {
        let how = self.how(op);
        if how == How::Call {
            return ALL;
        }
        let (uses, kills) = self.uses_kills(op, after);
        match how {
            How::Plain | How::Call => uses | after & !kills,
            How::Checked => uses | after | SEEN_BY_FAULTS,
            How::Step => uses | after | SEEN_BY_FAULTS,
        }
    }

    /// Registers that must be at hand when `op` is compiled, if `after` are needed after it: those it uses, and those
    /// its code may read without using them, which it leaves as they are.
    pub(crate) fn at_hand(&self, op: &Op, after: Set) -> Set {
        let (all, kills) = self.uses_kills(op, ALL);
        self.uses_kills(op, after).0 | all & after & !kills
    }

    fn uses_kills(&self, op: &Op, after: Set) -> (Set, Set) {
        let needed = |of: Set, uses: Set| if after & of != 0 { uses } else { 0 };
        let place = |p: &Place| match p {
            Place::Register(_, AddressRegister::Ar1, _) => AR1,
            Place::Register(_, AddressRegister::Ar2, _) | Place::Instance(_) => AR2,
            _ => 0,
        };
        let ar = |r: &AddressRegister| if *r == AddressRegister::Ar1 { AR1 } else { AR2 };
        match op {
            Op::Scan { logic, test, .. } => {
                let tested = match test {
                    BitTest::Bit(p) => place(p),
                    BitTest::Status(bit) => match bit {
                        StatusBit::Overflow => OV,
                        StatusBit::StoredOverflow => OS,
                        StatusBit::BinaryResult => BR,
                        _ => CC,
                    },
                    BitTest::Timer(_) | BitTest::Counter(_) => AR2,
                };
                match logic {
                    Logic::And => (tested | needed(RLO, FC | RLO | OR), RLO | FC | STA),
                    _ => (tested | needed(RLO, FC | RLO), RLO | FC | OR | STA),
                }
            }
            Op::Open { .. } => (FC | RLO | OR | NEST, CHAIN),
            Op::Close => (NEST | RLO, RLO | CHAIN),
            Op::OrBranch => (FC | RLO, CHAIN),
            Op::Assign(p) | Op::Set(p) | Op::Reset(p) => (RLO | place(p), CHAIN),
            Op::EdgePositive(p) | Op::EdgeNegative(p) => (RLO | place(p), RLO | CHAIN),
            Op::SetRlo | Op::ClearRlo => (0, RLO | CHAIN),
            Op::NotRlo => (needed(RLO, RLO), RLO | STA),
            Op::SaveRlo => (needed(BR, RLO), BR),
            Op::Load(o) => (needed(A2, A1) | place(&o.place), A1 | A2),
            Op::LoadConst(_) => (needed(A2, A1), A1 | A2),
            Op::Transfer(o) => (A1 | place(&o.place), 0),
            Op::LoadStatus => (ALL, 0),
            Op::TransferStatus => (ALL, 0),
            Op::Arithmetic(..) => (needed(A1 | CC | OV | OS, A1 | A2), A1 | CC | OV | if self.four() { A2 } else { 0 }),
            Op::AddConst { .. } | Op::Increment(_) | Op::Decrement(_) => (needed(A1, A1), A1),
            Op::Compare(..) => (needed(RLO | STA | CC | OV | OS, A1 | A2), RLO | CHAIN | CC | OV),
            Op::WordLogic(_, with) => (needed(A1 | CC, A1 | if with.is_none() { A2 } else { 0 }), A1 | CC | OV),
            Op::DWordLogic(_, with) => (needed(A1 | CC, A1 | if with.is_none() { A2 } else { 0 }), A1 | CC | OV),
            Op::Shift(_, Some(0)) => (0, 0),
            Op::Shift(_, Some(_)) => (needed(A1 | CC, A1), A1 | CC | OV),
            Op::Shift(_, None) => (A1 | A2, 0),
            Op::RotateLeftCc1 | Op::RotateRightCc1 => (needed(A1 | CC, A1 | CC), A1 | CC | OV),
            Op::Convert(kind) => match kind {
                Convert::Rnd | Convert::RndPlus | Convert::RndMinus | Convert::Trunc => {
                    (needed(A1 | OV | OS, A1), A1 | OV)
                }
                Convert::Negi | Convert::Negd => (needed(A1 | CC | OV | OS, A1), A1 | CC | OV),
                _ => (A1, A1),
            },
            Op::Math(_) => (needed(A1 | CC | OV | OS, A1), A1 | CC | OV),
            Op::ExchangeAccus => (needed(A1, A2) | needed(A2, A1), A1 | A2),
            Op::Push => (needed(A2, A1) | A2, A2),
            Op::Pop => (needed(A1 | A2, A2), A1 | if self.four() { A2 } else { 0 }),
            Op::Enter => (A2, 0),
            Op::Leave => (0, A2),
            Op::LoadAr(r) => (needed(ar(r), A1), ar(r)),
            Op::LoadArConst(r, _) => (0, ar(r)),
            Op::LoadArFrom(r, o) => (place(&o.place), ar(r)),
            Op::CopyAr2ToAr1 => (needed(AR1, AR2), AR1),
            Op::CopyAr1ToAr2 => (needed(AR2, AR1), AR2),
            Op::ExchangeArs => (needed(AR1, AR2) | needed(AR2, AR1), AR1 | AR2),
            Op::TransferAr(r) => (needed(A2, A1) | needed(A1, ar(r)), A1 | A2),
            Op::TransferArTo(r, o) => (ar(r) | place(&o.place), 0),
            Op::AddAr(r) => (needed(ar(r), A1 | ar(r)), ar(r)),
            Op::AddArConst(r, _) => (needed(ar(r), ar(r)), ar(r)),
            Op::Jump(on, _) => match on {
                Jump::Always => (0, 0),
                Jump::IfRlo | Jump::IfNotRlo => (RLO, RLO | CHAIN),
                Jump::IfRloSaveBr | Jump::IfNotRloSaveBr => (RLO, RLO | CHAIN | BR),
                Jump::IfBr | Jump::IfNotBr => (BR, CHAIN),
                Jump::IfOverflow => (OV, 0),
                Jump::IfStoredOverflow => (OS, OS),
                _ => (CC, 0),
            },
            Op::Loop(_) | Op::JumpList { .. } => (A1, 0),
            Op::EndIf => (RLO | self.end, RLO | CHAIN),
            Op::End => (self.end, ALL),
            Op::OpenDb(..) => (AR2, 0),
            Op::LoadTimer(_) | Op::LoadCounter(_) => (needed(A2, A1) | AR2, A1 | A2),
            Op::ResetTimer(_) | Op::CountUp(_) | Op::CountDown(_) | Op::ResetCounter(_) => (RLO | AR2, FC | OR),
            Op::LoadDbLength(_) | Op::LoadDbNumber(_) => (A1, 0),
            Op::Nop | Op::Build(_) => (0, 0),
            // Run by the reference, which may use any of these.
            _ => (ALL & !(CC | OV | OS | BR), 0),
        }
    }
}

/// Registers whose values are needed before each statement; the last entry stands for the end.
pub(crate) fn liveness(stmts: &[Stmt], env: &Env<'_>) -> Vec<Set> {
    let mut live = vec![0; stmts.len() + 1];
    live[stmts.len()] = env.end;
    loop {
        let mut changed = false;
        for (i, stmt) in stmts.iter().enumerate().rev() {
            let mut after = 0;
            successors(&stmt.op, i, &mut |next| after |= live[next]);
            let before = env.before(&stmt.op, after);
            changed |= before != live[i];
            live[i] = before;
        }
        if !changed {
            return live;
        }
    }
}

/// The statements that can come after statement `i`.
pub(crate) fn successors(op: &Op, i: usize, see: &mut dyn FnMut(usize)) {
    match op {
        Op::Jump(Jump::Always, to) => see(*to as usize),
        Op::Jump(_, to) | Op::Loop(to) => {
            see(*to as usize);
            see(i + 1);
        }
        Op::JumpList { targets, otherwise } => {
            targets.iter().for_each(|to| see(*to as usize));
            see(*otherwise as usize);
        }
        Op::End => {}
        _ => see(i + 1),
    }
}

/// For each statement (and the end) whether a jump leads there.
pub(crate) fn targets(stmts: &[Stmt]) -> Vec<bool> {
    let mut marks = vec![false; stmts.len() + 1];
    for stmt in stmts {
        match &stmt.op {
            Op::Jump(_, to) | Op::Loop(to) => marks[*to as usize] = true,
            Op::JumpList { targets, otherwise } => {
                targets.iter().for_each(|to| marks[*to as usize] = true);
                marks[*otherwise as usize] = true;
            }
            _ => {}
        }
    }
    marks
}

/// For each statement (and the end) whether a jump leads back to it.
pub(crate) fn loops(stmts: &[Stmt]) -> Vec<bool> {
    let mut marks = vec![false; stmts.len() + 1];
    for (pc, stmt) in stmts.iter().enumerate() {
        successors(&stmt.op, pc, &mut |next| marks[next] |= next <= pc);
    }
    marks
}

/// What is known of the registers at a statement, whichever path led there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Facts {
    pub(crate) fc: Option<bool>,
    pub(crate) or: Option<bool>,
    /// Numbers of opened data blocks of the program; 0: none is open.
    pub(crate) db: Option<u16>,
    pub(crate) di: Option<u16>,
}

impl Facts {
    /// Nothing is known: as at the begin of a block that is called.
    pub(crate) const NONE: Self = Self { fc: None, or: None, db: None, di: None };

    fn meet(self, other: Self) -> Self {
        fn same<T: PartialEq + Copy>(a: Option<T>, b: Option<T>) -> Option<T> {
            if a == b { a } else { None }
        }
        Self {
            fc: same(self.fc, other.fc),
            or: same(self.or, other.or),
            db: same(self.db, other.db),
            di: same(self.di, other.di),
        }
    }

    /// The facts after `op`, which may also have failed.
    fn behind(self, op: &Op, env: &Env<'_>) -> Self {
        let mut next = self;
        let mut set = |fc: Option<bool>, or: Option<bool>| (next.fc, next.or) = (fc, or);
        let (yes, no) = (Some(true), Some(false));
        match op {
            Op::Scan { logic: Logic::And, .. } => set(yes, self.or),
            Op::Scan { .. } | Op::EdgePositive(_) | Op::EdgeNegative(_) | Op::Compare(..) => set(yes, no),
            Op::Close => set(yes, None),
            Op::OrBranch => set(None, None),
            Op::Open { .. } | Op::Assign(_) | Op::Set(_) | Op::Reset(_) | Op::SetRlo | Op::ClearRlo | Op::EndIf => {
                set(no, no);
            }
            Op::Jump(
                Jump::IfRlo | Jump::IfNotRlo | Jump::IfRloSaveBr | Jump::IfNotRloSaveBr | Jump::IfBr | Jump::IfNotBr,
                _,
            ) => set(no, no),
            Op::ResetTimer(_) | Op::CountUp(_) | Op::CountDown(_) | Op::ResetCounter(_) => set(no, no),
            // A call that cannot be made leaves the chain as it is.
            Op::Call(_) => set(self.fc.filter(|fc| !fc), self.or.filter(|or| !or)),
            _ => {}
        }
        match env.how(op) {
            How::Plain | How::Call => {}
            How::Checked => next = next.meet(self),
            How::Step => (next.fc, next.or) = (None, None),
        }
        opened(op, env, &mut next);
        next
    }
}

/// The data block registers after `op`.
fn opened(op: &Op, env: &Env<'_>, facts: &mut Facts) {
    let mut place = |p: &Place| match p {
        // Opened before anything can fail, when it is loaded.
        Place::InDb(n, _) => facts.db = place::data(env.plan, *n).map(|_| *n),
        Place::InDi(n, _) => facts.di = place::data(env.plan, *n).map(|_| *n),
        _ => {}
    };
    // A data block that an actual parameter opens is open only for the call.
    if !matches!(op, Op::Call(_)) {
        op.places(&mut |p, _| place(&p));
    }
    match op {
        // It holds the instance; after a call that could not be made it holds what it held before.
        Op::Call(_) if opens_instance(op) => facts.db = None,
        Op::OpenDb(register, n) => {
            let known = match n {
                Number::Fixed(n) if env.how(op) == How::Plain => Some(*n),
                _ => None,
            };
            *(if *register == DbRegister::Db { &mut facts.db } else { &mut facts.di }) = known;
        }
        Op::ExchangeDbs => std::mem::swap(&mut facts.db, &mut facts.di),
        _ => {}
    }
}

/// True for a call of a function block with its instance: afterwards the DB register holds the instance's data block.
pub(crate) fn opens_instance(op: &Op) -> bool {
    matches!(op, Op::Call(call) if call.instance.is_some() || matches!(call.target, Target::Local(..)))
}

/// What is known before each statement a jump leads to; `None` where no path leads.
pub(crate) fn facts(stmts: &[Stmt], entry: Facts, marks: &[bool], env: &Env<'_>) -> Vec<Option<Facts>> {
    let mut at: Vec<Option<Facts>> = vec![None; stmts.len() + 1];
    at[0] = Some(entry);
    let mut again = true;
    while again {
        again = false;
        let mut now = at[0];
        for (i, stmt) in stmts.iter().enumerate() {
            if marks[i] || i == 0 {
                now = match (at[i], now.filter(|_| i > 0)) {
                    (Some(a), Some(b)) => Some(a.meet(b)),
                    (a, b) => a.or(b),
                };
                again |= at[i] != now;
                at[i] = now;
            }
            let Some(before) = now else { continue };
            let behind = before.behind(&stmt.op, env);
            let mut falls = false;
            successors(&stmt.op, i, &mut |next| {
                if next == i + 1 {
                    falls = true;
                }
                if marks[next] {
                    let met = at[next].map_or(behind, |known| known.meet(behind));
                    again |= at[next] != Some(met);
                    at[next] = Some(met);
                }
            });
            now = falls.then_some(behind);
        }
        let end = stmts.len();
        if let Some(now) = now {
            let met = at[end].map_or(now, |known| known.meet(now));
            at[end] = Some(met);
        }
    }
    at
}

/// The block's statements open or exchange a data block: it cannot become part of its caller.
pub(crate) fn opens_data(op: &Op) -> bool {
    let mut found = matches!(op, Op::OpenDb(..) | Op::ExchangeDbs);
    op.places(&mut |place, _| found |= matches!(place, Place::InDb(..) | Place::InDi(..)));
    found
}
