//! The code of a program's blocks: bytes that run wherever they lie.

use ob1_cpu::engine::Plan;

use crate::tier::Tier;

/// Functions begin at multiples of it, on every processor there is code for.
const ALIGNMENT: usize = 16;

/// A place where compiled code can be entered from the reference: the statement, and its number among these places.
pub(crate) type Resume = (u32, u32);

/// What a function is made of besides its code.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Made {
    /// Entries from the reference, by ascending statement.
    pub(crate) resume: Vec<Resume>,
}

/// The code of a block.
#[derive(Clone, Debug, Default)]
pub(crate) struct BlockCode {
    pub(crate) code: Box<[u8]>,
    pub(crate) made: Made,
    /// Bytes of stack it takes.
    pub(crate) stack: u32,
}

/// A block: its code, and the tier of the compiler that has tried it last.
#[derive(Clone, Debug, Default)]
struct Slot {
    /// None: the reference runs it.
    function: Option<BlockCode>,
    optimised: bool,
}

/// The code of all blocks.
#[derive(Clone, Debug, Default)]
pub struct Image {
    slots: Vec<Slot>,
}

/// A compiled block in its place.
#[derive(Clone, Debug, Default)]
pub(crate) struct Compiled {
    /// Where its code begins; `None`: the reference runs the block.
    pub(crate) at: Option<u32>,
    pub(crate) made: Made,
}

impl Image {
    /// An image of a plan, without any code.
    #[must_use]
    pub fn empty(plan: &Plan) -> Self {
        Self::of_blocks(plan.blocks.len())
    }

    /// An image of so many blocks, without any code.
    pub(crate) fn of_blocks(blocks: usize) -> Self {
        Self { slots: vec![Slot::default(); blocks] }
    }

    /// What a compiler has made of a block, or nothing.
    pub(crate) fn put(&mut self, block: u32, tier: Tier, function: Option<BlockCode>) {
        let Some(slot) = self.slots.get_mut(block as usize) else { return };
        slot.optimised = tier == Tier::Optimised;
        if function.is_some() {
            slot.function = function;
        }
    }

    /// Takes the blocks that another compiler of the same plan has made.
    pub fn absorb(&mut self, other: Self) {
        for (slot, theirs) in self.slots.iter_mut().zip(other.slots) {
            slot.optimised |= theirs.optimised;
            if theirs.function.is_some() {
                slot.function = theirs.function;
            }
        }
    }

    /// Machine code of a block; none: the reference runs it.
    #[must_use]
    pub fn code(&self, block: u32) -> Option<&[u8]> {
        Some(&self.slots.get(block as usize)?.function.as_ref()?.code)
    }

    /// Blocks that the optimising tier has not seen.
    #[must_use]
    pub fn unoptimised(&self) -> Vec<u32> {
        (0..).zip(&self.slots).filter(|(_, slot)| !slot.optimised).map(|(block, _)| block).collect()
    }

    /// Bytes of machine code.
    #[must_use]
    pub fn len(&self) -> usize {
        self.functions().fold(0, |len, function| place(len) + function.code.len())
    }

    /// Blocks that have code, and all blocks.
    #[must_use]
    pub fn blocks(&self) -> (usize, usize) {
        (self.functions().count(), self.slots.len())
    }

    /// Bytes of stack that a block's code takes at most, without the helpers it calls.
    #[must_use]
    pub fn stack_bytes(&self) -> usize {
        self.functions().map(|function| function.stack).max().unwrap_or(0) as usize
    }

    /// There is no code.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn functions(&self) -> impl Iterator<Item = &BlockCode> {
        self.slots.iter().filter_map(|slot| slot.function.as_ref())
    }

    /// All code, one function after the other, and where that of each block begins.
    pub(crate) fn placed(&self) -> (Vec<u8>, Vec<Compiled>) {
        let mut bytes = Vec::with_capacity(self.len());
        let compiled = self.slots.iter().map(|slot| {
            let Some(function) = &slot.function else { return Compiled::default() };
            bytes.resize(place(bytes.len()), 0);
            let at = bytes.len() as u32;
            bytes.extend_from_slice(&function.code);
            Compiled { at: Some(at), made: function.made.clone() }
        });
        let compiled = compiled.collect();
        (bytes, compiled)
    }
}

/// Where a function after `len` bytes begins.
const fn place(len: usize) -> usize {
    len.next_multiple_of(ALIGNMENT)
}
