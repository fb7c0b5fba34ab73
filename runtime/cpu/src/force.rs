//! Forcing: values that the operator holds.
//!
//! On an S7-300 inputs and outputs of the process image: set after the inputs were read, before the outputs are written
//! and again after it; in between the program can overwrite them, and peripheral access passes them by. On an S7-400
//! bit memory and peripheral cells, too; every read sees the value, and no write has an effect: engines run the blocks
//! statement by statement then, and the value is set before each of them ([`crate::engine::Watched::every`]).
//! (S7-300 installation manual, table 10-1; Programming with STEP 7, 20.8.3)

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use ob1_model::{FORCED_300, FORCED_400, Forced, ForcedArea, Width};

use crate::arena::{ArenaByte, Range};
use crate::machine::Machine;
use crate::{CellError, Cpu, Family, IoError};

/// A step of setting what is forced: the cells come one by one, and are taken together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ForceStep {
    /// A new list begins.
    New,
    /// One more cell of it.
    Add(Forced),
    /// It takes the place of the one before; an empty list ends forcing.
    Take,
}

/// A list of cells, with its room.
#[derive(Debug)]
struct List {
    cells: Box<[Forced; FORCED_400]>,
    count: usize,
}

impl Default for List {
    fn default() -> Self {
        Self { cells: Box::new([Forced::NONE; FORCED_400]), count: 0 }
    }
}

impl List {
    fn get(&self) -> &[Forced] {
        self.cells.get(..self.count).unwrap_or_default()
    }
}

/// What is forced, and what is to be forced from the next control point on.
#[derive(Debug, Default)]
pub(crate) struct Force {
    held: List,
    staged: List,
    /// A cell of the staged list was refused.
    refused: bool,
    /// How many are held, for others.
    count: Arc<AtomicU32>,
}

impl Force {
    #[inline]
    pub(crate) fn is_on(&self) -> bool {
        self.held.count != 0
    }

    pub(crate) fn clear(&mut self) {
        self.held.count = 0;
        self.count.store(0, Ordering::Relaxed);
    }

    /// Puts the forced values over peripheral bytes that were read, or are about to be written.
    fn cover(&self, inputs: bool, address: u32, bytes: &mut [u8]) {
        let meant = |area| match area {
            ForcedArea::PeripheralInput => inputs,
            ForcedArea::PeripheralOutput | ForcedArea::Output => !inputs,
            ForcedArea::Input | ForcedArea::Memory => false,
        };
        for cell in self.held.get().iter().filter(|cell| meant(cell.area)) {
            let value = (cell.value << (32 - cell.width.bits())).to_be_bytes();
            for at in 0..u32::from(cell.width.bits().div_ceil(8)) {
                let place = (cell.bit / 8 + at).checked_sub(address).and_then(|place| bytes.get_mut(place as usize));
                let Some(byte) = place else { continue };
                if cell.width == Width::Bit {
                    let mask = 1 << (cell.bit % 8);
                    *byte = if cell.value & 1 == 1 { *byte | mask } else { *byte & !mask };
                } else {
                    *byte = value[at as usize];
                }
            }
        }
    }
}

impl Machine {
    /// The values are forced everywhere: reads and writes pass by nothing.
    pub(crate) fn forces_all(&self) -> bool {
        self.force.is_on() && self.config.family == Family::S7_400
    }

    /// Sets the forced cells of the areas.
    #[inline]
    pub(crate) fn put_forced(&mut self) {
        if self.force.is_on() {
            self.put_forced_now();
        }
    }

    #[cold]
    fn put_forced_now(&mut self) {
        for at in 0..self.force.held.count {
            let Some(cell) = self.force.held.cells.get(at).copied() else { return };
            let bits = cell.width.bits();
            if let Some(byte) = self.area(cell.area).locate(cell.bit / 8, u32::from(bits.div_ceil(8))) {
                self.memory.write_bits(byte.bit(cell.bit % 8), bits, cell.value);
            }
        }
    }

    /// A peripheral cell within the process image is one of it, too: images are read from modules and written to them.
    const fn area(&self, area: ForcedArea) -> Range {
        match area {
            ForcedArea::Input | ForcedArea::PeripheralInput => self.memory.inputs,
            ForcedArea::Output | ForcedArea::PeripheralOutput => self.memory.outputs,
            ForcedArea::Memory => self.memory.memory,
        }
    }

    /// Peripheral outputs have their forced values though nobody writes them.
    pub(crate) fn drive_forced(&mut self) {
        if !self.forces_all() {
            return;
        }
        for at in 0..self.force.held.count {
            let cell = self.force.held.cells.get(at).copied().filter(|cell| cell.area == ForcedArea::PeripheralOutput);
            let Some(cell) = cell else { continue };
            let value = cell.value.to_be_bytes();
            let bytes = value.get(4 - usize::from(cell.width.bits() / 8)..).unwrap_or_default();
            // A module that does not answer is told of elsewhere.
            let _ = self.modules.write(cell.bit / 8, bytes);
        }
    }

