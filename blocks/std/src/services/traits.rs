//! Services that the CPU provides in its own way.

use ob1_model::AlarmTime;
use ob1_model::moment::Moment;

use crate::services::{AlarmTable, DelayInterrupt, ErrorFilter, InterruptLocks, RunTimeMeter, TimeOfDayInterrupt};

/// The CPU's clock of date and time.
pub trait WallClock {
    /// Date and time now.
    fn moment(&mut self) -> Moment;
    /// Sets date and time; they continue from there.
    fn set_moment(&mut self, moment: Moment);
}

/// Run-time meters, numbered from 0.
pub trait Meters {
    /// A meter, or `None` when there is none of this number.
    fn meter(&mut self, number: u8) -> Option<&mut RunTimeMeter>;
}

/// Interrupts by time. The CPU looks at them again after a block that asked for one of them.
pub trait Schedule: WallClock {
    /// The interrupt of OB 10 to 17; `None` for an OB this CPU does not have.
    fn time_of_day(&mut self, ob: u16) -> Option<&mut TimeOfDayInterrupt>;
    /// The interrupt of OB 20 to 23; `None` for an OB this CPU does not have.
    fn delay(&mut self, ob: u16) -> Option<&mut DelayInterrupt>;
}

/// A data block to be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DbRequest {
    /// The lowest number it may get.
    pub low: u16,
    /// The highest number it may get.
    pub high: u16,
    /// Its length in bytes, even.
    pub bytes: u16,
    /// SFC 82: not in the work memory.
    pub unlinked: bool,
    /// Write-protected for the program.
    pub read_only: bool,
    /// No restart keeps its values.
    pub non_retain: bool,
}

/// Why a data block cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CreateError {
    /// The limits are beyond the numbers of this CPU.
    Numbers,
    /// The length is more than this CPU allows.
    Length,
    /// No number is free between the limits.
    NoneFree,
    /// No memory is left.
    NoMemory,
    /// Not possible now; a later call may succeed.
    NotNow,
}

/// Why a data block cannot be deleted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeleteError {
    /// A number this CPU does not have.
    Number,
    /// No such data block.
    Missing,
    /// Part of the program on the memory card: not to be deleted.
    Fixed,
    /// Not possible now; a later call may succeed.
    NotNow,
}

/// Why the load memory cannot be read or written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadError {
    /// No such data block in the load memory.
    Missing,
    /// Outside the data block.
    Outside,
    /// The data block is write-protected.
    Protected,
}

/// What SFC 24 reports of a data block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DbInfo {
    /// Length of the data block in bytes.
    pub bytes: u16,
    /// Write-protected for the program.
    pub read_only: bool,
    /// Only in the load memory.
    pub unlinked: bool,
}

/// Making and deleting data blocks.
pub trait DataBlocks {
    /// Makes a data block with the lowest free number and returns that. Its bytes are what was in this memory before,
    /// or 0.
    ///
    /// # Errors
    /// [`CreateError`]: the limits or the length are beyond this CPU, no number or memory is free, or it is not
    /// possible now.
    fn create(&mut self, request: &DbRequest) -> Result<u16, CreateError>;
    /// Deletes a data block.
    ///
    /// # Errors
    /// [`DeleteError`]: no such number or data block, or it is not to be deleted, at all or now.
    fn delete(&mut self, number: u16) -> Result<(), DeleteError>;
    /// What is known of a data block.
    ///
    /// # Errors
    /// `Number` for a number that cannot be, `Missing` for a data block that is not there.
    fn info(&mut self, number: u16) -> Result<DbInfo, DeleteError>;
    /// Reads the initial values of a data block from the load memory.
    ///
    /// # Errors
    /// [`LoadError`]: there is no such data block, or the bytes lie outside it.
    fn load_read(&mut self, number: u16, at: u32, into: &mut [u8]) -> Result<(), LoadError>;
    /// Writes initial values in the load memory.
    ///
    /// # Errors
    /// [`LoadError`]: there is no such data block, the bytes lie outside it, or it is write-protected.
    fn load_write(&mut self, number: u16, at: u32, from: &[u8]) -> Result<(), LoadError>;
}

/// Why an image was not updated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageError {
    /// No such partition number.
    Partition,
    /// The partition is not configured, or the CPU updates it itself every cycle.
    NotConfigured,
    /// The byte at this address could not be accessed.
    Access(u16),
}

/// The process images, as SFC 26 and 27 update them.
pub trait Images {
    /// Reads the inputs of a partition, 0 for the whole image that is not partitioned.
    ///
    /// # Errors
    /// [`ImageError`]: no such partition, one that the CPU updates itself, or a byte that cannot be read.
    fn update_inputs(&mut self, partition: u8) -> Result<(), ImageError>;
    /// Writes the outputs of a partition.
    ///
    /// # Errors
    /// [`ImageError`]: no such partition, one that the CPU updates itself, or a byte that cannot be written.
    fn update_outputs(&mut self, partition: u8) -> Result<(), ImageError>;
}

/// Why a system status list is not given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatusError {
    /// SZL_ID is wrong or unknown here.
    Id,
    /// INDEX is wrong or not permitted.
    Index,
    /// Not available now; a later call may succeed.
    NotNow,
}

