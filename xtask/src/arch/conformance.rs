//! The conformance tables of the CPs: every row of the manuals with the test that proves it, or the reason why there is
//! no test.
//!
//! `docs/conformance/*.rows` are written by hand, and `cargo xtask arch --bless` generates the pages from them. The
//! guard finds rows without test and reason, missing tests, sections without a row, lines of a manual without a row,
//! and pages that do not match the rows.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::ops::RangeInclusive;

use super::Finding;
use super::citations;
use super::tree::{File, Tree};
use crate::cargo;
use crate::failure::{Outcome, step};

const RULE: &str = "conformance";

/// A table with its page.
struct Manual {
    rows: &'static str,
    page: &'static str,
    /// The sections it must contain.
    sections: &'static str,
    /// The beginning of the page.
    head: &'static str,
    /// The event numbers are also rows of this table.
    has_events: bool,
    /// The manual of which each line has a row.
    whole: Option<&'static str>,
}

const MANUALS: [Manual; 6] = [
    Manual {
        rows: "docs/conformance/cp240.rows",
        page: "docs/conformance/cp240.md",
        sections: SECTIONS_240,
        head: HEAD_240,
        has_events: false,
        whole: Some("S0"),
    },
    Manual {
        rows: "docs/conformance/cp240-enocean.rows",
        page: "docs/conformance/cp240-enocean.md",
        sections: SECTIONS_240_ENOCEAN,
        head: HEAD_240_ENOCEAN,
        has_events: false,
        whole: Some("S1"),
    },
    Manual {
        rows: "docs/conformance/cp040.rows",
        page: "docs/conformance/cp040.md",
        sections: SECTIONS_040,
        head: HEAD_040,
        has_events: false,
        whole: Some("S3"),
    },
    Manual {
        rows: "docs/conformance/cp341.rows",
        page: "docs/conformance/cp341.md",
        sections: SECTIONS,
        head: HEAD,
        has_events: true,
        whole: None,
    },
    Manual {
        rows: "docs/conformance/cp340.rows",
        page: "docs/conformance/cp340.md",
        sections: SECTIONS_340,
        head: HEAD_340,
        has_events: false,
        whole: None,
    },
    Manual {
        rows: "docs/conformance/cp342.rows",
        page: "docs/conformance/cp342.md",
        sections: "blocks; DPSTATUS; DTYPE; CTYPE; STATUS",
        head: HEAD_342,
        has_events: false,
        whole: None,
    },
];

/// The table of event numbers, generated from the code.
const EVENTS: &str = "docs/cp341-events.md";

/// The reasons for a row without test.
const REASONS: [&str; 3] = ["fact only", "other module", "hardware fault"];

/// The sections the table must contain: chapters 3 to 7 of the driver's manual, sections 1 to 6 of the reference. 3.2
/// to 3.14 of the reference are the event numbers.
const SECTIONS: &str = "
    S4 3.1; S4 3.2; S4 3.3; S4 3.4; S4 3.5; S4 3.6; S4 3.6.1; S4 3.6.2; S4 3.6.3; S4 3.7; S4 3.8; S4 4; S4 4.1; S4 4.2; S4 4.3;
    S4 5; S4 5.1; S4 5.2; S4 5.3; S4 5.4; S4 5.5; S4 5.6; S4 5.7; S4 5.8; S4 5.9; S4 5.10; S4 5.11; S4 5.12; S4 5.13; S4 5.14; S4 5.15;
    S4 6; S4 6.1.1; S4 6.1.2; S4 7; S4 7.1; S4 7.2; S4 7.3;
    reference 1.0; reference 1.1; reference 1.2; reference 1.3; reference 1.4; reference 1.5; reference 1.6; reference 1.7;
    reference 1.8; reference 1.9; reference 2; reference 2.1; reference 2.2; reference 3.1; reference 4.1; reference 4.2; reference 4.3;
    reference 4.4; reference 4.5; reference 4.6; reference 4.7; reference 4.8; reference 4.9; reference 4.10; reference 4.11;
    reference 5.1; reference 5.2; reference 5.3; reference 5.4; reference 5.5; reference 5.6; reference 5.7;
    reference 6.1; reference 6.2; reference 6.3; reference 6.4; reference 6.5; reference 6.6; events";

