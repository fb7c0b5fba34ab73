//! What a block that is not made of statements can ask of the CPU. The CPU implements [`Context`]; a test gives a fake.

use ob1_model::Area;
use ob1_time::{Instant, Span};

use crate::services::Services;

/// Why the CPU refused a request; the block decides what that means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The CPU is going to STOP: return [`Abort`].
    Abort,
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
    /// The block to call does not exist, or its arguments do not match.
    NoBlock,
    /// No timer or counter of this number.
    NoTimer,
}

/// A block is to be left at once: the CPU goes to STOP, or the run ends. Every caller returns it unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Abort;

/// How a block ends. BR and RET_VAL are set before.
pub type Done = Result<(), Abort>;

/// Memory that a block may name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NativeArea {
    /// Process image of the inputs.
    Input,
    /// Process image of the outputs.
    Output,
    /// Bit memory, from M 0.0 on.
    Memory,
    /// The data block with this number.
    Db(u16),
    /// The instance of the running FB.
    Instance,
    /// Local data of the caller.
    CallerLocal,
}

/// The running FB's instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instance {
    /// Number of the instance data block.
    pub db: u16,
    /// First byte in it.
    pub offset: u32,
    /// Length of the instance in bytes.
    pub len: u32,
}

/// Bytes of input and output registers of a module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModuleSize {
    /// Input bytes (module to CPU).
    pub inputs: u16,
    /// Output bytes (CPU to module).
    pub outputs: u16,
}

/// The CPU as a block sees it during its call. Parameters are counted as in [`ob1_model::Interface::formals`].
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
    /// Reads bytes of an area.
    fn area_read(&mut self, area: NativeArea, at: u32, into: &mut [u8]) -> Result<(), Refused>;
    /// Writes bytes of an area.
    fn area_write(&mut self, area: NativeArea, at: u32, from: &[u8]) -> Result<(), Refused>;
    /// Where the instance of the running FB is; nothing in an FC.
    fn instance(&mut self) -> Option<Instance>;
    /// Data blocks in the DB and DI registers of the caller, 0 for none.
    fn registers(&mut self) -> (u16, u16);
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
    /// Writes a whole record to a module. The records of handling blocks are unknown to it.
    fn record_write(&mut self, address: u32, record: u8, from: &[u8]) -> Result<(), Refused>;

    /// Restarts the cycle monitoring (SFC 43).
    fn retrigger_watchdog(&mut self);
    /// Waits this long inside the call (SFC 47); higher priority classes may run meanwhile.
    ///
    /// # Errors
    /// The CPU goes to STOP.
    fn wait(&mut self, time: Span) -> Done;
    /// Sends the CPU to STOP (SFC 46); the block ends with what this returns.
    fn stop_by_program(&mut self) -> Abort;
    /// Clock, interrupts by time, masks and locks, data blocks, and what else only standard blocks ask for.
    fn services(&mut self) -> &mut dyn Services;

    /// Reads bytes of the running FB's instance.
    fn instance_read(&mut self, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        self.area_read(NativeArea::Instance, at, into)
    }
    /// Writes bytes of the running FB's instance.
    fn instance_write(&mut self, at: u32, from: &[u8]) -> Result<(), Refused> {
        self.area_write(NativeArea::Instance, at, from)
    }
    /// What a pointer to this area names: `db` counts for `Db` and `Di`, and 0 is the block in the caller's register;
    /// local data is the caller's, whichever of its two codes the pointer has. `None`: peripheral bytes.
    fn pointed(&mut self, area: Area, db: u16) -> Option<NativeArea> {
        let (opened_db, opened_di) = self.registers();
        Some(match area {
            Area::Input => NativeArea::Input,
            Area::Output => NativeArea::Output,
            Area::Memory => NativeArea::Memory,
            Area::Local | Area::PreviousLocal => NativeArea::CallerLocal,
            Area::Db => NativeArea::Db(if db == 0 { opened_db } else { db }),
            Area::Di => NativeArea::Db(if db == 0 { opened_di } else { db }),
            Area::Peripheral => return None,
        })
    }
    /// Reads bytes that a pointer names, see [`Context::pointed`].
    fn pointer_read(&mut self, area: Area, db: u16, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        match self.pointed(area, db) {
            Some(area) => self.area_read(area, at, into),
            None => self.io_read(at, into),
        }
    }
    /// Writes bytes that a pointer names.
    fn pointer_write(&mut self, area: Area, db: u16, at: u32, from: &[u8]) -> Result<(), Refused> {
        match self.pointed(area, db) {
            Some(area) => self.area_write(area, at, from),
            None => self.io_write(at, from),
        }
    }
}
