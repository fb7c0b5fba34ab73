//! What can be wrong with a station file and the files beside it, by number, and the collector of findings.

use std::io;
use std::ops::Range;
use std::path::Path;

use crate::finding::{Finding, Level, Spot, Text, nearest};

/// The file cannot be read.
pub const UNREADABLE: &str = "C001";
/// It is no TOML, or a value has the wrong type.
pub const SYNTAX: &str = "C002";
/// A key that does not exist.
pub const UNKNOWN_KEY: &str = "C003";
/// A key that must be there is missing.
pub const MISSING: &str = "C004";
/// A value that its key cannot have.
pub const VALUE: &str = "C005";
/// A name that is there twice.
pub const TWICE: &str = "C006";
/// Two modules at one address, or a module outside the address space.
pub const ADDRESS: &str = "C007";
/// An impossible parameter of a CP.
pub const PARAMETER: &str = "C008";
/// A line that cannot be understood.
pub const LINE: &str = "C009";
/// Two keys that do not go together.
pub const CONTRADICTION: &str = "C010";
/// A stimulus file with a mistake.
pub const STIMULUS: &str = "C011";
/// A station file among sources, or with an option that is for sources.
pub const MISPLACED: &str = "C012";
/// A test calls a block in a way that is not possible.
pub const CALL: &str = "C013";
/// A real-time scan that would leave no time to others on its core.
pub const STARVES: &str = "C014";
/// The findings beyond the limit.
pub const REST: &str = "C015";
/// A block in machine code that cannot be used.
pub const MACHINE_CODE: &str = "C016";
/// A link that strangers could use.
pub const UNPROTECTED: &str = "C017";
/// The numbers of blocks that have a name only cannot be kept.
pub const NOT_KEPT: &str = "C018";
/// A file with nothing in it.
pub const EMPTY: &str = "C019";
/// A key that has no effect with this module.
pub const NO_EFFECT: &str = "C020";
/// A name that a command was given and the program does not have.
pub const UNKNOWN_NAME: &str = "C021";
/// A table of alarm texts with a mistake.
pub const ALARM_TEXTS: &str = "C022";
/// A trace with a signal or a trigger that does not exist.
pub const TRACE: &str = "C023";

/// The finding about a file that cannot be read, at the place that names it.
#[must_use]
pub fn unreadable(place: &Spot, path: &Path, error: &io::Error) -> Finding {
    let message = format!("the file {} cannot be read: {error}", path.display());
    let remedy = match error.kind() {
        io::ErrorKind::NotFound => "paths count from the file that names them",
        io::ErrorKind::PermissionDenied => "make it readable for this user",
        io::ErrorKind::IsADirectory => "name a file, not a folder",
        _ => "name another file",
    };
    place.finding(Level::Error, UNREADABLE, message, remedy.to_owned())
}

/// Collects findings of one file.
#[derive(Debug)]
pub struct Findings<'a> {
    source: Text<'a>,
    found: Vec<Finding>,
    /// How many were left out.
    more: usize,
}

/// Errors of one file that are told, at most: each is looked up in the file, and nobody reads more.
const MOST: usize = 200;

impl<'a> Findings<'a> {
    /// Nothing found yet in this file.
    pub fn new(source: Text<'a>) -> Self {
        Self { source, found: Vec::new(), more: 0 }
    }

    /// A place in the file, for an error that may come later.
    pub fn spot(&self, at: Range<usize>) -> Spot {
        self.source.spot(at)
    }

    /// Adds an error: its number, its place in the file, what is wrong and what helps.
    pub fn error(&mut self, code: &str, at: Range<usize>, message: impl Into<String>, remedy: impl Into<String>) {
        if self.found.len() >= MOST && self.has_error() {
            self.more += 1;
            return;
        }
        self.found.push(self.source.finding(Level::Error, code, at, message.into(), remedy.into()));
    }

    /// Adds what the TOML reader says of a value that has another type.
    pub(super) fn mistyped(&mut self, at: Range<usize>, message: &str) {
        let message = in_words(&message.replace('\n', ", "));
        self.error(SYNTAX, at, message, "docs/station-file.md lists every key with its type");
    }

    /// Adds a warning: the file can be used.
    pub fn warning(&mut self, code: &str, at: Range<usize>, message: impl Into<String>, remedy: impl Into<String>) {
        self.found.push(self.source.finding(Level::Warning, code, at, message.into(), remedy.into()));
    }

    /// Whether there is an error so far.
    fn has_error(&self) -> bool {
        self.found.iter().any(|finding| finding.level == Level::Error)
    }

    /// Takes the warnings out, if there is no error among them.
    pub fn take_warnings(&mut self) -> Vec<Finding> {
        if self.has_error() { Vec::new() } else { std::mem::take(&mut self.found) }
    }

    /// The station if nothing was found, else the findings in the order of the file.
    pub fn into_result<T>(mut self, value: T) -> Result<T, Vec<Finding>> {
        if self.found.is_empty() {
            return Ok(value);
        }
        self.found.sort_by_key(|f| (f.line, f.column));
        if self.more > 0 {
            let (file, message) = (self.source.file, format!("{} errors more", self.more));
            self.found.push(Finding::whole(Level::Error, VALUE, file, message, "correct the others first"));
        }
        Err(self.found)
    }
}

