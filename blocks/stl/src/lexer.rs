//! Text to tokens. Never fails: other text becomes a token of the kind `Bad`, with a diagnostic.

use crate::diagnostic::Sink;
use crate::messages;
use crate::parser::{HEADER_LINES, begins_block, ends_head, is_section};
use crate::token::{Kind, Span, Token};

/// Prefixes of constants, before a `#`.
#[rustfmt::skip]
const CONSTANT_PREFIXES: [&str; 28] = [
    "BOOL", "B", "BYTE", "CHAR", "W", "WORD", "DW", "DWORD",
    "SINT", "USINT", "INT", "UINT", "L", "DINT", "UDINT", "REAL", "C",
    "S5T", "S5TIME", "T", "TIME", "D", "DATE", "TOD", "TIME_OF_DAY", "DT", "DATE_AND_TIME", "DTL",
];

/// Splits `text`. Every token costs one step; every character is read a bounded number of times.
pub(crate) fn lex(file: usize, text: &str, sink: &mut Sink) -> Vec<Token> {
    lex_as(file, text, false, sink)
}

/// The same for SCL: comments lie in each other, there are more operators, and the name of a REGION is any text.
pub(crate) fn lex_scl(file: usize, text: &str, sink: &mut Sink) -> Vec<Token> {
    lex_as(file, text, true, sink)
}

fn lex_as(file: usize, text: &str, scl: bool, sink: &mut Sink) -> Vec<Token> {
    let mut lexer = Lexer {
        scl,
        lines_within: 0,
        in_head: false,
        stray_line: 0,
        file,
        text,
        at: 0,
        line: 1,
        tokens: Vec::with_capacity(text.len() / 4),
        sink,
    };
    lexer.run();
    lexer.tokens
}

/// The length of the list that begins here with its closing bracket. It may go over lines; within a text it neither
/// ends nor begins another.
fn closed_list(text: &str) -> Option<usize> {
    let mut quoted = false;
    for (at, byte) in text.bytes().enumerate().skip(1) {
        match byte {
            b'\'' => quoted = !quoted,
            b'\n' => quoted = false,
            b'}' if !quoted => return Some(at + 1),
            b'{' if !quoted => return None,
            _ => {}
        }
    }
    None
}

/// Constants of SCL with `-` and `:` within them.
const DATED: [&str; 7] = ["D", "DATE", "DT", "DATE_AND_TIME", "TOD", "TIME_OF_DAY", "DTL"];

/// The length of the comment that begins here, others within it included; `None`: it is not closed.
fn nested_comment(text: &str) -> Option<usize> {
    let bytes = text.as_bytes();
    let (mut at, mut open) = (0, 0u32);
    while let Some(pair) = bytes.get(at..at + 2) {
        match pair {
            b"(*" => open += 1,
            b"*)" => open = open.saturating_sub(1),
            _ => {
                at += 1;
                continue;
            }
        }
        at += 2;
        if open == 0 {
            return Some(at);
        }
    }
    None
}

struct Lexer<'a> {
    /// The text is SCL.
    scl: bool,
    /// Line ends within the token under way.
    lines_within: u32,
    /// Between a block's first word and its first section or statement, where a line like `AUTHOR : x` has any text.
    in_head: bool,
    /// The line of the last stray character: a broken line costs one message.
    stray_line: u32,
    file: usize,
    text: &'a str,
    at: usize,
    line: u32,
    tokens: Vec<Token>,
    sink: &'a mut Sink,
}

fn is_word_start(c: char) -> bool {
    c.is_alphabetic() || c == '_' || is_letter_elsewhere(c)
}

/// Signs of CP1252 that are letters in the code pages of other countries, whose sources are read as CP1252 too.
fn is_letter_elsewhere(c: char) -> bool {
    ('\u{A1}'..='\u{FF}').contains(&c)
}

fn is_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_' || !c.is_ascii() && (c.is_alphanumeric() || is_letter_elsewhere(c))
}

impl<'a> Lexer<'a> {
    fn rest(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or("")
    }

    fn peek(&self) -> Option<char> {
        match self.text.as_bytes().get(self.at) {
            Some(byte) if byte.is_ascii() => Some(char::from(*byte)),
            _ => self.rest().chars().next(),
        }
    }

    fn peek_second(&self) -> Option<char> {
        match self.text.as_bytes().get(self.at..self.at + 2) {
            Some([first, second]) if first.is_ascii() && second.is_ascii() => Some(char::from(*second)),
            _ => self.rest().chars().nth(1),
        }
    }