/// The pages of the manuals that are publicly available, and the blocks.
const SECTIONS_340: &str = "
    CP 340 blocks; CP 340 p. 39; CP 340 p. 54; CP 340 p. 64; CP 340 p. 67; CP 340 p. 72; CP 340 p. 85; CP 340 p. 142; CP 340 p. 143;
    CP 341 p. 76; CP 341 p. 94; CP 341 p. 100; CP 341 p. 101; CP 341 p. 103; reference 3.7";

/// The sections of the CP 240's manual, by the pages of its table of contents.
const SECTIONS_240: &str = "
    S0 0; S0 1-2; S0 1-3; S0 1-4; S0 1-5; S0 2-2; S0 2-5; S0 2-8; S0 2-10; S0 2-12; S0 3-2; S0 3-3; S0 3-4;
    S0 3-7; S0 3-8; S0 3-9; S0 3-10; S0 3-11; S0 3-12; S0 3-14; S0 3-16; S0 3-17; S0 4-2; S0 4-3; S0 4-4; S0 4-5;
    S0 4-10; S0 4-11; S0 4-12; S0 4-16; S0 4-18; S0 4-19; S0 4-22; S0 4-26; S0 4-27; S0 4-28; S0 4-31; S0 4-34; S0 4-35; S0 4-39;
    S0 4-40; S0 4-46; S0 5-2; S0 5-3; S0 5-4; S0 5-5; S0 5-7; S0 5-9; S0 5-14; S0 5-17; S0 5-29; S0 5-31; S0 6-2; S0 6-3; S0 6-4;
    S0 6-5; S0 6-6; S0 6-8; S0 6-13; S0 6-17; S0 A";

/// The sections of the manual of the CP 240 EnOcean, by the pages of its table of contents.
const SECTIONS_240_ENOCEAN: &str = "
    S1 0; S1 1-2; S1 1-3; S1 1-5; S1 1-7; S1 1-11; S1 1-12; S1 1-14; S1 1-17; S1 2-2; S1 2-3; S1 2-5; S1 3-2; S1 3-3; S1 3-5;
    S1 3-6; S1 3-9; S1 3-12; S1 3-14; S1 3-19; S1 3-34";

/// The chapters of the CP 040's manual.
const SECTIONS_040: &str = "
    S3 1; S3 2; S3 2.8; S3 3.1; S3 3.2; S3 3.3; S3 4.1; S3 4.2; S3 4.3.1; S3 4.3.2; S3 4.3.3; S3 4.4; S3 4.5;
    S3 5.1; S3 5.2; S3 5.3; S3 5.4; S3 5.5; S3 5.6; S3 5.6.3; S3 5.6.4";

const HEAD_240: &str = "\
# Conformance of the CP 240

Every line of the CP 240's manual (S0) with the test that proves what it requires, or the reason why there is none:
*fact only* (nothing to be done by this program), *other module*, *hardware fault*. Where two lines of the manual
contradict each other, the row says so; what ob1 does then is
[decision 20](../decisions/0020-what-the-cp-manuals-leave-open.md).

Made of `docs/conformance/cp240.rows` by `cargo xtask arch --bless`; `cargo xtask arch` fails when a row has neither,
when a test is not there, when a section has no row, and when a line of the manual has none.
";

const HEAD_240_ENOCEAN: &str = "\
# Conformance of the CP 240 EnOcean

Every line of the EnOcean module's own manual (S1, German) with the test that proves what it requires, or the reason why
there is none: *fact only* (nothing to be done by this program), *other module*, *hardware fault*. What it shares with
the [manual of the CP 240](cp240.md) has the same tests.

Made of `docs/conformance/cp240-enocean.rows` by `cargo xtask arch --bless`; `cargo xtask arch` fails when a row has
neither, when a test is not there, when a section has no row, and when a line of the manual has none.
";

const HEAD_040: &str = "\
# Conformance of the CP 040

Every line of the CP 040's manual (S3, the excerpts that are public) with the test that proves what it requires, or the
reason why there is none: *fact only* (nothing to be done by this program), *other module*, *hardware fault*. A row that
says *ours* is our decision, because the excerpt is silent ([registers](../cp040-registers.md)).