/// What the TOML reader says, as a finding. The remedy for an unknown key is the nearest known key, else what
/// `elsewhere` says of the key and of those known here. `document` explains the keys.
pub fn of_toml(
    source: Text<'_>,
    error: &toml::de::Error,
    document: &str,
    elsewhere: impl Fn(&str, &[&str]) -> Option<String>,
) -> Finding {
    let at = error.span().unwrap_or(0..0);
    let message = error.message();
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    match (message.split_whitespace().next(), quoted.as_slice()) {
        (Some("unknown"), [key, known @ ..]) if message.starts_with("unknown field") => {
            let remedy = unknown(key, known, elsewhere);
            source.finding(Level::Error, UNKNOWN_KEY, at, format!("unknown key `{key}`"), remedy)
        }
        (Some("missing"), [key]) => {
            let remedy = format!("add `{key}`; {document} says what it means");
            source.finding(Level::Error, MISSING, at.start..at.start, format!("the key `{key}` is missing"), remedy)
        }
        _ => {
            let remedy = brackets(source.text, &at, message)
                .unwrap_or_else(|| format!("{document} lists every key with its type"));
            source.finding(Level::Error, SYNTAX, at, in_words(&message.replace('\n', ", ")), remedy)
        }
    }
}

/// The remedy for an unknown key: the nearest of the `known` ones, else what `elsewhere` says of it.
pub(super) fn unknown(key: &str, known: &[&str], elsewhere: impl Fn(&str, &[&str]) -> Option<String>) -> String {
    let near = nearest(key, known.iter().copied()).map(|near| format!("did you mean `{near}`?"));
    near.or_else(|| elsewhere(key, known)).unwrap_or_else(|| format!("known here: {}", known.join(", ")))
}

/// What the TOML reader expects, in words of a station file instead of those of the reader.
fn in_words(message: &str) -> String {
    let Some((found, expected)) = message.rsplit_once(", expected ") else { return message.to_owned() };
    let expected = match expected {
        "a string" | "literal string" => "a text in quotes",
        "a sequence" => "a list in brackets",
        "i64" => "a whole number",
        "a boolean" => "true or false",
        "a map" => "keys in braces",
        table if table.starts_with("struct ") => "keys in braces",
        other => other,
    };
    format!("{found}, expected {expected}")
}

/// The remedy for a header with one pair of brackets instead of two, or with two instead of one.
fn brackets(text: &str, at: &Range<usize>, message: &str) -> Option<String> {
    let (before, header) = (text.get(..at.start)?, text.get(at.start..)?);
    let line = before.rfind('\n').map_or(before, |newline| &before[newline + 1..]);
    let name = header.trim_start_matches('[');
    let name = &name[..name.find(']')?];
    match (line, message) {
        ("", _) if header.starts_with("[[") && message.starts_with("invalid type: map") => {
            Some(format!("write [{name}]: there is one such table"))
        }
        ("", "invalid type: map, expected a sequence") if header.starts_with('[') => {
            Some(format!("write [[{name}]]: there may be several such tables"))
        }
        ("[", "duplicate key") => {
            Some(format!("write [[{name}]] if there may be several such tables, else make it one"))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_of_the_reader_are_told_in_those_of_the_file() {
        #[derive(Debug, serde::Deserialize)]
        struct File {
            #[serde(default, rename = "one")]
            _one: One,
            #[serde(default, rename = "list")]
            _list: Vec<One>,
        }
        #[derive(Debug, Default, serde::Deserialize)]
        struct One {
            #[serde(rename = "number")]
            _number: Option<i64>,
            #[serde(rename = "text")]
            _text: Option<String>,
            #[serde(rename = "switch")]
            _switch: Option<bool>,
            #[serde(rename = "words")]
            _words: Option<Vec<String>>,
        }
        for (text, says) in [
            ("[one]\nnumber = 1.5\n", "invalid type: floating point `1.5`, expected a whole number"),
            ("[one]\ntext = 10\n", "invalid type: integer `10`, expected a text in quotes"),
            ("[one]\nswitch = 1\n", "invalid type: integer `1`, expected true or false"),
            ("[one]\nwords = \"a\"\n", "invalid type: string \"a\", expected a list in brackets"),
            ("one = 5\n", "invalid type: integer `5`, expected keys in braces"),
            ("[list]\nnumber = 1\n", "= write [[list]]: there may be several such tables"),
            ("[[one]]\nnumber = 1\n", "= write [one]: there is one such table"),
            ("[list]\n[list]\n", "= write [[list]] if there may be several such tables, else make it one"),
        ] {
            let error = toml::from_str::<File>(text).expect_err(text);
            let finding = of_toml(Text { file: "x.toml", text }, &error, "the page", |_, _| None);
            assert!(finding.text.contains(says), "{text}: {}", finding.text);
        }
    }

    /// Where paths count from helps only if there is no such file.
    #[test]
    fn what_helps_with_a_file_that_cannot_be_read_fits_the_cause() {
        let place = Findings::new(Text { file: "a.toml", text: "sources = [\"b\"]\n" }).spot(11..14);
        for (kind, remedy) in [
            (io::ErrorKind::NotFound, "paths count from the file that names them"),
            (io::ErrorKind::PermissionDenied, "make it readable for this user"),
            (io::ErrorKind::IsADirectory, "name a file, not a folder"),
        ] {
            let found = unreadable(&place, Path::new("b"), &io::Error::new(kind, "why"));
            assert_eq!((found.message.as_str(), found.remedy.as_str()), ("the file b cannot be read: why", remedy));
            assert!(found.text.starts_with("a.toml:1:12: error C001: the file b cannot be read: why\n"), "{found}");
            assert!(found.text.ends_with(&format!("^^^\n  = {remedy}\n")), "{found}");
        }
    }
}
