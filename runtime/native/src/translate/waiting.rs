//! Bits that wait for their byte: a byte is put together once, when somebody wants all of it. A bit that is replaced
//! before that is never calculated, and one that is read is the value it was given.

use cranelift_codegen::cursor::{Cursor, FuncCursor};
use cranelift_codegen::ir::{InstBuilder, Value, types};

use super::Translation;
use super::cache::{Cache, Held, Key};
use super::operand::Spot;
use super::state::Bit;

impl Cache {
    pub(super) fn bits_of(&self, key: Key) -> Vec<(u8, Bit)> {
        self.bits.iter().filter(|(byte, ..)| *byte == key).map(|(_, at, bit)| (*at, *bit)).collect()
    }

    pub(super) fn set_bits(&mut self, key: Key, bits: &[(u8, Bit)]) {
        self.bits.retain(|(byte, ..)| *byte != key);
        self.bits.extend(bits.iter().map(|(at, bit)| (key, *at, *bit)));
    }
}

impl Translation<'_, '_> {
    /// The value of a known place, with the bits that wait.
    pub(super) fn settled(&mut self, key: Key) -> Option<Value> {
        let held = *self.checked.cache.get(key)?;
        let bits = self.checked.cache.bits_of(key);
        if bits.is_empty() {
            return Some(held.value);
        }
        let mut cursor = self.at(held.since);
        let value = with_bits(&mut cursor, held.value, &bits);
        cursor.prev_inst();
        let since = (held.since.0, cursor.current_inst());
        self.checked.cache.set_bits(key, &[]);
        self.checked.cache.insert(key, Held { value, since, ..held });
        Some(value)
    }

    /// A bit that waits to be put into its byte.
    pub(crate) fn waiting_bit(&self, spot: Spot, at: u8) -> Option<Bit> {
        let part = self.part(spot)?;
        let found = |(byte, bit, _): &&(Key, u8, Bit)| (*byte, *bit) == ((part, spot.offset), at);
        self.checked.cache.bits.iter().find(found).map(|(_, _, bit)| *bit)
    }

    /// A byte, without the bits that wait to be put into it.
    pub(crate) fn byte_of(&mut self, spot: Spot) -> Value {
        let held = self.part(spot).and_then(|part| self.checked.cache.get((part, spot.offset)));
        match held {
            Some(held) if held.bytes == 1 => held.value,
            _ => self.content(spot, 8),
        }
    }

    /// Replaces what [`Self::byte_of`] gave: the bits that wait still do.
    pub(crate) fn put_byte(&mut self, spot: Spot, byte: Value) {
        let key = self.part(spot).map(|part| (part, spot.offset));
        let bits = key.map(|key| self.checked.cache.bits_of(key)).unwrap_or_default();
        self.put_content(spot, byte);
        if let Some(key) = key {
            self.checked.cache.set_bits(key, &bits);
        }
    }

    /// A bit of a place that can wait, from here on.
    pub(crate) fn put_known_bit(&mut self, spot: Spot, at: u8, bit: Bit) {
        let byte = self.byte_of(spot);
        self.put_byte(spot, byte);
        let Some(key) = self.part(spot).map(|part| (part, spot.offset)) else { return };
        debug_assert!(bit != Bit::Var, "variables are read before bits are written");
        self.checked.cache.bits.retain(|(byte, n, _)| (*byte, *n) != (key, at));
        self.checked.cache.bits.push((key, at, bit));
    }
}

/// A byte of which these bits are replaced.
fn with_bits(at: &mut FuncCursor<'_>, byte: Value, bits: &[(u8, Bit)]) -> Value {
    let number = |at: &mut FuncCursor<'_>, v: u8| at.ins().iconst(types::I8, i64::from(v));
    let rest = bits.iter().fold(0xFF, |rest: u8, (to, _)| rest & !(1 << to));
    let mut whole = (rest != 0).then(|| {
        let rest = number(at, rest);
        at.ins().band(byte, rest)
    });
    for (to, bit) in bits {
        let part = match *bit {
            Bit::Known(false) | Bit::Var => continue,
            Bit::Known(true) => number(at, 1 << to),
            Bit::Val(v) => {
                let by = number(at, *to);
                at.ins().ishl(v, by)
            }
            Bit::At(v, from) => {
                let (by, mask) = (number(at, from.abs_diff(*to)), number(at, 1 << to));
                let moved = if from > *to { at.ins().ushr(v, by) } else { at.ins().ishl(v, by) };
                at.ins().band(moved, mask)
            }
        };
        whole = Some(whole.map_or(part, |whole| at.ins().bor(whole, part)));
    }
    whole.unwrap_or_else(|| number(at, 0))
}
