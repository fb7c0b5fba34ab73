//! The checkout as the guards see it: every text file git would keep, and the graph of crates.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use super::mask::mask;
use crate::cargo;
use crate::failure::{Outcome, step};
use crate::shell;

/// A text file of the checkout.
pub(super) struct File {
    /// From the root of the checkout, with `/`.
    pub(super) path: String,
    /// The text of the file.
    pub(super) text: String,
    /// Rust only: the text with blanked comments and literals, with the same lines.
    pub(super) code: String,
    /// Rust only: byte ranges of `code` that exist under `cfg(test)` only.
    tests: Vec<Range<usize>>,
}

impl File {
    /// A file with this text.
    pub(super) fn new(path: &str, text: &str) -> Self {
        let code = if path.ends_with(".rs") { mask(text) } else { String::new() };
        let tests = test_ranges(path, &code);
        Self { path: path.to_owned(), text: text.to_owned(), code, tests }
    }

    /// Whether it is Rust source.
    pub(super) fn is_rust(&self) -> bool {
        self.path.ends_with(".rs")
    }

    /// Lines of code: number from 1, masked text, whether it is test code.
    pub(super) fn code_lines(&self) -> impl Iterator<Item = (usize, &str, bool)> {
        let mut offset = 0;
        self.code.split('\n').enumerate().map(move |(index, line)| {
            let start = offset;
            offset += line.len() + 1;
            (index + 1, line, self.tests.iter().any(|range| range.contains(&start)))
        })
    }

    /// Whether it is below one of the folders.
    pub(super) fn is_in(&self, folders: &[&str]) -> bool {
        folders.iter().any(|folder| self.path.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/')))
    }
}

/// All files, and the graph of crates.
pub(super) struct Tree {
    pub(super) files: Vec<File>,
    pub(super) graph: Graph,
}

impl Tree {
    /// Reads the checkout: all files that are in git or would be added to it.
    pub(super) fn read() -> Outcome<Self> {
        let root = cargo::root();
        let mut list = Command::new("git");
        list.args(["ls-files", "--cached", "--others", "--exclude-standard"]).current_dir(root);
        let names = if root.join(".git").exists() { shell::read(&mut list)? } else { walk(root) };
        let mut files = Vec::new();
        for path in names.lines().filter(|path| is_text(path)) {
            match std::fs::read_to_string(root.join(path)) {
                Ok(text) => files.push(File::new(path, &text)),
                // Deleted but still in the index, or a program in CP1252: ignored.
                Err(why) if matches!(why.kind(), std::io::ErrorKind::NotFound | std::io::ErrorKind::InvalidData) => {}
                Err(why) => return Err(step(format!("{path}: {why}"))),
            }
        }
        Ok(Self { files, graph: Graph::of(&cargo::metadata()?) })
    }

    /// A tree of these files without crates, for the tests of the guards.
    #[cfg(test)]
    pub(super) fn of(files: &[(&str, &str)]) -> Self {
        let files = files.iter().map(|(path, text)| File::new(path, text)).collect();
        Self { files, graph: Graph::default() }
    }

    /// The Rust files, tests included.
    pub(super) fn rust(&self) -> impl Iterator<Item = &File> {
        self.files.iter().filter(|file| file.is_rust())
    }
}

fn is_text(path: &str) -> bool {
    [".rs", ".toml", ".md", ".py", ".js", ".awl", ".h", ".c", ".rows"]
        .iter()
        .any(|end| path.to_ascii_lowercase().ends_with(end))
}

/// The files of an unpacked archive without git.
fn walk(root: &Path) -> String {
    let mut found = String::new();
    let mut folders = vec![root.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let name = entry.file_name();
            if path.is_dir() {
                if name != "target" && !name.to_string_lossy().starts_with('.') {
                    folders.push(path);
                }
            } else if let Some(path) = path.strip_prefix(root).ok().and_then(Path::to_str) {
                found.push_str(path);
                found.push('\n');
            }
        }
    }
    found
}