Made of `docs/conformance/cp040.rows` by `cargo xtask arch --bless`; `cargo xtask arch` fails when a row has neither,
when a test is not there, when a section has no row, and when a line of the manual has none.
";

const HEAD_342: &str = "\
# Conformance of the CP 342-5

What FC 1 to FC 4 of a DP master do, with the test that proves it or the reason why there is none: *fact only* (nothing
to be done by this program), *other module*. A row that says *ours* is our decision
([decision 43](../decisions/0043-cp-342-5.md)).

Made of `docs/conformance/cp342.rows` by `cargo xtask arch --bless`; `cargo xtask arch` fails when a row has neither,
when a test is not there, and when a section has no row.
";

const HEAD_340: &str = "\
# Conformance of the CP 340 and of the printer driver

What the manual of the CP 340 (04/2011), and that of the CP 341 (09/2008) about the printer driver, say as far as public
text has it, with the test that proves it or the reason why there is none: *fact only* (nothing to be done by this
program), *other module*, *hardware fault*. A row that says *ours* is our decision, because the text at hand is silent
([CP 340](../cp340.md), [printer driver](../cp340-printer.md)).

Made of `docs/conformance/cp340.rows` by `cargo xtask arch --bless`; `cargo xtask arch` fails when a row has neither,
when a test is not there, and when a section has no row.
";

const HEAD: &str = "\
# Conformance of the CP 341

Every row of chapters 3 to 7 of the loadable driver's manual (S4) and of sections 1 to 6 of the reference, with the test
that proves it or the reason why there is none: *fact only* (nothing to be done by this program), *other module*,
*hardware fault*. \"Reference\" with a number is a section of the facts about CP 341 and CP 340 that were gathered from
their manuals and TIA Portal's help before the blocks were written; each row here says the fact itself.

Made of `docs/conformance/cp341.rows` by `cargo xtask arch --bless`; `cargo xtask arch` fails when a row has neither,
when a test is not there, and when a section has no row.
";

/// A row of a `.rows` file, with its line.
struct Row<'a> {
    line: usize,
    place: &'a str,
    text: &'a str,
    proof: &'a str,
}

/// The contents of a rows file.
#[derive(Default)]
struct Table<'a> {
    aliases: BTreeMap<&'a str, &'a str>,
    sections: Vec<(&'a str, Vec<Row<'a>>)>,
    flaws: Vec<(usize, String)>,
}

impl<'a> Table<'a> {
    fn read(text: &'a str) -> Self {
        let mut table = Self::default();
        for (line, content) in (1..).zip(text.lines()).filter(|(_, content)| !content.trim().is_empty()) {
            let columns: Vec<&str> = content.split(" | ").map(str::trim).collect();
            match (content.as_bytes()[0], &columns[..]) {
                (b'#', _) => {}
                (b'@', _) => match content[1..].split_once(' ') {
                    Some((alias, path)) => drop(table.aliases.insert(alias, path.trim())),
                    None => table.flaws.push((line, "an alias is `@NAME PATH`".into())),
                },
                (b'=', _) => table.sections.push((content.trim_start_matches("== ").trim(), Vec::new())),
                (_, &[place, text, proof]) => match table.sections.last_mut() {
                    Some((_, rows)) => rows.push(Row { line, place, text, proof }),
                    None => table.flaws.push((line, "a row before the first section".into())),
                },
                _ => table.flaws.push((line, "a row is `PLACE | WHAT IT SAYS | TEST or REASON`".into())),
            }
        }
        table
    }

    fn rows(&self) -> impl Iterator<Item = &Row<'a>> {
        self.sections.iter().flat_map(|(_, rows)| rows)
    }

    /// The tests that a row names, `alias::name, alias::name`; or the error in one.
    fn prove(&self, tree: &Tree, row: &Row<'_>) -> Result<Vec<(&'a str, String)>, String> {
        let mut tests = Vec::new();
        for proof in row.proof.split(',').map(str::trim) {
            let (alias, name) = proof.split_once("::").ok_or(format!("`{proof}` is neither a test nor a reason"))?;
            let path = *self.aliases.get(alias).ok_or(format!("no file has the name `{alias}`"))?;
            let file = tree.files.iter().find(|file| file.path == path).ok_or(format!("{path} is not there"))?;
            if !has_test(file, name) {
                return Err(format!("{path} has no test `{name}`"));
            }
            tests.push((path, name.to_owned()));
        }
        Ok(tests)
    }
}

