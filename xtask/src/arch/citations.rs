//! Every citation of a manual, `[S0 L1631]` or `[S0 "Timeout times"]`, names a known manual and existing lines.

use std::ops::RangeInclusive;

use super::Finding;
use super::tree::Tree;

/// The manuals and their numbers of lines.
const MANUALS: &[(&str, u32)] = &[("S0", 4956), ("S1", 2499), ("S3", 400), ("S4", 2330)];

const RULE: &str = "invariant 12";

/// The number of lines of a manual, 0 if there is none of this name.
pub(super) fn length(manual: &str) -> usize {
    MANUALS.iter().find(|(name, _)| *name == manual).map_or(0, |(_, lines)| *lines as usize)
}

/// Checks all citations in the checkout.
pub(super) fn check(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    // The tests in this file contain wrong citations on purpose.
    for file in tree.files.iter().filter(|file| file.path != "xtask/src/arch/citations.rs") {
        for (index, line) in file.text.lines().enumerate() {
            for citation in citations(line) {
                if let Err(what) = verify(citation) {
                    let place = format!("{}:{}", file.path, index + 1);
                    findings.push(Finding { place, rule: RULE, what: format!("[{citation}]: {what}") });
                }
            }
        }
    }
    findings
}

/// The text between `[S<digit>` and `]`.
fn citations(line: &str) -> impl Iterator<Item = &str> {
    line.match_indices("[S").filter_map(|(at, _)| {
        let inner = &line[at + 1..];
        let digit = inner.as_bytes().get(1).is_some_and(u8::is_ascii_digit);
        let citation = &inner[..inner.find(']')?];
        // `[S7]` and similar are words and not citations.
        (digit && citation.contains(' ')).then_some(citation)
    })
}

/// `S0 L12`, `S0 L12-34`, `S0 L12, L34-56`, `S0 "Title"`, `S0 "Title", L12`; several manuals are separated by `;`.
fn verify(citation: &str) -> Result<(), String> {
    for part in citation.split(';') {
        let part = part.trim();
        let (manual, rest) = part.split_once(' ').ok_or("names no place in the manual")?;
        let (_, last) = MANUALS.iter().find(|(name, _)| *name == manual).ok_or("there is no such manual")?;
        let outside_titles: String = rest.split('"').step_by(2).collect();
        let mut places = usize::from(rest.contains('"'));
        for word in outside_titles.split([',', ' ']).map(str::trim).filter(|word| word.starts_with('L')) {
            let lines = lines(word).ok_or_else(|| format!("`{word}` is no line or range of lines"))?;
            if lines.is_empty() || *lines.start() == 0 || lines.end() > last {
                return Err(format!("{manual} has the lines 1 to {last}"));
            }
            places += 1;
        }
        if places == 0 {
            return Err("names neither a title nor a line".to_owned());
        }
    }
    Ok(())
}

/// `L12` or `L12-34`, also `L12-L34`.
fn lines(word: &str) -> Option<RangeInclusive<u32>> {
    let numbers = word.strip_prefix('L')?;
    let (from, to) = numbers.split_once(['-', '–']).unwrap_or((numbers, numbers));
    Some(from.parse().ok()?..=to.trim_start_matches('L').parse().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn good_citations_pass() {
        for good in
            ["S0 L1631", "S0 L1590-1668, L1911-2030", "S0 \"Timeout times\"", "S1 L2498; S3 L1", "S4 \"A\", L2330"]
        {
            assert_eq!(verify(good), Ok(()), "{good}");
        }
    }

    #[test]
    fn a_line_that_is_not_there_is_found() {
        for bad in ["S0 L4957", "S3 L399-401", "S2 L1", "S0 L20-10", "S0 L0", "S0 Lx", "S0 page 3", "S0 L1; S1 L2500"] {
            assert!(verify(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn the_place_is_named() {
        let tree = Tree::of(&[("a/src/a.rs", "// [S0 L1631]\nfn a() {} // see [S0 L5000], not [S7] or [S5T#1s]\n")]);
        let findings = check(&tree);
        assert_eq!(findings.len(), 1);
        assert_eq!(findings[0].place, "a/src/a.rs:2");
    }
}
