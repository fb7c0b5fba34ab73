//! The table of alarm texts, `[program] alarms`: what each message number means. (docs/alarm-texts.md)

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::ops::Range;
use std::path::Path;

use ob1_access::alarm_text::Template;
use ob1_access::alarms::{AlarmText, AlarmTexts};
use ob1_stl::Source;

use crate::finding::{Finding, Level, Spot, Text, nearest};
use crate::findings::{ALARM_TEXTS, unreadable};

/// Signals of an alarm, at most: ALARM_8.
const SIGNALS: u8 = 8;
/// The highest priority. [as SEVERITY of SFB 31, 33 to 36]
const PRIORITY: u8 = 127;
/// What separates columns; which one it is, the first line tells.
const SEPARATORS: [char; 3] = [';', ',', '\t'];
/// The columns, with what stands in them.
const COLUMNS: [&str; 6] = ["number", "signal", "text", "info", "class", "priority"];
/// A line whose fields cannot be told apart.
const NOT_CLOSED: (&str, &str) = ("a quote is not closed, or something stands behind it", "two quotes mean one");
/// The largest table that is read, in bytes.
const LONGEST: u64 = 16 << 20;

/// Reads a table that a station file names at `place`.
///
/// # Errors
/// All findings: an unreadable file, or every mistake in it.
pub fn load(path: &Path, place: &Spot) -> Result<AlarmTexts, Vec<Finding>> {
    let name = path.display().to_string();
    match ob1_process::files::read(path, LONGEST) {
        Ok(bytes) => parse(&Source::new(name.as_str(), bytes).text(), &name),
        Err(error) => Err(vec![unreadable(place, path, &error)]),
    }
}

/// Reads the text of a table.
///
/// # Errors
/// All findings: every mistake in the text.
pub fn parse(text: &str, name: &str) -> Result<AlarmTexts, Vec<Finding>> {
    let mut table = Table { source: Text { file: name, text }, found: Vec::new(), first: BTreeMap::new() };
    let mut rows = BTreeMap::new();
    let mut lines = lines(text);
    let Some(first) = lines.next() else {
        let remedy = format!("the first line names the columns: {}", COLUMNS.join(", "));
        return Err(vec![Finding::whole(Level::Error, ALARM_TEXTS, name, "the table is empty", remedy)]);
    };
    let Some((separator, columns)) = table.columns(&first) else { return Err(table.found) };
    for line in lines {
        table.row(&line, separator, &columns, &mut rows);
    }
    if table.found.is_empty() { Ok(AlarmTexts::new(rows)) } else { Err(table.found) }
}

/// The lines that say something, with their places in bytes.
fn lines(text: &str) -> impl Iterator<Item = Range<usize>> {
    let mut at = 0;
    let all = text.split_inclusive('\n').map(move |line| {
        let from = at;
        at += line.len();
        (from, line)
    });
    let said = all.filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    said.map(|(from, line)| from..from + line.trim_end_matches(['\n', '\r']).len())
}

/// A field: its text, and where it stands.
struct Field {
    text: String,
    at: Range<usize>,
}

/// The fields of a line. In quotes a separator means itself, and two quotes mean one.
fn fields(text: &str, line: &Range<usize>, separator: char) -> Option<Vec<Field>> {
    let content = text.get(line.clone())?;
    let mut fields = Vec::new();
    let mut rest = content;
    loop {
        let from = line.start + content.len() - rest.len();
        let mut field = String::new();
        let quoted = rest.strip_prefix('"');
        let behind = match quoted {
            None => {
                let end = rest.find(separator).unwrap_or(rest.len());
                field.push_str(rest[..end].trim());
                &rest[end..]
            }
            Some(mut inside) => loop {
                let end = inside.find('"')?;
                field.push_str(&inside[..end]);
                inside = &inside[end + 1..];
                match inside.strip_prefix('"') {
                    Some(more) => {
                        field.push('"');
                        inside = more;
                    }
                    None => break inside,
                }
            },
        };
        let at = from..line.start + content.len() - behind.len();
        fields.push(Field { text: field, at });
        match behind.strip_prefix(separator) {
            Some(next) => rest = next,
            None if behind.trim().is_empty() => return Some(fields),
            None => return None,
        }
    }
}

