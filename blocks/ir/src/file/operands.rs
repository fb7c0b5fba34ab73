//! Operands and numbers.

use std::sync::LazyLock;

use ob1_model::{Area, BitAddr, BlockId, BlockKind};

use super::cursor::{Cursor, Expected};
use crate::text::{area_text, letter};
use crate::{AddressRegister, Number, Operand, Place, Pointer, Width};

pub(super) const WIDTHS: [Width; 4] = [Width::Bit, Width::Byte, Width::Word, Width::DWord];
const KINDS: [BlockKind; 6] =
    [BlockKind::Ob, BlockKind::Fb, BlockKind::Fc, BlockKind::Sfb, BlockKind::Sfc, BlockKind::Db];
const REGISTERS: [AddressRegister; 2] = [AddressRegister::Ar1, AddressRegister::Ar2];
/// How an operand begins: an area with a width, or only that.
static TYPED: LazyLock<Vec<(String, Option<Area>, Width)>> = LazyLock::new(|| {
    let of_width = |width| {
        let areas = Area::ALL.map(|area| (area_text(area, width) + " ", Some(area), width));
        areas.into_iter().chain([(letter(width).to_owned() + " ", None, width)])
    };
    WIDTHS.into_iter().flat_map(of_width).collect()
});

impl Cursor<'_> {
    /// `12.3`, or `12` for a whole byte.
    pub(super) fn address(&mut self) -> Expected<BitAddr> {
        let byte: u32 = self.number()?;
        let bit: u32 = if self.0.starts_with('.') { self.dot()? } else { 0 };
        let at = byte.checked_mul(8).and_then(|at| at.checked_add(bit)).filter(|_| bit < 8);
        at.map(BitAddr).ok_or("an address")
    }

    fn dot(&mut self) -> Expected<u32> {
        self.0 = &self.0[1..];
        self.number()
    }

    pub(super) fn area(&mut self) -> Expected<Area> {
        self.choice(Area::ALL, Area::name, "an area")
    }

    pub(super) fn kind(&mut self) -> Expected<BlockKind> {
        self.choice(KINDS, BlockKind::name, "a kind of block")
    }

    pub(super) fn block(&mut self) -> Expected<BlockId> {
        Ok(BlockId::new(self.kind()?, self.number()?))
    }

    /// `AR1,P#2.0]` of a register-indirect operand, or `MD 20]` of a memory-indirect one.
    fn pointer(&mut self, size: Width) -> Expected<Pointer> {
        let area = self.area()?;
        self.need(letter(size))?;
        let at = self.address()?;
        self.need("]")?;
        Ok(Pointer { area, at })
    }

    pub(super) fn operand(&mut self) -> Expected<Operand> {
        const WHAT: &str = "an operand";
        if self.eat("PAR") {
            let index = self.number()?;
            let width = self.width()?;
            self.need("+")?;
            return Ok(Operand { width, place: Place::Param { index, at: self.address()? } });
        }
        if self.eat("INST") {
            let width = self.width()?;
            self.need("+")?;
            return Ok(Operand { width, place: Place::Instance(self.address()?) });
        }
        let mut whole = *self;
        for (name, area, global) in [("DB", ".DB", true), ("DI", ".DI", false)] {
            if whole.eat(name)
                && let Ok(number) = whole.number()
                && whole.eat(area)
            {
                let width = whole.width()?;
                let at = whole.address()?;
                *self = whole;
                let place = if global { Place::InDb(number, at) } else { Place::InDi(number, at) };
                return Ok(Operand { width, place });
            }
            whole = *self;
        }
        // A bit by a pointer with its area has no letter.
        let bare = self.0.trim_start().starts_with("[AR");
        let (area, width) = if bare {
            (None, Width::Bit)
        } else {
            let (_, area, width) = self.choice(&*TYPED, |typed| &typed.0, WHAT)?;
            (*area, *width)
        };
        if !self.eat("[") {
            let area = area.ok_or(WHAT)?;
            return Ok(Operand { width, place: Place::Fixed(area, self.address()?) });
        }
        let place = match self.choice(REGISTERS, |register| register.to_string(), WHAT) {
            Ok(register) => {
                self.need(",P#")?;
                let at = self.address()?;
                self.need("]")?;
                Place::Register(area, register, at)
            }
            Err(_) => Place::Memory(area.ok_or(WHAT)?, self.pointer(Width::DWord)?),
        };
        Ok(Operand { width, place })
    }

    pub(super) fn bit(&mut self) -> Expected<Place> {
        let operand = self.operand()?;
        if operand.width == Width::Bit { Ok(operand.place) } else { Err("a bit") }
    }

    fn width(&mut self) -> Expected<Width> {
        self.choice(WIDTHS, letter, "a width")
    }

    /// The number of a timer, counter or block.
    pub(super) fn block_number(&mut self) -> Expected<Number> {
        if self.eat("[") {
            return Ok(Number::Memory(self.pointer(Width::Word)?));
        }
        if self.eat("PAR") {
            return Ok(Number::Param(self.number()?));
        }
        if self.eat("INST+") {
            return Ok(Number::Instance(self.address()?));
        }
        Ok(Number::Fixed(self.number()?))
    }

    /// `P#12.0`, `P#M 3.0` or `DW#16#..`: the bits of a pointer.
    pub(super) fn pointer_bits(&mut self) -> Expected<u32> {
        if self.eat("DW#16#") {
            return self.hex();
        }
        self.need("P#")?;
        if let Ok(at) = self.address() {
            return Ok(at.0);
        }
        let area = self.choice(Area::ALL, |area| area_text(area, Width::Bit) + " ", "a pointer")?;
        Ok(u32::from(area.pointer_code()) << 24 | self.address()?.0)
    }
}
