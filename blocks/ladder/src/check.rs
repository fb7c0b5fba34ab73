//! The safety rule: a network is drawn only if generating its tree gives back the same statements.

use ob1_ir::{Jump, Op};

use crate::generate::{Made, generate};
use crate::network::{Network, Statement};
use crate::not_drawn::Reason;
use crate::parse::{Mode, parse};
use crate::tree::Tree;

/// The tree of a network, as STEP 7 would draw it; where it would not, as its statements can be drawn all the same.
///
/// # Errors
/// [`Reason`]: the first thing that no drawing has, so that the network stays statements.
pub fn read(network: &Network) -> Result<Tree, Reason> {
    let first = match checked(network, Mode::Step7) {
        Ok(tree) => return Ok(tree),
        Err(reason) => reason,
    };
    // What STEP 7 would say of it is worth more, unless reading got further without its marks.
    checked(network, Mode::ByHand).map_err(|reason| first.later(reason))
}

/// The tree of a network, only if STEP 7 would draw it.
///
/// # Errors
/// [`Reason`]: the first thing that STEP 7 would not draw.
pub fn read_step7(network: &Network) -> Result<Tree, Reason> {
    checked(network, Mode::Step7)
}

fn checked(network: &Network, mode: Mode) -> Result<Tree, Reason> {
    if network.is_empty() {
        return Ok(Tree { rungs: Vec::new(), nodes: 0, as_step7: true });
    }
    let tree = parse(network, mode)?;
    match difference(&generate(&tree), network, mode) {
        None => Ok(tree),
        Some(statement) => Err(Reason { statement, what: "the editor would write it otherwise" }),
    }
}

/// The first statement that differs.
fn difference(made: &[Made], network: &Network, mode: Mode) -> Option<u32> {
    let counts = |op: &Op| mode == Mode::Step7 || !matches!(op, Op::Nop | Op::Build(_));
    // A leading NOP 0 carries the label.
    let named = mode == Mode::Step7 && network.statements.len() > 1 && !network.label.is_empty();
    let skipped = usize::from(named && network.statements.first().is_some_and(|s| s.op == Op::Nop));
    let theirs: Vec<(usize, &Statement)> =
        network.statements.iter().enumerate().skip(skipped).filter(|(_, s)| counts(&s.op)).collect();
    let ours: Vec<(usize, &Made)> = made.iter().enumerate().filter(|(_, made)| counts(&made.op)).collect();
    let end = network.statements.last().map_or(0, |statement| statement.ops.end);
    let same = |(_, theirs): &(usize, &Statement), (_, made): &(usize, &Made)| match (&theirs.op, &made.op, made.to) {
        (Op::Jump(Jump::IfNotRloSaveBr, to), Op::Jump(Jump::IfNotRloSaveBr, _), Some(made_to)) => {
            // Where both lead: to the same one of the statements that count.
            let ours_at = ours.partition_point(|(at, _)| *at < made_to);
            let from = network.at_op(*to).map_or(theirs_end(*to, end), |at| at as usize);
            ours_at == theirs_at(network, skipped, from, &counts)
        }
        (a, b, _) => a == b,
    };
    let differs = theirs.iter().zip(&ours).find(|(theirs, ours)| !same(theirs, ours));
    let place = |at: usize| at as u32;
    match differs {
        Some(((at, _), _)) => Some(place(*at)),
        None if theirs.len() > ours.len() => theirs.get(ours.len()).map(|(at, _)| place(*at)),
        None if theirs.len() < ours.len() => Some(place(network.statements.len().saturating_sub(1))),
        None => None,
    }
}

/// A target behind the last statement.
const fn theirs_end(to: u32, end: u32) -> usize {
    if to == end { usize::MAX } else { 0 }
}

/// How many statements that count stand before this one.
fn theirs_at(network: &Network, skipped: usize, from: usize, counts: &dyn Fn(&Op) -> bool) -> usize {
    let all = network.statements.iter().enumerate().skip(skipped);
    all.take_while(|(at, _)| *at < from).filter(|(_, statement)| counts(&statement.op)).count()
}
