//! The image of the `di do ai ao` modules: a shared memory that any program can map, to read what the PLC drives and to
//! write what it senses.
//!
//! Inputs are written by whoever likes, at any time, and every content is legal. Outputs are written by the PLC alone.
//! A value of 1, 2, 4 or 8 bytes at a multiple of its size is never torn; the outputs of one write belong together
//! under a sequence (see `docs/backplane.md`, which has the memory map and an example).

use core::ops::Range;
use core::ptr::NonNull;
use core::sync::atomic::{AtomicU64, Ordering, fence};
use std::fmt;
use std::os::fd::BorrowedFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::bytes::{extract, merged};
use crate::fault::SegmentError;
use crate::io_layout::{
    AT_INPUT_BYTES, AT_INPUT_OFFSET, AT_INPUTS, AT_MAGIC, AT_OUTPUT_BYTES, AT_OUTPUT_OFFSET, AT_OUTPUTS, AT_SCAN,
    AT_SEQUENCE, AT_TOTAL_BYTES, AT_VERSION, IO_AREA_BYTES, IO_IMAGE_BYTES, IO_LAYOUT_VERSION, IO_MAGIC,
};
use crate::memfd::SharedMemory;

const IMAGE_WORDS: usize = IO_IMAGE_BYTES / 8;
const AREA_WORDS: usize = IO_AREA_BYTES / 8;

/// The words of an image. Nothing but atomics: other programs write to it at any time.
#[repr(C, align(128))]
struct ImageCells([AtomicU64; IMAGE_WORDS]);

impl ImageCells {
    /// `AT` is one of the constants above, checked when the program is compiled.
    #[inline]
    fn word<const AT: usize>(&self) -> &AtomicU64 {
        const { assert!(AT.is_multiple_of(8) && AT < IO_IMAGE_BYTES) };
        &self.0[AT / 8]
    }

    #[inline]
    fn area<const AT: usize>(&self) -> &[AtomicU64; AREA_WORDS] {
        const { assert!(AT.is_multiple_of(8) && AT + IO_AREA_BYTES <= IO_IMAGE_BYTES) };
        let (_, area) = self.0.split_at(AT / 8);
        area.first_chunk().expect("the area lies inside the image: asserted above")
    }
}

#[derive(Clone)]
enum Keep {
    Heap(#[expect(dead_code, reason = "held only to keep the memory")] Arc<ImageCells>),
    Shared(Arc<SharedMemory>),
}

/// The PLC's end of the image.
pub struct IoImage {
    memory: Memory,
    /// What the output area holds: the PLC is its only writer.
    outputs: Box<[u64; AREA_WORDS]>,
}

/// The field's end: what the PLC drives and senses. In another process it is mapped by its path, in any language.
#[derive(Clone)]
pub struct IoField {
    memory: Memory,
}

#[derive(Clone)]
struct Memory {
    /// Points into what `keep` holds, for as long as `keep` lives.
    cells: NonNull<ImageCells>,
    keep: Keep,
}

// SAFETY: the pointer leads to memory that `keep` keeps in place, and there is nothing but atomics in it.
unsafe impl Send for Memory {}
// SAFETY: as for Send.
unsafe impl Sync for Memory {}

impl Memory {
    fn shared(memory: SharedMemory) -> Result<Self, SegmentError> {
        let cells: NonNull<ImageCells> = memory.start()?.cast();
        if memory.len() < size_of::<ImageCells>() || !cells.is_aligned() {
            return Err(SegmentError::Size { found: memory.len() as u64, expected: IO_IMAGE_BYTES as u64 });
        }
        Ok(Self { cells, keep: Keep::Shared(Arc::new(memory)) })
    }

    #[inline]
    fn cells(&self) -> &ImageCells {
        // SAFETY: `cells` points to an `ImageCells` kept alive by `keep`: an `Arc` of it, or a mapping of at least its
        // size at a page boundary whose file is sealed against shrinking. Atomics only: any content is valid, also
        // while others write.
        unsafe { self.cells.as_ref() }
    }
}

impl IoImage {
    /// An image on the heap, for tests and simulations.
    #[must_use]
    pub fn heap() -> Self {
        let cells = Arc::new(ImageCells([const { AtomicU64::new(0) }; IMAGE_WORDS]));
        Self::format(Memory { cells: NonNull::from(&*cells), keep: Keep::Heap(cells) })
    }

