//! A module on the heap whose registers and calls the test can read.
#![allow(clippy::disallowed_types, reason = "the test and the CPU share it, on one thread")]

use std::sync::{Arc, Mutex};

use ob1_cpu::{Module, ModuleEntry, ModuleError, ModuleEvent, ModuleStatus};
use ob1_time::Instant;

/// What the module has seen and holds.
#[derive(Debug, Default)]
pub struct Seen {
    pub inputs: Vec<u8>,
    pub outputs: Vec<u8>,
    pub writes: Vec<(u16, Vec<u8>)>,
    pub states: Vec<bool>,
    pub scans: u32,
    /// Its outputs were disabled and enabled.
    pub disabled: Vec<bool>,
    pub absent: bool,
    pub events: Vec<ModuleEvent>,
    /// Its own diagnostic buffer, newest first; empty: it has none.
    pub buffer: Vec<ModuleEntry>,
}

/// A module and the test's view of it.
#[derive(Clone, Debug)]
pub struct TestModule(pub Arc<Mutex<Seen>>, u16);

impl TestModule {
    pub fn new(bytes: u16) -> Self {
        let registers = vec![0; usize::from(bytes)];
        let seen = Seen { inputs: registers.clone(), outputs: registers, ..Seen::default() };
        Self(Arc::new(Mutex::new(seen)), bytes)
    }

    pub fn look<T>(&self, f: impl FnOnce(&mut Seen) -> T) -> T {
        f(&mut self.0.lock().expect("one thread"))
    }
}

impl Module for TestModule {
    fn input_bytes(&self) -> u16 {
        self.1
    }
    fn output_bytes(&self) -> u16 {
        self.1
    }
    fn begin_scan(&mut self, _now: Instant) {
        self.look(|s| s.scans += 1);
    }
    fn read(&mut self, at: u16, into: &mut [u8]) -> Result<(), ModuleError> {
        self.look(|s| {
            if s.absent {
                return Err(ModuleError::Absent);
            }
            into.copy_from_slice(&s.inputs[usize::from(at)..usize::from(at) + into.len()]);
            Ok(())
        })
    }
    fn write(&mut self, at: u16, from: &[u8]) -> Result<(), ModuleError> {
        self.look(|s| {
            if s.absent {
                return Err(ModuleError::Absent);
            }
            s.outputs[usize::from(at)..usize::from(at) + from.len()].copy_from_slice(from);
            s.writes.push((at, from.to_vec()));
            Ok(())
        })
    }
    fn end_scan(&mut self, _now: Instant) {}
    fn output_disable(&mut self, on: bool) {
        self.look(|s| s.disabled.push(on));
    }
    fn cpu_state(&mut self, run: bool) {
        self.look(|s| s.states.push(run));
    }
    fn poll_event(&mut self) -> Option<ModuleEvent> {
        self.look(|s| s.events.pop())
    }
    fn status(&self) -> ModuleStatus {
        ModuleStatus { present: !self.look(|s| s.absent), generation: 3 }
    }
    fn record_read(&mut self, record: u8, into: &mut [u8]) -> Result<usize, ModuleError> {
        if record != 1 {
            return Err(ModuleError::NoRecord);
        }
        into[0] = 0x42;
        Ok(1)
    }
    fn record_write(&mut self, record: u8, _from: &[u8]) -> Result<(), ModuleError> {
        if matches!(record, 1 | 0x80 | 0x90) { Ok(()) } else { Err(ModuleError::NoRecord) }
    }
    fn is_of_blocks(&self, record: u8) -> bool {
        record == 0x80
    }
    fn diagnostic_buffer(&mut self, each: &mut dyn FnMut(ModuleEntry)) -> bool {
        self.look(|s| s.buffer.iter().for_each(|entry| each(*entry)));
        self.look(|s| !s.buffer.is_empty())
    }
}
