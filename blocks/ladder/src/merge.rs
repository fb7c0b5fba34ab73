//! Two versions of a network as one tree: what is gone, what is new, what has another operand.

use crate::line::Writer;
use crate::network::Network;
use crate::number::renumber;
use crate::tree::{Body, BoxNode, End, Kind, Node, Rung, Tree};

/// What has become of a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mark {
    /// In both, with the same operands.
    #[default]
    Same,
    /// In the older one only; its names begin with `-`.
    Gone,
    /// In the newer one only; its names begin with `+`.
    Added,
}

/// Both versions, ready to be drawn as one.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The statements of the older one, then those of the newer.
    pub network: Network,
    /// Both trees as one. It is no network of anybody: statements do not follow from it.
    pub tree: Tree,
    /// What has become of each node, by its number.
    pub marks: Vec<Mark>,
}

/// Most parts that are compared one with the other.
const MOST: usize = 512;

/// One tree of two; `None`: they are the same.
pub fn merge(old: (&Network, &Tree), new: (&Network, &Tree)) -> Option<Merged> {
    let mut network = new.0.clone();
    let by = old.0.statements.len() as u32;
    network.statements = old.0.statements.iter().chain(&new.0.statements).cloned().collect();
    let mut newer = new.1.rungs.clone();
    newer.iter_mut().for_each(|rung| rung.shift(by));
    // The numbers of nodes are their marks until the end.
    let mut older = old.1.rungs.clone();
    older.iter_mut().chain(&mut newer).for_each(|rung| mark_rung(rung, 0));
    let both = network.clone();
    let mut merger = Merger { texts: Writer::new(&both), named: Vec::new() };
    let text = |rungs: &[Rung]| rungs.iter().map(|rung| merger.texts.rung(rung)).collect::<Vec<_>>();
    let (before, after) = (text(&older), text(&newer));
    if before == after {
        return None;
    }
    let rungs = merger.rungs(older, newer);
    let mut tree = Tree { rungs, nodes: 0, as_step7: new.1.as_step7 && old.1.as_step7 };
    let mut marks = Vec::new();
    renumber(&mut tree, &mut |id| {
        marks.push(match id {
            GONE => Mark::Gone,
            ADDED => Mark::Added,
            _ => Mark::Same,
        });
    });
    for (range, sign) in merger.named {
        for statement in network.statements.get_mut(range).unwrap_or_default() {
            for name in [&mut statement.operand, &mut statement.symbol] {
                if !name.is_empty() {
                    *name = format!("{sign}{name}");
                }
            }
            for actual in &mut statement.actuals {
                actual.text = format!("{sign}{}", actual.text);
            }
        }
    }
    Some(Merged { network, tree, marks })
}

const GONE: u32 = 1;
const ADDED: u32 = 2;

fn mark_rung(rung: &mut Rung, mark: u32) {
    if let Some(logic) = &mut rung.logic {
        mark_node(logic, mark);
    }
    rung.ends.iter_mut().for_each(|end| mark_end(end, mark));
}

fn mark_end(end: &mut End, mark: u32) {
    match end {
        End::Coil(coil) => coil.id = mark,
        End::Branch { id, arms, .. } => {
            *id = mark;
            arms.iter_mut().for_each(|arm| mark_rung(arm, mark));
        }
    }
}

fn mark_node(node: &mut Node, mark: u32) {
    node.id = mark;
    node.children_mut().into_iter().for_each(|child| mark_node(child, mark));
}

struct Merger<'n> {
    texts: Writer<'n>,
    /// Statements whose names get a sign.
    named: Vec<(std::ops::Range<usize>, char)>,
}

/// One part of two lists.
enum Pair<T> {
    Both(T, T),
    /// In one of them only: [`GONE`] or [`ADDED`].
    One(T, u32),
}

