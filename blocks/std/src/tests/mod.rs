//! A CPU for tests: parameters by name, memory, modules and every service, for the tests of the blocks.

mod alarm_model;

use std::collections::BTreeMap;

use ob1_model::calendar::DAY_MS;
use ob1_model::moment::{Date, Moment};
use ob1_model::{AlarmTime, Area, Layout, Section};
use ob1_time::{Instant, Span};

use crate::services::{
    AlarmInfo, AlarmSource, AlarmTable, CreateError, DataBlocks, DbInfo, DbRequest, DelayInterrupt, DeleteError,
    ErrorFilter, ImageError, Images, InterruptLocks, LoadError, MessageError, Messages, Meters, NoPlace, Placed, Rack,
    RunTimeMeter, RunTimes, Schedule, Services, StartInfo, StatusError, SystemStatus, TimeOfDayInterrupt, WallClock,
};
use crate::{Abort, Context, Done, Instance, ModuleSize, NativeArea, Refused, StandardBlock, standard_block};

/// A call of one block.
pub(crate) struct Fake {
    block: StandardBlock,
    /// Bytes of the parameters of a block without instance; a BOOL is one byte.
    params: Vec<Option<Vec<u8>>>,
    instance: Vec<u8>,
    memory: BTreeMap<(Area, u16), Vec<u8>>,
    pub(crate) br: bool,
    pub(crate) now: Instant,
    pub(crate) ended: Done,
    /// Peripheral bytes from 0 on: inputs, outputs.
    pub(crate) io: [Vec<u8>; 2],
    /// Sizes of the modules, by address.
    pub(crate) modules: BTreeMap<u32, ModuleSize>,
    pub(crate) records: BTreeMap<(u32, u8), Vec<u8>>,
    pub(crate) retriggered: u32,
    pub(crate) station: Station,
    /// Data block and first byte of the instance.
    pub(crate) place: (u16, u32),
}

/// State of the services that the blocks ask.
#[derive(Default)]
pub(crate) struct Station {
    pub(crate) moment: Moment,
    pub(crate) meters: [RunTimeMeter; 2],
    pub(crate) time_of_day: TimeOfDayInterrupt,
    pub(crate) delay: DelayInterrupt,
    pub(crate) filter: ErrorFilter,
    pub(crate) locks: InterruptLocks,
    pub(crate) replaced: Option<u32>,
    pub(crate) in_error_ob: bool,
    pub(crate) created: Vec<DbRequest>,
    pub(crate) create: Option<CreateError>,
    pub(crate) blocks: BTreeMap<u16, DbInfo>,
    pub(crate) load: BTreeMap<u16, Vec<u8>>,
    pub(crate) updates: Vec<(char, u8)>,
    pub(crate) image_error: Option<ImageError>,
    pub(crate) messages: Vec<(u16, Vec<u8>, Vec<u8>, bool)>,
    pub(crate) message_error: Option<MessageError>,
    pub(crate) alarms: AlarmTable,
    pub(crate) alarm_time: AlarmTime,
    pub(crate) placed: Vec<Placed>,
    pub(crate) alarm: Option<AlarmInfo>,
    pub(crate) status: Vec<Vec<u8>>,
    pub(crate) waited: Vec<Span>,
}

/// DATE_AND_TIME of a text: `dt("2024-02-29-23:59:59.999")`.
pub(crate) fn dt(text: &str) -> [u8; 8] {
    moment(text).to_bytes()
}

/// The moment of such a text.
pub(crate) fn moment(text: &str) -> Moment {
    let n: Vec<u32> = text.split(['-', ':', '.']).map(|part| part.parse().expect("digits")).collect();
    let days = Date { year: n[0], month: n[1], day: n[2] }.days().expect("a date");
    let ms = ((n[3] * 60 + n[4]) * 60 + n[5]) * 1000 + n[6];
    Moment::from_ms(u64::from(days) * DAY_MS + u64::from(ms)).expect("a moment")
}

/// A STRING with its length bytes and room for `max` characters.
pub(crate) fn string(max: u8, text: &str) -> Vec<u8> {
    let mut bytes = vec![max, text.len() as u8];
    bytes.extend(text.as_bytes());
    bytes.resize(usize::from(max) + 2, 0);
    bytes
}

/// An ANY: type code, count, byte of the bit memory.
pub(crate) fn any(ty: u8, count: u16, byte: u32) -> [u8; 10] {
    let ([high, low], at) = (count.to_be_bytes(), (byte * 8).to_be_bytes());
    [0x10, ty, high, low, 0, 0, 0x83, at[1], at[2], at[3]]
}