impl StatusError {
    /// RET_VAL of SFC 51.
    pub const fn code(self) -> u16 {
        match self {
            Self::Id => 0x8082,
            Self::Index => 0x8083,
            Self::NotNow => 0x8085,
        }
    }
}

/// Run times of an OB in microseconds (SFC 78).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunTimes {
    /// Number of the OB.
    pub ob: u16,
    /// Priority class of the OB.
    pub priority: u16,
    /// Run time of the last completed execution, interruptions left out; all ones when there is none.
    pub last_run: u32,
    /// From call to end of the last completed execution.
    pub last_whole: u32,
    /// When the execution under way was requested.
    pub request: u32,
    /// Run time of the execution under way; 0 when it is not running.
    pub current_run: u32,
    /// Time since the call of the execution under way.
    pub current_whole: u32,
    /// Until the next request waiting; 0 when none waits.
    pub next: u32,
}

/// System status lists (SZL) and run times.
pub trait SystemStatus {
    /// Gives each record of a list to `each` and returns the length of a record in bytes.
    ///
    /// # Errors
    /// [`StatusError`]: SZL_ID or INDEX is wrong, or the list is not available now.
    fn list(&mut self, id: u16, index: u16, each: &mut dyn FnMut(&[u8])) -> Result<u16, StatusError>;
    /// Run times of an OB, 0 for the running one; `None` for an OB that is not configured.
    fn run_times(&mut self, ob: u16) -> Option<RunTimes>;
}

/// A module in its place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Placed {
    /// The number of its master system; 0: it is a central module.
    pub master: u8,
    /// The rack, from 0; of a distributed module the station.
    pub rack: u16,
    /// The slot in it; 0 of a station is the station itself.
    pub slot: u16,
    /// Logical address of the first input byte, and how many there are.
    pub inputs: (u16, u16),
    /// Logical address of the first output byte, and how many there are.
    pub outputs: (u16, u16),
}

/// Which part of the place of a distributed module does not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoPlace {
    /// There is no such master system.
    Master,
    /// There is no such station.
    Station,
    /// The slot, or nothing is in it.
    Slot,
}

/// Where the modules are plugged.
pub trait Rack {
    /// How SFC 49 and 71 call the area of this CPU's central modules: 0 for an S7-400, 1 for an S7-300.
    fn area(&mut self) -> u8;
    /// The module one of whose input (or output) bytes has this logical address.
    fn module_with(&mut self, address: u16, output: bool) -> Option<Placed>;
    /// The central module in this rack and slot.
    fn module_in(&mut self, rack: u16, slot: u16) -> Option<Placed>;
    /// The module in this slot of a station.
    ///
    /// # Errors
    /// Which part of this place does not exist.
    fn module_on(&mut self, master: u16, station: u16, slot: u16) -> Result<Placed, NoPlace>;
}

/// Why a user message was not sent to a station. The entry is in the diagnostic buffer nevertheless.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MessageError {
    /// No station is logged on.
    NoStation,
    /// The send buffer is full.
    Full,
}

/// Messages of the program.
pub trait Messages {
    /// Enters a user event with up to 2 and 4 bytes of information in the diagnostic buffer and sends it to logged-on
    /// stations when asked to.
    ///
    /// # Errors
    /// The entry is made, but not sent.
    fn user_message(&mut self, event: u16, info1: &[u8], info2: &[u8], send: bool) -> Result<(), MessageError>;
    /// The alarms.
    fn alarms(&mut self) -> &mut AlarmTable;
    /// The time of a message that is made now.
    fn alarm_time(&mut self) -> AlarmTime;
    /// Hands over what waits in the table, as far as there is room.
    fn send_alarms(&mut self);
}

/// Start information as in the local data of an OB: 12 bytes without the time stamp.
pub trait StartInfo {
    /// That of the OB that was called last and has not ended.
    fn current(&mut self) -> [u8; 12];
    /// That of the start-up OB that was started last.
    fn start_up(&mut self) -> [u8; 12];
}

/// The alarm an OB is handling.
#[derive(Clone, Copy, Debug)]
pub struct AlarmInfo {
    /// Logical address of the component it comes from, bit 15 set for an output.
    pub address: u32,
    /// The OB's start information, time stamp included.
    pub start: [u8; 20],
    /// The alarm's bytes, header included.
    pub data: [u8; 64],
    /// How many of them.
    pub len: u8,
}

/// Alarms of modules (SFB 54).
pub trait AlarmSource {
    /// The alarm whose OB is running; `None` when the OB that runs was not started by one.
    fn alarm(&mut self) -> Option<AlarmInfo>;
}

/// All of it, as the CPU has it.
pub trait Services:
    Meters + Schedule + DataBlocks + StartInfo + Images + Rack + SystemStatus + Messages + AlarmSource
{
    /// The filter of synchronous errors of the running priority class.
    fn error_filter(&mut self) -> &mut ErrorFilter;
    /// Which interrupts are locked and delayed.
    fn interrupt_locks(&mut self) -> &mut InterruptLocks;
    /// Puts a value into ACCU1 of the block that an error has interrupted; false outside OB 121 and OB 122.
    fn replace_value(&mut self, value: u32) -> bool;
}
