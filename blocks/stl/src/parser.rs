//! Tokens to blocks: frames, headers and sections. Never fails: after a mistake it goes on at the next statement,
//! declaration or block.

use ob1_model::Section;

use crate::codes::{self, Code};
use crate::diagnostic::Sink;
use crate::mnemonics::{BlockWord, Words};
use crate::syntax::{Block, Frame, NameRef, Statement, Type, TypeKind};
use crate::token::{File, Kind, Span, Token};

/// Words that begin a block, with the word that ends it.
const FRAMES: [(&str, &str, Frame); 5] = [
    ("ORGANIZATION_BLOCK", "END_ORGANIZATION_BLOCK", Frame::Ob),
    ("FUNCTION_BLOCK", "END_FUNCTION_BLOCK", Frame::Fb),
    ("FUNCTION", "END_FUNCTION", Frame::Fc),
    ("DATA_BLOCK", "END_DATA_BLOCK", Frame::Db),
    ("TYPE", "END_TYPE", Frame::Udt),
];

/// Words that begin a declaration section.
const SECTIONS: [(&str, Section); 5] = [
    ("VAR_INPUT", Section::Input),
    ("VAR_OUTPUT", Section::Output),
    ("VAR_IN_OUT", Section::InOut),
    ("VAR_TEMP", Section::Temp),
    ("VAR", Section::Static),
];

/// Header lines of the form `VERSION : 0.1`.
const HEADER_LINES: [&str; 4] = ["VERSION", "AUTHOR", "FAMILY", "NAME"];

/// Attributes of a block that are words alone.
const HEADER_WORDS: [&str; 5] = ["KNOW_HOW_PROTECT", "READ_ONLY", "NON_RETAIN", "UNLINKED", "WRITE_PROTECTED"];

/// Words a statement may not begin with, proposed when an unknown word is near one of them.
pub(crate) fn keywords() -> impl Iterator<Item = &'static str> {
    let frames = FRAMES.into_iter().flat_map(|(begin, end, _)| [begin, end]);
    let sections = SECTIONS.into_iter().map(|(word, _)| word);
    frames.chain(sections).chain(HEADER_WORDS).chain(["BEGIN", "NETWORK", "TITLE", "END_VAR", "STRUCT", "END_STRUCT"])
}

/// Words that begin a block or a declaration section.
pub(crate) fn is_frame_or_section(word: &str) -> bool {
    FRAMES.iter().any(|(begin, _, _)| *begin == word) || SECTIONS.iter().any(|(begin, _)| *begin == word)
}

/// Parses one file.
pub(crate) fn parse(index: usize, file: &File<'_>, words: &Words, sink: &mut Sink) -> Vec<Block> {
    let mut parser = Parser { index, file, words, sink, at: 0 };
    parser.file()
}

pub(crate) struct Parser<'p, 's> {
    pub(crate) index: usize,
    pub(crate) file: &'p File<'s>,
    pub(crate) words: &'p Words,
    pub(crate) sink: &'p mut Sink,
    pub(crate) at: usize,
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

    /// Up to, not over, the end of the line or statement.
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
    pub(crate) fn keyword(&self) -> Option<String> {
        let token = self.peek().filter(|t| t.kind == Kind::Word && t.span.end - t.span.start <= 24)?;
        Some(self.text(token).to_ascii_uppercase())
    }

