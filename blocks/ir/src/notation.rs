//! How a constant is written.

/// The form a constant is best shown in. Machine code keeps it beside the value; for execution it means nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Notation {
    /// A byte in hexadecimal: `B#16#FF`.
    Byte,
    /// A word in hexadecimal: `W#16#FFFF`.
    Word,
    /// A double word in hexadecimal: `DW#16#FFFFFFFF`.
    DWord,
    /// Bits, as many as needed: `2#1010`.
    Binary,
    /// A decimal number of 16 bits: `-5`.
    Int,
    /// A decimal number of 32 bits: `L#-5`.
    DInt,
    /// A floating-point number: `1.5e+000`.
    Real,
    /// One to four characters: `'AB'`.
    Text,
    /// Two or four decimal bytes: `B#(1,2)` or `B#(1,2,3,4)`.
    Bytes,
    /// A count value in BCD: `C#127`.
    Count,
    /// A date, in days: `D#1994-3-15`.
    Date,
    /// A time in BCD with its base: `S5T#2S`.
    S5Time,
    /// A time in milliseconds: `T#2S`.
    Time,
    /// A time of day in milliseconds: `TOD#12:30:0.0`.
    TimeOfDay,
    /// An area pointer: `P#M 1.0`.
    Pointer,
}