/// A POINTER to a byte of the bit memory.
pub(crate) fn pointer(byte: u32) -> [u8; 6] {
    let at = (byte * 8).to_be_bytes();
    [0, 0, 0x83, at[1], at[2], at[3]]
}

impl Fake {
    /// A call of the block with this key, without parameters.
    pub(crate) fn new(key: &str) -> Self {
        let block = standard_block(key).unwrap_or_else(|| panic!("no block {key}"));
        let mut instance = vec![0; block.interface.instance_bytes as usize];
        for param in &block.interface.params {
            let bits = Layout::bits(&param.ty);
            match &param.initial {
                Some(initial) if bits == 1 => instance[param.at.byte() as usize] |= initial[0] << param.at.bit(),
                Some(initial) => instance[param.at.byte() as usize..][..initial.len()].copy_from_slice(initial),
                None => {}
            }
        }
        let params = vec![None; block.interface.formals().count()];
        let memory = BTreeMap::from([
            ((Area::Memory, 0), vec![0; 256]),
            ((Area::Output, 0), vec![0; 16]),
            ((Area::Db, 10), vec![0; 64]),
        ]);
        Self {
            block,
            params,
            instance,
            memory,
            br: true,
            now: Instant::START,
            ended: Ok(()),
            io: [vec![0; 512], vec![0; 512]],
            modules: BTreeMap::new(),
            records: BTreeMap::new(),
            retriggered: 0,
            station: Station::default(),
            place: (20, 0),
        }
    }

    /// Supplies a parameter, or sets a static.
    pub(crate) fn with(mut self, name: &str, bytes: impl AsRef<[u8]>) -> Self {
        self.set(name, bytes.as_ref());
        self
    }

    pub(crate) fn set(&mut self, name: &str, bytes: &[u8]) {
        let at = self.index(name);
        let param = &self.block.interface.params[at];
        let bits = Layout::bits(&param.ty);
        if self.instance.is_empty() {
            self.params[at] = Some(bytes.to_vec());
        } else if bits == 1 {
            let byte = &mut self.instance[param.at.byte() as usize];
            *byte = *byte & !(1 << param.at.bit()) | (bytes[0] & 1) << param.at.bit();
        } else {
            assert_eq!(bits as usize / 8, bytes.len(), "{name}");
            self.instance[param.at.byte() as usize..][..bytes.len()].copy_from_slice(bytes);
        }
    }

    /// Calls the block with BR = 1, and keeps how it ended.
    pub(crate) fn run(&mut self) {
        self.br = true;
        let block = self.block.clone();
        self.ended = block.run(self);
    }

    /// Calls it so often; of each call a `+` where the first output is set, a `-` where the second is, `.` for
    /// neither, `?` for both.
    pub(crate) fn signs(&mut self, calls: usize, plus: &str, minus: &str) -> String {
        let sign = |_| {
            self.run();
            match (self.value(plus), self.value(minus)) {
                (1, 0) => '+',
                (0, 1) => '-',
                (0, 0) => '.',
                _ => '?',
            }
        };
        (0..calls).map(sign).collect()
    }

