//! Variable tables: addresses, and what status and modifying make of their values.

use ob1_model::{Forced, ForcedArea, Width};

use crate::codes::{Code, ItemCode};
use crate::server::var::{Slot, codes, values};
use crate::server::{Put, Reply};
use crate::wire::{Address, Area, DataItems, DataType, OCTET};

/// Bytes of an address.
const ADDRESS: usize = 6;
/// Bytes in front of a value: code, size, length.
const VALUE: usize = 4;

/// Bytes of the value at an address, also where it cannot be served.
fn value_bytes([kind, count, ..]: [u8; ADDRESS]) -> usize {
    let count = usize::from(count);
    match kind & 0x0F {
        0 => 1,
        1 => count,
        3 => count * 4,
        _ => count * 2,
    }
}

/// An address of a variable table: area and width, repetition or bit, data block, byte or number.
fn address(bytes: [u8; ADDRESS]) -> Slot {
    let [kind, count, db_high, db_low, high, low] = bytes;
    let area = match kind >> 4 {
        0 => Area::Memory,
        1 => Area::Inputs,
        2 => Area::Outputs,
        3 => Area::Peripheral,
        5 => Area::Timers,
        6 => Area::Counters,
        7 => Area::Db,
        _ => return Err(ItemCode::NO_OBJECT),
    };
    let first = u32::from(u16::from_be_bytes([high, low]));
    let db = if area == Area::Db { u16::from_be_bytes([db_high, db_low]) } else { 0 };
    let (ty, start, count) = match (area, kind & 0x0F) {
        (Area::Timers, 4) => (DataType::Timer, first, count),
        (Area::Counters, 4) => (DataType::Counter, first, count),
        (Area::Timers | Area::Counters, _) => return Err(ItemCode::TYPE),
        (_, 0) if count < 8 => (DataType::Bit, first * 8 + u32::from(count), 1),
        (_, 1) => (DataType::Byte, first * 8, count),
        (_, 2) => (DataType::Word, first * 8, count),
        (_, 3) => (DataType::DWord, first * 8, count),
        _ => return Err(ItemCode::TYPE),
    };
    if count == 0 {
        return Err(ItemCode::ADDRESS);
    }
    Ok(Address { area, db, start, ty, count: u16::from(count) })
}

/// The variables of a job: their addresses, the length of a result with their values, the bytes behind them.
fn variables(data: &[u8]) -> Result<(Vec<Slot>, usize, &[u8]), Code> {
    let (&[high, low], rest) = data.split_first_chunk::<2>().ok_or(Code::TEST_DATA)?;
    let count = usize::from(u16::from_be_bytes([high, low]));
    let (addresses, rest) = rest.split_at_checked(count * ADDRESS).ok_or(Code::TEST_DATA)?;
    let addresses = addresses.as_chunks::<ADDRESS>().0;
    let slots: Vec<Slot> = addresses.iter().map(|bytes| address(*bytes)).collect();
    let length = addresses.iter().map(|bytes| VALUE + value_bytes(*bytes).next_multiple_of(2)).sum::<usize>();
    if slots.is_empty() { Err(Code::TEST_DATA) } else { Ok((slots, 2 + length, rest)) }
}

/// The variables of a status job, and the length of its results.
pub(super) fn status(data: &[u8]) -> Result<(Vec<Slot>, usize), Code> {
    let (slots, length, rest) = variables(data)?;
    if rest.is_empty() { Ok((slots, length)) } else { Err(Code::TEST_DATA) }
}

/// The variables of a job that modifies, what is written, and the length of its results.
pub(super) fn modify(data: &[u8]) -> Result<(Vec<Slot>, Vec<Put>, usize), Code> {
    let (mut slots, _, rest) = variables(data)?;
    let mut items = DataItems::new(rest);
    let mut puts = Vec::new();
    for slot in &mut slots {
        let Some(Some(item)) = items.next() else { return Err(Code::TEST_DATA) };
        if let Ok(address) = *slot {
            if item.bytes.len() == address.bytes() {
                puts.push(Put { address, bytes: item.bytes.to_vec() });
            } else {
                *slot = Err(ItemCode::INCONSISTENT);
            }
        }
    }
    let length = (2 + slots.len()).next_multiple_of(2);
    Ok((slots, puts, length))
}

/// Forced cells as the data of the request that forces them.
pub(super) fn forced(cells: &[Forced]) -> Vec<u8> {
    let mut data = (cells.len() as u16).to_be_bytes().to_vec();
    for cell in cells {
        let area = match cell.area {
            ForcedArea::Memory => 0x00,
            ForcedArea::Input => 0x10,
            ForcedArea::Output => 0x20,
            ForcedArea::PeripheralInput | ForcedArea::PeripheralOutput => 0x30,
        };
        let (width, count) = match cell.width {
            Width::Bit => (0, (cell.bit % 8) as u8),
            Width::Byte => (1, 1),
            Width::Word => (2, 1),
            Width::DWord => (3, 1),
        };
        let [high, low] = ((cell.bit / 8) as u16).to_be_bytes();
        data.extend([area | width, count, 0, 0, high, low]);
    }
    for cell in cells {
        let bytes = cell.width.bytes() as usize;
        data.extend([0x00, OCTET]);
        data.extend((bytes as u16).to_be_bytes());
        data.extend_from_slice(&cell.value.to_be_bytes()[4 - bytes..]);
        data.extend((bytes % 2 == 1).then_some(0));
    }
    data
}

/// The values of all variables.
pub(super) fn seen(slots: &[Slot], reply: Reply) -> Vec<u8> {
    let mut data = (slots.len() as u16).to_be_bytes().to_vec();
    for value in values(slots, reply) {
        match value {
            Ok((_, bytes)) => {
                data.extend_from_slice(&[ItemCode::DONE.0, OCTET]);
                data.extend_from_slice(&(bytes.len() as u16).to_be_bytes());
                data.extend_from_slice(&bytes);
                if bytes.len() % 2 == 1 {
                    data.push(0);
                }
            }
            Err(code) => data.extend_from_slice(&[code.0, 0, 0, 0]),
        }
    }
    data
}

/// The outcome for each variable.
pub(super) fn modified(slots: &[Slot], reply: Reply) -> Vec<u8> {
    let mut data = (slots.len() as u16).to_be_bytes().to_vec();
    data.extend(codes(slots, reply).into_iter().map(|code| code.0));
    if data.len() % 2 == 1 {
        data.push(0);
    }
    data
}
