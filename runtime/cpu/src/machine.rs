//! The CPU's state while it runs.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ob1_model::{Event, Site};
use ob1_time::{Instant, Span};

use crate::accounts::Trace;
use crate::alarms::Alarms;
use crate::engine::{Caller, Hot, Interrupted, Tape};
use crate::force::Force;
use crate::holding::{Debugging, Follower};
use crate::interrupts::{Diagnoses, Interrupts};
use crate::log::{LogLine, LogWriter};
use crate::organization_blocks::ObRecords;
use crate::points::Points;
use crate::retentive_ranges::Keep;
use crate::scan_position::ScanPosition;
use crate::service_state::ServiceState;
use crate::stacks::Stacks;
use crate::standstill::Standstill;
use crate::timers::{Counter, Timer};
use crate::wall_clock::{Shown, Wall};
use crate::watching::Watching;
use crate::{Command, CpuConfig, DiagBuffer, DiagEntry, IoError, Memory, Modules, ObInfo, OperatingState, ShortText};

/// Flags that other threads may set; the scan reads them at safe points.
#[derive(Clone, Debug, Default)]
pub struct Attention {
    due: Arc<AtomicBool>,
    halt: Arc<AtomicBool>,
}

impl Attention {
    /// Makes the program read the clock and the watchdog at its next safe point.
    pub fn attend(&self) {
        self.due.store(true, Ordering::Release);
    }

    /// Sends the CPU to STOP at the next safe point, as an operator's STOP does, even out of an endless loop.
    pub fn halt(&self) {
        self.halt.store(true, Ordering::Release);
        self.due.store(true, Ordering::Release);
    }

    #[inline]
    pub(crate) fn is_due(&self) -> bool {
        self.due.load(Ordering::Relaxed)
    }

    /// The flag that [`Attention::is_due`] reads.
    pub(crate) fn due(&self) -> &AtomicBool {
        &self.due
    }

    pub(crate) fn take_due(&self) {
        self.due.store(false, Ordering::Relaxed);
    }

    pub(crate) fn take_halt(&self) -> bool {
        self.halt.load(Ordering::Acquire) && self.halt.swap(false, Ordering::AcqRel)
    }
}

/// Cycle monitoring of the running cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Watchdog {
    /// When the running cycle is too long; `None`: not monitored.
    pub(crate) expires: Option<Instant>,
    /// It has expired once in this cycle.
    pub(crate) excess: bool,
}

/// Everything that changes while the program runs.
pub(crate) struct Machine {
    pub(crate) config: CpuConfig,
    pub(crate) memory: Memory,
    pub(crate) timers: Box<[Timer]>,
    pub(crate) counters: Box<[Counter]>,
    pub(crate) modules: Modules,
    pub(crate) diag: DiagBuffer,
    pub(crate) trace: Trace,
    pub(crate) log: LogWriter,
    pub(crate) attention: Attention,
    /// Statements the clock has been told of.
    pub(crate) statements: u64,
    /// What engines read and write directly.
    pub(crate) hot: Hot,
    /// The time 1024 statements took between the last two readings of the clock.
    pub(crate) pace: Span,
    pub(crate) watchdog: Watchdog,
    pub(crate) standstill: Standstill,
    /// A change of the operating state that is asked for.
    pub(crate) wanted: Option<Command>,
    /// References to actual parameters, a stack.
    pub(crate) refs: Box<[u32]>,
    /// Bytes of stack the thread needs that runs the CPU.
    pub(crate) stack: usize,
    pub(crate) ob: ObInfo,
    /// The organization block that gives the running class: `ob`, unless that is OB 121 or OB 122.
    pub(crate) class_ob: u16,
    /// The date at `now`.
    pub(crate) wall: Wall,
    pub(crate) shown: Shown,
    /// While a link asks for a list: the operating state it sees.
    pub(crate) seen_from_outside: Option<OperatingState>,
    /// Date and time at which the last start-up began.
    pub(crate) started: [u8; 8],
    /// Where the scan is, for others.
    pub(crate) position: Arc<ScanPosition>,
    /// Bit n: OB n has begun and not ended.
    pub(crate) active: u128,
    /// The running OB for a synchronous error is aborted, and the block it was called for continues.
    pub(crate) aborted: bool,
    /// Diagnostic interrupts that wait for the end of the OB that runs in their class.
    pub(crate) diagnoses: Diagnoses,
    /// Time the running organization block was interrupted by others.
    pub(crate) inside: Span,
    pub(crate) interrupts: Interrupts,
    pub(crate) obs: ObRecords,
    pub(crate) services: ServiceState,
    pub(crate) alarms: Alarms,
    /// When the running cycle began.
    pub(crate) cycle_start: Instant,
    /// When it went to STOP.
    pub(crate) stopped_at: Instant,
    /// Which memory is retentive.
    pub(crate) keep: Keep,
    /// Who called the native block that runs.
    pub(crate) native_caller: Option<Caller>,
    /// Registers for the error organization block that is about to begin.
    pub(crate) interrupted: Option<Interrupted>,
    /// What SFC 44 has given to the block that an error has interrupted.
    pub(crate) substitute: Option<u32>,
    /// The CPU is in STOP, and nobody has enabled the peripheral outputs.
    pub(crate) outputs_disabled: bool,
    /// The statement at which the engine last came to a safe point that was due.
    pub(crate) at: Option<Caller>,
    /// While two engines are compared: what comes from outside, recorded or played back.
    pub(crate) tape: Option<Box<Tape>>,
    /// Program status: jobs that watch blocks.
    pub(crate) watching: Watching,
    /// Breakpoints, and where the CPU holds.
    pub(crate) debugging: Debugging,
    /// In what it has gone to STOP.
    pub(crate) stacks: Stacks,
    /// How long it has been in HOLD: by so much its time is behind.
    pub(crate) held: Span,
    pub(crate) followers: Vec<Follower>,
    /// Variable tables: what is read and modified at points of the cycle.
    pub(crate) points: Points,
    /// Values that the operator holds.
    pub(crate) force: Force,
}

