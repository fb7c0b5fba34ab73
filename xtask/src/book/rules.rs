//! The rules between the pages: every page of `docs/` is in the table of contents, the target of every link and every
//! named path exists.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use super::page::{Page, Placed};

/// The table of contents.
pub(super) const SUMMARY: &str = "docs/SUMMARY.md";
/// Paths below these folders that are written as code must exist.
const FOLDERS: [&str; 13] = [
    "base/",
    "backplane/",
    "blocks/",
    "plugins/",
    "driver/",
    "links/",
    "runtime/",
    "docs/",
    "examples/",
    "tests/",
    "include/",
    "xtask/",
    "fuzz/",
];

/// The checkout: Markdown files by path from its root, and all files that git knows or would add.
#[derive(Debug, Default)]
pub(super) struct Book {
    pub(super) pages: BTreeMap<String, Page>,
    pub(super) files: BTreeSet<String>,
    /// Paths that exist only after a build or a run.
    pub(super) ignored: Vec<String>,
    /// The verbs of `cargo xtask`.
    pub(super) verbs: Vec<String>,
}

/// An error, and how to correct it.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Finding {
    place: String,
    what: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.what)
    }
}

impl Book {
    /// Everything that breaks a rule, in the order of the pages.
    pub(super) fn check(&self) -> Vec<Finding> {
        let mut found = self.contents();
        for (path, page) in &self.pages {
            found.extend(page.links.iter().filter_map(|link| self.link(path, link)));
            found.extend(page.spans.iter().filter_map(|span| self.named_path(path, span)));
            found.extend(page.spans.iter().chain(&page.code).filter_map(|code| self.verb(path, code)));
        }
        found
    }

    /// SUMMARY.md names each page of docs/ once.
    fn contents(&self) -> Vec<Finding> {
        let Some(summary) = self.pages.get(SUMMARY) else {
            return vec![Finding { place: SUMMARY.into(), what: "the table of contents is missing".into() }];
        };
        let mut found = Vec::new();
        let mut listed = BTreeSet::new();
        for link in &summary.links {
            // The rule for links checks the target.
            if !listed.insert(resolve(SUMMARY, &link.text)) {
                found.push(at(SUMMARY, link.line, format!("{} is listed twice; keep one of the lines", link.text)));
            }
        }
        for (path, page) in &self.pages {
            let Some(relative) = path.strip_prefix("docs/").filter(|_| path != SUMMARY) else { continue };
            let title = page.title.as_deref();
            if title.is_none() {
                found.push(at(path, 1, "a page begins with its title: # Title".into()));
            }
            if !listed.contains(path) {
                let line = format!("- [{}]({relative})", title.unwrap_or(relative));
                let what =
                    format!("is not in the book; add the line `{line}` to {SUMMARY}, below the part it belongs to");
                found.push(Finding { place: path.clone(), what });
            }
        }
        found
    }

    /// The finding for a link without target.
    fn link(&self, path: &str, link: &Placed) -> Option<Finding> {
        let text = link.text.as_str();
        if text.contains("://") || text.starts_with("mailto:") {
            return None;
        }
        let (file, anchor) = text.split_once('#').map_or((text, None), |(file, anchor)| (file, Some(anchor)));
        let target = if file.is_empty() { path.to_owned() } else { resolve(path, file) };
        if !self.exists(&target) {
            return Some(at(path, link.line, format!("the link {text} leads to {target}, which does not exist")));
        }
        if path.starts_with("docs/") && !target.starts_with("docs/") {
            let what =
                format!("the link {text} leaves the book, which ends at docs/; name the path as code: `{target}`");
            return Some(at(path, link.line, what));
        }
        let anchors = &self.pages.get(&target)?.anchors;
        let wanted = anchor.filter(|anchor| !anchors.iter().any(|there| there == anchor))?;
        let what = format!("{target} has no heading #{wanted}; it has {}", anchors.join(", "));
        Some(at(path, link.line, what))
    }

