//! The verifier: what every engine may rely on without checking again.
//!
//! A program that passes has jump targets within their blocks or right after them (which ends the block), brackets that
//! are closed and not nested too deep, parameters that exist and are of the kind they are used as, local data and
//! instance operands within their sizes, whole-byte addresses where bytes and words are accessed, and calls with one
//! argument for each formal of a block that exists.
//!
//! It is the only verifier: a CPU takes only a [`Verified`] program, whatever has made it (STL, machine code that
//! came over a network, a test).

use std::borrow::Borrow;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::Deref;

use ob1_model::{Area, BitAddr, BlockId, Interface, Layout, Param, Section, Width};

use crate::{Arg, Call, CallMode, CodeBlock, DataKind, Number, Op, Place, Program, Target};

/// Most brackets open at once.
pub const BRACKETS: u32 = 7;
/// Most brackets of the master control relay open at once.
pub const MCR_BRACKETS: u32 = 8;
/// Most bytes of local data of a block.
pub const LOCAL_BYTES: u32 = 65_536;

/// A program, owned or borrowed, that has passed [`verify`].
#[derive(Clone, Copy, Debug)]
pub struct Verified<T>(T);

impl<T: Borrow<Program>> Deref for Verified<T> {
    type Target = Program;

    fn deref(&self) -> &Program {
        self.0.borrow()
    }
}

/// What is wrong with a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Defect {
    /// Two blocks have this name.
    DuplicateBlock(BlockId),
    /// Two data blocks have this number, or it is 0.
    DataNumber(u16),
    /// An instance data block that is shorter than its function block's instance, or whose function block is missing. A
    /// longer one is not a defect: it may have been made for an older interface.
    InstanceLength(u16),
    /// The index of the source file is beyond [`Program::sources`].
    Source(BlockId),
    /// A jump to a statement the block does not have.
    JumpTarget(u32),
    /// A parameter index the block does not have.
    ParamIndex(u16),
    /// A parameter reference in a block with an instance, or the other way round.
    ParamKind,
    /// The number of a timer, counter or block used as a place, or the other way round.
    ParamType(u16),
    /// Beyond the end of a parameter.
    ParamOverflow(u16, BitAddr),
    /// The pointer to a composed parameter without a place for its POINTER, or the other way round.
    ParamPointer(u16),
    /// A copy of a parameter that is not as long as said.
    ParamCopy(u16),
    /// More brackets open than [`BRACKETS`], or one closed that is not open.
    Brackets,
    /// The same for the master control relay and [`MCR_BRACKETS`].
    McrBrackets,
    /// More local data than [`LOCAL_BYTES`].
    LocalBytes(u32),
    /// A variable that does not lie within the instance: its index among the declarations.
    Declaration(usize),
    /// Local data beyond `temp_bytes`.
    TempOverflow(BitAddr),
    /// An instance operand beyond `instance_bytes`.
    InstanceOverflow(BitAddr),
    /// A byte, word or double word at an address within a byte.
    Alignment(BitAddr),
    /// A pointer in an area that holds none.
    PointerArea(Area),
    /// The block called is neither in the program nor outside it.
    UnknownBlock(BlockId),
    /// A call with this number of arguments for that number of formals.
    ArgCount(usize, usize),
    /// An argument left open where the callee has no memory of its own.
    OpenArg(usize),
    /// A pointer of a raw list in a `CALL`, or another argument in the list of a `UC` or `CC`.
    RawArg(usize),
    /// An instance data block is missing or too much.
    Instance,
}