/// `fn name(` with `#[test]` above it; attributes and comments (which are blank here) may be between.
fn has_test(file: &File, name: &str) -> bool {
    let lines: Vec<&str> = file.code.split('\n').map(str::trim).collect();
    let head = format!("fn {name}(");
    let is_between = |line: &&&str| line.is_empty() || line.starts_with("#[");
    lines.iter().enumerate().any(|(at, line)| {
        line.starts_with(&head) && lines[..at].iter().rev().take_while(is_between).any(|above| *above == "#[test]")
    })
}

impl Manual {
    /// The event numbers that are rows of this table.
    fn events<'t>(&self, tree: &'t Tree) -> Vec<(&'t str, &'t str, &'t str)> {
        if self.has_events { events(tree) } else { Vec::new() }
    }
}

/// An event number of the page: number, text, why it does not occur.
fn events(tree: &Tree) -> Vec<(&str, &str, &str)> {
    let page = tree.files.iter().find(|file| file.path == EVENTS).map_or("", |file| &file.text);
    let rows = page.lines().filter_map(|line| {
        let columns: Vec<&str> = line.strip_prefix("| ")?.split('|').map(str::trim).collect();
        let &[number, text, _, reason, ..] = &columns[..] else { return None };
        (number.len() == 4 && u16::from_str_radix(number, 16).is_ok()).then_some((number, text, reason))
    });
    rows.collect()
}

/// Whether a heading belongs to this section: `S4 3.6.1 Modbus ASCII Protocol` belongs to `S4 3.6.1`.
fn is_about(heading: &str, section: &str) -> bool {
    heading.strip_prefix(section).is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
}

/// The lines of the manual that a place names: `L12`, `L12-15`, several parted by commas.
fn lines_of(place: &str) -> Option<Vec<RangeInclusive<usize>>> {
    let range = |part: &str| {
        let part = part.trim().strip_prefix('L')?;
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let range: RangeInclusive<usize> = first.parse().ok()?..=last.parse().ok()?;
        (!range.is_empty()).then_some(range)
    };
    place.split(',').map(range).collect()
}

/// The lines of a manual that no row names, as ranges; or the rows whose places are no lines of it.
fn holes(table: &Table<'_>, lines: usize) -> Vec<(Option<usize>, String)> {
    let mut has_row = vec![false; lines];
    let mut flaws = Vec::new();
    for row in table.rows() {
        let named = lines_of(row.place);
        match named.filter(|ranges| ranges.iter().all(|range| *range.start() > 0 && *range.end() <= lines)) {
            Some(ranges) => ranges.into_iter().flatten().for_each(|line| has_row[line - 1] = true),
            None => flaws.push((Some(row.line), format!("`{}` are no lines of the manual, `L1-{lines}`", row.place))),
        }
    }
    let lines: Vec<usize> = (1..=lines).collect();
    let runs = lines.chunk_by(|a, b| has_row[a - 1] == has_row[b - 1]).filter(|run| !has_row[run[0] - 1]);
    flaws.extend(runs.map(|run| (None, format!("L{}-{} has no row", run[0], run[run.len() - 1]))));
    flaws
}

/// The guard: each table has all its sections, and each row a proof.
pub(super) fn check(tree: &Tree) -> Vec<Finding> {
    let required = |manual: &Manual| manual.sections.split(';').map(str::trim);
    MANUALS.iter().flat_map(|manual| check_against(tree, manual, required(manual))).collect()
}

