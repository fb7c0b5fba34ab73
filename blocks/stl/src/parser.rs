//! Tokens to blocks: frames, headers and sections. Never fails: after a mistake it continues at the next statement,
//! declaration or block.

use ob1_model::Section;

use crate::diagnostic::Sink;
use crate::identifiers::BlockWord;
use crate::messages::{self, Code};
pub(crate) use crate::parse_scl::Bodies;
use crate::syntax::{Block, Frame, NameRef, Statement, Type, TypeKind};
use crate::tia;
use crate::token::{File, Kind, Span, Token};
use crate::words::Words;

/// Words that begin a block, with the word that ends it.
pub(crate) const FRAMES: [(&str, &str, Frame); 5] = [
    ("ORGANIZATION_BLOCK", "END_ORGANIZATION_BLOCK", Frame::Ob),
    ("FUNCTION_BLOCK", "END_FUNCTION_BLOCK", Frame::Fb),
    ("FUNCTION", "END_FUNCTION", Frame::Fc),
    ("DATA_BLOCK", "END_DATA_BLOCK", Frame::Db),
    ("TYPE", "END_TYPE", Frame::Udt),
];

/// Header lines of the form `VERSION : 0.1`.
pub(crate) const HEADER_LINES: [&str; 4] = ["VERSION", "AUTHOR", "FAMILY", "NAME"];

/// Attributes of a block that are words alone.
const HEADER_WORDS: [&str; 16] = [
    "KNOW_HOW_PROTECT",
    "READ_ONLY",
    "RETAIN",
    "NON_RETAIN",
    "UNLINKED",
    "WRITE_PROTECTED",
    "CODE_VERSION1",
    "MULTIPLE_INSTANCE",
    "STANDARD",
    "SYSTEM",
    "OPTIMIZED",
    "OPTIMIZED_ACCESS",
    "OPTIMIZED_CODE",
    "NON_OPTIMIZED",
    "NON_OPTIMIZED_ACCESS",
    "SET_ENO_AUTOMATICALLY",
];

/// What may follow the word of a declaration section.
const SECTION_WORDS: [&str; 4] = ["RETAIN", "NON_RETAIN", "DB_SPECIFIC", "CONSTANT"];

/// A word in capitals, kept without allocation: nearly every statement is asked whether it is one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Keyword {
    letters: [u8; Self::LONGEST],
    length: usize,
}

impl Keyword {
    const LONGEST: usize = 24;

    /// `None` for what is longer than any keyword.
    fn new(word: &str) -> Option<Self> {
        let mut letters = [0; Self::LONGEST];
        let length = word.len();
        letters.get_mut(..length)?.copy_from_slice(word.as_bytes());
        letters.make_ascii_uppercase();
        Some(Self { letters, length })
    }
}

impl std::ops::Deref for Keyword {
    type Target = str;

    fn deref(&self) -> &str {
        self.letters.get(..self.length).and_then(|letters| std::str::from_utf8(letters).ok()).unwrap_or("")
    }
}

/// What the first word of a block, in capitals, begins, and the word that ends it.
fn frame_of(word: &str) -> Option<(&'static str, Frame)> {
    FRAMES.iter().find(|(begin, _, _)| *begin == word).map(|(_, end, frame)| (*end, *frame))
}

/// True for the first word of a block.
pub(crate) fn begins_block(word: &str) -> bool {
    FRAMES.iter().any(|(begin, _, _)| begin.eq_ignore_ascii_case(word))
}

/// True for the last word of a block.
pub(crate) fn ends_block(word: &str) -> bool {
    FRAMES.iter().any(|(_, end, _)| end.eq_ignore_ascii_case(word))
}

/// True for the first word of a declaration section.
pub(crate) fn is_section(word: &str) -> bool {
    Section::opened_by(word).is_some()
}

