//! Guards over source text: no allocation in the protocols, unsafe code only in certain crates, no state in plugins,
//! foreign libraries and the disk only in their rooms.

use super::Finding;
use super::mask::has_word;
use super::tree::{File, Tree};

/// Crates that are `no_std` and do not use `alloc`.
const NO_ALLOC: &[(&str, &str)] =
    &[("driver/protocols", "invariant 1"), ("base/serial", "invariant 1"), ("base/time", "invariant 1")];

/// `#![no_std]` at the crate root and no `extern crate` outside tests: then `Vec`, `String` and `Box` are not
/// available.
pub(super) fn no_std_without_alloc(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (folder, rule) in NO_ALLOC {
        let root = format!("{folder}/src/lib.rs");
        let declared = tree.rust().find(|file| file.path == root).is_some_and(|file| {
            file.code.lines().any(|line| matches!(line.trim(), "#![no_std]" | "#![cfg_attr(not(test), no_std)]"))
        });
        if !declared {
            findings.push(Finding { place: root, rule, what: "`#![no_std]` is missing".into() });
        }
        for file in tree.rust().filter(|file| file.is_in(&[folder])) {
            for (number, line, test) in file.code_lines() {
                if !test && has_word(line, "extern") && has_word(line, "crate") {
                    let what = "`extern crate` brings std or alloc back: this crate does without".to_owned();
                    findings.push(Finding { place: format!("{}:{number}", file.path), rule, what });
                }
            }
        }
    }
    findings
}

/// Crates with unsafe code; each block has a SAFETY comment (checked by clippy).
const UNSAFE_CRATES: &[&str] = &[
    "backplane/segment",
    "base/process",
    "plugins/sdk",
    "runtime/arena",
    "runtime/rt",
    "runtime/host",
    "runtime/native",
    "driver/line",
];

/// Other files that need unsafe code, with the reason.
const UNSAFE_FILES: &[(&str, &str)] = &[];

/// Finds `unsafe`, or an `allow` of it, outside these crates.
pub(super) fn unsafe_code(tree: &Tree) -> Vec<Finding> {
    let exempt = |file: &File| file.is_in(UNSAFE_CRATES) || UNSAFE_FILES.iter().any(|(path, _)| file.path == *path);
    let mut findings = Vec::new();
    for file in tree.rust().filter(|file| !exempt(file)) {
        for (number, line, _) in file.code_lines() {
            let leave = has_word(line, "unsafe_code") && (has_word(line, "allow") || has_word(line, "expect"));
            if has_unsafe_code(line) || leave {
                findings.push(Finding {
                    place: format!("{}:{number}", file.path),
                    rule: "invariant 5",
                    what: format!("unsafe code outside {}", UNSAFE_CRATES.join(", ")),
                });
            }
        }
    }
    findings
}

/// Whether a line has `unsafe`, except in the type of a function pointer: `unsafe extern "C" fn(...)`.
fn has_unsafe_code(line: &str) -> bool {
    line.match_indices("unsafe").any(|(at, word)| {
        let rest = line[at + word.len()..].trim_start();
        let rest = rest.strip_prefix("extern").map_or(rest, str::trim_start);
        has_word(&line[at..], word) && !rest.starts_with("fn(")
    }) && has_word(line, "unsafe")
}

/// What only some folders may name: the walls inside a crate.
const ROOMS: &[(&[&str], &[&str])] = &[
    (&["opcua_crypto", "opcua_nodes", "opcua_server", "opcua_types"], &["links/gate/src/opcua", "tests"]),
    (&["rumqttc"], &["links/gate/src/mqtt", "tests"]),
    (
        &["hyper", "hyper_util", "http_body_util"],
        &["links/gate/src/web", "links/gate/src/http", "links/gate/src/metrics"],
    ),
    (&["argon2"], &["links/gate/src/shared"]),
    // Files are for who keeps something; a process gets what it needs of them from the runtime.
    (
        &["ob1_process::files"],
        &[
            "base/process",
            "links/gate/src/web",
            "runtime/record",
            "runtime/station",
            "runtime/station-file",
            "runtime/ob1",
        ],
    ),
];

