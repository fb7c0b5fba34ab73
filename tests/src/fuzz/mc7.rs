//! Machine code, block headers and compiled interfaces made from bytes: the verifier checks everything that can be
//! decoded, and printing it gives a text or a reason.

use ob1_ir::{Defect, Program};
use ob1_mc7::{BlockImage, CompiledInterface, MachineBlock, Segments, Written, decode, encode};
use ob1_model::{BlockId, BlockKind, DataType, Field, Interface, Param, Section};
use ob1_stl::Mnemonics;
use ob1_stl::print::{Listing, Printer};

/// The first byte is the kind of the others.
pub fn run(data: &[u8]) {
    let Some((what, rest)) = data.split_first() else { return };
    match what % 4 {
        0 => image(rest),
        kind => code(kind, rest),
    }
}

/// A block as in the CPU; its code is decoded with its own interface.
fn image(bytes: &[u8]) {
    let Ok((image, length)) = BlockImage::read(bytes) else {
        let _ = (CompiledInterface::read(bytes), Segments::read(bytes));
        return;
    };
    assert_eq!(image.bytes().as_deref(), Ok(&bytes[..length]));
    let (Some(kind), Ok(compiled)) = (image.head.block_kind(), CompiledInterface::read(&image.interface)) else {
        return;
    };
    let interface = compiled.interface(kind.has_instance());
    let segments = Segments::read(&image.segments).unwrap_or_default();
    judge(BlockId::new(kind, image.head.number), &interface, &image.code, &segments);
}

fn code(kind: u8, code: &[u8]) {
    let kind = match kind {
        1 => BlockKind::Ob,
        2 => BlockKind::Fc,
        _ => BlockKind::Fb,
    };
    let id = BlockId::new(kind, 1);
    judge(id, &interface(kind.has_instance()), code, &Segments::default());
}

/// Parameters of every kind of type.
fn interface(has_instance: bool) -> Interface {
    use DataType::{Any, BlockDb, Bool, Int, Pointer, Real, Struct, Timer};
    let field = |name: &str, ty| Field { name: name.into(), ty, initial: None };
    let structure = Struct(vec![field("x", Bool), field("w", Int), field("r", Real)]);
    let params = [
        ("x", Section::Input, Bool),
        ("w", Section::Input, Int),
        ("t", Section::Input, Timer),
        ("db", Section::Input, BlockDb),
        ("any", Section::Input, Any),
        ("ptr", Section::Input, Pointer),
        ("o", Section::Output, Real),
        ("s", Section::InOut, structure),
        ("n", Section::Temp, Int),
    ];
    let params = params.into_iter().map(|(name, section, ty)| Param::new(name, section, ty)).collect();
    let mut interface = Interface { params, ..Interface::default() };
    interface.lay_out(has_instance);
    interface
}

fn judge(id: BlockId, own: &Interface, code: &[u8], segments: &Segments) {
    let (function, instance) = (interface(false), interface(true));
    let known = |id: BlockId| Some(if id.kind.has_instance() { &instance } else { &function });
    let block = MachineBlock { id, name: None, interface: own, code, segments, multi_instance: true, local_bytes: 0 };
    let Ok(decoded) = decode(&block, &known) else { return };
    let listing = Listing { notations: decoded.notations.clone(), ..Listing::default() };
    let _ = Printer::new(Mnemonics::International, &known).statements(&decoded.block, &listing);
    let written = Written { multi_instance: true, notations: decoded.notations };
    let _ = encode(&decoded.block, &written, &known);
    let program = Program { blocks: vec![decoded.block], sources: vec!["fuzz".to_owned()], ..Program::default() };
    use Defect::{Brackets, LocalBytes, McrBrackets, ParamOverflow, ParamType, UnknownBlock};
    // The verifier finds errors that machine code itself can contain; the decoder prevents all others.
    for finding in ob1_ir::verify(&program, &known).err().unwrap_or_default() {
        let allowed = matches!(
            finding.defect,
            UnknownBlock(_) | Brackets | McrBrackets | ParamType(_) | ParamOverflow(..) | LocalBytes(_)
        );
        assert!(allowed, "{finding}");
    }
}
