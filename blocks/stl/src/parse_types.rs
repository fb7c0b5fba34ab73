//! Declarations and types.

use std::rc::Rc;

use ob1_model::DataType;

use crate::identifiers::BlockWord;
use crate::messages;
use crate::parser::{Bodies, Parser, is_frame_or_section, unquote};
use crate::syntax::{Bound, Declaration, NameRef, Type, TypeKind};
use crate::tia;
use crate::token::{Kind, Span, Token};

/// Structures and arrays within each other.
pub(crate) const TYPE_DEPTH: u32 = 16;

/// Dimensions of an array.
const DIMENSIONS: usize = 6;

/// The types that are one word, by all their words.
pub fn simple_types() -> impl Iterator<Item = (&'static str, &'static DataType)> {
    DataType::WORDS.iter().flat_map(|ty| {
        let short = match ty {
            DataType::TimeOfDay => Some("TOD"),
            DataType::DateAndTime => Some("DT"),
            _ => None,
        };
        [ty.name()].into_iter().chain(short).map(move |name| (name, ty))
    })
}

/// The words that are types.
pub(crate) fn type_words() -> impl Iterator<Item = &'static str> {
    simple_types().map(|(name, _)| name).chain(["STRING", "ARRAY", "STRUCT", "UDT", "FB"])
}

/// The type of one word, whatever its case.
pub(crate) fn simple_type(word: &str) -> Option<DataType> {
    simple_types().find(|(name, _)| name.eq_ignore_ascii_case(word)).map(|(_, ty)| ty.clone())
}

impl Parser<'_, '_> {
    /// Declarations up to and with `end` (END_VAR, END_STRUCT).
    pub(crate) fn declarations(&mut self, end: &str, head: Span, depth: u32) -> Vec<Declaration> {
        let mut out = Vec::new();
        loop {
            self.skip_newlines();
            if self.eat(Kind::Semicolon) {
                continue;
            }
            let Some(token) = self.peek() else { break };
            match self.keyword() {
                Some(word) if &*word == end => {
                    self.bump();
                    return out;
                }
                Some(word) if ends_declarations(&word) && !self.names_declaration() => break,
                _ => {}
            }
            if matches!(token.kind, Kind::Word | Kind::Symbol | Kind::Local) {
                self.declaration(depth, &mut out);
            } else {
                self.report(token.span, &messages::DECLARATION, "a declaration is written name : TYPE;");
                self.skip_statement();
                self.eat(Kind::Semicolon);
            }
        }
        let remedy = format!("Write {end} after the last declaration.");
        self.sink.report_with(self.index, head, &messages::MISSING_END, format!("{end} is missing"), remedy);
        out
    }

    /// True for a word that is declared here, whatever else it means elsewhere.
    fn names_declaration(&self) -> bool {
        self.peek_at(1).is_some_and(|t| matches!(t.kind, Kind::Colon | Kind::Comma | Kind::Attributes))
    }

    /// `a, b : TYPE := value;`
    fn declaration(&mut self, depth: u32, out: &mut Vec<Declaration>) {
        let mut names = Vec::new();
        let mut over = None;
        let is_name = |t: &Token| matches!(t.kind, Kind::Word | Kind::Symbol | Kind::Local);
        while let Some(token) = self.peek().filter(is_name) {
            names.push((unquote(self.text(token)).to_owned(), token.span));
            self.bump();
            if self.peek_kind() == Some(Kind::Attributes) {
                self.bump();
            }
            over = self.overlaid();
            if over.is_some() || !self.eat(Kind::Comma) {
                break;
            }
            self.skip_newlines();
        }
        if !self.eat(Kind::Colon) {
            let span = self.here();
            self.report(span, &messages::DECLARATION, "a colon and the type are missing after the name");
            self.skip_statement();
            self.eat(Kind::Semicolon);
            return;
        }
        let ty = Rc::new(self.ty(depth));
        let bad = matches!(ty.kind, TypeKind::Bad);
        let initial = self.initial();
        for (name, span) in names {
            out.push(Declaration { name, span, ty: Rc::clone(&ty), over: over.clone(), initial: initial.clone() });
        }
        self.end_of_declaration(bad);
    }

    /// `AT x` after a name.
    fn overlaid(&mut self) -> Option<String> {
        let at = self.peek().filter(|t| t.kind == Kind::Word && self.text(*t).eq_ignore_ascii_case("AT"));
        let over = self.peek_at(1).filter(|t| matches!(t.kind, Kind::Word | Kind::Symbol | Kind::Local));
        let over = at.and(over)?;
        self.bump();
        self.bump();
        Some(unquote(self.text(over)).to_owned())
    }

    fn initial(&mut self) -> Option<std::ops::Range<usize>> {
        let before = self.at;
        self.skip_newlines();
        if !self.eat(Kind::Assign) {
            self.at = before;
            return None;
        }
        let from = self.at;
        while let Some(token) = self.peek() {
            match token.kind {
                Kind::Semicolon => break,
                Kind::Newline if self.next_line_declares() => break,
                _ => self.bump(),
            }
        }
        Some(from..self.at)
    }

