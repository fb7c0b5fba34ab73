//! The verifier: what every engine may rely on without looking again.
//!
//! A program that passes has jump targets within their blocks, parameter indices within the interface, local data and
//! instance operands within their sizes, whole-byte addresses where bytes and words are accessed, and calls with one
//! argument for each formal of a block that exists.

use std::collections::BTreeSet;
use std::fmt;

use ob1_model::{Area, BitAddr, BlockId, Interface};

use crate::{Arg, Call, CallMode, CodeBlock, DataKind, Number, Op, Place, Program, Target, Width};

/// What is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Defect {
    /// Two blocks have this name.
    DuplicateBlock(BlockId),
    /// Two data blocks have this number, or it is 0.
    DataNumber(u16),
    /// An instance data block that is not as long as its function block's instance, or whose function block is missing.
    InstanceLength(u16),
    /// The index of the source file is beyond [`Program::sources`].
    Source(BlockId),
    /// A jump to a statement the block does not have.
    JumpTarget(u32),
    /// A parameter index the block does not have.
    ParamIndex(u16),
    /// A parameter reference in a block with an instance, or the other way round.
    ParamKind,
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
            Defect::DuplicateBlock(id) => write!(f, "{id} is there twice"),
            Defect::DataNumber(n) => write!(f, "DB {n} is there twice, or has no number"),
            Defect::InstanceLength(n) => write!(f, "DB {n} does not fit its function block"),
            Defect::Source(id) => write!(f, "{id} is of a source that is not there"),
            Defect::JumpTarget(to) => write!(f, "jump to statement {to}, which is not there"),
            Defect::ParamIndex(index) => write!(f, "parameter {index} is not there"),
            Defect::ParamKind => f.write_str("a parameter reference in a block of the other kind"),
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
    /// The statement's index.
    pub statement: Option<u32>,
    /// What is wrong.
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
pub fn verify<'p>(
    program: &'p Program,
    external: &dyn Fn(BlockId) -> Option<&'p Interface>,
) -> Result<(), Vec<Finding>> {
    let own: std::collections::BTreeMap<BlockId, &Interface> =
        program.blocks.iter().map(|b| (b.id, &b.interface)).collect();
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
        check_code(block, &interface, &mut findings);
    }
    let mut numbers = BTreeSet::new();
    for data in &program.data {
        let mut at_data = |defect| findings.push(Finding { block: None, statement: None, defect });
        if data.number == 0 || !numbers.insert(data.number) {
            at_data(Defect::DataNumber(data.number));
        }
        if let DataKind::Instance(fb) = data.kind
            && interface(fb).is_none_or(|i| i.instance_bytes as usize != data.bytes.len())
        {
            at_data(Defect::InstanceLength(data.number));
        }
    }
    if findings.is_empty() { Ok(()) } else { Err(findings) }
}

fn check_code<'p>(
    block: &'p CodeBlock,
    interface: &dyn Fn(BlockId) -> Option<&'p Interface>,
    findings: &mut Vec<Finding>,
) {
    let len = block.code.len();
    let formals = block.interface.formals().count();
    for (index, stmt) in (0u32..).zip(&block.code) {
        let mut report = |defect| findings.push(Finding { block: Some(block.id), statement: Some(index), defect });
        let mut target = |to: u32| {
            if to as usize >= len {
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
            _ => {}
        }
        stmt.op.places(&mut |place, width| {
            if let Err(defect) = check_place(block, formals, place, width) {
                report(defect);
            }
        });
        stmt.op.numbers(&mut |number| {
            if let Err(defect) = check_number(block, formals, *number) {
                report(defect);
            }
        });
    }
}

fn check_place(block: &CodeBlock, formals: usize, place: Place, width: Width) -> Result<(), Defect> {
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
        Place::Param { .. } if has_instance => return Err(Defect::ParamKind),
        Place::Param { index, .. } if usize::from(index) >= formals => return Err(Defect::ParamIndex(index)),
        Place::Memory(_, pointer) => {
            if !matches!(pointer.area, Area::Memory | Area::Local | Area::Db | Area::Di) {
                return Err(Defect::PointerArea(pointer.area));
            }
            return Ok(());
        }
        // The bit part of a register-indirect address adds to that of the register.
        Place::Register(..) => return Ok(()),
        Place::Fixed(_, at)
        | Place::InDb(_, at)
        | Place::InDi(_, at)
        | Place::Instance(at)
        | Place::Param { at, .. } => at,
    };
    if width != Width::Bit && at.bit() != 0 { Err(Defect::Alignment(at)) } else { Ok(()) }
}

fn check_number(block: &CodeBlock, formals: usize, number: Number) -> Result<(), Defect> {
    match number {
        Number::Param(_) | Number::Instance(_)
            if block.id.kind.has_instance() != matches!(number, Number::Instance(_)) =>
        {
            Err(Defect::ParamKind)
        }
        Number::Param(index) if usize::from(index) >= formals => Err(Defect::ParamIndex(index)),
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
    let needs_instance = with_parameters && id.kind.has_instance() && !local;
    if call.instance.is_some() != needs_instance {
        report(Defect::Instance);
    }
    // A list of pointers is as long as it is.
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
        verify(&program, &|_| None).err().unwrap_or_default().into_iter().map(|f| f.defect).collect()
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
        };
        assert_eq!(defects(vec![block(FC1, ops), fb], vec![data]), []);
    }

    #[test]
    fn each_defect_is_found() {
        let one = |op| defects(vec![block(FC1, vec![op])], Vec::new());
        let at = BitAddr::new(1, 0);
        assert_eq!(one(Op::Jump(Jump::IfRlo, 1)), [Defect::JumpTarget(1)]);
        assert_eq!(one(Op::Loop(9)), [Defect::JumpTarget(9)]);
        assert_eq!(one(Op::JumpList { targets: Box::new([0, 3]), otherwise: 0 }), [Defect::JumpTarget(3)]);
        let param = |index| Place::Param { index, at: BitAddr(0) };
        assert_eq!(one(load(param(1), Width::Word)), [Defect::ParamIndex(1)]);
        assert_eq!(one(load(Place::Fixed(Area::Local, at), Width::Word)), [Defect::TempOverflow(at)]);
        assert_eq!(one(load(Place::Instance(BitAddr(0)), Width::Word)), [Defect::ParamKind]);
        assert_eq!(one(load(Place::Fixed(Area::Memory, BitAddr(3)), Width::Byte)), [Defect::Alignment(BitAddr(3))]);
        assert_eq!(one(Op::ResetTimer(Number::Param(4))), [Defect::ParamIndex(4)]);
        assert_eq!(one(call(FB1, Vec::new(), None)), [Defect::UnknownBlock(FB1)]);
        assert_eq!(one(call(FC1, Vec::new(), None)), [Defect::ArgCount(0, 1)]);
        assert_eq!(one(call(FC1, vec![Arg::Open], None)), [Defect::OpenArg(0)]);
        assert_eq!(one(call(FC1, vec![Arg::Const(0)], Some(Number::Fixed(1)))), [Defect::Instance]);
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
        };
        assert_eq!(defects(vec![block(FB1, Vec::new())], vec![data]), [Defect::InstanceLength(5)]);
    }
}
