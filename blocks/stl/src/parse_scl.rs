//! What SCL declares besides: CONST and LABEL.

use std::rc::Rc;

use crate::messages;
use crate::parser::{FRAMES, Parser, begins_block, is_section, unquote};
use crate::syntax::{Block, Declaration, Type};
use crate::token::Kind;

/// What is done with statements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Bodies {
    Stl,
    Scl,
    /// They are of a language that is not compiled.
    LeftOut,
}

impl Parser<'_, '_> {
    /// `CONST name := value; END_CONST`. Siemens' compiler takes BEGIN for its end, too.
    pub(crate) fn constants(&mut self, block: &mut Block) {
        self.bump();
        loop {
            self.skip_newlines();
            let Some(token) = self.peek() else { return };
            match self.keyword().as_deref() {
                Some("END_CONST") => return self.bump(),
                Some(word) if word == "BEGIN" || word == "CONST" || is_section(word) || word.starts_with("END_") => {
                    return;
                }
                _ => {}
            }
            if self.eat(Kind::Semicolon) {
                continue;
            }
            let named = matches!(token.kind, Kind::Word | Kind::Local | Kind::Symbol);
            if named {
                self.bump();
            }
            if !named || !self.eat(Kind::Assign) {
                self.report(token.span, &messages::DECLARATION, "a constant is written name := value;");
                self.skip_statement();
                continue;
            }
            let from = self.at;
            while !matches!(self.peek_kind(), None | Some(Kind::Semicolon)) && !self.ends_constants() {
                self.bump();
            }
            let ty = Rc::new(Type::bad(token.span));
            let name = unquote(self.text(token)).to_owned();
            let initial = Some(from..self.at);
            block.constants.push(Declaration { name, span: token.span, ty, over: None, initial });
        }
    }

    fn ends_constants(&self) -> bool {
        self.keyword().is_some_and(|word| &*word == "BEGIN" || word.starts_with("END_"))
    }

    /// `LABEL a, b; END_LABEL`: what is declared there stands before a statement anyway.
    pub(crate) fn labels(&mut self) {
        while self.peek().is_some() && !self.keyword().is_some_and(|w| &*w == "END_LABEL" || &*w == "BEGIN") {
            self.bump();
        }
        if self.keyword().as_deref() == Some("END_LABEL") {
            self.bump();
        }
    }

    /// Skips statements of another language, up to the block's last word.
    pub(crate) fn foreign_body(&mut self, end: &str) {
        while let Some(token) = self.peek() {
            let word = self.text(token);
            let ends = word.eq_ignore_ascii_case(end)
                || word.len() > 6 && FRAMES.iter().any(|f| f.1.eq_ignore_ascii_case(word));
            if token.kind == Kind::Word && (ends || begins_block(word)) && !self.names_component() {
                return;
            }
            self.bump();
        }
    }
}
