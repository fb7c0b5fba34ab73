//! Places, numbers, components.

use ob1_ir::{AddressRegister, Number, Operand, Place, Pointer, Width};
use ob1_model::{Area, BitAddr, BlockKind, Component, DataType, Layout, Param, Section};

use super::Made;

impl Made<'_> {
    pub(super) fn width(&mut self) -> Width {
        self.bytes.of(&[Width::Bit, Width::Byte, Width::Word, Width::DWord])
    }

    pub(super) fn operand(&mut self) -> Operand {
        let width = self.bytes.of(&[Width::Byte, Width::Word, Width::DWord]);
        Operand { width, place: self.place(width) }
    }

    /// An address: mostly low, at times at the edges of short and long forms.
    fn byte(&mut self, area: Area) -> u32 {
        if area == Area::Local {
            return u32::from(self.bytes.byte());
        }
        match self.bytes.byte() % 8 {
            0 => self.bytes.of(&[127, 128, 255, 256, 65_532]),
            1 => u32::from(self.bytes.word()) % 65_532,
            _ => u32::from(self.bytes.byte()) % 40,
        }
    }

    pub(super) fn fixed(&mut self, area: Area, width: Width) -> Place {
        let bit = if width == Width::Bit { self.bytes.byte() % 8 } else { 0 };
        Place::Fixed(area, BitAddr::new(self.byte(area), bit))
    }

    fn area(&mut self, width: Width) -> Area {
        let all = [Area::Input, Area::Output, Area::Memory, Area::Db, Area::Di, Area::Local, Area::Peripheral];
        self.bytes.of(if width == Width::Bit { &all[..6] } else { &all })
    }

    pub(super) fn pointer(&mut self) -> Pointer {
        let area = self.bytes.of(&[Area::Memory, Area::Db, Area::Di, Area::Local]);
        let Place::Fixed(area, at) = self.fixed(area, Width::DWord) else { unreachable!() };
        Pointer { area, at }
    }

    /// Any place an access of this width can have.
    pub(super) fn place(&mut self, width: Width) -> Place {
        match self.bytes.byte() % 10 {
            0 => Place::Memory(self.area(width), self.pointer()),
            1 | 2 => {
                let area = if self.bytes.flag() { Some(self.area(width)) } else { None };
                let register = self.bytes.of(&[AddressRegister::Ar1, AddressRegister::Ar2]);
                // `DIX [AR2,..]` names a variable of the instance where there is one.
                let own = self.id.kind == BlockKind::Fb && area == Some(Area::Di);
                let register = if own { AddressRegister::Ar1 } else { register };
                Place::Register(area, register, BitAddr(u32::from(self.bytes.word())))
            }
            3 => match self.fixed(Area::Db, width) {
                Place::Fixed(_, at) => Place::InDb(1 + self.bytes.word() % 300, at),
                other => other,
            },
            4 | 5 => self.variable(width).unwrap_or_else(|| self.fixed(Area::Memory, width)),
            _ => {
                let area = self.area(width);
                self.fixed(area, width)
            }
        }
    }

    /// A variable of the block, or a component of one.
    pub(super) fn variable(&mut self, width: Width) -> Option<Place> {
        let kind = self.id.kind;
        let of_block = |p: &Param| match p.section {
            Section::Temp => true,
            Section::Static => kind == BlockKind::Fb,
            _ => !p.is_pointer() || kind == BlockKind::Fc,
        };
        let params: Vec<Param> = self.interface.params.iter().filter(|p| of_block(p)).cloned().collect();
        let param = self.bytes.of(&params);
        let at = self.component(&param.ty, width)?;
        Some(match (param.section, kind) {
            (Section::Temp, _) => Place::Fixed(Area::Local, BitAddr(param.at.0 + at.0)),
            (_, BlockKind::Fc) => {
                let index = self.interface.formals().position(|p| p.name == param.name)?;
                Place::Param { index: index as u16, at }
            }
            _ => Place::Instance(BitAddr(param.at.0 + at.0)),
        })
    }

    /// Where a component of this width lies in a type.
    pub(super) fn component(&mut self, ty: &DataType, width: Width) -> Option<BitAddr> {
        let mut all: Vec<Component> = Vec::new();
        Layout::components("", ty, BitAddr(0), &mut all);
        all.retain(|c| Width::of(&c.ty) == Some(width));
        if all.is_empty() { None } else { Some(self.bytes.of(&all).at) }
    }

    /// The number of a timer, counter or data block.
    pub(super) fn number(&mut self, ty: &DataType) -> Number {
        let own: Vec<(u16, BitAddr)> = (0u16..)
            .zip(self.interface.formals())
            .filter(|(_, p)| p.ty == *ty)
            .map(|(index, p)| (index, p.at))
            .collect();
        match (self.bytes.byte() % 4, self.id.kind) {
            (0, BlockKind::Fc) if !own.is_empty() => Number::Param(self.bytes.of(&own).0),
            (0, BlockKind::Fb) if !own.is_empty() => Number::Instance(self.bytes.of(&own).1),
            (1, _) => Number::Memory(self.pointer()),
            (2, _) => Number::Fixed(1 + self.bytes.word() % 0xFFF0),
            _ => Number::Fixed(1 + u16::from(self.bytes.byte())),
        }
    }
}
