//! Numbers the nodes of a tree in the order of their first statements, so that whoever draws, colours and compares
//! them means the same.

use crate::tree::{End, Node, Rung, Tree};

pub(crate) fn number(tree: &mut Tree) {
    renumber(tree, &mut |_| {});
}

/// The same; `seen` gets the number each node had, in the order of the new ones.
pub(crate) fn renumber(tree: &mut Tree, seen: &mut dyn FnMut(u32)) {
    let mut next = 0;
    let mut take = |id: &mut u32| {
        seen(*id);
        *id = next;
        next += 1;
    };
    tree.rungs.iter_mut().for_each(|rung| of_rung(rung, &mut take));
    tree.nodes = next;
}

fn of_rung(rung: &mut Rung, take: &mut dyn FnMut(&mut u32)) {
    if let Some(node) = &mut rung.logic {
        of_node(node, take);
    }
    for end in &mut rung.ends {
        match end {
            End::Coil(coil) => take(&mut coil.id),
            End::Branch { id, arms, .. } => {
                take(id);
                arms.iter_mut().for_each(|arm| of_rung(arm, take));
            }
        }
    }
}

fn of_node(node: &mut Node, take: &mut dyn FnMut(&mut u32)) {
    take(&mut node.id);
    node.children_mut().into_iter().for_each(|child| of_node(child, take));
}
