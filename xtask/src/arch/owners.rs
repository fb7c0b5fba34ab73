//! Things that are defined only once: the verifier, the table of module types, the words between a handling block and
//! its CP, the types of time.

use std::collections::BTreeMap;

use super::Finding;
use super::tree::{File, Tree};

/// The crate of the words, and the crates that must not define them again.
const WORDS: &str = "backplane/words/src";
const BOTH_SIDES: &[&str] = &[
    "driver/firmware/src",
    "links/s7/src",
    "links/s7-process/src",
    "backplane/segment/src",
    "plugins/cp040/src",
    "plugins/cp240/src",
    "plugins/cp340/src",
    "plugins/cp341/src",
    "plugins/cp342/src",
    "plugins/cp343/src",
    "plugins/mbus/src",
    "runtime/host/src/bus",
    "plugins/siemens/src",
];

/// The table of module types.
const KINDS: &str = "driver/params/src/module_types.rs";

/// Folders in which module types are checked. The name of a plugin may be that of its CP.
const TYPES_COUNT: &[&str] = &["driver", "links", "runtime"];

/// The file of the verifier, the only one that may make a `Verified`.
const VERIFIER: &str = "blocks/ir/src/verify.rs";

/// The crate of instants and durations.
const TIME: &str = "base/time/src";

/// Type names that are not times: the number of a request, a set of registers.
const NO_TIMES: &[&str] = &["Ticket", "Set"];

/// No wire constant is defined twice: neither side defines a constant with the name and the value of one in the words.
pub(super) fn words(tree: &Tree) -> Vec<Finding> {
    let mut owned: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in tree.rust().filter(|file| file.is_in(&[WORDS])) {
        for (_, line, _) in file.code_lines().filter(|(_, _, test)| !test) {
            if let Some((name, value)) = constant(line) {
                owned.entry(name.to_owned()).or_default().push(value.to_owned());
            }
        }
    }
    let mut findings = Vec::new();
    for file in tree.rust().filter(|file| file.is_in(BOTH_SIDES)) {
        for (number, line, _) in file.code_lines().filter(|(_, _, test)| !test) {
            let Some((name, value)) = constant(line) else { continue };
            // A different constant with that name, such as a STATUS, has another value.
            let is_copy = owned.get(name).is_some_and(|values| values.iter().any(|own| own == value));
            if is_copy && value.starts_with(|c: char| c.is_ascii_digit()) {
                findings.push(Finding {
                    place: format!("{}:{number}", file.path),
                    rule: "one owner",
                    what: format!("`{name} = {value}` stands in {WORDS} already: take it from there"),
                });
            }
        }
    }
    findings
}

/// Finds `const NAME: T = VALUE;` in one line.
fn constant(line: &str) -> Option<(&str, &str)> {
    let rest = line.trim_start();
    let rest = rest.strip_prefix("pub(crate) ").or_else(|| rest.strip_prefix("pub ")).unwrap_or(rest);
    let (name, rest) = rest.strip_prefix("const ")?.split_once(':')?;
    let (_, value) = rest.split_once(" = ")?;
    Some((name.trim(), value.strip_suffix(';')?.trim()))
}

/// Only the table distinguishes module types by their names.
pub(super) fn module_types(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for file in tree.rust().filter(|file| file.is_in(TYPES_COUNT) && is_product(file) && file.path != KINDS) {
        for ((number, code, test), text) in file.code_lines().zip(file.text.split('\n')) {
            let is_comment = code.trim().is_empty();
            if !test && !is_comment && (compares_a_type(text) || names_a_cp(text)) {
                findings.push(Finding {
                    place: format!("{}:{number}", file.path),
                    rule: "one owner",
                    what: format!("a module type by its name: ask its row in {KINDS}"),
                });
            }
        }
    }
    findings
}

fn is_product(file: &File) -> bool {
    file.path.contains("/src/") && !file.path.ends_with("tests.rs") && !file.path.contains("/tests/")
}

/// Whether a line compares a type name with anything but the type of a value, such as `BOOL`.
fn compares_a_type(line: &str) -> bool {
    ["type_name ==", "type_name !="].iter().flat_map(|comparison| line.split(comparison).skip(1)).any(|rest| {
        let literal = rest.trim_start().strip_prefix('"').and_then(|text| text.split('"').next());
        literal.is_none_or(|name| name.contains(|c: char| c.is_ascii_lowercase()))
    })
}

/// Whether a line contains a type name of the station file.
fn names_a_cp(line: &str) -> bool {
    line.split("\"cp").skip(1).any(|rest| {
        let mut digits = rest.chars();
        digits.by_ref().take(3).filter(char::is_ascii_digit).count() == 3 && digits.next() == Some('"')
    })
}

