//! The judge: automata written from the manuals, which know no code of the project.
//!
//! A rule has a name, and each finding says by which line of the manual. What a judge sees: each call of a handling
//! block with the parameters before and after it, what happened from outside, and what arrived at the partner.

pub mod cp240;

use std::fmt;

use ob1_cpu::{Cpu, OperatingState};
use ob1_time::Instant;

use super::record::Call;
use super::run::Deed;
use super::text::Site;

/// A scan as the judge sees it.
#[derive(Debug)]
pub struct Scan<'a> {
    /// Its start.
    pub now: Instant,
    /// The calls in their order.
    pub calls: &'a [Call],
    /// The places in the program.
    pub sites: &'a [Site],
    /// State of the CPU after it.
    pub state: OperatingState,
}

/// A judge of the programs of one CP with partner `P`.
pub trait Judge<P> {
    /// Looks at a scan, and at the partner at its end.
    fn scan(&mut self, scan: &Scan<'_>, cpu: &mut Cpu, partner: &mut P, verdict: &mut Verdict);

    /// Something happens from outside.
    fn deed(&mut self, now: Instant, deed: &Deed);

    /// Nothing is open any more: a run whose plan is over may end.
    fn is_over(&self, _now: Instant) -> bool {
        false
    }

    /// The run ends.
    fn end(&mut self, now: Instant, partner: &mut P, verdict: &mut Verdict);
}

/// A violated rule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Its name, for example `fc0-end`.
    pub rule: &'static str,
    /// When.
    pub at: Instant,
    /// What was seen, with the manual's line.
    pub text: String,
}

/// What a judge has found, and how often it had something to judge.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verdict {
    /// The first violations of each rule.
    pub findings: Vec<Finding>,
    /// Orders given, ended without error, ended with error, telegrams received.
    pub counts: [u64; 4],
}

/// Most findings of one rule that are kept.
const KEPT: usize = 3;

impl Verdict {
    /// A rule is violated.
    pub fn broken(&mut self, rule: &'static str, at: Instant, text: impl Into<String>) {
        if self.findings.iter().filter(|finding| finding.rule == rule).count() < KEPT {
            self.findings.push(Finding { rule, at, text: text.into() });
        }
    }

    /// An order was given.
    pub fn given(&mut self) {
        self.counts[0] += 1;
    }

    /// An order ended without error.
    pub fn done(&mut self) {
        self.counts[1] += 1;
    }

    /// An order ended with error.
    pub fn failed(&mut self) {
        self.counts[2] += 1;
    }

    /// The program got a telegram.
    pub fn received(&mut self) {
        self.counts[3] += 1;
    }

    /// Whether a rule is violated.
    #[must_use]
    pub fn has(&self, rule: &str) -> bool {
        self.findings.iter().any(|finding| finding.rule == rule)
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:>10} {}: {}", self.at.micros(), self.rule, self.text)
    }
}
