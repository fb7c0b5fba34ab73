//! What was downloaded and deleted, and the program that results from it and the sources.

use std::collections::BTreeMap;
use std::sync::Arc;

use ob1_cpu::Surroundings;
use ob1_ir::{DataKind, Program};
use ob1_mc7::{BlockHead, BlockImage, CompiledInterface};
use ob1_model::{BlockId, BlockKind, Interface};
use ob1_project::Image;
use ob1_stl::Library;

use super::order::differing;
use crate::access::protocol::Download;
use crate::program_facts::KnownProgram;

/// Blocks as they came, by kind and number; `None`: it was deleted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Changes(pub(super) BTreeMap<BlockId, Option<Vec<u8>>>);

impl Changes {
    /// Whether nothing was downloaded or deleted.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Notes a block that has come.
    pub fn put(&mut self, id: BlockId, bytes: Vec<u8>) {
        self.0.insert(id, Some(bytes));
    }

    /// Notes a block that was deleted.
    pub fn delete(&mut self, id: BlockId) {
        self.0.insert(id, None);
    }

    /// The system data among them, which no source has.
    #[must_use]
    pub fn system_data(&self) -> Self {
        let system = self.0.iter().filter(|(id, _)| id.kind == BlockKind::Sdb);
        Self(system.map(|(id, bytes)| (*id, bytes.clone())).collect())
    }

    /// What turns the sources into this program. A block without machine code is left as in the sources.
    #[must_use]
    pub fn between(sources: &Program, program: &Program, library: &Library) -> Self {
        let known = |id: BlockId| library.get(id).map(|block| &block.interface);
        let mut changes = Self::default();
        for (id, _) in differing(sources, program) {
            let image = ob1_mc7::image(program, id, &known).and_then(|image| image.bytes().ok());
            match (has(program, id), image) {
                (false, _) => changes.delete(id),
                (true, Some(bytes)) => changes.put(id, bytes),
                (true, None) => tracing::warn!("{id} has no machine code: the next start takes it from the sources"),
            }
        }
        changes
    }

    /// Forgets changes that leave a block as it is in the sources.
    pub fn forget_same(&mut self, sources: &Program, library: &Library) {
        let known = |id: BlockId| library.get(id).map(|block| &block.interface);
        self.0.retain(|id, change| match change {
            None => has(sources, *id) || is_given(*id),
            Some(bytes) => {
                let ours = ob1_mc7::image(sources, *id, &known);
                ours.zip(BlockImage::read(bytes).ok()).is_none_or(|(ours, (theirs, _))| !same(&ours, &theirs))
            }
        });
    }

    /// How the blocks differ from the sources.
    fn told(&self, sources: &Program, around: &Surroundings) -> Vec<Download> {
        let what = |id: BlockId, change: &Option<Vec<u8>>| match change {
            None => "deleted",
            Some(_) if id.kind == BlockKind::Sdb => "not used",
            Some(_) if around.has(id) => "not used",
            Some(_) if has(sources, id) => "changed",
            Some(_) => "new",
        };
        let told = |(id, change): (&BlockId, &Option<Vec<u8>>)| Download {
            block: id.to_string(),
            what: what(*id, change).to_owned(),
        };
        self.0.iter().map(told).collect()
    }

    /// What others see of the program that results from the sources and these changes.
    #[must_use]
    pub fn known(
        &self,
        program: &Arc<Program>,
        (sources, around): (&Program, &Surroundings),
        library: &Arc<Library>,
    ) -> KnownProgram {
        let used = |(id, change): (&BlockId, &Option<Vec<u8>>)| {
            let image = change.as_ref().filter(|_| !around.has(*id))?;
            Some((*id, image.clone()))
        };
        let mut known = KnownProgram::new(Arc::clone(program), Arc::clone(library));
        let given = GIVEN.map(|number| BlockId::new(BlockKind::Sdb, number));
        let given = given.into_iter().filter(|id| !self.0.contains_key(id)).map(|id| (id, without_content(id.number)));
        known.images = given.chain(self.0.iter().filter_map(used)).collect();
        known.downloads = self.told(sources, around);
        known.add_system_data();
        known
    }