/// There is only one verifier: no other file creates a `Verified` or has a function that verifies a program.
pub(super) fn verifier(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for file in tree.rust().filter(|file| file.is_in(&["blocks", "runtime"]) && file.path != VERIFIER) {
        for (number, line, test) in file.code_lines() {
            let second = line.contains("struct Verified") || line.contains("fn verify(") || line.contains("fn verify<");
            if second && !test {
                findings.push(Finding {
                    place: format!("{}:{number}", file.path),
                    rule: "one owner",
                    what: format!("a second verifier: what a program may be is decided in {VERIFIER}"),
                });
            }
        }
    }
    findings
}

/// Instants and durations are types: no alias of a plain number is used for them.
pub(super) fn time(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for file in tree.rust().filter(|file| !file.is_in(&[TIME])) {
        for (number, line, _) in file.code_lines() {
            let Some((name, number_type)) = alias(line) else { continue };
            let is_number = ["u32", "u64", "u128", "i64", "f64"].contains(&number_type);
            if is_number && !NO_TIMES.contains(&name) {
                findings.push(Finding {
                    place: format!("{}:{number}", file.path),
                    rule: "one owner",
                    what: format!(
                        "`{name}` is another name of {number_type}: a time is an `Instant` or a `Span` of {TIME}"
                    ),
                });
            }
        }
    }
    findings
}

/// Finds `type NAME = T;` in one line, except associated types of traits.
fn alias(line: &str) -> Option<(&str, &str)> {
    let rest = line.strip_prefix("pub(crate) ").or_else(|| line.strip_prefix("pub(super) ")).unwrap_or(line);
    let (name, of) = rest.strip_prefix("pub ").unwrap_or(rest).strip_prefix("type ")?.split_once(" = ")?;
    Some((name, of.strip_suffix(';')?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(findings: &[Finding]) -> Vec<&str> {
        findings.iter().map(|finding| finding.place.as_str()).collect()
    }

    #[test]
    fn a_wire_constant_of_ones_own_is_found() {
        let tree = Tree::of(&[
            ("backplane/words/src/cp240.rs", "pub const BLOCK_BYTES: usize = 12;\npub const FAILED: u16 = 0x2000;\n"),
            ("plugins/cp240/src/a.rs", "pub(crate) const BLOCK_BYTES: u16 = 12;\nconst FAILED: u16 = 0x1E0F;\n"),
            ("driver/firmware/src/a.rs", "const BLOCK_BYTES: u16 = cp240::BLOCK_BYTES as u16;\n"),
            ("driver/firmware/src/b.rs", "// const FAILED: u16 = 0x2000;\npub const FAILED: u16 = 0x2000;\n"),
            ("links/s7/src/a.rs", "const BLOCK_BYTES: usize = 12;\n"),
        ]);
        let found = ["plugins/cp240/src/a.rs:1", "driver/firmware/src/b.rs:2", "links/s7/src/a.rs:1"];
        assert_eq!(places(&words(&tree)), found);
    }

    #[test]
    fn a_module_type_by_its_name_is_found() {
        let tree = Tree::of(&[
            ("driver/params/src/module_types.rs", "name: \"cp240\",\n"),
            ("runtime/ob1/src/a.rs", "// \"cp341\"\nif view.type_name == \"cp341\" {}\n"),
            (
                "runtime/station/src/b.rs",
                "let a = \"cp240_1\";\n#[cfg(test)]\nmod tests { const A: &str = \"cp240\"; }\n",
            ),
            ("runtime/ob1/src/c.rs", "if value.type_name == \"BOOL\" {}\nif a.type_name != b.type_name {}\n"),
            ("runtime/station/tests/b.rs", "let a = \"cp240\";\n"),
            ("driver/cp/src/a.rs", "match name { \"cp040\" => 1, _ => 2 }\n"),
        ]);
        let found = ["runtime/ob1/src/a.rs:2", "runtime/ob1/src/c.rs:2", "driver/cp/src/a.rs:1"];
        assert_eq!(places(&module_types(&tree)), found);
    }

    #[test]
    fn a_second_verifier_is_found() {
        let tree = Tree::of(&[
            ("blocks/ir/src/verify.rs", "pub struct Verified<T>(T);\npub fn verify<T>() {}\n"),
            ("runtime/cpu/src/engine/verify.rs", "fn verify(program: &Program) {}\n"),
            ("runtime/cpu/src/a.rs", "fn verify_later() {}\n"),
        ]);
        assert_eq!(places(&verifier(&tree)), ["runtime/cpu/src/engine/verify.rs:1"]);
    }

    #[test]
    fn a_time_that_is_a_bare_number_is_found() {
        let tree = Tree::of(&[
            ("base/time/src/span.rs", "type Nanos = u64;\n"),
            ("base/serial/src/lib.rs", "// pub type Nanos = u64;\npub type Nanos = u64;\n"),
            ("runtime/rt/src/a.rs", "pub(crate) type Millis = u32;\npub type Ticket = u64;\ntype Pair = (u64, u64);\n"),
            ("links/gate/src/a.rs", "impl Iterator for A {\n    type Item = u64;\n}\n"),
        ]);
        assert_eq!(places(&time(&tree)), ["base/serial/src/lib.rs:2", "runtime/rt/src/a.rs:1"]);
    }
}
