//! Services of the CPU that some standard blocks need: state the CPU keeps, and traits it implements.
//!
//! If the rules of a service are those of the reference manual, its state is here together with its rules (error
//! filter, alarms, interrupt locks, run-time meters, interrupts by time): the CPU keeps the state and asks it. What the
//! CPU does in its own way (memory of data blocks, images, the diagnostic buffer) is a trait.

mod alarms;
mod filter;
mod locks;
mod meter;
mod schedule;
mod traits;

pub use alarms::{AlarmCall, AlarmError, AlarmLock, AlarmTable, NoPlaceFor, Owner, Reported};
pub use filter::ErrorFilter;
pub use locks::{InterruptLocks, LockError};
pub use meter::RunTimeMeter;
pub use schedule::{DelayInterrupt, Period, TimeOfDayInterrupt};
pub use traits::{
    AlarmInfo, AlarmSource, CreateError, DataBlocks, DbInfo, DbRequest, DeleteError, ImageError, Images, LoadError,
    MessageError, Messages, Meters, NoPlace, Placed, Rack, RunTimes, Schedule, StartInfo, StatusError, SystemStatus,
    WallClock,
};
