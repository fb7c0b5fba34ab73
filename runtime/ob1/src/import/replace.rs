//! Handling blocks of the communication processors: those of a project are replaced by ours, because their code drives
//! a module by records that only the original answers.

use std::collections::{BTreeMap, BTreeSet};

use ob1_mc7::CompiledInterface;
use ob1_model::{BlockId, DataType, Interface, Section};
use ob1_project::{Block, Folder, Note, Notes};
use ob1_std::{StandardBlock, standard_blocks};
use ob1_stl::Library;

use ob1_station::program;
use ob1_station_file::library::Choice;

/// The letters of a block's head that are kept: NAME has 8.
const NAME: usize = 8;

/// What is replaced, and what there is to say of it.
#[derive(Debug, Default)]
pub(super) struct Replaced {
    /// Number in the project, and our block.
    pub(super) blocks: BTreeMap<BlockId, StandardBlock>,
    /// What there is to say.
    pub(super) notes: Notes,
}

/// Looks for handling blocks by their heads: kind, NAME and parameters.
pub(super) fn find(folder: &Folder) -> Replaced {
    let handling: Vec<StandardBlock> =
        standard_blocks().into_iter().filter(|block| block.origin.is_declared_only()).collect();
    let mut replaced = Replaced::default();
    for (id, block) in &folder.blocks {
        let named = |ours: &&StandardBlock| {
            let name: String = ours.name.chars().take(NAME).collect();
            ours.id.kind == id.kind && name.eq_ignore_ascii_case(block.head.name.trim())
        };
        let Some(ours) = handling.iter().filter(named).find(|ours| same_parameters(block, &ours.interface)) else {
            if handling.iter().any(|ours| named(&ours)) {
                let what = format!(
                    "it is called {} and has other parameters than ours; its own code is used",
                    block.head.name
                );
                replaced.notes.push(Note::info(id.to_string(), what));
            }
            continue;
        };
        let what = format!(
            "it is the handling block {}; {} of the plugin {} takes its place",
            ours.name,
            ours.key(),
            plugin_of(ours)
        );
        replaced.notes.push(Note::info(id.to_string(), what));
        replaced.blocks.insert(*id, ours.clone());
    }
    replaced
}

/// The plugin that serves a declared block.
pub(super) fn plugin_of(block: &StandardBlock) -> String {
    block.origin.plugin().unwrap_or_default().to_owned()
}

/// The same parameters in the same order, by type; in and out as a whole, because manuals and blocks differ in it.
fn same_parameters(block: &Block, ours: &Interface) -> bool {
    let Ok(compiled) = CompiledInterface::read(&block.interface) else { return false };
    let types = |interface: &Interface| {
        let formals = interface.formals().map(|p| (p.section == Section::Input, normal(&p.ty)));
        let (ins, outs): (Vec<_>, Vec<_>) = formals.partition(|(input, _)| *input);
        (ins, outs.into_iter().map(|(_, ty)| ty).collect::<Vec<_>>())
    };
    let (their_ins, mut their_outs) = types(&compiled.interface(block.id.kind.has_instance()));
    let (our_ins, mut our_outs) = types(ours);
    their_outs.sort_by_key(|ty| ty.name());
    our_outs.sort_by_key(|ty| ty.name());
    their_ins == our_ins && their_outs == our_outs
}

/// Types that a call passes alike, as one type.
fn normal(ty: &DataType) -> DataType {
    match ty {
        DataType::TimerOrWord => DataType::Word,
        other => other.clone(),
    }
}

impl Replaced {
    /// The blocks of the project that are replaced.
    pub(super) fn ids(&self) -> BTreeSet<BlockId> {
        self.blocks.keys().copied().collect()
    }

    /// What the program may call besides its own blocks.
    pub(super) fn library(&self) -> Result<Library, String> {
        let choices: Vec<Choice> =
            self.blocks.iter().map(|(id, block)| Choice { id: *id, key: block.key(), offered: false }).collect();
        program::library(&[], &choices)
            .map_err(|findings| findings.iter().map(|f| f.message.clone()).collect::<Vec<_>>().join(", "))
    }
}
