//! A block of a program as a CPU holds it: what an upload gives.

use std::collections::BTreeMap;

use ob1_ir::{CodeBlock, DataBlock, DataKind, Op, Program, Target};
use ob1_model::{BlockId, BlockKind, Component, DataType, Interface, Layout, Param, Section};

use crate::block::Callees;
use crate::compiled::{CompiledInterface, InterfaceKind};
use crate::encode::{Encoded, Written, encode};
use crate::head::{BlockFoot, BlockHead, BlockImage, Stamp};

/// Attribute of a block that is linked.
const LINKED: u8 = 0x01;
/// Attribute of a block whose code nobody sees, and the code that it shows: the end of the block.
const KNOW_HOW: u8 = 0x08;
const BE: [u8; 2] = [0x65, 0x00];
/// Numbers of languages in the head of a block.
const STL: u8 = 1;
const DB: u8 = 5;
/// Version of the head: instances are addressed through AR2.
const VERSION: u8 = 1;

/// The block of this name; `None` where the program does not have it, or no machine code can be made of it. A data
/// block has its load values. `known` gives the interfaces of the blocks that are called and are not in the program; of
/// one of the CPU there is an image, too, with nothing in it but its declarations.
pub fn image<'c>(
    program: &'c Program,
    id: BlockId,
    known: &(dyn Fn(BlockId) -> Option<&'c Interface> + 'c),
) -> Option<BlockImage> {
    let callees = |id| find(program, id).map(|block| &block.interface).or_else(|| known(id));
    if id.kind == BlockKind::Db {
        let data = program.data.iter().find(|data| data.number == id.number)?;
        return data_image(program, data, &callees);
    }
    if id.kind.is_system() {
        return system_image(id, known(id)?);
    }
    code_image(program, find(program, id)?, &callees)
}

/// A block of the CPU: what it does is not machine code.
fn system_image(id: BlockId, interface: &Interface) -> Option<BlockImage> {
    let interface = CompiledInterface::of(id.number, interface, &BTreeMap::new(), &|_| None).ok()?;
    Some(BlockImage {
        head: BlockHead { attribute: LINKED | KNOW_HOW, ..head(id, STL) },
        code: BE.to_vec(),
        interface: interface.bytes().ok()?,
        segments: Vec::new(),
        foot: foot(None),
    })
}

/// The machine code of a block of statements as [`image`] has it, and where each of its statements begins there.
pub fn code_of<'c>(
    program: &'c Program,
    id: BlockId,
    known: &(dyn Fn(BlockId) -> Option<&'c Interface> + 'c),
) -> Option<(Vec<u8>, Vec<u32>)> {
    let callees = |id| find(program, id).map(|block| &block.interface).or_else(|| known(id));
    let encoded = encoded(find(program, id)?, &callees)?;
    Some((encoded.code, encoded.offsets))
}

/// The compiled form of the declarations of a block of statements; `known` as for [`image`].
pub fn declarations<'c>(
    program: &'c Program,
    id: BlockId,
    known: &(dyn Fn(BlockId) -> Option<&'c Interface> + 'c),
) -> Option<CompiledInterface> {
    let callees = |id| find(program, id).map(|block| &block.interface).or_else(|| known(id));
    compiled(program, find(program, id)?, &callees)
}

fn find(program: &Program, id: BlockId) -> Option<&CodeBlock> {
    program.blocks.iter().find(|block| block.id == id)
}

/// The declarations of a block that are instances of function blocks, by their index: those it calls.
fn instances(block: &CodeBlock, callees: &Callees<'_>) -> BTreeMap<usize, BlockId> {
    let named = |ty: &DataType| match ty {
        DataType::Struct(fields) => fields.iter().filter(|field| !field.name.is_empty()).count(),
        _ => 0,
    };
    let mut found = BTreeMap::new();
    for stmt in &block.code {
        let Op::Call(call) = &stmt.op else { continue };
        let (Target::Local(id, at), None) = (call.target, call.instance) else { continue };
        let Some(callee) = callees(id) else { continue };
        let is_one = |param: &Param| {
            param.section == Section::Static
                && param.at == at
                && matches!(param.ty, DataType::Struct(_))
                && Layout::bits(&param.ty) == callee.instance_bytes * 8
                // Not a structure that has the instance as its only component.
                && named(&param.ty) == named(&callee.instance_type())
        };
        if let Some(index) = block.interface.params.iter().position(is_one) {
            found.insert(index, id);
        }
    }
    found
}

