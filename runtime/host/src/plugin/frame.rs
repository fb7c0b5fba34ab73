//! What a call carries through the plugin and back.

use std::any::Any;

use ob1_cpu::NativeContext;

use super::memory::StationMemory;

/// What the call context of the interface points to.
pub(super) struct Frame<'a> {
    pub(super) cx: &'a mut dyn NativeContext,
    pub(super) memory: &'a StationMemory,
    /// The plugin has been told to return.
    pub(super) abort: bool,
    /// A panic of the CPU itself, kept until the plugin has returned.
    pub(super) panic: Option<Box<dyn Any + Send>>,
}
