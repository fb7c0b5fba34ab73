//! Addresses of S7 communication and cells of the CPU, kinds of blocks.

use ob1_access::door::Refusal;
use ob1_model::{Area as Place, BlockKind, Cell, CellError, Forced, ForcedArea, Piece, Put, Width};
use ob1_s7::codes::ItemCode;
use ob1_s7::server;
use ob1_s7::wire::{Address, Area, BlockType, DataType};

/// The first cell of an address.
fn cell(address: &Address) -> Cell {
    let bit = address.start;
    match address.area {
        Area::Peripheral => Cell::Peripheral(bit),
        Area::Inputs => Cell::Area(Place::Input, bit),
        Area::Outputs => Cell::Area(Place::Output, bit),
        Area::Memory => Cell::Area(Place::Memory, bit),
        Area::Db => Cell::Db(address.db, bit),
        Area::Counters => Cell::Counter(bit as u16),
        Area::Timers => Cell::Timer(bit as u16),
    }
}

/// Width and number of elements, if each is a separate value: modules, timers, counters.
fn single(address: &Address) -> Option<(Width, u32)> {
    let count = u32::from(address.count);
    match (address.area, address.ty.bytes()) {
        (Area::Counters | Area::Timers, _) => Some((Width::Word, count)),
        (Area::Peripheral, 2) => Some((Width::Word, count)),
        (Area::Peripheral, 4) => Some((Width::DWord, count)),
        (Area::Peripheral, bytes) => Some((Width::Byte, count * bytes)),
        _ => None,
    }
}

/// The n-th element of an address.
fn element(address: &Address, width: Width, index: u32) -> Cell {
    match cell(address) {
        Cell::Counter(first) => Cell::Counter(first.saturating_add(index as u16)),
        Cell::Timer(first) => Cell::Timer(first.saturating_add(index as u16)),
        other => other.at_bit(other.bit() / 8 * 8 + index * u32::from(width.bits())),
    }
}

/// The pieces of all addresses, one after the other.
pub(crate) fn pieces(addresses: &[Address]) -> Vec<Piece> {
    let mut pieces = Vec::with_capacity(addresses.len());
    for address in addresses {
        match single(address) {
            Some((width, count)) => {
                pieces.extend((0..count).map(|index| Piece::Value(element(address, width, index), width)));
            }
            None => {
                let at = cell(address);
                pieces.push(Piece::Bytes { at: at.at_bit(at.bit() / 8 * 8), len: address.bytes() as u32 });
            }
        }
    }
    pieces
}

/// The values of all addresses, from what their pieces have given, one after the other.
pub(crate) fn values<'p>(
    addresses: &[Address],
    next: &mut dyn FnMut() -> Result<&'p [u8], Refusal>,
) -> Vec<Result<Vec<u8>, ItemCode>> {
    let mut piece = || next().map_err(code);
    let mut of = |address: &Address| {
        let Some((_, count)) = single(address) else {
            let bytes = piece()?;
            let is_bit = address.ty == DataType::Bit;
            let bit = |byte: &u8| byte >> (address.start % 8) & 1;
            return Ok(if is_bit { bytes.iter().map(bit).collect() } else { bytes.to_vec() });
        };
        // All pieces are consumed, even after a missing one.
        let all: Vec<Result<&[u8], ItemCode>> = (0..count).map(|_| piece()).collect();
        let mut bytes = Vec::with_capacity(address.bytes());
        for piece in all {
            let piece = piece?;
            match address.area {
                Area::Counters => bytes.extend_from_slice(&to_bcd(number(piece)).to_be_bytes()),
                Area::Peripheral if address.ty == DataType::Bit => {
                    bytes.extend(piece.iter().map(|byte| byte >> (address.start % 8) & 1));
                }
                _ => bytes.extend_from_slice(piece),
            }
        }
        Ok(bytes)
    };
    addresses.iter().map(&mut of).collect()
}

/// The writes for a value.
///
/// # Errors
/// The value does not fit.
pub(crate) fn puts(put: &server::Put) -> Result<Vec<Put>, ItemCode> {
    let address = &put.address;
    if address.ty == DataType::Bit {
        let value = put.bytes.first().map_or(0, |byte| u32::from(byte & 1));
        return Ok(vec![Put::Value(cell(address), Width::Bit, value)]);
    }
    let Some((width, _)) = single(address) else {
        return Ok(vec![Put::Bytes(cell(address), put.bytes.clone().into())]);
    };
    let elements = put.bytes.chunks(width.bytes() as usize).zip(0..);
    elements
        .map(|(bytes, index)| {
            let value = match address.area {
                Area::Counters => from_bcd(number(bytes)).ok_or(NO_VALUE)?,
                _ => number(bytes),
            };
            Ok(Put::Value(element(address, width, index), width, value))
        })
        .collect()
}

/// The cells that a value forces; `None`: such a cell cannot be forced over S7. A peripheral address does not say
/// whether inputs or outputs are meant.
pub(crate) fn forced(put: &server::Put) -> Option<Vec<Forced>> {
    let Address { area, start, ty, .. } = put.address;
    let area = match area {
        Area::Inputs => ForcedArea::Input,
        Area::Outputs => ForcedArea::Output,
        Area::Memory => ForcedArea::Memory,
        _ => return None,
    };
    let width = match ty.bytes() {
        _ if ty == DataType::Bit => Width::Bit,
        2 => Width::Word,
        4 => Width::DWord,
        _ => Width::Byte,
    };
    let elements = put.bytes.chunks(width.bytes().max(1) as usize).zip(0..);
    let cell =
        |(bytes, index)| Forced { area, bit: start + index * u32::from(width.bits()), width, value: number(bytes) };
    Some(elements.map(cell).collect())
}

