//! The image of a bus: the inputs, outputs and couplers of one line of remote modules, between the scan and the process
//! that owns the line.
//!
//! Each side publishes whole numbered images. There are three slots per direction, and the number tells which is the
//! newest. A reader takes the newest whole image. It never waits: only a writer that publishes twice more during the
//! copy gets in its way, and then the reader tries again, a few times. A reader trusts nothing but the bytes; what the
//! words about a coupler mean is agreed elsewhere.

use core::ops::Range;
use core::sync::atomic::{AtomicU64, Ordering};
use std::fmt;
use std::os::fd::{BorrowedFd, OwnedFd};

use crate::bytes::{copy_out, overlay};
use crate::fault::SegmentError;
use crate::io_layout::IO_AREA_BYTES;
use crate::io_memory::{Cells, Memory};
use crate::seqlock::{Freshness, SeqCell, TRIES};

/// Couplers on a bus, at most.
pub const BUS_COUPLERS: usize = if cfg!(miri) { 4 } else { 256 };
/// Words about a coupler.
pub const COUPLER_WORDS: usize = 8;
/// Bytes of inputs, and as many of outputs, that a bus can have.
pub const BUS_AREA_BYTES: usize = if cfg!(miri) { 64 } else { IO_AREA_BYTES };

const SLOTS: u64 = 3;
const AREA_WORDS: usize = BUS_AREA_BYTES / 8;
/// The image of the process: the couplers, then the inputs.
const INPUT_WORDS: usize = BUS_COUPLERS * COUPLER_WORDS + AREA_WORDS;
/// The image of the scan: whether the outputs are driven, then the outputs.
const OUTPUT_WORDS: usize = 1 + AREA_WORDS;

/// One direction: the number of the newest image, and the slots. Each has one writer and so its own cache line.
#[repr(C, align(128))]
struct Way<const N: usize> {
    newest: AtomicU64,
    slots: [SeqCell<N>; SLOTS as usize],
}

impl<const N: usize> Default for Way<N> {
    fn default() -> Self {
        Self { newest: AtomicU64::new(0), slots: Default::default() }
    }
}

impl<const N: usize> Way<N> {
    fn slot(&self, number: u64) -> &SeqCell<N> {
        &self.slots[(number % SLOTS) as usize]
    }

    fn publish(&self, words: impl Iterator<Item = u64>) {
        let next = self.newest.load(Ordering::Relaxed).wrapping_add(1);
        self.slot(next).write(words);
        // Pairs with the load(Acquire) in `take`: a reader of this number finds that image in its slot, or a newer one.
        self.newest.store(next, Ordering::Release);
    }

    /// Takes the newest image if its number is not `last`. `None`: there is no newer image.
    fn take(&self, last: &mut u64, into: &mut [u64]) -> Option<Freshness> {
        for _ in 0..TRIES {
            let newest = self.newest.load(Ordering::Acquire);
            if newest == *last {
                return None;
            }
            if self.slot(newest).copy(into) {
                *last = newest;
                return Some(Freshness::Fresh);
            }
        }
        Some(Freshness::Stale)
    }
}

/// The memory of a bus image.
#[repr(C, align(128))]
#[derive(Default)]
pub(crate) struct BusCells {
    inputs: Way<INPUT_WORDS>,
    outputs: Way<OUTPUT_WORDS>,
}

// SAFETY: atomics only, `repr(C)`; every content is valid.
unsafe impl Cells for BusCells {
    const BYTES: usize = size_of::<Self>();

    fn zeros() -> std::sync::Arc<Self> {
        std::sync::Arc::default()
    }
}

/// The used part of an image; both ends know it from the configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusSize {
    couplers: usize,
    inputs: usize,
    outputs: usize,
}

impl BusSize {
    /// A size in couplers, input bytes and output bytes; `None` if this is too much for a bus.
    pub const fn new(couplers: usize, inputs: usize, outputs: usize) -> Option<Self> {
        if couplers > BUS_COUPLERS || inputs > BUS_AREA_BYTES || outputs > BUS_AREA_BYTES {
            return None;
        }
        Some(Self { couplers, inputs, outputs })
    }

    const fn input_words(self) -> usize {
        self.couplers * COUPLER_WORDS + self.inputs.div_ceil(8)
    }

    const fn output_words(self) -> usize {
        1 + self.outputs.div_ceil(8)
    }

