//! Loading, transferring, address registers, data blocks.

use cranelift_codegen::ir::{InstBuilder, Value, types};
use ob1_ir::{AddressRegister, DbRegister, Number, Op};

use super::Translation;
use super::operand::Which;
use super::state::{self, Accu, Bit, Reg};

/// The low 24 bits of an address register: the area code above them stays when addresses are added.
const AR_ADDRESS: u32 = 0x00FF_FFFF;

const fn index(register: AddressRegister) -> usize {
    match register {
        AddressRegister::Ar1 => 0,
        AddressRegister::Ar2 => 1,
    }
}

impl Translation<'_, '_> {
    /// A value into ACCU1; what it held goes to ACCU2.
    pub(crate) fn load(&mut self, value: Accu) {
        // A value in its variable moves as a value.
        if self.now.a[0] == Accu::Var {
            // A value that only memory has is not needed by anybody.
            let stored = self.now.stored & crate::flow::A1 != 0;
            let v = if stored { self.word(0) } else { self.b.use_var(self.vars.a[0]) };
            self.now.a[0] = Accu::Full(v);
        }
        self.now.a[1] = self.now.a[0];
        self.now.a[0] = value;
    }

    /// All of ACCU1 (0) or ACCU2 (1).
    pub(crate) fn accu(&mut self, i: usize) -> Value {
        let v = state::full(self.now.a[i], self.vars.a[i], &mut self.b);
        if !matches!(self.now.a[i], Accu::Real(_) | Accu::Split { .. }) {
            self.now.a[i] = Accu::Full(v);
        }
        v
    }

    /// The same, when only its low word counts.
    pub(crate) fn accu_low(&mut self, i: usize) -> Value {
        state::low(self.now.a[i], self.vars.a[i], &mut self.b)
    }

    /// The low word of an accumulator in 16 bits.
    pub(crate) fn low_word(&mut self, i: usize) -> Value {
        let v = self.accu_low(i);
        match state::constant(&self.b, v) {
            Some(c) => self.b.iconst(types::I16, c & 0xFFFF),
            None => state::word_of(v, &self.b).unwrap_or_else(|| self.b.ins().ireduce(types::I16, v)),
        }
    }

    fn register(&mut self, register: AddressRegister) -> Reg {
        let i = index(register);
        match self.now.ar[i] {
            Reg::Var => Reg::Val(self.b.use_var(self.vars.ar[i])),
            known => known,
        }
    }

    /// A constant value is known.
    fn known(&self, v: Value) -> Reg {
        state::constant(&self.b, v).map_or(Reg::Val(v), |c| Reg::Known(c as u32))
    }

    /// True when the statement is one of these.
    pub(crate) fn word_statement(&mut self, op: &Op, pc: usize) -> bool {
        match op {
            Op::Load(operand) => {
                let bits = u32::from(operand.width.bits());
                let spot = self.spot(&operand.place, bits, false, pc);
                let v = self.value(spot, bits);
                self.load(Accu::Full(v));
            }
            Op::LoadConst(value) => {
                let v = self.word(*value);
                self.load(Accu::Full(v));
            }
            Op::Transfer(operand) => {
                let bits = u32::from(operand.width.bits());
                let spot = self.spot(&operand.place, bits, true, pc);
                let v = if bits == 32 { self.accu(0) } else { self.accu_low(0) };
                self.put_value(spot, bits, v);
            }
            Op::LoadArFrom(register, operand) => {
                let bits = u32::from(operand.width.bits());
                let spot = self.spot(&operand.place, bits, false, pc);
                let v = self.value(spot, bits);
                self.set_address(index(*register), Reg::Val(v));
            }
            Op::TransferArTo(register, operand) => {
                let bits = u32::from(operand.width.bits());
                let spot = self.spot(&operand.place, bits, true, pc);
                let v = self.address(index(*register));
                self.put_value(spot, bits, v);
            }
            Op::LoadAr(register) => {
                let v = self.accu(0);
                let value = self.known(v);
                self.set_address(index(*register), value);
            }
            Op::LoadArConst(register, value) => self.set_address(index(*register), Reg::Known(*value)),
            Op::CopyAr2ToAr1 => {
                let value = self.register(AddressRegister::Ar2);
                self.set_address(0, value);
            }
            Op::CopyAr1ToAr2 => {
                let value = self.register(AddressRegister::Ar1);
                self.set_address(1, value);
            }
            Op::ExchangeArs => {
                let (one, two) = (self.register(AddressRegister::Ar1), self.register(AddressRegister::Ar2));
                self.set_address(0, two);
                self.set_address(1, one);
            }
            Op::TransferAr(register) => {
                let v = self.address(index(*register));
                self.load(Accu::Full(v));
            }
            Op::AddAr(register) => {
                let offset = state::signed(self.now.a[0], self.vars.a[0], &mut self.b);
                self.add_address(index(*register), offset);
            }
            Op::AddArConst(register, offset) => {
                // 16 bits with a sign, as machine code has them.
                let offset = i32::from(offset.0 as u16 as i16) as u32;
                let offset = self.word(offset);
                self.add_address(index(*register), offset);
            }
            Op::OpenDb(register, Number::Fixed(n)) => {
                let which = if *register == DbRegister::Db { Which::Db } else { Which::Di };
                self.open(which, *n);
            }
            _ => return false,
        }
        true
    }

    /// A value of so many bits; one bit as 0 or 1.
    pub(crate) fn value(&mut self, spot: super::operand::Spot, bits: u32) -> Value {
        if bits > 1 {
            return self.read(spot, bits);
        }
        let bit = self.bit(spot).value(self.vars.rlo, &mut self.b);
        self.b.ins().uextend(types::I32, bit)
    }

    pub(crate) fn put_value(&mut self, spot: super::operand::Spot, bits: u32, value: Value) {
        if bits > 1 {
            self.write(spot, bits, value);
            return;
        }
        let low = self.b.ins().ireduce(types::I8, value);
        let one = self.b.iconst(types::I8, 1);
        let bit = self.b.ins().band(low, one);
        self.put_bit(spot, Bit::Val(bit));
    }

    fn add_address(&mut self, i: usize, offset: Value) {
        if let (Reg::Known(ar), Some(offset)) = (self.now.ar[i], state::constant(&self.b, offset)) {
            let sum = ar & !AR_ADDRESS | ar.wrapping_add(offset as u32) & AR_ADDRESS;
            self.set_address(i, Reg::Known(sum));
            return;
        }
        let ar = self.address(i);
        let sum = self.b.ins().iadd(ar, offset);
        let address = self.word(AR_ADDRESS);
        let sum = self.b.ins().band(sum, address);
        let code = self.b.ins().band_not(ar, address);
        let sum = self.b.ins().bor(code, sum);
        self.set_address(i, Reg::Val(sum));
    }
}