/// The longest common part of two lists by their texts; neighbours of which one is gone and one new are paired when
/// `alike` says so.
fn paired<T>(old: Vec<T>, new: Vec<T>, text: &dyn Fn(&T) -> String, alike: &dyn Fn(&T, &T) -> bool) -> Vec<Pair<T>> {
    let (a, b): (Vec<String>, Vec<String>) = (old.iter().map(text).collect(), new.iter().map(text).collect());
    let mut long = vec![vec![0usize; b.len() + 1]; a.len() + 1];
    if a.len() <= MOST && b.len() <= MOST {
        for i in (0..a.len()).rev() {
            for j in (0..b.len()).rev() {
                long[i][j] = if a[i] == b[j] { long[i + 1][j + 1] + 1 } else { long[i + 1][j].max(long[i][j + 1]) };
            }
        }
    }
    let (mut i, mut j, mut out) = (0, 0, Vec::new());
    let (mut old, mut new) = (old.into_iter(), new.into_iter());
    let (mut next_old, mut next_new) = (old.next(), new.next());
    while next_old.is_some() || next_new.is_some() {
        match (next_old.take(), next_new.take()) {
            (Some(one), Some(other)) if a[i] == b[j] || long[i][j] == long[i + 1][j + 1] && alike(&one, &other) => {
                out.push(Pair::Both(one, other));
                (i, j, next_old, next_new) = (i + 1, j + 1, old.next(), new.next());
            }
            (Some(one), other) if other.is_none() || long[i + 1][j] >= long[i][j + 1] => {
                out.push(Pair::One(one, GONE));
                (i, next_old, next_new) = (i + 1, old.next(), other);
            }
            (one, Some(other)) => {
                out.push(Pair::One(other, ADDED));
                (j, next_old, next_new) = (j + 1, one, new.next());
            }
            (Some(one), None) => {
                out.push(Pair::One(one, GONE));
                next_old = old.next();
            }
            (None, None) => {}
        }
    }
    out
}

/// Two parts that can be drawn as one with differences inside.
fn alike(one: &Node, other: &Node) -> bool {
    match (&one.kind, &other.kind) {
        (Kind::Series { .. }, Kind::Series { .. }) | (Kind::Parallel(_), Kind::Parallel(_)) => true,
        (Kind::Box(a), Kind::Box(b)) => same_box(a, b),
        _ => false,
    }
}

fn same_box(a: &BoxNode, b: &BoxNode) -> bool {
    a.used == b.used
        && match (&a.body, &b.body) {
            (Body::Latch { place: a, set_first: c, .. }, Body::Latch { place: b, set_first: d, .. }) => {
                a == b && c == d
            }
            (Body::Timer { time: a, start: c, outputs: e, .. }, Body::Timer { time: b, start: d, outputs: f, .. }) => {
                (&a.op, &c.op) == (&b.op, &d.op) && values(e) == values(f)
            }
            _ => false,
        }
}

fn values(outputs: &[Option<[crate::tree::Value; 2]>; 2]) -> Vec<Option<&ob1_ir::Op>> {
    outputs.iter().map(|output| output.as_ref().map(|[_, to]| &to.op)).collect()
}

