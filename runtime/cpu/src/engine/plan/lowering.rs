//! What lowering reads.

use ob1_ir::{Place, Program, Verified};
use ob1_model::Area;

use super::Signatures;
use crate::CpuConfig;
use crate::arena::ArenaByte;
use crate::memory::Memory;

/// Everything lowering reads of the configuration, the memory and the program.
pub(crate) struct Lowering<'a> {
    pub(crate) config: &'a CpuConfig,
    pub(crate) memory: &'a Memory,
    pub(crate) program: Verified<&'a Program>,
    pub(crate) signatures: &'a Signatures,
    /// Constants of calls: their bytes, at `memory.constants`.
    pub(crate) constants: &'a Constants,
}

/// Constants of calls, collected before the memory is laid out.
#[derive(Clone, Debug, Default)]
pub(crate) struct Constants {
    pub(crate) bytes: Vec<u8>,
}

impl Constants {
    /// The offset of these bytes, which are appended when they are not there yet.
    pub(crate) fn add(&mut self, bytes: &[u8]) {
        if self.find(bytes).is_none() {
            self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
            self.bytes.extend_from_slice(bytes);
        }
    }

    /// Offset of these bytes, on a multiple of four.
    pub(crate) fn find(&self, bytes: &[u8]) -> Option<u32> {
        let mut at = 0;
        while at + bytes.len() <= self.bytes.len() {
            if &self.bytes[at..at + bytes.len()] == bytes {
                return u32::try_from(at).ok();
            }
            at += 4;
        }
        None
    }
}

/// The arena byte and bit mask of a place in E, A or M that lies inside its area.
pub(crate) fn fixed(place: Place, bits: u32, l: &Lowering<'_>) -> Option<(ArenaByte, u8)> {
    let Place::Fixed(area, at) = place else { return None };
    let range = match area {
        Area::Input => l.memory.inputs,
        Area::Output => l.memory.outputs,
        Area::Memory => l.memory.memory,
        _ => return None,
    };
    range.locate(at.byte(), bits.div_ceil(8)).map(|byte| (byte, 1 << at.bit()))
}
