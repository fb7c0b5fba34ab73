//! What the standard blocks ask of the CPU besides memory: clock, interrupts by time, masked errors, locks, data
//! blocks, where the modules are.
//!
//! The rules of masks and locks are in `ob1-std`; here they are asked at the right places and turned into due times.

use ob1_model::moment::Moment;
use ob1_std::services::{
    AlarmInfo, AlarmSource, CreateError, DataBlocks, DbInfo, DbRequest, DelayInterrupt, DeleteError, ErrorFilter,
    ImageError, Images, InterruptLocks, LoadError, Meters, NoPlace, Period, Placed, Rack, RunTimeMeter, Schedule,
    Services, StartInfo, TimeOfDayInterrupt, WallClock,
};

use crate::Family;
use crate::db_pool::NoDb;
use crate::interrupts::{NEVER, slot_of};
use crate::machine::Machine;
use crate::made_data_blocks::Attributes;
use crate::modules::{Plugged, SLOT};
use crate::service_state::Course;

/// Longest data block SFC 22 makes.
const LONGEST_DB: u16 = 65_534;

/// The PERIOD word of a time-of-day interrupt.
pub(crate) const fn period_word(period: Period) -> u16 {
    match period {
        Period::Once => 0x0000,
        Period::EveryMinute => 0x0201,
        Period::Hourly => 0x0401,
        Period::Daily => 0x1001,
        Period::Weekly => 0x1201,
        Period::Monthly => 0x1401,
        Period::Yearly => 0x1801,
        Period::EndOfMonth => 0x2001,
    }
}

impl Machine {
    /// Looks at the interrupts by time again, after a block that may have changed them.
    #[cold]
    pub(crate) fn reschedule(&mut self) {
        self.services.touched = false;
        for i in 0..self.services.time_of_day.len() {
            if std::mem::take(&mut self.services.time_of_day[i].withdrawn) {
                self.services.courses[i] = Course::default();
                self.interrupts.withdraw(i);
            }
            // One whose time has come already is on its way; looking for the next would lose it.
            if !self.interrupts.is_due(i, self.hot.now) {
                self.next_time_of_day(i);
            }
        }
        for (i, delay) in self.services.delays.iter().enumerate() {
            let slot = slot_of(20 + i as u16).unwrap_or_default();
            if let Some((due, ms, sign)) = delay.due {
                self.interrupts.delays[i] = crate::interrupts::Delay { sign, ms };
                self.interrupts.set_due(slot, due);
            } else {
                self.interrupts.set_due(slot, NEVER);
            }
        }
        // What a lock held back comes at the next safe point.
        self.attention.attend();
    }

    /// Sets and activates the time-of-day interrupts of the configuration.
    pub(crate) fn set_times_of_day(&mut self) {
        for i in 0..self.config.time_of_day.len() {
            let configured = self.config.time_of_day[i];
            let slot = usize::from(configured.ob.saturating_sub(10));
            if let Some(interrupt) = self.services.time_of_day.get_mut(slot).filter(|interrupt| interrupt.loaded) {
                (interrupt.set, interrupt.active) = (Some((configured.start, configured.period)), true);
                self.next_time_of_day(slot);
            }
        }
    }

    /// The next due time of a time-of-day interrupt, OB 10 + `i`; without one it is no longer active.
    fn next_time_of_day(&mut self, i: usize) {
        let now = self.moment_now();
        let interrupt = &mut self.services.time_of_day[i];
        let course = &mut self.services.courses[i];
        let mut next = if interrupt.active { interrupt.next(now) } else { None };
        // When the clock was set back, an S7-300 repeats what is due once more, an S7-400 does not. ["Characteristics
        // of SFCs 28 to 31" of the system software reference]
        if let (Family::S7_400, Some((first, last)), Some(moment)) = (self.config.family, course.called, next)
            && (first..=last).contains(&moment)
        {
            next = interrupt.next(last);
        }
        interrupt.active = next.is_some();
        course.next = next;
        let due = next.map_or(NEVER, |moment| self.wall.when(moment));
        self.interrupts.set_due(slot_of(10 + i as u16).unwrap_or_default(), due);
    }

