//! The words of an image that have an owner: its header, and its outputs under one sequence.

use core::ops::Range;
use core::sync::atomic::{Ordering, fence};

use crate::io_layout::{
    AT_INPUT_BYTES, AT_INPUT_OFFSET, AT_INPUTS, AT_MAGIC, AT_OUTPUT_BYTES, AT_OUTPUT_OFFSET, AT_OUTPUTS, AT_OWNER,
    AT_SEQUENCE, AT_TOTAL_BYTES, AT_VERSION, IO_AREA_BYTES, IO_IMAGE_BYTES, IO_LAYOUT_VERSION, IO_MAGIC,
};
use crate::io_memory::{AREA_WORDS, ImageCells, Memory};

/// Who writes the outputs of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Owner {
    /// No owner: the PLC has ended normally, and its outputs are in their safe state.
    Nobody = 0,
    /// The PLC drives them: the outputs follow its process image.
    Cpu = 1,
    /// The guardian, because the PLC has died or stood still for too long: the outputs are in their safe state.
    Guardian = 2,
}

impl Owner {
    /// The owner of this number.
    pub const fn of(number: u64) -> Option<Self> {
        match number {
            0 => Some(Self::Nobody),
            1 => Some(Self::Cpu),
            2 => Some(Self::Guardian),
            _ => None,
        }
    }
}

/// Writes only the header words that are wrong: others read the header all the time.
pub(crate) fn put_header(cells: &ImageCells, owner: Owner) {
    let words = [
        (cells.word::<AT_MAGIC>(), IO_MAGIC),
        (cells.word::<AT_TOTAL_BYTES>(), IO_IMAGE_BYTES as u64),
        (cells.word::<AT_INPUT_OFFSET>(), AT_INPUTS as u64),
        (cells.word::<AT_INPUT_BYTES>(), IO_AREA_BYTES as u64),
        (cells.word::<AT_OUTPUT_OFFSET>(), AT_OUTPUTS as u64),
        (cells.word::<AT_OUTPUT_BYTES>(), IO_AREA_BYTES as u64),
        (cells.word::<AT_OWNER>(), owner as u64),
        (cells.word::<AT_VERSION>(), IO_LAYOUT_VERSION),
    ];
    for (cell, word) in words {
        if cell.load(Ordering::Relaxed) != word {
            cell.store(word, Ordering::Release);
        }
    }
}

/// Writes words of the output area under one sequence; `give_up` is asked before each.
pub(crate) fn put_outputs(
    cells: &ImageCells,
    from: &[u64; AREA_WORDS],
    words: Range<usize>,
    give_up: impl Fn() -> bool,
) {
    let sequence = cells.word::<AT_SEQUENCE>();
    let odd = sequence.load(Ordering::Relaxed) | 1;
    sequence.store(odd, Ordering::Relaxed);
    // As in `seqlock`: pairs with the reader's fence between its copy and its second reading of the sequence.
    fence(Ordering::Release);
    for (cell, word) in cells.area::<AT_OUTPUTS>().iter().zip(from).take(words.end).skip(words.start) {
        if give_up() {
            return;
        }
        cell.store(*word, Ordering::Relaxed);
    }
    sequence.store(odd.wrapping_add(1), Ordering::Release);
}

/// The guardian's takeover: sets all outputs to the safe state and writes the guardian into the header.
pub(crate) fn make_safe(memory: &Memory, safe: &[u64; AREA_WORDS]) {
    let cells = memory.cells();
    put_header(cells, Owner::Guardian);
    put_outputs(cells, safe, 0..AREA_WORDS, || false);
}
