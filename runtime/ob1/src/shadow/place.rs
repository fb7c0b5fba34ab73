//! Where a difference begins: of the cells that differ, those that are made of equal ones.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use ob1_cpu::{Cell, Width};
use ob1_ir::Program;
use ob1_model::BlockId;
use ob1_stl::{Access, CrossReference, Match, Reference};

use super::subject::Watched;

/// A statement whose result differs though what its network reads is equal.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Origin {
    pub(crate) block: BlockId,
    pub(crate) network: u16,
    pub(crate) line: u32,
    /// The operand that it writes.
    pub(crate) operand: String,
    /// Block, network, file and line.
    pub(crate) place: String,
}

type Network = (BlockId, u16);

/// Which networks write a cell, and which cells they read.
pub(crate) struct Wiring {
    /// For each cell the statements that write it.
    writers: Vec<BTreeSet<Origin>>,
    /// For each cell the networks with them; those of a call, whose block writes it, are those of the call.
    written: Vec<BTreeSet<Network>>,
    reads: BTreeMap<Network, BTreeSet<usize>>,
    /// Whether no reading tells the state of a cell: a timer's rest does not say what `U T` gives, and a pulse of one
    /// scan is over before anybody looks.
    hidden: Vec<bool>,
}

impl Wiring {
    pub(crate) fn new(xref: &CrossReference<Arc<Program>>, cells: &[Watched]) -> Self {
        let mut reads: BTreeMap<Network, BTreeSet<usize>> = BTreeMap::new();
        let (mut writers, mut written) = (Vec::new(), Vec::<BTreeSet<Network>>::new());
        for (cell, watched) in cells.iter().enumerate() {
            let (mut here, mut networks) = (BTreeSet::new(), BTreeSet::new());
            let uses = xref.find(&watched.item.name).map(|uses| uses.found).unwrap_or_default();
            for (how, reference) in uses {
                let network = (reference.block, reference.network);
                if matches!(reference.access, Access::Read | Access::ReadWrite) {
                    reads.entry(network).or_default().insert(cell);
                }
                if how != Match::Possible && reference.writes() {
                    networks.insert(network);
                    let within = within(xref, reference);
                    let inner = within.iter().map(|reference| origin(xref, reference));
                    here.extend(inner.chain(within.is_empty().then(|| origin(xref, reference))));
                }
            }
            writers.push(here);
            written.push(networks);
        }
        // Edge bits are read and written by one statement.
        let edges: BTreeSet<Network> = xref
            .all
            .iter()
            .filter(|reference| reference.access == Access::ReadWrite && reference.via.is_none())
            .map(|reference| (reference.block, reference.network))
            .collect();
        let is_hidden = |(watched, networks): (&Watched, &BTreeSet<Network>)| match watched.item.cell {
            Cell::Timer(_) => true,
            _ => watched.item.width == Width::Bit && networks.iter().any(|network| edges.contains(network)),
        };
        let hidden = cells.iter().zip(&written).map(is_hidden).collect();
        Self { writers, written, reads, hidden }
    }

    /// What is read in the networks that write a cell, itself apart.
    fn read_for(&self, cell: usize) -> impl Iterator<Item = usize> {
        let networks = self.written.get(cell).into_iter().flatten();
        networks.filter_map(|network| self.reads.get(network)).flatten().copied().filter(move |other| *other != cell)
    }

    /// All cells that this one is made of, however far back.
    pub(crate) fn leading_to(&self, cell: usize) -> BTreeSet<usize> {
        self.reached(cell, |_| true)
    }

    /// This cell, and those that it is made of as long as they may be followed.
    fn reached(&self, cell: usize, follow: impl Fn(usize) -> bool) -> BTreeSet<usize> {
        let (mut seen, mut open) = (BTreeSet::new(), vec![cell]);
        while let Some(cell) = open.pop() {
            if seen.insert(cell) {
                open.extend(self.read_for(cell).filter(|other| follow(*other)));
            }
        }
        seen
    }

    /// The statements where the difference of a cell begins. Where its network reads what cannot be seen, those that
    /// write that come first.
    pub(crate) fn origins(&self, cell: usize, differing: &BTreeSet<usize>) -> Vec<Origin> {
        let is_hidden = |cell: usize| self.hidden.get(cell) == Some(&true);
        let begins = |cell: &usize| !self.read_for(*cell).any(|other| differing.contains(&other));
        let differs = self.reached(cell, |other| differing.contains(&other));
        let first: BTreeSet<usize> = differs.iter().copied().filter(begins).collect();
        let first = if first.is_empty() { differs } else { first };
        let before: BTreeSet<usize> = first
            .iter()
            .flat_map(|cell| self.reached(*cell, is_hidden))
            .filter(|cell| is_hidden(*cell) && !first.contains(cell))
            .collect();
        let of = |cells: &BTreeSet<usize>| -> BTreeSet<Origin> {
            cells.iter().filter_map(|cell| self.writers.get(*cell)).flatten().cloned().collect()
        };
        let (before, first) = (of(&before), of(&first));
        let rest = first.difference(&before).cloned().collect::<Vec<_>>();
        before.into_iter().chain(rest).collect()
    }
}

/// The statements of a called block that write the formal an operand is supplied to.
fn within<'x>(xref: &'x CrossReference<Arc<Program>>, call: &Reference) -> Vec<&'x Reference> {
    let Some((block, formal)) = call.via.as_deref().and_then(|via| via.split_once('.')) else { return Vec::new() };
    let name = format!("#{formal}");
    let writes = |reference: &&Reference| {
        reference.writes() && reference.operand.ends_with(&name) && reference.block.to_string() == block
    };
    xref.all.iter().filter(writes).collect()
}

fn origin(xref: &CrossReference<Arc<Program>>, reference: &Reference) -> Origin {
    Origin {
        block: reference.block,
        network: reference.network,
        line: reference.line,
        operand: reference.operand.clone(),
        place: reference.place(xref.program()),
    }
}
