//! Constants in operands: signs, byte lists, and what `P#` points to.

use ob1_ir::compose::{ANY_TYPES, any_length};
use ob1_ir::{Number, Operand, Place, Width};
use ob1_model::{Area, BitAddr, DataType};

use crate::address::bit_address;
use crate::constant::{self, Constant, PointerConstant, ToParam};
use crate::fold;
use crate::identifiers::{BlockWord, Identifier};
use crate::messages;
use crate::operand::Resolver;
use crate::parser::{split_digits, unquote};
use crate::reader::Reader;
use crate::token::{Kind, Span};
use crate::value::Value;

impl Resolver<'_> {
    /// A constant of any kind. `None` when there is none (reported).
    pub fn constant(&self, reader: &mut Reader<'_, '_>) -> Option<Constant> {
        match self.constants {
            Some(constants) => fold::sum(self, constants, reader, 0),
            None => self.single_constant(reader),
        }
    }

    /// A constant with its sign.
    pub(crate) fn single_constant(&self, reader: &mut Reader<'_, '_>) -> Option<Constant> {
        let span = reader.here();
        let negative = match reader.peek().filter(|t| t.kind == Kind::Operator).map(|t| reader.text(t)) {
            Some(sign @ ("+" | "-")) => {
                reader.next();
                sign == "-"
            }
            _ => false,
        };
        let token = reader.peek();
        let result = match token.map(|t| (t.kind, reader.text(t))) {
            Some((Kind::Number, text)) => {
                reader.next();
                constant::parse(text, negative)
            }
            Some((Kind::Typed, text)) if !negative => {
                reader.next();
                // `B#`, whose bytes follow in brackets; `W#16#` lacks its digits.
                let is_list = text.split_once('#').is_some_and(|(_, body)| body.is_empty());
                if is_list { self.byte_list(reader) } else { constant::parse(text, false) }
            }
            Some((Kind::Text, text)) if !negative => {
                reader.next();
                constant::text(text).map(Constant::Text)
            }
            Some((Kind::PointerSign, _)) if !negative => {
                reader.next();
                if let Some(name) = reader.eat(Kind::Local) {
                    return self.pointer_to_local(reader, unquote(reader.text(name)), span);
                }
                return self.pointer(reader, span).map(Constant::Pointer);
            }
            Some((Kind::Word, text)) if !negative && text.eq_ignore_ascii_case("TRUE") => {
                reader.next();
                Ok(Constant::Bool(true))
            }
            Some((Kind::Word, text)) if !negative && text.eq_ignore_ascii_case("FALSE") => {
                reader.next();
                Ok(Constant::Bool(false))
            }
            Some((Kind::Bad, _)) => return None,
            _ => Err("a constant is expected here".into()),
        };
        let span = token.map_or(span, |t| span.to(t.span));
        result.map_err(|message| reader.report(span, &messages::CONSTANT, message)).ok()
    }

    /// `(1, 2)` or `(1, 2, 3, 4)` after `B#`.
    fn byte_list(&self, reader: &mut Reader<'_, '_>) -> Result<Constant, String> {
        let wrong = || "bytes are written B#(1, 2) or B#(1, 2, 3, 4), each from 0 to 255".to_owned();
        reader.eat(Kind::LeftParen).ok_or_else(wrong)?;
        let mut value = 0u32;
        let mut count = 0u8;
        loop {
            let number = reader.eat(Kind::Number).and_then(|t| reader.text(t).parse::<u8>().ok()).ok_or_else(wrong)?;
            value = value << 8 | u32::from(number);
            count = count.saturating_add(1);
            if reader.eat(Kind::Comma).is_none() {
                break;
            }
        }
        reader.eat(Kind::RightParen).ok_or_else(wrong)?;
        match count {
            2 => Ok(Constant::Bits(value, 16)),
            4 => Ok(Constant::Bits(value, 32)),
            _ => Err(wrong()),
        }
    }

    /// Reads what follows `P#`.
    fn pointer(&self, reader: &mut Reader<'_, '_>, span: Span) -> Option<PointerConstant> {
        let wrong = |reader: &mut Reader<'_, '_>| {
            reader.report(span, &messages::POINTER, "a pointer is written P#12.0, P#M 3.0 or P#DB10.DBX0.0 BYTE 12");
            None
        };
        let mut db = 0;
        let Some(token) = reader.peek() else { return wrong(reader) };
        match token.kind {
            Kind::Number => {
                reader.next();
                let Some(at) = bit_address(reader.text(token)) else { return wrong(reader) };
                return Some(PointerConstant { area: None, at, db, any: None, own: None });
            }
            Kind::Symbol => {
                reader.next();
                let value = self.symbol(reader, unquote(reader.text(token)), span)?;
                return self.pointer_to_value(reader, &value, span);
            }
            Kind::Word => {}
            _ => return wrong(reader),
        }
        let (mut word, mut digits) = split_digits(reader.text(token));
        reader.next();
        if word.eq_ignore_ascii_case("DB") {
            let number =
                if digits.is_empty() { reader.eat(Kind::Number).map_or("", |t| reader.text(t)) } else { digits };
            db = number.parse().unwrap_or(0);
            if db == 0 || reader.eat(Kind::Dot).is_none() {
                return wrong(reader);
            }
            let absolute = reader.peek().filter(|t| t.kind == Kind::Word).map(|t| split_digits(reader.text(t)));
            let Some(inner) = absolute.filter(|(word, _)| self.words.identifier(word).is_some()) else {
                let value = self.in_data(reader, BlockWord::Db, db, span)?;
                return self.pointer_to_value(reader, &value, span);
            };
            self.refuse_optimized(reader, db, span)?;
            reader.next();
            (word, digits) = inner;
        }
        let area = match self.words.identifier(word) {
            Some(Identifier::Memory(area, Width::Bit)) => area,
            _ if word.eq_ignore_ascii_case("P") => Area::Peripheral,
            _ if word.eq_ignore_ascii_case("V") => Area::PreviousLocal,
            _ => return wrong(reader),
        };
        let Some(at) = self.bit_part(reader, digits) else { return wrong(reader) };
        let any = self.any_length(reader, span)?;
        Some(PointerConstant { area: Some(area), at, db, any, own: None })
    }

    /// `P#"Data".x[2].y`, `P#DB1.STR1`: the address of a component, with its length for an ANY.
    fn pointer_to_value(&self, reader: &mut Reader<'_, '_>, value: &Value<'_>, span: Span) -> Option<PointerConstant> {
        let Value::Memory { operand, ty } = *value else {
            reader.report(
                span,
                &messages::POINTER,
                format!("P# takes the address of a component, this is {}", value.describe()),
            );
            return None;
        };
        let (area, at, db) = match operand.place {
            Place::Fixed(area, at) => (area, at, 0),
            Place::InDb(db, at) => (Area::Db, at, db),
            _ => {
                reader.report(span, &messages::POINTER, "the address of this is known only at run time");
                return None;
            }
        };
        if db > 0 {
            self.refuse_optimized(reader, db, span)?;
        }
        let any = self.any_length(reader, span)?;
        let own = any_length(operand, ty);
        Some(PointerConstant { area: Some(area), at, db, any, own: Some(own) })
    }

    /// `BYTE 12` after a pointer; `Some(None)` when nothing follows.
    #[expect(clippy::option_option, reason = "reported, absent, present")]
    fn any_length(&self, reader: &mut Reader<'_, '_>, span: Span) -> Option<Option<(u8, u16)>> {
        let Some(word) = reader.peek().filter(|t| t.kind == Kind::Word) else { return Some(None) };
        let text = reader.text(word);
        let code = ANY_TYPES.iter().find(|(name, _)| name.eq_ignore_ascii_case(text)).map(|(_, code)| *code);
        reader.next();
        let count = reader.eat(Kind::Number).and_then(|t| reader.text(t).parse::<u16>().ok());
        match (code, count) {
            (Some(code), Some(count)) => Some(Some((code, count))),
            _ => {
                reader.report(span, &messages::POINTER, "the length of an ANY is written BYTE 12");
                None
            }
        }
    }

    /// True when `ty` is that of the whole parameter, not of its first component.
    fn is_whole(&self, index: u16, ty: &DataType) -> bool {
        let formal = self.block.and_then(|(_, info)| info.interface.formals().nth(usize::from(index)));
        formal.is_some_and(|f| std::ptr::eq(&raw const f.ty, ty))
    }

    /// `P##name`: a pointer to a variable of this block.
    fn pointer_to_local(&self, reader: &mut Reader<'_, '_>, name: &str, span: Span) -> Option<Constant> {
        let value = self.local(reader, name, span)?;
        let (area, at) = match value {
            Value::Memory { operand: Operand { place: Place::Fixed(area, at), .. }, .. } => (area, at),
            Value::Memory { operand: Operand { place: Place::Instance(at), .. }, .. } | Value::Instance(_, at) => {
                (Area::Di, at)
            }
            // The instance has a POINTER in its place; that is what P## of it points to.
            Value::Through { pointer, whole: true, .. } => (Area::Di, pointer),
            Value::Memory { operand: Operand { place: Place::Param { index, at: BitAddr(0) }, .. }, ty: Some(ty) }
                if self.is_whole(index, ty) =>
            {
                let kind = match ty {
                    DataType::Any => ToParam::Copy(10),
                    DataType::Pointer => ToParam::Copy(6),
                    ty if ty.is_composed() => ToParam::Pointer,
                    _ => ToParam::Actual,
                };
                return Some(Constant::ToParam { index, kind });
            }
            Value::Memory { .. } | Value::Through { .. } => {
                let message = "the address of this is known only at run time; P## takes whole parameters, temps and instance data";
                reader.report(span, &messages::NOT_SUPPORTED, message);
                return None;
            }
            // The number lies in the instance.
            Value::Timer(Number::Instance(at))
            | Value::Counter(Number::Instance(at))
            | Value::Block(_, Number::Instance(at)) => (Area::Di, at),
            Value::Timer(_) | Value::Counter(_) | Value::Block(..) => {
                let message = "a TIMER, COUNTER or BLOCK parameter of a function is a number and has no address";
                reader.report(span, &messages::NOT_SUPPORTED, message);
                return None;
            }
            _ => {
                reader.report(span, &messages::POINTER, "P## takes a variable");
                return None;
            }
        };
        Some(Constant::Pointer(PointerConstant { area: Some(area), at, db: 0, any: None, own: None }))
    }
}
