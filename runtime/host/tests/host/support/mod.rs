//! A CPU of tables for the tests of plugins, and where the plugins are.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use ob1_cpu::{
    Abort, Instance, ModuleStatus, NativeArea, NativeArg, NativeBlock, NativeContext, Natives, ObInfo, Refused,
    TimerState,
};
use ob1_model::{BlockId, BlockKind, Event, FaultKind, TimerKind};
use ob1_std::{Context, ModuleSize};
use ob1_time::{Instant, Span};

/// A plugin of this workspace.
pub(crate) fn plugin(name: &str) -> PathBuf {
    let folder = std::env::var_os("OB1_PLUGIN_DIR");
    let folder = folder.expect("OB1_PLUGIN_DIR is not set; run: cargo xtask test");
    let path = Path::new(&folder).join(format!("lib{name}.so"));
    #[expect(clippy::disallowed_methods, reason = "a test may look whether a file is there")]
    let there = path.is_file();
    assert!(there, "{} does not exist; run: cargo xtask test", path.display());
    path
}

/// A module of 16 bytes each way.
#[derive(Default)]
pub(crate) struct Registers {
    pub(crate) address: u32,
    pub(crate) status: ModuleStatus,
    pub(crate) input: [u8; 16],
    pub(crate) output: [u8; 16],
}

/// A CPU of tables.
#[derive(Default)]
pub(crate) struct Cpu {
    /// Actual parameters by index; `None`: left open.
    pub(crate) params: Vec<Option<u32>>,
    /// ANY pointers among them, by index.
    pub(crate) pointers: BTreeMap<u32, [u8; 10]>,
    pub(crate) dbs: BTreeMap<u16, Vec<u8>>,
    pub(crate) memory: Vec<u8>,
    pub(crate) inputs: Vec<u8>,
    pub(crate) outputs: Vec<u8>,
    pub(crate) instance: Vec<u8>,
    /// Where it lies, apart from the first one.
    pub(crate) instance_at: u32,
    pub(crate) timers: BTreeMap<u16, (Instant, bool)>,
    pub(crate) module: Registers,
    /// Records the module answers, and those the block has written, by number.
    pub(crate) records: BTreeMap<u8, Vec<u8>>,
    pub(crate) written: BTreeMap<u8, Vec<u8>>,
    pub(crate) now: Instant,
    /// Requests of the block.
    pub(crate) stops: Vec<(Event, String)>,
    pub(crate) entries: Vec<(u16, String)>,
    pub(crate) faults: Vec<(FaultKind, u32)>,
    pub(crate) logs: Vec<(u8, String)>,
    pub(crate) calls: Vec<(BlockId, Vec<NativeArg>)>,
    /// Functions called since the last look.
    pub(crate) asked: u32,
    /// Answers of `call_block`; then `NoBlock`.
    pub(crate) callees: VecDeque<Result<(), Refused>>,
    pub(crate) br: Option<bool>,
    /// The CPU itself breaks down in `param_get`.
    pub(crate) breaks: bool,
}

impl Cpu {
    /// Memory, inputs and outputs of 128 bytes, timers T 0 to T 15.
    pub(crate) fn new() -> Self {
        Self {
            memory: vec![0; 128],
            inputs: vec![0; 128],
            outputs: vec![0; 128],
            timers: (0..16).map(|n| (n, (Instant::START, false))).collect(),
            ..Self::default()
        }
    }

    /// Calls a block with these actual parameters; they are kept in `params` afterwards.
    pub(crate) fn call(&mut self, block: &dyn NativeBlock, params: &[u32]) -> Result<(), Abort> {
        self.params = params.iter().map(|value| Some(*value)).collect();
        self.asked = 0;
        block.call(self)
    }

    fn area(&mut self, area: NativeArea) -> Result<&mut Vec<u8>, Refused> {
        Ok(match area {
            NativeArea::Input => &mut self.inputs,
            NativeArea::Output => &mut self.outputs,
            NativeArea::Memory => &mut self.memory,
            NativeArea::Db(0) => return Err(Refused::DbNumber),
            NativeArea::Db(number) => self.dbs.get_mut(&number).ok_or(Refused::NoDb)?,
            NativeArea::Instance if self.instance.is_empty() => return Err(Refused::NoParam),
            NativeArea::Instance => &mut self.instance,
            NativeArea::CallerLocal => return Err(Refused::Outside),
        })
    }

