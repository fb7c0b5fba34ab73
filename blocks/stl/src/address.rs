//! Addresses in operands: fixed, memory-indirect, register-indirect; numbers of timers, counters and blocks.

use ob1_ir::{Number, Operand, Place, Pointer, Width};
use ob1_model::{Area, BitAddr};

use crate::messages;
use crate::operand::Resolver;
use crate::reader::Reader;
use crate::token::{Kind, Span};
use crate::value::Value;

impl Resolver<'_> {
    /// The address after an identifier: fixed, memory-indirect or register-indirect.
    pub(crate) fn place(
        &self,
        reader: &mut Reader<'_, '_>,
        area: Area,
        width: Width,
        digits: &str,
        span: Span,
    ) -> Option<Place> {
        if digits.is_empty() && reader.peek_kind() == Some(Kind::LeftBracket) {
            return self.bracket(reader, Some(area));
        }
        self.fixed(reader, width, digits, span).map(|at| Place::Fixed(area, at))
    }

    /// A fixed address with the bit part that its width asks for.
    pub(crate) fn fixed(&self, reader: &mut Reader<'_, '_>, width: Width, digits: &str, span: Span) -> Option<BitAddr> {
        let first = reader.here();
        let at = if width == Width::Bit {
            self.bit_part(reader, digits)
        } else {
            let text = if digits.is_empty() { reader.eat(Kind::Number).map_or("", |t| reader.text(t)) } else { digits };
            text.parse::<u32>().ok().filter(|b| b + width.bytes() <= BitAddr::MAX_BYTE + 1).map(BitAddr::byte_addr)
        };
        if at.is_none() {
            let message = if width == Width::Bit {
                "the address of a bit is written byte.bit: byte 0 to 65535, bit 0 to 7"
            } else {
                "the address is a byte number from 0 to 65535"
            };
            let span = span.to(first).to(reader.here());
            let text = reader.slice(span);
            match letter_for_digit(text).or_else(|| ninth_bit(text)) {
                Some(remedy) => reader.sink.report_with(reader.index, span, &messages::ADDRESS, message, remedy),
                None => reader.report(span, &messages::ADDRESS, message),
            }
        }
        at
    }

    /// `12.0` after a bit identifier, in the spellings `M 12.0`, `M12.0`.
    pub(crate) fn bit_part(&self, reader: &mut Reader<'_, '_>, digits: &str) -> Option<BitAddr> {
        if digits.is_empty() {
            let number = reader.eat(Kind::Number)?;
            return bit_address(reader.text(number));
        }
        reader.eat(Kind::Dot)?;
        let bit = reader.eat(Kind::Number)?;
        bit_address(&format!("{digits}.{}", reader.text(bit)))
    }

    /// An indirect address in brackets: `[MD 184]`, `[AR1,P#2.0]`.
    pub(crate) fn bracket(&self, reader: &mut Reader<'_, '_>, area: Option<Area>) -> Option<Place> {
        let span = reader.here();
        reader.eat(Kind::LeftBracket)?;
        let place = match self.inner(reader, span)? {
            Value::Register(register) => {
                let pointer = reader.eat(Kind::Comma).and_then(|_| reader.eat(Kind::PointerSign));
                let offset = pointer.and_then(|_| reader.eat(Kind::Number)).and_then(|t| bit_address(reader.text(t)));
                let Some(offset) = offset else {
                    reader.report(span, &messages::INDIRECT, "register-indirect is written [AR1,P#2.0]");
                    return None;
                };
                Place::Register(area, register, offset)
            }
            Value::Memory { operand, .. } => {
                let pointer = self.pointer_place(operand, Width::DWord);
                match (area, pointer) {
                    (Some(area), Some(pointer)) => Place::Memory(area, pointer),
                    _ => {
                        let message = "memory-indirect takes a fixed double word of M, L, DB or DI: DBW [MD 184]";
                        reader.report(span, &messages::INDIRECT, message);
                        return None;
                    }
                }
            }
            other => {
                reader.report(span, &messages::INDIRECT, format!("{} cannot hold an address", other.describe()));
                return None;
            }
        };
        self.close(reader, span)?;
        Some(place)
    }

    pub(crate) fn close(&self, reader: &mut Reader<'_, '_>, span: Span) -> Option<()> {
        if reader.eat(Kind::RightBracket).is_none() {
            reader.report(span, &messages::INDIRECT, "the address is not closed with ]");
            return None;
        }
        Some(())
    }

    /// The number of a timer, counter or block: `5`, `[MW 2]`.
    pub(crate) fn number(&self, reader: &mut Reader<'_, '_>, digits: &str, span: Span) -> Option<Number> {
        if digits.is_empty() && reader.peek_kind() == Some(Kind::LeftBracket) {
            let span = reader.here();
            reader.next();
            let pointer = match self.inner(reader, span)? {
                Value::Memory { operand, .. } => self.pointer_place(operand, Width::Word),
                _ => None,
            };
            let Some(pointer) = pointer else {
                reader.report(
                    span,
                    &messages::INDIRECT,
                    "the number must be in a fixed word of M, L, DB or DI: [MW 50]",
                );
                return None;
            };
            self.close(reader, span)?;
            return Some(Number::Memory(pointer));
        }
        let text = if digits.is_empty() { reader.eat(Kind::Number).map_or("", |t| reader.text(t)) } else { digits };
        let number = text.parse().ok();
        if number.is_none() {
            let span = span.to(reader.here());
            reader.report(span, &messages::NUMBER, "a number from 0 to 65535 is expected here");
        }
        number.map(Number::Fixed)
    }

    /// The place of a pointer, when the operand can hold one. A variable of an instance has a fixed place with
    /// CODE_VERSION1 only; with multi-instances it depends on AR2.
    fn pointer_place(&self, operand: Operand, width: Width) -> Option<Pointer> {
        if operand.width != width {
            return None;
        }
        match operand.place {
            Place::Fixed(area @ (Area::Memory | Area::Local | Area::Db | Area::Di), at) => Some(Pointer { area, at }),
            Place::Instance(at) if self.block.is_some_and(|(_, info)| info.code_version1) => {
                Some(Pointer { area: Area::Di, at })
            }
            _ => None,
        }
    }
}

