//! The image of the `di do ai ao` modules: a shared memory that any program can map, to read what the PLC drives and to
//! write what it senses.
//!
//! Any program may write inputs at any time, and every content is legal. Only the PLC writes outputs, until its
//! guardian takes them over ([`GuardPage`]). A value of 1, 2, 4 or 8 bytes at a multiple of its size is never torn; the
//! outputs of one write belong together under a sequence (see `docs/backplane.md`, which has the memory map and an
//! example).

use core::ops::Range;
use core::sync::atomic::{AtomicU64, Ordering, fence};
use std::fmt;
use std::os::fd::BorrowedFd;
use std::path::{Path, PathBuf};

use crate::bytes::{extract, merged};
use crate::fault::SegmentError;
use crate::io_guard::{GuardPage, Guardian};
use crate::io_layout::{
    AT_ALIVE, AT_INPUTS, AT_MAGIC, AT_OUTPUTS, AT_OWNER, AT_SCAN, AT_VERSION, IO_AREA_BYTES, IO_IMAGE_BYTES,
    IO_LAYOUT_VERSION, IO_MAGIC,
};
use crate::io_memory::{AREA_WORDS, Memory};
use crate::io_outputs::{Owner, put_header, put_outputs};
use crate::memfd::SharedMemory;

/// The PLC's end of the image.
pub struct IoImage {
    memory: Memory,
    guard: GuardPage,
    /// A copy of the output area, whose only writer is the PLC.
    outputs: Box<[u64; AREA_WORDS]>,
    /// Its content in the safe state.
    safe: Box<[u64; AREA_WORDS]>,
    /// Words of the area, from its start, that were ever driven: the words after them are not checked in each cycle.
    used: usize,
}

/// The field's end: reads what the PLC drives, writes what it senses. Another process, in any language, maps the image
/// by its path.
#[derive(Clone)]
pub struct IoField {
    memory: Memory,
}

impl IoImage {
    /// An image on the heap, for tests and simulations.
    pub fn heap() -> Self {
        Self::format(Memory::heap(), GuardPage::heap())
    }

    /// An image that other processes can map.
    ///
    /// # Errors
    /// The system's error if no memory or no descriptor is left.
    pub fn create_shared() -> Result<Self, SegmentError> {
        Ok(Self::format(Memory::create(c"ob1-io")?, GuardPage::create_shared()?))
    }

    fn format(memory: Memory, guard: GuardPage) -> Self {
        put_header(memory.cells(), Owner::Cpu);
        let area = || Box::new([0; AREA_WORDS]);
        Self { memory, guard, outputs: area(), safe: area(), used: 0 }
    }

    /// The page that the guardian gets besides this image.
    pub const fn guard(&self) -> &GuardPage {
        &self.guard
    }

    /// Sets the safe state of the output bytes from `offset` on, and writes it to the outputs.
    pub fn set_safe(&mut self, offset: usize, data: &[u8]) {
        for (index, first, place) in pieces(&clip(offset, data.len())) {
            if let Some(word) = self.safe.get_mut(index) {
                *word = merged(*word, first, data.get(place).unwrap_or_default());
            }
        }
        self.write_outputs(offset, data);
    }

    /// The safe state, as bytes of the output area.
    pub fn safe_state(&self) -> Vec<u8> {
        self.safe.iter().flat_map(|word| word.to_ne_bytes()).collect()
    }

    /// The path under which another process of the same user maps this image, as long as this process lives; `None` on
    /// the heap.
    pub fn path(&self) -> Option<PathBuf> {
        self.memory.path()
    }