/// True for a word after which no line of the head can follow.
pub(crate) fn ends_head(word: &str) -> bool {
    ["BEGIN", "STRUCT", "NETWORK", "ARRAY"].iter().any(|end| end.eq_ignore_ascii_case(word))
        || word.get(..4).is_some_and(|w| w.eq_ignore_ascii_case("END_"))
}

/// Words a statement may not begin with, proposed when an unknown word is near one of them.
pub(crate) fn keywords() -> impl Iterator<Item = &'static str> {
    let frames = FRAMES.into_iter().flat_map(|(begin, end, _)| [begin, end]);
    let sections = Section::WORDS.into_iter().map(|(_, word)| word);
    frames.chain(sections).chain(HEADER_WORDS).chain(["BEGIN", "NETWORK", "TITLE", "END_VAR", "STRUCT", "END_STRUCT"])
}

/// Words that begin a block or a declaration section.
pub(crate) fn is_frame_or_section(word: &str) -> bool {
    FRAMES.iter().any(|(begin, _, _)| *begin == word) || Section::WORDS.iter().any(|(_, begin)| *begin == word)
}

/// Parses one file.
pub(crate) fn parse(index: usize, file: &File<'_>, words: &Words, bodies: Bodies, sink: &mut Sink) -> Vec<Block> {
    Parser { index, file, words, sink, at: 0, bodies, statements: Vec::new(), calls: Vec::new() }.file()
}

pub(crate) struct Parser<'p, 's> {
    pub(crate) index: usize,
    pub(crate) file: &'p File<'s>,
    pub(crate) words: &'p Words,
    pub(crate) sink: &'p mut Sink,
    pub(crate) at: usize,
    pub(crate) bodies: Bodies,
    /// The statements of the block under way, and which of them are calls.
    pub(crate) statements: Vec<Statement>,
    pub(crate) calls: Vec<u32>,
}

