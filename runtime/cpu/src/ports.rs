//! What the CPU is given: a clock, modules, and native blocks, all as trait objects. It knows nothing of plugins,
//! drivers or operating systems.

use std::sync::atomic::AtomicU64;

use crate::OperatingState;
use ob1_model::{BlockId, Event, FaultKind, Interface, TimerKind};
use ob1_std::{Abort, Context, NativeArea, Refused};
use ob1_time::Instant;

/// The header of a snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark {
    /// The number that [`crate::Link::watch`] was given.
    pub generation: u64,
    /// Counts the cycle control points, those in STOP included.
    pub scan: u64,
    /// When it was taken, by the runtime's clock.
    pub time: Instant,
    /// The operating state then.
    pub state: OperatingState,
}

/// Where the snapshots of a link go. Called by the scan: it allocates nothing and never waits.
pub trait Window: Send {
    /// Makes the next snapshot: calls `fill` once, with room for [`ob1_model::FRAME_WORDS`] words.
    fn put(&mut self, mark: Mark, fill: &mut dyn FnMut(&[AtomicU64]));
}

/// Why a module cannot be accessed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModuleError {
    /// Its driver is down.
    Absent,
    /// The bytes lie outside its registers.
    Outside,
    /// It is busy; a later request may succeed.
    Busy,
    /// It has no such record or line.
    NoRecord,
}

impl From<ModuleError> for Refused {
    fn from(error: ModuleError) -> Self {
        match error {
            ModuleError::Absent => Self::Absent,
            ModuleError::Outside => Self::Outside,
            ModuleError::Busy => Self::Busy,
            ModuleError::NoRecord => Self::NoRecord,
        }
    }
}

/// A module's state, for programs and tools.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModuleStatus {
    /// True while its driver answers.
    pub present: bool,
    /// Counts the driver's starts.
    pub generation: u32,
}

/// Something a module reports by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModuleEvent {
    /// What the diagnostic buffer says.
    pub event: Event,
    /// Raises OB 82 when true.
    pub diagnostic_interrupt: bool,
    /// Bytes of diagnostic data or of the text, meaning by event. Of a lost or returned station of a bus
    /// ([`Event::BUS_FAILED`], [`Event::STATION_FAILED`], [`Event::STATION_BACK`]): diagnostic address of the station,
    /// that of the bus, number of the bus, number of the station, 1 for one that was missing at the start-up already;
    /// no text.
    pub data: [u8; 16],
    /// Bytes of `data` in use. In a [`Event::STATION_FAULT`] or [`Event::STATION_REFUSES`] that is a diagnostic
    /// interrupt, text follows the first four bytes.
    pub len: u8,
}

/// An entry of a module's own diagnostic buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModuleEntry {
    /// The module's number of the event: class (high byte) and number (low byte) of a CP 341.
    pub number: u16,
    /// The event has come; otherwise a state that had come is gone.
    pub incoming: bool,
    /// When it was entered, by the runtime's clock.
    pub time: Instant,
}

/// A module on the back plane as the CPU sees it: input and output registers at a logical address, records, events.
///
/// All methods run on the scan thread: they neither block nor allocate, and make no system call but a doorbell. Offsets
/// count from the first byte of the module.
pub trait Module: Send {
    /// Bytes of input registers (CP to CPU).
    fn input_bytes(&self) -> u16;
    /// Bytes of output registers (CPU to CP).
    fn output_bytes(&self) -> u16;
    /// Once a scan, before the process image of the inputs is read.
    fn begin_scan(&mut self, now: Instant);
    /// Reads input registers. An absent driver's registers read 0 and this is `Ok`, unless the station file says
    /// `absent = "fault"`.
    fn read(&mut self, at: u16, into: &mut [u8]) -> Result<(), ModuleError>;
    /// Reads input registers from the first on for the process image. The image gets what `into` holds,
    /// also when this fails: zeros, unless the module has substitute values.
    fn read_image(&mut self, into: &mut [u8]) -> Result<(), ModuleError> {
        let read = self.read(0, into);
        if read.is_err() {
            into.fill(0);
        }
        read
    }
    /// Writes output registers; the bytes of one call reach the module together.
    fn write(&mut self, at: u16, from: &[u8]) -> Result<(), ModuleError>;
    /// Once a scan, after the process image of the outputs is written: rings the doorbell where one is due.
    fn end_scan(&mut self, now: Instant);
    /// The CPU went to RUN (true: parameters are sent again) or to STOP (the CPU writes zeros itself).
    fn cpu_state(&mut self, run: bool);
    /// HOLD begins (true): until it ends outputs are in their safe state, and keep what was and is written for then. A
    /// CP, whose registers are no outputs, does nothing.
    fn output_disable(&mut self, _on: bool) {}
    /// The next event, if any.
    fn poll_event(&mut self) -> Option<ModuleEvent>;
    /// State for programs and tools.
    fn status(&self) -> ModuleStatus;
    /// Reads a record; returns its length. Record [`ob1_std::DP_DIAGNOSIS`] is the diagnosis of a DP slave.
    fn record_read(&mut self, record: u8, into: &mut [u8]) -> Result<usize, ModuleError>;
    /// Writes a whole record to the module.
    fn record_write(&mut self, record: u8, from: &[u8]) -> Result<(), ModuleError>;
    /// Whether the module's handling blocks exchange data by this record. No other block writes it.
    fn is_of_blocks(&self, _record: u8) -> bool {
        false
    }
    /// Tells the entries of its own diagnostic buffer, newest first; false if it has none.
    fn diagnostic_buffer(&mut self, _each: &mut dyn FnMut(ModuleEntry)) -> bool {
        false
    }
}