impl fmt::Display for Defect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Defect::DuplicateBlock(id) => write!(f, "{id} occurs twice"),
            Defect::DataNumber(n) => write!(f, "DB {n} occurs twice, or has no number"),
            Defect::InstanceLength(n) => write!(f, "DB {n} does not fit its function block"),
            Defect::Source(id) => write!(f, "{id} is of a source that is not there"),
            Defect::JumpTarget(to) => write!(f, "jump to statement {to}, which is not there"),
            Defect::ParamIndex(index) => write!(f, "parameter {index} is not there"),
            Defect::ParamKind => f.write_str("a parameter reference in a block of the other kind"),
            Defect::ParamType(index) => write!(f, "parameter {index} is a number where a place is needed, or a place"),
            Defect::ParamOverflow(index, at) => write!(f, "bit {at} lies beyond parameter {index}"),
            Defect::ParamPointer(index) => write!(f, "the pointer to parameter {index} is of the other kind"),
            Defect::ParamCopy(index) => write!(f, "parameter {index} is not as long as its copy"),
            Defect::Brackets => write!(f, "more than {BRACKETS} brackets open, or one closed that is not open"),
            Defect::McrBrackets => {
                write!(f, "more than {MCR_BRACKETS} MCR brackets open, or one closed that is not open")
            }
            Defect::LocalBytes(bytes) => write!(f, "{bytes} bytes of local data, at most {LOCAL_BYTES}"),
            Defect::Declaration(index) => write!(f, "declaration {index} lies outside the instance"),
            Defect::TempOverflow(at) => write!(f, "local data {at} lies beyond the declared"),
            Defect::InstanceOverflow(at) => write!(f, "instance data {at} lies beyond the instance"),
            Defect::Alignment(at) => write!(f, "address {at} is within a byte"),
            Defect::PointerArea(area) => write!(f, "a pointer cannot lie in area {}", area.name()),
            Defect::UnknownBlock(id) => write!(f, "{id} is not there"),
            Defect::ArgCount(given, formals) => write!(f, "{given} arguments for {formals} parameters"),
            Defect::OpenArg(index) => write!(f, "argument {index} is left open"),
            Defect::RawArg(index) => write!(f, "argument {index} is of the other kind of call"),
            Defect::Instance => f.write_str("the instance data block is missing or too much"),
        }
    }
}

/// A defect with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The block, for defects within one.
    pub block: Option<BlockId>,
    /// Index of the statement; `None`: the block as a whole.
    pub statement: Option<u32>,
    /// What is wrong there.
    pub defect: Defect,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(block) = self.block {
            write!(f, "{block}, ")?;
        }
        if let Some(statement) = self.statement {
            write!(f, "statement {statement}: ")?;
        }
        write!(f, "{}", self.defect)
    }
}

/// Checks a program; `external` gives the interfaces of blocks that come from elsewhere (library, plugins).
///
/// # Errors
/// Every defect found, in program order.
pub fn verify<'e, T: Borrow<Program>>(
    program: T,
    external: &dyn Fn(BlockId) -> Option<&'e Interface>,
) -> Result<Verified<T>, Vec<Finding>> {
    let findings = findings(program.borrow(), external);
    if findings.is_empty() { Ok(Verified(program)) } else { Err(findings) }
}

fn findings<'e>(program: &Program, external: &dyn Fn(BlockId) -> Option<&'e Interface>) -> Vec<Finding> {
    let own: BTreeMap<BlockId, &Interface> = program.blocks.iter().map(|b| (b.id, &b.interface)).collect();
    let interface = |id: BlockId| own.get(&id).copied().or_else(|| external(id));
    let mut findings = Vec::new();
    let mut ids = BTreeSet::new();
    for block in &program.blocks {
        let mut at_block = |defect| findings.push(Finding { block: Some(block.id), statement: None, defect });
        if !ids.insert(block.id) {
            at_block(Defect::DuplicateBlock(block.id));
        }
        if block.source as usize >= program.sources.len() {
            at_block(Defect::Source(block.id));
        }
        check_interface(block, &mut at_block);
        check_code(block, &interface, &mut findings);
    }
    let mut numbers = BTreeSet::new();
    for data in &program.data {
        let mut at_data = |defect| findings.push(Finding { block: None, statement: None, defect });
        if data.number == 0 || !numbers.insert(data.number) {
            at_data(Defect::DataNumber(data.number));
        }
        if let DataKind::Instance(fb) = data.kind
            && interface(fb).is_none_or(|i| i.instance_bytes as usize > data.bytes.len())
        {
            at_data(Defect::InstanceLength(data.number));
        }
    }
    findings
}

fn check_interface(block: &CodeBlock, report: &mut dyn FnMut(Defect)) {
    let Interface { params, instance_bytes, temp_bytes } = &block.interface;
    if *temp_bytes > LOCAL_BYTES {
        report(Defect::LocalBytes(*temp_bytes));
    }
    if !block.id.kind.has_instance() {
        return;
    }
    for (index, param) in params.iter().enumerate().filter(|(_, param)| param.section != Section::Temp) {
        if u64::from(param.at.0) + u64::from(param.passed_bits(true)) > u64::from(*instance_bytes) * 8 {
            report(Defect::Declaration(index));
        }
    }
}

