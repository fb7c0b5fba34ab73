//! Big-endian cells in a byte slice: an S7 stores the high byte at the low address.
//!
//! Every function returns `None` when the cell does not lie wholly inside the slice.

/// Reads 1, 2 or 4 bytes as an unsigned number.
#[inline]
pub fn get(memory: &[u8], at: usize, width: usize) -> Option<u32> {
    match width {
        1 => memory.get(at).map(|b| u32::from(*b)),
        2 => word(memory, at).map(u32::from),
        4 => dword(memory, at),
        _ => None,
    }
}

/// Writes 1, 2 or 4 bytes of a number; the higher bytes of `value` are dropped.
#[must_use]
#[inline]
pub fn set(memory: &mut [u8], at: usize, width: usize, value: u32) -> Option<()> {
    let bytes = value.to_be_bytes();
    let skip = 4usize.checked_sub(width)?;
    let target = memory.get_mut(at..at.checked_add(width)?)?;
    target.copy_from_slice(bytes.get(skip..)?);
    Some(())
}

/// Reads a word, high byte first.
#[inline]
pub fn word(memory: &[u8], at: usize) -> Option<u16> {
    let bytes = memory.get(at..at.checked_add(2)?)?;
    Some(u16::from_be_bytes([bytes[0], bytes[1]]))
}

/// Reads a double word.
#[inline]
pub fn dword(memory: &[u8], at: usize) -> Option<u32> {
    let bytes = memory.get(at..at.checked_add(4)?)?;
    Some(u32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
}

/// Reads a bit; `bit` is byte * 8 + bit.
#[inline]
pub fn bit(memory: &[u8], bit: usize) -> Option<bool> {
    memory.get(bit / 8).map(|b| b >> (bit % 8) & 1 == 1)
}

/// Writes a bit; `bit` is byte * 8 + bit.
#[must_use]
#[inline]
pub fn set_bit(memory: &mut [u8], bit: usize, value: bool) -> Option<()> {
    let byte = memory.get_mut(bit / 8)?;
    let mask = 1u8 << (bit % 8);
    *byte = if value { *byte | mask } else { *byte & !mask };
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn high_byte_first() {
        let mut memory = [0u8; 6];
        assert_eq!(set(&mut memory, 1, 2, 0x1_1234), Some(()));
        assert_eq!(memory, [0, 0x12, 0x34, 0, 0, 0]);
        assert_eq!(get(&memory, 1, 4), Some(0x1234_0000));
        assert_eq!(word(&memory, 1), Some(0x1234));
    }

    #[test]
    fn outside_is_none_and_changes_nothing() {
        let mut memory = [7u8; 3];
        assert_eq!(get(&memory, 0, 4), None);
        assert_eq!(set(&mut memory, 2, 2, 0), None);
        assert_eq!(get(&memory, usize::MAX, 2), None);
        assert_eq!(set(&mut memory, 0, 5, 0), None);
        assert_eq!(bit(&memory, 24), None);
        assert_eq!(set_bit(&mut memory, 24, true), None);
        assert_eq!(memory, [7; 3]);
    }

    #[test]
    fn bits() {
        let mut memory = [0u8; 2];
        assert_eq!(set_bit(&mut memory, 11, true), Some(()));
        assert_eq!(memory, [0, 8]);
        assert_eq!(bit(&memory, 11), Some(true));
        assert_eq!(set_bit(&mut memory, 11, false), Some(()));
        assert_eq!(memory, [0, 0]);
    }
}