    /// An image that other processes can map.
    ///
    /// # Errors
    /// What the system says when it has no memory or no descriptor left.
    pub fn create_shared() -> Result<Self, SegmentError> {
        Ok(Self::format(Memory::shared(SharedMemory::create(c"ob1-io", IO_IMAGE_BYTES)?)?))
    }

    fn format(memory: Memory) -> Self {
        let cells = memory.cells();
        cells.word::<AT_MAGIC>().store(IO_MAGIC, Ordering::Relaxed);
        cells.word::<AT_TOTAL_BYTES>().store(IO_IMAGE_BYTES as u64, Ordering::Relaxed);
        cells.word::<AT_INPUT_OFFSET>().store(AT_INPUTS as u64, Ordering::Relaxed);
        cells.word::<AT_INPUT_BYTES>().store(IO_AREA_BYTES as u64, Ordering::Relaxed);
        cells.word::<AT_OUTPUT_OFFSET>().store(AT_OUTPUTS as u64, Ordering::Relaxed);
        cells.word::<AT_OUTPUT_BYTES>().store(IO_AREA_BYTES as u64, Ordering::Relaxed);
        cells.word::<AT_VERSION>().store(IO_LAYOUT_VERSION, Ordering::Release);
        Self { memory, outputs: Box::new([0; AREA_WORDS]) }
    }

    /// The path under which another process of the same user maps this image, as long as this process lives; `None` on
    /// the heap.
    #[must_use]
    pub fn path(&self) -> Option<PathBuf> {
        match &self.memory.keep {
            Keep::Heap(_) => None,
            Keep::Shared(memory) => Some(memory.path()),
        }
    }

    /// The descriptor of a shared image, for a runtime that passes it on.
    #[must_use]
    pub fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        match &self.memory.keep {
            Keep::Heap(_) => None,
            Keep::Shared(memory) => Some(memory.descriptor()),
        }
    }

    /// The other end.
    #[must_use]
    pub fn field(&self) -> IoField {
        IoField { memory: self.memory.clone() }
    }

    /// Copies the input bytes from `offset` on; what lies outside the area reads 0. Returns how many lay inside.
    pub fn read_inputs(&self, offset: usize, into: &mut [u8]) -> usize {
        read_area(self.memory.cells().area::<AT_INPUTS>(), offset, into)
    }

    /// Writes output bytes from `offset` on, under one sequence: they belong together. What lies outside the area is
    /// ignored. Touches nothing that does not change. Returns how many lay inside.
    pub fn write_outputs(&mut self, offset: usize, data: &[u8]) -> usize {
        let inside = clip(offset, data.len());
        let differs = pieces(&inside).any(|(index, first, place)| {
            let (word, chunk) = (self.outputs.get(index), data.get(place).unwrap_or_default());
            word.is_some_and(|word| merged(*word, first, chunk) != *word)
        });
        if !differs {
            return inside.len();
        }
        let cells = self.memory.cells();
        let sequence = cells.word::<AT_SEQUENCE>();
        let odd = sequence.load(Ordering::Relaxed) | 1;
        sequence.store(odd, Ordering::Relaxed);
        // As in `seqlock`: pairs with the reader's fence between its copy and its second look at the sequence.
        fence(Ordering::Release);
        let area = cells.area::<AT_OUTPUTS>();
        for (index, first, place) in pieces(&inside) {
            if let (Some(word), Some(cell)) = (self.outputs.get_mut(index), area.get(index)) {
                *word = merged(*word, first, data.get(place).unwrap_or_default());
                cell.store(*word, Ordering::Relaxed);
            }
        }
        sequence.store(odd.wrapping_add(1), Ordering::Release);
        inside.len()
    }

    /// Tells other programs that a scan has ended and its outputs are written; `scan` is its number.
    pub fn scan_done(&mut self, scan: u64) {
        self.memory.cells().word::<AT_SCAN>().store(scan, Ordering::Release);
    }
}

