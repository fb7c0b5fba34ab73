//! Which trees a ladder can show.
//!
//! In a ladder everything that is in series takes what comes from the left. So a NOT, an edge or a connector in a leg
//! that begins behind something else would act on more than its statement does; a box that has logic of its own at its
//! first input would get more. A function plan shows each of these as it is.

use crate::tree::{End, Kind, Node, Rung, Tree};

/// A ladder says the same as the statements.
pub fn is_ladder(tree: &Tree) -> bool {
    tree.rungs.iter().all(rung)
}

fn rung(rung: &Rung) -> bool {
    let ends = rung.ends.iter().all(|end| match end {
        End::Coil(_) => true,
        End::Branch { arms, .. } => arms.iter().all(self::rung),
    });
    ends && rung.logic.as_ref().is_none_or(|logic| node(logic, true))
}

/// `begins`: nothing stands before it but a rail or a branch.
fn node(this: &Node, begins: bool) -> bool {
    match &this.kind {
        Kind::Contact { .. } | Kind::Compare { .. } => true,
        Kind::Wire { .. } | Kind::Not | Kind::Edge { .. } | Kind::Connector(_) => begins,
        Kind::Series { items, .. } => items.iter().enumerate().all(|(at, item)| {
            let acts = matches!(item.kind, Kind::Not | Kind::Edge { .. } | Kind::Connector(_));
            node(item, begins && (at == 0 || acts))
        }),
        Kind::Parallel(legs) => legs.iter().all(|leg| node(leg, begins)),
        Kind::Negated(_) | Kind::Xor(_) => false,
        Kind::Box(_) => begins && this.children().into_iter().all(|child| node(child, true)),
    }
}
