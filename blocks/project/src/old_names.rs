//! Names and comments of an old project for blocks that were read out of a CPU, which keeps none.
//!
//! A block that is the same as one of the project takes all of it. For any other the nearest is a guess, and is told:
//! the block of its number. Declarations that say something else than the compiled interface are held against that by
//! [`translate`](crate::translate), which keeps their names as far as the types agree.

use std::collections::{BTreeMap, BTreeSet};

use ob1_mc7::{CompiledInterface, InterfaceKind, Segments};
use ob1_model::{BlockId, BlockKind};

use crate::comments::{Comments, Network};
use crate::folder::{Block, Folder};
use crate::note::{Note, Notes};

/// Shorter machine code says nothing about which block it is: `BE` alone, or a call.
const TELLING: usize = 12;
/// More comparisons of networks than this are not made: STEP 7 has at most 999 networks in a block.
const LARGEST: usize = 4_000_000;

const NO_SUCH_BLOCK: &str = "the old project has no such block: it has no names";

/// What an old project says about the blocks of a CPU.
#[derive(Clone, Debug, Default)]
pub struct OldNames {
    /// Which block of the project each block took its names from.
    pub taken: BTreeMap<BlockId, BlockId>,
    /// Each guess, and each block without names.
    pub notes: Notes,
}

impl Folder {
    /// Lays names, comments and types of an old project's folder over blocks that have none.
    pub fn take_names(&mut self, old: &Folder) -> OldNames {
        let mut out = OldNames::default();
        self.udts.clone_from(&old.udts);
        let own: Vec<BlockId> = self.blocks.keys().copied().filter(|id| !id.kind.is_system()).collect();
        let is_same = |id: &BlockId, other: &Block| self.blocks.get(id).is_some_and(|block| same(block, other));
        let kept: BTreeSet<BlockId> =
            own.iter().copied().filter(|id| old.blocks.get(id).is_some_and(|other| is_same(id, other))).collect();
        let mut sources: BTreeMap<BlockId, (BlockId, bool)> = kept.iter().map(|id| (*id, (*id, true))).collect();
        for id in own.iter().filter(|id| !kept.contains(id)) {
            // One that has moved: the same block under one other number, which no block has kept.
            let moved = old.blocks.iter().filter(|(other, block)| {
                other.kind == id.kind && !kept.contains(other) && block.code.len() >= TELLING && is_same(id, block)
            });
            let moved: Vec<BlockId> = moved.map(|(other, _)| *other).collect();
            match moved.as_slice() {
                [one] => drop(sources.insert(*id, (*one, true))),
                _ if old.blocks.contains_key(id) => drop(sources.insert(*id, (*id, false))),
                _ => out.notes.push(Note::warning(id.to_string(), NO_SUCH_BLOCK)),
            }
        }
        for (id, (from, is_same)) in sources {
            let (Some(block), Some(other)) = (self.blocks.get_mut(&id), old.blocks.get(&from)) else { continue };
            let guess = match (is_same, from == id) {
                (true, true) => None,
                (true, false) => Some(format!("it is the same as {from} of the old project, whose names it has")),
                (false, _) => match resembles(block, other) {
                    Some(how) => Some(how),
                    None => {
                        let told = "the old project has another block of this number: it has no names";
                        out.notes.push(Note::warning(id.to_string(), told));
                        continue;
                    }
                },
            };
            out.notes.extend(guess.map(|guess| Note::warning(id.to_string(), guess)));
            block.comments = if is_same { other.comments.clone() } else { comments_alike(block, other) };
            block.declarations.clone_from(&other.declarations);
            out.taken.insert(id, from);
        }
        out
    }
}

/// The values of a data block change as long as the CPU runs. What differs most often is compared first.
fn same(block: &Block, other: &Block) -> bool {
    let code = if block.id.kind == BlockKind::Db {
        block.code.len() == other.code.len()
    } else {
        (&block.code, &block.segments) == (&other.code, &other.segments)
    };
    code && declares_the_same(block, other)
}

/// The same compiled interface, but for the block's own number in it.
fn declares_the_same(block: &Block, other: &Block) -> bool {
    let read = |block: &Block| {
        let mut compiled = CompiledInterface::read(&block.interface).ok()?;
        if matches!(compiled.kind, InterfaceKind::Code | InterfaceKind::Global) {
            compiled.number = 0;
        }
        Some(compiled)
    };
    block.interface == other.interface || read(block).is_some_and(|mine| read(other) == Some(mine))
}

