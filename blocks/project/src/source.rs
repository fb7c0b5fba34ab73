//! STL source of a block: its heading, its declarations, and room for its statements.
//!
//! The declarations of a project are STL except for a few things: a function's value stands among the outputs, the text
//! of a data block lacks its last END_VAR, and texts are in the project's code page.

use std::fmt::Write as _;

use ob1_mc7::BlockHead;
use ob1_model::{BlockId, BlockKind, Section};

use crate::comments::Comments;
use crate::folder::{Block, Head, Language};
use crate::text::CodePage;

/// The declarations of a block, ready for a source.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Declarations {
    /// The type of a function's value.
    pub result: Option<String>,
    /// The sections, or the structure.
    pub text: String,
}

impl Declarations {
    /// From the text of a project. `is_function`: the value stands as first output.
    pub(crate) fn of_text(text: &str, is_function: bool, page: CodePage) -> Self {
        let mut text = escape(text.trim_matches(['\r', '\n', ' ', '\t', '\0']), page).replace("\r\n", "\n");
        let result = if is_function { cut_result(&mut text) } else { None };
        let (opened, closed) = count_sections(&text);
        for _ in closed..opened {
            text.push_str("\nEND_VAR");
        }
        if !text.is_empty() {
            text.push('\n');
        }
        Self { result, text }
    }
}

/// The name of [`Declarations::reserve`]'s variable.
const RESERVED: &str = "COMPILER_TEMP";

impl Declarations {
    /// Adds `bytes` of local data behind the declared ones, as a variable: those that a compiler has made itself.
    pub(crate) fn reserve(&mut self, bytes: u32) {
        let mut name = RESERVED.to_owned();
        while self.text.to_ascii_uppercase().contains(&name) {
            name.push('_');
        }
        let variable = format!("  {name} : ARRAY [1 .. {bytes}] OF BYTE ;\n");
        let temp = self.text.lines().position(|line| line.split_whitespace().next() == Some("VAR_TEMP"));
        let end = temp.and_then(|temp| {
            let is_end = |line: &str| line.split_whitespace().next().is_some_and(|word| word.starts_with("END_VAR"));
            self.text.lines().skip(temp).position(is_end).map(|end| temp + end)
        });
        match end {
            Some(end) => {
                let at = self.text.split_inclusive('\n').take(end).map(str::len).sum();
                self.text.insert_str(at, &variable);
            }
            None => {
                let _ = write!(self.text, "VAR_TEMP\n{variable}END_VAR\n");
            }
        }
    }
}

/// Texts in quotes: what is not ASCII becomes the byte the project means, `$C4`.
fn escape(text: &str, page: CodePage) -> String {
    let mut out = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        let (mut quoted, mut chars) = (false, line.chars().peekable());
        while let Some(c) = chars.next() {
            match c {
                '/' if !quoted && chars.peek() == Some(&'/') => {
                    out.push(c);
                    out.extend(chars.by_ref());
                }
                '$' if quoted => {
                    out.push(c);
                    out.extend(chars.next());
                }
                '\'' => {
                    quoted = !quoted;
                    out.push(c);
                }
                _ if quoted && !c.is_ascii() => {
                    let mut buffer = [0; 4];
                    for byte in page.bytes(c.encode_utf8(&mut buffer)) {
                        let _ = write!(out, "${byte:02X}");
                    }
                }
                _ => out.push(c),
            }
        }
    }
    out
}

/// Takes `RET_VAL : INT ;` out of the outputs and gives its type. An output section that is empty then goes too.
fn cut_result(text: &mut String) -> Option<String> {
    let outputs = text.find("VAR_OUTPUT")?;
    let body = outputs + "VAR_OUTPUT".len();
    let rest = text.get(body..)?;
    let name = body + rest.len() - rest.trim_start().len();
    let declaration = text.get(name..)?;
    let (head, tail) = declaration.split_once(':')?;
    if !head.trim().eq_ignore_ascii_case("RET_VAL") {
        return None;
    }
    let ty = tail.split(';').next()?.trim().to_owned();
    let end = name + declaration.find('\n').map_or(declaration.len(), |at| at + 1);
    let line = text.get(..name)?.rfind('\n').map_or(name, |at| at + 1);
    text.replace_range(line..end, "");
    let empty = text.get(body..).is_some_and(|rest| rest.trim_start().starts_with("END_VAR"));
    if empty {
        let end = text.get(body..)?.find("END_VAR")? + body + "END_VAR".len();
        text.replace_range(outputs..end, "");
    }
    Some(ty)
}

/// Sections opened and closed, by the first word of each line.
fn count_sections(text: &str) -> (usize, usize) {
    let words = || text.lines().filter_map(|line| line.split_whitespace().next());
    let opened = |w: &&str| Section::WORDS.iter().any(|(_, word)| word == w);
    (words().filter(opened).count(), words().filter(|w| *w == "END_VAR").count())
}

