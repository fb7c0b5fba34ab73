//! Machine code to statements and back to text; what would not say the same stays in machine code.

use std::collections::BTreeMap;

use ob1_ir::CodeBlock;
use ob1_mc7::{MachineBlock, Segments, decode};
use ob1_model::{BlockId, BlockKind, Interface};
use ob1_stl::print::Printer;

use super::{Draft, Of};
use crate::note::Note;
use crate::overlay::{self, Image};
use crate::register::decode_block;
use crate::{listing, source, stand_in};

impl Draft<'_> {
    /// Machine code to statements, with the interfaces all blocks have now.
    pub(super) fn decode(&mut self) {
        let files = self.files();
        let program = self.compile(&files).program;
        let mut interfaces: BTreeMap<BlockId, Interface> =
            program.blocks.into_iter().map(|block| (block.id, block.interface)).collect();
        for id in self.images.iter().filter(|id| id.kind != BlockKind::Db) {
            if let Some(compiled) = self.compiled.get(id) {
                interfaces.insert(*id, compiled.interface(id.kind.has_instance()));
            }
        }
        let library = self.library.clone();
        let callees = |id: BlockId| interfaces.get(&id).or_else(|| library.get(id).map(|block| &block.interface));
        let folder = self.folder;
        for (id, block) in &folder.blocks {
            let is_here = self.declared.contains_key(id) || self.images.contains(id);
            if !is_here || id.kind == BlockKind::Db {
                continue;
            }
            let local_bytes = u32::from(block.local_bytes);
            let Some(interface) = interfaces.get(id) else {
                self.leave_out(*id, "it has no interface, neither as text nor compiled");
                continue;
            };
            let segments = Segments::read(&block.segments).unwrap_or_else(|error| {
                self.note(*id, format!("its networks cannot be told: {error}"));
                Segments::default()
            });
            let machine = MachineBlock {
                id: *id,
                name: Some(block.head.name.clone()).filter(|name| !name.is_empty()),
                interface,
                code: &block.code,
                segments: &segments,
                multi_instance: !block.code_version1,
                local_bytes: 0,
            };
            let unshown = |block: &CodeBlock| block.interface.temp_bytes < local_bytes;
            let mut decoded = decode_block(&machine, &callees);
            // What a head says above its statements is for calls that are folded here, or reached by pointers.
            if decoded.as_ref().is_ok_and(|decoded| unshown(&decoded.block))
                && decode(&machine, &|_| None).is_ok_and(|unfolded| unshown(&unfolded.block))
            {
                decoded = decode_block(&MachineBlock { local_bytes, ..machine }, &callees);
                self.reserved.insert(*id);
            }
            match decoded {
                Ok(decoded) => drop(self.decoded.insert(*id, decoded)),
                Err(error) => self.leave_out(*id, error.to_string()),
            }
        }
        self.interfaces = interfaces;
    }

    /// Declares the local data that a head says and nothing else shows.
    pub(super) fn reserve(&mut self) {
        for (id, decoded) in self.decoded.iter().filter(|(id, _)| self.reserved.contains(id)) {
            let (Some(block), Some(declared)) = (self.folder.blocks.get(id), self.declared.get_mut(id)) else {
                continue;
            };
            // A protected block has its machine code beside it, whose head says it.
            if !block.know_how {
                let declared_bytes = decoded.block.interface.declared_temps().next_multiple_of(2);
                declared.reserve(u32::from(block.local_bytes) - declared_bytes);
            }
        }
    }

    /// Called blocks that are missing are replaced by one that does nothing. True when there are any.
    pub(super) fn stand_in(&mut self) -> bool {
        let missing = stand_in::missing(&self.decoded, &self.library, &|id| self.decoded.contains_key(&id));
        for missing in missing {
            let what = missing.note(self.folder);
            self.out.notes.push(Note::warning(missing.id.to_string(), what));
            self.stand_ins.push(Image {
                file: format!("{}.mc7", source::file_stem(missing.id)),
                block: missing.image(self.folder),
            });
        }
        overlay::announce(&self.stand_ins, &|_| false, &mut self.library);
        !self.stand_ins.is_empty()
    }

    /// Symbols by the address they stand for, as the printer writes it.
    fn symbols(&self) -> BTreeMap<String, String> {
        let mut symbols = BTreeMap::new();
        for symbol in &self.wanted.symbols {
            symbols.entry(symbol.address.clone()).or_insert_with(|| symbol.name.clone());
        }
        symbols
    }

    /// Statements as text, checked against the machine code; what does not give the same stays in machine code.
    pub(super) fn write_statements(&mut self) {
        let (symbols, library, interfaces) =
            (self.symbols(), self.library.clone(), std::mem::take(&mut self.interfaces));
        let callees = |id: BlockId| interfaces.get(&id).or_else(|| library.get(id).map(|block| &block.interface));
        let printer = Printer::new(self.wanted.mnemonics, &callees).with_symbols(&symbols);
        let mut unsaid = Vec::new();
        for (id, decoded) in &self.decoded {
            let Some(block) = self.folder.blocks.get(id).filter(|_| self.declared.contains_key(id)) else { continue };
            if block.know_how {
                self.images.insert(*id);
                self.statements.insert(
                    *id,
                    format!("// KNOW_HOW_PROTECT: its statements are in {}.mc7.\n", source::file_stem(*id)),
                );
                continue;
            }
            self.printed.insert(*id);
            match printer.statements(&decoded.block, &listing::of(block, decoded)) {
                Ok(text) => drop(self.statements.insert(*id, text)),
                Err(why) => unsaid.push((*id, why.to_string())),
            }
        }
        for (id, why) in unsaid {
            self.stay_compiled(id, &why);
        }
        for _ in 0..3 {
            let files = self.files();
            let output = self.compile(&files);
            let mut differ: BTreeMap<BlockId, String> = BTreeMap::new();
            for diagnostic in output.diagnostics.iter().filter(|d| d.severity == ob1_stl::Severity::Error) {
                for source in diagnostic.sources() {
                    let Some((Of::Block(id), _)) = files.get(source) else { continue };
                    let line = if source == diagnostic.source {
                        format!(" (line {})", diagnostic.line)
                    } else {
                        String::new()
                    };
                    differ.entry(*id).or_insert_with(|| format!("{} {}{line}", diagnostic.code, diagnostic.message));
                }
            }
            for block in &output.program.blocks {
                if let Some(decoded) = self.decoded.get(&block.id).filter(|_| self.printed.contains(&block.id))
                    && let Some(at) = first_difference(block, &decoded.block)
                {
                    differ.entry(block.id).or_insert(at);
                }
            }
            if differ.is_empty() {
                break;
            }
            for (id, why) in differ {
                self.stay_compiled(id, &why);
            }
        }
    }

    fn stay_compiled(&mut self, id: BlockId, why: &str) {
        if self.printed.remove(&id) {
            self.images.insert(id);
            self.statements.insert(id, format!("// Its statements are in {}.mc7.\n", source::file_stem(id)));
            self.note(id, format!("it stays in machine code: its source would not say the same: {why}"));
        } else if id.kind != BlockKind::Db {
            self.declared.remove(&id);
        }
    }
}

/// Where two blocks differ, in words; `None` when they say the same.
fn first_difference(source: &CodeBlock, machine: &CodeBlock) -> Option<String> {
    let pairs = source.code.iter().zip(&machine.code);
    if let Some((at, (a, b))) = pairs.enumerate().find(|(_, (a, b))| a.op != b.op || a.network != b.network) {
        return Some(format!("statement {}: {} for {}", at + 1, a.op, b.op));
    }
    let (a, b) = (source.code.len(), machine.code.len());
    (a != b).then(|| format!("{a} statements for {b}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A note is read by people.
    #[test]
    fn a_difference_is_told_as_statements() {
        let block = |value: u32| {
            let text = format!("FUNCTION FC 1 : VOID\nBEGIN\nNETWORK\nL {value};\nEND_FUNCTION\n");
            let sources = [ob1_stl::Source::new("a.awl", text)];
            ob1_stl::compile(&sources, &ob1_stl::Library::new(), &ob1_stl::Options::default()).program.blocks.remove(0)
        };
        assert_eq!(first_difference(&block(1), &block(1)), None);
        let told = first_difference(&block(1), &block(2)).expect("they differ");
        assert_eq!(told, "statement 1: L DW#16#1 for L DW#16#2");
    }
}