/// Finds such a name outside its folders, or outside the file that is named as a folder would be.
pub(super) fn rooms(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (words, folders) in ROOMS {
        let is_home = |file: &File| file.is_in(folders) || folders.iter().any(|f| file.path == format!("{f}.rs"));
        for file in tree.rust().filter(|file| !is_home(file)) {
            for (number, line, _) in file.code_lines() {
                // Also in `use a::{b, c}`.
                let names = |path: &&&str| path.split("::").all(|part| has_word(line, part));
                let Some(word) = words.iter().find(names) else { continue };
                findings.push(Finding {
                    place: format!("{}:{number}", file.path),
                    rule: "invariant 2",
                    what: format!("`{word}` belongs to {}", folders.join(", ")),
                });
            }
        }
    }
    findings
}

/// Crates that become part of a plugin.
const PLUGIN_CRATES: &[&str] = &[
    "plugins/cp040",
    "plugins/cp240",
    "plugins/cp340",
    "plugins/cp341",
    "plugins/cp342",
    "plugins/cp343",
    "plugins/mbus",
    "plugins/siemens",
    "backplane/words",
    "plugins/sdk",
    "examples",
];

/// Mutable statics that are allowed, with the reason: file, name of the static.
const PLUGIN_STATICS: &[(&str, &str, &str)] = &[
    ("plugins/sdk/src/panic.rs", "MESSAGE", "invariant 9 itself: the hook copies the message into a fixed buffer"),
    ("plugins/sdk/src/panic.rs", "LEN", "the length of that message"),
];

/// Types that make a static mutable.
const CELLS: &[&str] = &[
    "Cell",
    "RefCell",
    "UnsafeCell",
    "OnceCell",
    "LazyCell",
    "OnceLock",
    "LazyLock",
    "Once",
    "Mutex",
    "RwLock",
    "SyncUnsafeCell",
];

/// Other names that are forbidden in a plugin; clippy also refuses most of them, but a plugin of a user does not have
/// our clippy.toml.
const PLUGIN_WORDS: &[&str] = &["thread_local", "Instant", "SystemTime"];

/// No mutable statics, threads or clocks in plugins: one loaded .so may serve many stations.
pub(super) fn plugin_statics(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for file in tree.rust().filter(|file| file.is_in(PLUGIN_CRATES)) {
        for (number, line, test) in file.code_lines() {
            if test {
                continue;
            }
            let place = format!("{}:{number}", file.path);
            let kept = mutable_static(line)
                .filter(|name| !PLUGIN_STATICS.iter().any(|(path, allowed, _)| file.path == *path && name == allowed));
            if let Some(name) = kept {
                let what = format!("`{name}` outlives the call: state belongs to the host, per station and module");
                findings.push(Finding { place: place.clone(), rule: "invariant 9", what });
            }
            let thread = line.contains("thread::").then_some("thread");
            if let Some(word) = PLUGIN_WORDS.iter().copied().find(|word| has_word(line, word)).or(thread) {
                let what = format!("`{word}` in a plugin: it has no thread and no clock of its own");
                findings.push(Finding { place, rule: "invariant 9", what });
            }
        }
    }
    findings
}

