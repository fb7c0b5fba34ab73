//! The program as the page explains it: lines of its sources, networks, who uses what.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crate::shared::{Station, Trouble};
use ob1_access::Names;
use ob1_access::door::Document;
use ob1_access::why::Known;
use ob1_ir::{CodeBlock, Program};
use ob1_ladder::tree::Tree;
use ob1_ladder::{Network, Reason, View, listing, read};
use ob1_model::BlockId;
use ob1_stl::{CrossReference, Library, Mnemonics};
use serde::Deserialize;

/// How old this may be: it changes with a download only.
const AGE: Duration = Duration::from_secs(10);
/// How long the station may need for it.
const PATIENCE: Duration = Duration::from_secs(60);

/// Between two questions for what the station is still making.
const MAKING: Duration = Duration::from_millis(200);

/// A line: its number in the file (0 without one), its network, its text, the symbols of its operands.
pub(super) type Line = (u32, u16, String, Vec<String>);

/// A block as its source has it.
#[derive(Debug, Default, Deserialize)]
pub(super) struct BlockText {
    /// The file; empty: it is printed from its statements.
    pub(super) file: String,
    pub(super) lines: Vec<Line>,
}

/// The broker's document.
#[derive(Deserialize)]
struct Sources {
    mnemonics: String,
    blocks: BTreeMap<String, BlockText>,
    /// The called blocks that are not the program's own, in the file form.
    library: String,
}

/// A network, and its tree or why it stays statements.
pub(super) type Drawable = (Network, Result<Tree, Reason>);

/// See [the module](self).
#[derive(Debug)]
pub(super) struct Insight {
    /// The set of mnemonics of most sources.
    pub(super) set: Mnemonics,
    pub(super) names: Names,
    /// Who reads and writes what, with the program.
    pub(super) all: CrossReference<Arc<Program>>,
    texts: BTreeMap<String, BlockText>,
    library: Library,
    /// Symbols by address, in the set.
    symbols: BTreeMap<String, String>,
    /// The networks of the block that was asked for last.
    networks: Mutex<Option<(BlockId, Arc<Vec<Drawable>>)>>,
}

/// The newest one, with the document it was made of.
#[derive(Debug, Default)]
pub(super) struct Newest(RefCell<Option<Made>>);

type Made = (Arc<[u8]>, Arc<Insight>);

impl Newest {
    /// The program that runs, as far as is known.
    pub(super) async fn get(&self, station: &Station) -> Result<Arc<Insight>, Trouble> {
        let mut sources = station.document(Document::Sources, AGE).await?;
        // The station makes it when it is asked for first.
        let begun = tokio::time::Instant::now();
        while sources.is_empty() {
            if begun.elapsed() > PATIENCE {
                return Err(Trouble::Program("the station is still reading its sources".into()));
            }
            tokio::time::sleep(MAKING).await;
            sources = station.document(Document::Sources, MAKING / 2).await?;
        }
        if let Some((of, insight)) = &*self.0.borrow()
            && *of == sources
        {
            return Ok(Arc::clone(insight));
        }
        // That of the same program, not one that was kept.
        let program = station.document(Document::Program, Duration::ZERO).await?;
        let of = Arc::clone(&sources);
        // A large program takes a while to read.
        let made = tokio::task::spawn_blocking(move || Insight::new(&program, &of)).await;
        let made = made.map_err(|error| Trouble::Program(error.to_string()))?.map(Arc::new)?;
        *self.0.borrow_mut() = Some((sources, Arc::clone(&made)));
        Ok(made)
    }
}

impl Insight {
    fn new(program: &[u8], sources: &[u8]) -> Result<Self, Trouble> {
        let wrong = |error: &dyn std::fmt::Display| Trouble::Program(error.to_string());
        let sources: Sources = serde_json::from_slice(sources).map_err(|error| wrong(&error))?;
        let program = ob1_ir::parse(&String::from_utf8_lossy(program)).map_err(|error| wrong(&error))?;
        let mut library = Library::new();
        for block in ob1_ir::parse(&sources.library).map_err(|error| wrong(&error))?.blocks {
            library.insert(block.id, block.name.as_deref().unwrap_or_default(), block.interface);
        }
        let set = if sources.mnemonics == "en" { Mnemonics::International } else { Mnemonics::German };
        Ok(Self {
            set,
            names: Names::new(&program),
            symbols: ob1_ladder::symbols(&program, set),
            all: CrossReference::new(Arc::new(program), &library),
            texts: sources.blocks,
            library,
            networks: Mutex::default(),
        })
    }

    /// The block of this name, `FC 1`.
    pub(super) fn block(&self, id: &str) -> Option<&CodeBlock> {
        self.all.program().blocks.iter().find(|block| block.id.to_string() == id)
    }

    /// What the table of symbols says of one.
    pub(super) fn comment(&self, name: &str) -> &str {
        let found = self.all.program().symbols.iter().find(|symbol| symbol.name == name);
        found.map_or("", |symbol| symbol.comment.as_str())
    }

    /// Symbols by address, in the set.
    pub(super) const fn symbols(&self) -> &BTreeMap<String, String> {
        &self.symbols
    }

    pub(super) fn text(&self, id: BlockId) -> Option<&BlockText> {
        self.texts.get(&id.to_string())
    }

    /// The networks of a block, the empty ones too.
    pub(super) fn networks(&self, block: &CodeBlock) -> Arc<Vec<Drawable>> {
        if let Some((id, networks)) = &*self.networks.lock().unwrap_or_else(PoisonError::into_inner)
            && *id == block.id
        {
            return Arc::clone(networks);
        }
        let of_program = |id| self.all.program().blocks.iter().find(|block| block.id == id);
        let callees = |id| match of_program(id) {
            Some(block) => Some(&block.interface),
            None => self.library.get(id).map(|block| &block.interface),
        };
        let listing = self.text(block.id).map(|text| listing(block, &whole(text))).unwrap_or_default();
        let view = View { mnemonics: self.set, callees: &callees, symbols: &self.symbols, listing: &listing };
        let drawable = |network: Network| {
            let tree = read(&network);
            (network, tree)
        };
        let networks = Arc::new(view.networks(block).into_iter().map(drawable).collect::<Vec<_>>());
        *self.networks.lock().unwrap_or_else(PoisonError::into_inner) = Some((block.id, Arc::clone(&networks)));
        networks
    }

    /// Answers questions why a bit has its value.
    pub(super) fn known<T>(&self, ask: impl FnOnce(&Known<'_, Arc<Program>>) -> T) -> T {
        let line = |id, number| {
            let text = self.text(id).filter(|text| !text.file.is_empty())?;
            let at = text.lines.binary_search_by_key(&number, |line| line.0).ok()?;
            text.lines.get(at).map(|line| line.2.clone())
        };
        ask(&Known { all: &self.all, names: &self.names, line: &line, set: &|_| self.set })
    }
}

/// The lines of a file up to the block's end; those in front of the block are empty.
fn whole(text: &BlockText) -> Vec<&str> {
    let Some(last) = text.lines.last().map(|line| line.0 as usize) else { return Vec::new() };
    let mut lines = vec![""; last];
    for (number, _, line, _) in &text.lines {
        if let Some(place) = (*number as usize).checked_sub(1).and_then(|at| lines.get_mut(at)) {
            *place = line;
        }
    }
    lines
}