    fn frame_here(&self) -> Option<(&'static str, Frame)> {
        let word = self.keyword()?;
        FRAMES.iter().find(|(begin, _, _)| *begin == word).map(|(_, end, frame)| (*end, *frame))
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
        let message = "this stands outside any block";
        match self.sink.nearest(self.text(token), begins) {
            Some(near) => {
                let remedy = format!("Did you mean {near}?");
                self.sink.report_with(self.index, token.span, &codes::OUTSIDE_BLOCK, message, remedy);
            }
            None if !reported => self.report(token.span, &codes::OUTSIDE_BLOCK, message),
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
                &codes::BLOCK_NAME,
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
            sections: Vec::new(),
            shape: None,
            assignments: Vec::new(),
            statements: Vec::new(),
            read_only: false,
        };
        if frame == Frame::Fc && name.is_some() {
            self.result_type(&mut block, span);
        }
        self.header(&mut block);
        self.body(&mut block, end, head);
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
                let (word, digits) = split_digits(self.text(token));
                let word = BlockWord::parse(word)?;
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
            self.sink.report_with(self.index, span, &codes::RETURN_TYPE, "the function has no return type", remedy);
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
    fn header(&mut self, block: &mut Block) {
        loop {
            let Some(token) = self.peek() else { return };
            if matches!(token.kind, Kind::Newline | Kind::Semicolon | Kind::Title | Kind::Attributes) {
                self.bump();
                continue;
            }
            let data = matches!(block.frame, Frame::Db | Frame::Udt);
            if data && token.kind == Kind::Symbol && block.shape.is_none() {
                block.shape = Some(self.ty(0));
                continue;
            }
            let Some(word) = self.keyword() else { return };
            if word == "BEGIN" {
                self.bump();
                return;
            }
            if let Some((_, section)) = SECTIONS.iter().find(|(name, _)| *name == word) {
                self.section(block, *section);
            } else if HEADER_WORDS.contains(&word.as_str()) {
                block.read_only |= word == "READ_ONLY";
                self.bump();
            } else if HEADER_LINES.contains(&word.as_str()) && self.peek_at(1).is_some_and(|t| t.kind == Kind::Colon) {
                self.header_line(block, &word);
            } else if data && block.shape.is_none() && self.begins_shape(&word) {
                block.shape = Some(self.ty(0));
            } else {
                return;
            }
        }
    }

    fn begins_shape(&self, word: &str) -> bool {
        if word == "STRUCT" || word == "ARRAY" {
            return true;
        }
        let names_type =
            matches!(BlockWord::parse(split_digits(word).0), Some(BlockWord::Fb | BlockWord::Sfb | BlockWord::Udt));
        names_type && self.peek_at(1).is_none_or(|t| t.kind != Kind::Assign)
    }

    fn header_line(&mut self, block: &mut Block, word: &str) {
        self.bump();
        self.bump();
        let from = self.at;
        self.skip_statement();
        if word == "NAME" && self.at > from {
            let tokens = &self.file.tokens;
            let span = tokens[from].span.to(tokens[self.at - 1].span);
            block.header_name = Some(self.file.slice(span).trim_matches('\'').to_owned());
        }
    }

    fn section(&mut self, block: &mut Block, section: Section) {
        let head = self.here();
        self.bump();
        let allowed = match (block.frame, section) {
            (Frame::Fb, _) | (Frame::Fc | Frame::Ob, Section::Temp) => true,
            (Frame::Fc, other) => other != Section::Static,
            _ => false,
        };
        let declarations = self.declarations("END_VAR", head, 0);
        if allowed {
            block.sections.push((section, declarations));
        } else {
            self.report(head, &codes::SECTION, "a block of this kind has no such declaration section");
        }
    }

    /// Statements or assignments up to the block's end.
    fn body(&mut self, block: &mut Block, end: &'static str, head: Span) {
        let mut network = 0u16;
        while let Some(token) = self.peek() {
            if matches!(token.kind, Kind::Newline | Kind::Semicolon | Kind::Title | Kind::Attributes) {
                self.bump();
                continue;
            }
            if self.frame_here().is_some() {
                break;
            }
            match self.keyword().as_deref() {
                Some(word) if word == end => {
                    self.bump();
                    return;
                }
                Some(word) if FRAMES.iter().any(|(_, other, _)| *other == word) => {
                    let remedy = format!("End this block with {end}.");
                    let message = format!("{word} does not end this block");
                    self.sink.report_with(self.index, token.span, &codes::WRONG_END, message, remedy);
                    self.bump();
                    return;
                }
                Some("NETWORK") => {
                    self.bump();
                    self.skip_statement();
                    network = network.saturating_add(1);
                }
                Some("BEGIN") => {
                    self.report(token.span, &codes::MISPLACED, "BEGIN stands once, before the first statement");
                    self.bump();
                }
                _ if block.frame == Frame::Db => self.assignment(block),
                _ if block.frame == Frame::Udt => {
                    self.report(token.span, &codes::MISPLACED, "a TYPE has nothing but one structure");
                    self.skip_statement();
                }
                _ => {
                    network = network.max(1);
                    let statement = self.statement(network);
                    block.statements.extend(statement);
                }
            }
        }
        let remedy = format!("Write {end} after the block's last line.");
        self.sink.report_with(self.index, head, &codes::MISSING_END, format!("{end} is missing"), remedy);
    }
}

impl Statement {
    /// A statement without operation, to hold a label.
    pub(crate) fn empty(label: Option<usize>, token: Token, at: usize, network: u16) -> Self {
        Self { label, row: None, span: token.span, operand: at..at, args: Vec::new(), network, line: token.line }
    }
}

impl Type {
    pub(crate) fn bad(span: Span) -> Self {
        Self { kind: TypeKind::Bad, span }
    }
}

/// `"pump"` without its quotes, closed or not; also without a leading `#`.
pub(crate) fn unquote(text: &str) -> &str {
    let text = text.strip_prefix('#').unwrap_or(text);
    let text = text.strip_prefix('"').unwrap_or(text);
    text.strip_suffix('"').unwrap_or(text)
}

/// `MW10` as `MW` and `10`.
pub(crate) fn split_digits(word: &str) -> (&str, &str) {
    let letters = word.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    word.split_at(letters)
}
