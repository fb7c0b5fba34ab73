//! The registers of the CPU and the status word.

use ob1_ir::StatusBit;

use super::Entry;
use crate::arena::{ArenaByte, Db};

/// `/FC`: a chain of bit logic is under way.
pub const FC: u32 = 1;
/// Result of logic operation.
pub const RLO: u32 = 1 << 1;
/// The bit last scanned or written.
pub const STA: u32 = 1 << 2;
/// Result of the AND in front of an OR.
pub const OR: u32 = 1 << 3;
/// Stored overflow: an OV since it was last reset.
pub const OS: u32 = 1 << 4;
/// Overflow of the last arithmetic statement.
pub const OV: u32 = 1 << 5;
/// Condition code 0 (`A0`).
pub const CC0: u32 = 1 << 6;
/// Condition code 1 (`A1`).
pub const CC1: u32 = 1 << 7;
/// Binary result: how a block tells its caller of success.
pub const BR: u32 = 1 << 8;

/// Accumulators, address and data block registers, status word of the running block.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Regs {
    /// ACCU1, right-aligned for bytes and words.
    pub a1: u32,
    /// ACCU2, the left operand of arithmetic and comparison.
    pub a2: u32,
    /// ACCU3, on an S7-400 alone.
    pub a3: u32,
    /// ACCU4, on an S7-400 alone.
    pub a4: u32,
    /// Address register 1: area pointer of `[AR1,P#x]`.
    pub ar1: u32,
    /// Address register 2: area pointer of `[AR2,P#x]`, and begin of a multi-instance.
    pub ar2: u32,
    /// OS, OV, CC0, CC1 and BR in their places of the status word.
    pub flags: u32,
    /// Result of logic operation.
    pub rlo: bool,
    /// `/FC`: 1 while a chain of logic goes on.
    pub fc: bool,
    /// OR: result of the AND in front of an OR.
    pub or: bool,
    /// STA: the bit last scanned or written.
    pub sta: bool,
    /// Open brackets, eight bits each, the innermost lowest.
    pub nest: u64,
    /// The DB register, set by `AUF DB`.
    pub db: Db,
    /// The DI register, set by `AUF DI` and by a call with an instance.
    pub di: Db,
    /// The running block's local data.
    pub local: ArenaByte,
    /// Length of the local data in bytes.
    pub local_len: u32,
    /// The calling block's local data.
    pub previous_local: ArenaByte,
    /// Length of the caller's local data in bytes.
    pub previous_local_len: u32,
    /// First reference to an actual parameter.
    pub refs: u32,
    /// Master control relay: open brackets as bits below a leading 1, the innermost lowest.
    pub mcr: u32,
    /// `MCRA` is in force.
    pub mcr_active: bool,
}

/// The registers of a block that an error has interrupted. OB 121 and OB 122 find them in their own, as they belong to
/// the same class; they come back unchanged, except for what SFC 44 puts in ACCU1. ["Error Organization Blocks" of
/// Programming with STEP 7]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Interrupted {
    pub(crate) accus: [u32; 4],
    ar1: u32,
    ar2: u32,
    db: Db,
    di: Db,
}

impl Regs {
    /// What an error organization block finds.
    pub(crate) fn interrupted(&self) -> Interrupted {
        let accus = [self.a1, self.a2, self.a3, self.a4];
        Interrupted { accus, ar1: self.ar1, ar2: self.ar2, db: self.db, di: self.di }
    }

    /// The registers of the block that an error has interrupted.
    pub(crate) fn take_over(&mut self, from: &Interrupted) {
        [self.a1, self.a2, self.a3, self.a4] = from.accus;
        (self.ar1, self.ar2, self.db, self.di) = (from.ar1, from.ar2, from.db, from.di);
    }

