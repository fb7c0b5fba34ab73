//! The list of pointers of `UC` and `CC`, as it follows the call in machine code: `UC FC 5 { P#M 1.0, N#15 }`.

use ob1_ir::{Arg, CallMode, Target};

use crate::constant::Constant;
use crate::lexer;
use crate::lower::Lowerer;
use crate::messages;
use crate::reader::Reader;
use crate::syntax::Statement;
use crate::token::{File, Kind, Span, Token};

/// Pointers of one list.
const LONGEST: usize = 256;

impl<'s> Lowerer<'_, 's> {
    /// The list in a call's operand; empty when there is none. `None`: it is wrong (reported).
    pub(crate) fn raw_list(&mut self, statement: &Statement, mode: CallMode, target: Target) -> Option<Vec<Arg>> {
        let tokens = self.file.tokens.get(statement.operand.clone()).unwrap_or_default();
        let Some(list) = tokens.iter().copied().find(|t| t.kind == Kind::Attributes) else { return Some(Vec::new()) };
        if mode == CallMode::Call {
            return Some(Vec::new());
        }
        let with_instance = match target {
            Target::Block(id) | Target::Local(id, _) => id.kind.has_instance(),
            Target::Indirect(kind, _) => kind.has_instance(),
        };
        if with_instance {
            let message = "a function block has its parameters in its instance; a list of pointers is for an FC or SFC";
            self.sink.report(self.index, list.span, &messages::ACTUAL_SYNTAX, message);
            return None;
        }
        let inner = self.inner(list);
        let resolver = self.resolver;
        let count = inner.tokens.len();
        let mut reader = Reader::new(self.index, &inner, self.sink, 0..count, list.span);
        let mut args = Vec::new();
        while !reader.is_empty() {
            let span = reader.here();
            args.push(Arg::Raw(entry(&resolver, &mut reader, span)?));
            if reader.eat(Kind::Comma).is_none() {
                break;
            }
        }
        if !reader.finish(&messages::ACTUAL_SYNTAX) {
            return None;
        }
        if args.len() > LONGEST {
            let message = format!("the list has {} pointers, a block at most {LONGEST} parameters", args.len());
            self.sink.report(self.index, list.span, &messages::ACTUAL_SYNTAX, message);
            return None;
        }
        Some(args)
    }

    /// The tokens between the brackets of a list.
    fn inner(&mut self, list: Token) -> File<'s> {
        let span = Span { start: list.span.start + 1, end: list.span.end.saturating_sub(1) };
        let text = self.file.slice(span);
        let mut tokens = lexer::lex(self.index, text, self.sink);
        for token in &mut tokens {
            token.span = Span { start: token.span.start + span.start, end: token.span.end + span.start };
            token.line += list.line - 1;
        }
        File { text: self.file.text, tokens }
    }
}

/// One entry. `None` when it is not valid (reported).
fn entry(resolver: &crate::operand::Resolver<'_>, reader: &mut Reader<'_, '_>, span: Span) -> Option<u32> {
    let wrong = |reader: &mut Reader<'_, '_>| {
        let message = "the list holds pointers P#M 1.0, P#V 10.0 and numbers N#15, with commas between them";
        reader.report(span, &messages::ACTUAL_SYNTAX, message);
        None
    };
    match reader.peek_kind()? {
        Kind::Word if reader.peek().is_some_and(|t| reader.text(t).eq_ignore_ascii_case("N")) => {
            reader.next();
            let number = reader.eat(Kind::Local).map(|t| reader.text(t)).and_then(|t| t.strip_prefix('#'));
            let number = number.and_then(|n| n.parse::<u16>().ok());
            number.map_or_else(|| wrong(reader), |n| Some(u32::from(n) << 16))
        }
        Kind::PointerSign | Kind::Typed => match resolver.constant(reader)? {
            Constant::Pointer(p) if p.any.is_none() && p.db == 0 => Some(p.bits()),
            Constant::Bits(bits, 32) => Some(bits),
            _ => {
                reader.report(span, &messages::POINTER, "a list holds pointers without data block and length");
                None
            }
        },
        _ => wrong(reader),
    }
}
