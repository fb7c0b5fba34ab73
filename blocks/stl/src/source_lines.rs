//! A source as a person reads it: the lines of each block, and its words in the other set of mnemonics.

use std::ops::RangeInclusive;

use crate::auto;
use crate::diagnostic::Sink;
use crate::identifiers::{IDENTIFIERS, Identifier};
use crate::lexer;
use crate::mnemonics::Mnemonics;
use crate::parser::{self, split_digits};
use crate::token::{File, Kind, Token};
use crate::words::Words;

/// The lines of each block of a source, from its first word to its last; from 1, in the order of the text.
pub fn block_lines(text: &str) -> Vec<RangeInclusive<u32>> {
    let tokens = lexer::lex(0, text, &mut Sink::new());
    let file = File { text, tokens };
    let mut all = Vec::new();
    let mut begun: Option<u32> = None;
    let mut at_start = true;
    for token in &file.tokens {
        let word = if token.kind == Kind::Word { file.of(*token) } else { "" };
        match begun {
            None if at_start && parser::begins_block(word) => begun = Some(token.line),
            Some(first) if at_start && parser::ends_block(word) => {
                all.push(first..=token.line);
                begun = None;
            }
            _ => {}
        }
        at_start = matches!(token.kind, Kind::Newline | Kind::Semicolon);
    }
    if let Some(first) = begun {
        all.push(first..=file.tokens.last().map_or(first, |token| token.line));
    }
    all
}

/// The set of mnemonics of each of the sources of one program, by their words.
pub fn sets_of(texts: &[&str]) -> Vec<Mnemonics> {
    let files: Vec<File<'_>> =
        texts.iter().map(|text| File { text, tokens: lexer::lex(0, text, &mut Sink::new()) }).collect();
    let words = [Mnemonics::German, Mnemonics::International].map(Words::new);
    auto::decide(&files.iter().map(Some).collect::<Vec<_>>(), [&words[0], &words[1]], &mut Sink::new())
}

/// The set that most of these are.
pub fn most(sets: &[Mnemonics]) -> Mnemonics {
    let international = sets.iter().filter(|set| **set == Mnemonics::International).count();
    if international * 2 > sets.len() { Mnemonics::International } else { Mnemonics::German }
}

/// A source in another set of mnemonics: comments, names and columns stay. `from` is its own set.
pub fn in_other_set(text: &str, from: Mnemonics, to: Mnemonics) -> String {
    if from == to || from == Mnemonics::Auto || to == Mnemonics::Auto {
        return text.to_owned();
    }
    let file = File { text, tokens: lexer::lex(0, text, &mut Sink::new()) };
    let mut out = String::with_capacity(text.len());
    let mut copied = 0;
    for (at, replacement) in (Exchange { file: &file, words: Words::new(from), to }).all() {
        out.push_str(text.get(copied..at.start as usize).unwrap_or_default());
        out.push_str(&replacement);
        copied = at.end as usize;
    }
    out.push_str(text.get(copied..).unwrap_or_default());
    out
}

struct Exchange<'f> {
    file: &'f File<'f>,
    words: Words,
    to: Mnemonics,
}

