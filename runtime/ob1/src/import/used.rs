//! Which addresses a program names.

use std::collections::BTreeSet;

use ob1_ir::{Arg, Number, Numbered, Op, Place, Program, Width};
use ob1_model::Area as Memory;
use ob1_project::Area;

/// The addresses a program names. What pointers reach at run time is not among them.
#[derive(Clone, Debug, Default)]
pub(super) struct Used {
    /// Bytes of process images and bit memory: one more than the highest.
    pub(super) inputs: u32,
    pub(super) outputs: u32,
    pub(super) memory: u32,
    /// One more than the highest number.
    pub(super) timers: u32,
    pub(super) counters: u32,
    /// Input and output bytes that are named, in the process image and beyond it.
    pub(super) read: BTreeSet<u32>,
    pub(super) written: BTreeSet<u32>,
    /// Those that are reached directly, past the process image.
    pub(super) peripheral_read: BTreeSet<u32>,
    pub(super) peripheral_written: BTreeSet<u32>,
}

impl Used {
    /// By the statements of a program and by its symbols.
    pub(super) fn of(program: &Program) -> Self {
        let mut used = Self::default();
        for op in program.blocks.iter().flat_map(|block| &block.code).map(|stmt| &stmt.op) {
            used.operation(op);
        }
        for symbol in &program.symbols {
            used.symbol(&symbol.address);
        }
        used
    }

    fn operation(&mut self, op: &Op) {
        let writes = matches!(op, Op::Transfer(_));
        let is_call = matches!(op, Op::Call(_));
        op.places(&mut |place, width| self.place(place, width, writes, is_call));
        op.numbers(&mut |number| {
            let Number::Fixed(n) = number else { return };
            let above = u32::from(*n) + 1;
            match op.numbered() {
                Some(Numbered::Timer) => self.timers = self.timers.max(above),
                Some(Numbered::Counter) => self.counters = self.counters.max(above),
                // A number handed over: a timer, a counter or a block, whose parameter says which.
                None if is_call && above <= 512 => {
                    self.timers = self.timers.max(above);
                    self.counters = self.counters.max(above);
                }
                _ => {}
            }
        });
        if let Op::Call(call) = op {
            for arg in &call.args {
                if let Arg::Raw(pointer) = arg {
                    self.pointer(*pointer);
                }
            }
        }
    }

    /// A pointer of a list: area, byte and bit.
    fn pointer(&mut self, pointer: u32) {
        let byte = (pointer & 0x7_FFFF) / 8;
        if let Some(area) = Memory::from_pointer_code((pointer >> 24) as u8) {
            self.bytes(area, byte, 4, true, true);
        }
    }

    fn place(&mut self, place: Place, width: Width, writes: bool, is_call: bool) {
        if let Place::Fixed(area, at) = place {
            self.bytes(area, at.byte(), width.bytes(), writes || is_call, !writes || is_call);
        }
    }

    fn bytes(&mut self, area: Memory, first: u32, count: u32, written: bool, read: bool) {
        let end = first.saturating_add(count).min(65_536);
        match area {
            Memory::Input => {
                self.inputs = self.inputs.max(end);
                self.read.extend(first..end);
            }
            Memory::Output => {
                self.outputs = self.outputs.max(end);
                self.written.extend(first..end);
            }
            Memory::Memory => self.memory = self.memory.max(end),
            Memory::Peripheral => {
                if read {
                    self.peripheral_read.extend(first..end);
                }
                if written {
                    self.peripheral_written.extend(first..end);
                }
            }
            _ => {}
        }
    }

    /// `I 1.0`, `QW 4`, `PIW 256`, `M 5.0`, `T 5`.
    fn symbol(&mut self, address: &str) {
        let Some((word, number)) = address.split_once(' ') else { return };
        let Some(byte) = number.split('.').next().and_then(|n| n.trim().parse::<u32>().ok()) else { return };
        let (head, width) = match word.char_indices().last() {
            Some((at, 'B')) if at > 0 => (&word[..at], 1),
            Some((at, 'W')) if at > 0 => (&word[..at], 2),
            Some((at, 'D')) if at > 0 => (&word[..at], 4),
            _ => (word, 1),
        };
        match head {
            "I" => self.bytes(Memory::Input, byte, width, false, true),
            "Q" => self.bytes(Memory::Output, byte, width, true, false),
            "M" => self.bytes(Memory::Memory, byte, width, true, true),
            "PI" => self.peripheral_read.extend(byte..byte.saturating_add(width).min(65_536)),
            "PQ" => self.peripheral_written.extend(byte..byte.saturating_add(width).min(65_536)),
            "T" => self.timers = self.timers.max(byte.saturating_add(1)),
            "C" => self.counters = self.counters.max(byte.saturating_add(1)),
            _ => {}
        }
    }
}

/// Bytes as areas: neighbours together, and words kept whole.
pub(super) fn areas(bytes: &BTreeSet<u32>) -> Vec<Area> {
    let mut out: Vec<Area> = Vec::new();
    for byte in bytes {
        match out.last_mut().filter(|last| last.first + last.bytes == *byte) {
            Some(last) => last.bytes += 1,
            None => out.push(Area { first: *byte, bytes: 1 }),
        }
    }
    out
}