/// The declarations of a block, its instances as such, and those within them.
fn compiled(program: &Program, block: &CodeBlock, callees: &Callees<'_>) -> Option<CompiledInterface> {
    let mut all = BTreeMap::new();
    let mut next = vec![block];
    while let Some(block) = next.pop() {
        let of_block = instances(block, callees);
        next.extend(of_block.values().filter(|id| !all.contains_key(*id)).filter_map(|id| find(program, *id)));
        all.insert(block.id, of_block);
    }
    let none = BTreeMap::new();
    let own = all.get(&block.id).unwrap_or(&none);
    CompiledInterface::of(block.id.number, &block.interface, own, &|id| {
        Some((callees(id)?, all.get(&id).unwrap_or(&none)))
    })
    .ok()
}

fn encoded(block: &CodeBlock, callees: &Callees<'_>) -> Option<Encoded> {
    // The instance of a function block may lie anywhere in a data block.
    let written = Written { multi_instance: block.id.kind.has_instance(), ..Written::default() };
    encode(block, &written, callees).ok()
}

fn code_image(program: &Program, block: &CodeBlock, callees: &Callees<'_>) -> Option<BlockImage> {
    let encoded = encoded(block, callees)?;
    let interface = compiled(program, block, callees)?;
    let head = BlockHead { local_bytes: u16::try_from(encoded.local_bytes).ok()?, ..head(block.id, STL) };
    Some(BlockImage {
        head,
        code: encoded.code,
        interface: interface.bytes().ok()?,
        segments: encoded.segments.bytes(),
        foot: foot(block.name.as_deref()),
    })
}

fn data_image(program: &Program, data: &DataBlock, callees: &Callees<'_>) -> Option<BlockImage> {
    let (kind, number, block) = match data.kind {
        DataKind::Global => (InterfaceKind::Global, data.number, None),
        DataKind::Instance(of) => {
            let kind = if of.kind == BlockKind::Sfb { InterfaceKind::OfSfb } else { InterfaceKind::OfFb };
            (kind, of.number, find(program, of))
        }
    };
    let compiled = match block {
        Some(block) => compiled(program, block, callees)?,
        None => CompiledInterface::of(number, &declared(&data.components), &BTreeMap::new(), &|_| None).ok()?,
    };
    let id = BlockId::new(BlockKind::Db, data.number);
    let bit = |is_so: bool, bit: u8| if is_so { bit } else { 0 };
    let attribute = LINKED | bit(data.read_only, BlockHead::READ_ONLY) | bit(data.non_retain, BlockHead::NON_RETAIN);
    Some(BlockImage {
        head: BlockHead { attribute, ..head(id, DB) },
        code: data.bytes.clone(),
        interface: CompiledInterface { kind, ..compiled }.bytes().ok()?,
        segments: Vec::new(),
        foot: foot(data.name.as_deref()),
    })
}

/// The declarations of a data block, as static variables.
fn declared(components: &[Component]) -> Interface {
    let params = components.iter().map(|c| Param::new(&c.path, Section::Static, c.ty.clone())).collect();
    Interface { params, ..Interface::default() }
}

fn head(id: BlockId, language: u8) -> BlockHead {
    BlockHead {
        version: VERSION,
        attribute: LINKED,
        language,
        kind: BlockHead::kind_byte(id.kind),
        number: id.number,
        password: 0,
        code_changed: Stamp { days: 0, ms: 0 },
        interface_changed: Stamp { days: 0, ms: 0 },
        local_bytes: 0,
    }
}

/// The name has eight bytes.
fn foot(name: Option<&str>) -> BlockFoot {
    let mut bytes = [0; 8];
    bytes.iter_mut().zip(name.unwrap_or_default().bytes().filter(u8::is_ascii)).for_each(|(to, from)| *to = from);
    BlockFoot { name: bytes, version: 0x01, ..BlockFoot::default() }
}
