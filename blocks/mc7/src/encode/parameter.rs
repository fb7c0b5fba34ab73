//! What a parameter needs around a statement: the accumulators are put aside, the number or POINTER is fetched, the
//! accumulators come back, and then the statement itself.

use ob1_ir::{AddressRegister, DbRegister, Number, Op, Operand, Place, Pointer, Stmt, Width};
use ob1_model::{Area, BitAddr};

use super::{Encoder, operand};
use crate::statement::Mc7Op;

/// An operand in the local data.
pub(super) fn local(width: Width, byte: u32) -> Operand {
    operand(width, Place::Fixed(Area::Local, BitAddr::byte_addr(byte)))
}

const AR1: AddressRegister = AddressRegister::Ar1;

fn crossing(width: Width, bytes: u32) -> Op {
    Op::Load(operand(width, Place::Register(None, AR1, BitAddr::byte_addr(bytes))))
}

impl Encoder<'_, '_> {
    /// `T LD a; TAK; T LD b`; gives both places.
    fn save(&mut self) -> (Operand, Operand) {
        let (a, b) = (local(Width::DWord, self.take(4)), local(Width::DWord, self.take(4)));
        self.plain(Op::Transfer(a));
        self.plain(Op::ExchangeAccus);
        self.plain(Op::Transfer(b));
        (a, b)
    }

    /// `L LD b; L LD a`.
    fn restore(&mut self, (a, b): (Operand, Operand)) {
        self.plain(Op::Load(b));
        self.plain(Op::Load(a));
    }

    /// A number that is a parameter of a function block: a word of its instance.
    pub(super) fn number_of_instance(&mut self, at: BitAddr, mut op: Op) -> Option<()> {
        let from = self.own(at)?;
        if !self.written.multi_instance {
            let pointer = Pointer { area: Area::Di, at };
            *op.number_mut()? = Number::Memory(pointer);
            self.plain(op);
            return Some(());
        }
        let saved = self.save();
        let word = self.take(2);
        self.plain(Op::Load(operand(Width::Word, from)));
        self.plain(Op::Transfer(local(Width::Word, word)));
        self.restore(saved);
        *op.number_mut()? = number_at(word);
        self.plain(op);
        Some(())
    }

    /// True for the POINTER of a composed in/out in the instance.
    pub(super) fn is_pointer(&self, at: BitAddr) -> bool {
        self.block.interface.params.iter().any(|p| p.is_pointer() && p.at == at)
    }

    /// A component that such a POINTER leads to: the data block opened and AR1 loaded, in front of the statement
    /// itself.
    pub(super) fn through(&mut self, pointer: BitAddr, rest: &[Stmt]) -> Option<usize> {
        let address = operand(Width::DWord, Place::Instance(BitAddr(pointer.0 + 16)));
        if rest.get(1)?.op != Op::LoadArFrom(AR1, address) || !self.written.multi_instance {
            return None;
        }
        self.put(Mc7Op::Build(18));
        let saved = self.save();
        let word = self.take(2);
        let from = self.own(pointer)?;
        self.plain(Op::Load(operand(Width::Word, from)));
        self.plain(Op::Transfer(local(Width::Word, word)));
        self.plain(Op::OpenDb(DbRegister::Db, number_at(word)));
        let from = self.own(BitAddr(pointer.0 + 16))?;
        self.plain(Op::Load(operand(Width::DWord, from)));
        self.plain(Op::LoadAr(AR1));
        self.restore(saved);
        Some(2)
    }

    /// A component of a composed parameter of a function.
    pub(super) fn component(&mut self, list: u16, at: BitAddr, mut op: Op) -> Option<()> {
        // AR1 is used on the way.
        if matches!(op, Op::LoadArFrom(..) | Op::TransferArTo(..)) {
            return None;
        }
        *op.place_mut()? = Place::Register(None, AR1, at);
        self.put(Mc7Op::Build(5));
        let saved = self.save();
        let word = self.take(2);
        self.put(Mc7Op::ParamPointer { index: list, other: false });
        self.plain(Op::LoadAr(AR1));
        self.plain(crossing(Width::Word, 0));
        self.plain(Op::Transfer(local(Width::Word, word)));
        self.plain(Op::OpenDb(DbRegister::Db, number_at(word)));
        self.plain(crossing(Width::DWord, 2));
        self.plain(Op::LoadAr(AR1));
        self.restore(saved);
        self.plain(op);
        Some(())
    }
}

/// The number in a word of the local data.
pub(super) fn number_at(word: u32) -> Number {
    Number::Memory(Pointer { area: Area::Local, at: BitAddr::byte_addr(word) })
}
