//! Diagnostics: what is wrong, where, under which number, and what to do about it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use crate::messages::{self, Code, Severity};
use crate::source::Source;
use crate::token::Span;

/// One finding about a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// The number, `S0123`; its page is in `docs/stl-errors.md`.
    pub code: &'static str,
    /// Error, warning or lint.
    pub severity: Severity,
    /// Index of the source in the order given to [`compile`](crate::compile).
    pub source: usize,
    /// Line in the source, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
    /// Characters concerned, at least 1.
    pub length: u32,
    /// What is wrong, in one sentence.
    pub message: String,
    /// What to do about it.
    pub remedy: String,
    /// The other sources it is about: all uses of something that does not exist are one finding.
    pub others: Vec<usize>,
}

impl Diagnostic {
    /// The sources it is about, by their index; that of its line comes first.
    pub fn sources(&self) -> impl Iterator<Item = usize> + '_ {
        std::iter::once(self.source).chain(self.others.iter().copied())
    }
}

/// Characters of a source line shown at most, so that one endless line does not flood the terminal.
const SHOWN: usize = 160;

/// The finding as text: `file:line:column`, number and message, the source line with a caret, the remedy.
pub fn render(diagnostic: &Diagnostic, source: &Source) -> String {
    let text = source.text();
    let shown = text.lines().nth(diagnostic.line.saturating_sub(1) as usize).unwrap_or("");
    render_line(diagnostic, &source.name, shown)
}

/// All findings as text, in order, an empty line between them. Each source is decoded once, so this is the way to print
/// many.
pub fn render_all(diagnostics: &[Diagnostic], sources: &[Source]) -> String {
    let texts: Vec<_> = sources.iter().map(Source::text).collect();
    let lines: Vec<Vec<&str>> = texts.iter().map(|t| t.lines().collect()).collect();
    let mut out = Vec::with_capacity(diagnostics.len());
    for diagnostic in diagnostics {
        let line = diagnostic.line.saturating_sub(1) as usize;
        let shown = lines.get(diagnostic.source).and_then(|l| l.get(line)).copied().unwrap_or("");
        let name = sources.get(diagnostic.source).map_or("", |s| s.name.as_str());
        out.push(render_line(diagnostic, name, shown));
    }
    out.join("\n")
}

fn render_line(diagnostic: &Diagnostic, name: &str, shown: &str) -> String {
    let Diagnostic { code, severity, line, column, length, message, remedy, .. } = diagnostic;
    let (name, message, remedy) = (printable(name), printable(message), printable(remedy));
    let mut out = format!("{name}:{line}:{column}: {} {code}: {message}\n", severity.name());
    out += &excerpt(shown, *line, *column, *length);
    if !remedy.is_empty() {
        let _ = writeln!(out, "{} = {remedy}", " ".repeat(line.to_string().len()));
    }
    out
}

/// A line of a file as a reader sees it, with carets under the place meant: at most so much of it as a terminal shows,
/// and no control characters. `column` counts from 1.
pub fn excerpt(shown: &str, line: u32, column: u32, length: u32) -> String {
    let column = column.saturating_sub(1) as usize;
    // A line that fits is shown whole.
    let skip = if shown.chars().nth(SHOWN).is_none() { 0 } else { column.saturating_sub(SHOWN / 2) };
    let (lead, tail) =
        (if skip > 0 { "..." } else { "" }, if shown.chars().nth(skip + SHOWN).is_some() { "..." } else { "" });
    let window: String = shown.chars().skip(skip).take(SHOWN).map(shown_as).collect();
    // The caret line repeats the tabs of the source line, so that the caret is in its place however wide a tab is.
    let indent: String = window.chars().take(column - skip).map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
    let room = SHOWN.saturating_sub(column - skip).max(1);
    let carets = "^".repeat((length as usize).clamp(1, room));
    let number = line.to_string();
    let gutter = " ".repeat(number.len());
    let below = " ".repeat(lead.len());
    format!("{gutter} |\n{number} | {lead}{window}{tail}\n{gutter} | {below}{indent}{carets}\n")
}

/// A text of a file in a message: what would steer the reader's terminal becomes a replacement character.
pub fn printable(text: &str) -> String {
    text.chars().map(shown_as).collect()
}

