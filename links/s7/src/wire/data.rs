//! Data of variables in a telegram: code, transport size, length, bytes; padded to an even length, except the last.

use super::address::DataType;
use crate::codes::ItemCode;

/// Transport sizes of data: how the length is counted.
const BITS: u8 = 0x03;
const BYTES_IN_BITS: u8 = 0x04;
const INTEGER_IN_BITS: u8 = 0x05;
const OCTETS: [u8; 4] = [0x06, REAL, OCTET, 0x00];
const REAL: u8 = 0x07;
/// Counted in bytes, as data of user data are, too.
pub(crate) const OCTET: u8 = 0x09;

/// The transport size of a type in an answer.
#[must_use]
pub const fn transport_of(ty: DataType) -> u8 {
    match ty {
        DataType::Bit => BITS,
        DataType::Real => REAL,
        DataType::Counter | DataType::Timer | DataType::DateAndTime => OCTET,
        _ => BYTES_IN_BITS,
    }
}

/// The number of bytes that `length` means; `None` for an unknown transport size.
#[must_use]
pub fn bytes_of(transport: u8, length: u16) -> Option<usize> {
    match transport {
        BITS | BYTES_IN_BITS | INTEGER_IN_BITS => Some(usize::from(length).div_ceil(8)),
        octets if OCTETS.contains(&octets) => Some(usize::from(length)),
        _ => None,
    }
}

/// Appends an item with its data.
pub fn write_item(out: &mut Vec<u8>, code: ItemCode, ty: DataType, bytes: &[u8]) {
    pad(out);
    let transport = transport_of(ty);
    let length = match transport {
        BITS => 1,
        BYTES_IN_BITS => bytes.len() * 8,
        _ => bytes.len(),
    };
    out.extend_from_slice(&[code.0, transport]);
    out.extend_from_slice(&(length as u16).to_be_bytes());
    out.extend_from_slice(bytes);
}

/// Appends an item without data.
pub fn write_refused(out: &mut Vec<u8>, code: ItemCode) {
    pad(out);
    out.extend_from_slice(&[code.0, 0, 0, 0]);
}

/// Appends an item of several areas: each has its code and, if it is done, its bytes, without padding.
pub fn write_areas<'v>(out: &mut Vec<u8>, areas: impl Iterator<Item = Result<&'v [u8], ItemCode>>) {
    pad(out);
    out.extend_from_slice(&[ItemCode::DONE.0, OCTET, 0, 0]);
    let begin = out.len();
    for area in areas {
        match area {
            Ok(bytes) => {
                out.push(ItemCode::DONE.0);
                out.extend_from_slice(bytes);
            }
            Err(code) => out.push(code.0),
        }
    }
    let length = ((out.len() - begin) as u16).to_be_bytes();
    if let Some(place) = out.get_mut(begin - length.len()..begin) {
        place.copy_from_slice(&length);
    }
}

/// Pads to an even length.
fn pad(out: &mut Vec<u8>) {
    if !out.len().is_multiple_of(2) {
        out.push(0);
    }
}

/// The data of one item of a read or write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataItem<'b> {
    /// Its outcome; 0 in a write.
    pub code: ItemCode,
    /// How its length was counted.
    pub transport: u8,
    /// The data, without padding.
    pub bytes: &'b [u8],
}

impl DataItem<'_> {
    /// Whether these are data of an address of this type and length.
    #[must_use]
    pub fn fits(&self, ty: DataType, bytes: usize) -> bool {
        self.bytes.len() == bytes && (self.transport == BITS) == (ty == DataType::Bit)
    }
}

/// The data of items, one after the other; `None` inside: the rest is cut off.
#[derive(Clone, Debug)]
pub struct DataItems<'b> {
    rest: &'b [u8],
    ended: bool,
}

impl<'b> DataItems<'b> {
    /// The items in the data of a telegram.
    #[must_use]
    pub const fn new(data: &'b [u8]) -> Self {
        Self { rest: data, ended: false }
    }
}

impl<'b> Iterator for DataItems<'b> {
    type Item = Option<DataItem<'b>>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let item = self.rest.split_first_chunk::<4>().and_then(|(&[code, transport, high, low], rest)| {
            let len = bytes_of(transport, u16::from_be_bytes([high, low]))?;
            Some((DataItem { code: ItemCode(code), transport, bytes: rest.get(..len)? }, 4 + len))
        });
        let Some((item, len)) = item else {
            self.ended = true;
            return Some(None);
        };
        self.rest = self.rest.get(len + len % 2..).unwrap_or_default();
        Some(Some(item))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_padded_but_for_the_last() {
        let mut out = Vec::new();
        write_item(&mut out, ItemCode::DONE, DataType::Bit, &[1]);
        write_item(&mut out, ItemCode::DONE, DataType::Byte, &[1, 2, 3]);
        write_refused(&mut out, ItemCode::ADDRESS);
        write_item(&mut out, ItemCode::DONE, DataType::Real, &[0x3F, 0x80, 0, 0]);
        write_item(&mut out, ItemCode::DONE, DataType::Byte, &[7]);
        assert_eq!(
            out,
            [
                0xFF, 3, 0, 1, 1, 0, 0xFF, 4, 0, 24, 1, 2, 3, 0, 5, 0, 0, 0, 0xFF, 7, 0, 4, 0x3F, 0x80, 0, 0, 0xFF, 4,
                0, 8, 7
            ]
        );
        let items: Vec<_> = DataItems::new(&out).take(5).collect();
        let bytes: Vec<_> = items.iter().map(|item| item.expect("all are whole").bytes.to_vec()).collect();
        assert_eq!(bytes, [vec![1], vec![1, 2, 3], vec![], vec![0x3F, 0x80, 0, 0], vec![7]]);
    }

    #[test]
    fn what_is_cut_off_ends_the_row() {
        assert_eq!(DataItems::new(&[0, 4, 0, 16, 1]).collect::<Vec<_>>(), [None]);
        assert_eq!(DataItems::new(&[0, 0x55, 0, 1, 1]).collect::<Vec<_>>(), [None]);
        let bit = DataItem { code: ItemCode(0), transport: 3, bytes: &[1] };
        assert!(bit.fits(DataType::Bit, 1) && !bit.fits(DataType::Byte, 1) && !bit.fits(DataType::Bit, 2));
    }
}
