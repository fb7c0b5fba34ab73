//! Reads a plugin's table: sizes, counts, pointers, kinds and texts are checked before anything is built on them.

use std::collections::BTreeSet;

use libloading::Library;
use ob1_model::{BlockId, BlockKind};
use ob1_sdk::abi::{self as abi, BlockDesc, ParamDesc, PluginEntry, PluginTable};

use super::error::Refusal;
use super::text::{malformed, text, word};
use super::{BlockInfo, PluginInfo, interface};

/// A block's entry and the bytes it keeps per station.
#[derive(Clone, Copy, Debug)]
pub(super) struct Code {
    pub(super) entry: Entry,
    pub(super) state_size: usize,
}

/// A block's entry, known to be there.
pub(super) type Entry = unsafe extern "C" fn(
    host: *const abi::HostTable,
    call: *mut abi::CallContext,
    state: *mut std::ffi::c_void,
) -> abi::Status;

/// Copies the message of the last panic.
pub(super) type PanicMessage = unsafe extern "C" fn(into: *mut u8, len: u32) -> u32;

/// More blocks or parameters than this are a mistake, not a plugin.
const BLOCKS_MAX: u32 = 4096;
const PARAMS_MAX: u32 = 1024;
const STATE_MAX: u32 = 16 << 20;

/// Asks a library for its table, that of a plugin of our major version.
pub(super) fn open(library: &Library) -> Result<&'static PluginTable, Refusal> {
    // SAFETY: the symbol's name is the interface's; a library that gives it another meaning is beyond any check.
    let entry = unsafe { library.get::<PluginEntry>(abi::ENTRY_SYMBOL.as_bytes()) }.map_err(|_| Refusal::NoSymbol)?;
    // SAFETY: a function of the type the interface names.
    let table = unsafe { entry() };
    if table.is_null() || !table.is_aligned() {
        return Err(malformed("ob1_plugin returned no table"));
    }
    // Size and versions are the frozen part: they are there in every major version, and nothing else is read before
    // they are known. SAFETY: not null, aligned, and at least these three fields long in every version of the
    // interface.
    let (size, major, minor) = unsafe { ((*table).size, (*table).abi_major, (*table).abi_minor) };
    if major != abi::ABI_MAJOR {
        return Err(Refusal::OtherMajor { major, minor });
    }
    if (size as usize) < size_of::<PluginTable>() {
        return Err(malformed(format!("its size is {size}, it has at least {}", size_of::<PluginTable>())));
    }
    // SAFETY: static data of a library that is never unloaded, as large as our PluginTable.
    Ok(unsafe { &*table })
}

/// What the table says of the plugin, and the code of its blocks; no two have the same kind and number.
pub(super) fn read(table: &PluginTable) -> Result<(PluginInfo, Vec<Code>), Refusal> {
    if table.block_count == 0 || table.block_count > BLOCKS_MAX {
        return Err(malformed(format!("it lists {} blocks", table.block_count)));
    }
    let mut seen = BTreeSet::new();
    let (mut blocks, mut codes) = (Vec::new(), Vec::new());
    for desc in entries(table.blocks, table.block_count, |desc| desc.size, "the list of blocks")? {
        let (info, code) = block(desc)?;
        if !seen.insert(info.id) {
            return Err(malformed(format!("it brings {} twice", info.id)));
        }
        blocks.push(info);
        codes.push(code);
    }
    let (name, version) = (word(table.name, "the plugin's name")?, text(table.version, "the plugin's version")?);
    Ok((PluginInfo { name, version, abi: (table.abi_major, table.abi_minor), blocks }, codes))
}

/// Runs the plugin's `init`, if it has one.
pub(super) fn init(table: &PluginTable) -> Result<(), Refusal> {
    let Some(init) = table.init else { return Ok(()) };
    // SAFETY: a function of the type the interface names; called once, on the loading thread (Plugin::load holds the
    // lock).
    match unsafe { init() } {
        abi::OK => Ok(()),
        status => Err(Refusal::InitFailed(status)),
    }
}

fn block(desc: &BlockDesc) -> Result<(BlockInfo, Code), Refusal> {
    let kind = match desc.kind {
        abi::KIND_OB => BlockKind::Ob,
        abi::KIND_FB => BlockKind::Fb,
        abi::KIND_FC => BlockKind::Fc,
        abi::KIND_SFB => BlockKind::Sfb,
        abi::KIND_SFC => BlockKind::Sfc,
        other => return Err(malformed(format!("a block of kind {other}"))),
    };
    let id = BlockId::new(kind, desc.number);
    let name = word(desc.name, &format!("the name of {id}"))?;
    let Some(entry) = desc.entry else { return Err(malformed(format!("{id} {name} has no entry"))) };
    if desc.param_count > PARAMS_MAX {
        return Err(malformed(format!("{id} {name} has {} parameters", desc.param_count)));
    }
    let list = format!("the parameters of {id} {name}");
    let params = entries(desc.params, desc.param_count, |param: &ParamDesc| param.size, &list)?;
    let interface = interface::of(kind, params).map_err(|what| malformed(format!("{id} {name}: {what}")))?;
    let state_size = state_size(desc.state_size, &name)?;
    Ok((BlockInfo { id, name, interface }, Code { entry, state_size }))
}

/// The entries of a list whose elements say their own size: they may be larger than ours, when a later minor version
/// built them.
fn entries<T>(first: *const T, count: u32, size: fn(&T) -> u32, list: &str) -> Result<Vec<&'static T>, Refusal> {
    let mut entries = Vec::new();
    let mut next = first;
    for _ in 0..count {
        if next.is_null() || !next.is_aligned() {
            return Err(malformed(format!("{list}: no pointer to them")));
        }
        // SAFETY: not null, aligned; static data of the plugin, by its word an array of `count` elements that begin
        // with their size.
        let bytes = unsafe { next.cast::<u32>().read() } as usize;
        if bytes < size_of::<T>() || bytes > 64 * size_of::<T>() || !bytes.is_multiple_of(align_of::<T>()) {
            return Err(malformed(format!("{list}: an entry of {bytes} bytes, it has at least {}", size_of::<T>())));
        }
        // SAFETY: as above, and the element is as large as our T.
        let entry: &'static T = unsafe { &*next };
        debug_assert_eq!(size(entry) as usize, bytes);
        entries.push(entry);
        next = next.wrapping_byte_add(bytes);
    }
    Ok(entries)
}

pub(super) fn state_size(bytes: u32, what: &str) -> Result<usize, Refusal> {
    if bytes > STATE_MAX {
        return Err(malformed(format!("{what} takes {bytes} bytes, {STATE_MAX} is the limit")));
    }
    Ok(bytes as usize)
}