    fn bump(&mut self) {
        self.at += self.peek().map_or(0, char::len_utf8);
    }

    fn skip_while(&mut self, keep: impl Fn(char) -> bool) {
        let bytes = self.text.as_bytes();
        // Nearly every character is ASCII.
        while bytes.get(self.at).is_some_and(|b| b.is_ascii() && keep(char::from(*b))) {
            self.at += 1;
        }
        if bytes.get(self.at).is_some_and(|b| !b.is_ascii()) {
            let rest = self.rest();
            self.at += rest.find(|c| !keep(c)).unwrap_or(rest.len());
        }
    }

    /// To the end of the line.
    fn skip_line(&mut self) {
        let rest = self.text.as_bytes().get(self.at..).unwrap_or_default();
        self.at += rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
    }

    fn eat(&mut self, c: char) -> bool {
        let found = self.peek() == Some(c);
        if found {
            self.bump();
        }
        found
    }

    fn run(&mut self) {
        let mut spaced = true;
        while let Some(c) = self.peek() {
            self.sink.steps += 1;
            let start = self.at;
            if self.in_head
                && self.tokens.last().is_some_and(|t| t.kind == Kind::Colon)
                && let Some(length) = self.head_text()
            {
                self.at += length;
                self.push(Kind::Title, start, spaced);
            } else if c == '\n' {
                self.bump();
                self.push(Kind::Newline, start, spaced);
                self.line = self.line.saturating_add(1);
                spaced = true;
            } else if c.is_whitespace() {
                self.skip_while(|c| c.is_whitespace() && c != '\n');
                spaced = true;
            } else if c == '/' && self.peek_second() == Some('/') {
                self.skip_line();
                spaced = true;
            } else if c == '('
                && let Some(comment) = self.comment_form()
            {
                if self.comment(start, comment) {
                    self.push(Kind::Newline, self.at, true);
                }
                spaced = true;
            } else if c == '%' && self.peek_second().is_some_and(is_word_start) {
                // TIA Portal marks an address: %MW10 is MW 10.
                self.bump();
                spaced = true;
            } else {
                let kind = self.token(c);
                self.push(kind, start, spaced);
                spaced = false;
            }
        }
        self.push(Kind::Newline, self.at, spaced);
    }

    /// The comment that begins here with a bracket: `(* .. *)`, or `(/* .. */)`, TIA Portal's in several languages.
    fn comment_form(&self) -> Option<(&'static str, &'static str)> {
        [("(*", "*)"), ("(/*", "*/)")].into_iter().find(|(open, _)| self.rest().starts_with(open))
    }

    /// A comment over any number of lines; true when it ends a line.
    fn comment(&mut self, start: usize, (open, close): (&str, &str)) -> bool {
        let text = self.rest();
        let inner = text.get(open.len()..).unwrap_or("");
        let length = if self.scl && open == "(*" {
            nested_comment(text)
        } else {
            inner.find(close).map(|at| at + open.len() + close.len())
        };
        if length.is_none() {
            let span = Span { start: start as u32, end: (start + open.len()) as u32 };
            self.sink.open_comment(self.file, span, close);
        }
        let length = length.unwrap_or(text.len());
        let lines = text.get(..length).unwrap_or("").matches('\n').count() as u32;
        self.at += length;
        self.line = self.line.saturating_add(lines);
        self.sink.steps += u64::from(lines);
        lines > 0
    }

    fn push(&mut self, kind: Kind, start: usize, spaced: bool) {
        let span = Span { start: start as u32, end: self.at as u32 };
        self.tokens.push(Token { kind, span, line: self.line, spaced });
        self.line = self.line.saturating_add(std::mem::take(&mut self.lines_within));
    }

    fn token(&mut self, c: char) -> Kind {
        if is_word_start(c) {
            return self.word();
        }
        if c.is_ascii_digit() {
            return self.number();
        }
        match c {
            '"' => self.quoted('"', Kind::Symbol),
            '\'' => self.quoted('\'', Kind::Text),
            '#' => self.local(),
            '{' => self.attributes(),
            _ => self.punctuation(c),
        }
    }

