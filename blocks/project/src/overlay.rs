//! Adds blocks in machine code to a program from sources.
//!
//! A block of machine code that is in a source, too, takes its declarations, names included, from there: the source
//! then is its interface. One that is in no source has the interface of its compiled form, without names.

use std::collections::BTreeMap;

use ob1_ir::{CodeBlock, DataBlock, DataKind, Program};
use ob1_mc7::{BlockHead, BlockImage, CompiledInterface, InterfaceKind, MachineBlock, Segments};
use ob1_model::{BlockId, BlockKind, Interface};
use ob1_stl::Library;

use crate::register::decode_block;

/// A block of machine code with the file it is from.
#[derive(Clone, Debug)]
pub struct Image {
    /// The file, as it was named.
    pub file: String,
    /// The block as its file has it.
    pub block: BlockImage,
}

/// A block that could not be taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    /// The file, as it was named.
    pub file: String,
    /// The block; `None` for one of a kind no program has.
    pub block: Option<BlockId>,
    /// Why, in one sentence.
    pub reason: String,
}

impl Image {
    /// The block's kind and number; `None` for system data.
    pub fn id(&self) -> Option<BlockId> {
        Some(BlockId::new(self.block.head.block_kind()?, self.block.head.number))
    }

    fn refused(&self, reason: impl Into<String>) -> Refused {
        Refused { file: self.file.clone(), block: self.id(), reason: reason.into() }
    }
}

/// Tells the compiler of the blocks that are in no source: `sources` says which do.
pub fn announce(images: &[Image], in_source: &dyn Fn(BlockId) -> bool, library: &mut Library) {
    for image in images {
        let Some(id) = image.id().filter(|id| id.kind != BlockKind::Db && !in_source(*id)) else { continue };
        if let Ok(compiled) = CompiledInterface::read(&image.block.interface) {
            let name = foot_name(&image.block).unwrap_or_else(|| id.to_string());
            library.insert(id, &name, compiled.interface(id.kind.has_instance()));
        }
    }
}

/// Puts the blocks into a compiled program.
///
/// # Errors
/// The blocks that cannot be taken; the others are in.
pub fn overlay(program: &mut Program, images: &[Image], library: &Library) -> Result<(), Vec<Refused>> {
    if images.is_empty() {
        return Ok(());
    }
    let mut refused = Vec::new();
    let mut interfaces: BTreeMap<BlockId, Interface> =
        program.blocks.iter().map(|block| (block.id, block.interface.clone())).collect();
    for image in images {
        let Some(id) = image.id().filter(|id| id.kind != BlockKind::Db && !interfaces.contains_key(id)) else {
            continue;
        };
        match CompiledInterface::read(&image.block.interface) {
            Ok(compiled) => drop(interfaces.insert(id, compiled.interface(id.kind.has_instance()))),
            Err(error) => refused.push(image.refused(error.to_string())),
        }
    }
    let callees = |id: BlockId| interfaces.get(&id).or_else(|| library.get(id).map(|block| &block.interface));
    for image in images {
        let Some(id) = image.id() else {
            refused.push(image.refused("it is a system data block, which no program calls"));
            continue;
        };
        let source = program.sources.len() as u32;
        let outcome = if id.kind == BlockKind::Db {
            data(program, id, &image.block, &callees);
            Ok(())
        } else {
            match callees(id) {
                Some(interface) => code(id, &image.block, interface, &callees).map(|mut block| {
                    block.source = source;
                    put(program, block);
                }),
                // Reported already.
                None => continue,
            }
        };
        match outcome {
            Ok(()) => program.sources.push(image.file.clone()),
            Err(reason) => refused.push(image.refused(reason)),
        }
    }
    if refused.is_empty() { Ok(()) } else { Err(refused) }
}

/// Decodes a block of machine code.
///
/// # Errors
/// What is wrong with it, with number, block, offset and bytes.
pub(crate) fn code<'i>(
    id: BlockId,
    image: &BlockImage,
    interface: &Interface,
    callees: &(dyn Fn(BlockId) -> Option<&'i Interface> + 'i),
) -> Result<CodeBlock, String> {
    let segments = Segments::read(&image.segments).unwrap_or_default();
    let machine = MachineBlock {
        id,
        name: foot_name(image),
        interface,
        code: &image.code,
        segments: &segments,
        multi_instance: image.head.version != 0,
        local_bytes: u32::from(image.head.local_bytes),
    };
    decode_block(&machine, callees).map(|decoded| decoded.block).map_err(|error| error.to_string())
}

fn put(program: &mut Program, block: CodeBlock) {
    match program.blocks.iter_mut().find(|b| b.id == block.id) {
        Some(place) => *place = block,
        None => program.blocks.push(block),
    }
}

fn data<'i>(
    program: &mut Program,
    id: BlockId,
    image: &BlockImage,
    callees: &dyn Fn(BlockId) -> Option<&'i Interface>,
) {
    if let Some(db) = program.data.iter_mut().find(|db| db.number == id.number) {
        db.bytes.clone_from(&image.code);
        return;
    }
    let compiled = CompiledInterface::read(&image.interface).ok();
    let kind = compiled.as_ref().and_then(instance_of);
    let fits = |fb: &BlockId| callees(*fb).is_some_and(|i| i.instance_bytes as usize <= image.code.len());
    program.data.push(DataBlock {
        number: id.number,
        name: foot_name(image),
        kind: kind.filter(fits).map_or(DataKind::Global, DataKind::Instance),
        bytes: image.code.clone(),
        components: compiled.map(|compiled| compiled.components()).unwrap_or_default(),
        read_only: false,
        non_retain: image.head.attribute & BlockHead::NON_RETAIN != 0,
    });
}

/// The block a data block is an instance of, by its compiled interface.
pub(crate) fn instance_of(compiled: &CompiledInterface) -> Option<BlockId> {
    match compiled.kind {
        InterfaceKind::OfFb => Some(BlockId::new(BlockKind::Fb, compiled.number)),
        InterfaceKind::OfSfb => Some(BlockId::new(BlockKind::Sfb, compiled.number)),
        _ => None,
    }
}

fn foot_name(image: &BlockImage) -> Option<String> {
    let name: Vec<u8> = image.foot.name.iter().copied().take_while(|b| *b != 0).collect();
    let name = String::from_utf8_lossy(&name).trim().to_owned();
    (!name.is_empty()).then_some(name)
}