/// The ranges of `code` that are test code: whole files in a `tests` folder or named `tests.rs`, and items with
/// `#[cfg(test)]`.
fn test_ranges(path: &str, code: &str) -> Vec<Range<usize>> {
    let mut ranges = Vec::new();
    if path.starts_with("tests/") || path.contains("/tests/") || path.ends_with("/tests.rs") {
        ranges.push(0..code.len() + 1);
        return ranges;
    }
    for (start, _) in code.match_indices("#[cfg(") {
        let Some(end) = code[start..].find(']').map(|offset| start + offset) else { continue };
        let condition = code[start..end].replace("not(test)", "");
        if !super::mask::has_word(&condition, "test") {
            continue;
        }
        // The item ends with its closing brace, or at a `;` before any brace.
        let mut depth = 0usize;
        for (offset, byte) in code.bytes().enumerate().skip(end) {
            match byte {
                b'{' => depth += 1,
                b'}' => depth = depth.saturating_sub(1),
                b';' => {}
                _ => continue,
            }
            if depth == 0 {
                ranges.push(start..offset + 1);
                break;
            }
        }
    }
    ranges
}

/// A crate of the graph.
#[derive(Clone, Debug, Default)]
pub(super) struct Crate {
    /// From the root, e.g. `plugins/sdk`; empty for crates from a registry.
    pub(super) folder: String,
    /// Direct normal and build dependencies, by name.
    pub(super) needs: Vec<String>,
    /// Those of its Cargo.toml, for any machine.
    pub(super) declares: Vec<Declared>,
}

/// A dependency in a Cargo.toml.
#[derive(Clone, Debug)]
pub(super) struct Declared {
    /// The name of the package.
    pub(super) name: String,
    /// What it is called in code.
    pub(super) word: String,
}

impl Declared {
    pub(super) fn new(name: &str, word: &str) -> Self {
        Self { name: name.to_owned(), word: word.to_owned() }
    }
}

/// Crates by name. Two versions of one crate share an entry.
#[derive(Clone, Debug, Default)]
pub(super) struct Graph {
    pub(super) crates: BTreeMap<String, Crate>,
}

impl Graph {
    /// Reads the resolved graph from `cargo metadata`.
    fn of(metadata: &Value) -> Self {
        let mut graph = Self::default();
        let mut names = BTreeMap::new();
        let root = cargo::root().to_string_lossy().into_owned() + "/";
        let words = words(metadata);
        for package in cargo::list(&metadata["packages"]) {
            let (Some(id), Some(name)) = (package["id"].as_str(), package["name"].as_str()) else { continue };
            names.insert(id, name);
            let manifest = package["manifest_path"].as_str().unwrap_or_default();
            if package["source"].is_null() {
                let folder = manifest.strip_prefix(&root).and_then(|path| path.strip_suffix("/Cargo.toml"));
                let node = graph.crates.entry(name.to_owned()).or_default();
                node.folder = folder.unwrap_or_default().to_owned();
                node.declares =
                    cargo::list(&package["dependencies"]).iter().filter_map(|d| declared(d, &words)).collect();
            }
        }
        for node in cargo::list(&metadata["resolve"]["nodes"]) {
            let Some(from) = node["id"].as_str().and_then(|id| names.get(id)) else { continue };
            let entry = graph.crates.entry((*from).to_owned()).or_default();
            for edge in cargo::list(&node["deps"]) {
                let dev_only = cargo::list(&edge["dep_kinds"]).iter().all(|kind| kind["kind"] == "dev");
                if let Some(to) = edge["pkg"].as_str().and_then(|id| names.get(id)).filter(|_| !dev_only) {
                    entry.needs.push((*to).to_owned());
                }
            }
        }
        graph
    }

