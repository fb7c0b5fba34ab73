//! Memory of a plugin's blocks in one station: allocated before the first scan, zeroed at every start-up.

use std::cell::UnsafeCell;
use std::collections::BTreeMap;
use std::ffi::c_void;

use super::settings::{PluginModule, Setting};

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
            // SAFETY: the pointer of an UnsafeCell in a living box; one thread at a time has the blocks of this station
            // (`StationMemory`), and the CPU resets them while none runs.
            unsafe { chunk.get().write_bytes(0, 1) };
        }
    }
}

/// A plugin's memory for each module of a station, and the module's settings.
pub(super) struct StationMemory {
    /// By logical base address, ascending.
    modules: Vec<(PluginModule, State)>,
}

// SAFETY: the memory is reached through the blocks of one station alone. `Plugin::station` hands them out as `Natives`,
// which go to another thread all at once and are not `Sync`: one thread at a time has them.
unsafe impl Send for StationMemory {}
// SAFETY: as for Send.
unsafe impl Sync for StationMemory {}

impl StationMemory {
    pub(super) fn new(bytes: usize, modules: &[PluginModule]) -> Self {
        let mut modules = modules.to_vec();
        modules.sort_by_key(|module| module.address);
        modules.dedup_by_key(|module| module.address);
        Self { modules: modules.into_iter().map(|module| (module, State::new(bytes))).collect() }
    }

    fn find(&self, address: u32) -> Option<&(PluginModule, State)> {
        let at = self.modules.binary_search_by_key(&address, |(module, _)| module.address).ok()?;
        self.modules.get(at)
    }

    /// The plugin's memory for the module at a logical base address.
    pub(super) fn module(&self, address: u32) -> Option<*mut c_void> {
        self.find(address).map(|(_, state)| state.pointer())
    }

    /// The settings of the module at a logical base address.
    pub(super) fn settings(&self, address: u32) -> Option<&BTreeMap<String, Setting>> {
        self.find(address).map(|(module, _)| &module.settings)
    }

    pub(super) fn clear(&self) {
        for (_, state) in &self.modules {
            state.clear();
        }
    }
}