/// The source of a code block. `statements` are whole lines, networks included.
pub(crate) fn code_source(block: &Block, declarations: &Declarations, statements: &str) -> String {
    let (begin, end) = match block.id.kind {
        BlockKind::Ob => ("ORGANIZATION_BLOCK", "END_ORGANIZATION_BLOCK"),
        BlockKind::Fb | BlockKind::Sfb => ("FUNCTION_BLOCK", "END_FUNCTION_BLOCK"),
        _ => ("FUNCTION", "END_FUNCTION"),
    };
    let mut out = format!("{begin} {}", block.id);
    if block.id.kind == BlockKind::Fc {
        let _ = write!(out, " : {}", declarations.result.as_deref().unwrap_or("VOID"));
    }
    out.push('\n');
    heading(&mut out, &block.comments, &block.head);
    if !matches!(block.language, Language::Stl | Language::Db | Language::Other(_)) {
        let _ = writeln!(out, "// Made in {}.", block.language.name());
    }
    out.push_str(&declarations.text);
    let _ = writeln!(out, "BEGIN\n{statements}{end}");
    out
}

/// The source of a data block: its structure, the FB it is an instance of, or its UDT; then values.
pub(crate) fn data_source(block: &Block, shape: &str, values: &[(String, String)]) -> String {
    let mut out = format!("DATA_BLOCK {}\n", block.id);
    heading(&mut out, &block.comments, &block.head);
    if block.attribute & BlockHead::NON_RETAIN != 0 {
        out.push_str("NON_RETAIN\n");
    }
    let _ = writeln!(out, "{}\nBEGIN", shape.trim_end());
    for (path, value) in values {
        let _ = writeln!(out, "  {path} := {value};");
    }
    out.push_str("END_DATA_BLOCK\n");
    out
}

/// The source of a user-defined type.
pub(crate) fn udt_source(number: u16, head: &Head, declarations: &Declarations) -> String {
    let mut out = format!("TYPE UDT {number}\n");
    heading(&mut out, &Comments::default(), head);
    out.push_str(&declarations.text);
    out.push_str("END_TYPE\n");
    out
}

fn heading(out: &mut String, comments: &Comments, head: &Head) {
    let line = |text: &str| text.replace(['\r', '\n'], " ").trim().to_owned();
    if !comments.title.is_empty() {
        let _ = writeln!(out, "TITLE = {}", line(&comments.title));
    }
    comment_lines(out, &comments.comment);
    let words = [("AUTHOR", &head.author), ("FAMILY", &head.family), ("NAME", &head.name)];
    for (key, text) in words.into_iter().filter(|(_, text)| !text.trim().is_empty()) {
        let _ = writeln!(out, "{key} : '{}'", line(text).replace('\'', " "));
    }
    if head.version != 0 {
        let _ = writeln!(out, "VERSION : {}.{}", head.version >> 4, head.version & 15);
    }
}

/// A comment as lines of their own.
pub(crate) fn comment_lines(out: &mut String, comment: &str) {
    for line in comment.lines().map(|line| line.trim_end_matches('\r')) {
        let _ = writeln!(out, "//{line}");
    }
}

/// The name of a block's files: `FC_5`.
pub(crate) fn file_stem(id: BlockId) -> String {
    format!("{}_{}", id.kind.name(), id.number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_functions_value_leaves_its_outputs() {
        let text = "\r\nVAR_INPUT\r\n  A : INT ;\r\nEND_VAR\r\nVAR_OUTPUT\r\n  RET_VAL : INT ;\t//error\r\n  B : ANY ;\r\nEND_VAR\r\n\0";
        let declarations = Declarations::of_text(text, true, CodePage::default());
        assert_eq!(declarations.result.as_deref(), Some("INT"));
        assert_eq!(declarations.text, "VAR_INPUT\n  A : INT ;\nEND_VAR\nVAR_OUTPUT\n  B : ANY ;\nEND_VAR\n");
        let alone =
            Declarations::of_text("\r\nVAR_OUTPUT\r\n  RET_VAL : INT ;\r\nEND_VAR\r\n", true, CodePage::default());
        assert_eq!((alone.text.trim(), alone.result.as_deref()), ("", Some("INT")));
        let none = Declarations::of_text("VAR_OUTPUT\r\n X : INT ;\r\nEND_VAR", true, CodePage::default());
        assert_eq!((none.result, none.text.contains("X : INT")), (None, true));
    }

    #[test]
    fn texts_become_the_bytes_they_mean() {
        let page = CodePage::of_number(1251).expect("1251");
        let declarations = Declarations::of_text("VAR\n s : STRING := 'a$'Ж'; // Ж's\n", false, page);
        assert_eq!(declarations.text, "VAR\n s : STRING := 'a$'$C6'; // Ж's\nEND_VAR\n");
    }

    #[test]
    fn a_data_block_that_is_not_retentive_says_so() {
        let source = |attribute| {
            let block = Block { id: BlockId::new(BlockKind::Db, 3), attribute, ..Block::default() };
            data_source(&block, "FB 1", &[])
        };
        assert_eq!(source(0x21), "DATA_BLOCK DB 3\nVERSION : 1.0\nNON_RETAIN\nFB 1\nBEGIN\nEND_DATA_BLOCK\n");
        assert!(!source(0x05).contains("NON_RETAIN"));
    }
}