    /// A path from `from` to `to` over any number of edges, as names; `None` if there is none.
    pub(super) fn way(&self, from: &str, to: &str) -> Option<Vec<String>> {
        let mut seen = BTreeMap::from([(from.to_owned(), String::new())]);
        let mut queue = std::collections::VecDeque::from([from.to_owned()]);
        while let Some(name) = queue.pop_front() {
            if name == to && name != from {
                let mut way = vec![name];
                while let Some(before) = way.last().and_then(|last| seen.get(last)).filter(|before| !before.is_empty())
                {
                    way.push(before.clone());
                }
                way.reverse();
                return Some(way);
            }
            for next in self.crates.get(&name).map(|node| node.needs.as_slice()).unwrap_or_default() {
                if !seen.contains_key(next) {
                    seen.insert(next.clone(), name.clone());
                    queue.push_back(next.clone());
                }
            }
        }
        None
    }
}

/// What each package is called in code, if not by its name.
fn words(metadata: &Value) -> BTreeMap<&str, &str> {
    let libraries = cargo::list(&metadata["packages"]).iter().filter_map(|package| {
        let is_library = |target: &&Value| {
            let kinds = cargo::list(&target["kind"]);
            kinds.iter().any(|kind| kind == "proc-macro" || kind.as_str().is_some_and(|kind| kind.ends_with("lib")))
        };
        let library = cargo::list(&package["targets"]).iter().find(is_library)?;
        Some((package["name"].as_str()?, library["name"].as_str()?))
    });
    libraries.collect()
}

/// A normal or build dependency.
fn declared(dependency: &Value, words: &BTreeMap<&str, &str>) -> Option<Declared> {
    let name = dependency["name"].as_str().filter(|_| dependency["kind"] != "dev")?;
    let word = dependency["rename"].as_str().or(words.get(name).copied()).unwrap_or(name).replace('-', "_");
    Some(Declared::new(name, &word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn test_code_is_told_from_the_rest() {
        let source =
            "fn a() {}\n#[cfg(test)]\nmod tests {\n    fn b() { {} }\n}\nfn c() {}\n#[cfg(not(test))]\nfn d() {}\n";
        let file = File::new("a/src/lib.rs", source);
        let tests: Vec<usize> = file.code_lines().filter(|(_, _, test)| *test).map(|(number, ..)| number).collect();
        assert_eq!(tests, [2, 3, 4, 5]);
        assert!(File::new("a/tests/b.rs", "fn a() {}").code_lines().all(|(_, _, test)| test));
    }

    #[test]
    fn a_way_is_named_from_end_to_end() {
        let mut graph = Graph::default();
        for (from, to) in [("a", "b"), ("b", "c"), ("c", "a")] {
            graph.crates.entry(from.to_owned()).or_default().needs.push(to.to_owned());
        }
        assert_eq!(graph.way("a", "c"), Some(vec!["a".to_owned(), "b".to_owned(), "c".to_owned()]));
        assert_eq!(graph.way("a", "d"), None);
    }

    #[test]
    fn the_graph_knows_dev_edges_from_real_ones() {
        let metadata = serde_json::json!({
            "packages": [
                {"id": "1", "name": "a", "source": null, "manifest_path": cargo::root().join("x/a/Cargo.toml"),
                    "dependencies": [
                        {"name": "b", "kind": null, "rename": null}, {"name": "c", "kind": "dev", "rename": null},
                        {"name": "not-here", "kind": null, "rename": null},
                    ]},
                {"id": "2", "name": "b", "source": "registry", "manifest_path": "/b/Cargo.toml",
                    "targets": [{"kind": ["bin"], "name": "tool"}, {"kind": ["cdylib", "rlib"], "name": "the-b"}]},
                {"id": "3", "name": "c", "source": "registry", "manifest_path": "/c/Cargo.toml"},
            ],
            "resolve": {"nodes": [{"id": "1", "deps": [
                {"pkg": "2", "dep_kinds": [{"kind": null}]},
                {"pkg": "3", "dep_kinds": [{"kind": "dev"}]},
            ]}]},
        });
        let graph = Graph::of(&metadata);
        assert_eq!(graph.crates["a"].folder, "x/a");
        assert_eq!(graph.crates["a"].needs, ["b"]);
        let declares =
            graph.crates["a"].declares.iter().map(|declared| (declared.name.as_str(), declared.word.as_str()));
        assert_eq!(declares.collect::<Vec<_>>(), [("b", "the_b"), ("not-here", "not_here")]);
    }
}