    /// Whether it has such a parameter or static.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.block.interface.params.iter().any(|p| p.name == name)
    }

    fn index(&self, name: &str) -> usize {
        let found = self.block.interface.params.iter().position(|p| p.name == name);
        found.unwrap_or_else(|| panic!("{} has no {name}", self.block.name))
    }

    /// Bytes of a parameter or static.
    pub(crate) fn bytes(&self, name: &str) -> &[u8] {
        let at = self.index(name);
        if self.instance.is_empty() {
            return self.params[at].as_deref().unwrap_or_else(|| panic!("{name} not given"));
        }
        let param = &self.block.interface.params[at];
        let len = Layout::bits(&param.ty).div_ceil(8) as usize;
        &self.instance[param.at.byte() as usize..][..len]
    }

    /// An elementary parameter or static.
    pub(crate) fn value(&self, name: &str) -> u32 {
        let value = self.bytes(name).iter().fold(0, |value, byte| value << 8 | u32::from(*byte));
        let param = &self.block.interface.params[self.index(name)];
        if !self.instance.is_empty() && Layout::bits(&param.ty) == 1 { value >> param.at.bit() & 1 } else { value }
    }

    pub(crate) fn dint(&self, name: &str) -> i32 {
        self.value(name) as i32
    }

    pub(crate) fn real(&self, name: &str) -> f32 {
        f32::from_bits(self.value(name))
    }

    pub(crate) fn text(&self, name: &str) -> String {
        let bytes = self.bytes(name);
        String::from_utf8_lossy(&bytes[2..2 + usize::from(bytes[1])]).into_owned()
    }

    /// Writes bit memory from byte `at` on.
    pub(crate) fn memory(&mut self, at: usize, bytes: &[u8]) {
        self.area(Area::Memory, 0)[at..at + bytes.len()].copy_from_slice(bytes);
    }

    pub(crate) fn memory_at(&self, at: usize, len: usize) -> &[u8] {
        &self.memory[&(Area::Memory, 0)][at..at + len]
    }

    pub(crate) fn area(&mut self, area: Area, db: u16) -> &mut Vec<u8> {
        self.memory.get_mut(&(area, db)).expect("this area")
    }

    /// The interface of the block, for tests of its layout.
    pub(crate) fn at(&self, name: &str) -> String {
        self.block.interface.params[self.index(name)].at.to_string()
    }

    /// Place and size of a formal in the instance.
    fn formal(&self, index: u32) -> Option<(usize, u8, usize)> {
        let param = self.block.interface.formals().nth(index as usize)?;
        Some((param.at.byte() as usize, param.at.bit(), Layout::bits(&param.ty) as usize))
    }

    fn bytes_of(&mut self, area: NativeArea) -> Result<&mut [u8], Refused> {
        let (area, db) = match area {
            NativeArea::Instance => return Ok(&mut self.instance),
            NativeArea::Db(db) => (Area::Db, db),
            NativeArea::Input => (Area::Input, 0),
            NativeArea::Output => (Area::Output, 0),
            NativeArea::Memory => (Area::Memory, 0),
            NativeArea::CallerLocal => (Area::Local, 0),
        };
        self.memory.get_mut(&(area, db)).map(Vec::as_mut_slice).ok_or(Refused::NoDb)
    }
}

fn place(bytes: &mut [u8], at: u32, len: usize) -> Result<&mut [u8], Refused> {
    bytes.get_mut(at as usize..at as usize + len).ok_or(Refused::Outside)
}

impl Context for Fake {
    fn given(&mut self, index: u32) -> bool {
        !self.instance.is_empty() || self.params.get(index as usize).is_some_and(Option::is_some)
    }

    fn get(&mut self, index: u32) -> Result<u32, Refused> {
        if !self.instance.is_empty() {
            let (at, bit, bits) = self.formal(index).ok_or(Refused::NoParam)?;
            assert!(bits <= 32, "parameter {index} is no value");
            let bytes = &self.instance[at..at + bits.div_ceil(8)];
            let value = bytes.iter().fold(0, |value, byte| value << 8 | u32::from(*byte));
            return Ok(if bits == 1 { value >> bit & 1 } else { value });
        }
        let bytes = self.params.get(index as usize).and_then(Option::as_ref).ok_or(Refused::NoParam)?;
        assert!(bytes.len() <= 4, "parameter {index} is no value");
        Ok(bytes.iter().fold(0, |value, byte| value << 8 | u32::from(*byte)))
    }

    fn set(&mut self, index: u32, value: u32) -> Result<(), Refused> {
        let param = self.block.interface.formals().nth(index as usize).ok_or(Refused::NoParam)?;
        assert!(!self.instance.is_empty() || param.section != Section::Input, "{} is an input", param.name);
        if !self.instance.is_empty() {
            let name = param.name.clone();
            let bits = Layout::bits(&param.ty);
            let bytes = value.to_be_bytes();
            Fake::set(self, &name, &bytes[4 - bits.div_ceil(8) as usize..]);
            return Ok(());
        }
        let bytes = self.params.get_mut(index as usize).and_then(Option::as_mut).ok_or(Refused::NoParam)?;
        let len = bytes.len();
        bytes.copy_from_slice(&value.to_be_bytes()[4 - len..]);
        Ok(())
    }

    fn read(&mut self, index: u32, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        let bytes = if self.instance.is_empty() {
            self.params.get_mut(index as usize).and_then(Option::as_mut).ok_or(Refused::NoParam)?.as_mut_slice()
        } else {
            let (first, _, bits) = self.formal(index).ok_or(Refused::NoParam)?;
            &mut self.instance[first..first + bits / 8]
        };
        into.copy_from_slice(place(bytes, at, into.len())?);
        Ok(())
    }

