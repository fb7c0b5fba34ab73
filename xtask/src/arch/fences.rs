//! The fences that clippy checks: what a crate must not call or name. The clippy.toml files are generated from this
//! table.
//!
//! Clippy takes the nearest clippy.toml above a crate, and no other: one for each folder of crates, and one in a crate
//! that differs; each repeats the common part. This guard checks that the files match the table (which
//! `cargo xtask arch --bless` writes), and that no product code disables a fence with an `allow`. The fences also apply
//! to test code; a test that needs an exception (data files, threads of a model) says
//! `#![expect(clippy::disallowed_methods, reason = "...")]`.

use super::Finding;
use super::mask::has_word;
use super::tree::Tree;
use crate::cargo;
use crate::failure::{Outcome, step};

/// One thing that is forbidden to a crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ban {
    /// Reading a clock, of any kind.
    Clock,
    /// Starting or pausing a thread.
    Threads,
    /// Locks that another thread can hold, and channels built on them.
    Locks,
    /// Files and folders, for reading or writing.
    Disk,
    /// Sockets, of any family.
    Net,
    /// Other processes, and the arguments and environment of this one.
    Process,
    /// Collections whose order differs at each start.
    Hash,
}

impl Ban {
    /// The reason in the message.
    fn reason(self) -> &'static str {
        match self {
            Self::Clock => "invariant 4: the time is handed in",
            Self::Threads => "invariants 2, 9, 11: one thread runs everything",
            Self::Locks => "invariants 7, 8: no lock that another thread can hold",
            Self::Disk => "invariant 4: no disk here",
            Self::Net => "invariants 2, 4: no sockets here",
            Self::Process => "invariants 2, 4, 11: no processes and no environment here",
            Self::Hash => "invariant 11: its order differs at each start; take a BTreeMap or an index",
        }
    }

    fn methods(self) -> &'static [&'static str] {
        match self {
            Self::Clock => &["std::time::Instant::now", "std::time::SystemTime::now"],
            Self::Threads => &[
                "std::thread::spawn",
                "std::thread::scope",
                "std::thread::sleep",
                "std::thread::park",
                "std::thread::park_timeout",
                "std::thread::Builder::spawn",
            ],
            Self::Locks => &["std::sync::mpsc::channel", "std::sync::mpsc::sync_channel"],
            Self::Disk => &[
                "std::fs::canonicalize",
                "std::fs::copy",
                "std::fs::create_dir",
                "std::fs::create_dir_all",
                "std::fs::hard_link",
                "std::fs::metadata",
                "std::fs::read",
                "std::fs::read_dir",
                "std::fs::read_link",
                "std::fs::read_to_string",
                "std::fs::remove_dir",
                "std::fs::remove_dir_all",
                "std::fs::remove_file",
                "std::fs::rename",
                "std::fs::write",
                "std::fs::File::create",
                "std::fs::File::create_new",
                "std::fs::File::open",
                "std::fs::File::options",
                "std::fs::OpenOptions::new",
                "std::path::Path::exists",
                "std::path::Path::is_dir",
                "std::path::Path::is_file",
            ],
            Self::Process => &[
                "std::env::args",
                "std::env::current_dir",
                "std::env::var",
                "std::env::var_os",
                "std::env::vars",
                "std::process::abort",
                "std::process::exit",
            ],
            Self::Net | Self::Hash => &[],
        }
    }

    fn types(self) -> &'static [&'static str] {
        match self {
            Self::Clock => &["std::time::Instant", "std::time::SystemTime"],
            Self::Locks => &["std::sync::Condvar", "std::sync::Mutex", "std::sync::RwLock"],
            Self::Net => &[
                "std::net::TcpListener",
                "std::net::TcpStream",
                "std::net::UdpSocket",
                "std::os::unix::net::UnixDatagram",
                "std::os::unix::net::UnixListener",
                "std::os::unix::net::UnixStream",
            ],
            Self::Process => &["std::process::Command"],
            Self::Hash => &["std::collections::HashMap", "std::collections::HashSet", "std::hash::RandomState"],
            Self::Threads | Self::Disk => &[],
        }
    }
}

use Ban::{Clock, Disk, Hash, Locks, Net, Process, Threads};

/// Everything: the output of such a crate depends only on its input.
const ALL: &[Ban] = &[Clock, Threads, Locks, Disk, Net, Process, Hash];

/// Nothing: it reads the clock, touches the disk, has threads.
const NONE: &[Ban] = &[];

/// What is forbidden to every crate, and the crates and folders that differ.
const FENCES: &[(&str, &[Ban])] = &[
    ("", ALL),
    // It maps files created by others, through rustix.
    ("backplane/segment", &[Clock, Threads, Locks, Disk, Net, Hash]),
    ("base/process", NONE),
    // A listener removes what an earlier process has left at its path.
    ("base/socket", &[Clock, Threads, Locks, Net, Process, Hash]),
    ("driver/cp", NONE),
    ("driver/io", NONE),
    // The time is passed in; its pty has a name on the disk, and TCP is one of its lines.
    ("driver/line", &[Clock, Threads, Hash]),
    ("links/gate", NONE),
    ("links/s7-process", NONE),
    ("runtime/broker", NONE),
    // It may start processes and load plugins; the time is passed to its supervisor.
    ("runtime/host", &[Clock, Disk, Net, Hash]),
    ("runtime/ob1", NONE),
    // It provides the clock, and reads /proc.
    ("runtime/rt", &[Net, Process, Hash]),
    ("runtime/station", NONE),
    ("runtime/station-file", NONE),
    ("runtime/timing", NONE),
    ("tests", NONE),
    ("xtask", NONE),
];

