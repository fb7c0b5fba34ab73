//! What came over, what did not, and why.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use ob1_model::BlockKind;
use ob1_project::{Folder, Note, Notes, Translation, Weight};
use ob1_station_file::finding::Finding;

use super::names::{REPORT, STATION};
use super::station::Made;

/// The report beside the station. `errors` keep it from starting.
pub(super) fn text(title: &str, translation: &Translation, made: &Made, notes: &Notes, errors: &[Finding]) -> String {
    let mut out = format!("Import of {title}\n\n");
    let _ = writeln!(
        out,
        "{} blocks (OB, FB, FC, DB), {} came over, {} were left out.\n{} code blocks are STL that compiles to exactly the \
         statements of their machine code; {} files are machine code.",
        translation.blocks,
        translation.decoded,
        translation.left_out.len(),
        translation.printed,
        translation.images.len()
    );
    if !translation.left_out.is_empty() {
        out.push_str("\nLeft out\n");
        for (block, reason) in &translation.left_out {
            let _ = writeln!(out, "  {block}: {reason}");
        }
    }
    if !errors.is_empty() {
        let _ = writeln!(out, "\n{STARTS_NOT}");
        errors.iter().for_each(|error| out.push_str(&error.text));
    }
    let all: Notes = notes.iter().chain(&translation.notes).chain(&made.notes).cloned().collect();
    for (weight, heading) in [(Weight::Warning, "Warnings"), (Weight::Info, "Worth knowing")] {
        let of_weight: Notes = all.iter().filter(|note| note.weight == weight).cloned().collect();
        if !of_weight.is_empty() {
            let _ = writeln!(out, "\n{heading}");
            for line in together(&of_weight) {
                let _ = writeln!(out, "  {line}");
            }
        }
    }
    out
}

/// A line for each note; equal ones in one, with their count.
pub(super) fn together(notes: &Notes) -> impl Iterator<Item = String> {
    let mut lines: Vec<String> = Vec::new();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for line in notes.iter().map(Note::to_string) {
        let count = counts.entry(line.clone()).or_default();
        *count += 1;
        if *count == 1 {
            lines.push(line);
        }
    }
    lines.into_iter().map(move |line| match counts.get(&line) {
        Some(count) if *count > 1 => format!("{line} ({count} times)"),
        _ => line,
    })
}

/// The heading of errors.
const STARTS_NOT: &str = "The station does not start yet";
/// Errors that the command prints; all are in the report.
const SHOWN: usize = 10;

/// What the command prints at its end. `errors` keep the station from starting.
pub(super) fn summary(title: &str, translation: &Translation, out: &Path, errors: &[Finding]) -> String {
    let mut text = format!("{title}: {} of {} blocks\n", translation.decoded, translation.blocks);
    for (block, reason) in &translation.left_out {
        let _ = writeln!(text, "  left out: {block}: {reason}");
    }
    let station = out.join(STATION);
    let report = out.join(REPORT);
    let _ = writeln!(text, "report: {}", report.display());
    if errors.is_empty() {
        let _ = writeln!(text, "run it: ob1 run {}", station.display());
        return text;
    }
    let _ = writeln!(text, "{STARTS_NOT}; what `ob1 check {}` finds:", station.display());
    errors.iter().take(SHOWN).for_each(|error| text.push_str(&error.text));
    if errors.len() > SHOWN {
        let _ = writeln!(text, "and {} more, in the report", errors.len() - SHOWN);
    }
    text
}

/// The blocks of a folder, a line a kind.
pub(super) fn blocks(folder: &Folder) -> String {
    let mut out = String::new();
    for kind in [BlockKind::Ob, BlockKind::Fb, BlockKind::Fc, BlockKind::Db, BlockKind::Sfb, BlockKind::Sfc] {
        let of_kind = folder.blocks.values().filter(|block| block.id.kind == kind);
        let names: Vec<String> = of_kind
            .map(|block| {
                let lock = if block.know_how { " (protected)" } else { "" };
                match block.head.name.trim() {
                    "" => format!("{}{lock}", block.id.number),
                    name => format!("{} {name}{lock}", block.id.number),
                }
            })
            .collect();
        if !names.is_empty() {
            let _ = writeln!(out, "    {}: {}", kind.name(), names.join(", "));
        }
    }
    if !folder.udts.is_empty() {
        let numbers: Vec<String> = folder.udts.keys().map(u16::to_string).collect();
        let _ = writeln!(out, "    UDT: {}", numbers.join(", "));
    }
    for (block, why) in &folder.damaged {
        let _ = writeln!(out, "    {block}: {why}");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_notes_are_one_line() {
        let note = |what: &str| Note::warning("a", what);
        let lines: Vec<String> = together(&vec![note("x"), note("y"), note("x"), note("x")]).collect();
        assert_eq!(lines, ["a: x (3 times)", "a: y"]);
    }
}