fn shown_as(c: char) -> char {
    if c.is_control() && c != '\t' { '\u{fffd}' } else { c }
}

/// A finding before its line and column are known.
#[derive(Debug)]
struct Raw {
    file: usize,
    span: Span,
    code: &'static Code,
    message: String,
    remedy: String,
    /// It is about all uses of something, not about its line alone.
    whole: bool,
    /// The other files with such a use.
    others: Vec<usize>,
}

/// The placeholder in the message of a [`Missing`](crate::Missing) block for the number of its uses.
pub const USES: &str = "{uses}";

/// The uses of something that does not exist.
#[derive(Debug)]
struct Uses {
    first: Raw,
    count: usize,
    files: BTreeSet<usize>,
}

/// How many findings are given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limit {
    /// Findings of one source.
    pub file: usize,
    /// Findings of all sources.
    pub run: usize,
}

/// The findings beyond a [`Limit`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rest {
    /// How many of them are errors.
    pub errors: usize,
    /// How many of each number.
    pub by_code: BTreeMap<&'static str, usize>,
}

impl Rest {
    /// How many there are.
    pub fn count(&self) -> usize {
        self.by_code.values().sum()
    }
}

/// Collects findings of one run.
#[derive(Debug)]
pub struct Sink {
    raw: Vec<Raw>,
    /// What is used and not there, by kind and name.
    missing: BTreeMap<String, Uses>,
    /// Sources that are not STL: nothing else is reported about them.
    foreign: BTreeSet<usize>,
    /// Sources with a comment that is not closed.
    open_comments: BTreeSet<usize>,
    /// The names of the sources.
    names: Vec<String>,
    /// Nearest words are looked up for so many findings only: the search is long compared with everything else.
    suggestions_left: u32,
    /// Elementary steps of work so far, see [`Output::steps`](crate::Output::steps).
    pub steps: u64,
    said: u64,
}

impl Sink {
    pub(crate) fn new() -> Self {
        Self {
            raw: Vec::new(),
            missing: BTreeMap::new(),
            foreign: BTreeSet::new(),
            open_comments: BTreeSet::new(),
            names: Vec::new(),
            suggestions_left: 200,
            steps: 0,
            said: 0,
        }
    }

    /// The findings of a run over sources with these names.
    pub(crate) fn of(names: Vec<String>) -> Self {
        Self { names, ..Self::new() }
    }

    /// What a source is called.
    pub(crate) fn name(&self, file: usize) -> String {
        self.names.get(file).cloned().unwrap_or_else(|| format!("source {}", file + 1))
    }

    /// A comment reaches to the end of a source: that nothing behind it is there follows from it.
    pub(crate) fn open_comment(&mut self, file: usize, span: Span, close: &str) {
        self.open_comments.insert(file);
        self.report(file, span, &messages::NOT_CLOSED, format!("the comment is not closed with {close}"));
    }

    /// A finding with the remedy of its table row.
    pub fn report(&mut self, file: usize, span: Span, code: &'static Code, message: impl Into<String>) {
        self.report_with(file, span, code, message, code.remedy);
    }

    /// A finding with a remedy of its own.
    pub fn report_with(
        &mut self,
        file: usize,
        span: Span,
        code: &'static Code,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        let (message, remedy) = (message.into(), remedy.into());
        self.said += u64::from(code.severity == Severity::Error);
        self.raw.push(Raw { file, span, code, message, remedy, whole: false, others: Vec::new() });
    }

    /// A use of something that does not exist. All uses under one key are one finding, at the first of them; what it
    /// says is asked for once.
    pub fn missing(
        &mut self,
        key: &str,
        file: usize,
        span: Span,
        code: &'static Code,
        says: impl FnOnce(&mut Self) -> (String, String),
    ) {
        self.said += 1;
        if let Some(uses) = self.missing.get_mut(key) {
            uses.count += 1;
            uses.files.insert(file);
            return;
        }
        let (message, remedy) = says(self);
        let first = Raw { file, span, code, message, remedy, whole: true, others: Vec::new() };
        self.missing.insert(key.to_owned(), Uses { first, count: 1, files: BTreeSet::from([file]) });
    }

