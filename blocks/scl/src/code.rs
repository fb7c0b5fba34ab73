//! The operations of a block under way: labels, temporaries, the OK flag.

use std::collections::BTreeSet;

use ob1_ir::{Jump, Op, Operand, Place, Stmt, Width};
use ob1_model::{Area, BitAddr, BlockId};

use crate::options::Options;

/// A place in the code that is jumped to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Label(u32);

/// How much of the temporaries is in use.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mark {
    next: u32,
    bits: u32,
}

pub(crate) struct Code {
    pub(crate) ops: Vec<Stmt>,
    pub(crate) line: u32,
    labels: Vec<Option<u32>>,
    /// Jumps, by their index in the code.
    jumps: Vec<(usize, Label)>,
    /// The next byte of local data behind the declared ones, and the most that was used.
    next: u32,
    most: u32,
    /// The next bit of the byte that single bits are taken from; none left at a multiple of 8.
    bits: u32,
    /// The bit of the OK flag, where the block has one.
    pub(crate) ok: Option<Place>,
    pub(crate) options: Options,
    /// BLKMOV and CONCAT, where they are there.
    pub(crate) concat: Option<BlockId>,
    pub(crate) move_block: Option<BlockId>,
    /// Parameters of the function that are elementary, by their index among the formals.
    pub(crate) elementary: BTreeSet<u16>,
    /// Temporaries that are texts, by their index in the interface.
    pub(crate) texts: BTreeSet<usize>,
    /// A function block.
    pub(crate) has_instance: bool,
    /// Something was not made: a value that has no operations here. The statement then needs an error.
    pub(crate) lost: bool,
    /// A text is to be copied, and no block is there that does it.
    pub(crate) lacks_texts: bool,
}

impl Code {
    pub(crate) fn new(declared: u32, options: Options) -> Self {
        let next = declared.next_multiple_of(2);
        Self {
            ops: Vec::new(),
            line: 1,
            labels: Vec::new(),
            jumps: Vec::new(),
            next,
            most: next,
            bits: 0,
            ok: None,
            options,
            concat: None,
            move_block: None,
            elementary: BTreeSet::new(),
            texts: BTreeSet::new(),
            has_instance: false,
            lost: false,
            lacks_texts: false,
        }
    }

    pub(crate) fn op(&mut self, op: Op) {
        self.ops.push(Stmt { op, network: 1, line: self.line });
    }

    /// Nothing is made of this.
    pub(crate) const fn lose(&mut self) {
        self.lost = true;
    }

    pub(crate) fn label(&mut self) -> Label {
        self.labels.push(None);
        Label(self.labels.len() as u32 - 1)
    }

    /// The label stands here.
    pub(crate) fn set(&mut self, label: Label) {
        let here = self.ops.len() as u32;
        if let Some(slot) = self.labels.get_mut(label.0 as usize) {
            *slot = Some(here);
        }
    }

    pub(crate) fn jump(&mut self, jump: Jump, to: Label) {
        self.jumps.push((self.ops.len(), to));
        self.op(Op::Jump(jump, 0));
    }

    /// All operations, jumps with their targets, and the bytes of local data.
    pub(crate) fn finish(mut self) -> (Vec<Stmt>, u32) {
        let end = self.ops.len() as u32;
        for (at, label) in self.jumps {
            let target = self.labels.get(label.0 as usize).copied().flatten().unwrap_or(end);
            if let Some(Stmt { op: Op::Jump(_, to), .. }) = self.ops.get_mut(at) {
                *to = target;
            }
        }
        (self.ops, self.most.next_multiple_of(2))
    }

    pub(crate) const fn mark(&self) -> Mark {
        Mark { next: self.next, bits: self.bits }
    }

    /// Gives back the temporaries taken since.
    pub(crate) const fn release(&mut self, mark: Mark) {
        self.next = mark.next;
        self.bits = mark.bits;
    }

    /// So many bytes of local data from an even address.
    pub(crate) fn take(&mut self, bytes: u32) -> BitAddr {
        let at = self.next;
        self.next += bytes.next_multiple_of(2);
        self.most = self.most.max(self.next);
        BitAddr::byte_addr(at)
    }

    /// A single bit.
    pub(crate) fn take_bit(&mut self) -> Place {
        if self.bits.is_multiple_of(8) {
            self.bits = self.take(2).0;
        }
        let at = BitAddr(self.bits);
        self.bits += 1;
        Place::Fixed(Area::Local, at)
    }

    /// An operand in the local data.
    pub(crate) fn temp(&mut self, width: Width) -> Operand {
        let at = self.take(width.bytes());
        Operand { width, place: Place::Fixed(Area::Local, at) }
    }
}

/// An operand in the local data at an address.
pub(crate) const fn local(width: Width, at: BitAddr) -> Operand {
    Operand { width, place: Place::Fixed(Area::Local, at) }
}
