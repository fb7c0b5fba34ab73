//! The fences that clippy checks: what a crate must not call or name. The clippy.toml files are generated from this
//! table.
//!
//! The clippy.toml of a crate replaces the one at the root, so each repeats the common part. This guard checks that the
//! files match the table (`cargo xtask arch --bless` writes them), and that no product code disables a fence with an
//! `allow`. The fences also apply to test code; a test that needs an exception (data files, threads of a model) says
//! `#![expect(clippy::disallowed_methods, reason = "...")]`.

use super::Finding;
use super::mask::has_word;
use super::tree::Tree;
use crate::cargo;
use crate::failure::{Outcome, step};

/// One thing that is forbidden to a crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ban {
    /// Reading a clock.
    Clock,
    /// Starting or pausing a thread.
    Threads,
    /// Locks that another thread can hold, and channels built on them.
    Locks,
    /// Files.
    Disk,
    /// Sockets.
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
            Self::Clock => "invariant 4: only ob1 and ob1-cp read the clock; here the time is handed in",
            Self::Threads => "invariants 2, 9, 11: one thread runs everything",
            Self::Locks => "invariants 7, 8: no lock that another thread can hold",
            Self::Disk => "invariant 4: only ob1 and ob1-cp touch the disk",
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

/// Crate folders, and what is forbidden to each.
const FENCES: &[(&str, &[Ban])] = &[
    ("blocks/ir", ALL),
    ("blocks/mc7", ALL),
    ("blocks/model", ALL),
    ("blocks/project", ALL),
    ("blocks/std", ALL),
    ("blocks/stl", ALL),
    ("driver/coupler", ALL),
    ("driver/dp", ALL),
    ("driver/firmware", ALL),
    ("driver/params", ALL),
    ("driver/protocols", ALL),
    ("driver/serial", ALL),
    ("examples/rust-blocks", ALL),
    ("examples/rust-ob1", ALL),
    ("links/access", ALL),
    ("links/s7", ALL),
    ("plugins/abi", ALL),
    ("plugins/cp040", ALL),
    ("plugins/cp240", ALL),
    ("plugins/slio", ALL),
    ("plugins/cp340", ALL),
    ("plugins/cp341", ALL),
    ("plugins/any", ALL),
    ("plugins/cp342", ALL),
    ("plugins/cp343", ALL),
    ("plugins/ptp", ALL),
    ("plugins/mbus", ALL),
    ("plugins/mbus-records", ALL),
    ("plugins/sdk", ALL),
    ("plugins/words", ALL),
    ("runtime/arena", ALL),
    ("runtime/cpu", ALL),
    ("runtime/time", ALL),
    // It gets its memory for code from the system, through rustix.
    ("runtime/native", &[Clock, Threads, Locks, Disk, Net, Process, Hash]),
    // It maps files created by others, through rustix.
    ("plugins/backplane", &[Clock, Threads, Locks, Disk, Net, Hash]),
    // The time is passed in; its pty has a name on the disk, and TCP is one of its lines.
    ("driver/line", &[Clock, Threads, Hash]),
    // It may start processes and load plugins; the time is passed to its supervisor.
    ("runtime/host", &[Clock, Disk, Net, Hash]),
    // It provides the clock, and reads /proc.
    ("runtime/rt", &[Net, Process, Hash]),
];

/// The common part of every clippy.toml.
const COMMON: &str = "avoid-breaking-exported-api = false\n";

/// The clippy.toml of a crate with these bans.
fn clippy_toml(bans: &[Ban]) -> String {
    let mut text =
        String::from("# Written by `cargo xtask arch --bless` from the table in xtask/src/arch/fences.rs.\n");
    text.push_str(COMMON);
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
        let path = cargo::root().join(folder).join("clippy.toml");
        std::fs::write(&path, clippy_toml(bans)).map_err(|why| step(format!("{}: {why}", path.display())))?;
    }
    Ok(())
}

/// Compares the files with the table.
pub(super) fn check(tree: &Tree) -> Vec<Finding> {
    let text_of = |path: &str| tree.files.iter().find(|file| file.path == path).map(|file| file.text.as_str());
    let mut findings = Vec::new();
    for (folder, bans) in FENCES {
        let place = format!("{folder}/clippy.toml");
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
    for file in tree.rust().filter(|file| FENCES.iter().any(|(folder, _)| file.is_in(&[&format!("{folder}/src")]))) {
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
            FENCES.iter().map(|(folder, bans)| (format!("{folder}/clippy.toml"), clippy_toml(bans))).collect();
        let mut borrowed: Vec<(&str, &str)> = files.iter().map(|(path, text)| (path.as_str(), text.as_str())).collect();
        assert_eq!(check(&Tree::of(&borrowed)), []);
        borrowed[0].1 = COMMON;
        borrowed.pop();
        let places: Vec<String> = check(&Tree::of(&borrowed)).into_iter().map(|finding| finding.place).collect();
        assert_eq!(places, ["blocks/ir/clippy.toml", "runtime/rt/clippy.toml"]);
    }

    #[test]
    fn a_hole_in_product_code_is_found() {
        let source = "#[allow(clippy::disallowed_types)]\nfn a() {}\n#[cfg(test)]\n#[expect(clippy::disallowed_types)]\nmod b {}\n";
        let findings = holes(&Tree::of(&[("runtime/cpu/src/a.rs", source), ("runtime/cpu/examples/a.rs", source)]));
        assert_eq!(findings.len(), 1);
        assert_eq!(findings[0].place, "runtime/cpu/src/a.rs:1");
    }

    #[test]
    fn the_text_is_toml_clippy_reads() {
        let text = clippy_toml(&[Clock]);
        assert!(text.contains("disallowed-types = [\n    { path = \"std::time::Instant\", reason = \"invariant 4"));
        assert!(text.ends_with("]\n"));
    }
}