/// An actual parameter of a call a native block makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NativeArg {
    /// No actual was supplied for this formal.
    Open,
    /// A value, right-aligned; timer, counter and block numbers too.
    Value(u32),
    /// An operand by bit address.
    Operand(NativeArea, u32),
}

/// A timer as programs see it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimerState {
    /// What a scan gives.
    pub output: bool,
    /// True while it runs.
    pub running: bool,
    /// Remaining time as S5TIME.
    pub remaining: u16,
}

/// The running organization block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ObInfo {
    /// Number of the organization block.
    pub number: u16,
    /// Priority class of the organization block.
    pub priority: u8,
    /// Start information as in its local data.
    pub start: [u8; 20],
}

/// What a native block can ask of the CPU during its call. With the part that standard blocks use too the plugin
/// interface (`ob1_sdk::abi`) mirrors these functions one by one; meanings are documented there.
#[expect(missing_docs, reason = "documented at the function of the same name in ob1_sdk::abi::HostTable")]
pub trait NativeContext: Context {
    fn bit_get(&mut self, area: NativeArea, bit: u32) -> Result<bool, Refused>;
    fn bit_set(&mut self, area: NativeArea, bit: u32, value: bool) -> Result<(), Refused>;
    fn area_len(&mut self, area: NativeArea) -> Result<u32, Refused>;

    fn timer_run(&mut self, number: u16, kind: TimerKind, rlo: bool, s5time: u16) -> Result<(), Refused>;
    fn timer_reset(&mut self, number: u16) -> Result<(), Refused>;
    fn timer_get(&mut self, number: u16) -> Result<TimerState, Refused>;
    fn counter_get(&mut self, number: u16) -> Result<u16, Refused>;
    fn counter_set(&mut self, number: u16, value: u16) -> Result<(), Refused>;

    /// Status of the module at exactly this logical base address.
    fn module_status(&mut self, address: u32) -> Result<ModuleStatus, Refused>;
    /// Writes a record, those that handling blocks exchange with their CP included.
    fn record_of_block_write(&mut self, address: u32, record: u8, from: &[u8]) -> Result<(), Refused>;

    fn call_block(&mut self, id: BlockId, instance_db: u16, args: &[NativeArg]) -> Result<(), Refused>;
    fn ob_info(&mut self) -> ObInfo;
    fn attend(&mut self) -> Result<(), Abort>;
    fn raise_fault(&mut self, kind: FaultKind, number: u32) -> Result<(), Abort>;
    fn diagnostic_interrupt(&mut self, address: u32, data: &[u8]) -> Result<(), Refused>;
    fn diag_entry(&mut self, number: u16, text: &str);
    /// Enters the text, marks the CPU for STOP; the block then returns [`Abort`]. `event`: a panic or a request.
    fn stop(&mut self, event: Event, text: &str) -> Abort;
    fn log(&mut self, level: u8, text: &str);
}

/// A block that is not made of statements: of a plugin, of the standard library, of the user, in Rust or C.
pub trait NativeBlock: Send {
    /// Kind and number under which it is loaded.
    fn id(&self) -> BlockId;
    /// Its name, for lists.
    fn name(&self) -> &str;
    /// Its parameters, and of an FB its instance data.
    fn interface(&self) -> &Interface;
    /// Brought by a plugin: the time of its calls is accounted for.
    fn is_plugin(&self) -> bool {
        false
    }
    /// A start-up: state the block keeps for the station is zeroed.
    fn reset(&self);
    /// Runs it. `&self`, because a block may come to be called again from a block it called.
    fn call(&self, cx: &mut dyn NativeContext) -> Result<(), Abort>;
}
