//! The two areas of a slave, and which of its blocks the master has changed. [S0 "Range definitions"]
//!
//! Input and output are named from the master's point of view: it reads the input area (1x, 3x) and reads and writes
//! the output area (0x, 4x). Bits and words overlap, because "the CP 240 is not differentiating digital and analog
//! data" [S0 L2335]: word n is bytes 2n (high) and 2n + 1 (low), bit n is bit n modulo 8 of byte n / 8 (ours: so bit 0
//! is `E x.0` of the first byte).

use super::pdu::{Exception, Request};

/// Maximum number of bytes of an area. [S0 "Modbus Slave Long"]
pub const AREA_BYTES: usize = 1024;
/// Bytes of an area of the slave "short".
pub const SHORT_BYTES: usize = 16;
/// Bytes of a block. [S0 L2072]
pub const BLOCK_BYTES: usize = 8;
/// Blocks of an area.
pub const BLOCKS: usize = AREA_BYTES / BLOCK_BYTES;
/// Blocks that go to the CPU together if they are coherent.
pub const BLOCKS_TOGETHER: usize = 16;

/// Coherent blocks the master has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// First byte in the output area, a multiple of 8.
    pub first: usize,
    /// Bytes, 8 to 128, a multiple of 8.
    pub bytes: usize,
}

/// Both areas of a slave.
#[derive(Clone, Debug)]
pub struct Areas {
    size: usize,
    input: [u8; AREA_BYTES],
    output: [u8; AREA_BYTES],
    /// The output area as the CPU knows it.
    stored: [u8; AREA_BYTES],
    /// Blocks of the output area that the CPU has not been given yet; bit n is block n.
    changed: u128,
}

impl Areas {
    /// Areas of this many bytes each, all 0.
    pub const fn new(size: usize) -> Self {
        let size = if size > AREA_BYTES { AREA_BYTES } else { size };
        Self { size, input: [0; AREA_BYTES], output: [0; AREA_BYTES], stored: [0; AREA_BYTES], changed: 0 }
    }

    /// The input area, which the CPU fills and the master reads.
    pub fn input(&self) -> &[u8] {
        self.input.get(..self.size).unwrap_or(&[])
    }

    /// The output area, which the master writes.
    pub fn output(&self) -> &[u8] {
        self.output.get(..self.size).unwrap_or(&[])
    }

    /// The CPU's data for the input area, from its beginning; false if there are more than fit.
    pub fn set_input(&mut self, bytes: &[u8]) -> bool {
        put(&mut self.input, self.size, bytes)
    }

    /// The CPU's data for the output area (`ANZ OR 4000h`). The CPU knows them: no block counts as changed by it.
    /// [S0 "Write to master output area"]
    pub fn set_output(&mut self, bytes: &[u8]) -> bool {
        put(&mut self.stored, self.size, bytes) && put(&mut self.output, self.size, bytes)
    }

    /// Whether the master has changed something that [`Areas::take_change`] has not yet handed out.
    pub const fn has_changes(&self) -> bool {
        self.changed != 0
    }

    /// The next changed blocks, from the lowest on, as far as they are contiguous, at most 16. "If the 8Byte blocks are
    /// not coherent every changed 8Byte block requires one block cycle." [S0 L2072]
    pub fn take_change(&mut self) -> Option<Change> {
        if self.changed == 0 {
            return None;
        }
        let first = self.changed.trailing_zeros() as usize;
        let blocks = ((self.changed >> first).trailing_ones() as usize).min(BLOCKS_TOGETHER);
        let mask = (1_u128 << blocks) - 1;
        self.changed &= !(mask << first);
        Some(Change { first: first * BLOCK_BYTES, bytes: blocks * BLOCK_BYTES })
    }

    /// The CPU has stored a change, or cannot. In the latter case the area is reset to the CPU's data, so that the same
    /// write counts as a change again.
    pub fn close_change(&mut self, change: Change, stored: bool) {
        for block in change.first / BLOCK_BYTES..(change.first + change.bytes).min(self.size) / BLOCK_BYTES {
            let bytes = block * BLOCK_BYTES..(block + 1) * BLOCK_BYTES;
            // Written again in the meantime: that is a separate change.
            if self.changed >> block & 1 == 1 {
                continue;
            }
            if stored {
                self.stored[bytes.clone()].copy_from_slice(&self.output[bytes]);
            } else {
                self.output[bytes.clone()].copy_from_slice(&self.stored[bytes]);
            }
        }
    }

    /// Carries out a request; `answer` takes the bytes after address and function code. Returns their number.
    ///
    /// # Errors
    /// [`Exception::Address`] outside of the area: nothing is changed.
    pub fn serve(&mut self, request: &Request<'_>, answer: &mut [u8]) -> Result<usize, Exception> {
        match *request {
            Request::ReadBits { input, first, count } => {
                let (first, count) = (usize::from(first), usize::from(count));
                self.inside(first + count, 8 * self.size)?;
                let source = if input { self.input() } else { self.output() };
                let (bytes, data) = answer.split_first_mut().ok_or(Exception::Value)?;
                let data = data.get_mut(..count.div_ceil(8)).ok_or(Exception::Value)?;
                *bytes = data.len() as u8;
                data.fill(0);
                for n in 0..count {
                    data[n / 8] |= (source[(first + n) / 8] >> ((first + n) % 8) & 1) << (n % 8);
                }
                Ok(1 + data.len())
            }
            Request::ReadWords { input, first, count } => {
                let (from, len) = (2 * usize::from(first), 2 * usize::from(count));
                self.inside(from + len, self.size)?;
                let source = if input { self.input() } else { self.output() };
                let (bytes, data) = answer.split_first_mut().ok_or(Exception::Value)?;
                let data = data.get_mut(..len).ok_or(Exception::Value)?;
                *bytes = len as u8;
                data.copy_from_slice(&source[from..from + len]);
                Ok(1 + len)
            }
            Request::WriteBit { at, on } => {
                self.inside(usize::from(at) + 1, 8 * self.size)?;
                self.write_bit(usize::from(at), on);
                Ok(0)
            }
            Request::WriteBits { first, count, data } => {
                let (first, count) = (usize::from(first), usize::from(count));
                self.inside(first + count, 8 * self.size)?;
                for n in 0..count {
                    self.write_bit(first + n, data.get(n / 8).is_some_and(|byte| byte >> (n % 8) & 1 == 1));
                }
                Ok(0)
            }
            Request::WriteWords { first, data } => {
                let from = 2 * usize::from(first);
                self.inside(from + data.len(), self.size)?;
                for (n, byte) in data.iter().enumerate() {
                    self.write(from + n, *byte);
                }
                Ok(0)
            }
        }
    }

    const fn inside(&self, end: usize, size: usize) -> Result<(), Exception> {
        if end <= size { Ok(()) } else { Err(Exception::Address) }
    }

    fn write_bit(&mut self, at: usize, on: bool) {
        let mask = 1 << (at % 8);
        let byte = self.output[at / 8];
        self.write(at / 8, if on { byte | mask } else { byte & !mask });
    }

    /// "Only a changed data area is transferred to the CPU." [S0 L2263]
    fn write(&mut self, at: usize, byte: u8) {
        if self.output[at] != byte {
            self.output[at] = byte;
            self.changed |= 1 << (at / BLOCK_BYTES);
        }
    }
}

fn put(area: &mut [u8; AREA_BYTES], size: usize, bytes: &[u8]) -> bool {
    let fits = bytes.len() <= size;
    if fits {
        area[..bytes.len()].copy_from_slice(bytes);
    }
    fits
}
