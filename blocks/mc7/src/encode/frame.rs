//! What the frames of calls have in common.

use ob1_ir::{BitTest, Logic, Op, Operand, Place, Width};
use ob1_model::{Area, BitAddr, BlockKind};

use super::{Encoder, operand};
use crate::fold::{FRAMES, Frame};
use crate::statement::{ConstForm, Mc7Op};

impl Encoder<'_, '_> {
    /// The opening `BLD` of a frame.
    pub(super) fn open(&mut self, kind: impl Fn(BlockKind) -> Frame, of: BlockKind) -> Option<u8> {
        let (number, _) = FRAMES.iter().find(|(_, frame)| *frame == kind(of))?;
        self.put(Mc7Op::Build(*number));
        Some(*number)
    }

    /// `= L t.0`: ends the logic string. Gives the byte, whose other bits are free.
    pub(super) fn end_logic(&mut self) -> u32 {
        let byte = self.take(1);
        self.plain(Op::Assign(Place::Fixed(Area::Local, BitAddr::byte_addr(byte))));
        byte
    }

    /// `L` or `U` of an operand.
    pub(super) fn load(&mut self, from: Operand) {
        self.plain(match from.width {
            Width::Bit => Op::Scan { logic: Logic::And, negate: false, test: BitTest::Bit(from.place) },
            _ => Op::Load(from),
        });
    }

    /// `T` or `=` to an operand.
    pub(super) fn store(&mut self, to: Operand) {
        self.plain(match to.width {
            Width::Bit => Op::Assign(to.place),
            _ => Op::Transfer(to),
        });
    }

    /// A constant of a width.
    pub(super) fn load_const(&mut self, width: Width, value: u32) -> Option<()> {
        match (width, value) {
            (Width::Bit, 0) => self.plain(Op::ClearRlo),
            (Width::Bit, 1) => self.plain(Op::SetRlo),
            (Width::Bit, _) => return None,
            (Width::Byte, _) => self.put(Mc7Op::Constant(ConstForm::Byte, u32::from(u8::try_from(value).ok()?))),
            (Width::Word, _) => self.put(Mc7Op::Constant(ConstForm::Word(3), u32::from(u16::try_from(value).ok()?))),
            (Width::DWord, _) => self.put(Mc7Op::Constant(ConstForm::DWord(3), value)),
        }
        Some(())
    }

    /// The bytes of a POINTER or ANY as constants into places `so many bytes` into what `to` gives.
    pub(super) fn pointer_bytes(&mut self, bytes: &[u8], to: &dyn Fn(Width, u32) -> Operand) -> Option<()> {
        let word = |at: usize| bytes.get(at..at + 2).map(|b| u32::from(u16::from_be_bytes([b[0], b[1]])));
        let mut at = 0;
        if bytes.len() == 10 {
            self.put(Mc7Op::Constant(ConstForm::Word(0), word(0)?));
            self.store(to(Width::Word, 0));
            self.put(Mc7Op::Constant(ConstForm::Word(3), word(2)?));
            self.store(to(Width::Word, 2));
            at = 4;
        } else if bytes.len() != 6 {
            return None;
        }
        self.put(Mc7Op::Constant(ConstForm::Word(3), word(at)?));
        self.store(to(Width::Word, at as u32));
        self.put(Mc7Op::Constant(ConstForm::DWord(4), word(at + 2)? << 16 | word(at + 4)?));
        self.store(to(Width::DWord, at as u32 + 2));
        Some(())
    }
}

/// An operand at an offset from a place.
pub(super) fn behind(place: impl Fn(BitAddr) -> Place, start: BitAddr) -> impl Fn(Width, u32) -> Operand {
    move |width, bytes| operand(width, place(BitAddr(start.0 + bytes * 8)))
}
