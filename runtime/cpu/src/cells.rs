//! Cells, as links name them, in the memory of the CPU.

use ob1_model::{Area, Put, S5Time};

use crate::arena::{ArenaBit, Range};
use crate::machine::Machine;
use crate::timers::Counter;
use crate::{Cell, CellError, Width};

/// The piece of memory a cell lies in, and its bit there; `None` for cells that are not memory.
fn range(m: &Machine, cell: Cell, write: bool) -> Result<Option<(Range, u32)>, CellError> {
    Ok(Some(match cell {
        Cell::Area(Area::Input, at) => (m.memory.inputs, at),
        Cell::Area(Area::Output, at) => (m.memory.outputs, at),
        Cell::Area(Area::Memory, at) => (m.memory.memory, at),
        Cell::Area(..) => return Err(CellError::Outside),
        Cell::Db(number, at) => {
            let db = m.memory.db(number).ok_or(CellError::NoDb)?;
            if write && db.writable == 0 {
                return Err(CellError::ReadOnly);
            }
            (db.range(), at)
        }
        Cell::Peripheral(_) | Cell::Timer(_) | Cell::Counter(_) => return Ok(None),
    }))
}

/// The arena bytes from the byte of a cell on, `len` of them.
pub(crate) fn place(m: &Machine, cell: Cell, len: u32, write: bool) -> Result<std::ops::Range<usize>, CellError> {
    let (range, at) = range(m, cell, write)?.ok_or(CellError::Outside)?;
    let byte = range.locate(at / 8, len).ok_or(CellError::Outside)?.index();
    Ok(byte..byte + len as usize)
}

/// All bytes of the area or data block a cell lies in.
pub(crate) fn block(m: &Machine, cell: Cell) -> Result<&[u8], CellError> {
    let (range, _) = range(m, cell, false)?.ok_or(CellError::Outside)?;
    m.memory.bytes.get(range.bytes()).ok_or(CellError::Outside)
}

/// Whether a value can be written, without writing it. Whether a module takes it shows only at the write.
pub(crate) fn check(m: &Machine, cell: Cell, width: Width, value: u32) -> Result<(), CellError> {
    if width.bits() < 32 && value >> width.bits() != 0 {
        return Err(CellError::Value);
    }
    match cell {
        Cell::Area(..) | Cell::Db(..) => locate(m, cell, width, true).map(|_| ()),
        Cell::Counter(n) => match m.counters.get(usize::from(n)) {
            None => Err(CellError::NoTimer),
            Some(_) if value > u32::from(Counter::MAX) => Err(CellError::Value),
            Some(_) => Ok(()),
        },
        Cell::Peripheral(at) if width != Width::Bit => match m.has_outputs(at / 8, u32::from(width.bits() / 8)) {
            false => Err(CellError::NoModule),
            true if m.outputs_disabled => Err(CellError::OutputsOff),
            true => Ok(()),
        },
        Cell::Timer(n) if width == Width::Word => {
            m.timers.get(usize::from(n)).ok_or(CellError::NoTimer)?;
            S5Time(value as u16).digits().map(|_| ()).ok_or(CellError::Value)
        }
        Cell::Peripheral(_) | Cell::Timer(_) => Err(CellError::ReadOnly),
    }
}

/// The arena bit of a cell in memory; `None` for cells that are not memory.
fn locate(m: &Machine, cell: Cell, width: Width, write: bool) -> Result<Option<ArenaBit>, CellError> {
    let Some((range, at)) = range(m, cell, write)? else { return Ok(None) };
    let bits = u32::from(width.bits());
    if bits > 1 && at % 8 != 0 {
        return Err(CellError::Outside);
    }
    let byte = range.locate(at / 8, bits.div_ceil(8)).ok_or(CellError::Outside)?;
    Ok(Some(byte.bit(at % 8)))
}

/// Reads a cell, right-aligned; of a timer or counter a bit is what a scan gives, a word is time (BCD) or count.
pub(crate) fn read(m: &mut Machine, cell: Cell, width: Width) -> Result<u32, CellError> {
    if let Some(at) = locate(m, cell, width, false)? {
        return Ok(m.memory.read_bits(at, width.bits()));
    }
    match cell {
        Cell::Timer(n) => {
            let timer = m.timers.get(usize::from(n)).ok_or(CellError::NoTimer)?;
            Ok(match width {
                Width::Bit => u32::from(timer.output(m.hot.now)),
                _ => u32::from(timer.remaining_bcd(m.hot.now)),
            })
        }
        Cell::Counter(n) => {
            let counter = m.counters.get(usize::from(n)).ok_or(CellError::NoTimer)?;
            Ok(match width {
                Width::Bit => u32::from(counter.value != 0),
                _ => u32::from(counter.value),
            })
        }
        Cell::Peripheral(at) => {
            let mut bytes = [0; 4];
            let len = usize::from(width.bits().div_ceil(8));
            m.io_read(at / 8, &mut bytes[4 - len..]).map_err(|_| CellError::NoModule)?;
            let value = u32::from_be_bytes(bytes);
            Ok(if width == Width::Bit { value >> (at % 8) & 1 } else { value })
        }
        Cell::Area(..) | Cell::Db(..) => Err(CellError::Outside),
    }
}

/// Writes a cell, after all checks; an error changes nothing.
pub(crate) fn write(m: &mut Machine, cell: Cell, width: Width, value: u32) -> Result<(), CellError> {
    check(m, cell, width, value)?;
    if let Some(at) = locate(m, cell, width, true)? {
        m.memory.write_bits(at, width.bits(), value);
        return Ok(());
    }
    match cell {
        Cell::Counter(n) => {
            m.counters.get_mut(usize::from(n)).ok_or(CellError::NoTimer)?.value = value as u16;
            Ok(())
        }
        Cell::Timer(n) => {
            let now = m.hot.now;
            let timer = m.timers.get_mut(usize::from(n)).ok_or(CellError::NoTimer)?;
            if timer.preset(value as u16, now) { Ok(()) } else { Err(CellError::Value) }
        }
        Cell::Peripheral(at) if width != Width::Bit => {
            let len = usize::from(width.bits() / 8);
            m.io_write(at / 8, &value.to_be_bytes()[4 - len..]).map_err(|_| CellError::NoModule)
        }
        _ => Err(CellError::ReadOnly),
    }
}

/// Writes what is to be put, all of it or nothing.
pub(crate) fn put(m: &mut Machine, put: &Put) -> Result<(), CellError> {
    match put {
        Put::Value(cell, width, value) => write(m, *cell, *width, *value),
        Put::Bytes(cell, bytes) => place(m, *cell, bytes.len() as u32, true).map(|place| {
            if let Some(to) = m.memory.bytes.get_mut(place) {
                to.copy_from_slice(bytes);
            }
        }),
    }
}