    /// Reports that a source is not STL, and nothing else about it.
    pub fn foreign(&mut self, file: usize, message: &str, remedy: &str) {
        self.foreign.insert(file);
        self.report_with(file, Span::default(), &messages::OTHER_LANGUAGE, message, remedy);
    }

    /// A finding about an unknown word: the remedy names the nearest known one.
    pub fn report_unknown<'w>(
        &mut self,
        file: usize,
        span: Span,
        code: &'static Code,
        message: impl Into<String>,
        word: &str,
        known: impl IntoIterator<Item = &'w str>,
    ) {
        let nearest = self.nearest(word, known);
        let remedy = nearest.map_or_else(|| code.remedy.to_owned(), |near| format!("Did you mean {near}?"));
        self.report_with(file, span, code, message, remedy);
    }

    /// The known word nearest to `word`, when one is near. Searches for a bounded number of words only.
    pub fn nearest<'w>(&mut self, word: &str, known: impl IntoIterator<Item = &'w str>) -> Option<&'w str> {
        /// Candidates compared with one word.
        const CANDIDATES: usize = 2_000;
        if self.suggestions_left == 0 {
            return None;
        }
        self.suggestions_left -= 1;
        crate::near::nearest(word, known.into_iter().take(CANDIDATES))
    }

    /// True when an error was found.
    pub fn has_errors(&self) -> bool {
        self.raw.iter().any(|r| r.code.severity == Severity::Error) || !self.missing.is_empty()
    }

    /// How many errors were found, uses of what is not there counted once.
    pub fn errors(&self) -> usize {
        self.raw.iter().filter(|r| r.code.severity == Severity::Error).count() + self.missing.len()
    }

    /// How often an error was reported, each use of what is not there counted: who compares it before and behind a
    /// piece of work knows whether that has an error.
    pub const fn said(&self) -> u64 {
        self.said
    }

    fn gather(&mut self) {
        for (_, Uses { mut first, count, files }) in std::mem::take(&mut self.missing) {
            let several = |n: usize, one: &str| if n == 1 { format!("1 {one}") } else { format!("{n} {one}s") };
            let uses = format!("{} in {}", several(count, "use"), several(files.len(), "file"));
            if first.message.contains(USES) {
                first.message = first.message.replace(USES, &uses);
            } else if count > 1 {
                first.message = format!("{}: {uses}", first.message);
            }
            first.others = files.into_iter().filter(|file| *file != first.file).collect();
            self.raw.push(first);
        }
        let foreign = std::mem::take(&mut self.foreign);
        let follows =
            |r: &Raw| std::ptr::eq(r.code, &raw const messages::MISSING_END) && self.open_comments.contains(&r.file);
        self.raw.retain(|r| !follows(r));
        self.raw.retain(|r| !foreign.contains(&r.file) || std::ptr::eq(r.code, &raw const messages::OTHER_LANGUAGE));
        self.raw.sort_by_key(|r| (r.file, r.span.start));
    }

    /// The findings up to the limit of each file and of all, the worst ones kept first; and those that are left out.
    fn within(all: Vec<Diagnostic>, limit: Limit) -> (Vec<Diagnostic>, Rest) {
        let mut order: Vec<usize> = (0..all.len()).collect();
        order.sort_by_key(|at| std::cmp::Reverse(all.get(*at).map(|d| d.severity)));
        let mut keep = vec![false; all.len()];
        let mut of_file: BTreeMap<usize, usize> = BTreeMap::new();
        let mut kept = 0;
        for at in order {
            let (Some(one), Some(keep)) = (all.get(at), keep.get_mut(at)) else { continue };
            let of_file = of_file.entry(one.source).or_default();
            if *of_file < limit.file && kept < limit.run {
                *keep = true;
                *of_file += 1;
                kept += 1;
            }
        }
        let mut rest = Rest::default();
        let mut shown = Vec::with_capacity(kept);
        for (one, keep) in all.into_iter().zip(keep) {
            if keep {
                shown.push(one);
            } else {
                rest.errors += usize::from(one.severity == Severity::Error);
                *rest.by_code.entry(one.code).or_default() += 1;
            }
        }
        (shown, rest)
    }

    /// As [`finish`](Self::finish), up to a limit.
    pub fn finish_within(self, texts: &[&str], limit: Option<Limit>) -> (Vec<Diagnostic>, Rest) {
        let all = self.finish(texts);
        match limit {
            Some(limit) => Self::within(all, limit),
            None => (all, Rest::default()),
        }
    }

    /// The findings in source order, with lines and columns. A line has one error at most, the first: the others follow
    /// from it. One pass over each text, whatever the number of findings.
    pub fn finish(mut self, texts: &[&str]) -> Vec<Diagnostic> {
        self.gather();
        let mut wrong_line = (usize::MAX, 0u32);
        let mut out = Vec::with_capacity(self.raw.len());
        let mut place = (usize::MAX, 0usize, 1u32, 1u32);
        for raw in self.raw {
            let text = texts.get(raw.file).copied().unwrap_or("");
            if place.0 != raw.file {
                place = (raw.file, 0, 1, 1);
            }
            let start = (raw.span.start as usize).min(text.len());
            for c in text.get(place.1..start).unwrap_or("").chars() {
                (place.2, place.3) = if c == '\n' { (place.2 + 1, 1) } else { (place.2, place.3 + 1) };
            }
            place.1 = start;
            if raw.code.severity == Severity::Error && !raw.whole {
                if wrong_line == (raw.file, place.2) {
                    continue;
                }
                wrong_line = (raw.file, place.2);
            }
            // At most the rest of the first line is marked, and not more than the renderer shows.
            let marked = text.get(start..raw.span.end as usize).unwrap_or("");
            let length = marked.chars().take(SHOWN).take_while(|c| !matches!(c, '\n' | '\r')).count().max(1) as u32;
            out.push(Diagnostic {
                code: raw.code.number,
                severity: raw.code.severity,
                source: raw.file,
                line: place.2,
                column: place.3,
                length,
                message: raw.message,
                remedy: raw.remedy,
                others: raw.others,
            });
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages;

    #[test]
    fn a_finding_is_shown_with_its_line_and_a_caret() {
        let source = Source::new("pump.awl", "L 1\r\n\tL MX 10\r\n");
        let mut sink = Sink::new();
        sink.report_with(
            0,
            Span { start: 8, end: 10 },
            &messages::UNKNOWN_OPERAND,
            "MX is not an operand",
            "Did you mean MW?",
        );
        let found = sink.finish(&[&source.text()]);
        assert_eq!(
            render(&found[0], &source),
            "pump.awl:2:4: error S0302: MX is not an operand\n  |\n2 | \tL MX 10\n  | \t  ^^\n  = Did you mean MW?\n"
        );
        assert_eq!(render_all(&found, std::slice::from_ref(&source)), render(&found[0], &source));
    }

    #[test]
    fn an_endless_line_is_clipped_around_the_finding() {
        let source = Source::new("a", "x".repeat(1000));
        let mut sink = Sink::new();
        sink.report(0, Span { start: 500, end: 900 }, &messages::UNKNOWN_MNEMONIC, "m");
        let found = sink.finish(&[&source.text()]);
        let text = render(&found[0], &source);
        assert!(text.lines().all(|l| l.len() < 200), "{text}");
        assert!(text.contains("...x") && text.contains("x..."), "{text}");
    }

    #[test]
    fn uses_of_what_is_not_there_are_one_finding_about_all_their_sources() {
        let mut sink = Sink::new();
        for file in [2, 0, 2, 1] {
            let says = |_: &mut Sink| ("UDT 9".to_owned(), String::new());
            sink.missing("UDT 9", file, Span::default(), &messages::UNUSABLE_TYPE, says);
        }
        let found = sink.finish(&["", "", ""]);
        assert_eq!((found.len(), found[0].message.as_str()), (1, "UDT 9: 4 uses in 3 files"));
        assert_eq!(found[0].sources().collect::<Vec<_>>(), [2, 0, 1]);
    }

    #[test]
    fn the_nearest_word_is_proposed_only_when_near() {
        let mut sink = Sink::new();
        assert_eq!(sink.nearest("SPBM", ["SPB", "SPBN", "AUF"]), Some("SPB"));
        assert_eq!(sink.nearest("QQQQ", ["SPB", "SPBN", "AUF"]), None);
    }
}