    /// The descriptor of a shared image, for a runtime that passes it on.
    pub fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        self.memory.descriptor()
    }

    /// The end of whoever plays the process: it reads outputs and writes inputs.
    pub fn field(&self) -> IoField {
        IoField { memory: self.memory.clone() }
    }

    /// Copies the input bytes from `offset` on; bytes outside the area read 0. Returns how many are inside.
    pub fn read_inputs(&self, offset: usize, into: &mut [u8]) -> usize {
        read_area(self.memory.cells().area::<AT_INPUTS>(), offset, into)
    }

    /// Writes output bytes from `offset` on, under one sequence: they belong together. Bytes outside the area are
    /// ignored. Writes only what has changed, and nothing once the guardian has taken over. Returns how many bytes are
    /// inside.
    pub fn write_outputs(&mut self, offset: usize, data: &[u8]) -> usize {
        let inside = clip(offset, data.len());
        self.used = self.used.max(inside.end.div_ceil(8));
        let mut differs = false;
        for (index, first, place) in pieces(&inside) {
            if let Some(word) = self.outputs.get_mut(index) {
                let new = merged(*word, first, data.get(place).unwrap_or_default());
                differs |= new != *word;
                *word = new;
            }
        }
        if differs {
            self.put(inside.start / 8..inside.end.div_ceil(8));
        }
        inside.len()
    }

    /// Puts words of the copy into the image, if it is ours.
    fn put(&self, words: Range<usize>) {
        if self.guard.is_taken() {
            return;
        }
        put_outputs(self.memory.cells(), &self.outputs, words, || self.guard.is_taken());
        // The other half is in `Guardian::take_over`: either the guardian sees what was written here and overwrites it,
        // or this process sees that the guardian has taken over. A process can be stopped at any point.
        fence(Ordering::SeqCst);
        if self.guard.is_taken() {
            put_outputs(self.memory.cells(), &self.safe, 0..AREA_WORDS, || false);
        }
    }

    /// Call once per cycle, also in STOP: undoes outside changes to what belongs to the PLC, and gives a sign of life.
    pub fn refresh(&mut self) {
        self.guard.beat();
        if self.guard.is_taken() {
            return;
        }
        let cells = self.memory.cells();
        put_header(cells, Owner::Cpu);
        let area = cells.area::<AT_OUTPUTS>();
        let mut pairs = area.iter().zip(self.outputs.iter()).take(self.used);
        let changed = pairs.any(|(cell, word)| cell.load(Ordering::Relaxed) != *word);
        if changed {
            self.put(0..AREA_WORDS);
        }
        let alive = cells.word::<AT_ALIVE>();
        alive.store(alive.load(Ordering::Relaxed).wrapping_add(1), Ordering::Release);
    }

    /// Sets the outputs to their safe state permanently: they are not changed after that.
    pub fn let_go(&mut self) {
        self.outputs.clone_from(&self.safe);
        self.put(0..AREA_WORDS);
        if !self.guard.is_taken() {
            self.memory.cells().word::<AT_OWNER>().store(Owner::Nobody as u64, Ordering::Release);
            self.guard.let_go();
        }
    }

    /// Tells other programs that a scan has ended and its outputs are written; `scan` is its number.
    pub fn scan_done(&mut self, scan: u64) {
        if !self.guard.is_taken() {
            self.memory.cells().word::<AT_SCAN>().store(scan, Ordering::Release);
        }
    }
}

impl Guardian {
    /// The guardian of an image in the same process. For tests.
    pub fn beside(image: &IoImage) -> Self {
        Self::over(image.memory.clone(), image.guard.clone(), &image.safe_state())
    }
}

impl IoField {
    /// Maps the image of another process by its path, like `/proc/PID/fd/N`.
    ///
    /// # Errors
    /// [`SegmentError`] if that is not an image of this layout version.
    pub fn open(path: &Path) -> Result<Self, SegmentError> {
        let memory: Memory = Memory::shared(SharedMemory::open(path, &[IO_IMAGE_BYTES])?)?;
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

    /// Copies the output bytes from `offset` on; bytes outside the area read 0. Returns how many are inside.
    pub fn read_outputs(&self, offset: usize, into: &mut [u8]) -> usize {
        read_area(self.memory.cells().area::<AT_OUTPUTS>(), offset, into)
    }

    /// Copies the input bytes from `offset` on, as they were written last; bytes outside the area read 0. Returns how
    /// many are inside.
    pub fn read_inputs(&self, offset: usize, into: &mut [u8]) -> usize {
        read_area(self.memory.cells().area::<AT_INPUTS>(), offset, into)
    }

    /// Writes input bytes from `offset` on; bytes outside the area are ignored. Two threads that write into the same
    /// eight bytes can undo each other's writes. Returns how many bytes are inside.
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
    pub fn scan(&self) -> u64 {
        self.memory.cells().word::<AT_SCAN>().load(Ordering::Acquire)
    }

    /// A number that changes with every cycle of a running PLC, also in STOP.
    pub fn alive(&self) -> u64 {
        self.memory.cells().word::<AT_ALIVE>().load(Ordering::Acquire)
    }

    /// Who writes the outputs, according to the image; `None` if its word has no meaning.
    pub fn owner(&self) -> Option<Owner> {
        Owner::of(self.memory.cells().word::<AT_OWNER>().load(Ordering::Acquire))
    }

    /// Reads one word by its offset in the memory map; `None` outside or if unaligned.
    pub fn peek(&self, offset: usize) -> Option<u64> {
        self.memory.peek(offset)
    }

    /// Writes output bytes from `offset` on, as a misbehaving program would. For tests.
    pub fn trespass(&self, offset: usize, data: &[u8]) {
        let area = self.memory.cells().area::<AT_OUTPUTS>();
        for (index, first, place) in pieces(&clip(offset, data.len())) {
            if let (Some(cell), Some(chunk)) = (area.get(index), data.get(place)) {
                cell.store(merged(cell.load(Ordering::Relaxed), first, chunk), Ordering::Relaxed);
            }
        }
    }

    /// Fills the whole image with noise, word by word: what a faulty program may do. For tests.
    pub fn scribble(&self, mut noise: impl FnMut(usize) -> u64) {
        for (index, cell) in self.memory.cells().0.iter().enumerate() {
            cell.store(noise(index * 8), Ordering::Relaxed);
        }
    }
}

/// The part of `offset..offset + len` inside an area.
fn clip(offset: usize, len: usize) -> Range<usize> {
    let start = offset.min(IO_AREA_BYTES);
    start..offset.saturating_add(len).min(IO_AREA_BYTES).max(start)
}

/// Splits a part of an area at word boundaries: index of the word, first byte in it, and the range of its bytes in the
/// data.
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