    /// Looks for the next due time of interrupts by time whose due time has passed.
    pub(crate) fn elapsed(&mut self, slots: u32) {
        for i in 0..8 {
            if slots & 1 << i != 0 {
                let course = &mut self.services.courses[i];
                course.called = match (course.next, course.called) {
                    (Some(due), Some((first, _))) => Some((first, due)),
                    // What a clock that was set forward has skipped was not called.
                    (Some(due), None) if course.skipped.is_none() => Some((due, due)),
                    _ => None,
                };
                self.next_time_of_day(i);
            }
        }
        for (i, delay) in self.services.delays.iter_mut().enumerate() {
            if slots & 1 << (8 + i) != 0 {
                delay.due = None;
            }
        }
    }

    fn moment_now(&self) -> Moment {
        self.wall.moment(self.hot.now)
    }
}

impl Services for Machine {
    fn error_filter(&mut self) -> &mut ErrorFilter {
        &mut self.services.filter
    }
    fn interrupt_locks(&mut self) -> &mut InterruptLocks {
        self.services.touched = true;
        &mut self.services.locks
    }
    fn replace_value(&mut self, value: u32) -> bool {
        let synchronous = matches!(self.ob.number, 121 | 122);
        if synchronous {
            self.substitute = Some(value);
        }
        synchronous
    }
}

/// There is one process image; it has no partitions.
impl Images for Machine {
    fn update_inputs(&mut self, partition: u8) -> Result<(), ImageError> {
        if partition != 0 {
            return Err(ImageError::NotConfigured);
        }
        let mut result = Ok(());
        for index in 0..self.modules.list.len() {
            if self.modules.read_image(index, &mut self.memory).is_err() {
                result = result.and(Err(ImageError::Access(self.modules.list[index].slot.input_address as u16)));
            }
        }
        self.put_forced();
        result
    }
    fn update_outputs(&mut self, partition: u8) -> Result<(), ImageError> {
        if partition != 0 {
            return Err(ImageError::NotConfigured);
        }
        let mut result = Ok(());
        self.put_forced();
        for index in 0..self.modules.list.len() {
            if self.modules.write_image(index, &self.memory).is_err() {
                result = result.and(Err(ImageError::Access(self.modules.list[index].slot.output_address as u16)));
            }
        }
        result
    }
}

impl Rack for Machine {
    fn area(&mut self) -> u8 {
        u8::from(self.config.family == Family::S7_300)
    }

    fn module_with(&mut self, address: u16, output: bool) -> Option<Placed> {
        let address = u32::from(address);
        let has = |plugged: &Plugged| {
            let (first, bytes) = plugged.range(output);
            let itself = plugged.slot.bus.is_some() && bytes == 0 && first == address;
            (first..first + bytes).contains(&address) || itself
        };
        self.modules.placed(self.modules.list.iter().position(has)?)
    }

    fn module_in(&mut self, rack: u16, slot: u16) -> Option<Placed> {
        let index = slot.checked_sub(SLOT)?;
        let placed = self.modules.placed(usize::from(index))?;
        (rack == 0 && placed.master == 0).then_some(placed)
    }

    fn module_on(&mut self, master: u16, station: u16, slot: u16) -> Result<Placed, NoPlace> {
        let mut missing = NoPlace::Master;
        for (index, plugged) in self.modules.list.iter().enumerate() {
            let Some(place) = plugged.slot.bus.filter(|place| u16::from(place.master) == master) else { continue };
            if u16::from(place.station) != station {
                missing = if missing == NoPlace::Master { NoPlace::Station } else { missing };
                continue;
            }
            missing = NoPlace::Slot;
            if u16::from(place.slot) == slot {
                return self.modules.placed(index).ok_or(NoPlace::Slot);
            }
        }
        Err(missing)
    }
}

impl AlarmSource for Machine {
    /// Hardware and diagnostic interrupts with their four bytes; a lost or returned station without any.
    fn alarm(&mut self) -> Option<AlarmInfo> {
        let start = self.ob.start;
        let address = u32::from(u16::from_be_bytes([start[6], start[7]]));
        let bytes: &[u8] = match self.ob.number {
            40..=47 | 82 => &start[8..12],
            86 => &[],
            _ => return None,
        };
        let output = start[5] == 0x55;
        let place = self.modules.list.iter().position(|plugged| plugged.has(address, output)).unwrap_or(0);
        let mut data = [0; 64];
        // Header: length, type (reserved in the central rack), slot, specifier (reserved).
        data[..4].copy_from_slice(&[4 + bytes.len() as u8, 0, (place as u16 + SLOT) as u8, 0]);
        data[4..4 + bytes.len()].copy_from_slice(bytes);
        let len = if bytes.is_empty() { 0 } else { 4 + bytes.len() as u8 };
        Some(AlarmInfo { address: address | u32::from(output) << 15, start, data, len })
    }
}

