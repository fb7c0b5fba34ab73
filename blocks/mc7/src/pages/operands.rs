//! What the pages have in common: areas, addresses, registers and parameters as the machine writes them.

use ob1_ir::{AddressRegister, Number, Place, Pointer};
use ob1_model::{Area, BitAddr};

/// The code of an area in a nibble; 0 is the periphery.
pub(super) fn area_code(area: Area) -> Option<u8> {
    (area != Area::PreviousLocal).then_some(area.pointer_code() & 0x0F)
}

/// The area of a nibble.
pub(super) fn area(code: u8) -> Option<Area> {
    Area::from_pointer_code(0x80 | code).filter(|area| *area != Area::PreviousLocal)
}

/// The area of a bit operand: as [`area`], the periphery has no bits.
pub(super) fn bit_area(code: u8) -> Option<Area> {
    area(code).filter(|a| *a != Area::Peripheral)
}

/// The place of a pointer or number in memory, whose code is 3 to 6.
pub(super) fn pointer(code: u8, byte: u16) -> Option<Pointer> {
    let area = area(code).filter(|_| code >= 3)?;
    Some(Pointer { area, at: BitAddr::byte_addr(u32::from(byte)) })
}

/// The code and byte address of a pointer's place.
pub(super) fn pointer_code(pointer: Pointer) -> Option<(u8, u16)> {
    let code = area_code(pointer.area).filter(|code| *code >= 3)?;
    Some((code, whole_byte(pointer.at)?))
}

/// A byte address that a word operand holds.
pub(super) fn whole_byte(at: BitAddr) -> Option<u16> {
    if at.bit() == 0 { u16::try_from(at.byte()).ok() } else { None }
}

/// A register-indirect offset: 16 bits of bit address.
pub(super) fn offset(at: BitAddr) -> Option<u16> {
    u16::try_from(at.0).ok()
}

/// 0 for AR1, 8 for AR2, as the second byte has it.
pub(super) const fn register_bit(register: AddressRegister) -> u8 {
    match register {
        AddressRegister::Ar1 => 0,
        AddressRegister::Ar2 => 8,
    }
}

/// The register of that bit.
pub(super) const fn register(code: u8) -> AddressRegister {
    if code & 8 == 0 { AddressRegister::Ar1 } else { AddressRegister::Ar2 }
}

/// A formal parameter by its word offset in the caller's list: the first is 2, the second 4. The index counts from 0 in
/// the order of the list.
pub(super) fn param(word: u16) -> Option<u16> {
    (word >= 2 && word.is_multiple_of(2)).then(|| word / 2 - 1)
}

/// The word offset of a parameter.
pub(super) fn param_word(index: u16) -> Option<u16> {
    index.checked_add(1)?.checked_mul(2)
}

/// A whole formal parameter as a place.
pub(super) fn param_place(word: u16) -> Option<Place> {
    Some(Place::Param { index: param(word)?, at: BitAddr(0) })
}

/// The parameter number of a word, as a number.
pub(super) fn param_number(word: u16) -> Option<Number> {
    param(word).map(Number::Param)
}