    fn word(&mut self) -> Kind {
        let start = self.at;
        self.skip_while(is_word);
        let word = self.text.get(start..self.at).unwrap_or("");
        if self.starts_line() {
            self.first_word(word);
        }
        if self.in_head && (is_section(word) || ends_head(word)) {
            self.in_head = false;
        }
        if self.scl && self.starts_line() && ["REGION", "END_REGION"].iter().any(|w| w.eq_ignore_ascii_case(word)) {
            let end = self.at;
            self.skip_line();
            // A statement may follow the end of one on its line.
            let rest = self.text.get(end..self.at).unwrap_or("");
            if word.len() > 6 && rest.trim_start().starts_with(';') {
                self.at = end;
            }
            return Kind::Region;
        }
        if word.eq_ignore_ascii_case("TITLE") && self.title_follows() && self.title_may_stand() {
            self.skip_line();
            return Kind::Title;
        }
        if self.peek() != Some('#') {
            return Kind::Word;
        }
        if word.eq_ignore_ascii_case("P") {
            self.bump();
            return Kind::PointerSign;
        }
        // `L#name` is the mnemonic L and a local name, `L#5` a constant: constants continue with a digit or a sign.
        let second = self.peek_second();
        if second == Some('\'') && ["CHAR", "STRING"].iter().any(|ty| ty.eq_ignore_ascii_case(word)) {
            self.bump();
            return self.quoted('\'', Kind::Text);
        }
        let truth = word.eq_ignore_ascii_case("BOOL") && second.is_some_and(char::is_alphabetic);
        let goes_on = truth || second.is_some_and(|c| c.is_ascii_digit() || matches!(c, '-' | '+' | '('));
        if !goes_on || !CONSTANT_PREFIXES.iter().any(|p| p.eq_ignore_ascii_case(word)) {
            return Kind::Word;
        }
        self.bump();
        if matches!(self.peek(), Some('-' | '+')) {
            self.bump();
        }
        let dated = if self.scl {
            DATED.iter().any(|p| p.eq_ignore_ascii_case(word))
        } else {
            word.len() == 1 && word.eq_ignore_ascii_case("D") || word.len() > 1 && word.contains(['t', 'T'])
        };
        self.skip_while(|c| c.is_ascii_alphanumeric() || "_.#".contains(c) || dated && "-:".contains(c));
        if self.scl {
            self.give_back_range(start);
        }
        let exponent = word.eq_ignore_ascii_case("REAL") && matches!(self.peek(), Some('-' | '+'));
        if exponent && self.text.get(start..self.at).is_some_and(|t| t.ends_with(['e', 'E'])) {
            self.bump();
            self.skip_while(|c| c.is_ascii_digit());
        }
        Kind::Typed
    }

    /// `INT#1..5` is a range: the points belong to no constant, and a colon after one neither.
    fn give_back_range(&mut self, start: usize) {
        let constant = self.text.get(start..self.at).unwrap_or("");
        if let Some(points) = constant.find("..") {
            self.at = start + points;
        }
        while self.text.get(start..self.at).is_some_and(|t| t.ends_with([':', '.'])) {
            self.at -= 1;
        }
    }

    /// What the first word of a line tells about its place in a block: it may begin one.
    fn first_word(&mut self, word: &str) {
        // Nearly every line begins with a mnemonic: those are distinguished by their first letter.
        let may_begin = word.len() >= 4
            && matches!(word.as_bytes().first(), Some(b'O' | b'F' | b'D' | b'T' | b'o' | b'f' | b'd' | b't'));
        if may_begin && begins_block(word) && !self.goes_on_as_name() {
            self.in_head = true;
        }
    }

    /// True behind the name of a component or parameter: `Type : INT;`, `Type.x := 5;`.
    fn goes_on_as_name(&self) -> bool {
        self.rest().trim_start_matches([' ', '\t']).starts_with([':', ',', '{', '.', '['])
    }

    fn starts_line(&self) -> bool {
        // Compiler options stand before the first word of a block.
        self.tokens.iter().rev().find(|t| t.kind != Kind::Attributes).is_none_or(|t| t.kind == Kind::Newline)
    }

    /// A title begins a line, or follows the name of its block or network.
    fn title_may_stand(&self) -> bool {
        let line = self.tokens.iter().rposition(|t| t.kind == Kind::Newline).map_or(0, |at| at + 1);
        let mut words = self.tokens.iter().skip(line).skip_while(|t| t.kind == Kind::Attributes);
        words.next().is_none_or(|first| {
            let word = self.text.get(first.span.start as usize..first.span.end as usize).unwrap_or("");
            begins_block(word) || word.eq_ignore_ascii_case("NETWORK")
        })
    }

