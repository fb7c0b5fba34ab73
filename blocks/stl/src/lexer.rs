//! Text to tokens. Never fails: what is no token becomes one of the kind `Bad`, with a diagnostic.

use crate::codes;
use crate::diagnostic::Sink;
use crate::token::{Kind, Span, Token};

/// Prefixes of constants, before a `#`.
const CONSTANT_PREFIXES: [&str; 20] = [
    "B",
    "BYTE",
    "W",
    "WORD",
    "DW",
    "DWORD",
    "L",
    "DINT",
    "INT",
    "C",
    "S5T",
    "S5TIME",
    "T",
    "TIME",
    "D",
    "DATE",
    "TOD",
    "TIME_OF_DAY",
    "DT",
    "DATE_AND_TIME",
];

/// Splits `text`. Every token costs one step; every character is looked at a bounded number of times.
pub(crate) fn lex(file: usize, text: &str, sink: &mut Sink) -> Vec<Token> {
    let mut lexer =
        Lexer { lines_within: 0, file, text, at: 0, line: 1, tokens: Vec::with_capacity(text.len() / 4), sink };
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

struct Lexer<'a> {
    /// Line ends within the token under way.
    lines_within: u32,
    file: usize,
    text: &'a str,
    at: usize,
    line: u32,
    tokens: Vec<Token>,
    sink: &'a mut Sink,
}

fn is_word_start(c: char) -> bool {
    c.is_alphabetic() || c == '_'
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

impl<'a> Lexer<'a> {
    fn rest(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or("")
    }

    fn peek(&self) -> Option<char> {
        self.rest().chars().next()
    }

    fn peek_second(&self) -> Option<char> {
        self.rest().chars().nth(1)
    }

    fn bump(&mut self) {
        self.at += self.peek().map_or(0, char::len_utf8);
    }

    fn skip_while(&mut self, keep: impl Fn(char) -> bool) {
        let rest = self.rest();
        self.at += rest.find(|c| !keep(c)).unwrap_or(rest.len());
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
            if c == '\n' {
                self.bump();
                self.push(Kind::Newline, start, spaced);
                self.line = self.line.saturating_add(1);
                spaced = true;
            } else if c.is_whitespace() {
                self.skip_while(|c| c.is_whitespace() && c != '\n');
                spaced = true;
            } else if self.rest().starts_with("//") {
                self.skip_while(|c| c != '\n');
                spaced = true;
            } else {
                let kind = self.token(c);
                self.push(kind, start, spaced);
                spaced = false;
            }
        }
        self.push(Kind::Newline, self.at, spaced);
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
        if word.eq_ignore_ascii_case("TITLE") && self.starts_line() && self.title_follows() {
            self.skip_while(|c| c != '\n');
            return Kind::Title;
        }
        if self.peek() != Some('#') {
            return Kind::Word;
        }
        if word.eq_ignore_ascii_case("P") {
            self.bump();
            return Kind::PointerSign;
        }
        // `L#name` is the mnemonic L and a local name, `L#5` a constant: constants go on with a digit or a sign.
        let goes_on = self.peek_second().is_some_and(|c| c.is_ascii_digit() || matches!(c, '-' | '+' | '('));
        if !goes_on || !CONSTANT_PREFIXES.iter().any(|p| p.eq_ignore_ascii_case(word)) {
            return Kind::Word;
        }
        self.bump();
        if matches!(self.peek(), Some('-' | '+')) {
            self.bump();
        }
        let dated = word.len() == 1 && word.eq_ignore_ascii_case("D") || word.len() > 1 && word.contains(['t', 'T']);
        self.skip_while(|c| c.is_ascii_alphanumeric() || "_.#".contains(c) || dated && "-:".contains(c));
        Kind::Typed
    }

    fn starts_line(&self) -> bool {
        self.tokens.last().is_none_or(|t| t.kind == Kind::Newline)
    }

    fn title_follows(&self) -> bool {
        self.rest().trim_start_matches([' ', '\t']).starts_with('=')
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
            &codes::NOT_CLOSED,
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
                self.sink.report(self.file, span, &codes::STRAY_CHARACTER, "a name is missing after #");
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
            self.skip_while(|c| c != '\n');
            let span = Span { start: start as u32, end: self.at as u32 };
            self.sink.report(self.file, span, &codes::NOT_CLOSED, "the list is not closed with }");
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
            '=' | '>' => {
                self.eat('=');
                Kind::Operator
            }
            '<' => {
                if !self.eat('=') {
                    self.eat('>');
                }
                Kind::Operator
            }
            '+' | '-' | '*' | '/' => Kind::Operator,
            _ => {
                self.skip_while(|c| !c.is_whitespace() && !is_word(c) && !c.is_ascii_punctuation());
                let span = Span { start: start as u32, end: self.at as u32 };
                let shown: String = self.text.get(start..self.at).unwrap_or("").chars().take(8).collect();
                let message = format!("{} means nothing in STL", shown.escape_debug());
                self.sink.report(self.file, span, &codes::STRAY_CHARACTER, message);
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
    }
}