    /// At the end of a line: true when the next one begins a declaration or ends the section.
    fn next_line_declares(&self) -> bool {
        let mut ahead = 1;
        while self.peek_at(ahead).is_some_and(|t| t.kind == Kind::Newline) && ahead < 8 {
            ahead += 1;
        }
        let Some(next) = self.peek_at(ahead) else { return true };
        let colon = self.peek_at(ahead + 1).is_some_and(|t| t.kind == Kind::Colon);
        next.kind == Kind::Word && (colon || ends_declarations(&self.text(next).to_ascii_uppercase()))
    }

    fn end_of_declaration(&mut self, bad: bool) {
        let structure = self.at > 0
            && self.file.tokens.get(self.at - 1).is_some_and(|t| self.text(*t).eq_ignore_ascii_case("END_STRUCT"));
        let before = self.at;
        self.skip_newlines();
        if self.eat(Kind::Semicolon) {
            return;
        }
        self.at = before;
        if bad {
            self.skip_statement();
        } else if self.peek_kind() == Some(Kind::Newline) || self.peek().is_none() {
            if !structure {
                let span = self.here();
                self.report(span, &messages::MISSING_SEMICOLON, "a semicolon is missing after the declaration");
            }
        } else if self.keyword().is_some_and(|word| ends_declarations(&word)) {
            // What ends the section is left to it. On a new line it has ended a structure, too, which is reported.
            let on_new_line = self.at > 0 && self.file.tokens.get(self.at - 1).is_some_and(|t| t.kind == Kind::Newline);
            if !on_new_line {
                let span = self.here();
                self.report(span, &messages::MISSING_SEMICOLON, "a semicolon is missing after the declaration");
            }
        } else {
            let span = self.here();
            self.report(span, &messages::DECLARATION, "the declaration should end here");
            self.skip_statement();
        }
    }

    /// A type; on a mistake `TypeKind::Bad`, reported.
    pub(crate) fn ty(&mut self, depth: u32) -> Type {
        let before = self.at;
        self.skip_newlines();
        let span = self.here();
        if depth >= TYPE_DEPTH {
            self.report(span, &messages::TYPE_DEPTH, format!("types are nested more than {TYPE_DEPTH} deep"));
            self.skip_nested();
            return Type::bad(span);
        }
        let Some(token) = self.peek() else { return Type::bad(span) };
        if token.kind == Kind::Symbol {
            return match self.block_name() {
                Some(name) => Type { kind: TypeKind::Named(name), span },
                None => Type::bad(span),
            };
        }
        let Some(word) = self.keyword() else {
            self.report(span, &messages::UNKNOWN_TYPE, "a type is expected here");
            return Type::bad(span);
        };
        let kind = match &*word {
            "ARRAY" => self.array(depth),
            "STRUCT" => {
                self.bump();
                TypeKind::Struct(self.declarations("END_STRUCT", span, depth + 1))
            }
            "STRING" => self.string(),
            _ if ends_declarations(&word) => {
                self.report(span, &messages::UNKNOWN_TYPE, "a type is expected here");
                self.at = before;
                TypeKind::Bad
            }
            _ => self.simple_or_named(&word, span),
        };
        Type { kind, span }
    }

    fn simple_or_named(&mut self, word: &str, span: Span) -> TypeKind {
        if let Some((_, ty)) = simple_types().find(|(name, _)| *name == word) {
            self.bump();
            return TypeKind::Simple(ty.clone());
        }
        // STL moves it as a byte; statements of SCL would calculate with it as a number without sign.
        if word == "SINT" && self.bodies == Bodies::Scl {
            let message = "SINT has a sign, which statements of bytes do not take into account";
            self.sink.report_with(self.index, span, &messages::TYPE_WITHOUT_STL, message, "Write INT.");
            self.bump();
            return TypeKind::Bad;
        }
        if let Some(ty) = tia::simple(word) {
            self.bump();
            return TypeKind::Simple(ty);
        }
        if let Some(id) = tia::instance(word) {
            self.bump();
            return TypeKind::Named(NameRef::Absolute(BlockWord::Sfb, id.number));
        }
        if tia::without_stl(word) {
            let message = format!("STL has no statement for the type {word} of TIA Portal");
            self.report(span, &messages::TYPE_WITHOUT_STL, message);
            self.bump();
            return TypeKind::Bad;
        }
        let before = self.at;
        if let Some(name) = self.block_name() {
            return TypeKind::Named(name);
        }
        self.at = before;
        let known = type_words();
        let message = format!("{word} is not a data type");
        self.sink.report_unknown(self.index, span, &messages::UNKNOWN_TYPE, message, word, known);
        self.bump();
        TypeKind::Bad
    }