    /// In STOP forced outputs have their values only where the peripheral outputs are enabled. (Programming with STEP
    /// 7, 20.8.3)
    pub(crate) fn drive_in_stop(&mut self) {
        if self.outputs_disabled {
            return;
        }
        for at in 0..self.force.held.count {
            let cell = self.force.held.cells.get(at).copied().filter(|cell| cell.area == ForcedArea::Output);
            let Some(cell) = cell else { continue };
            let bytes = u32::from(cell.width.bits().div_ceil(8));
            let place = self.memory.outputs.locate(cell.bit / 8, bytes).map(ArenaByte::index);
            let image = place.and_then(|at| self.memory.bytes.get(at..at + bytes as usize));
            // A module that does not answer is told of elsewhere.
            let _ = image.map(|image| self.modules.write(cell.bit / 8, image));
        }
        self.drive_forced();
    }

    /// In STOP: enables the peripheral outputs, or disables them.
    pub(crate) fn enable_outputs(&mut self, on: bool) {
        if self.outputs_disabled == on {
            self.outputs_disabled = !on;
            self.modules.output_disable(!on);
        }
    }

    /// Peripheral bytes were read.
    #[inline]
    pub(crate) fn cover_read(&self, address: u32, bytes: &mut [u8]) {
        if self.forces_all() {
            self.force.cover(true, address, bytes);
        }
    }

    /// Writes peripheral bytes, with what is forced in place of what the program has written.
    #[cold]
    pub(crate) fn write_covered(&mut self, address: u32, from: &[u8]) -> Result<(), IoError> {
        // No longer area is consistent: of DP the longest has 240 bytes.
        let mut room = [0; 256];
        for (at, part) in (address..).step_by(room.len()).zip(from.chunks(room.len())) {
            let covered = &mut room[..part.len()];
            covered.copy_from_slice(part);
            self.force.cover(false, at, covered);
            self.write_modules(at, covered)?;
        }
        Ok(())
    }

    /// A step of setting what is forced.
    pub(crate) fn force_step(&mut self, step: ForceStep) -> Result<(), CellError> {
        match step {
            ForceStep::New => {
                self.force.staged.count = 0;
                self.force.refused = false;
            }
            ForceStep::Add(cell) => {
                if let Err(why) = self.may_force(&cell) {
                    self.force.refused = true;
                    return Err(why);
                }
                let staged = &mut self.force.staged;
                if let Some(place) = staged.cells.get_mut(staged.count) {
                    *place = cell;
                    staged.count += 1;
                }
            }
            ForceStep::Take => {
                if self.force.refused {
                    return Err(CellError::Value);
                }
                std::mem::swap(&mut self.force.held, &mut self.force.staged);
                self.force.staged.count = 0;
                self.force.count.store(self.force.held.count as u32, Ordering::Relaxed);
                self.put_forced();
            }
        }
        Ok(())
    }

    /// Whether this CPU can force the cell.
    fn may_force(&self, cell: &Forced) -> Result<(), CellError> {
        let large = self.config.family == Family::S7_400;
        let bits = cell.width.bits();
        if self.force.staged.count >= if large { FORCED_400 } else { FORCED_300 }
            || bits < 32 && cell.value >> bits != 0
            || bits > 1 && !cell.bit.is_multiple_of(8)
            || bits == 1 && matches!(cell.area, ForcedArea::PeripheralInput | ForcedArea::PeripheralOutput)
        {
            return Err(CellError::Value);
        }
        let (byte, bytes) = (cell.bit / 8, u32::from(bits.div_ceil(8)));
        let there = match cell.area {
            ForcedArea::Input | ForcedArea::Output => self.area(cell.area).locate(byte, bytes).is_some(),
            _ if !large => return Err(CellError::ReadOnly),
            ForcedArea::Memory => self.area(cell.area).locate(byte, bytes).is_some(),
            ForcedArea::PeripheralInput => self.modules.has(byte, bytes as usize, false),
            ForcedArea::PeripheralOutput => self.modules.has(byte, bytes as usize, true),
        };
        if there { Ok(()) } else { Err(CellError::Outside) }
    }
}

impl Cpu {
    /// Forces these cells in place of those before, between two calls of [`Cpu::cycle`]: what a station has kept.
    /// Returns how many there are now.
    pub fn force(&mut self, cells: &[Forced]) -> usize {
        let _ = self.machine.force_step(ForceStep::New);
        for cell in cells {
            // One that the CPU does not have any more is left out.
            if self.machine.may_force(cell).is_ok() {
                let _ = self.machine.force_step(ForceStep::Add(*cell));
            }
        }
        let _ = self.machine.force_step(ForceStep::Take);
        self.arm();
        self.machine.force.held.count
    }

    /// How many cells are forced, for other threads: a memory reset ends it.
    #[must_use]
    pub fn forced(&self) -> Arc<AtomicU32> {
        Arc::clone(&self.machine.force.count)
    }
}