    /// The program of the sources with the changes.
    ///
    /// # Errors
    /// The blocks that cannot be taken, each with the reason.
    pub fn apply(&self, sources: &Program, library: &Library, around: &Surroundings) -> Result<Program, Vec<String>> {
        let mut program = sources.clone();
        let (mut images, mut refused) = (Vec::new(), Vec::new());
        let mut library = library.clone();
        // Data blocks last: they do not move the sources of the others.
        let is_data = |(id, _): &(&BlockId, &Option<Vec<u8>>)| id.kind == BlockKind::Db;
        let (data, code): (Vec<_>, Vec<_>) = self.0.iter().partition(is_data);
        for (id, change) in code.into_iter().chain(data).filter(|(id, _)| id.kind != BlockKind::Sdb) {
            let Some(bytes) = change else {
                remove(&mut program, *id);
                continue;
            };
            // A block of a plugin or a library is that of the station, whatever code another CPU has for it.
            if around.has(*id) {
                continue;
            }
            match block(*id, bytes) {
                Ok(block) => {
                    let known = |id: BlockId| library.get(id).map(|block| &block.interface);
                    if !is_declared_so(&program, *id, &block, &known) {
                        remove(&mut program, *id);
                    }
                    images.push(Image { file: format!("downloaded {id}"), block });
                }
                Err(why) => refused.push(format!("{id}: {why}")),
            }
        }
        let declared: Vec<BlockId> = program.blocks.iter().map(|block| block.id).collect();
        ob1_project::announce(&images, &|id| declared.contains(&id), &mut library);
        if let Err(others) = ob1_project::overlay(&mut program, &images, &library) {
            refused.extend(others.iter().map(|other| format!("{}: {}", other.file, other.reason)));
        }
        for image in &images {
            let number = image.block.head.number;
            let is_it = |db: &&mut ob1_ir::DataBlock| {
                image.id().is_some_and(|id| id.kind == BlockKind::Db) && db.number == number
            };
            if let Some(db) = program.data.iter_mut().find(is_it) {
                let attribute = image.block.head.attribute;
                db.read_only = attribute & BlockHead::READ_ONLY != 0;
                db.non_retain = attribute & BlockHead::NON_RETAIN != 0;
            }
        }
        if refused.is_empty() { Ok(program) } else { Err(refused) }
    }
}

/// The system data blocks that every S7-300 has, and clients look for. The station file says what the hardware is, so
/// there is nothing in them, and what comes in their place is kept and not used.
const GIVEN: [u16; 6] = [0, 1, 2, 3, 4, 7];

fn is_given(id: BlockId) -> bool {
    id.kind == BlockKind::Sdb && GIVEN.contains(&id.number)
}

fn without_content(number: u16) -> Vec<u8> {
    let kind = BlockHead::kind_byte(BlockKind::Sdb);
    let head = BlockHead { version: 3, attribute: 2, language: 7, kind, number, ..BlockHead::default() };
    let (code, interface, segments, foot) = Default::default();
    BlockImage { head, code, interface, segments, foot }.bytes().unwrap_or_default()
}

/// Whether these bytes are a system data block of this number.
pub(super) fn is_system_data(number: u16, bytes: &[u8]) -> bool {
    let head = bytes.first_chunk::<{ ob1_mc7::HEAD_BYTES }>();
    head.is_some_and(|head| {
        let [_, _, _, _, _, kind, a, b, c, d, e, f, ..] = *head;
        kind == BlockHead::kind_byte(BlockKind::Sdb)
            && u16::from_be_bytes([a, b]) == number
            && u32::from_be_bytes([c, d, e, f]) as usize == bytes.len()
    })
}

/// The block in these bytes, if it has the expected kind and number.
///
/// # Errors
/// They are no block, something follows it, or it is another one; in words.
pub(super) fn block(id: BlockId, bytes: &[u8]) -> Result<BlockImage, String> {
    let (block, length) = BlockImage::read(bytes).map_err(|error| error.to_string())?;
    if length != bytes.len() {
        return Err("something follows its foot".into());
    }
    if block.head.block_kind() != Some(id.kind) || block.head.number != id.number {
        return Err("its head names another block".into());
    }
    Ok(block)
}

pub(super) fn has(program: &Program, id: BlockId) -> bool {
    match id.kind {
        BlockKind::Db => program.data.iter().any(|db| db.number == id.number),
        _ => program.blocks.iter().any(|block| block.id == id),
    }
}

fn remove(program: &mut Program, id: BlockId) {
    match id.kind {
        BlockKind::Db => program.data.retain(|db| db.number != id.number),
        _ => program.blocks.retain(|block| block.id != id),
    }
}

/// The same code or values, interface and attributes; the rest are dates.
fn same(one: &BlockImage, other: &BlockImage) -> bool {
    let attributes = |block: &BlockImage| block.head.attribute & (BlockHead::READ_ONLY | BlockHead::NON_RETAIN);
    let all = |block: &BlockImage| (block.code.clone(), block.interface.clone(), block.segments.clone());
    all(one) == all(other) && attributes(one) == attributes(other)
}

/// Whether the names of the sources fit a block: its declarations are the same.
fn is_declared_so<'c>(
    program: &'c Program,
    id: BlockId,
    block: &BlockImage,
    known: &(dyn Fn(BlockId) -> Option<&'c Interface> + 'c),
) -> bool {
    if id.kind == BlockKind::Db {
        let there = program.data.iter().find(|db| db.number == id.number && db.bytes.len() == block.code.len());
        let image = there.and_then(|_| ob1_mc7::image(program, id, known));
        return image.is_some_and(|image| image.interface == block.interface)
            || there.is_some_and(|db| db.kind == DataKind::Global && block.interface.is_empty());
    }
    let Some(there) = program.blocks.iter().find(|other| other.id == id) else { return true };
    // Another program may have its instances as structures.
    let plain = CompiledInterface::of(id.number, &there.interface, &BTreeMap::new(), &|_| None).ok();
    let forms = [ob1_mc7::declarations(program, id, known), plain];
    forms.into_iter().flatten().any(|form| form.bytes().is_ok_and(|bytes| bytes == block.interface))
}