    /// A text type: `STRING` or `STRING[20]`.
    fn string(&mut self) -> TypeKind {
        self.bump();
        if !self.eat(Kind::LeftBracket) {
            return TypeKind::Simple(DataType::String(254));
        }
        let span = self.here();
        let constant = self.bodies == Bodies::Scl && self.peek_kind() != Some(Kind::Number);
        if constant {
            let tokens = self.up_to(&[Kind::RightBracket]);
            self.eat(Kind::RightBracket);
            return TypeKind::Text(tokens);
        }
        let length = self.number().and_then(|n| u8::try_from(n).ok()).filter(|n| (1..=254).contains(n));
        let closed = self.eat(Kind::RightBracket);
        match length.filter(|_| closed) {
            Some(n) => TypeKind::Simple(DataType::String(n)),
            None => {
                self.report(span, &messages::STRING_LENGTH, "a STRING has a length from 1 to 254: STRING[20]");
                TypeKind::Bad
            }
        }
    }

    /// `ARRAY [1 .. 10, 0 .. 3] OF INT`.
    fn array(&mut self, depth: u32) -> TypeKind {
        self.bump();
        let span = self.here();
        let mut dimensions = Vec::new();
        let mut good = self.eat(Kind::LeftBracket);
        if good && self.peek().is_some_and(|token| self.text(token) == "*") {
            let message = "an array whose bounds are known at run time only (Array[*]) is not supported";
            let remedy = "Write the bounds of the array that is supplied: ARRAY [0 .. 9] OF INT.";
            self.sink.report_with(self.index, span, &messages::TYPE_WITHOUT_STL, message, remedy);
            return TypeKind::Bad;
        }
        while good {
            let low = self.bound();
            good = self.eat(Kind::DotDot);
            let high = self.bound();
            match (low, high) {
                (Some(Bound::Number(low)), Some(Bound::Number(high))) if low > high => good = false,
                (Some(low), Some(high)) if good => dimensions.push((low, high)),
                _ => good = false,
            }
            if !self.eat(Kind::Comma) {
                break;
            }
        }
        good &= self.eat(Kind::RightBracket) && dimensions.len() <= DIMENSIONS;
        self.skip_newlines();
        good &= self.keyword().as_deref() == Some("OF");
        if !good {
            let message =
                "an array is written ARRAY [low .. high, ...] OF TYPE, bounds from -32768 to 32767, low first";
            self.report(span, &messages::ARRAY_BOUNDS, message);
            return TypeKind::Bad;
        }
        self.bump();
        let element = self.ty(depth + 1);
        if matches!(element.kind, TypeKind::Bad) {
            TypeKind::Bad
        } else {
            TypeKind::Array(dimensions, Box::new(element))
        }
    }

    /// Tokens up to one of these kinds, or to the end of the line.
    fn up_to(&mut self, ends: &[Kind]) -> std::ops::Range<usize> {
        let from = self.at;
        while self
            .peek()
            .is_some_and(|t| t.kind != Kind::Newline && t.kind != Kind::Semicolon && !ends.contains(&t.kind))
        {
            self.bump();
        }
        from..self.at
    }

    /// A bound of an array: a number, or the name of a constant.
    fn bound(&mut self) -> Option<Bound> {
        if self.bodies == Bodies::Scl {
            let before = self.at;
            if let Some(number) = self.number().filter(|_| self.ends_bound()) {
                return Some(Bound::Number(number));
            }
            self.at = before;
            let tokens = self.up_to(&[Kind::DotDot, Kind::Comma, Kind::RightBracket]);
            return (!tokens.is_empty()).then_some(Bound::Value(tokens));
        }
        if let Some(name) = self.peek().filter(|t| matches!(t.kind, Kind::Symbol | Kind::Local | Kind::Word)) {
            self.bump();
            return Some(Bound::Named(unquote(self.text(name)).to_owned()));
        }
        self.number().map(Bound::Number)
    }

    fn ends_bound(&self) -> bool {
        matches!(self.peek_kind(), Some(Kind::DotDot | Kind::Comma | Kind::RightBracket))
    }

    fn number(&mut self) -> Option<i32> {
        let mut negative = false;
        if let Some(sign) = self.peek().filter(|t| t.kind == Kind::Operator) {
            negative = self.text(sign) == "-";
            self.bump();
        }
        let token = self.peek().filter(|t| t.kind == Kind::Number)?;
        self.bump();
        let value: i32 = self.text(token).parse().ok().filter(|v| *v <= 32_768)?;
        let value = if negative { -value } else { value };
        (value <= 32_767).then_some(value)
    }

    /// Skips a structure too deep to be parsed, by counting.
    fn skip_nested(&mut self) {
        let mut depth = 0u32;
        while self.peek().is_some() {
            match self.keyword().as_deref() {
                Some("STRUCT") => depth += 1,
                Some("END_STRUCT") => depth = depth.saturating_sub(1),
                Some(word) if ends_declarations(word) => return,
                _ => {}
            }
            if depth == 0 && matches!(self.peek_kind(), Some(Kind::Newline | Kind::Semicolon)) {
                return;
            }
            self.bump();
        }
    }
}

/// Words that end a list of declarations though its own end is missing.
fn ends_declarations(word: &str) -> bool {
    word.starts_with("END_") || matches!(word, "BEGIN" | "NETWORK" | "CONST") || is_frame_or_section(word)
}
