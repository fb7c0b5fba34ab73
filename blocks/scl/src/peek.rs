//! PEEK and POKE of TIA Portal: memory by area, data block and byte as numbers.

use ob1_model::{Area, BitAddr};
use ob1_stl::front::Span;

use crate::address::add_index;
use crate::check::Checker;
use crate::convert::explicit;
use crate::messages;
use crate::syntax::Arg;
use crate::tree::{Base, Check, Kind, Side, Typed, Var};
use crate::types::{BLOCK_DB, BOOL, BYTE, DINT, DWORD, WORD, is_bits, is_whole};

impl<'c> Checker<'c> {
    /// `PEEK(area, dbNumber, byteOffset)`, `PEEK_WORD`, `PEEK_DWORD`, `PEEK_BOOL` with `bitOffset`. The outer `None`:
    /// another name.
    pub(crate) fn peek(&mut self, name: &str, args: &[Arg], span: Span) -> Option<Option<Typed<'c>>> {
        let ty = match name {
            "PEEK" | "PEEK_BYTE" => &BYTE,
            "PEEK_WORD" => &WORD,
            "PEEK_DWORD" => &DWORD,
            "PEEK_BOOL" => {
                let [area, db, byte, bit] =
                    self.values(name, ["area", "dbNumber", "byteOffset", "bitOffset"], args, span)?;
                let var = self.memory(&area, db, byte, Some(bit));
                return Some(var.map(|var| Typed::new(Kind::Var(var), &BOOL, span)));
            }
            _ => return None,
        };
        let [area, db, byte] = self.values(name, ["area", "dbNumber", "byteOffset"], args, span)?;
        Some(self.memory(&area, db, byte, None).map(|var| Typed::new(Kind::Var(var), ty, span)))
    }

    /// `POKE(area, dbNumber, byteOffset, value)`, `POKE_BOOL` with `bitOffset`: where it writes, and what. The outer
    /// `None`: another name.
    pub(crate) fn poke(&mut self, name: &str, args: &[Arg], span: Span) -> Option<Option<(Var<'c>, Typed<'c>)>> {
        let (place, value) = if name.eq_ignore_ascii_case("POKE_BOOL") {
            let names = ["area", "dbNumber", "byteOffset", "bitOffset", "value"];
            let [area, db, byte, bit, value] = self.values("POKE_BOOL", names, args, span)?;
            let value = if value.is_bad() { None } else { self.coerced(value, &BOOL) };
            (self.memory(&area, db, byte, Some(bit)), value)
        } else if name.eq_ignore_ascii_case("POKE") {
            let names = ["area", "dbNumber", "byteOffset", "value"];
            let [area, db, byte, value] = self.values("POKE", names, args, span)?;
            let value = match &value.kind {
                Kind::Bad => None,
                Kind::Flexible(_) => self.coerced(value, &BYTE),
                _ if is_bits(value.ty) => Some(value),
                _ => self.wrong("POKE", &value, "a BYTE, WORD or DWORD"),
            };
            (self.memory(&area, db, byte, None), value)
        } else {
            return None;
        };
        Some(place.zip(value))
    }

    fn memory(&mut self, area: &Typed<'c>, db: Typed<'c>, byte: Typed<'c>, bit: Option<Typed<'c>>) -> Option<Var<'c>> {
        let known = match &area.kind {
            Kind::Flexible(constant) => Self::whole(constant),
            _ => None,
        };
        let base = match known {
            Some(0x1) => Base::Fixed(Area::Peripheral),
            Some(0x81) => Base::Fixed(Area::Input),
            Some(0x82) => Base::Fixed(Area::Output),
            Some(0x83) => Base::Fixed(Area::Memory),
            Some(0x84) => self.numbered_block(db)?,
            _ => {
                let message =
                    "the area is a constant: 16#81 inputs, 16#82 outputs, 16#83 bit memory, 16#84 a data block";
                self.report(area.span, &messages::FUNCTION_ARGUMENTS, message);
                return None;
            }
        };
        let mut var = Var { base, at: BitAddr(0), terms: Vec::new(), declared: None, side: Side::Both };
        let byte = self.whole_number(byte)?;
        add_index(&mut var, byte, (0, i32::from(u16::MAX)), 8);
        if let Some(bit) = bit {
            let bit = self.whole_number(bit)?;
            add_index(&mut var, bit, (0, 7), 1);
        }
        Some(var)
    }

    fn numbered_block(&mut self, db: Typed<'c>) -> Option<Base<'c>> {
        let number = match &db.kind {
            Kind::Bad => return None,
            Kind::Flexible(constant) => match Self::whole(constant).and_then(|n| u16::try_from(n).ok()) {
                Some(number @ 1..) => return Some(Base::Db(number)),
                _ => {
                    let message = "the number of a data block is 1 to 65535";
                    self.report(db.span, &messages::FUNCTION_ARGUMENTS, message);
                    return None;
                }
            },
            _ if is_bits(db.ty) => self.coerced(db, &WORD)?,
            _ if is_whole(db.ty) => explicit(db, &WORD)?,
            _ => {
                let _ = self.wrong("dbNumber", &db, "a whole number");
                return None;
            }
        };
        let span = number.span;
        let kind = Kind::Convert(Vec::new(), Check::Never, Box::new(number));
        Some(Base::DbAt(Box::new(Typed::new(kind, &BLOCK_DB, span))))
    }

    /// A number as a DINT.
    pub(crate) fn whole_number(&mut self, value: Typed<'c>) -> Option<Typed<'c>> {
        match value.kind {
            Kind::Bad => None,
            Kind::Flexible(_) => self.coerced(value, &DINT),
            _ if is_bits(value.ty) => explicit(value, &DINT),
            _ => self.coerced(value, &DINT),
        }
    }
}