    /// The words of the inputs, which follow those of the couplers.
    const fn input_range(self) -> Range<usize> {
        self.couplers * COUPLER_WORDS..self.input_words()
    }
}

/// The memory that the runtime creates and hands over. Clones are handles of the same memory.
#[derive(Clone)]
pub struct BusMemory {
    memory: Memory<BusCells>,
}

impl BusMemory {
    /// On the heap, for tests and simulations.
    pub fn heap() -> Self {
        Self { memory: Memory::heap() }
    }

    /// Memory that can be handed over.
    ///
    /// # Errors
    /// The system's error when it has no memory or no descriptor left.
    pub fn create_shared() -> Result<Self, SegmentError> {
        Ok(Self { memory: Memory::create(c"ob1-bus")? })
    }

    /// The memory that was handed over.
    ///
    /// # Errors
    /// [`SegmentError`] if it is not a sealed file of the right size.
    pub fn received(file: OwnedFd) -> Result<Self, SegmentError> {
        Ok(Self { memory: Memory::received(file)? })
    }

    /// The descriptor, to hand over; `None` on the heap.
    pub fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        self.memory.descriptor()
    }

    /// Fills the memory with noise, word by word: what a faulty process may do. For tests.
    pub fn scribble(&self, mut noise: impl FnMut() -> u64) {
        let cells = self.memory.cells();
        for (newest, slots) in [
            (
                &cells.inputs.newest,
                &mut cells.inputs.slots.iter().flat_map(SeqCell::words) as &mut dyn Iterator<Item = _>,
            ),
            (&cells.outputs.newest, &mut cells.outputs.slots.iter().flat_map(SeqCell::words)),
        ] {
            newest.store(noise(), Ordering::Relaxed);
            slots.for_each(|word| word.store(noise(), Ordering::Relaxed));
        }
    }
}

/// The scan's end: it takes inputs and gives outputs. It neither allocates nor waits, and makes no system call.
pub struct BusCpuSide {
    memory: BusMemory,
    size: BusSize,
    taken: u64,
    inputs: Box<[u64]>,
    outputs: Box<[u64]>,
    stale: u64,
}

impl BusCpuSide {
    /// The one end of this kind of a memory.
    pub fn new(memory: &BusMemory, size: BusSize) -> Self {
        let zeros = |words| vec![0; words].into_boxed_slice();
        let (inputs, outputs) = (zeros(size.input_words()), zeros(size.output_words()));
        Self { memory: memory.clone(), size, taken: 0, inputs, outputs, stale: 0 }
    }

    /// Takes the newest whole image of the inputs; true if there was a new one.
    pub fn take(&mut self) -> bool {
        match self.memory.memory.cells().inputs.take(&mut self.taken, &mut self.inputs) {
            Some(Freshness::Fresh) => true,
            Some(Freshness::Stale) => {
                self.stale = self.stale.wrapping_add(1);
                false
            }
            None => false,
        }
    }

    /// The words about a coupler in the image taken last; zeros if there is no such coupler.
    pub fn coupler(&self, index: usize) -> [u64; COUPLER_WORDS] {
        let first = index * COUPLER_WORDS;
        let words = self.inputs.get(first..first + COUPLER_WORDS).filter(|_| index < self.size.couplers);
        words.and_then(|words| words.try_into().ok()).unwrap_or_default()
    }

    /// Copies input bytes of the image taken last; bytes outside it read 0.
    pub fn inputs(&self, at: usize, into: &mut [u8]) {
        let words = self.inputs.get(self.size.input_range()).unwrap_or_default();
        for (n, byte) in into.iter_mut().enumerate() {
            let at = at + n;
            let word = words.get(at / 8).filter(|_| at < self.size.inputs);
            *byte = word.map_or(0, |word| word.to_ne_bytes()[at % 8]);
        }
    }

    /// Publishes the outputs if anything has changed; true if so.
    pub fn publish(&mut self, driven: bool, outputs: &[u8]) -> bool {
        let (head, area) = self.outputs.split_at_mut(1);
        let bytes = outputs.get(..outputs.len().min(self.size.outputs)).unwrap_or_default();
        let same = head[0] == u64::from(driven) && same(area, bytes);
        if same {
            return false;
        }
        head[0] = u64::from(driven);
        overlay(area, bytes);
        self.rewrite();
        true
    }

