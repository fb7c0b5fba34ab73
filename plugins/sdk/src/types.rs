//! The data types of parameters and instance variables: a marker for each S7 type, with the Rust type of its value.

use crate::abi::ty;

/// A type a parameter can have.
pub trait S7Type {
    /// The type's number in the interface.
    const TY: u8;
    /// Length of `STRING` and of opaque instance data, else 0.
    const LENGTH: u16 = 0;
}

/// A type whose value fits 32 bits.
pub trait Elementary: S7Type {
    /// The Rust type a block sees.
    type Value: Copy;
    /// Converts the raw number of the interface to the value.
    fn from_raw(raw: u32) -> Self::Value;
    /// Converts the value to the raw number of the interface.
    fn to_raw(value: Self::Value) -> u32;
}

macro_rules! elementary {
    ($($(#[$doc:meta])* $name:ident = $code:ident: $value:ty, |$raw:ident| $from:expr, |$v:ident| $to:expr;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $name;

        impl $name {
            /// The number of a value, for initial values of instance data.
            #[must_use]
            pub const fn raw($v: $value) -> u32 {
                $to
            }
        }

        impl S7Type for $name {
            const TY: u8 = ty::$code;
        }

        impl Elementary for $name {
            type Value = $value;
            #[inline]
            fn from_raw($raw: u32) -> $value {
                $from
            }
            #[inline]
            fn to_raw(value: $value) -> u32 {
                Self::raw(value)
            }
        }
    )*};
}

elementary! {
    /// `BOOL`, a single bit.
    Bool = BOOL: bool, |raw| raw != 0, |v| v as u32;
    /// `BYTE`, eight bits without a meaning.
    Byte = BYTE: u8, |raw| raw as u8, |v| v as u32;
    /// `CHAR`, in the controller's code page.
    Char = CHAR: u8, |raw| raw as u8, |v| v as u32;
    /// `WORD`, 16 bits without a meaning.
    Word = WORD: u16, |raw| raw as u16, |v| v as u32;
    /// `INT`, 16 bits with sign.
    Int = INT: i16, |raw| raw as i16, |v| v as u16 as u32;
    /// `DWORD`, 32 bits without a meaning.
    DWord = DWORD: u32, |raw| raw, |v| v;
    /// `DINT`, 32 bits with sign.
    DInt = DINT: i32, |raw| raw as i32, |v| v as u32;
    /// `REAL`, IEEE 754 of 32 bits.
    Real = REAL: f32, |raw| f32::from_bits(raw), |v| v.to_bits();
    /// `S5TIME`: base and three BCD digits, as it is in a timer.
    S5Time = S5TIME: u16, |raw| raw as u16, |v| v as u32;
    /// `TIME` in milliseconds, with sign.
    Time = TIME: i32, |raw| raw as i32, |v| v as u32;
    /// `DATE` in days since 1990-01-01.
    Date = DATE: u16, |raw| raw as u16, |v| v as u32;
    /// `TIME_OF_DAY` in milliseconds since midnight.
    TimeOfDay = TIME_OF_DAY: u32, |raw| raw, |v| v;
    /// A data block's number.
    BlockDb = BLOCK_DB: u16, |raw| raw as u16, |v| v as u32;
    /// A function block's number.
    BlockFb = BLOCK_FB: u16, |raw| raw as u16, |v| v as u32;
    /// Number of a function (FC).
    BlockFc = BLOCK_FC: u16, |raw| raw as u16, |v| v as u32;
    /// Number of a timer (T).
    Timer = TIMER: u16, |raw| raw as u16, |v| v as u32;
    /// Number of a counter (C, Z).
    Counter = COUNTER: u16, |raw| raw as u16, |v| v as u32;
    /// A timer's number, given as a timer (`T2`) or as a WORD.
    TimerOrWord = TIMER_OR_WORD: u16, |raw| raw as u16, |v| v as u32;
}

macro_rules! composed {
    ($($(#[$doc:meta])* $name:ident = $code:ident;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $name;

        impl S7Type for $name {
            const TY: u8 = ty::$code;
        }
    )*};
}

composed! {
    /// `DATE_AND_TIME`: 8 bytes BCD.
    DateAndTime = DATE_AND_TIME;
    /// `POINTER`, 6 bytes: data block and area pointer.
    Pointer = POINTER;
    /// `ANY`, 10 bytes: type, count, data block and area pointer.
    Any = ANY;
}

/// `STRING[N]`, N from 1 to 254: maximum length, length, characters.
#[derive(Clone, Copy, Debug)]
pub struct Str<const N: u16>;

impl<const N: u16> S7Type for Str<N> {
    const TY: u8 = ty::STRING;
    const LENGTH: u16 = {
        assert!(N >= 1 && N <= 254, "STRING[n] has 1 to 254 characters");
        N
    };
}

/// N opaque bytes of instance data.
#[derive(Clone, Copy, Debug)]
pub struct Bytes<const N: u16>;

impl<const N: u16> S7Type for Bytes<N> {
    const TY: u8 = ty::BYTES;
    const LENGTH: u16 = {
        assert!(N >= 1, "no bytes are no variable");
        N
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_survive_the_edge() {
        assert_eq!(Int::to_raw(-2), 0xFFFE);
        assert_eq!(Int::from_raw(0xFFFE), -2);
        assert_eq!(DInt::from_raw(DInt::to_raw(i32::MIN)), i32::MIN);
        assert_eq!(Real::from_raw(Real::to_raw(-0.5)), -0.5);
        assert!(Bool::from_raw(Bool::to_raw(true)));
        assert_eq!(Byte::from_raw(0x1FF), 0xFF);
    }
}