    /// The rest of a line of a block's head after its colon: any text, up to a comment.
    fn head_text(&mut self) -> Option<usize> {
        let [.., before, word, colon] = self.tokens.as_slice() else { return None };
        let line = before.kind == Kind::Newline && colon.kind == Kind::Colon && self.in_head;
        let text = self.text.get(word.span.start as usize..word.span.end as usize).unwrap_or("");
        if !line || !HEADER_LINES.iter().any(|w| w.eq_ignore_ascii_case(text)) {
            return None;
        }
        let rest = self.rest();
        let end = rest.find('\n').unwrap_or(rest.len());
        let line = rest.get(..end).unwrap_or("");
        let text = line.split("//").next().unwrap_or("").trim_end();
        (!text.trim().is_empty()).then_some(text.len())
    }

    /// True if `= text`, or nothing, follows the word TITLE.
    fn title_follows(&self) -> bool {
        let rest = self.rest().trim_start_matches([' ', '\t', '\r']);
        rest.is_empty() || rest.starts_with(['=', '\n'])
    }

    fn number(&mut self) -> Kind {
        let digit = |c: char| c.is_ascii_digit() || c == '_';
        self.skip_while(digit);
        if self.peek() == Some('#') && self.peek_second().is_some_and(|c| c.is_ascii_hexdigit()) {
            self.bump();
            self.skip_while(|c| c.is_ascii_hexdigit() || c == '_');
            return Kind::Number;
        }
        if self.peek() == Some('.') && self.peek_second().is_some_and(|c| c.is_ascii_digit()) {
            self.bump();
            self.skip_while(digit);
        }
        let mut ahead = self.rest().chars();
        if matches!(ahead.next(), Some('e' | 'E')) {
            let exponent = match ahead.next() {
                Some('+' | '-') => ahead.next(),
                other => other,
            };
            if exponent.is_some_and(|c| c.is_ascii_digit()) {
                self.bump();
                self.bump();
                self.skip_while(|c| c.is_ascii_digit());
            }
        }
        Kind::Number
    }

    /// A text or name, `Bad` when it is not closed; `$` takes the next character with it in texts.
    fn quoted(&mut self, quote: char, kind: Kind) -> Kind {
        let start = self.at;
        self.bump();
        while let Some(c) = self.peek().filter(|c| !matches!(c, '\n' | '\r')) {
            self.bump();
            if c == quote {
                return kind;
            }
            if c == '$' && quote == '\'' && !matches!(self.peek(), Some('\n' | '\r')) {
                self.bump();
            }
        }
        let what = if kind == Kind::Text { "text" } else { "name" };
        let span = Span { start: start as u32, end: self.at as u32 };
        self.sink.report(
            self.file,
            span,
            &messages::NOT_CLOSED,
            format!("the {what} is not closed with {quote} on this line"),
        );
        Kind::Bad
    }

    fn local(&mut self) -> Kind {
        self.bump();
        match self.peek() {
            Some('"') => self.quoted('"', Kind::Local),
            Some(c) if is_word(c) => {
                self.skip_while(is_word);
                Kind::Local
            }
            _ => {
                let span = Span { start: self.at as u32 - 1, end: self.at as u32 };
                self.sink.report(self.file, span, &messages::STRAY_CHARACTER, "a name is missing after #");
                Kind::Bad
            }
        }
    }

    fn attributes(&mut self) -> Kind {
        let start = self.at;
        if let Some(length) = closed_list(self.rest()) {
            let lines = self.rest().get(..length).unwrap_or("").matches('\n').count();
            self.at += length;
            self.lines_within = lines as u32;
        } else {
            self.skip_line();
            let span = Span { start: start as u32, end: self.at as u32 };
            self.sink.report(self.file, span, &messages::NOT_CLOSED, "the list is not closed with }");
        }
        Kind::Attributes
    }