    /// Publishes the outputs again, in case somebody has overwritten them.
    pub fn rewrite(&self) {
        self.memory.memory.cells().outputs.publish(self.outputs.iter().copied());
    }

    /// Reads of the inputs that found no whole image.
    pub const fn stale(&self) -> u64 {
        self.stale
    }
}

fn same(words: &[u64], bytes: &[u8]) -> bool {
    words.iter().zip(bytes.chunks(8)).all(|(word, chunk)| word.to_ne_bytes().starts_with(chunk))
}

/// The process's end: it gives inputs and takes outputs.
pub struct BusProcessSide {
    memory: BusMemory,
    size: BusSize,
    taken: u64,
    outputs: Box<[u64]>,
}

impl BusProcessSide {
    /// The one end of this kind of a memory.
    pub fn new(memory: &BusMemory, size: BusSize) -> Self {
        let outputs = vec![0; size.output_words()].into_boxed_slice();
        Self { memory: memory.clone(), size, taken: 0, outputs }
    }

    /// Publishes an image: the words about each coupler in turn, and the inputs.
    pub fn publish(&mut self, couplers: impl Iterator<Item = [u64; COUPLER_WORDS]>, inputs: &[u8]) {
        let size = self.size;
        let about = couplers.chain(core::iter::repeat([0; COUPLER_WORDS])).take(size.couplers).flatten();
        let bytes = inputs.get(..inputs.len().min(size.inputs)).unwrap_or_default();
        self.memory.memory.cells().inputs.publish(about.chain(crate::bytes::words_of(bytes)));
    }

    /// Takes the newest whole outputs into `into` if they are newer than the last; returns whether they are driven.
    pub fn take(&mut self, into: &mut [u8]) -> Option<bool> {
        match self.memory.memory.cells().outputs.take(&mut self.taken, &mut self.outputs) {
            Some(Freshness::Fresh) => {}
            Some(Freshness::Stale) | None => return None,
        }
        let (head, area) = self.outputs.split_at(1);
        copy_out(area, into);
        Some(head[0] == 1)
    }
}

/// A read-only view of what both sides have published last.
pub struct BusLook {
    scan: BusCpuSide,
    process: BusProcessSide,
}

impl BusLook {
    /// Takes a view of the memory now; `None` if both sides write too fast for a whole image.
    pub fn new(memory: &BusMemory, size: BusSize) -> Option<Self> {
        let mut look = Self { scan: BusCpuSide::new(memory, size), process: BusProcessSide::new(memory, size) };
        look.scan.take();
        let _driven = look.process.take(&mut []);
        (look.scan.stale() == 0).then_some(look)
    }

    /// The words of a coupler at the process's last image; see [`BusCpuSide::coupler`].
    pub fn coupler(&self, index: usize) -> [u64; COUPLER_WORDS] {
        self.scan.coupler(index)
    }

    /// Copies input bytes of the process's last image; see [`BusCpuSide::inputs`].
    pub fn inputs(&self, at: usize, into: &mut [u8]) {
        self.scan.inputs(at, into);
    }

    /// Copies output bytes; bytes outside the image read 0.
    pub fn outputs(&self, at: usize, into: &mut [u8]) {
        let area = self.process.outputs.get(1..).unwrap_or_default();
        for (n, byte) in into.iter_mut().enumerate() {
            let word = area.get((at + n) / 8).filter(|_| at + n < self.process.size.outputs);
            *byte = word.map_or(0, |word| word.to_ne_bytes()[(at + n) % 8]);
        }
    }

    /// Whether the scan drives the outputs.
    pub fn driven(&self) -> bool {
        self.process.outputs.first() == Some(&1)
    }
}

