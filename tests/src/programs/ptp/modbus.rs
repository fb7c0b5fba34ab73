//! What a Modbus master has to send for a source area. [S4 L1600-L1640]

use super::judge::Expected;

/// The telegram of a source area; `None`: the driver refuses it.
#[must_use]
pub fn request(source: &[u8]) -> Option<Expected> {
    let &[address, function, ref data @ ..] = source else { return None };
    let word = |at: usize| Some(u16::from_be_bytes([*data.get(at)?, *data.get(at + 1)?]));
    let for_all = address == 0;
    let take = |count: usize| data.get(..count).map(|data| [&[address, function], data].concat());
    let bytes = match function {
        // Broadcast only writes. [S4 L634]
        3 | 4 if !for_all && (1..=125).contains(&word(2)?) => take(4)?,
        // The state of a coil is FF00h or 0. [S4 L1800]
        5 if matches!(word(2)?, 0 | 0xFF00) => take(4)?,
        6 => take(4)?,
        8 if !for_all && word(0)? == 0 => take(4)?,
        16 if (1..=123).contains(&word(2)?) => {
            let count = 2 * usize::from(word(2)?);
            let values = data.get(4..4 + count)?;
            // The driver makes the byte counter. [S4 L1638]
            [&[address, function], &data[..4], &[count as u8], values].concat()
        }
        _ => return None,
    };
    Some(Expected { bytes, reads: matches!(function, 3 | 4) })
}
