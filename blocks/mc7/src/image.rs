//! A block of a program as a CPU holds it: what an upload gives.

use std::collections::BTreeMap;

use ob1_ir::{CodeBlock, DataBlock, DataKind, Program};
use ob1_model::{BlockId, BlockKind, Component, Interface, Param, Section};

use crate::compiled::{CompiledInterface, InterfaceKind};
use crate::encode::{Written, encode};
use crate::head::{BlockFoot, BlockHead, BlockImage, Stamp};

/// Attribute of a block that is linked.
const LINKED: u8 = 0x01;
/// Languages.
const STL: u8 = 1;
const DB: u8 = 5;
/// Version of the head: instances are addressed through AR2.
const VERSION: u8 = 1;

/// The block of this name; `None` where the program does not have it, or no machine code can be made of it. A data
/// block has its load values. `known` gives the interfaces of the blocks that are called and are not in the program.
#[must_use]
pub fn image<'c>(
    program: &'c Program,
    id: BlockId,
    known: &(dyn Fn(BlockId) -> Option<&'c Interface> + 'c),
) -> Option<BlockImage> {
    if id.kind == BlockKind::Db {
        return program.data.iter().find(|data| data.number == id.number).and_then(|data| data_image(program, data));
    }
    let block = program.blocks.iter().find(|block| block.id == id)?;
    let own = |id| program.blocks.iter().find(|block| block.id == id).map(|block| &block.interface);
    code_image(block, &|id| own(id).or_else(|| known(id)))
}

fn code_image<'c>(block: &CodeBlock, callees: &(dyn Fn(BlockId) -> Option<&'c Interface> + 'c)) -> Option<BlockImage> {
    // The instance of a function block may lie anywhere in a data block.
    let written = Written { multi_instance: block.id.kind.has_instance(), ..Written::default() };
    let encoded = encode(block, &written, callees).ok()?;
    let interface = CompiledInterface::of(block.id.number, &block.interface, &BTreeMap::new(), &|_| None).ok()?;
    let head = BlockHead { local_bytes: u16::try_from(encoded.local_bytes).ok()?, ..head(block.id, STL) };
    Some(BlockImage {
        head,
        code: encoded.code,
        interface: interface.bytes().ok()?,
        segments: encoded.segments.bytes(),
        foot: foot(block.name.as_deref()),
    })
}

fn data_image(program: &Program, data: &DataBlock) -> Option<BlockImage> {
    let (kind, number, interface) = match data.kind {
        DataKind::Global => (InterfaceKind::Global, data.number, declared(&data.components)),
        DataKind::Instance(of) => {
            let kind = if of.kind == BlockKind::Sfb { InterfaceKind::OfSfb } else { InterfaceKind::OfFb };
            let block = program.blocks.iter().find(|block| block.id == of);
            (kind, of.number, block.map_or_else(|| declared(&data.components), |block| block.interface.clone()))
        }
    };
    let compiled = CompiledInterface::of(number, &interface, &BTreeMap::new(), &|_| None).ok()?;
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

const fn head(id: BlockId, language: u8) -> BlockHead {
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