impl Merger<'_> {
    /// The names of these statements get the sign of a mark.
    fn name(&mut self, statements: &std::ops::Range<u32>, mark: u32) {
        self.named.push((range(statements), if mark == GONE { '-' } else { '+' }));
    }

    fn one_node(&mut self, mut node: Node, mark: u32) -> Node {
        self.name(&node.statements, mark);
        mark_node(&mut node, mark);
        node
    }

    fn one_rung(&mut self, mut rung: Rung, mark: u32) -> Rung {
        mark_rung(&mut rung, mark);
        rung.logic.iter().for_each(|node| self.name(&node.statements, mark));
        rung.ends.iter().for_each(|end| self.name(&statements(end), mark));
        rung
    }

    /// Logic that a rung or pin may have.
    fn logic(&mut self, old: Option<Node>, new: Option<Node>) -> Option<Node> {
        match (old, new) {
            (Some(old), Some(new)) => Some(self.node(old, new)),
            (Some(old), None) => Some(self.one_node(old, GONE)),
            (None, new) => new.map(|new| self.one_node(new, ADDED)),
        }
    }

    fn rungs(&mut self, old: Vec<Rung>, new: Vec<Rung>) -> Vec<Rung> {
        let pairs = paired(old, new, &|rung| self.texts.rung(rung), &|_, _| true);
        let one = |pair| match pair {
            Pair::Both(old, new) => self.rung(old, new),
            Pair::One(rung, mark) => self.one_rung(rung, mark),
        };
        pairs.into_iter().map(one).collect()
    }

    fn rung(&mut self, old: Rung, new: Rung) -> Rung {
        let logic = self.logic(old.logic, new.logic);
        let both = |a: &End, b: &End| matches!((a, b), (End::Branch { .. }, End::Branch { .. }));
        let pairs = paired(old.ends, new.ends, &|end| self.texts.end(end), &both);
        let one = |pair| match pair {
            Pair::Both(End::Branch { arms: old, .. }, End::Branch { id, statements, carried, arms: new }) => {
                End::Branch { id, statements, carried, arms: self.rungs(old, new) }
            }
            Pair::Both(_, new) => new,
            Pair::One(mut end, mark) => {
                mark_end(&mut end, mark);
                self.name(&statements(&end), mark);
                end
            }
        };
        Rung { logic, ends: pairs.into_iter().map(one).collect() }
    }

    fn nodes(&mut self, old: Vec<Node>, new: Vec<Node>) -> Vec<Node> {
        let pairs = paired(old, new, &|node| self.texts.logic(node), &alike);
        let one = |pair| match pair {
            Pair::Both(old, new) => self.node(old, new),
            Pair::One(node, mark) => self.one_node(node, mark),
        };
        pairs.into_iter().map(one).collect()
    }

    fn node(&mut self, old: Node, new: Node) -> Node {
        if self.texts.logic(&old) == self.texts.logic(&new) {
            return new;
        }
        let Node { id, statements, kind } = new;
        let put = |kind| Node { id, statements: statements.clone(), kind };
        match (old.kind, kind) {
            (Kind::Parallel(old), Kind::Parallel(new)) => put(Kind::Parallel(self.nodes(old, new))),
            (Kind::Box(old), Kind::Box(new)) if same_box(&old, &new) => {
                put(Kind::Box(Box::new(self.boxed(*old, *new))))
            }
            (one, other) => {
                let one = Node { id: 0, statements: old.statements, kind: one };
                let (items, bare) = (self.nodes(list(one), list(put(other))), false);
                put(Kind::Series { items, bare })
            }
        }
    }

    fn boxed(&mut self, old: BoxNode, new: BoxNode) -> BoxNode {
        let BoxNode { input, body, used } = new;
        let input = self.logic(old.input, input);
        let body = match (old.body, body) {
            (Body::Latch { second: old, .. }, Body::Latch { place, set_first, second }) => {
                Body::Latch { place, set_first, second: self.logic(old, second) }
            }
            (Body::Timer { reset: old, .. }, Body::Timer { time, start, reset, outputs }) => {
                Body::Timer { time, start, reset: self.logic(old, reset), outputs }
            }
            (_, body) => body,
        };
        BoxNode { input, body, used }
    }
}

/// A series as its items, anything else as one.
fn list(node: Node) -> Vec<Node> {
    match node.kind {
        Kind::Series { items, .. } => items,
        _ => vec![node],
    }
}

fn range(statements: &std::ops::Range<u32>) -> std::ops::Range<usize> {
    statements.start as usize..statements.end as usize
}

fn statements(end: &End) -> std::ops::Range<u32> {
    match end {
        End::Coil(coil) => coil.statements.clone(),
        End::Branch { statements, .. } => statements.clone(),
    }
}
