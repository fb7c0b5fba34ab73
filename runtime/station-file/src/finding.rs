//! Findings about files: place, number, what is wrong and what to do; as text with a caret and as JSON.

use std::fmt::{self, Write as _};
use std::ops::Range;

use ob1_process::log::Severity;
use ob1_stl::{excerpt, printable};
use serde::Serialize;

pub use ob1_stl::nearest;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// It cannot be used as it is.
    Error,
    /// It can be used, but is probably not what was meant.
    Warning,
    /// A matter of style.
    Lint,
}

impl Level {
    /// The word in front of a message.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Level::Error => "error",
            Level::Warning => "warning",
            Level::Lint => "lint",
        }
    }

    /// The same in the words of the log.
    #[must_use]
    pub const fn severity(self) -> Severity {
        match self {
            Level::Error => Severity::Error,
            Level::Warning => Severity::Warning,
            Level::Lint => Severity::Info,
        }
    }
}

/// One thing to report about a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How bad it is.
    pub level: Level,
    /// Its number: `S...` STL, `C...` station file, `L...` loading, `P...` plugins. Stable.
    pub code: String,
    /// The file, as it was named.
    pub file: String,
    /// Line from 1; 0: the file as a whole.
    pub line: u32,
    /// Column from 1, in characters.
    pub column: u32,
    /// What is wrong, in one sentence.
    pub message: String,
    /// What to do about it; may be empty.
    pub remedy: String,
    /// How many findings it stands for: above 1 if they are only counted.
    #[serde(skip)]
    pub count: usize,
    /// Ready text with the source line and a caret.
    #[serde(skip)]
    pub text: String,
}

impl Finding {
    /// A finding about the file as a whole.
    #[must_use]
    pub fn whole(level: Level, code: &str, file: &str, message: impl Into<String>, remedy: impl Into<String>) -> Self {
        let (message, remedy) = (message.into(), remedy.into());
        let mut text = format!("{}: {} {code}: {}\n", printable(file), level.name(), printable(&message));
        if !remedy.is_empty() {
            let _ = writeln!(text, "  = {}", printable(&remedy));
        }
        Self { level, code: code.into(), file: file.into(), line: 0, column: 0, message, remedy, count: 1, text }
    }

    /// A finding about a line of a file that is not at hand.
    #[must_use]
    pub fn in_line(level: Level, code: &str, file: &str, line: u32, message: String, remedy: &str) -> Self {
        Self { line, file: file.into(), ..Self::whole(level, code, &format!("{file}:{line}"), message, remedy) }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// A text file with its name, to find lines and columns in.
#[derive(Clone, Copy, Debug)]
pub struct Text<'a> {
    /// As it was named.
    pub file: &'a str,
    /// Its whole content, for lines and columns.
    pub text: &'a str,
}

impl Text<'_> {
    /// A finding at a range of bytes of this file.
    #[must_use]
    pub fn finding(&self, level: Level, code: &str, at: Range<usize>, message: String, remedy: String) -> Finding {
        self.spot(at).finding(level, code, message, remedy)
    }

    /// A range of bytes of this file.
    #[must_use]
    pub fn spot(&self, at: Range<usize>) -> Spot {
        let start = floor(self.text, at.start);
        let end = floor(self.text, at.end.max(start));
        let before = self.text.get(..start).unwrap_or_default();
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let line = before.matches('\n').count() as u32 + 1;
        let lead = self.text.get(line_start..start).unwrap_or_default();
        let shown = self.text.get(line_start..).unwrap_or_default().lines().next().unwrap_or_default();
        let marked = self.text.get(start..end).unwrap_or_default().lines().next().unwrap_or_default();
        let column = lead.chars().count() as u32 + 1;
        let length = u32::try_from(marked.chars().count()).unwrap_or(u32::MAX);
        Spot { file: self.file.into(), line, column, excerpt: excerpt(shown, line, column, length) }
    }
}

/// A place in a file, with the line that it shows: for a finding that may come after the file has been read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Spot {
    file: String,
    line: u32,
    column: u32,
    /// The line with a caret.
    excerpt: String,
}

impl Spot {
    /// Its line, from 1.
    #[must_use]
    pub const fn line(&self) -> u32 {
        self.line
    }

    /// A finding at this place.
    #[must_use]
    pub fn finding(&self, level: Level, code: &str, message: String, remedy: String) -> Finding {
        let Self { file, line, column, excerpt } = self;
        let mut text = format!("{}:{line}:{column}: {} {code}: ", printable(file), level.name());
        let _ = write!(text, "{}\n{excerpt}", printable(&message));
        if !remedy.is_empty() {
            let _ = writeln!(text, "{} = {}", " ".repeat(line.to_string().len()), printable(&remedy));
        }
        let (file, line, column) = (file.clone(), *line, *column);
        Finding { level, code: code.into(), file, line, column, message, remedy, count: 1, text }
    }
}

fn floor(text: &str, mut at: usize) -> usize {
    at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_caret_stands_under_its_character() {
        let file = Text { file: "a.toml", text: "x = 1\n\tname = \"ü\" # ü\n" };
        let found = file.finding(Level::Error, "C001", 7..11, "no".into(), "yes".into());
        assert_eq!((found.line, found.column), (2, 2));
        assert_eq!(found.text, "a.toml:2:2: error C001: no\n  |\n2 | \tname = \"ü\" # ü\n  | \t^^^^\n  = yes\n");
    }

    /// What a file holds is never handed to the terminal as it is.
    #[test]
    fn a_long_line_is_cut_and_a_control_character_does_not_reach_the_terminal() {
        let long = format!("x = {}\x1b[2J", "[".repeat(100_000));
        let file = Text { file: "a\x1b.toml", text: &long };
        for at in [4, 60_000, long.len()] {
            let found = file.finding(Level::Error, "C002", at..long.len(), "no \x1b[2J".into(), "\x07".into());
            assert!(found.text.len() < 600 && !found.text.contains(['\x1b', '\x07']), "{:?}", found.text);
        }
        let whole = Finding::whole(Level::Error, "C001", "\x1b[2J", "\x1b", "\x1b");
        assert!(!whole.text.contains('\x1b'), "{:?}", whole.text);
    }

    #[test]
    fn a_range_outside_or_amid_a_character_is_clipped() {
        let file = Text { file: "a", text: "ü" };
        assert_eq!(file.finding(Level::Lint, "C001", 1..1, String::new(), String::new()).column, 1);
        assert_eq!(file.finding(Level::Lint, "C001", 90..99, String::new(), String::new()).column, 2);
    }
}