/// A message number as it is written: decimal, or `16#...` with or without the type.
#[must_use]
pub fn number_of(text: &str) -> Option<u32> {
    let text = text.to_ascii_uppercase();
    let hexadecimal = text.strip_prefix("DW#").unwrap_or(&text).strip_prefix("16#");
    let number = match hexadecimal {
        Some(digits) => u32::from_str_radix(&digits.replace('_', ""), 16),
        None => text.parse(),
    };
    number.ok().filter(|number| *number > 0)
}

/// A table that is read.
struct Table<'t> {
    source: Text<'t>,
    found: Vec<Finding>,
    /// In which line each number and signal stands.
    first: BTreeMap<(u32, u8), u32>,
}

impl Table<'_> {
    fn error(&mut self, at: Range<usize>, message: impl Into<String>, remedy: impl Into<String>) {
        self.found.push(self.source.finding(Level::Error, ALARM_TEXTS, at, message.into(), remedy.into()));
    }

    /// The separator, and for each column of the file which one it is.
    fn columns(&mut self, line: &Range<usize>) -> Option<(char, Vec<usize>)> {
        let content = self.source.text.get(line.clone()).unwrap_or_default();
        let separator = SEPARATORS.into_iter().max_by_key(|one| content.matches(*one).count())?;
        let mut columns = Vec::new();
        let Some(names) = fields(self.source.text, line, separator) else {
            self.error(line.clone(), NOT_CLOSED.0, NOT_CLOSED.1);
            return None;
        };
        for field in names {
            let name = field.text.to_ascii_lowercase();
            match COLUMNS.iter().position(|column| *column == name) {
                Some(column) if columns.contains(&column) => {
                    self.error(field.at, format!("column \"{name}\" is there twice"), "remove one of them");
                }
                Some(column) => columns.push(column),
                None => {
                    let remedy = match nearest(&name, COLUMNS) {
                        Some(near) => format!("did you mean \"{near}\"?"),
                        None => format!("the first line names the columns: {}", COLUMNS.join(", ")),
                    };
                    self.error(field.at, format!("there is no column \"{}\"", field.text), remedy);
                }
            }
        }
        for (column, name) in [(0, "number"), (2, "text")] {
            if self.found.is_empty() && !columns.contains(&column) {
                let message = format!("the column \"{name}\" is missing");
                self.error(line.clone(), message, "the first line names the columns: number;text, and others");
            }
        }
        self.found.is_empty().then_some((separator, columns))
    }

    fn row(
        &mut self,
        line: &Range<usize>,
        separator: char,
        columns: &[usize],
        rows: &mut BTreeMap<(u32, u8), AlarmText>,
    ) {
        let Some(fields) = fields(self.source.text, line, separator) else {
            self.error(line.clone(), NOT_CLOSED.0, NOT_CLOSED.1);
            return;
        };
        if let Some(extra) = fields.get(columns.len()) {
            let remedy = format!("put a text with \"{separator}\" in quotes");
            self.error(extra.at.clone(), "there are more fields than columns", remedy);
            return;
        }
        let (mut key, mut row) = ((0, 0), AlarmText::default());
        let mut good = true;
        for (column, field) in columns.iter().zip(&fields) {
            let text = field.text.as_str();
            let problem = match *column {
                0 => match number_of(text) {
                    Some(number) => {
                        key.0 = number;
                        None
                    }
                    None => Some(("this is no message number".to_owned(), "1 to 4294967295, or DW#16#...".to_owned())),
                },
                1 if text.is_empty() => None,
                1 => match text.parse() {
                    Ok(signal @ 1..=SIGNALS) => {
                        key.1 = signal;
                        None
                    }
                    _ => Some((format!("there is no signal {text}"), "1 to 8; leave it empty for all".to_owned())),
                },
                2 | 3 => match Template::parse(text) {
                    Ok(template) if *column == 2 => {
                        row.text = template;
                        None
                    }
                    Ok(template) => {
                        row.info = template;
                        None
                    }
                    Err(bad) => {
                        let place = text.get(bad.at..).unwrap_or_default();
                        let remedy = "a place for a value is such as @1W%d@ (docs/alarm-texts.md)".to_owned();
                        Some((format!("\"{place}\": {}", bad.why), remedy))
                    }
                },
                4 => {
                    text.clone_into(&mut row.class);
                    None
                }
                _ if text.is_empty() => None,
                _ => match text.parse() {
                    Ok(priority @ 0..=PRIORITY) => {
                        row.priority = priority;
                        None
                    }
                    _ => Some((format!("there is no priority {text}"), format!("0 to {PRIORITY}"))),
                },
            };
            if let Some((message, remedy)) = problem {
                good = false;
                self.error(field.at.clone(), message, remedy);
            }
        }
        if !good {
            return;
        }
        if key.0 == 0 {
            self.error(line.clone(), "the line has no message number", "write it, or begin the line with #");
            return;
        }
        let number = self.source.spot(line.clone()).line();
        match self.first.entry(key) {
            Entry::Occupied(first) => {
                let message = format!("message number {} is in line {}, too", key.0, first.get());
                self.error(line.clone(), message, "remove one of them, or name different signals");
            }
            Entry::Vacant(place) => {
                place.insert(number);
                rows.insert(key, row);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(texts: &AlarmTexts, number: u32, signal: u8, value: &[u8]) -> Option<String> {
        texts.of(number, signal).map(|row| row.text.with(&[value]))
    }

    #[test]
    fn a_table_says_what_each_number_means() {
        let table = "number;signal;text;info;class;priority\n\
                     # pumps\n\
                     1;;Pump 1: @1I%d@ bar;call the fitter;fault;16\r\n\
                     \n\
                     DW#16#6000_0002;1;\"Level; \"\"low\"\"\";;warning;\n\
                     16#60000002;;level\n";
        let texts = parse(table, "alarms.csv").expect("no mistakes");
        assert_eq!(texts.len(), 3);
        assert_eq!(text(&texts, 1, 1, &[0, 7]), Some("Pump 1: 7 bar".into()));
        let first = texts.of(1, 5).expect("for all signals");
        assert_eq!((first.class.as_str(), first.priority), ("fault", 16));
        assert_eq!(first.info.with(&[]), "call the fitter");
        assert_eq!(text(&texts, 0x6000_0002, 1, &[]), Some("Level; \"low\"".into()));
        assert_eq!(text(&texts, 0x6000_0002, 2, &[]), Some("level".into()));
        assert_eq!(text(&texts, 3, 1, &[]), None);
        // Other separators, columns in another order.
        for table in ["text,number\nPump,1\n", "Text\tNumber\nPump\t1"] {
            assert_eq!(text(&parse(table, "a").expect("no mistakes"), 1, 1, &[]), Some("Pump".into()));
        }
    }

    #[test]
    fn every_mistake_has_its_place() {
        for (table, line, column, message) in [
            ("# nothing\n\n", 0, 0, "the table is empty"),
            ("number;\"text\n1;a\n", 1, 1, "not closed"),
            ("number;txt\n1;a\n", 1, 8, "no column \"txt\""),
            ("number;number;text\n", 1, 8, "twice"),
            ("number;info\n1;a\n", 1, 1, "\"text\" is missing"),
            ("text;info\n1;a\n", 1, 1, "\"number\" is missing"),
            ("number;text\n0;a\n", 2, 1, "no message number"),
            ("number;text\nx;a\n", 2, 1, "no message number"),
            ("number;text\n1;a;b\n", 2, 5, "more fields"),
            ("number;text\n1;\"a\n", 2, 1, "not closed"),
            ("number;text\n1;\"a\"b\n", 2, 1, "not closed"),
            ("number;text\n1;ä @1Q%d@\n", 2, 3, "\"@1Q%d@\": the type is one of"),
            ("number;signal;text\n1;9;a\n", 2, 3, "no signal 9"),
            ("number;text;priority\n1;a;128\n", 2, 5, "no priority 128"),
            ("number;text\n1;a\n\n1;b\n", 4, 1, "is in line 2, too"),
            ("text;number\nonly\n", 2, 1, "has no message number"),
        ] {
            let found = parse(table, "alarms.csv").expect_err(table);
            let told: Vec<_> = found.iter().map(|one| (one.line, one.column, one.message.as_str())).collect();
            assert!(told.len() == 1 && (told[0].0, told[0].1) == (line, column), "{table:?}: {told:?}");
            assert!(told[0].2.contains(message) && !found[0].remedy.is_empty(), "{table:?}: {told:?}");
            assert_eq!(found[0].code, ALARM_TEXTS);
        }
        let two = parse("number;text\n0;a\n1;@1@\n", "alarms.csv").expect_err("two mistakes");
        assert_eq!(two.iter().map(|one| one.line).collect::<Vec<u32>>(), [2, 3]);
    }
}