    fn punctuation(&mut self, c: char) -> Kind {
        let start = self.at;
        self.bump();
        match c {
            ':' if self.eat('=') => Kind::Assign,
            ':' => Kind::Colon,
            ';' => Kind::Semicolon,
            ',' => Kind::Comma,
            '(' => Kind::LeftParen,
            ')' => Kind::RightParen,
            '[' => Kind::LeftBracket,
            ']' => Kind::RightBracket,
            '.' if self.eat('.') => Kind::DotDot,
            '.' => Kind::Dot,
            '=' if self.scl && self.eat('>') => Kind::Arrow,
            '=' | '>' => {
                if !(self.scl && c == '=') {
                    self.eat('=');
                }
                Kind::Operator
            }
            '<' => {
                if !self.eat('=') {
                    self.eat('>');
                }
                Kind::Operator
            }
            '*' if self.scl && self.eat('*') => Kind::Operator,
            '+' | '-' | '*' | '/' if self.scl && self.eat('=') => Kind::AssignWith,
            '?' if self.scl && self.eat('=') => Kind::AssignWith,
            '&' | '^' if self.scl => Kind::Operator,
            '+' | '-' | '*' | '/' => Kind::Operator,
            _ => {
                self.skip_while(|c| !c.is_whitespace() && !is_word(c) && !c.is_ascii_punctuation());
                if self.stray_line == self.line {
                    return Kind::Bad;
                }
                self.stray_line = self.line;
                let span = Span { start: start as u32, end: self.at as u32 };
                let shown: String = self.text.get(start..self.at).unwrap_or("").chars().take(8).collect();
                let language = if self.scl { "SCL" } else { "STL" };
                let message = format!("{} means nothing in {language}", shown.escape_debug());
                self.sink.report(self.file, span, &messages::STRAY_CHARACTER, message);
                Kind::Bad
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(text: &str) -> Vec<(Kind, String)> {
        let mut sink = Sink::new();
        let tokens = lex(0, text, &mut sink);
        tokens
            .iter()
            .filter(|t| t.kind != Kind::Newline)
            .map(|t| (t.kind, text[t.span.start as usize..t.span.end as usize].to_owned()))
            .collect()
    }

    fn words(text: &str) -> String {
        kinds(text).into_iter().map(|(_, s)| s).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn operands_in_all_spellings() {
        assert_eq!(words("U DB10.DBX    108.7 //x"), "U DB10 . DBX 108.7");
        assert_eq!(words("FRG:=DB10.DBX260.4"), "FRG := DB10 . DBX260 . 4");
        assert_eq!(words("L W[AR1,P#2.0]"), "L W [ AR1 , P# 2.0 ]");
        assert_eq!(words("a : ARRAY [0..299] OF"), "a : ARRAY [ 0 .. 299 ] OF");
    }

    #[test]
    fn constants_are_one_token_and_local_names_another() {
        assert_eq!(kinds("L L#-5")[1], (Kind::Typed, "L#-5".into()));
        assert_eq!(kinds("L#x")[1], (Kind::Local, "#x".into()));
        assert_eq!(kinds("T#x")[0], (Kind::Word, "T".into()));
        assert_eq!(kinds("D#1994-3-15;")[0], (Kind::Typed, "D#1994-3-15".into()));
        assert_eq!(kinds("TOD#12:30:10.5")[0], (Kind::Typed, "TOD#12:30:10.5".into()));
        assert_eq!(words("B#(1, 2)"), "B# ( 1 , 2 )");
        assert_eq!(words("2#0101_1 1.5e-3 +1"), "2#0101_1 1.5e-3 + 1");
    }

    #[test]
    fn titles_are_raw() {
        assert_eq!(kinds("TITLE = it's \"so\n")[0].0, Kind::Title);
        assert_eq!(kinds("L TITLE = 1")[1].0, Kind::Word);
        assert_eq!(kinds("NETWORK TITLE = it's\nFUNCTION FC 1 : VOID TITLE = it's\n")[1].0, Kind::Title);
    }

    #[test]
    fn a_head_has_any_text() {
        let text = "FUNCTION FC 1 : VOID\nAUTHOR : it's {\"me\nNAME: a-b // c\nVAR_INPUT\nNAME : INT;\n";
        assert_eq!(words(text), "FUNCTION FC 1 : VOID AUTHOR :  it's {\"me NAME :  a-b VAR_INPUT NAME : INT ;");
    }

    #[test]
    fn names_of_other_countries() {
        // As bytes of CP1251 look when they are read as CP1252.
        assert_eq!(words("L #\u{EF}\u{F3}\u{F7}\u{B8}\u{EA}; L 1"), "L #\u{EF}\u{F3}\u{F7}\u{B8}\u{EA} ; L 1");
    }

    #[test]
    fn comments_go_over_lines() {
        assert_eq!(words("L 1 (/* a; \n b */) T MW 2"), "L 1 T MW 2");
        assert_eq!(words("L 1 (* a\n b *) T MW 2 // c\n(* d *) U M 1.0"), "L 1 T MW 2 U M 1.0");
        let mut sink = Sink::new();
        let tokens = lex(0, "(*\n*)\nL 1", &mut sink);
        assert_eq!(tokens.iter().find(|t| t.kind == Kind::Word).map(|t| t.line), Some(3));
    }

    #[test]
    fn tia_s_addresses() {
        assert_eq!(words("= %DB1.DBX0.3; L %MW10 CHAR#'A' BOOL#TRUE"), "= DB1 . DBX0 . 3 ; L MW10 CHAR#'A' BOOL#TRUE");
    }
}
