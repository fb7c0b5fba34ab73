//! `cargo xtask book [--check]`: the pages of `docs/` as a book.
//!
//! The check: every page is in the table of contents, the target of every link and path exists (`rules`), the STL in
//! the pages compiles and the command lines parse (`runtime/ob1/tests/command/book.rs`). Without `--check` mdBook then
//! generates HTML in `target/book`.

mod page;
mod rules;

use std::path::PathBuf;
use std::process::Command;

use crate::cargo::{self, cargo};
use crate::failure::{Failure, Outcome, step};
use crate::shell;
use page::Page;
use rules::Book;

/// Pinned: a new version may render differently.
const MDBOOK: &str = "0.5.4";

/// # Errors
/// If a page has an error, or mdBook cannot be built.
pub(crate) fn run(args: &[String], usage: &str) -> Outcome {
    let only_check = match args {
        [] => false,
        [flag] if flag == "--check" => true,
        _ => return Err(Failure::Usage("book takes --check or nothing".into())),
    };
    let book = read(usage)?;
    let findings = book.check();
    for finding in &findings {
        eprintln!("{finding}");
    }
    if !findings.is_empty() {
        return Err(step(format!("the book: {} findings", findings.len())));
    }
    println!("book: {} pages, every page listed, every link and path there", book.pages.len());
    // The whole workspace, as in the test step: see `cargo::TESTS`.
    shell::run(&mut cargo(&["test", "--quiet", "--workspace", "--test", "command", "book::"]))?;
    if only_check {
        return Ok(());
    }
    build().map(drop)
}

/// Generates the book as HTML; returns its folder.
///
/// # Errors
/// If mdBook cannot be installed, or refuses a page.
pub(crate) fn build() -> Outcome<PathBuf> {
    let mdbook = install()?;
    shell::run(Command::new(mdbook).arg("build").current_dir(cargo::root()))?;
    Ok(cargo::root().join("target/book"))
}

/// Reads the files that git knows or would add.
fn read(usage: &str) -> Outcome<Book> {
    let list = shell::read(
        Command::new("git")
            .args(["ls-files", "--cached", "--others", "--exclude-standard", "--deduplicate"])
            .current_dir(cargo::root()),
    )?;
    let mut book = Book { verbs: verbs(usage), ..Book::default() };
    let ignored = std::fs::read_to_string(cargo::root().join(".gitignore")).unwrap_or_default();
    book.ignored = ignored.lines().filter_map(|line| Some(line.strip_prefix('/')?.to_owned())).collect();
    for path in list.lines() {
        let file = cargo::root().join(path);
        // Deleted, but still known to git.
        if !file.exists() {
            continue;
        }
        book.files.insert(path.to_owned());
        if path.ends_with(".md") {
            let text = std::fs::read_to_string(&file).map_err(|why| step(format!("{path}: {why}")))?;
            book.pages.insert(path.to_owned(), Page::of(&text));
        }
    }
    Ok(book)
}

/// The verbs of the help text: the first word of each line indented by two blanks.
fn verbs(usage: &str) -> Vec<String> {
    let lines = usage.lines().filter_map(|line| line.strip_prefix("  "));
    lines.filter(|line| !line.starts_with(' ')).filter_map(|line| Some(line.split(' ').next()?.to_owned())).collect()
}

/// mdBook in the checkout's `.tools`, installed if it is missing, which takes three minutes.
fn install() -> Outcome<PathBuf> {
    let tool = cargo::root().join(".tools/bin/mdbook");
    let version = format!("={MDBOOK}");
    let is_pinned = |tool: &PathBuf| {
        tool.is_file()
            && shell::read(Command::new(tool).arg("--version")).is_ok_and(|text| text.trim().ends_with(MDBOOK))
    };
    if !is_pinned(&tool) {
        let words =
            ["install", "mdbook", "--version", &version, "--locked", "--no-default-features", "--root", ".tools"];
        shell::run(cargo(&words).args(["--target-dir", ".tools/target"]))?;
        // Its artifacts are not needed any more.
        let artifacts = cargo::root().join(".tools/target");
        std::fs::remove_dir_all(&artifacts).map_err(|why| step(format!("{}: {why}", artifacts.display())))?;
    }
    Ok(tool)
}

#[cfg(test)]
mod tests {
    use super::verbs;

    #[test]
    fn the_verbs_of_the_help_text() {
        let usage =
            "usage: cargo xtask VERB\n\n  demo [--for 20s]   the demo\n                     more\n  ci       all\n";
        assert_eq!(verbs(usage), ["demo", "ci"]);
    }
}