fn check_against<'s>(tree: &Tree, manual: &Manual, required: impl Iterator<Item = &'s str>) -> Vec<Finding> {
    let finding = |place: String, what: String| Finding { place, rule: RULE, what };
    let (rows, page_path) = (manual.rows, manual.page);
    let Some(file) = tree.files.iter().find(|file| file.path == rows) else {
        return vec![finding(rows.into(), "is not there".into())];
    };
    let table = Table::read(&file.text);
    let at = |line: usize| format!("{rows}:{line}");
    let mut findings: Vec<Finding> = table.flaws.iter().map(|(line, what)| finding(at(*line), what.clone())).collect();
    for row in table.rows().filter(|row| !REASONS.contains(&row.proof)) {
        if let Err(what) = table.prove(tree, row) {
            findings.push(finding(at(row.line), what));
        }
    }
    for section in required {
        let counts =
            table.sections.iter().filter(|(heading, _)| is_about(heading, section)).map(|(_, rows)| rows.len());
        if counts.sum::<usize>() == 0 {
            findings.push(finding(rows.into(), format!("{section} has no row")));
        }
    }
    for (line, what) in manual.whole.map_or_else(Vec::new, |name| holes(&table, citations::length(name))) {
        findings.push(finding(line.map_or_else(|| rows.into(), at), what));
    }
    let listed: BTreeSet<&str> = event_rows(&table).map(|row| row.place).collect();
    for (number, _, reason) in manual.events(tree) {
        match (listed.contains(number), reason) {
            (false, "") => findings.push(finding(rows.into(), format!("{number} occurs, and no row names its test"))),
            (true, reason) if !reason.is_empty() => {
                findings.push(finding(rows.into(), format!("{number} has a test and a reason to have none")));
            }
            _ => {}
        }
    }
    if tree.files.iter().find(|file| file.path == page_path).is_none_or(|file| file.text != page(tree, manual, &table))
    {
        findings.push(finding(page_path.into(), "is not made of the rows; cargo xtask arch --bless".into()));
    }
    findings
}

fn event_rows<'t>(table: &'t Table<'_>) -> impl Iterator<Item = &'t Row<'t>> {
    table.sections.iter().filter(|(heading, _)| is_about(heading, "events")).flat_map(|(_, rows)| rows)
}

/// Writes the pages of all tables anew.
pub(super) fn bless() -> Outcome {
    let tree = Tree::read()?;
    for manual in &MANUALS {
        let rows = tree.files.iter().find(|file| file.path == manual.rows).map_or("", |file| &file.text);
        let path = cargo::root().join(manual.page);
        let page = page(&tree, manual, &Table::read(rows));
        std::fs::write(&path, page).map_err(|why| step(format!("{}: {why}", path.display())))?;
    }
    Ok(())
}

