//! The intermediate code is not trusted: whatever the engine relies on is checked before anything is lowered.

use ob1_ir::{Arg, BitTest, CodeBlock, Number, Op, Place, Pointer};
use ob1_model::{Area, BitAddr, BlockKind, Layout, Section, Site};

use super::resolve::width_bits;
use crate::LoadError;

/// Most brackets open at once.
const NESTING: i32 = 7;
/// Most master control relay brackets open at once.
const MCR_NESTING: i32 = 8;
/// Most local data a block may have.
const LOCAL: u32 = 65_536;

/// Calls `f` with each memory operand of a statement and its width in bits; arguments of calls too.
pub(crate) fn places(op: &Op, f: &mut dyn FnMut(Place, u32)) {
    match op {
        Op::Scan { test: BitTest::Bit(place), .. }
        | Op::Assign(place)
        | Op::Set(place)
        | Op::Reset(place)
        | Op::EdgePositive(place)
        | Op::EdgeNegative(place) => f(*place, 1),
        Op::Load(operand) | Op::Transfer(operand) | Op::LoadArFrom(_, operand) | Op::TransferArTo(_, operand) => {
            f(operand.place, u32::from(width_bits(operand.width)));
        }
        Op::Call(call) => {
            for arg in &call.args {
                if let Arg::Operand(operand) = arg {
                    f(operand.place, u32::from(width_bits(operand.width)));
                }
            }
        }
        Op::LoadParamPointer { at: Some(at), .. } => f(Place::Fixed(Area::Local, *at), 48),
        Op::LoadParamCopy { index, bytes, at } => {
            f(Place::Param { index: *index, at: BitAddr(0) }, 8);
            f(Place::Fixed(Area::Local, *at), u32::from(*bytes) * 8);
        }
        _ => {}
    }
}

/// Calls `f` with each number operand.
fn numbers(op: &Op, f: &mut dyn FnMut(Number)) {
    match op {
        Op::Scan { test: BitTest::Timer(n) | BitTest::Counter(n), .. }
        | Op::LoadTimer(n)
        | Op::LoadTimerBcd(n)
        | Op::LoadCounter(n)
        | Op::LoadCounterBcd(n)
        | Op::OpenDb(_, n)
        | Op::StartTimer(_, n)
        | Op::ResetTimer(n)
        | Op::EnableTimer(n)
        | Op::CountUp(n)
        | Op::CountDown(n)
        | Op::SetCounter(n)
        | Op::ResetCounter(n)
        | Op::EnableCounter(n) => f(*n),
        Op::Call(call) => {
            if let ob1_ir::Target::Indirect(_, n) = call.target {
                f(n);
            }
            if let Some(n) = call.instance {
                f(n);
            }
            for arg in &call.args {
                if let Arg::Number(n) = arg {
                    f(*n);
                }
            }
        }
        _ => {}
    }
}

/// Places a statement writes.
fn written(op: &Op, f: &mut dyn FnMut(Place)) {
    match op {
        Op::Assign(place) | Op::Set(place) | Op::Reset(place) | Op::EdgePositive(place) | Op::EdgeNegative(place) => {
            f(*place);
        }
        Op::Transfer(operand) | Op::TransferArTo(_, operand) => f(operand.place),
        // What has its pointer may write it.
        Op::LoadParamPointer { index, .. } => f(Place::Param { index: *index, at: BitAddr(0) }),
        // Passed on: the called block may write it.
        Op::Call(_) => places(op, &mut |place, _| f(place)),
        _ => {}
    }
}

/// True when the block may write its formal `index`.
pub(crate) fn writes_param(block: &CodeBlock, index: usize) -> bool {
    let mut found = false;
    for stmt in &block.code {
        written(&stmt.op, &mut |place| {
            found |= matches!(place, Place::Param { index: i, .. } if usize::from(i) == index);
        });
    }
    found
}

