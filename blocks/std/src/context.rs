//! What a standard block can ask of the CPU. The CPU implements [`Context`]; a test gives a fake.

use ob1_model::Area;
use ob1_time::{Instant, Span};

use crate::services::{
    AlarmSource, DataBlocks, ErrorFilter, Images, InterruptLocks, Messages, Meters, Rack, Schedule, StartInfo,
    SystemStatus, WallClock,
};

/// Why the CPU refused a request; the block makes an error code of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// No such parameter, or of another kind.
    NoParam,
    /// The address lies outside the area.
    Outside,
    /// The data block does not exist.
    NoDb,
    /// The data block number is impossible.
    DbNumber,
    /// The data block is write-protected.
    ReadOnly,
    /// No module at this address.
    NoModule,
    /// The module does not answer.
    Absent,
    /// The module cannot do it now.
    Busy,
    /// The module has no such record.
    NoRecord,
}

/// The block did not come to its end: the CPU goes to STOP, or the run ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interrupted;

/// How a block ends. BR and RET_VAL are set before.
pub type Done = Result<(), Interrupted>;

/// Bytes of input and output registers of a module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModuleSize {
    /// Input bytes (module to CPU).
    pub inputs: u16,
    /// Output bytes (CPU to module).
    pub outputs: u16,
}

/// The CPU as a standard block sees it during its call. Parameters are counted as in [`ob1_model::Interface::formals`].
pub trait Context {
    /// True when the call supplies the parameter.
    fn given(&mut self, index: u32) -> bool;
    /// A parameter of up to 32 bits, right-aligned; a block or timer number too.
    fn get(&mut self, index: u32) -> Result<u32, Refused>;
    /// Sets a parameter of up to 32 bits.
    fn set(&mut self, index: u32, value: u32) -> Result<(), Refused>;
    /// Bytes of a parameter from byte `at` on. An ANY or POINTER reads as the pointer itself, outputs too.
    fn read(&mut self, index: u32, at: u32, into: &mut [u8]) -> Result<(), Refused>;
    /// Writes bytes of a parameter from byte `at` on.
    fn write(&mut self, index: u32, at: u32, from: &[u8]) -> Result<(), Refused>;
    /// Reads bytes of the running FB's instance.
    fn instance_read(&mut self, at: u32, into: &mut [u8]) -> Result<(), Refused>;
    /// Writes bytes of the running FB's instance.
    fn instance_write(&mut self, at: u32, from: &[u8]) -> Result<(), Refused>;
    /// The instance of the running FB: its data block, and its first byte there.
    fn instance_place(&mut self) -> (u16, u32);
    /// Reads bytes of an area. `db` counts for `Db` and `Di`; 0 is the block in the caller's register. Local data is
    /// the caller's.
    fn area_read(&mut self, area: Area, db: u16, at: u32, into: &mut [u8]) -> Result<(), Refused>;
    /// Writes bytes of an area, see [`Context::area_read`].
    fn area_write(&mut self, area: Area, db: u16, at: u32, from: &[u8]) -> Result<(), Refused>;
    /// Sets the binary result; it is 1 before the first time.
    fn set_br(&mut self, br: bool);
    /// The CPU's own time; never goes back.
    fn now(&mut self) -> Instant;

    /// The module whose logical base address this is.
    fn module(&mut self, address: u32) -> Result<ModuleSize, Refused>;
    /// Reads peripheral input bytes.
    fn io_read(&mut self, address: u32, into: &mut [u8]) -> Result<(), Refused>;
    /// Writes peripheral output bytes; they reach the module together.
    fn io_write(&mut self, address: u32, from: &[u8]) -> Result<(), Refused>;
    /// Reads a record and returns its length; `Outside` when it is longer than `into`.
    fn record_read(&mut self, address: u32, record: u8, into: &mut [u8]) -> Result<usize, Refused>;
    /// Writes a whole record to a module.
    fn record_write(&mut self, address: u32, record: u8, from: &[u8]) -> Result<(), Refused>;

    /// Restarts the cycle monitoring.
    fn retrigger_watchdog(&mut self);
    /// Sends the CPU to STOP; the block ends with what this returns.
    fn stop(&mut self) -> Interrupted;

    /// The time of day.
    fn wall_clock(&mut self) -> &mut dyn WallClock;
    /// The run-time meters of the CPU.
    fn meters(&mut self) -> &mut dyn Meters;
    /// Time-of-day and time-delay interrupts.
    fn schedule(&mut self) -> &mut dyn Schedule;
    /// The filter of synchronous errors of the running priority class.
    fn error_filter(&mut self) -> &mut ErrorFilter;
    /// Gives `value` to accumulator 1 of the block whose access error is being handled; false outside OB 121 and
    /// OB 122.
    fn replace_value(&mut self, value: u32) -> bool;
    /// Which interrupts are locked.
    fn interrupt_locks(&mut self) -> &mut InterruptLocks;
    /// Creating, deleting and testing data blocks.
    fn data_blocks(&mut self) -> &mut dyn DataBlocks;
    /// Updating the process images.
    fn images(&mut self) -> &mut dyn Images;
    /// System status lists and run times.
    fn system_status(&mut self) -> &mut dyn SystemStatus;
    /// The diagnostic buffer and alarm messages.
    fn messages(&mut self) -> &mut dyn Messages;
    /// Where the modules are plugged.
    fn rack(&mut self) -> &mut dyn Rack;
    /// Start information of organization blocks.
    fn start_info(&mut self) -> &mut dyn StartInfo;
    /// The alarm that is being handled.
    fn alarm_source(&mut self) -> &mut dyn AlarmSource;
    /// Waits this long inside the call; higher priority classes may run meanwhile.
    ///
    /// # Errors
    /// The CPU goes to STOP.
    fn wait(&mut self, time: Span) -> Done;
}