fn page(tree: &Tree, manual: &Manual, table: &Table<'_>) -> String {
    let mut page = manual.head.to_owned();
    let count = |is: &dyn Fn(&Row<'_>) -> bool| table.rows().filter(|row| is(row)).count();
    let without = manual.events(tree).iter().filter(|(_, _, reason)| !reason.is_empty()).count();
    let reasons = count(&|row| REASONS.contains(&row.proof)) + without;
    let proven = count(&|_| true) + without - reasons;
    let _ = write!(page, "\n{proven} rows have a test, {reasons} a reason why there is none.\n");
    for (heading, rows) in table.sections.iter().filter(|(heading, _)| !is_about(heading, "events")) {
        // S0, S1, S3, S4: the places are lines of this manual.
        let is_manual = |name: &&str| name.len() == 2 && name.starts_with('S');
        let manual = heading.split(' ').next().filter(is_manual).map_or(String::new(), |name| format!("{name} "));
        let _ = write!(page, "\n## {heading}\n\n| place | what it says | proof |\n|---|---|---|\n");
        for row in rows {
            let _ = writeln!(page, "| {manual}{} | {} | {} |", row.place, row.text, proof(tree, table, row));
        }
    }
    if !manual.has_events {
        return page;
    }
    page += "\n## Event numbers: S4 7.3, reference 3.2 to 3.14\n\n| number | event | proof |\n|---|---|---|\n";
    for (number, text, reason) in events(tree) {
        let proof = match event_rows(table).find(|row| row.place == number) {
            Some(row) if reason.is_empty() => proof(tree, table, row),
            _ => reason.to_owned(),
        };
        let _ = writeln!(page, "| {number} | {text} | {proof} |");
    }
    page
}

fn proof(tree: &Tree, table: &Table<'_>, row: &Row<'_>) -> String {
    match table.prove(tree, row) {
        Ok(tests) if !REASONS.contains(&row.proof) => {
            let cells: Vec<String> =
                tests.iter().map(|(path, name)| format!("`{name}` ({})", path.trim_end_matches(".rs"))).collect();
            cells.join("<br>")
        }
        _ => row.proof.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CP341: &Manual = &MANUALS[3];
    const WHOLE: Manual = Manual { whole: Some("S3"), has_events: false, ..MANUALS[0] };
    const CODE: &str = "#[test]\nfn good() {}\nfn helper() {}\n// fn commented()\n";
    const EVENT_PAGE: &str = "| STATUS | event |\n| 0E20 | bits | remedy | |\n| 0101 | memory | | hardware fault |\n";
    const GOOD: &str = "@m a/tests/m.rs\n== S4 3.1 Title\nL12 | said | m::good\nL13 | said | fact only\n== events\n0E20 | - | m::good\n";

    /// The findings for these rows with a matching page.
    fn findings(rows: &str) -> Vec<String> {
        let files = [("a/tests/m.rs", CODE), (EVENTS, EVENT_PAGE), (CP341.rows, rows)];
        let page = page(&Tree::of(&files), CP341, &Table::read(rows));
        let tree = Tree::of(&[files[0], files[1], files[2], (CP341.page, &page)]);
        check_against(&tree, CP341, ["S4 3.1", "events"].into_iter()).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_whole_table_passes() {
        assert_eq!(findings(GOOD), Vec::<String>::new());
    }

    #[test]
    fn each_breach_is_found() {
        for (from, to, says) in [
            ("fact only", "somehow", "neither a test nor a reason"),
            ("| fact only", "", "a row is"),
            ("fact only", "m::helper", "no test `helper`"),
            ("fact only", "m::commented", "no test `commented`"),
            ("fact only", "n::good", "no file has the name"),
            ("a/tests/m.rs", "a/tests/n.rs", "is not there"),
            ("S4 3.1 ", "S4 3.10 ", "S4 3.1 has no row"),
            ("0E20", "0E21", "0E20 occurs"),
            ("0E20", "0101", "0101 has a test and a reason"),
        ] {
            let found = findings(&GOOD.replace(from, to));
            assert!(found.iter().any(|finding| finding.contains(says)), "{from} -> {to}: {found:?}");
        }
    }

    #[test]
    fn each_line_of_a_whole_manual_has_a_row() {
        let good = "@m a/tests/m.rs\n== S3 1 Title\nL1-3, L6-400 | said | m::good\nL3-5 | said | fact only\n";
        for (from, to, says) in [
            ("", "", ""),
            ("L1-3, L6-400", "L1-3, L8-400", "L6-7 has no row"),
            ("L1-3, ", "L2-3, ", "L1-1 has no row"),
            ("L3-5", "L4-5", ""),
            ("L6-400", "L6-401", "`L1-3, L6-401` are no lines of the manual"),
            ("L3-5", "L0-5", "`L0-5` are no lines"),
            ("L3-5", "L5-3", "`L5-3` are no lines"),
            ("L3-5", "page 3", "`page 3` are no lines"),
        ] {
            let rows = good.replacen(from, to, 1);
            let code = [("a/tests/m.rs", CODE), (WHOLE.rows, &rows)];
            let page = page(&Tree::of(&code), &WHOLE, &Table::read(&rows));
            assert!(page.contains("| S3 L3-5 | said |") || !from.is_empty(), "{page}");
            let tree = Tree::of(&[code[0], code[1], (WHOLE.page, &page)]);
            let found = check_against(&tree, &WHOLE, ["S3 1"].into_iter());
            let text = found.iter().map(ToString::to_string).collect::<String>();
            assert!(found.is_empty() == says.is_empty() && text.contains(says), "{from} -> {to}: {text}");
        }
    }

    #[test]
    fn a_page_of_other_rows_is_found() {
        let tree =
            Tree::of(&[("a/tests/m.rs", CODE), (EVENTS, EVENT_PAGE), (CP341.rows, GOOD), (CP341.page, "# Old\n")]);
        let found = check_against(&tree, CP341, std::iter::empty());
        assert!(found.len() == 1 && found[0].what.contains("--bless"), "{found:?}");
    }
}