/// What is forbidden to the file at this path: the longest folder of the table says it.
fn bans_of(path: &str) -> &'static [Ban] {
    let is_above =
        |folder: &str| folder.is_empty() || path.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/'));
    let nearest = FENCES.iter().filter(|(folder, _)| is_above(folder)).max_by_key(|(folder, _)| folder.len());
    nearest.map_or(NONE, |(_, bans)| bans)
}

/// Where the clippy.toml of a folder lies.
fn place_of(folder: &str) -> String {
    if folder.is_empty() { "clippy.toml".to_owned() } else { format!("{folder}/clippy.toml") }
}

/// The common part of every clippy.toml.
const COMMON: &str = "avoid-breaking-exported-api = false\n";

/// The clippy.toml of a crate with these bans.
fn clippy_toml(bans: &[Ban]) -> String {
    let mut text =
        String::from("# Written by `cargo xtask arch --bless` from the table in xtask/src/arch/fences.rs.\n");
    text.push_str(COMMON);
    if bans.is_empty() {
        return text;
    }
    for (key, paths) in [("methods", Ban::methods as fn(Ban) -> &'static [&'static str]), ("types", Ban::types)] {
        text.push_str(&format!("\ndisallowed-{key} = [\n"));
        for ban in bans {
            for path in paths(*ban) {
                // A crate without std cannot resolve the path, which is not an error.
                text.push_str(&format!(
                    "    {{ path = \"{path}\", reason = \"{}\", allow-invalid = true }},\n",
                    ban.reason()
                ));
            }
        }
        text.push_str("]\n");
    }
    text
}

/// Writes all clippy.toml files.
pub(super) fn bless() -> Outcome {
    for (folder, bans) in FENCES {
        let path = cargo::root().join(place_of(folder));
        std::fs::write(&path, clippy_toml(bans)).map_err(|why| step(format!("{}: {why}", path.display())))?;
    }
    Ok(())
}

/// Compares the files with the table.
pub(super) fn check(tree: &Tree) -> Vec<Finding> {
    let text_of = |path: &str| tree.files.iter().find(|file| file.path == path).map(|file| file.text.as_str());
    let mut findings = Vec::new();
    for (folder, bans) in FENCES {
        let place = place_of(folder);
        if text_of(&place) != Some(clippy_toml(bans).as_str()) {
            let what = "is not what the table of fences says (`cargo xtask arch --bless` writes it)".to_owned();
            findings.push(Finding { place, rule: "invariant 4", what });
        }
    }
    findings
}

/// Files of product code that may disable a fence of their crate, with the reason.
const HOLES: &[(&str, &str)] =
    &[("driver/line/src/link/tcp_client.rs", "a thread that looks up a host name: getaddrinfo exists only blocking")];

/// Finds `allow` or `expect` of the fence lints in product code, but not in tests, examples and benches.
pub(super) fn holes(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    let is_fenced = |path: &str| path.contains("/src/") && !bans_of(path).is_empty();
    for file in tree.rust().filter(|file| is_fenced(&file.path)) {
        for (number, line, test) in file.code_lines() {
            let lint = ["disallowed_methods", "disallowed_types"].into_iter().find(|lint| has_word(line, lint));
            if let Some(lint) = lint.filter(|_| !test && !HOLES.iter().any(|(path, _)| file.path == *path)) {
                findings.push(Finding {
                    place: format!("{}:{number}", file.path),
                    rule: "invariant 4",
                    what: format!("`{lint}` is switched off in product code: the fence has a hole"),
                });
            }
        }
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fence_that_was_lowered_is_found() {
        let files: Vec<(String, String)> =
            FENCES.iter().map(|(folder, bans)| (place_of(folder), clippy_toml(bans))).collect();
        let mut borrowed: Vec<(&str, &str)> = files.iter().map(|(path, text)| (path.as_str(), text.as_str())).collect();
        assert_eq!(check(&Tree::of(&borrowed)), []);
        borrowed[0].1 = COMMON;
        borrowed.pop();
        let places: Vec<String> = check(&Tree::of(&borrowed)).into_iter().map(|finding| finding.place).collect();
        assert_eq!(places, ["clippy.toml", "xtask/clippy.toml"]);
    }

    #[test]
    fn a_hole_in_product_code_is_found() {
        let source = "#[allow(clippy::disallowed_types)]\nfn a() {}\n#[cfg(test)]\n#[expect(clippy::disallowed_types)]\nmod b {}\n";
        let places = ["runtime/cpu/src/a.rs", "runtime/cpu/examples/a.rs", "runtime/ob1/src/a.rs", "xtask/src/a.rs"];
        let findings = holes(&Tree::of(&places.map(|place| (place, source))));
        assert_eq!(findings.len(), 1);
        assert_eq!(findings[0].place, "runtime/cpu/src/a.rs:1");
    }

    #[test]
    fn a_crate_has_the_fence_of_its_folder_unless_it_has_its_own() {
        assert_eq!(bans_of("driver/params/src/lib.rs"), ALL);
        assert_eq!(bans_of("driver/cp/src/main.rs"), NONE);
        assert_eq!(bans_of("driver/cpu/src/main.rs"), ALL, "a folder whose name only begins so");
        assert_eq!(bans_of("links/gate/src/shared/mod.rs"), NONE);
        assert_eq!(bans_of("xtask/src/main.rs"), NONE);
    }

    #[test]
    fn the_text_is_toml_clippy_reads() {
        let text = clippy_toml(&[Clock]);
        assert!(text.contains("disallowed-types = [\n    { path = \"std::time::Instant\", reason = \"invariant 4"));
        assert!(text.ends_with("]\n"));
    }
}
