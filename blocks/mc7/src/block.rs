//! A block of machine code, its statements, and the blocks it calls: what decoding, folding and encoding ask of them.

use ob1_model::{BlockId, Interface};

use crate::segments::Segments;
use crate::statement::Mc7Op;

/// A block of machine code with what is known of it.
#[derive(Clone, Debug)]
pub struct MachineBlock<'b> {
    /// Kind and number of the block.
    pub id: BlockId,
    /// The name of its head.
    pub name: Option<String>,
    /// Its declarations, laid out.
    pub interface: &'b Interface,
    /// The code, its final `BE` included.
    pub code: &'b [u8],
    /// The segment table; an empty one puts everything into network 1.
    pub segments: &'b Segments,
    /// A function block of code version 2: its instance is addressed through AR2, so that it can be a multi-instance.
    pub multi_instance: bool,
    /// Bytes of local data that its head says; what the code itself shows counts if it is more.
    pub local_bytes: u32,
}

/// A statement at its place.
#[derive(Clone, Debug)]
pub(crate) struct Item {
    pub(crate) offset: usize,
    pub(crate) op: Mc7Op,
    /// Some jump leads here.
    pub(crate) target: bool,
    pub(crate) network: u16,
}

/// Interfaces of the blocks that are called.
pub(crate) type Callees<'c> = dyn Fn(BlockId) -> Option<&'c Interface> + 'c;

/// The formals' indices in the order of the list of pointers after a call in machine code.
pub fn list_order(interface: &Interface) -> Vec<u16> {
    let mut order: Vec<(u16, u16)> = interface.list_places().into_iter().zip(0u16..).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, formal)| formal).collect()
}