    fn write(&mut self, index: u32, at: u32, from: &[u8]) -> Result<(), Refused> {
        let bytes = self.params.get_mut(index as usize).and_then(Option::as_mut).ok_or(Refused::NoParam)?;
        place(bytes, at, from.len())?.copy_from_slice(from);
        Ok(())
    }

    fn area_read(&mut self, area: NativeArea, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        into.copy_from_slice(place(self.bytes_of(area)?, at, into.len())?);
        Ok(())
    }

    fn area_write(&mut self, area: NativeArea, at: u32, from: &[u8]) -> Result<(), Refused> {
        place(self.bytes_of(area)?, at, from.len())?.copy_from_slice(from);
        Ok(())
    }

    fn instance(&mut self) -> Option<Instance> {
        let (db, offset) = self.place;
        Some(Instance { db, offset, len: self.instance.len() as u32 })
    }

    fn registers(&mut self) -> (u16, u16) {
        (0, 0)
    }

    fn set_br(&mut self, br: bool) {
        self.br = br;
    }

    fn now(&mut self) -> Instant {
        self.now
    }

    fn module(&mut self, address: u32) -> Result<ModuleSize, Refused> {
        self.modules.get(&address).copied().ok_or(Refused::NoModule)
    }

    fn io_read(&mut self, address: u32, into: &mut [u8]) -> Result<(), Refused> {
        into.copy_from_slice(place(&mut self.io[0], address, into.len()).map_err(|_| Refused::NoModule)?);
        Ok(())
    }

    fn io_write(&mut self, address: u32, from: &[u8]) -> Result<(), Refused> {
        place(&mut self.io[1], address, from.len()).map_err(|_| Refused::NoModule)?.copy_from_slice(from);
        Ok(())
    }

    fn record_read(&mut self, address: u32, record: u8, into: &mut [u8]) -> Result<usize, Refused> {
        if !self.records.keys().any(|(at, _)| *at == address) {
            return Err(Refused::NoModule);
        }
        let bytes = self.records.get(&(address, record)).ok_or(Refused::NoRecord)?;
        into.get_mut(..bytes.len()).ok_or(Refused::Outside)?.copy_from_slice(bytes);
        Ok(bytes.len())
    }

    fn record_write(&mut self, address: u32, record: u8, from: &[u8]) -> Result<(), Refused> {
        if !self.records.keys().any(|(at, _)| *at == address) {
            return Err(Refused::NoModule);
        }
        *self.records.get_mut(&(address, record)).ok_or(Refused::NoRecord)? = from.to_vec();
        Ok(())
    }

    fn retrigger_watchdog(&mut self) {
        self.retriggered += 1;
    }

    fn stop_by_program(&mut self) -> Abort {
        Abort
    }

    fn services(&mut self) -> &mut dyn Services {
        &mut self.station
    }

    fn wait(&mut self, time: Span) -> Result<(), Abort> {
        self.station.waited.push(time);
        Ok(())
    }
}

impl Services for Station {
    fn error_filter(&mut self) -> &mut ErrorFilter {
        &mut self.filter
    }

    fn interrupt_locks(&mut self) -> &mut InterruptLocks {
        &mut self.locks
    }

    fn replace_value(&mut self, value: u32) -> bool {
        if self.in_error_ob {
            self.replaced = Some(value);
        }
        self.in_error_ob
    }
}

impl WallClock for Station {
    fn moment(&mut self) -> Moment {
        self.moment
    }
    fn set_moment(&mut self, moment: Moment) {
        self.moment = moment;
    }
}

impl Meters for Station {
    fn meter(&mut self, number: u8) -> Option<&mut RunTimeMeter> {
        self.meters.get_mut(usize::from(number))
    }
}

/// OB 10 and OB 20 exist.
impl Schedule for Station {
    fn time_of_day(&mut self, ob: u16) -> Option<&mut TimeOfDayInterrupt> {
        (ob == 10).then_some(&mut self.time_of_day)
    }
    fn delay(&mut self, ob: u16) -> Option<&mut DelayInterrupt> {
        (ob == 20).then_some(&mut self.delay)
    }
}

