//! What a listing shows besides the statements: labels, titles and comments of the project.

use std::collections::BTreeMap;

use ob1_mc7::{Decoded, Segments};
use ob1_stl::print::Listing;

use crate::folder::Block;

/// The listing of a block.
pub(crate) fn of(block: &Block, decoded: &Decoded) -> Listing {
    let segments = Segments::read(&block.segments).unwrap_or_default();
    let networks = &block.comments.networks;
    let mut listing = Listing {
        labels: decoded.labels(&segments, &block.comments.labels),
        notations: decoded.notations.clone(),
        networks: networks.iter().map(|n| (n.title.clone(), n.comment.clone())).collect(),
        ..Listing::default()
    };
    // The operation each statement of a network begins with, in order.
    let mut begins: BTreeMap<u16, Vec<u32>> = BTreeMap::new();
    let mut last = None;
    for ((index, stmt), shown) in (0u32..).zip(&decoded.block.code).zip(&decoded.shown) {
        if last != Some(*shown) {
            begins.entry(stmt.network).or_default().push(index);
            last = Some(*shown);
        }
    }
    for (number, network) in (1u16..).zip(networks) {
        let Some(begins) = begins.get(&number) else { continue };
        for line in network.lines.iter().filter(|line| !line.text.is_empty()) {
            let at = line.statement as usize;
            let text = line.text.trim_end().to_owned();
            if line.behind {
                if let Some(index) = at.checked_sub(1).and_then(|at| begins.get(at)) {
                    listing.beside.entry(*index).or_insert(text);
                }
            } else if let Some(index) = begins.get(at.min(begins.len().saturating_sub(1))) {
                listing.before.entry(*index).or_default().push(text);
            }
        }
    }
    listing
}