    /// The registers of a block that is entered from outside the engine.
    #[must_use]
    pub fn new(entry: &Entry, local: ArenaByte, local_len: u32) -> Self {
        Self {
            a1: 0,
            a2: 0,
            a3: 0,
            a4: 0,
            ar1: 0,
            ar2: entry.ar2,
            flags: 0,
            rlo: false,
            fc: false,
            or: false,
            sta: false,
            nest: 0,
            db: entry.db,
            di: entry.di,
            local,
            local_len,
            previous_local: entry.previous_local,
            previous_local_len: entry.previous_local_len,
            refs: entry.refs,
            mcr: 1,
            mcr_active: false,
        }
    }

    /// The status word, as `L STW` loads it.
    pub fn status_word(&self) -> u32 {
        self.flags
            | (u32::from(self.fc) * FC)
            | (u32::from(self.rlo) * RLO)
            | (u32::from(self.sta) * STA)
            | (u32::from(self.or) * OR)
    }

    /// Takes over a status word.
    pub fn set_status_word(&mut self, word: u32) {
        self.fc = word & FC != 0;
        self.rlo = word & RLO != 0;
        self.sta = word & STA != 0;
        self.or = word & OR != 0;
        self.flags = word & (OS | OV | CC0 | CC1 | BR);
    }

    /// A condition of the status word as an operand.
    #[inline]
    pub fn status_bit(&self, bit: StatusBit) -> bool {
        status_bit(self.flags, bit)
    }

    /// The master control relay is off: assignments write 0, `S` and `R` nothing.
    pub fn mcr_off(&self) -> bool {
        self.mcr_active && self.mcr & 1 == 0
    }

    /// Takes over CC1, CC0 and OV of a result; OV also sets OS.
    #[inline]
    pub fn set_cc(&mut self, cc: u32) {
        self.flags = with_cc(self.flags, cc);
    }

    /// A boolean result that begins or continues a chain: FC := 1, OR := 0, STA := RLO.
    #[inline]
    pub fn set_result(&mut self, rlo: bool) {
        self.rlo = rlo;
        self.sta = rlo;
        self.or = false;
        self.fc = true;
    }

    /// The result of `FP` and `FN`. STA is the bit written, as for every statement that writes one: the RLO before it.
    #[inline]
    pub fn set_edge(&mut self, written: bool, rlo: bool) {
        self.set_result(rlo);
        self.sta = written;
    }

    /// Ends a chain of bit logic: FC := 0, OR := 0, STA as given.
    #[inline]
    pub fn end_chain(&mut self, sta: bool) {
        self.fc = false;
        self.or = false;
        self.sta = sta;
    }

    /// SET and CLR: a new RLO, and the end of a chain.
    #[inline]
    pub fn set_rlo(&mut self, rlo: bool) {
        self.rlo = rlo;
        self.end_chain(rlo);
    }

    /// NOT: the RLO becomes its opposite.
    #[inline]
    pub fn invert_rlo(&mut self) {
        self.rlo = !self.rlo;
        self.sta = true;
    }
}

/// `flags` with CC1, CC0, OV of `cc`; OV also sets OS.
#[inline]
pub const fn with_cc(flags: u32, cc: u32) -> u32 {
    flags & (OS | BR) | cc | (cc & OV) >> 1
}

/// A condition of the flags.
#[inline]
pub(crate) const fn status_bit(flags: u32, bit: StatusBit) -> bool {
    let cc = flags & (CC1 | CC0);
    match bit {
        StatusBit::Zero => cc == 0,
        StatusBit::Positive => cc == CC1,
        StatusBit::Negative => cc == CC0,
        StatusBit::NotZero => cc == CC1 || cc == CC0,
        StatusBit::NotNegative => cc == 0 || cc == CC1,
        StatusBit::NotPositive => cc == 0 || cc == CC0,
        StatusBit::Unordered => cc == CC1 | CC0,
        StatusBit::Overflow => flags & OV != 0,
        StatusBit::StoredOverflow => flags & OS != 0,
        StatusBit::BinaryResult => flags & BR != 0,
    }
}