/// A letter that was typed for a digit, beside digits: the classic of listings typed in.
fn letter_for_digit(text: &str) -> Option<String> {
    let word = text.split([' ', '\t', '.']).skip(1).find(|word| word.contains(|c: char| c.is_ascii_digit()))?;
    let (letter, digit) =
        [('O', '0'), ('o', '0'), ('l', '1'), ('I', '1')].into_iter().find(|(l, _)| word.contains(*l))?;
    Some(format!("{word} has the letter {letter}; the digit is {digit}."))
}

/// `50.8`: whoever counts on in tens.
fn ninth_bit(text: &str) -> Option<String> {
    let number = text.trim_start_matches(|c: char| !c.is_ascii_digit()).trim_end();
    let (byte, bit) = number.split_once('.')?;
    let byte: u32 = byte.parse().ok().filter(|byte| *byte < BitAddr::MAX_BYTE)?;
    matches!(bit, "8" | "9").then(|| format!("A byte has the bits 0 to 7: the one behind {byte}.7 is {}.0.", byte + 1))
}

/// Byte and bit: `12.7`.
pub(crate) fn bit_address(text: &str) -> Option<BitAddr> {
    let (byte, bit) = text.split_once('.')?;
    let byte: u32 = byte.parse().ok().filter(|b| *b <= BitAddr::MAX_BYTE)?;
    let bit: u8 = bit.parse().ok().filter(|b| *b < 8 && bit.len() == 1)?;
    Some(BitAddr::new(byte, bit))
}
