//! Why a bit has its value: which of the bits that a pass through a block has scanned decide it.
//!
//! The pass is run again on paper ([`replay`]), each time with one of these bits the other way. What a recorded pass
//! does not tell, such as the value an operand had before, is unknown there, and nothing is said on it.

mod replay;

use ob1_model::PassLine;

use crate::call::Call;
use crate::op::{BitTest, Op};
use crate::place::{Number, Place};
use crate::program::Stmt;
use replay::{Flip, Replay};

/// Scanned bits that are tried, at most: each is a run through the block.
const TRIED: usize = 512;

/// A pass through a block.
#[derive(Clone, Copy)]
pub struct Observed<'p> {
    /// The statements of the block.
    pub code: &'p [Stmt],
    /// The registers behind each of them.
    pub lines: &'p [PassLine],
    /// Whether a call may write what a statement behind it scans.
    pub disturbs: &'p dyn Fn(&Call, &BitTest) -> bool,
}

/// What decides a bit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Why {
    /// The statement that has given the bit its value last, or would have: of `S` and `R` that had no effect the last.
    pub writer: Option<usize>,
    /// It gave the bit its value: `=`, or `S` and `R` with RLO 1.
    pub took_effect: bool,
    /// The statements that scan in the chain of the writer, in their order, each with the bit it found.
    pub terms: Vec<Term>,
    /// The scans whose bit, the other way at the begin of the pass, gives the other value, each for itself.
    pub decisive: Vec<Term>,
    /// There may be more of these: what follows from some bit is not known.
    pub is_open: bool,
}

/// A scan that the pass has made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Term {
    /// Index of the statement in the block.
    pub statement: usize,
    /// The bit that it found.
    pub bit: bool,
    /// With its bit the other way, and all others as they are, the chain gives the other result.
    pub turns: bool,
    /// The statement of this pass that had given the bit its value.
    pub written_by: Option<usize>,
}

/// Why a statement was not reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skipped {
    /// By this jump, or the end of the block at this statement.
    By(usize),
    /// Nothing of the block ran.
    NotCalled,
}

