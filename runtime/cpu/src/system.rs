//! The standard blocks of `ob1-std` as native blocks.

use ob1_model::{BlockId, Interface};
use ob1_std::{Abort, StandardBlock};

use crate::{NativeBlock, NativeContext};

/// The system functions (SFC, SFB), ready for [`crate::Cpu::new`]. The compiler gets the same by
/// [`ob1_std::system_functions`].
#[must_use]
pub fn system_blocks() -> Vec<Box<dyn NativeBlock>> {
    ob1_std::system_functions().into_iter().map(|block| standard_block(block.id, block)).collect()
}

/// A standard block under the number the user gives it.
#[must_use]
pub fn standard_block(id: BlockId, block: StandardBlock) -> Box<dyn NativeBlock> {
    Box::new(Standard { id, block })
}

struct Standard {
    id: BlockId,
    block: StandardBlock,
}

impl NativeBlock for Standard {
    fn id(&self) -> BlockId {
        self.id
    }

    fn name(&self) -> &str {
        self.block.name
    }

    fn interface(&self) -> &Interface {
        &self.block.interface
    }

    fn reset(&self) {}

    fn call(&self, cx: &mut dyn NativeContext) -> Result<(), Abort> {
        self.block.run(cx)
    }
}
