//! Places: what must be loaded and opened before a variable can be accessed.

use ob1_ir::{
    AccuOp, AddressRegister, DbRegister, Number, NumberFormat, Op, Operand, Place, Pointer, Shift, Width, WordLogic,
};
use ob1_model::{Area, BitAddr, DataType};

use crate::code::{Code, local};
use crate::tree::{Base, Kind, Term, Typed, Var};

const AR1: AddressRegister = AddressRegister::Ar1;

impl Code {
    /// Makes a variable accessible. What is accessed through AR1 or the DB register is so until the next place.
    pub(crate) fn place(&mut self, var: &Var<'_>) -> Place {
        let at = var.at;
        if var.terms.is_empty() {
            return match &var.base {
                Base::Fixed(area) => Place::Fixed(*area, at),
                Base::Instance => Place::Instance(at),
                Base::Param(index) => Place::Param { index: *index, at },
                Base::Db(number) => Place::InDb(*number, at),
                Base::DbAt(number) => {
                    let number = self.number(number);
                    self.op(Op::OpenDb(DbRegister::Db, number));
                    Place::Fixed(Area::Db, at)
                }
                Base::Through(pointer) => {
                    self.open_pointer(Place::Instance(*pointer));
                    self.op(Op::LoadArFrom(
                        AR1,
                        Operand { width: Width::DWord, place: Place::Instance(BitAddr(pointer.0 + 16)) },
                    ));
                    Place::Register(None, AR1, at)
                }
            };
        }
        self.indexed(var)
    }

    fn indexed(&mut self, var: &Var<'_>) -> Place {
        let at = var.at;
        let add = |code: &mut Self| code.op(Op::Arithmetic(NumberFormat::DInt, AccuOp::Add));
        match &var.base {
            Base::Fixed(area) => {
                self.offset(&var.terms);
                self.op(Op::LoadAr(AR1));
                Place::Register(Some(*area), AR1, at)
            }
            Base::Instance => {
                self.offset(&var.terms);
                self.op(Op::TransferAr(AddressRegister::Ar2));
                add(self);
                self.op(Op::LoadAr(AR1));
                Place::Register(Some(Area::Di), AR1, at)
            }
            Base::Db(number) => {
                self.offset(&var.terms);
                self.op(Op::LoadAr(AR1));
                self.op(Op::OpenDb(DbRegister::Db, Number::Fixed(*number)));
                Place::Register(Some(Area::Db), AR1, at)
            }
            Base::DbAt(number) => {
                let number = self.number(number);
                self.offset(&var.terms);
                self.op(Op::LoadAr(AR1));
                self.op(Op::OpenDb(DbRegister::Db, number));
                Place::Register(Some(Area::Db), AR1, at)
            }
            Base::Through(pointer) => {
                self.offset(&var.terms);
                self.op(Op::Load(Operand { width: Width::DWord, place: Place::Instance(BitAddr(pointer.0 + 16)) }));
                add(self);
                self.op(Op::LoadAr(AR1));
                self.open_pointer(Place::Instance(*pointer));
                Place::Register(None, AR1, at)
            }
            Base::Param(index) => {
                self.offset(&var.terms);
                let offset = self.temp(Width::DWord);
                self.op(Op::Transfer(offset));
                self.param_pointer(*index);
                self.op(Op::Load(offset));
                add(self);
                self.op(Op::LoadAr(AR1));
                Place::Register(None, AR1, at)
            }
        }
    }

    /// The pointer to a parameter into ACCU1, and its data block opened.
    pub(crate) fn param_pointer(&mut self, index: u16) {
        if self.elementary.contains(&index) {
            self.op(Op::LoadParamPointer { index, at: None });
            return;
        }
        let at = self.take(6);
        self.op(Op::LoadParamPointer { index, at: Some(at) });
        self.open_pointer(Place::Fixed(Area::Local, at));
        self.op(Op::Load(local(Width::DWord, BitAddr(at.0 + 16))));
    }

    /// Opens the data block that the POINTER here names; 0 is none. Changes the accumulators where it is not sure.
    fn open_pointer(&mut self, at: Place) {
        let number = match at {
            Place::Instance(at) => Number::Instance(at),
            Place::Fixed(area, at) => Number::Memory(Pointer { area, at }),
            _ => return self.lose(),
        };
        self.op(Op::OpenDb(DbRegister::Db, number));
    }

    /// The number of a data block, ready for opening it.
    pub(crate) fn number(&mut self, number: &Typed<'_>) -> Number {
        match &number.kind {
            Kind::Block(number) => *number,
            _ => {
                self.value(number);
                let word = self.temp(Width::Word);
                self.op(Op::Transfer(word));
                match word.place {
                    Place::Fixed(area, at) => Number::Memory(Pointer { area, at }),
                    _ => {
                        self.lose();
                        Number::Fixed(0)
                    }
                }
            }
        }
    }

    /// The bits that indices lead on, into ACCU1.
    fn offset(&mut self, terms: &[Term<'_>]) {
        for (at, term) in terms.iter().enumerate() {
            let sum = (at > 0).then(|| self.temp(Width::DWord));
            if let Some(sum) = sum {
                self.op(Op::Transfer(sum));
            }
            self.value(&term.index);
            if self.options.monitor_limits {
                self.check_limits(term);
            }
            if term.low != 0 {
                self.op(Op::AddConst { format: NumberFormat::DInt, value: term.low.saturating_neg() });
            }
            match term.stride {
                0 | 1 => {}
                stride if stride.is_power_of_two() => {
                    self.op(Op::Shift(Shift::LeftDWord, Some(stride.trailing_zeros() as u8)));
                }
                stride => {
                    self.op(Op::LoadConst(stride));
                    self.op(Op::Arithmetic(NumberFormat::DInt, AccuOp::Mul));
                    self.check_overflow();
                }
            }
            if let Some(sum) = sum {
                self.op(Op::Load(sum));
                self.op(Op::Arithmetic(NumberFormat::DInt, AccuOp::Add));
            }
        }
        // What lies beyond an area has no address.
        self.op(Op::DWordLogic(WordLogic::And, Some(0x7_FFFF)));
    }

    /// Width and place of an elementary variable.
    pub(crate) fn operand(&mut self, var: &Var<'_>, ty: &DataType) -> Operand {
        let place = self.place(var);
        Operand { width: Width::of(ty).unwrap_or(Width::Byte), place }
    }
}
