//! How a constant is written.

/// The form a constant is best shown in. Machine code keeps it beside the value; for execution it means nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Notation {
    /// `B#16#FF`.
    Byte,
    /// `W#16#FFFF`.
    Word,
    /// `DW#16#FFFFFFFF`.
    DWord,
    /// `2#1010`.
    Binary,
    /// `-5`.
    Int,
    /// `L#-5`.
    DInt,
    /// `1.5e+000`.
    Real,
    /// `'AB'`.
    Text,
    /// `B#(1,2)` or `B#(1,2,3,4)`.
    Bytes,
    /// `C#127`.
    Count,
    /// `D#1994-3-15`.
    Date,
    /// `S5T#2S`.
    S5Time,
    /// `T#2S`.
    Time,
    /// `TOD#12:30:0.0`.
    TimeOfDay,
    /// `P#M 1.0`.
    Pointer,
}
