//! Cells of the arena. Places are checked before; outside of the arena, reads give 0 and writes do nothing.

use crate::arena::ArenaByte;

#[inline(always)]
pub(super) fn word(bytes: &[u8], at: ArenaByte) -> u32 {
    let at = at.index();
    bytes.get(at..at + 2).map_or(0, |b| u32::from(u16::from_be_bytes([b[0], b[1]])))
}

#[inline(always)]
pub(super) fn dword(bytes: &[u8], at: ArenaByte) -> u32 {
    let at = at.index();
    bytes.get(at..at + 4).map_or(0, |b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]))
}

#[inline(always)]
pub(super) fn put_word(bytes: &mut [u8], at: ArenaByte, value: u32) {
    let at = at.index();
    if let Some(b) = bytes.get_mut(at..at + 2) {
        b.copy_from_slice(&(value as u16).to_be_bytes());
    }
}

#[inline(always)]
pub(super) fn put_dword(bytes: &mut [u8], at: ArenaByte, value: u32) {
    let at = at.index();
    if let Some(b) = bytes.get_mut(at..at + 4) {
        b.copy_from_slice(&value.to_be_bytes());
    }
}

#[inline(always)]
pub(super) fn byte(bytes: &[u8], at: ArenaByte) -> u8 {
    bytes.get(at.index()).copied().unwrap_or(0)
}

#[inline(always)]
pub(super) fn put_bit(bytes: &mut [u8], at: ArenaByte, mask: u8, value: bool) {
    if let Some(b) = bytes.get_mut(at.index()) {
        *b = if value { *b | mask } else { *b & !mask };
    }
}

#[inline(always)]
pub(super) fn put_byte(bytes: &mut [u8], at: ArenaByte, value: u32) {
    if let Some(b) = bytes.get_mut(at.index()) {
        *b = value as u8;
    }
}

/// 8, 16 or 32 bits.
#[inline(always)]
pub(super) fn get(bytes: &[u8], bits: u8, at: ArenaByte) -> u32 {
    match bits {
        8 => u32::from(byte(bytes, at)),
        16 => word(bytes, at),
        _ => dword(bytes, at),
    }
}

/// 8, 16 or 32 bits.
#[inline(always)]
pub(super) fn put(bytes: &mut [u8], bits: u8, at: ArenaByte, value: u32) {
    match bits {
        8 => put_byte(bytes, at, value),
        16 => put_word(bytes, at, value),
        _ => put_dword(bytes, at, value),
    }
}
