//! Typed names of parameters and instance variables.

use core::marker::PhantomData;

/// Section `VAR_INPUT`: the block reads it.
#[derive(Clone, Copy, Debug)]
pub struct In;
/// Section `VAR_OUTPUT`: the block writes it.
#[derive(Clone, Copy, Debug)]
pub struct Out;
/// Section `VAR_IN_OUT`: the block reads and writes it.
#[derive(Clone, Copy, Debug)]
pub struct InOut;
/// `RET_VAL`, the function value: the block writes it.
#[derive(Clone, Copy, Debug)]
pub struct Return;

/// A section a block may read: all of them. An output of an FC is the caller's operand and still holds its old value.
pub trait Readable {}
/// A section a block writes.
pub trait Writable {}

impl Readable for In {}
impl Readable for Out {}
impl Readable for InOut {}
impl Readable for Return {}
impl Writable for Out {}
impl Writable for InOut {}
impl Writable for Return {}

/// A formal parameter of type `T` in section `S`.
#[derive(Debug)]
pub struct Formal<T, S> {
    index: u32,
    _type: PhantomData<fn() -> (T, S)>,
}

impl<T, S> Clone for Formal<T, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T, S> Copy for Formal<T, S> {}

impl<T, S> Formal<T, S> {
    /// The formal of this index; [`crate::interface!`] counts them.
    #[must_use]
    pub const fn new(index: u32) -> Self {
        Self { index, _type: PhantomData }
    }

    /// Its place among the block's parameters.
    #[must_use]
    pub const fn index(self) -> u32 {
        self.index
    }
}

/// An instance variable of type `T` that is not a parameter.
#[derive(Debug)]
pub struct Static<T> {
    bit: u32,
    _type: PhantomData<fn() -> T>,
}

impl<T> Clone for Static<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Static<T> {}

impl<T> Static<T> {
    /// The variable at this bit address of the instance; [`crate::interface!`] lays them out.
    #[must_use]
    pub const fn new(bit: u32) -> Self {
        Self { bit, _type: PhantomData }
    }

    /// Its bit address (byte * 8 + bit) from the instance's first byte.
    #[must_use]
    pub const fn bit_address(self) -> u32 {
        self.bit
    }
}
