//! A plugin's block as the CPU sees it, and what a call carries through the plugin and back.

use std::panic::resume_unwind;
use std::sync::Arc;

use ob1_cpu::{Abort, NativeBlock, NativeContext};
use ob1_model::{BlockId, Event, Interface};
use ob1_sdk::abi;

use super::BlockInfo;
use super::frame::Frame;
use super::host_table::HOST;
use super::memory::{State, StationMemory};
use super::table::{Code, PanicMessage};
use crate::fixed_text::FixedText;

/// A text for the diagnostic buffer.
type Text = FixedText<{ abi::TEXT_MAX as usize }>;

/// A block of a plugin in one station.
pub(super) struct PluginBlock {
    id: BlockId,
    name: String,
    interface: Interface,
    code: Code,
    panic_message: Option<PanicMessage>,
    state: State,
    memory: Arc<StationMemory>,
}

// SAFETY: the state is reached through this block alone; see `StationMemory`.
unsafe impl Send for PluginBlock {}

impl PluginBlock {
    pub(super) fn new(
        id: BlockId,
        info: &BlockInfo,
        code: Code,
        panic_message: Option<PanicMessage>,
        memory: Arc<StationMemory>,
    ) -> Self {
        let state = State::new(code.state_size);
        Self { id, name: info.name.clone(), interface: info.interface.clone(), code, panic_message, state, memory }
    }

    /// The plugin's last panic.
    #[cold]
    fn panic_text(&self) -> Text {
        let mut text = Text { bytes: [0; _], len: 0 };
        if let Some(message) = self.panic_message {
            // SAFETY: a function of the type the interface names; pointer and length are those of an array.
            text.len = unsafe { message(text.bytes.as_mut_ptr(), abi::TEXT_MAX) } as usize;
        }
        text
    }

    /// The block has broken off: why, for the diagnostic buffer.
    #[cold]
    fn broken(&self, status: abi::Status, cx: &mut dyn NativeContext) -> Abort {
        let (id, name) = (self.id, self.name.as_str());
        let (event, line) = match status {
            abi::PANICKED => {
                let text = self.panic_text();
                let text = if text.as_str().is_empty() { "a panic without a message" } else { text.as_str() };
                (Event::PLUGIN_PANIC, Text::new(format_args!("{id} {name}: {text}")))
            }
            abi::ABORT => {
                let line = Text::new(format_args!("{id} {name} returned ABORT without being asked to"));
                (Event::PLUGIN_STOP, line)
            }
            other => (Event::PLUGIN_STOP, Text::new(format_args!("{id} {name} returned status {other}"))),
        };
        cx.stop(event, line.as_str())
    }
}

impl NativeBlock for PluginBlock {
    fn id(&self) -> BlockId {
        self.id
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn interface(&self) -> &Interface {
        &self.interface
    }

    fn is_plugin(&self) -> bool {
        true
    }

    fn reset(&self) {
        self.state.clear();
        self.memory.clear();
    }

    #[inline]
    fn call(&self, cx: &mut dyn NativeContext) -> Result<(), Abort> {
        let mut frame = Frame { cx, memory: &self.memory, abort: false, panic: None };
        // SAFETY: an entry of the type the interface names, with a table that lives forever, the frame as the call
        // context it gives back to the host's functions, and its own state. The frame is not touched until the entry
        // has returned.
        let status = unsafe { (self.code.entry)(&raw const HOST, (&raw mut frame).cast(), self.state.pointer()) };
        if let Some(panic) = frame.panic.take() {
            resume_unwind(panic);
        }
        if frame.abort {
            // Whatever it returned: it was ordered to leave.
            return Err(match status {
                abi::PANICKED => self.broken(status, frame.cx),
                _ => Abort,
            });
        }
        if status == abi::OK { Ok(()) } else { Err(self.broken(status, frame.cx)) }
    }
}
