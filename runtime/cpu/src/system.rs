//! The standard blocks of `ob1-std` as native blocks: what they ask of the CPU, put in the CPU's own words.

use ob1_model::{Area, BlockId, Event, Interface};
use ob1_std::services::{
    AlarmSource, DataBlocks, ErrorFilter, Images, InterruptLocks, Messages, Meters, Rack, Schedule, StartInfo,
    SystemStatus, WallClock,
};
use ob1_std::{Context, Done, Interrupted, ModuleSize, Refused, StandardBlock};
use ob1_time::{Instant, Span};

use crate::{Abort, ModuleError, NativeArea, NativeBlock, NativeContext, NativeError};

/// The system functions (SFC, SFB), ready for [`crate::Cpu::new`]. The compiler gets the same by
/// [`ob1_std::system_functions`].
#[must_use]
pub fn system_blocks() -> Vec<Box<dyn NativeBlock>> {
    ob1_std::system_functions().into_iter().map(|block| standard_block(block.id, block)).collect()
}

/// A standard block under the number the user gives it.
#[must_use]
pub fn standard_block(id: BlockId, block: StandardBlock) -> Box<dyn NativeBlock> {
    Box::new(Standard { id, block })
}

struct Standard {
    id: BlockId,
    block: StandardBlock,
}

impl NativeBlock for Standard {
    fn id(&self) -> BlockId {
        self.id
    }

    fn name(&self) -> &str {
        self.block.name
    }

    fn interface(&self) -> &Interface {
        &self.block.interface
    }

    fn reset(&self) {}

    fn call(&self, cx: &mut dyn NativeContext) -> Result<(), Abort> {
        self.block.run(&mut Bridge { cx }).map_err(|Interrupted| Abort)
    }
}

/// A call, as a standard block sees it.
struct Bridge<'a> {
    cx: &'a mut dyn NativeContext,
}

impl Bridge<'_> {
    /// The area of a pointer. Local data is the caller's, whichever of its two codes the pointer has.
    fn area(&mut self, area: Area, db: u16) -> Option<NativeArea> {
        let (opened_db, opened_di) = self.cx.registers();
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
}

fn refused(error: NativeError) -> Refused {
    match error {
        NativeError::NoParam => Refused::NoParam,
        NativeError::NoDb => Refused::NoDb,
        NativeError::DbNumber => Refused::DbNumber,
        NativeError::ReadOnly => Refused::ReadOnly,
        NativeError::NoModule => Refused::NoModule,
        NativeError::Module(ModuleError::Absent) => Refused::Absent,
        NativeError::Module(ModuleError::Busy) => Refused::Busy,
        NativeError::Module(ModuleError::NoRecord) => Refused::NoRecord,
        NativeError::Module(ModuleError::Outside) | NativeError::Outside => Refused::Outside,
        // Errors that only calls, timers and counters give.
        NativeError::Abort | NativeError::NoBlock | NativeError::NoTimer => Refused::NoParam,
    }
}

impl Context for Bridge<'_> {
    fn given(&mut self, index: u32) -> bool {
        self.cx.param_given(index)
    }

    fn get(&mut self, index: u32) -> Result<u32, Refused> {
        self.cx.param_get(index).map_err(refused)
    }

    fn set(&mut self, index: u32, value: u32) -> Result<(), Refused> {
        self.cx.param_set(index, value).map_err(refused)
    }

    fn read(&mut self, index: u32, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        self.cx.param_read(index, at, into).map_err(refused)
    }

    fn write(&mut self, index: u32, at: u32, from: &[u8]) -> Result<(), Refused> {
        self.cx.param_write(index, at, from).map_err(refused)
    }

    fn instance_read(&mut self, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        self.cx.area_read(NativeArea::Instance, at, into).map_err(refused)
    }

    fn instance_write(&mut self, at: u32, from: &[u8]) -> Result<(), Refused> {
        self.cx.area_write(NativeArea::Instance, at, from).map_err(refused)
    }

    fn instance_place(&mut self) -> (u16, u32) {
        self.cx.instance().map_or((0, 0), |instance| (instance.db, instance.offset))
    }

    fn area_read(&mut self, area: Area, db: u16, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        match self.area(area, db) {
            Some(area) => self.cx.area_read(area, at, into).map_err(refused),
            None => self.io_read(at, into),
        }
    }

    fn area_write(&mut self, area: Area, db: u16, at: u32, from: &[u8]) -> Result<(), Refused> {
        match self.area(area, db) {
            Some(area) => self.cx.area_write(area, at, from).map_err(refused),
            None => self.io_write(at, from),
        }
    }

    fn set_br(&mut self, br: bool) {
        self.cx.set_br(br);
    }

    fn now(&mut self) -> Instant {
        self.cx.now()
    }

    fn module(&mut self, address: u32) -> Result<ModuleSize, Refused> {
        let (_, inputs, outputs) = self.cx.module_info(address).map_err(refused)?;
        Ok(ModuleSize { inputs, outputs })
    }

    fn io_read(&mut self, address: u32, into: &mut [u8]) -> Result<(), Refused> {
        self.cx.io_read(address, into).map_err(refused)
    }

    fn io_write(&mut self, address: u32, from: &[u8]) -> Result<(), Refused> {
        self.cx.io_write(address, from).map_err(refused)
    }

    fn record_read(&mut self, address: u32, record: u8, into: &mut [u8]) -> Result<usize, Refused> {
        self.cx.record_read(address, record, into).map_err(refused)
    }

    fn record_write(&mut self, address: u32, record: u8, from: &[u8]) -> Result<(), Refused> {
        self.cx.program_record_write(address, record, from).map_err(refused)
    }

    fn retrigger_watchdog(&mut self) {
        self.cx.retrigger_watchdog();
    }

    fn wall_clock(&mut self) -> &mut dyn WallClock {
        self.cx.services()
    }

    fn meters(&mut self) -> &mut dyn Meters {
        self.cx.services()
    }

    fn schedule(&mut self) -> &mut dyn Schedule {
        self.cx.services()
    }

    fn error_filter(&mut self) -> &mut ErrorFilter {
        self.cx.services().error_filter()
    }

    fn replace_value(&mut self, value: u32) -> bool {
        self.cx.services().replace_value(value)
    }

    fn images(&mut self) -> &mut dyn Images {
        self.cx.services()
    }

    fn system_status(&mut self) -> &mut dyn SystemStatus {
        self.cx.services()
    }

    fn messages(&mut self) -> &mut dyn Messages {
        self.cx.services()
    }

    fn alarm_source(&mut self) -> &mut dyn AlarmSource {
        self.cx.services()
    }

    fn wait(&mut self, time: Span) -> Done {
        self.cx.wait(time).map_err(|Abort| Interrupted)
    }

    fn interrupt_locks(&mut self) -> &mut InterruptLocks {
        self.cx.services().interrupt_locks()
    }

    fn data_blocks(&mut self) -> &mut dyn DataBlocks {
        self.cx.services()
    }

    fn rack(&mut self) -> &mut dyn Rack {
        self.cx.services()
    }

    fn start_info(&mut self) -> &mut dyn StartInfo {
        self.cx.services()
    }

    fn stop(&mut self) -> Interrupted {
        let Abort = self.cx.stop(Event::STOP_PROGRAM, "");
        Interrupted
    }
}