fn check_code<'p>(
    block: &CodeBlock,
    interface: &dyn Fn(BlockId) -> Option<&'p Interface>,
    findings: &mut Vec<Finding>,
) {
    let len = block.code.len();
    let formals: Vec<&Param> = block.interface.formals().collect();
    let (mut brackets, mut mcr) = (0, 0);
    for (index, stmt) in (0u32..).zip(&block.code) {
        let mut report = |defect| findings.push(Finding { block: Some(block.id), statement: Some(index), defect });
        let mut target = |to: u32| {
            if to as usize > len {
                report(Defect::JumpTarget(to));
            }
        };
        match &stmt.op {
            Op::Jump(_, to) | Op::Loop(to) => target(*to),
            Op::JumpList { targets, otherwise } => {
                targets.iter().for_each(|to| target(*to));
                target(*otherwise);
            }
            Op::Call(call) => check_call(call, interface, &mut report),
            Op::Open { .. } | Op::Close if !count(&mut brackets, stmt.op != Op::Close, BRACKETS) => {
                report(Defect::Brackets);
            }
            Op::McrOpen | Op::McrClose if !count(&mut mcr, stmt.op == Op::McrOpen, MCR_BRACKETS) => {
                report(Defect::McrBrackets);
            }
            _ => {}
        }
        // The called block's formal decides how much of an operand a call takes; pointers have rules of their own.
        let whole = matches!(stmt.op, Op::Call(_) | Op::LoadParamPointer { .. } | Op::LoadParamCopy { .. });
        stmt.op.places(&mut |place, width| {
            if let Err(defect) = check_place(block, &formals, place, width, whole) {
                report(defect);
            }
        });
        if let Err(defect) = check_pointer(&stmt.op, &formals) {
            report(defect);
        }
        stmt.op.numbers(&mut |number| {
            if let Err(defect) = check_number(block, &formals, *number) {
                report(defect);
            }
        });
    }
}

/// One bracket more or less; false when there are too many, or none to close.
fn count(open: &mut u32, opens: bool, most: u32) -> bool {
    let (changed, fits) = if opens { (*open + 1, *open < most) } else { (open.saturating_sub(1), *open > 0) };
    *open = changed.min(most);
    fits
}

/// The pointer to a parameter, and its copy. Whether the parameter exists is checked at its place.
fn check_pointer(op: &Op, formals: &[&Param]) -> Result<(), Defect> {
    let (index, defect) = match op {
        Op::LoadParamPointer { index, .. } => (*index, Defect::ParamPointer(*index)),
        Op::LoadParamCopy { index, .. } => (*index, Defect::ParamCopy(*index)),
        _ => return Ok(()),
    };
    let Some(Param { ty, .. }) = formals.get(usize::from(index)) else { return Ok(()) };
    let fits = match op {
        Op::LoadParamPointer { at, .. } => ty.is_composed() == at.is_some(),
        Op::LoadParamCopy { bytes, .. } => !ty.is_parameter_type() && Layout::bits(ty) == u32::from(*bytes) * 8,
        _ => true,
    };
    if fits { Ok(()) } else { Err(defect) }
}

/// `whole`: the place does not say how much of a parameter is meant.
fn check_place(block: &CodeBlock, formals: &[&Param], place: Place, width: Width, whole: bool) -> Result<(), Defect> {
    let has_instance = block.id.kind.has_instance();
    let beyond = |at: BitAddr, bytes: u32| at.byte().saturating_add(width.bytes()) > bytes;
    let at = match place {
        Place::Fixed(Area::Local, at) if beyond(at, block.interface.temp_bytes) => {
            return Err(Defect::TempOverflow(at));
        }
        Place::Instance(_) if !has_instance => return Err(Defect::ParamKind),
        Place::Instance(at) if beyond(at, block.interface.instance_bytes) => {
            return Err(Defect::InstanceOverflow(at));
        }
        Place::Param { .. } if !block.id.kind.is_function() => return Err(Defect::ParamKind),
        Place::Param { index, at } => {
            let param = formals.get(usize::from(index)).ok_or(Defect::ParamIndex(index))?;
            if param.ty.is_parameter_type() && !whole {
                return Err(Defect::ParamType(index));
            }
            let bits = u32::from(width.bits());
            if !whole && at.0.saturating_add(bits) > Layout::bits(&param.ty).max(8) {
                return Err(Defect::ParamOverflow(index, at));
            }
            at
        }
        Place::Memory(_, pointer) => {
            if !matches!(pointer.area, Area::Memory | Area::Local | Area::Db | Area::Di) {
                return Err(Defect::PointerArea(pointer.area));
            }
            return Ok(());
        }
        // The bit part of a register-indirect address adds to that of the register.
        Place::Register(..) => return Ok(()),
        Place::Fixed(_, at) | Place::InDb(_, at) | Place::InDi(_, at) | Place::Instance(at) => at,
    };
    if width != Width::Bit && at.bit() != 0 { Err(Defect::Alignment(at)) } else { Ok(()) }
}