impl WallClock for Machine {
    fn moment(&mut self) -> Moment {
        self.moment_now()
    }
    /// Time-of-day interrupts that a clock set forward has skipped run once, after OB 80. ["Conditions That Affect
    /// Time-of-Day Interrupt OBs" of the system software reference]
    fn set_moment(&mut self, moment: Moment) {
        let (before, now) = (self.moment_now(), self.hot.now);
        self.wall.set(moment, now);
        self.services.touched = true;
        if moment <= before || !self.interrupts.is_active() {
            return;
        }
        for (i, course) in self.services.courses.iter_mut().enumerate() {
            course.called = None;
            // One whose time has come already is on its way.
            let Some(next) = course.next.filter(|next| *next <= moment) else { continue };
            if self.interrupts.is_due(i, now) {
                continue;
            }
            self.interrupts.set_due(i, now);
            // One that is due at the very moment is not skipped.
            if next < moment {
                course.skipped = Some((now, next));
                self.services.skipped |= 1 << i;
            }
        }
    }
}

impl Meters for Machine {
    fn meter(&mut self, number: u8) -> Option<&mut RunTimeMeter> {
        self.services.meters.get_mut(usize::from(number))
    }
}

impl Schedule for Machine {
    fn time_of_day(&mut self, ob: u16) -> Option<&mut TimeOfDayInterrupt> {
        self.services.touched = true;
        self.services.time_of_day.get_mut(usize::from(ob.checked_sub(10)?))
    }
    fn delay(&mut self, ob: u16) -> Option<&mut DelayInterrupt> {
        self.services.touched = true;
        self.services.delays.get_mut(usize::from(ob.checked_sub(20)?))
    }
}

impl DataBlocks for Machine {
    fn create(&mut self, request: &DbRequest) -> Result<u16, CreateError> {
        if request.bytes == 0 || request.bytes > LONGEST_DB {
            return Err(CreateError::Length);
        }
        if request.low == 0 || request.low > request.high {
            return Err(CreateError::Numbers);
        }
        // There is no load memory beside the work memory that could hold what is made at run time.
        if request.unlinked || self.memory.pool.len == 0 {
            return Err(CreateError::NoMemory);
        }
        // What nothing writes to has nothing to lose: its bytes are its load values.
        let read_only = request.read_only;
        let attributes = Attributes { read_only, non_retain: request.non_retain && !read_only };
        let made = self.memory.make_db(request.low, request.high, u32::from(request.bytes), attributes);
        made.map_err(|why| match why {
            NoDb::Number => CreateError::NoneFree,
            NoDb::Room => CreateError::NoMemory,
        })
    }
    fn delete(&mut self, number: u16) -> Result<(), DeleteError> {
        self.info(number)?;
        // Statements that name a data block of the program have been resolved to its bytes.
        if self.memory.delete_db(number) { Ok(()) } else { Err(DeleteError::Fixed) }
    }
    fn info(&mut self, number: u16) -> Result<DbInfo, DeleteError> {
        if number == 0 {
            return Err(DeleteError::Number);
        }
        let db = self.memory.db(number).ok_or(DeleteError::Missing)?;
        Ok(DbInfo { bytes: db.len as u16, read_only: db.writable == 0, unlinked: false })
    }
    fn load_read(&mut self, number: u16, at: u32, into: &mut [u8]) -> Result<(), LoadError> {
        let values = self.memory.load_values_mut(number).ok_or(LoadError::Missing)?;
        let from = values.get(at as usize..at as usize + into.len()).ok_or(LoadError::Outside)?;
        into.copy_from_slice(from);
        Ok(())
    }
    fn load_write(&mut self, number: u16, at: u32, from: &[u8]) -> Result<(), LoadError> {
        let values = self.memory.load_values_mut(number).ok_or(LoadError::Missing)?;
        values.get_mut(at as usize..at as usize + from.len()).ok_or(LoadError::Outside)?.copy_from_slice(from);
        Ok(())
    }
}

impl StartInfo for Machine {
    fn current(&mut self) -> [u8; 12] {
        first_twelve(&self.ob.start)
    }
    fn start_up(&mut self) -> [u8; 12] {
        first_twelve(&self.services.start_up)
    }
}

fn first_twelve(start: &[u8; 20]) -> [u8; 12] {
    std::array::from_fn(|i| start[i])
}