impl Observed<'_> {
    /// Why `place` has the value `now` behind the pass. None: no statement that ran writes it by its address.
    pub fn why(&self, place: Place, now: bool) -> Option<Why> {
        let writes = |at: &usize| self.ran(*at) && written(self.code.get(*at).map(|stmt| &stmt.op)) == Some(place);
        let writers: Vec<usize> = (0..self.code.len()).filter(writes).collect();
        let effective = |at: &&usize| match self.code.get(**at).map(|stmt| &stmt.op) {
            Some(Op::Set(_) | Op::Reset(_)) => self.rlo_before(**at),
            _ => true,
        };
        let took = writers.iter().rev().find(effective).copied();
        let writer = took.or_else(|| writers.last().copied())?;
        let mut why = Why { writer: Some(writer), took_effect: took.is_some(), ..Why::default() };
        why.terms = self.terms(writer);
        let end = self.code.len();
        // A writer that was jumped over may run with another bit in front of it.
        let all = self.code.iter().rposition(|stmt| written(Some(&stmt.op)) == Some(place));
        let last = all.unwrap_or(writer);
        if self.loops(last) {
            why.is_open = true;
            return Some(why);
        }
        let tried = self.scans(last);
        why.is_open = tried.len() > TRIED || Replay::new(self, place, now).run(end, &[]) != Some(now);
        if why.is_open {
            return Some(why);
        }
        for at in tried {
            let Some(flip) = self.test(at).map(Flip::Everywhere) else { continue };
            match Replay::new(self, place, now).run(end, &[flip]) {
                None => why.is_open = true,
                Some(value) if value != now => {
                    let term = Term { statement: at, bit: self.bit(at), turns: true, written_by: None };
                    why.decisive.push(term);
                }
                Some(_) => {}
            }
        }
        Some(why)
    }

    /// The scans that give the RLO in front of a statement, and which of them turn it.
    pub fn terms(&self, statement: usize) -> Vec<Term> {
        let first = self.chain_begin(statement);
        let scans = (first..statement).filter(|at| self.ran(*at) && self.test(*at).is_some());
        let usual = Replay::rlo(self, statement, &[]);
        let term = |at: usize| {
            let other = if self.loops(statement) { None } else { Replay::rlo(self, statement, &[Flip::Here(at)]) };
            let written_by = match self.test(at) {
                Some(BitTest::Bit(place)) => self.last_writer(place, at),
                _ => None,
            };
            let turns = usual.is_some() && other.is_some() && other != usual;
            Term { statement: at, bit: self.bit(at), turns, written_by }
        };
        scans.map(term).collect()
    }

    /// Why a statement was not reached.
    pub fn skipped(&self, statement: usize) -> Skipped {
        // What ran last in front of it leads away from here.
        let last = (0..statement.min(self.code.len())).rev().find(|at| self.ran(*at));
        last.map_or(Skipped::NotCalled, Skipped::By)
    }

    /// The statement of this pass that wrote a bit last in front of another.
    fn last_writer(&self, place: Place, before: usize) -> Option<usize> {
        let effective = |at: &usize| match self.code.get(*at).map(|stmt| &stmt.op) {
            Some(op @ (Op::Set(_) | Op::Reset(_))) => written(Some(op)) == Some(place) && self.rlo_before(*at),
            op => written(op) == Some(place),
        };
        (0..before).rev().find(|at| self.ran(*at) && effective(at))
    }

    /// The first statement of the chain that ends in front of this one.
    fn chain_begin(&self, statement: usize) -> usize {
        let (mut at, mut depth) = (statement, 0u32);
        while at > 0 {
            let before = at - 1;
            match self.code.get(before).map(|stmt| &stmt.op) {
                _ if !self.ran(before) => {}
                Some(Op::Close) => depth += 1,
                Some(Op::Open { .. }) => depth = depth.saturating_sub(1),
                // The first scan of an OR branch has no /FC, but its chain has begun before.
                Some(Op::OrBranch | Op::NotRlo | Op::EdgePositive(_) | Op::EdgeNegative(_)) => {}
                Some(op) if depth == 0 && ends_chain(op) => return at,
                _ => {}
            }
            at = before;
        }
        0
    }

    /// The scans up to a statement whose bits nothing in this pass had written, each operand once.
    fn scans(&self, upto: usize) -> Vec<usize> {
        let mut seen: Vec<BitTest> = Vec::new();
        let mut all = Vec::new();
        for at in (0..upto).filter(|at| self.ran(*at)) {
            let Some(test) = self.test(at) else { continue };
            let is_own = match test {
                BitTest::Bit(place) => is_plain(place) && self.last_writer(place, at).is_none(),
                BitTest::Timer(Number::Fixed(_)) | BitTest::Counter(Number::Fixed(_)) => true,
                _ => false,
            };
            if is_own && !seen.contains(&test) {
                seen.push(test);
                all.push(at);
            }
        }
        all
    }

    fn test(&self, at: usize) -> Option<BitTest> {
        match self.code.get(at)?.op {
            Op::Scan { test, .. } => Some(test),
            _ => None,
        }
    }

    fn ran(&self, at: usize) -> bool {
        self.lines.get(at).is_some_and(|line| line.times > 0)
    }

    /// Whether a statement up to this one ran more than once: only its last round is known.
    fn loops(&self, upto: usize) -> bool {
        self.lines.iter().take(upto + 1).any(|line| line.times > 1)
    }

    /// The bit that a scan found.
    fn bit(&self, at: usize) -> bool {
        self.lines.get(at).is_some_and(|line| line.status & STA != 0)
    }

    /// The RLO in front of a statement.
    fn rlo_before(&self, at: usize) -> bool {
        let before = (0..at).rev().find(|before| self.ran(*before)).and_then(|before| self.lines.get(before));
        before.is_some_and(|line| line.status & RLO != 0)
    }
}

/// Bits of the status word, as [`PassLine::status`] has them.
const FC: u16 = 1;
const RLO: u16 = 1 << 1;
const STA: u16 = 1 << 2;

/// The bit that a statement of bit logic gives a value.
const fn written(op: Option<&Op>) -> Option<Place> {
    match op {
        Some(Op::Assign(place) | Op::Set(place) | Op::Reset(place)) => Some(*place),
        _ => None,
    }
}

/// A place that is the same one each time it is named.
const fn is_plain(place: Place) -> bool {
    !matches!(place, Place::Memory(..) | Place::Register(..))
}

/// Statements behind which a chain of bit logic begins anew.
const fn ends_chain(op: &Op) -> bool {
    matches!(
        op,
        Op::Assign(_)
            | Op::Set(_)
            | Op::Reset(_)
            | Op::SetRlo
            | Op::ClearRlo
            | Op::Jump(..)
            | Op::Loop(_)
            | Op::JumpList { .. }
            | Op::Call(_)
            | Op::EndIf
            | Op::StartTimer(..)
            | Op::ResetTimer(_)
            | Op::EnableTimer(_)
            | Op::CountUp(_)
            | Op::CountDown(_)
            | Op::SetCounter(_)
            | Op::ResetCounter(_)
            | Op::EnableCounter(_)
            | Op::TransferStatus
            | Op::McrOpen
            | Op::McrClose
    )
}
