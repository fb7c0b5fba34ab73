//! Memory of a plugin's blocks in one station: allocated before the first scan, zeroed at every start-up.
//!
//! The blocks of a station share memory, and each can be sent to another thread by itself. So whoever runs or resets
//! one of them asks first ([`StationMemory::enter`]): one thread at a time is inside, and nobody ever waits.

use std::cell::UnsafeCell;
use std::collections::BTreeMap;
use std::ffi::c_void;
use std::sync::atomic::{AtomicUsize, Ordering};

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

    /// Fills it with zeros. `Alone`: no block of the station runs meanwhile.
    pub(super) fn clear(&self, _: &Alone<'_>) {
        for chunk in &self.chunks {
            // SAFETY: the pointer of an UnsafeCell in a living box, and no block of the station is running: `Alone`.
            unsafe { chunk.get().write_bytes(0, 1) };
        }
    }
}

/// A plugin's memory for each module of a station, and the module's settings.
pub(super) struct StationMemory {
    /// By logical base address, ascending.
    modules: Vec<(PluginModule, State)>,
    /// The thread that runs blocks of the station now, by its [`mark`]; 0: none.
    inside: AtomicUsize,
}

// SAFETY: the memory is reached by blocks of one station alone, while their thread is the one `inside`.
unsafe impl Send for StationMemory {}
// SAFETY: as for Send.
unsafe impl Sync for StationMemory {}

/// This thread runs blocks of the station until this is dropped; blocks that are called from there run too.
pub(super) struct Inside<'a> {
    /// `None`: this call came from a block that is running already.
    of: Option<&'a AtomicUsize>,
}

impl Drop for Inside<'_> {
    fn drop(&mut self) {
        if let Some(inside) = self.of {
            inside.store(0, Ordering::Release);
        }
    }
}

/// This thread is inside, and no block is running.
pub(super) struct Alone<'a> {
    _inside: Inside<'a>,
}

/// What tells the running thread from every other that lives: an address of its own, never 0.
fn mark() -> usize {
    thread_local! {
        static MARK: u8 = const { 0 };
    }
    MARK.with(|mark| std::ptr::from_ref(mark) as usize)
}

impl StationMemory {
    pub(super) fn new(bytes: usize, modules: &[PluginModule]) -> Self {
        let mut modules = modules.to_vec();
        modules.sort_by_key(|module| module.address);
        modules.dedup_by_key(|module| module.address);
        let modules = modules.into_iter().map(|module| (module, State::new(bytes))).collect();
        Self { modules, inside: AtomicUsize::new(0) }
    }

    /// Before a block of the station runs; `None`: one runs on another thread.
    pub(super) fn enter(&self) -> Option<Inside<'_>> {
        let me = mark();
        match self.inside.compare_exchange(0, me, Ordering::Acquire, Ordering::Relaxed) {
            Ok(_) => Some(Inside { of: Some(&self.inside) }),
            Err(thread) => (thread == me).then_some(Inside { of: None }),
        }
    }

    /// Before the memory is cleared; `None`: a block of the station is running.
    pub(super) fn alone(&self) -> Option<Alone<'_>> {
        self.enter().filter(|inside| inside.of.is_some()).map(|_inside| Alone { _inside })
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

    pub(super) fn clear(&self, alone: &Alone<'_>) {
        for (_, state) in &self.modules {
            state.clear(alone);
        }
    }
}