impl IoField {
    /// Maps the image of another process by its path, like `/proc/PID/fd/N`.
    ///
    /// # Errors
    /// [`SegmentError`] if that is no image of this layout version.
    pub fn open(path: &Path) -> Result<Self, SegmentError> {
        let memory = Memory::shared(SharedMemory::open(path, IO_IMAGE_BYTES)?)?;
        let header = |at: usize| memory.cells().0.get(at / 8).map_or(0, |cell| cell.load(Ordering::Acquire));
        for (at, field, expected) in
            [(AT_VERSION, "image.version", IO_LAYOUT_VERSION), (AT_MAGIC, "image.magic", IO_MAGIC)]
        {
            let found = header(at);
            if found != expected {
                return Err(SegmentError::Header { field, found });
            }
        }
        Ok(Self { memory })
    }

    /// Copies the output bytes from `offset` on; what lies outside the area reads 0. Returns how many lay inside.
    pub fn read_outputs(&self, offset: usize, into: &mut [u8]) -> usize {
        read_area(self.memory.cells().area::<AT_OUTPUTS>(), offset, into)
    }

    /// Copies the input bytes from `offset` on, as they were written last; what lies outside the area reads 0. Returns
    /// how many lay inside.
    pub fn read_inputs(&self, offset: usize, into: &mut [u8]) -> usize {
        read_area(self.memory.cells().area::<AT_INPUTS>(), offset, into)
    }

    /// Writes input bytes from `offset` on; what lies outside the area is ignored. Two threads that write into the same
    /// eight bytes undo each other's writes. Returns how many lay inside.
    pub fn write_inputs(&self, offset: usize, data: &[u8]) -> usize {
        let inside = clip(offset, data.len());
        let area = self.memory.cells().area::<AT_INPUTS>();
        for (index, first, place) in pieces(&inside) {
            if let (Some(cell), Some(chunk)) = (area.get(index), data.get(place)) {
                cell.store(merged(cell.load(Ordering::Relaxed), first, chunk), Ordering::Relaxed);
            }
        }
        inside.len()
    }

    /// Number of the last scan that has ended.
    #[must_use]
    pub fn scan(&self) -> u64 {
        self.memory.cells().word::<AT_SCAN>().load(Ordering::Acquire)
    }

    /// Reads one word by its offset in the memory map; `None` outside or off a word's boundary.
    #[must_use]
    pub fn peek(&self, offset: usize) -> Option<u64> {
        let cell = offset.is_multiple_of(8).then(|| self.memory.cells().0.get(offset / 8)).flatten();
        cell.map(|cell| cell.load(Ordering::Acquire))
    }

    /// Fills the whole image with noise, word by word: what a program gone mad may do. For tests.
    pub fn scribble(&self, mut noise: impl FnMut(usize) -> u64) {
        for (index, cell) in self.memory.cells().0.iter().enumerate() {
            cell.store(noise(index * 8), Ordering::Relaxed);
        }
    }
}

/// The part of `offset..offset + len` that lies inside an area.
fn clip(offset: usize, len: usize) -> Range<usize> {
    let start = offset.min(IO_AREA_BYTES);
    start..offset.saturating_add(len).min(IO_AREA_BYTES).max(start)
}

/// Cuts a part of an area at its words: index of the word, first byte in it, and where its bytes lie in the data.
fn pieces(inside: &Range<usize>) -> impl Iterator<Item = (usize, usize, Range<usize>)> {
    let Range { start, end } = *inside;
    (start / 8..end.div_ceil(8)).map(move |index| {
        let from = start.max(index * 8);
        let to = end.min(index * 8 + 8);
        (index, from - index * 8, from - start..to - start)
    })
}

fn read_area(area: &[AtomicU64; AREA_WORDS], offset: usize, into: &mut [u8]) -> usize {
    let inside = clip(offset, into.len());
    for (index, first, place) in pieces(&inside) {
        if let (Some(cell), Some(chunk)) = (area.get(index), into.get_mut(place)) {
            extract(cell.load(Ordering::Relaxed), first, chunk);
        }
    }
    into.get_mut(inside.len()..).unwrap_or_default().fill(0);
    inside.len()
}

impl fmt::Debug for IoImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("IoImage").field("path", &self.path()).finish_non_exhaustive()
    }
}