    fn cells(&mut self, area: NativeArea, at: u32, len: usize) -> Result<&mut [u8], Refused> {
        let at = at as usize;
        self.area(area)?.get_mut(at..at.saturating_add(len)).ok_or(Refused::Outside)
    }

    /// Without any records the module refuses: 1 as busy, 2 as absent, all others as `without` says.
    fn has_records(&self, address: u32, record: u8, without: Refused) -> Result<(), Refused> {
        if self.records.is_empty() {
            return Err(match record {
                1 => Refused::Busy,
                2 => Refused::Absent,
                _ => without,
            });
        }
        match address == self.module.address {
            true if !self.module.status.present => Err(Refused::Absent),
            true => Ok(()),
            false => Err(Refused::NoModule),
        }
    }

    fn register_range(&self, address: u32, len: usize) -> Result<std::ops::Range<usize>, Refused> {
        let at = address.checked_sub(self.module.address).ok_or(Refused::NoModule)? as usize;
        if at + len <= 16 { Ok(at..at + len) } else { Err(Refused::NoModule) }
    }
}

impl Context for Cpu {
    fn given(&mut self, index: u32) -> bool {
        self.params.get(index as usize).is_some_and(Option::is_some)
    }
    fn get(&mut self, index: u32) -> Result<u32, Refused> {
        assert!(!self.breaks, "the CPU is broken");
        self.asked += 1;
        self.params.get(index as usize).copied().flatten().ok_or(Refused::NoParam)
    }
    fn set(&mut self, index: u32, value: u32) -> Result<(), Refused> {
        self.asked += 1;
        *self.params.get_mut(index as usize).ok_or(Refused::NoParam)? = Some(value);
        Ok(())
    }
    fn read(&mut self, index: u32, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        let pointer = self.pointers.get(&index).ok_or(Refused::NoParam)?;
        let bytes = pointer.get(at as usize..at as usize + into.len()).ok_or(Refused::Outside)?;
        into.copy_from_slice(bytes);
        Ok(())
    }
    fn write(&mut self, _index: u32, _at: u32, _from: &[u8]) -> Result<(), Refused> {
        Err(Refused::NoParam)
    }
    fn area_read(&mut self, area: NativeArea, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        self.asked += 1;
        into.copy_from_slice(self.cells(area, at, into.len())?);
        Ok(())
    }
    fn area_write(&mut self, area: NativeArea, at: u32, from: &[u8]) -> Result<(), Refused> {
        self.asked += 1;
        self.cells(area, at, from.len())?.copy_from_slice(from);
        Ok(())
    }
    fn instance(&mut self) -> Option<Instance> {
        let len = self.instance.len() as u32;
        (len > 0).then_some(Instance { db: 7, offset: 4 + self.instance_at, len })
    }
    fn registers(&mut self) -> (u16, u16) {
        (10, 11)
    }
    fn set_br(&mut self, br: bool) {
        self.br = Some(br);
    }
    fn now(&mut self) -> Instant {
        self.now
    }
    fn module(&mut self, address: u32) -> Result<ModuleSize, Refused> {
        let here = address == self.module.address;
        if here { Ok(ModuleSize { inputs: 16, outputs: 16 }) } else { Err(Refused::NoModule) }
    }
    fn io_read(&mut self, address: u32, into: &mut [u8]) -> Result<(), Refused> {
        self.asked += 1;
        let range = self.register_range(address, into.len())?;
        let present = self.module.status.present;
        into.copy_from_slice(if present { &self.module.input[range] } else { &[0; 16][range] });
        Ok(())
    }
    fn io_write(&mut self, address: u32, from: &[u8]) -> Result<(), Refused> {
        self.asked += 1;
        let range = self.register_range(address, from.len())?;
        self.module.output[range].copy_from_slice(from);
        Ok(())
    }
    fn record_read(&mut self, address: u32, record: u8, into: &mut [u8]) -> Result<usize, Refused> {
        self.has_records(address, record, Refused::NoRecord)?;
        let found = self.records.get(&record).ok_or(Refused::NoRecord)?;
        let len = found.len().min(into.len());
        into[..len].copy_from_slice(&found[..len]);
        Ok(len)
    }
    fn record_write(&mut self, _: u32, _: u8, _: &[u8]) -> Result<(), Refused> {
        panic!("a plugin's block asks for nothing that is not in the interface")
    }
    fn retrigger_watchdog(&mut self) {
        panic!("a plugin's block asks for nothing that is not in the interface")
    }
    fn wait(&mut self, _: Span) -> Result<(), Abort> {
        panic!("a plugin's block asks for nothing that is not in the interface")
    }
    fn stop_by_program(&mut self) -> Abort {
        panic!("a plugin's block asks for nothing that is not in the interface")
    }
    fn services(&mut self) -> &mut dyn ob1_std::services::Services {
        panic!("a plugin's block asks for nothing that is not in the interface")
    }
}

