//! The items of reads and writes, by their syntax.

use super::address::{ANY, Address, Area, BadItem, DataType};
use crate::codes::ItemCode;

/// Syntax of several areas of data blocks, as clients of an S7-400 read them.
const AREAS: u8 = 0xB0;
/// Bytes in front of what an item says: its kind, bytes that follow.
const HEAD: usize = 2;

/// What an item names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Item {
    /// A variable, or several in a row.
    Variable(Address),
    /// Areas of data blocks. They are answered together, in one item, each with a code of its own.
    Areas(Vec<Result<Address, BadItem>>),
}

impl Item {
    /// One item, with the two bytes in front of it. Other syntaxes (drives, numeric controls, symbols of an S7-1200)
    /// are not served.
    fn read(item: &[u8]) -> Result<Self, BadItem> {
        match item {
            &[kind, _, AREAS, count, ref rest @ ..] if kind == ANY[0] => match rest.as_chunks() {
                (areas, []) if areas.len() == usize::from(count) && count > 0 => {
                    Ok(Self::Areas(areas.iter().map(|bytes| area(*bytes)).collect()))
                }
                _ => Err(ItemCode::TYPE),
            },
            _ => Address::read(item).map(Self::Variable),
        }
    }
}

/// Number of bytes, data block, first byte.
const fn area([bytes, db_high, db_low, high, low]: [u8; 5]) -> Result<Address, BadItem> {
    if bytes == 0 {
        return Err(ItemCode::ADDRESS);
    }
    Ok(Address {
        area: Area::Db,
        db: u16::from_be_bytes([db_high, db_low]),
        start: u16::from_be_bytes([high, low]) as u32 * 8,
        ty: DataType::Byte,
        count: bytes as u16,
    })
}

/// The items of a job, one after the other. A bad item is reported alone, as long as its end can be found.
#[derive(Clone, Debug)]
pub struct Items<'b> {
    rest: &'b [u8],
    left: usize,
}

impl<'b> Items<'b> {
    /// `count` items in `bytes`.
    #[must_use]
    pub const fn new(bytes: &'b [u8], count: usize) -> Self {
        Self { rest: bytes, left: count }
    }
}

/// `Some(Err(..))` inside: this item is bad. `None` inside: the rest is cut off, and nothing follows.
impl Iterator for Items<'_> {
    type Item = Option<Result<Item, BadItem>>;

    fn next(&mut self) -> Option<Self::Item> {
        self.left = self.left.checked_sub(1)?;
        let item = match self.rest {
            [_, len, ..] => self.rest.get(..HEAD + usize::from(*len)),
            _ => None,
        };
        let Some(item) = item else {
            self.left = 0;
            return Some(None);
        };
        // An item of odd length is followed by a fill byte, except the last.
        let pad = if self.left > 0 { item.len() % 2 } else { 0 };
        self.rest = self.rest.get(item.len() + pad..).unwrap_or_default();
        Some(Some(Item::read(item)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_items_are_padded_and_a_cut_ends_the_row() {
        let mut bytes = vec![0x12, 0x07, 0xB0, 1, 4, 0, 10, 0, 2, 0xEE];
        Address { area: Area::Memory, db: 0, start: 0, ty: DataType::Byte, count: 1 }.write(&mut bytes);
        let items: Vec<_> = Items::new(&bytes, 3).collect();
        assert_eq!(items.len(), 3);
        let area = Address { area: Area::Db, db: 10, start: 16, ty: DataType::Byte, count: 4 };
        assert_eq!(items[0], Some(Ok(Item::Areas(vec![Ok(area)]))));
        assert!(matches!(items[1], Some(Ok(Item::Variable(_)))));
        assert_eq!(items[2], None);
        assert_eq!(Items::new(&[0x12, 200, 1], 255).count(), 1);
    }

    /// Each alone: what comes behind such an item is served.
    #[test]
    fn what_is_no_known_syntax_is_refused_alone() {
        for bad in [
            // Drives, numeric controls, symbols; another kind of item; too short for a syntax.
            &[0x12, 0x0A, 0xA2, 1, 0, 1, 0, 1, 0x84, 0, 0, 0][..],
            &[0x12, 0x08, 0x82, 1, 0, 1, 0, 1, 0, 0],
            &[0x12, 0x08, 0x83, 1, 0, 1, 0, 1, 0, 0],
            &[0x12, 0x08, 0x84, 1, 0, 1, 0, 1, 0, 0],
            &[0x12, 0x0E, 0xB2, 0xFF, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0],
            &[0x11, 0x07, 0xB0, 1, 4, 0, 10, 0, 2],
            &[0x12, 0x01, 0xB0],
            &[0x12, 0x00],
            // Areas: none, fewer than announced, more than announced, half a one.
            &[0x12, 0x02, 0xB0, 0],
            &[0x12, 0x07, 0xB0, 2, 4, 0, 10, 0, 2],
            &[0x12, 0x0C, 0xB0, 1, 4, 0, 10, 0, 2, 4, 0, 10, 0, 2],
            &[0x12, 0x06, 0xB0, 1, 4, 0, 10, 0],
        ] {
            let mut bytes = bad.to_vec();
            bytes.resize(bytes.len().next_multiple_of(2), 0);
            Address { area: Area::Memory, db: 0, start: 0, ty: DataType::Byte, count: 1 }.write(&mut bytes);
            let items: Vec<_> = Items::new(&bytes, 2).collect();
            assert_eq!(items[0], Some(Err(ItemCode::TYPE)), "{bad:02X?}");
            assert!(matches!(items[1], Some(Ok(Item::Variable(_)))), "{bad:02X?}");
        }
    }

    #[test]
    fn an_area_without_bytes_is_an_address_that_is_none() {
        let item = Items::new(&[0x12, 0x0C, 0xB0, 2, 0, 0, 10, 0, 0, 255, 0xFF, 0xFF, 0xFF, 0xFF], 1).next();
        let last = Address { area: Area::Db, db: 0xFFFF, start: 0x7_FFF8, ty: DataType::Byte, count: 255 };
        assert_eq!(item, Some(Some(Ok(Item::Areas(vec![Err(ItemCode::ADDRESS), Ok(last)])))));
    }
}