/// The name of the static that this line declares, if it is mutable.
fn mutable_static(line: &str) -> Option<&str> {
    let rest = line.trim_start();
    let declaration = rest.split_once("static ").filter(|(before, _)| {
        before.is_empty() || before.ends_with(' ') && (before.starts_with("pub") || before.starts_with("unsafe"))
    })?;
    let (name, kind) = declaration.1.split_once(':')?;
    let kind = kind.split('=').next().unwrap_or(kind);
    let words = || kind.split(|c: char| !c.is_alphanumeric() && c != '_');
    let changes = words().any(|word| CELLS.contains(&word) || word.starts_with("Atomic"));
    match name.trim().strip_prefix("mut ") {
        Some(name) => Some(name.trim()),
        None => changes.then_some(name.trim()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SERIAL: (&str, &str) = ("base/serial/src/lib.rs", "#![no_std]\n");
    const TIME: (&str, &str) = ("base/time/src/lib.rs", "#![no_std]\n");

    #[test]
    fn no_std_is_demanded_and_alloc_refused() {
        let good = Tree::of(&[
            SERIAL,
            TIME,
            ("driver/protocols/src/lib.rs", "//! x\n#![no_std]\n#[cfg(test)]\nextern crate std;\n"),
        ]);
        assert_eq!(no_std_without_alloc(&good), []);
        let std = Tree::of(&[SERIAL, TIME, ("driver/protocols/src/lib.rs", "// #![no_std]\n")]);
        assert_eq!(no_std_without_alloc(&std).len(), 1);
        let alloc = Tree::of(&[SERIAL, TIME, ("driver/protocols/src/lib.rs", "#![no_std]\nextern crate alloc;\n")]);
        assert_eq!(no_std_without_alloc(&alloc)[0].place, "driver/protocols/src/lib.rs:2");
    }

    #[test]
    fn unsafe_stays_behind_its_fence() {
        let tree = Tree::of(&[
            ("backplane/segment/src/a.rs", "#![allow(unsafe_code)]\nunsafe { x() }"),
            ("runtime/cpu/src/a.rs", "// unsafe\nlet a = \"unsafe\";\nunsafe { x() }"),
            ("driver/firmware/src/a.rs", "#[allow(unsafe_code)]\nfn a() {}"),
            ("plugins/cp240/src/a.rs", "#[unsafe(no_mangle)]\nfn a() {}"),
            (
                "plugins/cp040/src/a.rs",
                "struct A { f: unsafe extern \"C\" fn(u8), g: unsafe fn() }\n#![deny(unsafe_code)]",
            ),
            ("plugins/cp040/src/b.rs", "unsafe extern \"C\" fn g() {}"),
        ]);
        let places: Vec<String> = unsafe_code(&tree).into_iter().map(|finding| finding.place).collect();
        assert_eq!(
            places,
            [
                "runtime/cpu/src/a.rs:3",
                "driver/firmware/src/a.rs:1",
                "plugins/cp240/src/a.rs:1",
                "plugins/cp040/src/b.rs:1",
            ]
        );
    }

    #[test]
    fn a_library_stays_in_its_room() {
        let tree = Tree::of(&[
            ("links/gate/src/mqtt/session.rs", "use rumqttc::Client;"),
            ("links/gate/src/metrics.rs", "use hyper::Request;"),
            ("links/gate/src/mqtt/tls.rs", "use hyper::Request;"),
            ("links/gate/src/shared/tls.rs", "// rumqttc\nuse opcua_types::Variant;"),
            ("driver/cp/src/main.rs", "use ob1_process::{files, log};\nob1_process::log::start();"),
        ]);
        let places: Vec<String> = rooms(&tree).into_iter().map(|finding| finding.place).collect();
        assert_eq!(
            places,
            ["links/gate/src/shared/tls.rs:2", "links/gate/src/mqtt/tls.rs:1", "driver/cp/src/main.rs:1"]
        );
    }

    #[test]
    fn a_plugin_keeps_nothing() {
        let found = |source: &str| plugin_statics(&Tree::of(&[("plugins/cp240/src/a.rs", source)])).len();
        assert_eq!(found("static NAMES: [&str; 2] = [X, Y];\nfn f(x: &'static str) {}"), 0);
        assert_eq!(found("static mut COUNT: u32 = 0;"), 1);
        assert_eq!(found("pub(crate) static COUNT: AtomicU32 = AtomicU32::new(0);"), 1);
        assert_eq!(found("    static LAST: std::sync::Mutex<u8> = x();"), 1);
        assert_eq!(found("thread_local!(x);"), 1);
        assert_eq!(found("std::thread::spawn(x);"), 1);
        assert_eq!(found("let t = std::time::Instant::now();"), 1);
        assert_eq!(found("#[cfg(test)]\nmod tests {\n static A: AtomicU8 = x();\n}"), 0);
        assert_eq!(plugin_statics(&Tree::of(&[("runtime/host/src/a.rs", "static mut A: u8 = 0;")])), []);
    }
}
