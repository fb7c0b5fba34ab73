//! Places in memory that a POINTER names, and the elements of a table there.

use ob1_model::{Area, BitAddr};

use crate::Refused;
use crate::call::Call;
use crate::declare::Params;

/// A place in memory that a POINTER names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) area: Area,
    pub(super) db: u16,
    pub(super) at: BitAddr,
}

impl Place {
    /// What a parameter of type POINTER names; `None` for an unknown area.
    pub(super) fn of(call: &mut Call<'_>, p: impl Params) -> Option<Self> {
        let mut bytes = [0; 6];
        call.cx.read(p.index(), 0, &mut bytes).ok()?;
        let [db_high, db_low, area, high, middle, low] = bytes;
        Some(Self {
            area: Area::from_pointer_code(area)?,
            db: u16::from_be_bytes([db_high, db_low]),
            at: BitAddr(u32::from_be_bytes([0, high, middle, low]) & 0x7_FFFF),
        })
    }

    pub(super) fn read(self, call: &mut Call<'_>, byte: u32, into: &mut [u8]) -> Result<(), Refused> {
        call.cx.pointer_read(self.area, self.db, self.at.byte() + byte, into)
    }

    pub(super) fn write(self, call: &mut Call<'_>, byte: u32, from: &[u8]) -> Result<(), Refused> {
        call.cx.pointer_write(self.area, self.db, self.at.byte() + byte, from)
    }

    pub(super) fn word(self, call: &mut Call<'_>, byte: u32) -> Result<u16, Refused> {
        let mut bytes = [0; 2];
        self.read(call, byte, &mut bytes)?;
        Ok(u16::from_be_bytes(bytes))
    }
}

/// The type of a table's entries (E_TYPE).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Element {
    Byte,
    Word,
    Int,
    DWord,
    DInt,
    Real,
}

impl Element {
    pub(super) const fn of(code: u8) -> Option<Self> {
        Some(match code {
            2 => Element::Byte,
            4 => Element::Word,
            5 => Element::Int,
            6 => Element::DWord,
            7 => Element::DInt,
            8 => Element::Real,
            _ => return None,
        })
    }

    pub(super) const fn bytes(self) -> u32 {
        match self {
            Element::Byte => 1,
            Element::Word | Element::Int => 2,
            Element::DWord | Element::DInt | Element::Real => 4,
        }
    }

    /// The bits of an element at a byte offset from a place, right-aligned.
    pub(super) fn get(self, call: &mut Call<'_>, place: Place, byte: u32) -> Result<u32, Refused> {
        let mut bytes = [0; 4];
        place.read(call, byte, &mut bytes[4 - self.bytes() as usize..])?;
        Ok(u32::from_be_bytes(bytes))
    }

    pub(super) fn put(self, call: &mut Call<'_>, place: Place, byte: u32, value: u32) -> Result<(), Refused> {
        place.write(call, byte, &value.to_be_bytes()[4 - self.bytes() as usize..])
    }

    /// The byte of entry `number` (from 1) of a table that begins with its length.
    pub(super) const fn entry(self, number: u32) -> u32 {
        2 + (number - 1) * self.bytes()
    }

    /// The value of a number type.
    pub(super) fn value(self, bits: u32) -> f64 {
        match self {
            Element::Int => f64::from(bits as u16 as i16),
            Element::DInt => f64::from(bits as i32),
            Element::Real => f64::from(f32::from_bits(bits)),
            Element::Byte | Element::Word | Element::DWord => f64::from(bits),
        }
    }

    /// Bits of a value; what does not fit becomes the nearest that does.
    pub(super) fn bits_of(self, value: f64) -> u32 {
        match self {
            Element::Int => u32::from(value.round_ties_even() as i16 as u16),
            Element::DInt => value.round_ties_even() as i32 as u32,
            Element::Real => (value as f32).to_bits(),
            Element::Byte | Element::Word | Element::DWord => value as u32,
        }
    }
}
