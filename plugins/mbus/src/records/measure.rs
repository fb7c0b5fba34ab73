//! The length of a data record, from its DIF and VIF only. A record longer than the received data is not returned.

/// Maximum number of DIFEs and of VIFEs of a record. [EN 13757-3]
const EXTENSIONS_MAX: usize = 10;

/// The lengths of the parts of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// DIF, VIF, their extensions, and the text of a VIF.
    pub head: usize,
    /// The LVAR byte of data of variable length.
    pub lvar: usize,
    /// Bytes of the data, after DIF, VIF and LVAR.
    pub data: usize,
}

impl Extent {
    /// Length of the whole record.
    pub fn bytes(self) -> usize {
        self.head + self.lvar + self.data
    }
}

/// Measures the record at the beginning of `bytes`; its DIF is not one of the special functions (xFh).
pub fn measure(bytes: &[u8]) -> Option<Extent> {
    let dif = *bytes.first()?;
    let at = chain(bytes, 0)?;
    let vif = *bytes.get(at)?;
    let head = if vif & 0x7F == 0x7C {
        // The unit as text: length and characters are between the VIF and its extensions, as meters send it.
        let behind = at + 2 + usize::from(*bytes.get(at + 1)?);
        if vif & 0x80 == 0 { behind } else { chain(bytes, behind)? }
    } else {
        chain(bytes, at)?
    };
    let (lvar, data) = match dif & 0xF {
        0x0 | 0x8 => (0, 0),
        0x1 | 0x9 => (0, 1),
        0x2 | 0xA => (0, 2),
        0x3 | 0xB => (0, 3),
        0x4 | 0x5 | 0xC => (0, 4),
        0x6 | 0xE => (0, 6),
        0x7 => (0, 8),
        _ => (1, variable_length(*bytes.get(head)?)?),
    };
    let extent = Extent { head, lvar, data };
    (extent.bytes() <= bytes.len()).then_some(extent)
}

/// The position after a chain that begins at `from`: each byte with bit 7 set is followed by another one.
fn chain(bytes: &[u8], from: usize) -> Option<usize> {
    let length = bytes.get(from..)?.iter().take(1 + EXTENSIONS_MAX).position(|byte| byte & 0x80 == 0)?;
    Some(from + length + 1)
}

/// The length given by an LVAR byte, in bytes. [EN 13757-3 "Variable length"]
fn variable_length(lvar: u8) -> Option<usize> {
    let n = usize::from(lvar);
    match lvar {
        0x00..=0xBF => Some(n),
        0xC0..=0xC9 | 0xD0..=0xD9 => Some(n & 0xF),
        // A number of zero bytes is not valid.
        0xE1..=0xEF => Some(n & 0xF),
        0xF0..=0xF4 => Some(4 * (n - 0xEC)),
        0xF5 => Some(48),
        0xF6 => Some(64),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::{Extent, measure};

    type Case = (&'static [u8], Option<(usize, usize, usize)>);

    #[test]
    fn extents() {
        let cases: &[Case] = &[
            (&[0x03, 0x13, 0x15, 0x31, 0x00, 0xFF], Some((2, 0, 3))),
            (&[0xDA, 0x02, 0x3B, 0x13, 0x01], Some((3, 0, 2))),
            (&[0x8B, 0x60, 0x04, 0x37, 0x18, 0x02], Some((3, 0, 3))),
            (&[0x02, 0xFC, 0x03, 0x48, 0x52, 0x25, 0x74, 0xD4, 0x11], Some((7, 0, 2))),
            (&[0x02, 0x7C, 0x03, 0x48, 0x52, 0x25, 0xD4, 0x11], Some((6, 0, 2))),
            (&[0x0D, 0xFD, 0x11, 0x02, 0x41, 0x42], Some((3, 1, 2))),
            (&[0x0D, 0x06, 0x00], Some((2, 1, 0))),
            (&[0x0D, 0x06, 0xE0], None),
            (&[0x0D, 0x06, 0xFF], None),
            // Truncated: in the data, the DIFEs, the VIFEs, the text; without a VIF.
            (&[0x03, 0x13, 0x15, 0x31], None),
            (&[0x8B, 0x80], None),
            (&[0x8B, 0x60, 0xC3], None),
            (&[0x02, 0xFC, 0x03, 0x48], None),
            (&[0x02, 0xFC, 0xF3, 0x48, 0x52, 0x25, 0x74, 0xB4], None),
            (&[0x01], None),
            (&[], None),
            // Eleven DIFEs.
            (&[0x8B, 0x8B, 0x8B, 0x8B, 0x8B, 0x8B, 0x8B, 0x8B, 0x8B, 0x8B, 0x8B, 0x60, 0x04, 0, 0, 0], None),
        ];
        for (bytes, expected) in cases {
            let expected = expected.map(|(head, lvar, data)| Extent { head, lvar, data });
            assert_eq!(measure(bytes), expected, "{bytes:02X?}");
        }
    }
}
