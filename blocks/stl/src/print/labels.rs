//! Labels of the statements that jumps lead to.

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{CodeBlock, Op};

use crate::jumps::LABEL_LENGTH;
use crate::mnemonics::ROWS;

/// A label for each target: the one that is given, where it can stand, else one that is made.
pub(super) fn labels(block: &CodeBlock, given: &BTreeMap<u32, String>) -> BTreeMap<u32, String> {
    let mut targets = BTreeSet::new();
    for stmt in &block.code {
        match &stmt.op {
            Op::Jump(_, to) | Op::Loop(to) => drop(targets.insert(*to)),
            Op::JumpList { targets: list, otherwise } => {
                targets.extend(list.iter().copied());
                targets.insert(*otherwise);
            }
            _ => {}
        }
    }
    let mut labels = BTreeMap::new();
    let mut used = BTreeSet::new();
    for target in &targets {
        if let Some(name) = given.get(target).filter(|name| is_label(name) && used.insert((*name).clone())) {
            labels.insert(*target, name.clone());
        }
    }
    let mut next = 0u32;
    for target in targets {
        labels.entry(target).or_insert_with(|| {
            loop {
                next += 1;
                let name = made(next);
                if is_label(&name) && used.insert(name.clone()) {
                    return name;
                }
            }
        });
    }
    labels
}

/// `M001` to `M999`, then four letters and digits.
fn made(number: u32) -> String {
    if number < 1000 {
        return format!("M{number:03}");
    }
    let mut left = number - 1000;
    let mut digits = Vec::new();
    for base in [36u32, 36, 36, 20] {
        digits.push(char::from_digit(left % base, 36).unwrap_or('0'));
        left /= base;
    }
    // The first is a letter other than M: N to Z, then A to G.
    let first = char::from(
        if digits[3].to_digit(36).unwrap_or(0) < 13 { b'N' } else { b'A' - 13 }
            + digits[3].to_digit(36).unwrap_or(0) as u8,
    );
    let rest: String = digits[..3].iter().rev().collect::<String>().to_ascii_uppercase();
    format!("{first}{rest}")
}

/// True for what can be before a colon as a label.
fn is_label(name: &str) -> bool {
    let mut chars = name.chars();
    let word =
        chars.next().is_some_and(|c| c.is_alphabetic() || c == '_') && chars.all(|c| c.is_alphanumeric() || c == '_');
    let keyword = ["BE", "END_", "NETWORK", "BEGIN"].iter().any(|w| name.eq_ignore_ascii_case(w));
    word && name.chars().count() <= LABEL_LENGTH && !keyword
        // A mnemonic as label is not a mistake, but hard to read.
        && !ROWS.iter().any(|row| row.german == name && row.international == name && name.len() > 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn made_labels_differ() {
        let all: BTreeSet<String> = (1..300_000).map(made).collect();
        assert_eq!(all.len(), 299_999);
        // Some are words of the language (NEGD), which are passed over.
        let words: Vec<&String> = all.iter().filter(|name| !is_label(name)).collect();
        assert!(words.contains(&&"NEGD".to_owned()) && words.len() < 100, "{words:?}");
        assert_eq!(made(1), "M001");
    }
}
