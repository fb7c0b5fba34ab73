//! Cells of the access port in the memory of the CPU.

use ob1_model::Area;

use crate::machine::Machine;
use crate::memory::Range;
use crate::timers::Counter;
use crate::{Cell, CellError, CellWidth};

/// The arena bit of a cell in memory; `None` for cells that are not memory.
fn locate(m: &Machine, cell: Cell, width: CellWidth, write: bool) -> Result<Option<u32>, CellError> {
    let (range, at) = match cell {
        Cell::Area(Area::Input, at) => (m.memory.inputs, at),
        Cell::Area(Area::Output, at) => (m.memory.outputs, at),
        Cell::Area(Area::Memory, at) => (m.memory.memory, at),
        Cell::Area(..) => return Err(CellError::Outside),
        Cell::Db(number, at) => {
            let db = m.memory.db(number).ok_or(CellError::NoDb)?;
            if write && db.writable == 0 {
                return Err(CellError::ReadOnly);
            }
            (Range { at: db.at, len: db.len }, at)
        }
        Cell::Peripheral(_) | Cell::Timer(_) | Cell::Counter(_) => return Ok(None),
    };
    let bits = u32::from(width.bits());
    if bits > 1 && at % 8 != 0 {
        return Err(CellError::Outside);
    }
    let byte = range.locate(at / 8, bits.div_ceil(8)).ok_or(CellError::Outside)?;
    Ok(Some(byte * 8 + at % 8))
}

/// Reads a cell.
pub(crate) fn read(m: &mut Machine, cell: Cell, width: CellWidth) -> Result<u32, CellError> {
    if let Some(at) = locate(m, cell, width, false)? {
        return Ok(m.memory.read_bits(at, width.bits()));
    }
    match cell {
        Cell::Timer(n) => {
            let timer = m.timers.get(usize::from(n)).ok_or(CellError::NoTimer)?;
            Ok(match width {
                CellWidth::Bit => u32::from(timer.output(m.now)),
                _ => u32::from(timer.remaining_bcd(m.now)),
            })
        }
        Cell::Counter(n) => {
            let counter = m.counters.get(usize::from(n)).ok_or(CellError::NoTimer)?;
            Ok(match width {
                CellWidth::Bit => u32::from(counter.value != 0),
                _ => u32::from(counter.value),
            })
        }
        Cell::Peripheral(at) => {
            let mut bytes = [0; 4];
            let len = usize::from(width.bits().div_ceil(8));
            m.io_read(at / 8, &mut bytes[4 - len..]).map_err(|_| CellError::NoModule)?;
            let value = u32::from_be_bytes(bytes);
            Ok(if width == CellWidth::Bit { value >> (at % 8) & 1 } else { value })
        }
        Cell::Area(..) | Cell::Db(..) => Err(CellError::Outside),
    }
}

/// Writes a cell.
pub(crate) fn write(m: &mut Machine, cell: Cell, width: CellWidth, value: u32) -> Result<(), CellError> {
    if width.bits() < 32 && value >> width.bits() != 0 {
        return Err(CellError::Value);
    }
    if let Some(at) = locate(m, cell, width, true)? {
        m.memory.write_bits(at, width.bits(), value);
        return Ok(());
    }
    match cell {
        Cell::Counter(n) => {
            let counter = m.counters.get_mut(usize::from(n)).ok_or(CellError::NoTimer)?;
            if value > u32::from(Counter::MAX) {
                return Err(CellError::Value);
            }
            counter.value = value as u16;
            Ok(())
        }
        Cell::Peripheral(at) if width != CellWidth::Bit => {
            let len = usize::from(width.bits() / 8);
            m.io_write(at / 8, &value.to_be_bytes()[4 - len..]).map_err(|_| CellError::NoModule)
        }
        _ => Err(CellError::ReadOnly),
    }
}