impl fmt::Debug for BusMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BusMemory").finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ends(memory: &BusMemory) -> (BusCpuSide, BusProcessSide) {
        let size = BusSize::new(2, 12, 9).expect("it fits");
        (BusCpuSide::new(memory, size), BusProcessSide::new(memory, size))
    }

    #[test]
    fn images_go_both_ways_whole() {
        let (mut cpu, mut process) = ends(&BusMemory::heap());
        assert!(!cpu.take());
        assert_eq!(process.take(&mut [0; 9]), None);
        process.publish([[1; 8], [2; 8], [3; 8]].into_iter(), &[7; 40]);
        process.publish([[4; 8], [5; 8]].into_iter(), &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
        assert!(cpu.take() && !cpu.take());
        assert_eq!((cpu.coupler(0), cpu.coupler(1), cpu.coupler(2)), ([4; 8], [5; 8], [0; 8]));
        let mut bytes = [0xFF; 6];
        cpu.inputs(7, &mut bytes);
        assert_eq!(bytes, [8, 9, 10, 11, 12, 0]);

        assert!(cpu.publish(true, &[1, 2, 3, 4, 5, 6, 7, 8, 9]) && !cpu.publish(true, &[1, 2, 3, 4, 5, 6, 7, 8, 9]));
        let mut bytes = [0; 9];
        assert_eq!(process.take(&mut bytes), Some(true));
        assert_eq!(bytes, [1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert!(cpu.publish(false, &[1, 2, 3, 4, 5, 6, 7, 8, 9]));
        assert_eq!(process.take(&mut bytes), Some(false));
        assert_eq!(process.take(&mut bytes), None);
    }

    #[test]
    fn who_looks_sees_both_ways_and_takes_nothing() {
        let memory = BusMemory::heap();
        let (mut cpu, mut process) = ends(&memory);
        process.publish([[1; 8], [2; 8]].into_iter(), &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
        cpu.publish(true, &[9, 8, 7, 6, 5, 4, 3, 2, 1]);
        let look = BusLook::new(&memory, BusSize::new(2, 12, 9).expect("it fits")).expect("whole");
        let (mut inputs, mut outputs) = ([0xFF; 3], [0xFF; 3]);
        look.inputs(7, &mut inputs);
        look.outputs(7, &mut outputs);
        assert_eq!((inputs, outputs, look.driven(), look.coupler(1)), ([8, 9, 10], [2, 1, 0], true, [2; 8]));
        assert!(cpu.take(), "still there for the scan");
        assert_eq!(process.take(&mut [0; 9]), Some(true), "and for the process");
    }

    #[test]
    fn a_bus_has_its_limits() {
        assert_eq!(BusSize::new(BUS_COUPLERS + 1, 0, 0), None);
        assert_eq!(BusSize::new(0, BUS_AREA_BYTES + 1, 0), None);
        assert!(BusSize::new(BUS_COUPLERS, BUS_AREA_BYTES, BUS_AREA_BYTES).is_some());
    }

    #[test]
    fn noise_is_neither_waited_for_nor_a_panic() {
        let memory = BusMemory::heap();
        let (mut cpu, mut process) = ends(&memory);
        let mut noise = 1_u64;
        for _ in 0..if cfg!(miri) { 5 } else { 50 } {
            memory.scribble(|| {
                noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                noise
            });
            let _ = (cpu.take(), process.take(&mut [0; 9]));
        }
        // The next image published is seen again.
        process.publish([[9; 8], [9; 8]].into_iter(), &[9; 12]);
        assert!(cpu.take());
        cpu.rewrite();
        let mut bytes = [1; 9];
        assert_eq!(process.take(&mut bytes), Some(false));
        assert_eq!((cpu.coupler(1), bytes), ([9; 8], [0; 9]));
    }

    /// Not under Miri, which has no shared memory.
    #[cfg(not(miri))]
    #[test]
    fn an_image_is_whole_while_it_is_written_all_the_time() {
        let memory = BusMemory::create_shared().expect("memory");
        let received = memory.descriptor().expect("shared").try_clone_to_owned().expect("a descriptor");
        let other = BusMemory::received(received).expect("the same memory");
        let (mut cpu, _) = ends(&memory);
        let (_, mut process) = ends(&other);
        let done = std::sync::atomic::AtomicBool::new(false);
        #[expect(clippy::disallowed_methods, reason = "two ends in two threads")]
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for n in 0..60_000_u64 {
                    process.publish([[n; 8], [n; 8]].into_iter(), &[n as u8; 12]);
                }
                done.store(true, Ordering::Release);
            });
            let mut seen = 0;
            while !done.load(Ordering::Acquire) {
                if cpu.take() {
                    let mut bytes = [0; 12];
                    cpu.inputs(0, &mut bytes);
                    let [first, ..] = cpu.coupler(0);
                    assert_eq!((cpu.coupler(1), bytes), ([first; 8], [first as u8; 12]));
                    assert!(first >= seen, "an older image after a newer one");
                    seen = first;
                }
            }
        });
    }
}
