//! Which crate may depend on which: direct dependencies from a table, and forbidden indirect dependencies.
//!
//! Checks normal and build dependencies as resolved for this machine, but not those used only by tests. An edge that
//! nobody uses is struck: it would be a door without a wall around it.

mod table;

use super::Finding;
use super::mask::has_word;
use super::tree::{File, Tree};
use table::{FLOORS, NO_WAY, TABLE};

/// The only member without a row.
const SEES_ALL: &str = "ob1-tests";

/// Compares the direct dependencies with the table; a member without a row and a row without a member are also
/// findings.
pub(super) fn direct(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (name, node) in tree.graph.crates.iter().filter(|(_, node)| !node.folder.is_empty()) {
        let Some(row) = TABLE.iter().find(|row| row.name == name) else {
            if name != SEES_ALL {
                findings.push(Finding {
                    place: node.folder.clone(),
                    rule: "invariant 2",
                    what: format!("`{name}` has no row in the table of edges (xtask/src/arch/edges/table.rs)"),
                });
            }
            continue;
        };
        for need in node.needs.iter().filter(|need| !row.may_need.contains(&need.as_str())) {
            findings.push(Finding {
                place: format!("{}/Cargo.toml", node.folder),
                rule: row.rule,
                what: format!(
                    "the edge {name} -> {need} is not allowed; `{name}` may need: {}",
                    row.may_need.join(", ")
                ),
            });
        }
    }
    for row in TABLE.iter().filter(|row| !tree.graph.crates.contains_key(row.name)) {
        let what = format!("the table of edges names `{}`, which does not exist", row.name);
        findings.push(Finding { place: "xtask/src/arch/edges/table.rs".into(), rule: row.rule, what });
    }
    findings
}

/// Names edges that the table allows and no Cargo.toml has, and dependencies that no source of their crate names.
pub(super) fn unused(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for row in TABLE {
        let Some(node) = tree.graph.crates.get(row.name) else { continue };
        let declared = |need: &str| node.declares.iter().any(|declared| declared.name == need);
        for need in row.may_need.iter().filter(|need| !declared(need)) {
            let what = format!("the edge {} -> {need} is allowed, but no Cargo.toml has it: strike it", row.name);
            findings.push(Finding { place: "xtask/src/arch/edges/table.rs".into(), rule: row.rule, what });
        }
        let sources: Vec<&File> = tree.rust().filter(|file| file.is_in(&[node.folder.as_str()])).collect();
        for declared in &node.declares {
            if !sources.iter().any(|file| has_word(&file.code, &declared.word)) {
                let what = format!("it depends on `{}`, but no source of it names `{}`", declared.name, declared.word);
                findings.push(Finding { place: format!("{}/Cargo.toml", node.folder), rule: row.rule, what });
            }
        }
    }
    findings
}

/// Every arrow between the rooms goes down. What stands on all of them (tests, examples, tools) has no floor.
pub(super) fn floors(tree: &Tree) -> Vec<Finding> {
    let floor = |name: &str| {
        let room = tree.graph.crates.get(name)?.folder.split('/').next()?;
        FLOORS.iter().position(|known| *known == room)
    };
    let mut findings = Vec::new();
    for (name, node) in &tree.graph.crates {
        let Some(own) = floor(name) else { continue };
        for need in node.needs.iter().filter(|need| floor(need).is_some_and(|below| below > own)) {
            let what = format!("{name} -> {need} goes up: from {} to {}", FLOORS[own], tree.graph.crates[need].folder);
            findings.push(Finding { place: format!("{}/Cargo.toml", node.folder), rule: "invariant 2", what });
        }
    }
    findings
}

