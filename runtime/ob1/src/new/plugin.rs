//! The files of a new plugin: one that builds without the sources of ob1.

use std::path::{Path, PathBuf};

use super::folder::File;
use super::{Language, NO_SDK, Refusal, fill};
use crate::exit::Exit;

/// The C side of the plugin interface goes with the plugin, so that it builds anywhere.
const HEADER: &str = include_str!("../../../../include/ob1.h");

/// How a plugin is made in one language.
struct Kit {
    build: &'static str,
    /// What follows the build, for the terminal.
    next: &'static str,
    language: &'static str,
    /// The library, from the folder; `NAME` and the name of the crate's library are filled in.
    library: &'static str,
    sources: &'static str,
}

const fn kit(language: Language) -> Kit {
    match language {
        Language::C => Kit {
            build: "make                            # @NAME@.so; a C compiler is all it needs",
            next: "  make\n  ob1 test\n  ob1 run station.toml\n",
            language: "in C (`@NAME@.c`)",
            library: "./@NAME@.so",
            sources: "`ob1.h` is the interface of the ob1 that wrote this folder; take a newer one with a newer ob1.",
        },
        Language::Rust => Kit {
            build: "cargo build --release           # target/release/lib@CRATE@.so",
            next: "  cargo build --release\n  ob1 test\n  ob1 run station.toml\n",
            language: "in Rust (`src/lib.rs`)",
            library: "./target/release/lib@CRATE@.so",
            sources: "`Cargo.toml` names the folder of the crate `ob1-sdk`; after an upgrade of ob1, build the plugin again.",
        },
    }
}

/// What to do with it.
pub(super) const fn next(language: Language) -> &'static str {
    kit(language).next
}

/// The files; a plugin in Rust needs the sdk.
pub(super) fn files(name: &str, language: Language, sdk: Option<&Path>, at: &Path) -> Result<Vec<File>, Refusal> {
    if language == Language::Rust && !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
        let message = format!("\"{name}\" is not a valid name for a crate");
        return Err(Refusal::new(Exit::Usage, super::NAME, at, message, "begin it with a letter"));
    }
    let sdk = match language {
        Language::C => PathBuf::new(),
        Language::Rust => find_sdk(sdk, at)?,
    };
    Ok(unchecked(name, language, &sdk))
}

/// The files, with the sdk at a place that is not checked.
pub(super) fn unchecked(name: &str, language: Language, sdk: &Path) -> Vec<File> {
    let kit = kit(language);
    let of_crate = name.replace('-', "_");
    // A text of TOML is written as one of Rust: the same escapes for quotes and backslashes.
    let sdk = format!("{:?}", sdk.display().to_string());
    let text = |template: &str| {
        let kit =
            [("BUILD", kit.build), ("LANGUAGE", kit.language), ("LIBRARY", kit.library), ("SOURCES", kit.sources)];
        fill(&fill(template, &kit), &[("NAME", name), ("CRATE", &of_crate), ("SDK", &sdk)])
    };
    let mut files = match language {
        Language::C => vec![
            File::new(format!("{name}.c"), "the block", text(include_str!("plugin/block.c.in"))),
            File::new("ob1.h", "the interface", HEADER.to_owned()),
            File::new("Makefile", "builds it", text(include_str!("plugin/makefile.in"))),
        ],
        Language::Rust => vec![
            File::new("src/lib.rs", "the block", text(include_str!("plugin/block.rs.in"))),
            File::new("Cargo.toml", "builds it", text(include_str!("plugin/manifest.in"))),
        ],
    };
    files.extend([
        File::new("station.toml", "a station that calls it", text(include_str!("plugin/station.toml.in"))),
        File::new("main.awl", "its program", text(include_str!("plugin/main.awl.in"))),
        File::new("main.test.toml", "its tests", text(include_str!("plugin/main.test.toml.in"))),
        File::new("README.md", "what to do with it", text(include_str!("plugin/README.md.in"))),
    ]);
    files
}

/// The crate ob1-sdk: as named, in the package (`../share/ob1/crates` beside the command), or in the checkout whose
/// `target` the command lies in.
fn find_sdk(named: Option<&Path>, at: &Path) -> Result<PathBuf, Refusal> {
    let beside = std::env::current_exe().ok().and_then(|exe| Some(exe.parent()?.to_owned()));
    let candidates: Vec<PathBuf> = match (named, beside) {
        (Some(named), _) => vec![named.to_owned()],
        (None, Some(beside)) => {
            vec![beside.join("../share/ob1/crates/ob1-sdk"), beside.join("../../plugins/sdk")]
        }
        (None, None) => Vec::new(),
    };
    let is_it = |path: &&PathBuf| {
        let manifest = std::fs::read_to_string(path.join("Cargo.toml")).unwrap_or_default();
        manifest.lines().any(|line| line.trim() == "name = \"ob1-sdk\"")
    };
    let found = candidates.iter().find(is_it).and_then(|path| path.canonicalize().ok());
    found.ok_or_else(|| {
        let searched: Vec<String> = candidates.iter().map(|path| path.display().to_string()).collect();
        let message = format!("the crate ob1-sdk is not in {}", searched.join(", "));
        let remedy = "name its folder with --sdk; a plugin in C (--language c) needs nothing but a C compiler";
        Refusal::new(Exit::Usage, NO_SDK, at, message, remedy)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sdk_is_the_crate_of_that_name() {
        let base = tempfile::tempdir().expect("a directory");
        let at = Path::new("x");
        let refusal = find_sdk(Some(base.path()), at).expect_err("an empty folder");
        assert_eq!(refusal.finding.code, NO_SDK);
        std::fs::write(base.path().join("Cargo.toml"), "[package]\nname = \"ob1-words\"\n").expect("written");
        assert!(find_sdk(Some(base.path()), at).is_err(), "another crate");
        let ours = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../plugins/sdk");
        assert!(find_sdk(Some(&ours), at).expect("the sdk of this checkout").is_absolute());
    }

    #[test]
    fn a_crate_begins_with_a_letter() {
        let ours = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../plugins/sdk");
        let files = |name, language| files(name, language, Some(&ours), Path::new("x"));
        assert!(files("7up", Language::Rust).is_err());
        assert!(files("7up", Language::C).is_ok());
        assert!(files("up-7", Language::Rust).is_ok());
    }
}