/// Everything a block's code must keep to.
pub(crate) fn verify(block: &CodeBlock, errors: &mut Vec<LoadError>) {
    let formals: Vec<_> = block.interface.formals().collect();
    let is_fc = matches!(block.id.kind, BlockKind::Fc | BlockKind::Sfc);
    let (mut brackets, mut mcr) = (0, 0);
    let count = block.code.len();
    for stmt in &block.code {
        let site = Site { block: block.id, network: stmt.network, line: stmt.line };
        let mut complain = |reason: String| errors.push(LoadError::Code { site, reason });
        let mut target = |at: u32| {
            if at as usize > count {
                complain(format!("jump to statement {at} of {count}"));
            }
        };
        match &stmt.op {
            Op::Jump(_, at) | Op::Loop(at) => target(*at),
            Op::JumpList { targets, otherwise } => {
                targets.iter().chain([otherwise]).for_each(|at| target(*at));
            }
            _ => {}
        }
        match stmt.op {
            Op::Open { .. } => brackets += 1,
            Op::Close => brackets -= 1,
            Op::McrOpen => mcr += 1,
            Op::McrClose => mcr -= 1,
            _ => {}
        }
        if !(0..=NESTING).contains(&brackets) {
            complain(format!("more than {NESTING} brackets open, or one closed that is not"));
            brackets = brackets.clamp(0, NESTING);
        }
        if !(0..=MCR_NESTING).contains(&mcr) {
            complain(format!("more than {MCR_NESTING} MCR brackets open, or one closed that is not"));
            mcr = mcr.clamp(0, MCR_NESTING);
        }
        let is_call = matches!(stmt.op, Op::Call(_));
        places(&stmt.op, &mut |place, bits| match place {
            Place::Param { index, at } => match formals.get(usize::from(index)).filter(|_| is_fc) {
                None => complain(format!("no parameter {index} by reference")),
                Some(p) if p.ty.is_parameter_type() => complain(format!("{} is a number, not a place", p.name)),
                // The called block's formal decides how much a call takes.
                Some(p) if !is_call && at.0.saturating_add(bits) > Layout::bits(&p.ty).max(8) => {
                    complain(format!("{} has no bit {at} with {bits} more", p.name));
                }
                Some(_) => {}
            },
            Place::Fixed(Area::Local, at) if at.byte().saturating_add(4) > LOCAL => {
                complain(format!("L {at} is beyond {LOCAL} bytes of local data"));
            }
            Place::Memory(_, pointer) => pointer_place(pointer, &mut complain),
            _ => {}
        });
        if let Op::LoadParamCopy { index, bytes, .. } = &stmt.op {
            let formal = formals.get(usize::from(*index)).filter(|_| is_fc);
            if formal.is_none_or(|p| p.ty.is_parameter_type() || Layout::bits(&p.ty) != u32::from(*bytes) * 8) {
                complain(format!("parameter {index} has not {bytes} bytes to be copied"));
            }
        }
        if let Op::LoadParamPointer { index, at } = &stmt.op {
            match formals.get(usize::from(*index)).filter(|_| is_fc) {
                None => complain(format!("no parameter {index} by reference")),
                Some(p) if p.ty.is_composed() != at.is_some() => {
                    complain(format!("the pointer to {} is of the other kind", p.name));
                }
                Some(_) => {}
            }
        }
        numbers(&stmt.op, &mut |n| match n {
            Number::Param(index) => {
                if !is_fc || formals.get(usize::from(index)).is_none_or(|p| !p.ty.is_parameter_type()) {
                    complain(format!("parameter {index} is no number"));
                }
            }
            Number::Memory(pointer) => pointer_place(pointer, &mut complain),
            Number::Fixed(_) | Number::Instance(_) => {}
        });
    }
    if block.interface.temp_bytes > LOCAL {
        let site = Site { block: block.id, network: 0, line: 0 };
        errors.push(LoadError::Code { site, reason: format!("more than {LOCAL} bytes of local data") });
    }
    if block.id.kind.has_instance() {
        let site = Site { block: block.id, network: 0, line: 0 };
        for p in block.interface.params.iter().filter(|p| p.section != Section::Temp) {
            let BitAddr(at) = p.at;
            if u64::from(at) + u64::from(p.passed_bits(true)) > u64::from(block.interface.instance_bytes) * 8 {
                errors.push(LoadError::Code { site, reason: format!("{} lies outside the instance data", p.name) });
            }
        }
    }
}

fn pointer_place(pointer: Pointer, complain: &mut dyn FnMut(String)) {
    if !matches!(pointer.area, Area::Memory | Area::Local | Area::Db | Area::Di) {
        complain(format!("a pointer in area {}", pointer.area.name()));
    }
}