impl NativeContext for Cpu {
    fn bit_get(&mut self, area: NativeArea, bit: u32) -> Result<bool, Refused> {
        Ok(self.cells(area, bit / 8, 1)?[0] >> (bit % 8) & 1 == 1)
    }
    fn bit_set(&mut self, area: NativeArea, bit: u32, value: bool) -> Result<(), Refused> {
        let byte = &mut self.cells(area, bit / 8, 1)?[0];
        *byte = *byte & !(1 << (bit % 8)) | u8::from(value) << (bit % 8);
        Ok(())
    }
    fn area_len(&mut self, area: NativeArea) -> Result<u32, Refused> {
        self.asked += 1;
        self.area(area).map(|bytes| bytes.len() as u32)
    }
    fn timer_run(&mut self, number: u16, kind: TimerKind, rlo: bool, s5time: u16) -> Result<(), Refused> {
        assert_eq!(kind, TimerKind::OnDelay);
        let ms = ob1_model::S5Time(s5time).to_ms().ok_or(Refused::Outside)?;
        let now = self.now;
        let (due, was) = self.timers.get_mut(&number).ok_or(Refused::NoTimer)?;
        if rlo && !*was {
            *due = now + Span::from_millis(ms.into());
        }
        *was = rlo;
        Ok(())
    }
    fn timer_reset(&mut self, number: u16) -> Result<(), Refused> {
        *self.timers.get_mut(&number).ok_or(Refused::NoTimer)? = (Instant::START, false);
        Ok(())
    }
    fn timer_get(&mut self, number: u16) -> Result<TimerState, Refused> {
        let (due, rlo) = *self.timers.get(&number).ok_or(Refused::NoTimer)?;
        Ok(TimerState { output: rlo && self.now >= due, running: rlo && self.now < due, remaining: 0 })
    }
    fn counter_get(&mut self, _number: u16) -> Result<u16, Refused> {
        Err(Refused::NoTimer)
    }
    fn counter_set(&mut self, _number: u16, _value: u16) -> Result<(), Refused> {
        Err(Refused::NoTimer)
    }
    fn call_block(&mut self, id: BlockId, _instance_db: u16, args: &[NativeArg]) -> Result<(), Refused> {
        self.calls.push((id, args.to_vec()));
        self.callees.pop_front().unwrap_or(Err(Refused::NoBlock))
    }
    fn ob_info(&mut self) -> ObInfo {
        ObInfo { number: 1, priority: 1, start: [0x11; 20] }
    }
    fn attend(&mut self) -> Result<(), Abort> {
        Ok(())
    }
    fn raise_fault(&mut self, kind: FaultKind, number: u32) -> Result<(), Abort> {
        self.faults.push((kind, number));
        Ok(())
    }
    fn diagnostic_interrupt(&mut self, _address: u32, _data: &[u8]) -> Result<(), Refused> {
        Ok(())
    }
    fn diag_entry(&mut self, number: u16, text: &str) {
        self.entries.push((number, text.to_owned()));
    }
    fn stop(&mut self, event: Event, text: &str) -> Abort {
        self.stops.push((event, text.to_owned()));
        Abort
    }
    fn log(&mut self, level: u8, text: &str) {
        self.logs.push((level, text.to_owned()));
    }
    fn module_status(&mut self, address: u32) -> Result<ModuleStatus, Refused> {
        self.asked += 1;
        if address == self.module.address { Ok(self.module.status) } else { Err(Refused::NoModule) }
    }
    fn record_of_block_write(&mut self, address: u32, record: u8, from: &[u8]) -> Result<(), Refused> {
        self.has_records(address, record, Refused::Outside)?;
        self.records.get(&record).ok_or(Refused::Outside)?;
        self.written.insert(record, from.to_vec());
        Ok(())
    }
}

/// The block of this id among those of a station.
pub(crate) fn find(blocks: &Natives, kind: BlockKind, number: u16) -> &dyn NativeBlock {
    let id = BlockId::new(kind, number);
    blocks.get(id).unwrap_or_else(|| panic!("no {id}"))
}
