//! `cargo xtask arch`: the guards of the invariants that the compiler and clippy do not check.
//!
//! A guard is a function from the checkout to findings. A finding names the place, the invariant (the number in
//! ARCHITECTURE.md) and the violation. The tests of each guard check that it finds a violation.

mod citations;
mod conformance;
mod edges;
mod fences;
mod house_rules;
mod mask;
mod owners;
mod purity;
mod tree;

use std::fmt;

use crate::failure::{Failure, Outcome, step};
use tree::Tree;

/// A violation of the architecture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Finding {
    /// `path:line`, or the crate.
    place: String,
    /// The rule: `invariant 5`, `style`, ...
    rule: &'static str,
    /// The violation, and how to correct it.
    what: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.place, self.rule, self.what)
    }
}

/// A guard, with its name in the table of ARCHITECTURE.md.
struct Guard {
    name: &'static str,
    check: fn(&Tree) -> Vec<Finding>,
}

const GUARDS: &[Guard] = &[
    guard("edges", edges::direct),
    guard("unused", edges::unused),
    guard("floors", edges::floors),
    guard("reach", edges::reach),
    guard("no-alloc", purity::no_std_without_alloc),
    guard("fences", fences::check),
    guard("fence-holes", fences::holes),
    guard("unsafe", purity::unsafe_code),
    guard("statics", purity::plugin_statics),
    guard("walls", purity::rooms),
    guard("citations", citations::check),
    guard("conformance", conformance::check),
    guard("words", owners::words),
    guard("module-types", owners::module_types),
    guard("verifier", owners::verifier),
    guard("time", owners::time),
    guard("tests", house_rules::tests),
    guard("lints", house_rules::workspace_lints),
    guard("merges", house_rules::merge_marks),
    guard("width", house_rules::width),
    guard("rooms", house_rules::long_files),
];

const fn guard(name: &'static str, check: fn(&Tree) -> Vec<Finding>) -> Guard {
    Guard { name, check }
}

/// `cargo xtask arch [--bless]`: runs all guards; with `--bless` first rewrites the clippy.toml files and the
/// conformance pages.
///
/// # Errors
/// When a guard finds something.
pub(crate) fn run(args: &[String]) -> Outcome {
    match args {
        [] => {}
        [flag] if flag == "--bless" => {
            fences::bless()?;
            conformance::bless()?;
        }
        _ => return Err(Failure::Usage("arch takes nothing but --bless".into())),
    }
    let tree = Tree::read()?;
    let mut breaches = 0;
    for guard in GUARDS {
        let findings = (guard.check)(&tree);
        println!("{:<12} {}", guard.name, if findings.is_empty() { "holds" } else { "BROKEN" });
        for finding in &findings {
            println!("    {finding}");
        }
        breaches += findings.len();
    }
    if breaches == 0 {
        println!("arch: {} guards hold over {} files", GUARDS.len(), tree.files.len());
        Ok(())
    } else {
        Err(step(format!("arch: {breaches} breaches")))
    }
}
