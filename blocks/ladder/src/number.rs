//! Numbers the nodes of a tree in the order of their first statements, so that whoever draws, colours and compares
//! them means the same.

use crate::tree::{End, Node, Rung, Tree};

pub(crate) fn number(tree: &mut Tree) {
    let mut next = 0;
    tree.rungs.iter_mut().for_each(|rung| of_rung(rung, &mut next));
    tree.nodes = next;
}

fn of_rung(rung: &mut Rung, next: &mut u32) {
    if let Some(node) = &mut rung.logic {
        of_node(node, next);
    }
    for end in &mut rung.ends {
        match end {
            End::Coil(coil) => coil.id = take(next),
            End::Branch { id, arms, .. } => {
                *id = take(next);
                arms.iter_mut().for_each(|arm| of_rung(arm, next));
            }
        }
    }
}

fn of_node(node: &mut Node, next: &mut u32) {
    node.id = take(next);
    node.children_mut().into_iter().for_each(|child| of_node(child, next));
}

fn take(next: &mut u32) -> u32 {
    let id = *next;
    *next += 1;
    id
}