impl<'s> Parser<'_, 's> {
    pub(crate) fn peek(&self) -> Option<Token> {
        self.peek_at(0)
    }

    pub(crate) fn peek_at(&self, ahead: usize) -> Option<Token> {
        self.file.tokens.get(self.at + ahead).copied()
    }

    pub(crate) fn peek_kind(&self) -> Option<Kind> {
        self.peek().map(|t| t.kind)
    }

    pub(crate) fn bump(&mut self) {
        self.at += 1;
        self.sink.steps += 1;
    }

    pub(crate) fn text(&self, token: Token) -> &'s str {
        self.file.of(token)
    }

    pub(crate) fn eat(&mut self, kind: Kind) -> bool {
        let found = self.peek_kind() == Some(kind);
        if found {
            self.bump();
        }
        found
    }

    pub(crate) fn skip_newlines(&mut self) {
        while matches!(self.peek_kind(), Some(Kind::Newline | Kind::Attributes)) {
            self.bump();
        }
    }

    /// Skips up to the end of the line or statement, not over it.
    pub(crate) fn skip_statement(&mut self) {
        while !matches!(self.peek_kind(), None | Some(Kind::Newline | Kind::Semicolon)) {
            self.bump();
        }
    }

    /// The place of the next token, for messages about something missing.
    pub(crate) fn here(&self) -> Span {
        self.peek().or_else(|| self.file.tokens.last().copied()).map_or(Span::default(), |t| t.span)
    }

    pub(crate) fn report(&mut self, span: Span, code: &'static Code, message: impl Into<String>) {
        self.sink.report(self.index, span, code, message);
    }

    /// The next token as a word in capitals, when it is a word that could be a keyword.
    pub(crate) fn keyword(&self) -> Option<Keyword> {
        let token = self.peek().filter(|t| t.kind == Kind::Word)?;
        Keyword::new(self.text(token))
    }

    fn frame_here(&self) -> Option<(&'static str, Frame)> {
        frame_of(&self.keyword()?)
    }

    fn file(&mut self) -> Vec<Block> {
        let mut blocks = Vec::new();
        let mut outside_reported = false;
        while let Some(token) = self.peek() {
            match token.kind {
                Kind::Newline | Kind::Semicolon | Kind::Title | Kind::Attributes => self.bump(),
                _ => {
                    if let Some((end, frame)) = self.frame_here() {
                        blocks.extend(self.block(end, frame));
                        outside_reported = false;
                        continue;
                    }
                    self.outside(token, outside_reported);
                    outside_reported = true;
                    self.skip_statement();
                }
            }
        }
        blocks
    }

    /// Text outside any block: reported once a run, and where it is a block's first word misspelt.
    fn outside(&mut self, token: Token, reported: bool) {
        let begins = FRAMES.iter().map(|(begin, _, _)| *begin);
        let message = "this is outside any block";
        match self.sink.nearest(self.text(token), begins) {
            Some(near) => {
                let remedy = format!("Did you mean {near}?");
                self.sink.report_with(self.index, token.span, &messages::OUTSIDE_BLOCK, message, remedy);
            }
            None if !reported => self.report(token.span, &messages::OUTSIDE_BLOCK, message),
            None => {}
        }
    }

    /// A block from its first word to its last. `None` when it has no usable name; its contents are checked all the
    /// same.
    fn block(&mut self, end: &'static str, frame: Frame) -> Option<Block> {
        let head = self.here();
        self.bump();
        let span = self.here();
        let name = self.block_name();
        if name.is_none() {
            self.report(
                span,
                &messages::BLOCK_NAME,
                "the block's name is missing: a kind and number (FC 9) or a \"symbol\"",
            );
            self.skip_statement();
        }
        let mut block = Block {
            file: self.index,
            frame,
            name: name.clone().unwrap_or(NameRef::Symbol(String::new())),
            span,
            header_name: None,
            result: None,
            optimized: false,
            code_version1: false,
            constants: Vec::new(),
            foreign: self.bodies == Bodies::LeftOut,
            scl: None,
            sections: Vec::new(),
            shape: None,
            assignments: Vec::new(),
            statements: Vec::new(),
            calls: Vec::new(),
            read_only: false,
            non_retain: false,
        };
        if frame == Frame::Fc && name.is_some() {
            self.result_type(&mut block, span);
        }
        self.header(&mut block, end);
        if self.bodies != Bodies::Stl && frame != Frame::Db && frame != Frame::Udt {
            let from = self.at;
            self.foreign_body(end);
            block.scl = (self.bodies == Bodies::Scl).then_some(from..self.at);
        }
        self.body(&mut block, end, head);
        block.statements = self.statements.drain(..).collect();
        block.calls = self.calls.drain(..).collect();
        name.map(|_| block)
    }

    /// `FC 9`, `FC9` or `"symbol"`.
    pub(crate) fn block_name(&mut self) -> Option<NameRef> {
        let token = self.peek()?;
        match token.kind {
            Kind::Symbol => {
                self.bump();
                Some(NameRef::Symbol(unquote(self.text(token)).to_owned()))
            }
            Kind::Word => {
                let text = self.text(token);
                let (word, digits) = split_digits(text);
                let Some(word) = BlockWord::parse(word) else {
                    // A symbol without its quotes; a keyword is not one.
                    if begins_block(text) || is_section(text) || ends_head(text) {
                        return None;
                    }
                    self.bump();
                    return Some(NameRef::Bare(text.to_owned()));
                };
                self.bump();
                let digits = match self.peek() {
                    _ if !digits.is_empty() => digits,
                    Some(number) if number.kind == Kind::Number => {
                        self.bump();
                        self.text(number)
                    }
                    _ => return None,
                };
                digits.parse().ok().map(|number| NameRef::Absolute(word, number))
            }
            _ => None,
        }
    }

    fn result_type(&mut self, block: &mut Block, span: Span) {
        self.skip_newlines();
        if !self.eat(Kind::Colon) {
            let remedy =
                "Write the type of the function value after the name, FUNCTION FC 1 : VOID when there is none.";
            self.sink.report_with(self.index, span, &messages::RETURN_TYPE, "the function has no return type", remedy);
            return;
        }
        if self.keyword().as_deref() == Some("VOID") {
            self.bump();
        } else {
            let ty = self.ty(0);
            block.result = (!matches!(ty.kind, TypeKind::Bad)).then_some(ty);
        }
    }

    /// Everything up to and with BEGIN, or up to what can only be the body.
    fn header(&mut self, block: &mut Block, end: &str) {
        let begin = if self.bodies == Bodies::Scl { None } else { self.begin(end) };
        loop {
            let Some(token) = self.peek() else { return };
            if token.kind == Kind::Attributes {
                block.optimized |= tia::is_optimized(self.text(token));
            }
            // `TYPE UDT 7 : STRUCT`, as other languages of the standard write it.
            let colon = token.kind == Kind::Colon && block.frame == Frame::Udt && block.shape.is_none();
            if colon || matches!(token.kind, Kind::Newline | Kind::Semicolon | Kind::Title | Kind::Attributes) {
                self.bump();
                continue;
            }
            let data = matches!(block.frame, Frame::Db | Frame::Udt);
            if data && token.kind == Kind::Symbol && block.shape.is_none() {
                block.shape = Some(self.ty(0));
                continue;
            }
            let Some(word) = self.keyword() else {
                if begin.is_some_and(|begin| self.at < begin) {
                    self.report(token.span, &messages::HEAD, "this word does not belong in a block header");
                    self.skip_line();
                    continue;
                }
                return;
            };
            if &*word == "BEGIN" {
                self.bump();
                return;
            }
            if let Some(section) = Section::opened_by(&word) {
                self.section(block, section);
            } else if self.bodies == Bodies::Scl && !data && &*word == "CONST" {
                self.constants(block);
            } else if self.bodies == Bodies::Scl && !data && &*word == "LABEL" {
                self.labels();
            } else if HEADER_WORDS.contains(&&*word) {
                block.read_only |= &*word == "READ_ONLY";
                block.non_retain |= &*word == "NON_RETAIN";
                block.code_version1 |= &*word == "CODE_VERSION1";
                self.bump();
            } else if HEADER_LINES.contains(&&*word) && self.peek_at(1).is_some_and(|t| t.kind == Kind::Colon) {
                self.header_line(block, &word);
            } else if data && block.shape.is_none() && self.begins_shape(&word) {
                block.shape = Some(self.ty(0));
            } else if begin.is_some_and(|begin| self.at < begin) {
                self.unknown_head_word(block, token, &word);
            } else {
                return;
            }
        }
    }

    /// Reports a line that does not belong in a head: its colon is missing, or its word is misspelt or unknown.
    fn unknown_head_word(&mut self, block: &mut Block, token: Token, word: &str) {
        let text: String = self.text(token).chars().take(32).collect();
        let missing = match word {
            "TITLE" => Some(("=", "=")),
            _ => HEADER_LINES.contains(&word).then_some((":", "a colon")),
        };
        if let Some((sign, said)) = missing {
            let message = format!("{said} is missing after {text}");
            let remedy = format!("Write {text} {sign} and its text.");
            self.sink.report_with(self.index, token.span, &messages::HEAD, message, remedy);
            return self.skip_line();
        }
        // Declarations are read, so that their names are known.
        let opens = word.starts_with("VAR") && self.peek_at(1).is_none_or(|t| t.kind == Kind::Newline);
        let section = if opens { self.sink.nearest(word, Section::WORDS.map(|(_, word)| word)) } else { None };
        let known = HEADER_WORDS.into_iter().chain(HEADER_LINES).chain(Section::WORDS.map(|(_, word)| word));
        let message = format!("{text} is not a word of a block header");
        self.sink.report_unknown(self.index, token.span, &messages::HEAD, message, word, known);
        match section.and_then(Section::opened_by) {
            Some(section) => self.section(block, section),
            None => self.skip_line(),
        }
    }

    /// The next BEGIN of this block, by its token.
    fn begin(&mut self, end: &str) -> Option<usize> {
        let mut line = true;
        for (at, token) in self.file.tokens.iter().enumerate().skip(self.at) {
            self.sink.steps += 1;
            if line && token.kind == Kind::Word {
                let word = self.file.of(*token);
                if word.eq_ignore_ascii_case("BEGIN") {
                    return Some(at);
                }
                if word.eq_ignore_ascii_case(end) || begins_block(word) || word.eq_ignore_ascii_case("NETWORK") {
                    return None;
                }
            }
            line = matches!(token.kind, Kind::Newline | Kind::Semicolon);
        }
        None
    }

    fn skip_line(&mut self) {
        while !matches!(self.peek_kind(), None | Some(Kind::Newline)) {
            self.bump();
        }
    }

    fn begins_shape(&self, word: &str) -> bool {
        if word == "STRUCT" || word == "ARRAY" || tia::instance(word).is_some() {
            return true;
        }
        let alone = self.peek_at(1).is_none_or(|t| matches!(t.kind, Kind::Newline | Kind::Semicolon))
            || self.peek_at(1).is_some_and(|t| self.text(t).eq_ignore_ascii_case("BEGIN"));
        if alone && self.words.mnemonic(word).is_none() && !ends_head(word) && !HEADER_WORDS.contains(&word) {
            return true;
        }
        let names_type =
            matches!(BlockWord::parse(split_digits(word).0), Some(BlockWord::Fb | BlockWord::Sfb | BlockWord::Udt));
        names_type && self.peek_at(1).is_none_or(|t| t.kind != Kind::Assign)
    }

    fn header_line(&mut self, block: &mut Block, word: &str) {
        self.bump();
        self.bump();
        let Some(text) = self.peek().filter(|t| t.kind == Kind::Title) else { return };
        self.bump();
        if word == "NAME" {
            let name = self.text(text).trim().trim_end_matches(';').trim_end();
            block.header_name = Some(name.trim_matches('\'').to_owned());
        }
    }

    fn section(&mut self, block: &mut Block, section: Section) {
        let head = self.here();
        self.bump();
        let mut constant = false;
        while let Some(word) = self.keyword().filter(|w| SECTION_WORDS.contains(&&**w)) {
            // A variable may be called like that.
            if self.peek_at(1).is_some_and(|t| matches!(t.kind, Kind::Colon | Kind::Comma)) {
                break;
            }
            constant |= &*word == "CONSTANT";
            self.bump();
        }
        let allowed = match (block.frame, section) {
            // TIA Portal gives an optimised organization block its start information as inputs.
            (Frame::Fb, _) | (Frame::Fc | Frame::Ob, Section::Temp) | (Frame::Ob, Section::Input) => true,
            (Frame::Fc, other) => other != Section::Static,
            _ => false,
        };
        let declarations = self.declarations("END_VAR", head, 0);
        let section = match (self.bodies, block.frame, section) {
            // VAR of a function lies in its local data.
            (Bodies::Scl, Frame::Fc | Frame::Ob, Section::Static) => Section::Temp,
            _ => section,
        };
        let allowed = allowed || self.bodies == Bodies::Scl && section == Section::Temp;
        if constant {
            block.constants.extend(declarations);
        } else if block.frame == Frame::Db && section == Section::Static {
            // TIA Portal declares the retentive part of a data block apart.
            match block.shape.as_mut().map(|shape| &mut shape.kind) {
                Some(TypeKind::Struct(all)) => all.extend(declarations),
                Some(_) => self.report(head, &messages::SECTION, "the data block has a structure already"),
                None => block.shape = Some(Type { kind: TypeKind::Struct(declarations), span: head }),
            }
        } else if allowed {
            block.sections.push((section, declarations));
        } else {
            self.report(head, &messages::SECTION, "a block of this kind has no such declaration section");
            if matches!(block.frame, Frame::Fc | Frame::Ob) {
                // Their uses are no mistakes of their own.
                block.sections.push((Section::Temp, declarations));
            }
        }
    }

    /// True for a word that names a component or parameter, whatever else it means: `Type := 5;`, `Type.x := 5;`.
    pub(crate) fn names_component(&self) -> bool {
        self.peek_at(1).is_some_and(|t| matches!(t.kind, Kind::Assign | Kind::Dot | Kind::LeftBracket))
    }

    /// Statements or assignments up to the block's end.
    fn body(&mut self, block: &mut Block, end: &'static str, head: Span) {
        let mut network = 0u16;
        while let Some(token) = self.peek() {
            if matches!(token.kind, Kind::Newline | Kind::Semicolon | Kind::Title | Kind::Attributes) {
                self.bump();
                continue;
            }
            // The searched words but VAR have four letters at least, mnemonics mostly fewer. One may name a component.
            let long = token.kind == Kind::Word
                && (token.span.end - token.span.start >= 4 || self.text(token).eq_ignore_ascii_case("VAR"));
            let word = if long && !self.names_component() { self.keyword() } else { None };
            match word.as_deref() {
                Some(word) if frame_of(word).is_some() => break,
                Some(word) if word == end => {
                    self.bump();
                    return;
                }
                Some(word) if FRAMES.iter().any(|(_, other, _)| *other == word) => {
                    let remedy = format!("End this block with {end}.");
                    let message = format!("{word} does not end this block");
                    self.sink.report_with(self.index, token.span, &messages::WRONG_END, message, remedy);
                    self.bump();
                    return;
                }
                Some("NETWORK") => {
                    self.bump();
                    self.skip_statement();
                    network = network.saturating_add(1);
                }
                Some("BEGIN") => {
                    self.report(token.span, &messages::MISPLACED, "BEGIN occurs once, before the first statement");
                    self.bump();
                }
                _ if block.frame == Frame::Db => self.assignment(block),
                _ if block.frame == Frame::Udt => {
                    self.report(token.span, &messages::MISPLACED, "a TYPE has exactly one structure");
                    self.skip_statement();
                }
                Some(word) if is_section(word) && self.peek_at(1).is_none_or(|t| t.kind != Kind::Colon) => {
                    let remedy = format!("Move {word} ... END_VAR in front of BEGIN.");
                    let message = "declarations stand in front of BEGIN and statements";
                    self.sink.report_with(self.index, token.span, &messages::MISPLACED, message, remedy);
                    if let Some(section) = Section::opened_by(word) {
                        self.section(block, section);
                    }
                }
                _ => {
                    network = network.max(1);
                    let statement = self.statement(network);
                    self.statements.extend(statement);
                }
            }
        }
        let remedy = format!("Write {end} after the block's last line.");
        self.sink.report_with(self.index, head, &messages::MISSING_END, format!("{end} is missing"), remedy);
    }
}

impl Statement {
    /// A statement without operation, to hold a label.
    pub(crate) fn empty(label: Option<usize>, token: Token, at: usize, network: u16) -> Self {
        let (span, line) = (token.span, token.line);
        Self { label, row: None, span, operand: at..at, args: Vec::new(), broken_list: false, network, line }
    }
}

impl Type {
    pub(crate) fn bad(span: Span) -> Self {
        Self { kind: TypeKind::Bad, span }
    }
}

/// `"pump"` without its quotes, closed or not; also without a leading `#`.
pub fn unquote(text: &str) -> &str {
    let text = text.strip_prefix('#').unwrap_or(text);
    let text = text.strip_prefix('"').unwrap_or(text);
    text.strip_suffix('"').unwrap_or(text)
}

/// `MW10` as `MW` and `10`.
pub fn split_digits(word: &str) -> (&str, &str) {
    let letters = word.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    word.split_at(letters)
}