impl Exchange<'_> {
    /// The words to be exchanged, in the order of the text.
    fn all(&self) -> Vec<(crate::token::Span, String)> {
        let mut all = Vec::new();
        let mut in_code = false;
        let kind = |at: usize| self.file.tokens.get(at).map(|token| token.kind);
        let mut at = 0;
        while let Some(token) = self.file.tokens.get(at).copied() {
            let starts = at == 0 || matches!(kind(at - 1), Some(Kind::Newline | Kind::Semicolon));
            let word = if token.kind == Kind::Word { self.file.of(token) } else { "" };
            if starts && ["BEGIN", "NETWORK"].iter().any(|begin| word.eq_ignore_ascii_case(begin)) {
                in_code = true;
            } else if starts && parser::ends_block(word) {
                in_code = false;
            }
            // A label stands in front of its statement.
            if starts && in_code && token.kind == Kind::Word && kind(at + 1) == Some(Kind::Colon) {
                at += 2;
                while kind(at) == Some(Kind::Newline) {
                    at += 1;
                }
                self.statement(at, &mut all);
            } else if starts && in_code {
                self.statement(at, &mut all);
            } else if in_code
                && matches!(kind(at.wrapping_sub(1)), Some(Kind::Assign | Kind::LeftBracket | Kind::PointerSign))
            {
                self.operand(at, true, &mut all);
            }
            at += 1;
        }
        all
    }

    fn statement(&self, at: usize, all: &mut Vec<(crate::token::Span, String)>) {
        let token = |at: usize| self.file.tokens.get(at).copied();
        let Some(first) = token(at).filter(|t| matches!(t.kind, Kind::Word | Kind::Operator)) else { return };
        let next = token(at + 1);
        // A supplied parameter or a start value, not a statement.
        let named = |kind| matches!(kind, Kind::Assign | Kind::Comma | Kind::Dot | Kind::Attributes);
        if next.is_some_and(|t| named(t.kind)) {
            return;
        }
        let word = self.file.of(first);
        let opens = next.is_some_and(|t| t.kind == Kind::LeftParen);
        let row = if opens { self.words.mnemonic_of(word, "(") } else { self.words.mnemonic(word) };
        let Some(row) = row.or_else(|| self.words.mnemonic(word)) else { return };
        let other = row.word(self.to).trim_end_matches('(');
        if first.kind == Kind::Word && !other.eq_ignore_ascii_case(word) {
            all.push((first.span, like(word, other)));
        }
        self.operand(at + 1, false, all);
    }

    /// `supplied`: behind `:=`, `[` or `P#`, where a name of the program may stand as well.
    fn operand(&self, at: usize, supplied: bool, all: &mut Vec<(crate::token::Span, String)>) {
        let Some(token) = self.file.tokens.get(at).copied().filter(|t| t.kind == Kind::Word) else { return };
        let word = self.file.of(token);
        let (letters, digits) = split_digits(word);
        let addressed = !digits.is_empty() || self.is_addressed(at + 1);
        let row = IDENTIFIERS.iter().find(|(german, international, _)| {
            let own = if self.to == Mnemonics::International { german } else { international };
            own.eq_ignore_ascii_case(letters)
        });
        let Some((german, international, identifier)) = row else { return };
        let is_one = addressed || !supplied && matches!(identifier, Identifier::Status(_));
        let other = if self.to == Mnemonics::International { international } else { german };
        if is_one && !other.eq_ignore_ascii_case(letters) {
            all.push((token.span, format!("{}{digits}", like(letters, other))));
        }
    }

    fn is_addressed(&self, at: usize) -> bool {
        self.file.tokens.get(at).is_some_and(|t: &Token| matches!(t.kind, Kind::Number | Kind::LeftBracket))
    }
}

/// A word in small letters where the one it replaces is.
fn like(old: &str, new: &str) -> String {
    let small = old.chars().any(char::is_lowercase) && !old.chars().any(char::is_uppercase);
    if small { new.to_lowercase() } else { new.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Library, Options, Source, compile};

    const GERMAN: &str = "FUNCTION FC 1 : VOID\nTITLE = U E 0.0 of the A side\nVAR_INPUT\n E1 : BOOL; // U\nEND_VAR\nVAR_TEMP\n A : INT;\n\
        END_VAR\nBEGIN\nNETWORK\nTITLE = U(\n      U(;\n u     e 1.0; // SPB U E 1.0\n      O     #E1;\n      );\n\
        m1:   =     A 4.0;\n      SPBNB m1;\nL PEW 256;\nT     AW[MD 4];\nL Z 3;\nSE T 5;\nU BIE;\nLAR1 P#E 1.0;\n\
        T #A;\nCALL SFC 20 (SRCBLK := P#E 0.0 BYTE 2, RET_VAL := AW 6, DSTBLK := P#M 1.0 BYTE 2);\nEND_FUNCTION\n\nFUNCTION FC 2 : VOID\nBEGIN\nEND_FUNCTION\n";

    #[test]
    fn a_source_in_the_other_set_means_the_same() {
        let english = in_other_set(GERMAN, Mnemonics::German, Mnemonics::International);
        for part in [
            " a     i 1.0; // SPB U E 1.0",
            "TITLE = U(\n      A(;",
            "JNB m1",
            "QW[MD 4]",
            "L C 3",
            "SD T 5",
            "A BR",
            "P#I 1.0",
            "T #A",
            "RET_VAL := QW 6",
            " A : INT",
            "of the A side",
        ] {
            assert!(english.contains(part), "{part}\n{english}");
        }
        assert_eq!(in_other_set(&english, Mnemonics::International, Mnemonics::German), GERMAN);
        let program = |text: &str, mnemonics| {
            let options = Options { mnemonics, ..Options::default() };
            compile(&[Source::new("x", text)], &Library::new(), &options).program
        };
        let (one, other) = (program(GERMAN, Mnemonics::German), program(&english, Mnemonics::International));
        assert!(one.blocks[0].code.len() > 12);
        assert_eq!(one, other);
    }

    #[test]
    fn blocks_are_from_their_first_line_to_their_last() {
        let last = GERMAN.lines().count() as u32;
        assert_eq!(block_lines(GERMAN), [1..=last - 4, last - 2..=last]);
        assert_eq!(block_lines("x\nFUNCTION FC 1 : VOID\nBEGIN\nU M 1.0"), [2..=4]);
        assert!(block_lines("U FUNCTION FC 1").is_empty());
    }
}
