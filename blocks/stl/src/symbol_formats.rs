//! The rows of the four forms of symbol tables. Never fails: a line that is not a row is reported and left out.

use crate::diagnostic::Sink;
use crate::messages;
use crate::token::Span;

/// A row as written.
#[derive(Debug, PartialEq)]
pub(crate) struct Row {
    pub(crate) name: String,
    pub(crate) address: String,
    /// Empty where the form has none.
    pub(crate) ty: String,
    pub(crate) comment: String,
    /// Its place in the text.
    pub(crate) span: Span,
}

/// The lines of a text that say something, with their places. A carriage return ends a line too: SEQ files have it
/// alone.
fn lines<'t>(text: &'t str, sink: &mut Sink) -> Vec<(Span, &'t str)> {
    let mut start = 0usize;
    let mut out = Vec::new();
    for line in text.split(['\n', '\r']) {
        sink.steps += 1;
        let span = Span { start: start as u32, end: (start + line.len()) as u32 };
        start += line.len() + 1;
        // 1Ah is the end of a text file of old.
        if !line.trim_matches(|c: char| c.is_whitespace() || c == '\u{1a}').is_empty() {
            out.push((span, line));
        }
    }
    out
}

fn wrong(span: Span, message: &str, sink: &mut Sink) {
    sink.report(0, span, &messages::TABLE_ROW, message);
}

/// `"name","M 1.0","BOOL","comment"`. Quotes within a field are doubled.
pub(crate) fn sdf(text: &str, sink: &mut Sink) -> Vec<Row> {
    let mut rows = Vec::new();
    for (span, line) in lines(text, sink) {
        match quoted(line).or_else(|| loosely_quoted(line)) {
            Some(fields) if fields.len() >= 3 => {
                // TIA Portal's tables have more columns, in some versions the path after the name.
                let is_address = |at: usize| fields.get(at).is_some_and(|f| f.starts_with('%'));
                let (address, ty) = match (1..4).find(|at| is_address(*at)) {
                    Some(2) => (2, 1),
                    Some(3) => (3, 2),
                    _ => (1, 2),
                };
                // The tables of STEP 7 V5 have four columns, the last one the comment.
                let comment = if fields.len() == 4 && address == 1 { 3 } else { usize::MAX };
                let field = |at: usize| fields.get(at).map_or("", |f| f.trim_start_matches('%')).to_owned();
                rows.push(Row {
                    name: field(0),
                    address: field(address),
                    ty: field(ty),
                    comment: field(comment),
                    span,
                });
            }
            _ => wrong(span, "a row of an SDF file is written \"name\",\"M 1.0\",\"BOOL\",\"comment\"", sink),
        }
    }
    rows
}

/// The texts in quotes of a line, separated by commas. `None` when they are not well formed.
fn quoted(line: &str) -> Option<Vec<String>> {
    let mut fields = Vec::new();
    let mut rest = line.trim();
    loop {
        rest = rest.strip_prefix('"')?;
        let mut field = String::new();
        loop {
            let (head, tail) = rest.split_once('"')?;
            field.push_str(head);
            match tail.strip_prefix('"') {
                Some(more) => {
                    field.push('"');
                    rest = more;
                }
                None => {
                    rest = tail.trim_start();
                    break;
                }
            }
        }
        fields.push(field);
        if rest.is_empty() {
            return Some(fields);
        }
        rest = rest.strip_prefix(',')?.trim_start();
    }
}

/// The same where quotes within a field stand as they are: a field ends where quote, comma, quote stand together.
fn loosely_quoted(line: &str) -> Option<Vec<String>> {
    let inner = line.trim().strip_prefix('"')?.strip_suffix('"')?;
    let fields: Vec<String> = inner.split("\",\"").map(|f| f.replace("\"\"", "\"")).collect();
    (fields.len() >= 3).then_some(fields)
}

/// Characters of name, address and type in a record of an ASC file; with the 80 of the comment they are the 126 each
/// record begins with.
const COLUMNS: [usize; 3] = [24, 12, 10];

/// `126,` and the columns.
pub(crate) fn asc(text: &str, sink: &mut Sink) -> Vec<Row> {
    let mut rows = Vec::new();
    for (span, line) in lines(text, sink) {
        let record = line.strip_prefix("126,");
        let columns = record.and_then(|record| {
            let (name, rest) = cut(record, COLUMNS[0])?;
            let (address, rest) = cut(rest, COLUMNS[1]).unwrap_or((rest, ""));
            let (ty, comment) = cut(rest, COLUMNS[2]).unwrap_or((rest, ""));
            Some((name, address, ty, comment))
        });
        match columns {
            Some((name, address, ty, comment)) => {
                let [name, address, ty, comment] = [name, address, ty, comment].map(str::to_owned);
                rows.push(Row { name, address, ty, comment, span });
            }
            None => {
                let message =
                    "a record of an ASC file begins with 126, and has columns of 24, 12, 10 and 80 characters";
                wrong(span, message, sink);
            }
        }
    }
    rows
}

/// The first `count` characters and what follows; `None` when there are fewer.
fn cut(text: &str, count: usize) -> Option<(&str, &str)> {
    if text.chars().count() == count {
        return Some((text, ""));
    }
    text.char_indices().nth(count).map(|(at, _)| text.split_at(at))
}

