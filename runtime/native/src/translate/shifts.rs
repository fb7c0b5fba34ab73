//! Shifts and rotations of ACCU1.

use cranelift_codegen::ir::{InstBuilder, Value, types};
use ob1_ir::Shift;

use super::Translation;
use super::state;

impl Translation<'_, '_> {
    pub(super) fn shift(&mut self, kind: Shift, count: u8) {
        if count == 0 {
            return;
        }
        let n = u32::from(count);
        // The result, and a value whose bit 0 was shifted out last.
        let (result, out) = match kind {
            Shift::LeftWord => {
                // What lies above the low word moves up and out.
                let low = self.accu_low(0);
                if n > 16 {
                    (self.word(0), self.word(0))
                } else {
                    let wide = self.shifted(low, n, Shift::LeftDWord);
                    (wide, self.shifted(wide, 16, Shift::RightDWord))
                }
            }
            Shift::RightWord => {
                let low = self.accu_low(0);
                let mask = self.word(0xFFFF);
                let low = self.b.ins().band(low, mask);
                let n = n.min(17);
                (self.shifted(low, n, Shift::RightDWord), self.shifted(low, n - 1, Shift::RightDWord))
            }
            Shift::RightInt => {
                let low = self.signed(0);
                let n = n.min(16);
                (self.shifted(low, n, Shift::RightDInt), self.shifted(low, n - 1, Shift::RightDInt))
            }
            Shift::LeftDWord => {
                let v = self.accu(0);
                match n {
                    0..=31 => (self.shifted(v, n, kind), self.shifted(v, 32 - n, Shift::RightDWord)),
                    32 => (self.word(0), v),
                    _ => (self.word(0), self.word(0)),
                }
            }
            Shift::RightDWord => {
                let v = self.accu(0);
                match n {
                    0..=31 => (self.shifted(v, n, kind), self.shifted(v, n - 1, kind)),
                    32 => (self.word(0), self.shifted(v, 31, kind)),
                    _ => (self.word(0), self.word(0)),
                }
            }
            Shift::RightDInt => {
                let v = self.accu(0);
                let (n, last) = if n > 31 { (31, 31) } else { (n, n - 1) };
                (self.shifted(v, n, kind), self.shifted(v, last, kind))
            }
            Shift::RotateLeft => {
                let v = self.accu(0);
                let count = self.word(n % 32);
                let result = self.b.ins().rotl(v, count);
                (result, result)
            }
            Shift::RotateRight => {
                let v = self.accu(0);
                let count = self.word(n % 32);
                let result = self.b.ins().rotr(v, count);
                (result, self.shifted(result, 31, Shift::RightDWord))
            }
        };
        match kind {
            Shift::LeftWord | Shift::RightWord | Shift::RightInt => self.set_low(result),
            _ => self.set_full(result),
        }
        self.set_cc1(|t| {
            let one = t.word(1);
            let out = t.b.ins().band(out, one);
            t.b.ins().ireduce(types::I8, out)
        });
    }

    /// A shift of 32 bits by fewer than 32.
    fn shifted(&mut self, v: Value, n: u32, kind: Shift) -> Value {
        let n = self.word(n);
        match kind {
            Shift::LeftDWord => self.b.ins().ishl(v, n),
            Shift::RightDInt => self.b.ins().sshr(v, n),
            _ => self.b.ins().ushr(v, n),
        }
    }

    pub(super) fn rotate_cc1(&mut self, left: bool) {
        let v = self.accu(0);
        let (cc1, _) = state::pair(self.now.cc, self.vars.cc, &mut self.b);
        let cc1 = state::placed(cc1, 1, &mut self.b);
        let (moved, out, last) = if left {
            (self.shifted(v, 1, Shift::LeftDWord), self.shifted(v, 31, Shift::RightDWord), cc1)
        } else {
            (self.shifted(v, 1, Shift::RightDWord), v, self.shifted(cc1, 31, Shift::LeftDWord))
        };
        let result = self.b.ins().bor(moved, last);
        self.set_full(result);
        self.set_cc1(|t| {
            let one = t.word(1);
            let out = t.b.ins().band(out, one);
            t.b.ins().ireduce(types::I8, out)
        });
    }
}