/// Looks for forbidden indirect dependencies.
pub(super) fn reach(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (rule, starts, ends) in NO_WAY {
        for start in starts.iter() {
            for end in ends.iter() {
                if let Some(way) = tree.graph.way(start, end) {
                    let what = format!("`{start}` must not reach `{end}`, but does: {}", way.join(" -> "));
                    findings.push(Finding { place: (*start).to_owned(), rule, what });
                }
            }
        }
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::super::tree::Declared;
    use super::*;

    /// The graph of the table, with one more edge.
    fn tree_with(from: &str, to: &str) -> Tree {
        let mut tree = Tree::of(&[]);
        for row in TABLE {
            tree.graph.crates.entry(row.name.to_owned()).or_default().folder = format!("somewhere/{}", row.name);
        }
        tree.graph.crates.entry(from.to_owned()).or_default().needs.push(to.to_owned());
        tree
    }

    #[test]
    fn an_allowed_edge_is_silent() {
        let tree = tree_with("ob1-cpu", "ob1-ir");
        assert_eq!(direct(&tree), []);
        assert_eq!(reach(&tree), []);
    }

    #[test]
    fn an_edge_outside_the_table_is_named_with_its_invariant() {
        let findings = direct(&tree_with("ob1-cpu", "ob1-backplane"));
        assert_eq!(findings.len(), 1);
        assert_eq!(findings[0].rule, "invariant 2");
        assert!(findings[0].what.contains("ob1-cpu -> ob1-backplane"), "{}", findings[0]);
    }

    #[test]
    fn an_arrow_that_goes_up_is_named() {
        let mut tree = Tree::of(&[]);
        for (name, folder, needs) in [
            ("ob1-time", "base/time", &["ob1-cpu"][..]),
            ("ob1-cpu", "runtime/cpu", &["ob1-access", "ob1-arena", "libc"]),
            ("ob1-arena", "runtime/arena", &[]),
            ("ob1-access", "links/access", &[]),
            ("ob1-tests", "tests", &["ob1-cpu"]),
            ("libc", "", &[]),
        ] {
            let node = tree.graph.crates.entry(name.to_owned()).or_default();
            node.folder = folder.to_owned();
            node.needs = needs.iter().map(|need| (*need).to_owned()).collect();
        }
        let findings = floors(&tree);
        assert_eq!(findings.len(), 1);
        assert_eq!(findings[0].what, "ob1-time -> ob1-cpu goes up: from base to runtime/cpu");
    }

    #[test]
    fn a_way_through_a_foreign_crate_is_found() {
        let mut tree = tree_with("ob1-cpu", "rtrb");
        tree.graph.crates.entry("rtrb".to_owned()).or_default().needs.push("libc".to_owned());
        assert_eq!(direct(&tree), []);
        let findings = reach(&tree);
        assert_eq!(findings.len(), 1);
        assert!(findings[0].what.contains("ob1-cpu -> rtrb -> libc"), "{}", findings[0]);
    }

    #[test]
    fn a_new_crate_must_be_entered() {
        let mut tree = tree_with("ob1-cpu", "ob1-ir");
        tree.graph.crates.entry("ob1-jit".to_owned()).or_default().folder = "runtime/jit".to_owned();
        tree.graph.crates.remove("ob1-stl");
        let findings = direct(&tree);
        assert!(findings.iter().any(|finding| finding.what.contains("`ob1-jit` has no row")));
        assert!(findings.iter().any(|finding| finding.what.contains("`ob1-stl`, which does not exist")));
    }
    #[test]
    fn an_edge_that_nobody_uses_is_named() {
        let source =
            |code: &str| Tree::of(&[("runtime/arena/src/lib.rs", code), ("runtime/log/src/a.rs", "use libc;")]);
        let findings = |row: &str, code: &str, declares: &[(&str, &str)]| {
            let mut tree = source(code);
            let node = tree.graph.crates.entry(row.to_owned()).or_default();
            node.folder = "runtime/arena".to_owned();
            node.declares = declares.iter().map(|(name, word)| Declared::new(name, word)).collect();
            unused(&tree).into_iter().map(|finding| finding.what).collect::<Vec<_>>()
        };
        let model = ("ob1-model", "ob1_model");
        assert_eq!(findings("ob1-ir", "use ob1_model::Area;", &[model]), <[&str; 0]>::default());
        let allowed = "the edge ob1-ir -> ob1-model is allowed, but no Cargo.toml has it: strike it";
        assert_eq!(findings("ob1-ir", "use ob1_model::Area;", &[]), [allowed]);
        let named = "it depends on `ob1-model`, but no source of it names `ob1_model`";
        assert_eq!(findings("ob1-ir", "// ob1_model\nuse ob1_models;", &[model]), [named]);
        // What a crate is called in code may differ from its name.
        let named = "it depends on `libc-two`, but no source of it names `libc`";
        assert_eq!(findings("ob1-arena", "fn a() {}", &[("libc-two", "libc")]), [named]);
    }
}