fn check_number(block: &CodeBlock, formals: &[&Param], number: Number) -> Result<(), Defect> {
    match number {
        Number::Param(_) if !block.id.kind.is_function() => Err(Defect::ParamKind),
        Number::Param(index) => {
            let param = formals.get(usize::from(index)).ok_or(Defect::ParamIndex(index))?;
            if param.ty.is_parameter_type() { Ok(()) } else { Err(Defect::ParamType(index)) }
        }
        Number::Instance(_) if !block.id.kind.has_instance() => Err(Defect::ParamKind),
        Number::Memory(pointer) if !matches!(pointer.area, Area::Memory | Area::Local | Area::Db | Area::Di) => {
            Err(Defect::PointerArea(pointer.area))
        }
        _ => Ok(()),
    }
}

fn check_call<'p>(call: &Call, interface: &dyn Fn(BlockId) -> Option<&'p Interface>, report: &mut dyn FnMut(Defect)) {
    let with_parameters = call.mode == CallMode::Call;
    if let Some(index) = call.args.iter().position(|a| matches!(a, Arg::Raw(_)) == with_parameters) {
        report(Defect::RawArg(index));
    }
    let (id, local) = match call.target {
        Target::Block(id) => (id, false),
        Target::Local(id, _) => (id, true),
        Target::Indirect(kind, _) => {
            if !call.args.is_empty() && (with_parameters || kind.has_instance()) {
                report(Defect::ArgCount(call.args.len(), 0));
            }
            return;
        }
    };
    let Some(callee) = interface(id) else {
        report(Defect::UnknownBlock(id));
        return;
    };
    let runs_on_instance = with_parameters && id.kind.has_instance();
    let sound = if call.instance.is_some() { runs_on_instance } else { local || !runs_on_instance };
    if !sound {
        report(Defect::Instance);
    }
    // A list of pointers may have any length.
    let listed = !with_parameters && !id.kind.has_instance();
    let formals = if with_parameters { callee.formals().count() } else { 0 };
    if call.args.len() != formals && !listed {
        report(Defect::ArgCount(call.args.len(), formals));
    }
    if !id.kind.has_instance()
        && with_parameters
        && let Some(index) = call.args.iter().position(|a| *a == Arg::Open)
    {
        report(Defect::OpenArg(index));
    }
}

#[cfg(test)]
mod tests {
    use ob1_model::{BlockKind, DataType, Param, Section};

    use super::*;
    use crate::{DataBlock, Jump, Operand, Stmt};

    const FC1: BlockId = BlockId::new(BlockKind::Fc, 1);
    const FB1: BlockId = BlockId::new(BlockKind::Fb, 1);

    fn block(id: BlockId, ops: Vec<Op>) -> CodeBlock {
        let params =
            vec![Param::new("x", Section::Input, DataType::Int), Param::new("t", Section::Temp, DataType::Word)];
        let mut interface = Interface { params, ..Interface::default() };
        interface.lay_out(id.kind.has_instance());
        let code = ops.into_iter().map(|op| Stmt { op, network: 1, line: 1 }).collect();
        CodeBlock { id, name: None, interface, code, source: 0 }
    }

    fn defects(blocks: Vec<CodeBlock>, data: Vec<DataBlock>) -> Vec<Defect> {
        let program = Program { blocks, data, symbols: Vec::new(), sources: vec!["a".into()] };
        verify(program, &|_| None).err().unwrap_or_default().into_iter().map(|f| f.defect).collect()
    }

    fn load(place: Place, width: Width) -> Op {
        Op::Load(Operand { width, place })
    }

    fn call(id: BlockId, args: Vec<Arg>, instance: Option<Number>) -> Op {
        Op::Call(Box::new(Call { mode: CallMode::Call, target: Target::Block(id), instance, args }))
    }

    #[test]
    fn a_sound_program_passes() {
        let ops = vec![
            Op::Jump(Jump::Always, 1),
            load(Place::Fixed(Area::Local, BitAddr(0)), Width::Word),
            load(Place::Param { index: 0, at: BitAddr(0) }, Width::Word),
            call(FC1, vec![Arg::Const(1)], None),
            call(FB1, vec![Arg::Open], Some(Number::Fixed(1))),
        ];
        let fb = block(FB1, vec![load(Place::Instance(BitAddr(0)), Width::Word)]);
        let data = DataBlock {
            number: 1,
            name: None,
            kind: DataKind::Instance(FB1),
            bytes: vec![0; 2],
            components: Vec::new(),
            read_only: false,
            non_retain: false,
        };
        assert_eq!(defects(vec![block(FC1, ops), fb], vec![data]), []);
    }

