//! House rules: what a test must not do, the lints of the workspace in every crate, and the size of a file.

use super::Finding;
use super::mask::has_word;
use super::tree::Tree;

/// Allowed sleeps in tests: file and reason.
const SLEEPS: &[(&str, &str)] = &[];

/// No test is ignored or left out of its binary, and none sleeps: a sleep is either too short on a busy machine or too
/// long on all others.
pub(super) fn tests(tree: &Tree) -> Vec<Finding> {
    let mut findings = left_out(tree);
    let mut found = |place: String, what: &str| {
        findings.push(Finding { place, rule: "tests", what: what.to_owned() });
    };
    for file in tree.rust() {
        for (number, line, test) in file.code_lines() {
            let place = || format!("{}:{number}", file.path);
            let attribute = line.trim_start();
            let ignores =
                attribute.starts_with("#[") && has_word(attribute, "ignore") && !attribute.starts_with("#[doc");
            if ignores {
                found(place(), "`#[ignore]`: a test runs or is not there");
            }
            let sleeps = line.contains("thread::sleep")
                || line.contains("park_timeout")
                || line.contains("sleep(") && has_word(line, "sleep");
            if test && sleeps && !SLEEPS.iter().any(|(path, _)| file.path == *path) {
                found(place(), "a sleep in a test: wait for the thing itself, with a deadline as a guard");
            }
        }
    }
    for file in tree.files.iter().filter(|file| file.path.ends_with(".py") && file.is_in(&["tests"])) {
        for (index, line) in file.text.lines().enumerate().filter(|(_, line)| line.contains("sleep(")) {
            let comment = line.trim_start().starts_with('#');
            if !comment {
                found(
                    format!("{}:{}", file.path, index + 1),
                    "a sleep in a partner: wait for the line, with a deadline",
                );
            }
        }
    }
    findings
}

/// Files beside a `tests/KIND/main.rs` that it does not name: nobody compiles them.
fn left_out(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    let is_kind = |folder: &str| folder.rsplit_once('/').is_some_and(|(tests, _)| tests.ends_with("tests"));
    for main in tree.rust() {
        let Some(folder) = main.path.strip_suffix("/main.rs").filter(|folder| is_kind(folder)) else { continue };
        for file in tree.rust() {
            let name = file.path.strip_prefix(folder).and_then(|rest| rest.strip_prefix('/')?.strip_suffix(".rs"));
            let Some(name) = name.filter(|name| *name != "main") else { continue };
            let module = name.split_once('/').map_or(name, |(module, _)| module);
            if !main.text.lines().any(|line| line == format!("mod {module};")) {
                let what = format!("{} does not name it, so it is never compiled", main.path);
                findings.push(Finding { place: file.path.clone(), rule: "tests", what });
            }
        }
    }
    findings
}

/// No merge marks: a document with merge marks does not fail to build.
pub(super) fn merge_marks(tree: &Tree) -> Vec<Finding> {
    let mark = |line: &str| ["<<<<<<< ", ">>>>>>> "].iter().any(|mark| line.starts_with(mark));
    let lines =
        tree.files.iter().flat_map(|file| file.text.lines().enumerate().map(move |(at, line)| (file, at, line)));
    lines
        .filter(|(_, _, line)| mark(line))
        .map(|(file, at, _)| Finding {
            place: format!("{}:{}", file.path, at + 1),
            rule: "merges",
            what: "the mark of a merge that was not finished".to_owned(),
        })
        .collect()
}

/// Every member inherits the lints of the workspace; without them the compiler checks no fence.
pub(super) fn workspace_lints(tree: &Tree) -> Vec<Finding> {
    let manifests = tree.files.iter().filter(|file| file.path.ends_with("/Cargo.toml"));
    let without = manifests.filter(|file| {
        let packed: String = file.text.split_whitespace().collect();
        packed.contains("[package]") && !packed.contains("[lints]workspace=true")
    });
    let finding = |place: &str| Finding {
        place: place.to_owned(),
        rule: "invariant 5",
        what: "`[lints] workspace = true` is missing".to_owned(),
    };
    without.map(|file| finding(&file.path)).collect()
}

/// A source file with more lines than this, its tests included, is divided.
const LONG: usize = 600;

/// The guard of rooms: names files of more lines than [`LONG`].
pub(super) fn long_files(tree: &Tree) -> Vec<Finding> {
    let is_source = |path: &str| [".rs", ".py", ".js", ".c", ".h", ".awl"].iter().any(|end| path.ends_with(end));
    let files = tree.files.iter().filter(|file| is_source(&file.path));
    let lengths = files.map(|file| (file, file.text.lines().count()));
    lengths
        .filter(|(_, lines)| *lines > LONG)
        .map(|(file, lines)| Finding {
            place: file.path.clone(),
            rule: "style",
            what: format!("{lines} lines, more than {LONG}: divide the file"),
        })
        .collect()
}

/// Columns of a line, as in rustfmt.toml, which does not change comments.
const WIDE: usize = 120;

/// Comments and pages have the same maximum width as code. Rows of tables cannot be wrapped, and quotations keep their
/// lines.
pub(super) fn width(tree: &Tree) -> Vec<Finding> {
    let mut findings = wide_comments(tree);
    findings.extend(wide_pages(tree));
    findings
}

