//! Memory of a plugin's blocks in one station: allocated before the first scan, zeroed at every start-up.

use std::cell::UnsafeCell;
use std::ffi::c_void;

/// The interface promises an alignment of 16 bytes.
#[repr(C, align(16))]
struct Chunk([u8; 16]);

/// Zeroed memory that only the plugin looks into.
pub(super) struct State {
    chunks: Box<[UnsafeCell<Chunk>]>,
}

impl State {
    pub(super) fn new(bytes: usize) -> Self {
        Self { chunks: (0..bytes.div_ceil(16)).map(|_| UnsafeCell::new(Chunk([0; 16]))).collect() }
    }

    /// Where it lies; null when there is none.
    pub(super) fn pointer(&self) -> *mut c_void {
        if self.chunks.is_empty() {
            return std::ptr::null_mut();
        }
        // A pointer to the whole slice, interior mutability included.
        std::ptr::from_ref(&*self.chunks).cast::<c_void>().cast_mut()
    }

    /// Fills it with zeros. No block of the plugin runs meanwhile.
    pub(super) fn clear(&self) {
        for chunk in &self.chunks {
            // SAFETY: the pointer of an UnsafeCell in a living box; blocks of this station run on the thread of the CPU, which is
            // the one that resets them (`Plugin::station`), and not during a reset.
            unsafe { chunk.get().write_bytes(0, 1) };
        }
    }
}

/// A plugin's memory for each module of a station.
pub(super) struct StationMemory {
    /// By logical base address, ascending.
    modules: Vec<(u32, State)>,
}

// SAFETY: the memory is reached through the blocks of one station alone, and `Plugin::station` binds them to one CPU, which runs
// them on one thread at a time.
unsafe impl Send for StationMemory {}
// SAFETY: as for Send.
unsafe impl Sync for StationMemory {}

impl StationMemory {
    pub(super) fn new(bytes: usize, modules: &[u32]) -> Self {
        let mut addresses = modules.to_vec();
        addresses.sort_unstable();
        addresses.dedup();
        Self { modules: addresses.into_iter().map(|address| (address, State::new(bytes))).collect() }
    }

    /// The plugin's memory for the module at a logical base address.
    pub(super) fn module(&self, address: u32) -> Option<*mut c_void> {
        let at = self.modules.binary_search_by_key(&address, |(address, _)| *address).ok()?;
        self.modules.get(at).map(|(_, state)| state.pointer())
    }

    pub(super) fn clear(&self) {
        for (_, state) in &self.modules {
            state.clear();
        }
    }
}
