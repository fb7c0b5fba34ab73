//! The frame of ASCII: `:`, the telegram and its LRC in hexadecimal text, CR, LF.

use super::failure::Failure;

/// Begins a frame at any position.
pub const START: u8 = b':';
/// First of the two end characters.
pub const CR: u8 = 0x0D;
/// Second of the two end characters.
pub const LF: u8 = 0x0A;

/// The LRC: the two's complement of the sum of the bytes.
pub fn lrc(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)).wrapping_neg()
}

/// The value of a hexadecimal digit. Capital letters only: a small letter is a capital one with one wrong bit.
pub const fn digit(character: u8) -> Option<u8> {
    match character {
        b'0'..=b'9' => Some(character - b'0'),
        b'A'..=b'F' => Some(character - b'A' + 10),
        _ => None,
    }
}

/// The byte of a pair of digits, the high one first.
pub fn byte([high, low]: &[u8; 2]) -> Option<u8> {
    Some(digit(*high)? << 4 | digit(*low)?)
}

/// Writes the frame of a telegram; returns its length. `None`: there is no room for it.
pub fn encode(telegram: &[u8], frame: &mut [u8]) -> Option<usize> {
    const DIGITS: &[u8; 16] = b"0123456789ABCDEF";
    let len = 2 * (telegram.len() + 1) + 3;
    let frame = frame.get_mut(..len)?;
    let (start, rest) = frame.split_first_mut()?;
    let (text, end) = rest.split_last_chunk_mut::<2>()?;
    *start = START;
    let check = lrc(telegram);
    for (pair, byte) in text.chunks_exact_mut(2).zip(telegram.iter().chain([&check])) {
        pair[0] = DIGITS[usize::from(byte >> 4)];
        pair[1] = DIGITS[usize::from(byte & 0x0F)];
    }
    *end = [CR, LF];
    Some(len)
}

/// Decodes a frame, from its `:` to its LF, into `telegram`; returns the telegram's length.
///
/// # Errors
/// [`Failure::Start`]: the first character is not `:`. [`Failure::Overflow`]: CR LF is not at the end, or the telegram
/// is longer than `telegram` less one byte. [`Failure::Incomplete`]: half a byte, or not even address, function code
/// and LRC. [`Failure::Fault`]: a character that is not a digit, or a wrong LRC.
pub fn decode(frame: &[u8], telegram: &mut [u8]) -> Result<usize, Failure> {
    let Some((&START, rest)) = frame.split_first() else {
        return Err(if frame.is_empty() { Failure::Incomplete } else { Failure::Start });
    };
    let text = rest.strip_suffix(&[CR, LF]).ok_or(Failure::Overflow)?;
    let (pairs, half) = text.as_chunks::<2>();
    if !half.is_empty() || pairs.len() < 3 {
        return Err(Failure::Incomplete);
    }
    let bytes = telegram.get_mut(..pairs.len()).ok_or(Failure::Overflow)?;
    for (pair, place) in pairs.iter().zip(bytes.iter_mut()) {
        *place = byte(pair).ok_or(Failure::Fault)?;
    }
    // The sum over the telegram and its LRC is 0.
    if lrc(bytes) == 0 { Ok(bytes.len() - 1) } else { Err(Failure::Fault) }
}