/// Tab, address, tab, name, tab, comment.
pub(crate) fn seq(text: &str, sink: &mut Sink) -> Vec<Row> {
    let mut rows = Vec::new();
    for (span, line) in lines(text, sink) {
        let mut fields = line.split('\t');
        let first = fields.next().unwrap_or("");
        // The leading tab is sometimes lost in editors.
        let address = if first.trim().is_empty() { fields.next() } else { Some(first) };
        match (address, fields.next()) {
            (Some(address), Some(name)) => {
                let comment = fields.next().unwrap_or_default().to_owned();
                rows.push(Row { name: name.into(), address: address.into(), ty: String::new(), comment, span });
            }
            _ if line.trim_start().starts_with(';') => {}
            _ => wrong(span, "a row of a SEQ file is tab, address, tab, name, tab, comment", sink),
        }
    }
    rows
}

/// The header, then tuples: `-1,0` and `BOT` begin one, `1,0` and a text in quotes are a cell, `-1,0` and `EOD` end
/// all.
pub(crate) fn dif(text: &str, sink: &mut Sink) -> Vec<Row> {
    let lines = lines(text, sink);
    let mut rows = Vec::new();
    let data = lines.iter().position(|(_, l)| l.trim() == "DATA").unwrap_or(lines.len());
    let begin = lines.iter().skip(data).position(|(_, l)| l.trim().starts_with("-1"));
    let Some(mut at) = begin.map(|begin| data + begin) else {
        let span = lines.first().map_or(Span::default(), |(span, _)| *span);
        wrong(span, "the header of the DIF file is not followed by DATA and a first tuple", sink);
        return rows;
    };
    let mut tuple: Option<(Span, Vec<String>)> = None;
    let mut ended = false;
    while let (Some((span, head)), Some((_, value))) = (lines.get(at), lines.get(at + 1)) {
        at += 2;
        let kind = head.split_once(',').map(|(kind, _)| kind.trim());
        match (kind, value.trim()) {
            (Some("-1"), "BOT") => finish(tuple.replace((*span, Vec::new())), &mut rows, sink),
            (Some("-1"), "EOD") => {
                ended = true;
                break;
            }
            (Some("1"), text) => {
                if let Some((place, cells)) = &mut tuple
                    && cells.len() < 4
                {
                    place.end = lines.get(at - 1).map_or(place.end, |(s, _)| s.end);
                    let inner = text.strip_prefix('"').and_then(|t| t.strip_suffix('"')).unwrap_or(text);
                    cells.push(inner.replace("\"\"", "\""));
                }
            }
            // A number as cell is not a field of a symbol table; it keeps its column.
            (Some("0"), _) => {
                if let Some((_, cells)) = tuple.as_mut().filter(|(_, cells)| cells.len() < 4) {
                    cells.push(head.split_once(',').map_or("", |(_, number)| number.trim()).to_owned());
                }
            }
            _ => {
                wrong(*span, "the DIF file continues with neither a cell (1,0) nor a tuple (-1,0)", sink);
                return rows;
            }
        }
    }
    finish(tuple, &mut rows, sink);
    if !ended {
        let span = lines.last().map_or(Span::default(), |(span, _)| *span);
        wrong(span, "the DIF file ends without EOD", sink);
    }
    rows
}

fn finish(tuple: Option<(Span, Vec<String>)>, rows: &mut Vec<Row>, sink: &mut Sink) {
    let Some((span, cells)) = tuple else { return };
    let mut cells = cells.into_iter();
    match (cells.next(), cells.next()) {
        (Some(name), Some(address)) => {
            let (ty, comment) = (cells.next().unwrap_or_default(), cells.next().unwrap_or_default());
            rows.push(Row { name, address, ty, comment, span });
        }
        _ => wrong(span, "a tuple of a symbol table has four cells: name, address, type, comment", sink),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(rows: Vec<Row>) -> Vec<String> {
        rows.into_iter().map(|r| format!("{}|{}|{}", r.name.trim(), r.address.trim(), r.ty.trim())).collect()
    }

    #[test]
    fn the_manual_s_examples() {
        let mut sink = Sink::new();
        let sdf_text = "\"green_phase_ped.\",\"T 2\",\"TIMER\",\"Duration, \"\"green\"\"\"\r\n\"red_ped.\",\"Q 0.0\",\"BOOL\",\"\"\r\n";
        assert_eq!(flat(sdf(sdf_text, &mut sink)), ["green_phase_ped.|T 2|TIMER", "red_ped.|Q 0.0|BOOL"]);
        let seq_text = "\tT 2\tgreen_phase_ped.\tDuration\r\tQ 0.0\tred\r\n";
        assert_eq!(flat(seq(seq_text, &mut sink)), ["green_phase_ped.|T 2|", "red|Q 0.0|"]);
        let asc_text = format!("126,{:<24}{:<12}{:<10}{:<80}", "grün_1", "T       2", "TIMER", "Dauer");
        assert_eq!(flat(asc(&asc_text, &mut sink)), ["grün_1|T       2|TIMER"]);
        let dif_text = "TABLE\n0,1\n\"x\"\nVECTORS\n0,1\n\"\"\nTUPLES\n0,4\n\"\"\nDATA\n0,0\n\"\"\n-1,0\nBOT\n1,0\n\"a\"\n1,0\n\
                        \"Q 0.0\"\n1,0\n\"BOOL\"\n1,0\n\"\"\n-1,0\nEOD\n";
        assert_eq!(flat(dif(dif_text, &mut sink)), ["a|Q 0.0|BOOL"]);
        assert!(!sink.has_errors());
    }
}
