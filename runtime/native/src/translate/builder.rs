//! The front end's builder, with the constants of the block being filled: each is made once per block. Every
//! instruction costs the compiler time, even one that turns out to be a duplicate.

use std::ops::{Deref, DerefMut};

use cranelift_codegen::ir::{self, InstBuilder, Type, Value};
use cranelift_frontend::FunctionBuilder;

/// How many constants of a block are searched, at most: the newest ones.
const LOOK: usize = 24;

pub(crate) struct Builder<'f> {
    inner: FunctionBuilder<'f>,
    constants: Vec<(Type, i64, Value)>,
    /// The block they lie in.
    block: Option<ir::Block>,
}

impl<'f> Builder<'f> {
    pub(crate) fn new(inner: FunctionBuilder<'f>) -> Self {
        Self { inner, constants: Vec::with_capacity(64), block: None }
    }

    /// A constant; the same value is made once in a block of code.
    pub(crate) fn iconst(&mut self, ty: Type, value: i64) -> Value {
        let block = self.inner.current_block();
        if self.block != block {
            self.constants.clear();
            self.block = block;
        }
        let found = self.constants.iter().rev().take(LOOK).find(|known| (known.0, known.1) == (ty, value));
        if let Some((_, _, known)) = found {
            return *known;
        }
        let made = self.inner.ins().iconst(ty, value);
        self.constants.push((ty, value, made));
        made
    }

    pub(crate) fn finish(self) -> FunctionBuilder<'f> {
        self.inner
    }
}

impl<'f> Deref for Builder<'f> {
    type Target = FunctionBuilder<'f>;

    fn deref(&self) -> &Self::Target {
        &self.inner
    }
}

impl DerefMut for Builder<'_> {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.inner
    }
}
