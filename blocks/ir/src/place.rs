//! Operands: where a statement reads or writes.

use ob1_model::{Area, BitAddr, Width};

/// The two address registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names say it")]
pub enum AddressRegister {
    Ar1,
    Ar2,
}

/// The two data block registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names say it")]
pub enum DbRegister {
    Db,
    Di,
}

/// Where the pointer of a memory-indirect operand lies: `[MD 200]`, `[LW 4]`, `[DBD 8]`, `[DIW 2]`. Always a fixed
/// place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Pointer {
    /// Memory, Local, Db or Di.
    pub area: Area,
    /// Its byte address as a bit address.
    pub at: BitAddr,
}

/// Where an operand lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Place {
    /// A fixed address: `M 1.0`, `DBW 20` (of the opened data block), `PEW 256`, `LB 3`.
    Fixed(Area, BitAddr),
    /// A fully qualified data operand, `DB10.DBW 20`. Opens the data block (DB register), as on the CPU.
    InDb(u16, BitAddr),
    /// A fully qualified data operand of an instance data block, `DI10.DIW 20`. Opens it in the DI register.
    InDi(u16, BitAddr),
    /// A formal parameter of an FC: the reference number `index`, plus an offset for components of composed types.
    Param {
        /// Index among the block's formals.
        index: u16,
        /// Offset into the actual.
        at: BitAddr,
    },
    /// A variable of the FB's instance: relative to the instance's start in its data block (DI register and AR2).
    Instance(BitAddr),
    /// Memory-indirect, `DBW [MD 200]`: the pointer's double word is an area-internal `P#byte.bit`.
    Memory(Area, Pointer),
    /// Register-indirect, `W [AR1,P#2.0]` (area-crossing, `None`) or `DBW [AR1,P#2.0]` (area-internal).
    Register(Option<Area>, AddressRegister, BitAddr),
}

/// A place with the width of the access.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Operand {
    /// Bit, byte, word, double word.
    pub width: Width,
    /// Where the operand lies.
    pub place: Place,
}

/// The number of a timer, counter or block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Number {
    /// A number in the statement: `T 5`.
    Fixed(u16),
    /// `T [MW 20]`: a word holds the number.
    Memory(Pointer),
    /// A formal parameter of the types TIMER, COUNTER, BLOCK_xx of an FC.
    Param(u16),
    /// Such a parameter of an FB: the word in the instance data block holds the number.
    Instance(BitAddr),
}