impl Machine {
    /// One of these organization blocks has begun and not ended.
    pub(crate) fn is_active(&self, obs: &[u16]) -> bool {
        obs.iter().any(|ob| self.active >> ob & 1 == 1)
    }

    /// Why there is no room for one block more: what an S7-400 says of it.
    pub(crate) fn full(&self) -> Event {
        let too_deep = self.hot.depth >= u32::from(self.config.nesting_depth);
        if too_deep { Event::BLOCKS_TOO_DEEP } else { Event::NO_LOCAL_DATA }
    }

    /// Reads peripheral bytes at the module; with `peripheral_from_image` from the process image.
    pub(crate) fn io_read(&mut self, address: u32, into: &mut [u8]) -> Result<(), IoError> {
        if self.config.peripheral_from_image {
            let len = into.len() as u32;
            let at = self.memory.inputs.locate(address, len).ok_or(IoError::NoModule)?.index();
            into.copy_from_slice(&self.memory.bytes[at..at + into.len()]);
            return Ok(());
        }
        let read = match self.tape.take() {
            None => self.modules.read(address, into),
            Some(tape) => self.read_on_tape(tape, address, into),
        };
        self.cover_read(address, into);
        read
    }

    /// Whether there are these peripheral outputs. Whether their module takes a value shows only at the write.
    pub(crate) fn has_outputs(&self, address: u32, bytes: u32) -> bool {
        if self.config.peripheral_from_image {
            return self.memory.outputs.locate(address, bytes).is_some();
        }
        self.modules.has_outputs(address, bytes as usize)
    }

    /// Writes peripheral bytes, and the process image of the outputs where they lie inside it.
    pub(crate) fn io_write(&mut self, address: u32, from: &[u8]) -> Result<(), IoError> {
        if self.config.peripheral_from_image {
            let len = from.len() as u32;
            let at = self.memory.outputs.locate(address, len).ok_or(IoError::NoModule)?.index();
            self.memory.bytes[at..at + from.len()].copy_from_slice(from);
            return Ok(());
        }
        if self.forces_all() {
            return self.write_covered(address, from);
        }
        self.write_modules(address, from)
    }

    /// Writes what the program has written, or what is forced in its place.
    pub(crate) fn write_modules(&mut self, address: u32, from: &[u8]) -> Result<(), IoError> {
        match self.tape.take() {
            None => self.modules.write(address, from)?,
            Some(tape) => self.write_on_tape(tape, address, from)?,
        }
        for (byte, value) in (address..).zip(from) {
            if let Some(at) = self.memory.outputs.locate(byte, 1) {
                self.memory.bytes[at.index()] = *value;
            }
        }
        Ok(())
    }

    /// Enters an event into the diagnostic buffer, with its statement if it has one.
    pub(crate) fn enter(&mut self, event: Event, site: Option<Site>, data: u32, text: ShortText) {
        self.enter_with(event, site, [0; 2], (data, text));
    }

    /// The same with ACCU1 and ACCU2.
    pub(crate) fn enter_with(
        &mut self,
        event: Event,
        site: Option<Site>,
        accus: [u32; 2],
        (data, text): (u32, ShortText),
    ) {
        let entry = DiagEntry { site, accus, ..DiagEntry::new(self.real(), event, data, text) };
        self.diag.push(entry, self.wall.outside(self.held));
    }

    /// Copies a log line into the ring.
    pub(crate) fn log(&mut self, level: u8, text: &str) {
        self.log.write(LogLine::new(self.real(), level, text));
    }
}
