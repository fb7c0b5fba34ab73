//! The table of a plugin and the entries of its blocks: what [`crate::export_plugin!`] is made of. Not for direct use.

use core::ffi::c_void;
use std::mem::ManuallyDrop;
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::abi::{self as abi, CallContext, HostTable, ParamDesc, Status};
pub use crate::abi::{BlockDesc, PluginTable};

pub use crate::layout::bit_address;
use crate::param::{self, Param};
use crate::state::Zeroable;
use crate::text::text;
use crate::{Block, Cx, Kind};

/// Constant data that contains pointers, all of them to constant data.
#[repr(transparent)]
#[derive(Debug)]
pub struct Constant<T>(T);

// SAFETY: made of tables only (`blocks`, `table`), whose pointers lead to constants of the plugin that nobody writes.
unsafe impl<const N: usize> Sync for Constant<[BlockDesc; N]> {}
// SAFETY: as above.
unsafe impl Sync for Constant<PluginTable> {}

impl<T> Constant<T> {
    /// The address of the constant, for a table in C.
    pub const fn get(&'static self) -> *const T {
        &raw const self.0
    }
}

/// The blocks of a plugin.
#[must_use]
pub const fn blocks<const N: usize>(blocks: [BlockDesc; N]) -> Constant<[BlockDesc; N]> {
    Constant(blocks)
}

/// The table of a plugin.
#[must_use]
pub const fn table<M: Zeroable, const N: usize>(
    name: &'static str,
    version: &'static str,
    blocks: &'static Constant<[BlockDesc; N]>,
) -> Constant<PluginTable> {
    Constant(PluginTable {
        size: size_of::<PluginTable>() as u32,
        abi_major: abi::ABI_MAJOR,
        abi_minor: abi::ABI_MINOR,
        name: text(name),
        version: text(version),
        blocks: blocks.0.as_ptr(),
        block_count: N as u32,
        module_state_size: size_of::<M>() as u32,
        init: Some(crate::panic::init),
        panic_message: Some(crate::panic::message),
    })
}

/// A block's description. The bound on `B` makes its memory per module that of the plugin.
#[must_use]
pub const fn block<M: Zeroable, B: Block<Module = M>>() -> BlockDesc {
    const {
        param::check(B::PARAMS, B::KIND.has_instance());
        assert!(!matches!(B::KIND, Kind::Ob) || B::PARAMS.is_empty(), "an OB has no parameters");
        assert!(align_of::<B::State>() <= 16, "the host aligns state to 16 bytes");
        assert!(!B::NAME.is_empty(), "a block has a name");
    }
    BlockDesc {
        size: size_of::<BlockDesc>() as u32,
        kind: B::KIND as u8,
        reserved: 0,
        number: B::NUMBER,
        name: text(B::NAME),
        params: params(B::PARAMS),
        param_count: B::PARAMS.len() as u32,
        state_size: size_of::<B::State>() as u32,
        entry: Some(entry::<B>),
    }
}

/// `Param` is a transparent `ParamDesc`.
const fn params(params: &'static [Param]) -> *const ParamDesc {
    params.as_ptr().cast()
}

/// A block's entry: raw pointers become a [`Cx`], a panic becomes a status.
///
/// # Safety
/// As `crate::abi::BlockEntry` says: the pointers are the host's, for this call; `state` leads to `state_size` bytes.
unsafe extern "C" fn entry<B: Block>(host: *const HostTable, call: *mut CallContext, state: *mut c_void) -> Status {
    // SAFETY: null, or the host's table, which begins with its size.
    let Some(size) = (unsafe { host.cast::<u32>().as_ref() }) else { return abi::BAD_ARGUMENT };
    if (*size as usize) < size_of::<HostTable>() || call.is_null() {
        return abi::BAD_ARGUMENT;
    }
    // SAFETY: it is as large as our HostTable, and constant.
    let host = unsafe { &*host };
    let state: *const B::State =
        if size_of::<B::State>() == 0 { core::ptr::NonNull::dangling().as_ptr() } else { state.cast() };
    // SAFETY: memory of `state_size` = `size_of::<B::State>()` bytes, aligned to 16, zeroed at start-up and then
    // written by this block alone through shared references; or, for a state without bytes, any aligned pointer.
    let Some(state) = (unsafe { state.as_ref() }) else { return abi::BAD_ARGUMENT };
    let ran = catch_unwind(AssertUnwindSafe(|| {
        // SAFETY: `host` and `call` are those of this entry; the context ends with the closure.
        B::call(&mut unsafe { Cx::new(host, call) }, state)
    }));
    match ran {
        Ok(Ok(())) => abi::OK,
        Ok(Err(_abort)) => abi::ABORT,
        Err(payload) => {
            // The destructor of a payload can panic too; the CPU is going to STOP, a few bytes do not matter.
            let _kept = ManuallyDrop::new(payload);
            abi::PANICKED
        }
    }
}

/// Exports the plugin: its name and version, the type of its memory per module (`()` for none), and its blocks. Once
/// per crate, and only in a crate of type `cdylib`.
///
/// ```text
/// ob1_sdk::export_plugin! {
///     name: "limits",
///     version: env!("CARGO_PKG_VERSION"),
///     module_state: (),
///     blocks: [Limit],
/// }
/// ```
#[macro_export]
macro_rules! export_plugin {
    (name: $name:expr, version: $version:expr, module_state: $module:ty, blocks: [$($block:ty),+ $(,)?] $(,)?) => {
        const _: () = {
            const COUNT: usize = [$(stringify!($block)),+].len();
            static BLOCKS: $crate::export::Constant<[$crate::export::BlockDesc; COUNT]> =
                $crate::export::blocks([$($crate::export::block::<$module, $block>()),+]);
            static TABLE: $crate::export::Constant<$crate::export::PluginTable> =
                $crate::export::table::<$module, COUNT>($name, $version, &BLOCKS);

            /// The one symbol a host looks for.
            // SAFETY: no other function of a plugin has this name; see "a crate of type cdylib and nothing else".
            #[unsafe(no_mangle)]
            pub extern "C" fn ob1_plugin() -> *const $crate::export::PluginTable {
                TABLE.get()
            }
        };
    };
}