/// In what a changed block is still the old one; `None`: in nothing.
fn resembles(block: &Block, other: &Block) -> Option<String> {
    let alike = declares_the_same(block, other);
    let interface = if alike { "the same declarations" } else { "other declarations" };
    if block.id.kind == BlockKind::Db {
        // Of a structure that has changed, the components in front of the change.
        return Some(format!("it has changed since the old project ({interface}): names as far as the types agree"));
    }
    let (mine, theirs) = (networks(block), networks(other));
    let equal = pairs(&mine, &theirs).len();
    (equal > 0 || alike).then(|| {
        let of = mine.len();
        format!("it has changed since the old project: {interface}, {equal} of {of} networks as they were")
    })
}

/// The machine code of each network; of one table that does not fit, the whole block.
fn networks(block: &Block) -> Vec<&[u8]> {
    let segments = Segments::read(&block.segments).unwrap_or_default();
    let mut rest = block.code.as_slice();
    let mut parts = Vec::with_capacity(segments.networks.len());
    for length in &segments.networks {
        let Some((part, behind)) = rest.split_at_checked(usize::from(*length)) else { return vec![&block.code] };
        parts.push(part);
        rest = behind;
    }
    parts
}

/// Networks that are in both, in order: the longest common sequence.
fn pairs(mine: &[&[u8]], theirs: &[&[u8]]) -> Vec<(usize, usize)> {
    let is_telling = |a: usize, b: usize| mine[a] == theirs[b] && !mine[a].is_empty();
    let width = theirs.len() + 1;
    if mine.len().saturating_mul(width) > LARGEST {
        return (0..mine.len().min(theirs.len())).filter(|at| is_telling(*at, *at)).map(|at| (at, at)).collect();
    }
    let mut longest = vec![0u32; (mine.len() + 1) * width];
    for a in (0..mine.len()).rev() {
        for b in (0..theirs.len()).rev() {
            longest[a * width + b] = if is_telling(a, b) {
                longest[(a + 1) * width + b + 1] + 1
            } else {
                longest[(a + 1) * width + b].max(longest[a * width + b + 1])
            };
        }
    }
    let (mut a, mut b, mut found) = (0, 0, Vec::new());
    while a < mine.len() && b < theirs.len() {
        if is_telling(a, b) && longest[a * width + b] == longest[(a + 1) * width + b + 1] + 1 {
            found.push((a, b));
            (a, b) = (a + 1, b + 1);
        } else if longest[(a + 1) * width + b] >= longest[a * width + b + 1] {
            a += 1;
        } else {
            b += 1;
        }
    }
    found
}

/// The comments of the networks that are as they were, and titles of those that stand alone between two such.
fn comments_alike(block: &Block, other: &Block) -> Comments {
    let (mine, theirs) = (networks(block), networks(other));
    let equal = pairs(&mine, &theirs);
    let from = |at: usize| other.comments.networks.get(at).cloned().unwrap_or_default();
    let mut made = vec![Network::default(); mine.len()];
    let ends = [(mine.len(), theirs.len())];
    let mut before = (0, 0);
    for (a, b) in equal.iter().chain(&ends).copied() {
        // As many in between as there were: changed ones, in their places.
        if a - before.0 == b - before.1 {
            for (at, of) in (before.0..a).zip(before.1..b) {
                made[at] = Network { lines: Vec::new(), ..from(of) };
            }
        }
        if a < mine.len() {
            made[a] = from(b);
        }
        before = (a + 1, b + 1);
    }
    Comments {
        title: other.comments.title.clone(),
        comment: other.comments.comment.clone(),
        networks: made,
        labels: labels_alike(block, other, &equal),
        damaged: other.comments.damaged,
    }
}

/// The labels of jumps in networks that are as they were: the jump at the same place of its network.
fn labels_alike(block: &Block, other: &Block, equal: &[(usize, usize)]) -> Vec<String> {
    let (mine, theirs) = (networks(block), networks(other));
    let begins = |parts: &[&[u8]], at: usize| parts.iter().take(at).map(|part| part.len()).sum::<usize>();
    let jumps = |block: &Block| Segments::read(&block.segments).unwrap_or_default().jumps;
    let old: BTreeMap<usize, &String> =
        jumps(other).iter().map(|word| usize::from(*word) * 2).zip(&other.comments.labels).collect();
    let of = |place: usize| {
        let (a, b) = equal.iter().find(|(a, _)| {
            let start = begins(&mine, *a);
            (start..start + mine[*a].len()).contains(&place)
        })?;
        Some((*old.get(&(begins(&theirs, *b) + place - begins(&mine, *a)))?).clone())
    };
    jumps(block).iter().map(|word| of(usize::from(*word) * 2).unwrap_or_default()).collect()
}