/// Data blocks 1 to 100.
impl DataBlocks for Station {
    fn create(&mut self, request: &DbRequest) -> Result<u16, CreateError> {
        if let Some(error) = self.create {
            return Err(error);
        }
        self.created.push(*request);
        let number =
            (request.low..=request.high).find(|n| !self.blocks.contains_key(n)).ok_or(CreateError::NoneFree)?;
        self.blocks
            .insert(number, DbInfo { bytes: request.bytes, read_only: request.read_only, unlinked: request.unlinked });
        Ok(number)
    }
    fn delete(&mut self, number: u16) -> Result<(), DeleteError> {
        self.info(number)?;
        self.blocks.remove(&number);
        Ok(())
    }
    fn info(&mut self, number: u16) -> Result<DbInfo, DeleteError> {
        if !(1..=100).contains(&number) {
            return Err(DeleteError::Number);
        }
        self.blocks.get(&number).copied().ok_or(DeleteError::Missing)
    }
    fn load_read(&mut self, number: u16, at: u32, into: &mut [u8]) -> Result<(), LoadError> {
        let bytes = self.load.get_mut(&number).ok_or(LoadError::Missing)?;
        into.copy_from_slice(place(bytes, at, into.len()).map_err(|_| LoadError::Outside)?);
        Ok(())
    }
    fn load_write(&mut self, number: u16, at: u32, from: &[u8]) -> Result<(), LoadError> {
        let bytes = self.load.get_mut(&number).ok_or(LoadError::Missing)?;
        place(bytes, at, from.len()).map_err(|_| LoadError::Outside)?.copy_from_slice(from);
        Ok(())
    }
}

impl Images for Station {
    fn update_inputs(&mut self, partition: u8) -> Result<(), ImageError> {
        self.updates.push(('E', partition));
        self.image_error.map_or(Ok(()), Err)
    }
    fn update_outputs(&mut self, partition: u8) -> Result<(), ImageError> {
        self.updates.push(('A', partition));
        self.image_error.map_or(Ok(()), Err)
    }
}

/// List 0011h with the records of `status`.
impl SystemStatus for Station {
    fn list(&mut self, id: u16, index: u16, each: &mut dyn FnMut(&[u8])) -> Result<u16, StatusError> {
        match (id, index) {
            (0x0011, 0) => {
                self.status.iter().for_each(|record| each(record));
                Ok(self.status.first().map_or(0, |record| record.len() as u16))
            }
            (0x0011, _) => Err(StatusError::Index),
            (0x0012, _) => Err(StatusError::NotNow),
            _ => Err(StatusError::Id),
        }
    }
    fn run_times(&mut self, ob: u16) -> Option<RunTimes> {
        let ob = if ob == 0 { 1 } else { ob };
        (ob == 1).then_some(RunTimes {
            ob,
            priority: 1,
            last_run: 2,
            last_whole: 3,
            request: 4,
            current_run: 5,
            current_whole: 6,
            next: 7,
        })
    }
}

impl Messages for Station {
    fn user_message(&mut self, event: u16, info1: &[u8], info2: &[u8], send: bool) -> Result<(), MessageError> {
        self.messages.push((event, info1.to_vec(), info2.to_vec(), send));
        self.message_error.map_or(Ok(()), Err)
    }
    fn alarms(&mut self) -> &mut AlarmTable {
        &mut self.alarms
    }
    fn alarm_time(&mut self) -> AlarmTime {
        self.alarm_time
    }
    /// Nothing is fetched: the test does it.
    fn send_alarms(&mut self) {}
}

impl Rack for Station {
    fn area(&mut self) -> u8 {
        1
    }
    fn module_with(&mut self, address: u16, output: bool) -> Option<Placed> {
        let has = |placed: &&Placed| {
            let (first, bytes) = if output { placed.outputs } else { placed.inputs };
            (first..first + bytes).contains(&address) || placed.master != 0 && bytes == 0 && first == address
        };
        self.placed.iter().find(has).copied()
    }
    fn module_in(&mut self, rack: u16, slot: u16) -> Option<Placed> {
        self.placed.iter().find(|placed| (placed.master, placed.rack, placed.slot) == (0, rack, slot)).copied()
    }
    fn module_on(&mut self, master: u16, station: u16, slot: u16) -> Result<Placed, NoPlace> {
        let on = |placed: &&Placed| u16::from(placed.master) == master;
        let mut there = self.placed.iter().filter(on).peekable();
        there.peek().ok_or(NoPlace::Master)?;
        let mut here = there.filter(|placed| placed.rack == station).peekable();
        here.peek().ok_or(NoPlace::Station)?;
        here.find(|placed| placed.slot == slot).copied().ok_or(NoPlace::Slot)
    }
}

impl StartInfo for Station {
    fn current(&mut self) -> [u8; 12] {
        [1; 12]
    }
    fn start_up(&mut self) -> [u8; 12] {
        [2; 12]
    }
}

impl AlarmSource for Station {
    fn alarm(&mut self) -> Option<AlarmInfo> {
        self.alarm
    }
}
