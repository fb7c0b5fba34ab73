//! Called blocks that neither the project nor ob1 has: a block that does nothing takes the place of each,
//! so that the program starts, and the report says who calls it.

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{Arg, Op, Target};
use ob1_mc7::{
    BlockFoot, BlockHead, BlockImage, CompiledInterface, Decoded, Entry, EntryType, InterfaceKind, Segments, list_order,
};
use ob1_model::{BlockId, DataType, Section};
use ob1_stl::Library;

use crate::folder::Folder;

/// A block that is missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Missing {
    pub(crate) id: BlockId,
    callers: BTreeSet<BlockId>,
    /// Pointers its calls hand over.
    parameters: usize,
}

/// Called blocks that are missing.
pub(crate) fn missing(
    decoded: &BTreeMap<BlockId, Decoded>,
    library: &Library,
    there: &dyn Fn(BlockId) -> bool,
) -> Vec<Missing> {
    let mut missing: BTreeMap<BlockId, Missing> = BTreeMap::new();
    for (caller, decoded) in decoded {
        for stmt in &decoded.block.code {
            let Op::Call(call) = &stmt.op else { continue };
            let (Target::Block(id) | Target::Local(id, _)) = call.target else { continue };
            if there(id) || library.get(id).is_some() {
                continue;
            }
            let entry = missing.entry(id).or_insert_with(|| Missing { id, callers: BTreeSet::new(), parameters: 0 });
            entry.callers.insert(*caller);
            let raw = call.args.iter().filter(|arg| matches!(arg, Arg::Raw(_))).count();
            entry.parameters = entry.parameters.max(raw);
        }
    }
    missing.into_values().collect()
}

/// What a system function says that could not do its work: an internal error.
const ERROR: [u8; 2] = [0x80, 0x7F];

impl Missing {
    /// What the report says.
    pub(crate) fn note(&self, folder: &Folder) -> String {
        let callers: Vec<String> = self.callers.iter().map(BlockId::to_string).collect();
        let system = self.id.kind.is_system();
        let name = folder.blocks.get(&self.id).map(|b| b.head.name.trim().to_owned()).filter(|name| !name.is_empty());
        let name = name.map(|name| format!(" ({name})")).unwrap_or_default();
        let what = if system {
            "this CPU does not have it"
        } else if folder.blocks.contains_key(&self.id) || folder.damaged.contains_key(&self.id.to_string()) {
            "it is left out"
        } else {
            "it is not in the project"
        };
        let does = if self.interface(folder).is_some_and(|i| result(&i).is_some()) {
            "a block that returns W#16#807F stands in"
        } else {
            "a block that does nothing stands in"
        };
        format!("{what}{name}; {} calls it; {does}", callers.join(", "))
    }

    fn interface(&self, folder: &Folder) -> Option<CompiledInterface> {
        let block = folder.blocks.get(&self.id)?;
        CompiledInterface::read(&block.interface).ok().filter(|compiled| !compiled.entries.is_empty())
    }

    /// The substitute for a missing block.
    pub(crate) fn image(&self, folder: &Folder) -> BlockImage {
        let compiled = self.interface(folder).unwrap_or_else(|| {
            let entry = Entry { ty: EntryType::Simple(DataType::DWord), attribute: 3, extra: 0 };
            CompiledInterface {
                kind: InterfaceKind::Code,
                number: self.id.number,
                entries: vec![entry; self.parameters],
                start: Vec::new(),
                rest: vec![0],
            }
        });
        let mut code = Vec::new();
        if let Some(offset) = result(&compiled).filter(|_| !self.id.kind.has_instance()) {
            // L W#16#807F; T #RET_VAL; CLR; SAVE.
            code.extend([0x30, 0x07, ERROR[0], ERROR[1], 0xFB, 0xC6]);
            code.extend(offset.to_be_bytes());
            code.extend([0x68, 0x1C, 0x68, 0x2C]);
        }
        let length = code.len() as u16;
        code.extend([0x65, 0x00]);
        BlockImage {
            head: BlockHead {
                version: 1,
                attribute: 1,
                language: 1,
                kind: BlockHead::kind_byte(self.id.kind),
                number: self.id.number,
                password: 0,
                code_changed: ob1_mc7::Stamp::default(),
                interface_changed: ob1_mc7::Stamp::default(),
                local_bytes: 0,
            },
            code,
            interface: compiled.bytes().unwrap_or_default(),
            segments: Segments { networks: vec![length], ..Segments::default() }.bytes(),
            foot: BlockFoot::default(),
        }
    }
}

/// The place of a value of one word in the list of pointers, as the offset a statement names it by.
fn result(compiled: &CompiledInterface) -> Option<u16> {
    let interface = compiled.interface(false);
    let formal = interface
        .formals()
        .position(|p| p.section == Section::Return && matches!(p.ty, DataType::Int | DataType::Word))?;
    let place = list_order(&interface).iter().position(|f| usize::from(*f) == formal)?;
    u16::try_from(2 * (place + 1)).ok()
}
