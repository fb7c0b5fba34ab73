//! What a block is.

use crate::Cx;
use crate::param::Param;
use crate::reply::Abort;
use crate::state::Zeroable;

/// The kind of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// Organization block: called by the CPU, has no parameters.
    Ob = crate::abi::KIND_OB,
    /// Function block: has an instance data block.
    Fb = crate::abi::KIND_FB,
    /// Function: a block without an instance.
    Fc = crate::abi::KIND_FC,
    /// System function block: an FB built into the CPU.
    Sfb = crate::abi::KIND_SFB,
    /// System function: an FC built into the CPU.
    Sfc = crate::abi::KIND_SFC,
}

impl Kind {
    /// True for blocks with an instance data block.
    #[must_use]
    pub const fn has_instance(self) -> bool {
        matches!(self, Self::Fb | Self::Sfb)
    }
}

/// A block in Rust. Implemented for a unit type; listed in [`crate::export_plugin!`].
pub trait Block {
    /// Kind of the block: what the program calls it by, with `NUMBER`.
    const KIND: Kind;
    /// The number it wants; the station file may give it another.
    const NUMBER: u16;
    /// The name, as a manual would print it.
    const NAME: &'static str;
    /// Its parameters, from [`crate::interface!`].
    const PARAMS: &'static [Param];
    /// Memory of this block per station, zeroed at every start-up; `()` for none. Data that must survive belongs in the
    /// instance data block.
    type State: Zeroable;
    /// The plugin's memory per module, the same type for all its blocks; `()` for none. See [`Cx::module_state`].
    type Module: Zeroable;

    /// Runs the block once, on the scan thread: it must not wait.
    ///
    /// # Errors
    /// [`Abort`], as the host gave it.
    fn call(cx: &mut Cx<'_, Self::Module>, state: &Self::State) -> Result<(), Abort>;
}