fn wide_pages(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for file in tree.files.iter().filter(|file| file.path.ends_with(".md")) {
        let mut fenced = false;
        for (at, line) in file.text.lines().enumerate() {
            let text = line.trim_start();
            fenced ^= text.starts_with("```");
            let is_quoted = fenced || line.starts_with("    ") || text.starts_with(['|', '[', '#']);
            if !is_quoted && line.chars().count() > WIDE && text.contains(' ') {
                let what = format!("a line of more than {WIDE} columns");
                findings.push(Finding { place: format!("{}:{}", file.path, at + 1), rule: "width", what });
            }
        }
    }
    findings
}

fn wide_comments(tree: &Tree) -> Vec<Finding> {
    let is_wide = |line: &str| {
        let text = line.trim_start().trim_start_matches('/').trim_start_matches('!').trim_start();
        line.trim_start().starts_with("//") && line.chars().count() > WIDE && !text.starts_with('|')
    };
    let lines = tree.rust().flat_map(|file| file.text.lines().enumerate().map(move |(at, line)| (file, at, line)));
    lines
        .filter(|(_, _, line)| is_wide(line))
        .map(|(file, at, _)| Finding {
            place: format!("{}:{}", file.path, at + 1),
            rule: "width",
            what: format!("a comment of more than {WIDE} columns"),
        })
        .collect()
}

#[cfg(test)]
mod unit {
    use super::*;

    #[test]
    fn no_test_is_ignored_or_sleeps() {
        let tree = Tree::of(&[
            (
                "a/src/lib.rs",
                "std::thread::sleep(x);\n#[cfg(test)]\nmod tests {\n    #[test]\n    #[ignore = \"slow\"]\n    fn a() {}\n}",
            ),
            (
                "a/tests/b.rs",
                "// thread::sleep\nfn b() { thread::sleep(x); }\nuse thread::{self, sleep};\nfn c() { sleep(x); }",
            ),
            ("tests/peers/p.py", "# time.sleep(1)\ntime.sleep(1)\n"),
        ]);
        let places: Vec<String> = tests(&tree).into_iter().map(|finding| finding.place).collect();
        assert_eq!(places, ["a/src/lib.rs:5", "a/tests/b.rs:2", "a/tests/b.rs:4", "tests/peers/p.py:2"]);
    }

    #[test]
    fn every_test_file_is_in_its_binary() {
        let tree = Tree::of(&[
            ("a/tests/kind/main.rs", "mod one;\nmod help;\n"),
            ("a/tests/kind/one.rs", ""),
            ("a/tests/kind/two.rs", ""),
            ("a/tests/kind/help/mod.rs", ""),
            ("a/tests/kind/other/mod.rs", ""),
            ("a/src/main.rs", ""),
            ("a/src/free.rs", ""),
        ]);
        let places: Vec<String> = tests(&tree).into_iter().map(|finding| finding.place).collect();
        assert_eq!(places, ["a/tests/kind/two.rs", "a/tests/kind/other/mod.rs"]);
    }

    #[test]
    fn comments_are_narrow() {
        let long = "x".repeat(WIDE - 2);
        let text = format!("//{long}\n//{long}x\n    //! | {long} |\nlet a = \"{long}xx\";\n    /// {long}\n");
        let tree = Tree::of(&[("a/src/lib.rs", &text), ("docs/a.md", &text)]);
        let places: Vec<String> = wide_comments(&tree).into_iter().map(|finding| finding.place).collect();
        assert_eq!(places, ["a/src/lib.rs:2", "a/src/lib.rs:5"]);
    }

    #[test]
    fn pages_are_narrow() {
        let long = format!("x {}", "x".repeat(WIDE - 2));
        let page = format!("{long}\n{long}x\n| {long} |\n    {long}x\n```text\n{long}x\n```\n{long}y\n");
        let tree = Tree::of(&[("docs/a.md", &page)]);
        let places: Vec<String> = width(&tree).into_iter().map(|finding| finding.place).collect();
        assert_eq!(places, ["docs/a.md:2", "docs/a.md:8"]);
    }

    #[test]
    fn a_merge_is_finished() {
        let halves = "a\n<<<<<<< HEAD\nb\n=======\nc\n>>>>>>> d\n";
        let tree = Tree::of(&[("docs/a.md", halves), ("b/src/lib.rs", "// a <<<<<<< b\n")]);
        let places: Vec<String> = merge_marks(&tree).into_iter().map(|finding| finding.place).collect();
        assert_eq!(places, ["docs/a.md:2", "docs/a.md:6"]);
    }

    #[test]
    fn every_member_inherits_the_lints() {
        let tree = Tree::of(&[
            ("a/Cargo.toml", "[package]\nname = \"a\"\n\n[lints]\nworkspace = true\n"),
            ("b/Cargo.toml", "[package]\nname = \"b\"\n"),
        ]);
        assert_eq!(workspace_lints(&tree).len(), 1);
        assert_eq!(workspace_lints(&tree)[0].place, "b/Cargo.toml");
    }

    #[test]
    fn a_long_file_is_named_whatever_is_in_it() {
        let full = "fn a() {}\n".repeat(LONG);
        let tests = format!("#[cfg(test)]\nmod tests {{\n{full}}}\n");
        let long = format!("{full}\n");
        let tree = Tree::of(&[
            ("a/src/a.rs", tests.as_str()),
            ("a/src/b.rs", full.as_str()),
            ("tests/tests/c.rs", long.as_str()),
            ("tests/peers/d.py", long.as_str()),
            ("docs/e.md", long.as_str()),
        ]);
        let places: Vec<String> = long_files(&tree).into_iter().map(|finding| finding.place).collect();
        assert_eq!(places, ["a/src/a.rs", "tests/tests/c.rs", "tests/peers/d.py"]);
    }
}
