//! Missing blocks: the messages for a call of one, and for a block that is declared but served by no plugin.

use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

use ob1_cpu::LoadError;
use ob1_host::plugin::Plugin;
use ob1_ir::Program;
use ob1_model::{BlockId, BlockKind};
use ob1_std::{Origin, StandardBlock, known_system_function, standard_blocks};
use ob1_stl::{CANDIDATES, Candidate, KEY, Library, Missing, USES};

use ob1_station_file::finding::{Finding, Level};
use ob1_station_file::library::Choice;

/// A block that is called, is declared by a library, and that no plugin serves.
const UNSERVED: &str = "L020";
const MANUAL: &str = "docs/standard-blocks.md";

/// Tells the compiler the names of blocks that are not in the library, those it may take from there, and what to say of
/// calls of the others.
pub fn explain_missing(library: &mut Library) {
    for kind in [BlockKind::Sfc, BlockKind::Sfb] {
        for id in (0..=u16::from(u8::MAX)).map(|number| BlockId::new(kind, number)) {
            if let Some(name) = known_system_function(id) {
                library.name(id, name);
            }
        }
    }
    for block in standard_blocks().into_iter().filter(|block| block.origin != Origin::System) {
        library.name(block.id, block.name);
        if !block.origin.is_declared_only() {
            library.offer(block.id, block.name, block.interface);
        }
    }
    library.explain(missing);
}

fn missing(id: BlockId) -> Option<Missing> {
    let blocks = table();
    let (offered, others): (Vec<_>, Vec<_>) =
        blocks.iter().filter(|block| block.id == id).partition(|block| block.origin == Origin::System);
    if !others.is_empty() {
        return Some(to_be_chosen(id, &others));
    }
    known_system_function(id).filter(|_| offered.is_empty()).map(|name| lacking(id, name))
}

/// The standard blocks, made once: a program may lack thousands of blocks.
fn table() -> &'static [StandardBlock] {
    static BLOCKS: LazyLock<Vec<StandardBlock>> = LazyLock::new(standard_blocks);
    &BLOCKS
}

fn lacking(id: BlockId, name: &str) -> Missing {
    let message = format!("{id} {name} is a block of STEP 7 that this CPU does not have: {USES}");
    let remedy = format!("leave the call out or replace it; {MANUAL} lists the blocks there are");
    Missing { message, remedy, ..Missing::default() }
}

fn to_be_chosen(id: BlockId, candidates: &[&StandardBlock]) -> Missing {
    if let Some(block) = candidates.iter().find(|block| block.origin == Origin::S7_400) {
        return of_s7_400(block);
    }
    let of = |block: &&StandardBlock| Candidate {
        key: block.key(),
        name: block.name.to_owned(),
        formals: block.interface.formals().map(|formal| formal.name.clone()).collect(),
    };
    let subject = if id.kind == BlockKind::Fb { format!("{id} and its instances") } else { id.to_string() };
    // Only the handling blocks of the CPs come with plugins.
    let plugin = if candidates.iter().any(|block| block.origin.is_declared_only()) { ", its plugin" } else { "" };
    Missing {
        message: format!("{subject}: {}, and neither the program nor the library has it", USES),
        remedy: format!(
            "load its source{plugin}, import the project, or choose a standard block of this number ({CANDIDATES}): \
             [library] \"{id}\" = \"{KEY}\" in the station file; bare sources: --library {}={KEY}",
            compact(id)
        ),
        candidates: candidates.iter().map(of).collect(),
    }
}

/// A system block of an S7-400, called in an S7-300.
fn of_s7_400(block: &StandardBlock) -> Missing {
    let (id, name) = (block.id, block.name);
    let other = table().iter().find(|other| other.origin == Origin::Cp300 && other.id.number == id.number);
    let other =
        other.map(|other| format!(", or call {} {} ({})", other.id, other.name, other.key())).unwrap_or_default();
    Missing {
        message: format!("{id} {name} is a block of an S7-400: {USES}, and this CPU is an S7-300"),
        remedy: format!(
            "[cpu] family = 400 in the station file{other}; bare sources: --library {}; {MANUAL}",
            block.origin.name()
        ),
        ..Missing::default()
    }
}

fn compact(id: BlockId) -> String {
    format!("{}{}", id.kind.name(), id.number)
}

/// The blocks that are declared and that no plugin serves.
#[derive(Clone, Debug, Default)]
pub struct Unserved(BTreeMap<BlockId, StandardBlock>);

impl Unserved {
    /// The blocks of these declared libraries that none of these plugins serves under the number it was given.
    pub fn new(standard: &[Choice], plugins: &[(Arc<Plugin>, BTreeMap<BlockId, BlockId>)]) -> Self {
        let mut declared: BTreeMap<BlockId, StandardBlock> = standard
            .iter()
            .filter_map(|choice| Some((choice.id, choice.block()?)))
            .filter(|(_, block)| block.origin.is_declared_only())
            .collect();
        for (plugin, renumber) in plugins {
            for block in &plugin.info().blocks {
                declared.remove(&renumber.get(&block.id).copied().unwrap_or(block.id));
            }
        }
        Self(declared)
    }

    /// The findings of a program that cannot be loaded: the use of a declared block is reported as such, once per
    /// statement.
    pub fn findings(&self, errors: &[LoadError], program: &Program) -> Vec<Finding> {
        let is_called = |wanted: &BlockId| {
            errors.iter().any(|error| matches!(error, LoadError::MissingBlock { block, .. } if block == wanted))
        };
        let tell = |error: &LoadError| {
            let usual = of_load_error(error, program);
            match error {
                LoadError::MissingBlock { block, site } if self.0.contains_key(block) => {
                    Some(self.unserved(&usual, *block, &format!("{site} calls")))
                }
                // Its calls have been reported already.
                LoadError::Instance { block, .. } if self.0.contains_key(block) && is_called(block) => None,
                LoadError::Instance { block, number } if self.0.contains_key(block) => {
                    Some(self.unserved(&usual, *block, &format!("DB {number} is an instance of")))
                }
                _ => Some(usual),
            }
        };
        errors.iter().filter_map(tell).collect()
    }

    fn unserved(&self, usual: &Finding, block: BlockId, what: &str) -> Finding {
        let named = self.0.get(&block).map(|b| format!("{block} {} ({})", b.name, b.key())).unwrap_or_default();
        let message = format!("{what} {named}, which is declared only: no plugin serves it");
        let remedy = format!("load the plugin that has it: [[plugin]] in the station file; {MANUAL}");
        match usual.line {
            0 => Finding::whole(Level::Error, UNSERVED, &usual.file, message, remedy),
            line => Finding::in_line(Level::Error, UNSERVED, &usual.file, line, message, &remedy),
        }
    }
}

/// A reason to refuse a program, with the source line where it has one.
fn of_load_error(error: &LoadError, program: &Program) -> Finding {
    let site = match error {
        LoadError::MissingBlock { site, .. } | LoadError::Arguments { site, .. } | LoadError::Code { site, .. } => {
            Some(*site)
        }
        _ => None,
    };
    let block = site.and_then(|site| program.blocks.iter().find(|block| block.id == site.block));
    let file = block.and_then(|block| program.sources.get(block.source as usize));
    let code = format!("L{:03}", error.number());
    let text = error.to_string();
    let message = text.strip_prefix(&format!("{code}: ")).unwrap_or(&text);
    match (site, file) {
        (Some(site), Some(file)) => Finding::in_line(Level::Error, &code, file, site.line, message.to_owned(), ""),
        _ => Finding::whole(Level::Error, &code, "program", message, ""),
    }
}
