//! Plugins: blocks that come as shared libraries behind the interface of `ob1_sdk::abi`.
//!
//! [`Plugin::load`] opens a library, checks its table before believing a byte of it, and never closes it again. One
//! loaded library serves many stations: [`Plugin::station`] makes the native blocks of one station, with memory of
//! their own.

mod block;
mod error;
mod frame;
mod host_table;
mod interface;
mod memory;
mod settings;
mod table;
mod text;

use std::collections::{BTreeMap, BTreeSet};
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use libloading::Library;
use ob1_cpu::{NativeBlock, Natives};
use ob1_model::{BlockId, Interface};
use ob1_sdk::abi::PluginTable;

use block::PluginBlock;
pub use error::{PluginError, Refusal};
use memory::StationMemory;
pub use settings::{PluginModule, STATION, Setting};
use table::{Code, PanicMessage};

/// A block a plugin brings.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockInfo {
    /// Kind and number it wants.
    pub id: BlockId,
    /// Name of the block, `SEND`.
    pub name: String,
    /// Its parameters; for an FB with the layout of the instance.
    pub interface: Interface,
}

/// What a plugin says about itself: for the compiler, and for lists.
#[derive(Clone, Debug, PartialEq)]
pub struct PluginInfo {
    /// Name of the plugin, `cp240`.
    pub name: String,
    /// Version of the plugin, `0.1.0`.
    pub version: String,
    /// Major and minor version of the interface it was built with.
    pub abi: (u16, u16),
    /// The blocks that it brings, in the order of its table.
    pub blocks: Vec<BlockInfo>,
}

/// A plugin whose library is loaded and whose table was checked.
#[derive(Debug)]
pub struct Plugin {
    path: PathBuf,
    info: PluginInfo,
    /// One for each block of `info`.
    code: Vec<Code>,
    module_state_size: usize,
    panic_message: Option<PanicMessage>,
    table_address: usize,
}

/// Everything loaded so far: a library is opened and initialised once in a process.
static LOADED: Mutex<Vec<Arc<Plugin>>> = Mutex::new(Vec::new());

impl Plugin {
    /// Loads the shared library at `path`, or gives the plugin that was loaded from there before. Not for the scan
    /// thread.
    ///
    /// # Errors
    /// A [`PluginError`] with a number and a remedy.
    pub fn load(path: &Path) -> Result<Arc<Self>, PluginError> {
        let refuse = |refusal| PluginError { path: path.to_owned(), refusal };
        let file = path.canonicalize().map_err(|e| refuse(Refusal::Missing(e.to_string())))?;
        let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = loaded.iter().find(|plugin| plugin.path == file) {
            return Ok(Arc::clone(known));
        }
        // SAFETY: loading runs the library's constructors. That is what the station file asks for by naming it; a
        // plugin is trusted with that (docs/plugins.md, "What is checked").
        let library = unsafe { Library::new(&file) }.map_err(|e| refuse(Refusal::NotALibrary(reason(&e))))?;
        // Never unloaded: blocks, texts and the panic hook of the plugin stay valid until the process ends.
        let library = ManuallyDrop::new(library);
        let table = table::open(&library).map_err(refuse)?;
        if let Some(known) = loaded.iter().find(|plugin| plugin.table_address == address(table)) {
            return Ok(Arc::clone(known));
        }
        let plugin = Arc::new(Self::read(table, file).map_err(refuse)?);
        table::init(table).map_err(refuse)?;
        loaded.push(Arc::clone(&plugin));
        Ok(plugin)
    }

    fn read(table: &PluginTable, path: PathBuf) -> Result<Self, Refusal> {
        let (info, code) = table::read(table)?;
        let module_state_size = table::state_size(table.module_state_size, "module state")?;
        let (panic_message, table_address) = (table.panic_message, address(table));
        Ok(Self { path, info, code, module_state_size, panic_message, table_address })
    }

    /// What the plugin says about itself.
    pub fn info(&self) -> &PluginInfo {
        &self.info
    }

    /// The file it was loaded from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The blocks for one station, under the numbers `renumber` gives them (their own where it says nothing), with
    /// memory for each block and for each of the `modules`.
    ///
    /// The blocks share the memory of the modules. They stay together and belong to one CPU, which runs them on one
    /// thread at a time.
    ///
    /// # Errors
    /// [`Refusal::NoSuchBlock`] and [`Refusal::SameNumber`] for an impossible `renumber`.
    pub fn station(
        &self,
        renumber: &BTreeMap<BlockId, BlockId>,
        modules: &[PluginModule],
    ) -> Result<Natives, PluginError> {
        let refuse = |refusal| PluginError { path: self.path.clone(), refusal };
        if let Some((from, _)) = renumber.iter().find(|(from, _)| !self.info.blocks.iter().any(|b| b.id == **from)) {
            return Err(refuse(Refusal::NoSuchBlock(*from)));
        }
        let memory = Arc::new(StationMemory::new(self.module_state_size, modules));
        let mut taken = BTreeSet::new();
        let mut blocks: Vec<Box<dyn NativeBlock>> = Vec::new();
        for (info, code) in self.info.blocks.iter().zip(&self.code) {
            let id = renumber.get(&info.id).copied().unwrap_or(info.id);
            if id.kind != info.id.kind || !taken.insert(id) {
                return Err(refuse(Refusal::SameNumber(info.id, id)));
            }
            blocks.push(Box::new(PluginBlock::new(id, info, *code, self.panic_message, Arc::clone(&memory))));
        }
        Ok(blocks.into())
    }
}

/// What the loader says: the library's error puts it after its own text.
fn address(table: &PluginTable) -> usize {
    std::ptr::from_ref(table).addr()
}

fn reason(error: &libloading::Error) -> String {
    std::error::Error::source(error).map_or_else(|| error.to_string(), ToString::to_string)
}

/// What the plugin at `path` brings, for `ob1 check --plugin`.
///
/// # Errors
/// The refusals of [`Plugin::load`]: the file, its interface or its table.
pub fn describe(path: &Path) -> Result<PluginInfo, PluginError> {
    Plugin::load(path).map(|plugin| plugin.info.clone())
}