fn number(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |number, byte| number << 8 | u32::from(*byte))
}

/// A counter is sent as three decimal digits.
fn to_bcd(count: u32) -> u16 {
    let count = count.min(999) as u16;
    count + count / 10 * 6 + count / 100 * 96
}

fn from_bcd(word: u32) -> Option<u32> {
    let digits = [word >> 8 & 0xF, word >> 4 & 0xF, word & 0xF];
    let is_count = word < 0x1000 && digits.iter().all(|digit| *digit < 10);
    is_count.then(|| digits.iter().fold(0, |count, digit| count * 10 + digit))
}

/// What is no time or no count is refused so. [recorded from a 315-2]
const NO_VALUE: ItemCode = ItemCode::NOT_ALLOWED;

/// The code with which a CPU refuses to read or write an item.
pub(crate) fn code(refusal: Refusal) -> ItemCode {
    match refusal {
        Refusal::Cell(CellError::Outside | CellError::NoTimer) => ItemCode::ADDRESS,
        Refusal::Cell(CellError::NoDb | CellError::NoEntry) | Refusal::NotThere => ItemCode::NO_OBJECT,
        Refusal::Cell(CellError::Value) => NO_VALUE,
        Refusal::Cell(CellError::ReadOnly | CellError::OutputsOff) | Refusal::Right | Refusal::Password => {
            ItemCode::NOT_ALLOWED
        }
        Refusal::InRun | Refusal::Block | Refusal::Room | Refusal::Watched => ItemCode::NOT_ALLOWED,
        Refusal::Cell(CellError::NoModule) | Refusal::Full | Refusal::Silent => ItemCode::HARDWARE,
    }
}

/// The kind of block of the program.
pub(crate) const fn kind(ty: BlockType) -> BlockKind {
    match ty {
        BlockType::Ob => BlockKind::Ob,
        BlockType::Db => BlockKind::Db,
        BlockType::Fc => BlockKind::Fc,
        BlockType::Sfc => BlockKind::Sfc,
        BlockType::Fb => BlockKind::Fb,
        BlockType::Sfb => BlockKind::Sfb,
        BlockType::Sdb => BlockKind::Sdb,
    }
}

/// The type of a kind of block.
pub(crate) const fn ty(kind: BlockKind) -> BlockType {
    match kind {
        BlockKind::Ob => BlockType::Ob,
        BlockKind::Db => BlockType::Db,
        BlockKind::Fc => BlockType::Fc,
        BlockKind::Sfc => BlockType::Sfc,
        BlockKind::Fb => BlockType::Fb,
        BlockKind::Sfb => BlockType::Sfb,
        BlockKind::Sdb => BlockType::Sdb,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(area: Area, start: u32, ty: DataType, count: u16) -> Address {
        Address { area, db: if area == Area::Db { 7 } else { 0 }, start, ty, count }
    }

    #[test]
    fn memory_is_read_in_one_piece_and_modules_by_element() {
        let all = [
            address(Area::Db, 160, DataType::Real, 3),
            address(Area::Memory, 83, DataType::Bit, 1),
            address(Area::Peripheral, 80, DataType::Word, 2),
            address(Area::Peripheral, 8, DataType::DateAndTime, 1),
            address(Area::Timers, 5, DataType::Timer, 2),
        ];
        let value = |at: u32| Piece::Value(Cell::Peripheral(at), Width::Byte);
        let mut expected = vec![
            Piece::Bytes { at: Cell::Db(7, 160), len: 12 },
            Piece::Bytes { at: Cell::Area(Place::Memory, 80), len: 1 },
            Piece::Value(Cell::Peripheral(80), Width::Word),
            Piece::Value(Cell::Peripheral(96), Width::Word),
        ];
        expected.extend((0..8).map(|n| value(8 + n * 8)));
        expected.extend([5, 6].map(|n| Piece::Value(Cell::Timer(n), Width::Word)));
        assert_eq!(pieces(&all), expected);
    }

    #[test]
    fn values_are_put_as_they_lie() {
        let put = |address, bytes: &[u8]| puts(&server::Put { address, bytes: bytes.to_vec() });
        let bit = address(Area::Db, 83, DataType::Bit, 1);
        assert_eq!(put(bit, &[0xFF]), Ok(vec![Put::Value(Cell::Db(7, 83), Width::Bit, 1)]));
        let words = address(Area::Db, 16, DataType::Word, 2);
        assert_eq!(put(words, &[1, 2, 3, 4]), Ok(vec![Put::Bytes(Cell::Db(7, 16), [1, 2, 3, 4].into())]));
        let outputs = address(Area::Peripheral, 16, DataType::DWord, 1);
        let expected = Put::Value(Cell::Peripheral(16), Width::DWord, 0x0102_0304);
        assert_eq!(put(outputs, &[1, 2, 3, 4]), Ok(vec![expected]));
        let counters = address(Area::Counters, 3, DataType::Counter, 2);
        let expected = [(3, 999), (4, 12)].map(|(n, value)| Put::Value(Cell::Counter(n), Width::Word, value));
        assert_eq!(put(counters, &[0x09, 0x99, 0x00, 0x12]), Ok(expected.to_vec()));
        assert_eq!(put(counters, &[0x09, 0x9A, 0, 0]), Err(NO_VALUE));
        assert_eq!(put(counters, &[0x19, 0x99, 0, 0]), Err(NO_VALUE));
    }

    #[test]
    fn counts_are_decimal_on_the_wire() {
        for count in 0..=999 {
            assert_eq!(from_bcd(u32::from(to_bcd(count))), Some(count));
        }
        assert_eq!((to_bcd(123), to_bcd(999)), (0x123, 0x999));
    }
}