    /// The finding for a path written as code that does not exist.
    fn named_path(&self, path: &str, span: &Placed) -> Option<Finding> {
        let text = span.text.trim_end_matches('/');
        let is_path = FOLDERS.iter().any(|folder| text.starts_with(folder))
            && text.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || "/._-".contains(c));
        if !is_path || self.exists(text) || self.ignored.iter().any(|ignored| text.starts_with(ignored)) {
            return None;
        }
        Some(at(path, span.line, format!("`{text}` does not exist")))
    }

    /// The finding for `cargo xtask VERB` with an unknown verb.
    fn verb(&self, path: &str, code: &Placed) -> Option<Finding> {
        let rest = code.text.split_once("cargo xtask ")?.1;
        let verb: String = rest.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '-').collect();
        if verb.is_empty() || self.verbs.contains(&verb) || verb.chars().all(|c| c.is_ascii_uppercase()) {
            return None;
        }
        Some(at(path, code.line, format!("cargo xtask has no `{verb}`; it has {}", self.verbs.join(", "))))
    }

    /// Whether a path is a file or a folder with files.
    fn exists(&self, path: &str) -> bool {
        let folder = format!("{path}/");
        self.files.contains(path) || self.files.range(folder.clone()..).next().is_some_and(|f| f.starts_with(&folder))
    }
}

fn at(path: &str, line: usize, what: String) -> Finding {
    Finding { place: format!("{path}:{line}"), what }
}

/// A relative link of a page, from the root of the checkout.
fn resolve(page: &str, link: &str) -> String {
    let mut parts: Vec<&str> = page.split('/').collect();
    parts.pop();
    for part in link.split('#').next().unwrap_or_default().split('/') {
        match part {
            "" | "." => {}
            ".." => _ = parts.pop(),
            part => parts.push(part),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &[(&str, &str)] = &[
        ("docs/SUMMARY.md", "# Summary\n\n- [A](a.md)\n- [B](deep/b.md)\n"),
        ("docs/a.md", "# A\n\nSee [B](deep/b.md#two-words), [above](#a), `driver/cp`, `cargo xtask test`.\n"),
        ("docs/deep/b.md", "# B\n\n## Two words\n\n[A](../a.md), <https://example.org>, `docs/NAME.md`, `fuzz/work`\n"),
        ("README.md", "# R\n\n[A](docs/a.md)\n"),
    ];

    /// The findings for the correct book with one file changed.
    fn findings(path: &str, text: &str) -> Vec<String> {
        let mut texts: BTreeMap<&str, &str> = GOOD.iter().copied().collect();
        if !path.is_empty() {
            texts.insert(path, text);
        }
        let book = Book {
            files: texts.keys().copied().chain(["driver/cp/src/main.rs"]).map(str::to_owned).collect(),
            pages: texts.iter().map(|(path, text)| ((*path).to_owned(), Page::of(text))).collect(),
            ignored: vec!["fuzz/work".into()],
            verbs: vec!["test".into()],
        };
        book.check().iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_good_book() {
        assert_eq!(findings("", ""), [""; 0]);
    }

    #[test]
    fn each_mistake_is_found() {
        for (path, text, expected) in [
            (
                "docs/c.md",
                "# The C page\n",
                "docs/c.md: is not in the book; add the line `- [The C page](c.md)` to docs/SUMMARY.md",
            ),
            ("docs/a.md", "No title\n", "docs/a.md:1: a page begins with its title"),
            (
                "docs/SUMMARY.md",
                "- [A](a.md)\n- [B](deep/b.md)\n- [A](a.md)\n",
                "docs/SUMMARY.md:3: a.md is listed twice",
            ),
            (
                "docs/SUMMARY.md",
                "- [A](a.md)\n- [B](deep/b.md)\n- [C](c.md)\n",
                "docs/SUMMARY.md:3: the link c.md leads to docs/c.md",
            ),
            (
                "docs/a.md",
                "# A\n\n[x](deep/c.md)\n",
                "docs/a.md:3: the link deep/c.md leads to docs/deep/c.md, which does not exist",
            ),
            (
                "docs/a.md",
                "# A\n\n[x](deep/b.md#three)\n",
                "docs/a.md:3: docs/deep/b.md has no heading #three; it has b, two-words",
            ),
            ("docs/a.md", "# A\n\n[x](#b)\n", "docs/a.md:3: docs/a.md has no heading #b"),
            ("docs/a.md", "# A\n\n[x](../README.md)\n", "docs/a.md:3: the link ../README.md leaves the book"),
            ("README.md", "[x](docs/z.md)\n", "README.md:1: the link docs/z.md leads to docs/z.md"),
            ("README.md", "See `driver/cq`.\n", "README.md:1: `driver/cq` does not exist"),
            ("README.md", "    cargo xtask tset\n", "README.md:1: cargo xtask has no `tset`; it has test"),
        ] {
            let found = findings(path, text);
            assert_eq!(found.len(), 1, "{found:#?}");
            assert!(found[0].starts_with(expected), "{found:#?}");
        }
    }
}
