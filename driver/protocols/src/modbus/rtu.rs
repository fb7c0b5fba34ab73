//! The frame of RTU: the telegram and its CRC, low byte first.

use super::failure::Failure;

/// The CRC before the first byte.
pub const CRC_START: u16 = 0xFFFF;

/// Table of the CRC, polynomial A001h (8005h with its bits reversed).
const TABLE: [u16; 256] = {
    let mut table = [0; 256];
    let mut n = 0;
    while n < 256 {
        let mut crc = n as u16;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xA001 } else { crc >> 1 };
            bit += 1;
        }
        table[n] = crc;
        n += 1;
    }
    table
};

/// The CRC extended by one byte. Over a whole frame, its two check bytes included, it is 0.
pub const fn crc_push(crc: u16, byte: u8) -> u16 {
    (crc >> 8) ^ TABLE[((crc ^ byte as u16) & 0xFF) as usize]
}

/// The CRC of these bytes.
pub fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(CRC_START, |crc, byte| crc_push(crc, *byte))
}

/// Writes telegram and CRC; returns the length. `None`: there is no room for it.
pub fn encode(telegram: &[u8], frame: &mut [u8]) -> Option<usize> {
    let len = telegram.len() + 2;
    let (body, check) = frame.get_mut(..len)?.split_at_mut(telegram.len());
    body.copy_from_slice(telegram);
    check.copy_from_slice(&crc(telegram).to_le_bytes());
    Some(len)
}

/// The telegram in a frame.
///
/// # Errors
/// [`Failure::Incomplete`] for a frame without address, function code and CRC, [`Failure::Fault`] for a wrong CRC.
pub fn decode(frame: &[u8]) -> Result<&[u8], Failure> {
    let Some((telegram, check)) = frame.split_last_chunk::<2>().filter(|(telegram, _)| telegram.len() >= 2) else {
        return Err(Failure::Incomplete);
    };
    if crc(telegram) == u16::from_le_bytes(*check) { Ok(telegram) } else { Err(Failure::Fault) }
}