    #[test]
    fn each_defect_is_found() {
        let one = |op| defects(vec![block(FC1, vec![op])], Vec::new());
        let at = BitAddr::new(1, 0);
        // Right after the last statement is the block's end.
        assert_eq!(one(Op::Jump(Jump::IfRlo, 1)), []);
        assert_eq!(one(Op::Jump(Jump::IfRlo, 2)), [Defect::JumpTarget(2)]);
        assert_eq!(one(Op::Loop(9)), [Defect::JumpTarget(9)]);
        assert_eq!(one(Op::JumpList { targets: Box::new([0, 3]), otherwise: 0 }), [Defect::JumpTarget(3)]);
        let param = |index| Place::Param { index, at: BitAddr(0) };
        assert_eq!(one(load(param(1), Width::Word)), [Defect::ParamIndex(1)]);
        assert_eq!(one(load(Place::Fixed(Area::Local, at), Width::Word)), [Defect::TempOverflow(at)]);
        assert_eq!(one(load(Place::Instance(BitAddr(0)), Width::Word)), [Defect::ParamKind]);
        assert_eq!(one(load(Place::Fixed(Area::Memory, BitAddr(3)), Width::Byte)), [Defect::Alignment(BitAddr(3))]);
        assert_eq!(one(Op::ResetTimer(Number::Param(4))), [Defect::ParamIndex(4)]);
        assert_eq!(one(Op::ResetTimer(Number::Param(0))), [Defect::ParamType(0)]);
        assert_eq!(one(load(param(0), Width::DWord)), [Defect::ParamOverflow(0, BitAddr(0))]);
        assert_eq!(one(Op::Close), [Defect::Brackets]);
        assert_eq!(one(Op::McrClose), [Defect::McrBrackets]);
        let open = Op::Open { logic: crate::Logic::And, negate: false };
        assert_eq!(defects(vec![block(FC1, vec![open; 8])], Vec::new()), [Defect::Brackets]);
        assert_eq!(defects(vec![block(FC1, vec![Op::McrOpen; 9])], Vec::new()), [Defect::McrBrackets]);
        assert_eq!(one(call(FB1, Vec::new(), None)), [Defect::UnknownBlock(FB1)]);
        assert_eq!(one(call(FC1, Vec::new(), None)), [Defect::ArgCount(0, 1)]);
        assert_eq!(one(call(FC1, vec![Arg::Open], None)), [Defect::OpenArg(0)]);
        assert_eq!(one(call(FC1, vec![Arg::Const(0)], Some(Number::Fixed(1)))), [Defect::Instance]);
        let within = |id| {
            let (target, instance) = (Target::Local(id, BitAddr(0)), Some(Number::Fixed(1)));
            Op::Call(Box::new(Call { mode: CallMode::Call, target, instance, args: vec![Arg::Const(0)] }))
        };
        assert_eq!(one(within(FC1)), [Defect::Instance]);
        assert_eq!(defects(vec![block(FC1, vec![within(FB1)]), block(FB1, Vec::new())], Vec::new()), []);
        let mode = CallMode::Unconditional;
        let uc =
            |id, arg| Op::Call(Box::new(Call { mode, target: Target::Block(id), instance: None, args: vec![arg] }));
        assert_eq!(one(uc(FC1, Arg::Raw(0x8300_0008))), []);
        assert_eq!(one(uc(FC1, Arg::Const(1))), [Defect::RawArg(0)]);
        assert_eq!(one(call(FC1, vec![Arg::Raw(0)], None)), [Defect::RawArg(0)]);
        assert_eq!(
            defects(vec![block(FC1, vec![uc(FB1, Arg::Raw(0))]), block(FB1, Vec::new())], Vec::new()),
            [Defect::ArgCount(1, 0)]
        );
        assert_eq!(one(Op::LoadParamPointer { index: 3, at: None }), [Defect::ParamIndex(3)]);
        let twice = vec![block(FC1, Vec::new()), block(FC1, Vec::new())];
        assert_eq!(defects(twice, Vec::new()), [Defect::DuplicateBlock(FC1)]);
    }

    #[test]
    fn instances_fit_their_function_block() {
        let fb = || block(FB1, vec![load(Place::Instance(BitAddr::new(2, 0)), Width::Byte)]);
        assert_eq!(defects(vec![fb()], Vec::new()), [Defect::InstanceOverflow(BitAddr::new(2, 0))]);
        let data = DataBlock {
            number: 5,
            name: None,
            kind: DataKind::Instance(FB1),
            bytes: Vec::new(),
            components: Vec::new(),
            read_only: false,
            non_retain: false,
        };
        assert_eq!(defects(vec![block(FB1, Vec::new())], vec![data]), [Defect::InstanceLength(5)]);
    }
}
