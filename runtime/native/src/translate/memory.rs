//! Reading and writing the arena: values lie there with their high byte first.

use cranelift_codegen::ir::{InstBuilder, Value, types};

use super::Translation;
use super::operand::{BitAt, Spot};
use super::state::{self, Bit};

impl Translation<'_, '_> {
    /// 8, 16 or 32 bits, the upper ones 0.
    pub(crate) fn read(&mut self, spot: Spot, bits: u32) -> Value {
        let value = self.content(spot, bits);
        if bits == 32 { value } else { self.b.ins().uextend(types::I32, value) }
    }

    /// Writes the low 8, 16 or 32 bits.
    pub(crate) fn write(&mut self, spot: Spot, bits: u32, value: Value) {
        let value = match bits {
            8 => self.b.ins().ireduce(types::I8, value),
            16 => state::word_of(value, &self.b).unwrap_or_else(|| self.b.ins().ireduce(types::I16, value)),
            _ => value,
        };
        self.put_content(spot, value);
    }

    fn shift_of(&mut self, spot: Spot) -> Value {
        match spot.bit {
            BitAt::Known(bit) => self.b.iconst(types::I8, i64::from(bit)),
            // A shift of eight bits looks at the low three of its distance.
            BitAt::Computed(v) => v,
        }
    }

    /// A bit of memory.
    pub(crate) fn bit(&mut self, spot: Spot) -> Bit {
        if let BitAt::Known(at) = spot.bit {
            return self.waiting_bit(spot, at).unwrap_or_else(|| Bit::At(self.byte_of(spot), at));
        }
        let (byte, shift) = (self.content(spot, 8), self.shift_of(spot));
        let shifted = self.b.ins().ushr(byte, shift);
        let one = self.b.iconst(types::I8, 1);
        Bit::Val(self.b.ins().band(shifted, one))
    }

    /// Writes a bit.
    pub(crate) fn put_bit(&mut self, spot: Spot, value: Bit) {
        if let BitAt::Known(at) = spot.bit
            && self.part(spot).is_some()
        {
            self.put_known_bit(spot, at, value);
            return;
        }
        let (byte, shift) = (self.content(spot, 8), self.shift_of(spot));
        let one = self.b.iconst(types::I8, 1);
        let mask = self.b.ins().ishl(one, shift);
        let new = match value {
            Bit::Known(true) => self.b.ins().bor(byte, mask),
            Bit::Known(false) => self.b.ins().band_not(byte, mask),
            value => {
                let v = value.value(self.vars.rlo, &mut self.b);
                let cleared = self.b.ins().band_not(byte, mask);
                let placed = self.b.ins().ishl(v, shift);
                self.b.ins().bor(cleared, placed)
            }
        };
        self.put_content(spot, new);
    }

    /// Sets or clears a bit when `when` is 1.
    pub(crate) fn change_bit(&mut self, spot: Spot, set: bool, when: Bit) {
        let placed = match spot.bit {
            BitAt::Known(at) => {
                if let Some(before) = self.waiting_bit(spot, at) {
                    let off = state::not(when, &mut self.b);
                    let b = &mut self.b;
                    let new = if set { state::or(before, when, b) } else { state::and(before, off, b) };
                    self.put_known_bit(spot, at, new);
                    return;
                }
                when.alone_at(at, self.vars.rlo, &mut self.b)
            }
            BitAt::Computed(shift) => {
                let v = when.value(self.vars.rlo, &mut self.b);
                self.b.ins().ishl(v, shift)
            }
        };
        let byte = self.byte_of(spot);
        let new = if set { self.b.ins().bor(byte, placed) } else { self.b.ins().band_not(byte, placed) };
        self.put_byte(spot, new);
    }
}
