//! What a CPU is built with: sizes, cycle rules, and where its modules lie.

use crate::{AccountsConfig, CyclicInterrupt, Family, MissedCycle, Retentive, TimeOfDay};
use ob1_model::OperatingState;
use ob1_time::{Instant, Span};

/// Largest stack of a CPU, in bytes.
pub const MOST_STACK_BYTES: usize = 64 * 1024 * 1024;

/// The sizes and rules of one CPU. The defaults are those of an S7-300.
#[derive(Clone, Debug, PartialEq)]
pub struct CpuConfig {
    /// Bytes of the process image of the inputs, 0 to 8192.
    pub input_bytes: u32,
    /// Bytes of the process image of the outputs, 0 to 8192.
    pub output_bytes: u32,
    /// Bytes of bit memory, 0 to 65536.
    pub memory_bytes: u32,
    /// Timers, 0 to 2048.
    pub timers: u16,
    /// Counters, 0 to 2048.
    pub counters: u16,
    /// Bytes of local data for all nested blocks together, 1024 to 1048576.
    pub local_bytes: u32,
    /// The rules of S7-300 or S7-400. The number of accumulators is set separately.
    pub family: Family,
    /// What keeps its value over a warm restart and a power cycle.
    pub retentive: Retentive,
    /// Bytes reserved for data blocks that the program makes itself (SFC 22), 0 to 64 MiB; 0: it cannot make any.
    pub db_pool_bytes: u32,
    /// Accumulators: 2 (S7-300) or 4 (S7-400).
    pub accumulators: u8,
    /// Blocks nested in one another within a priority class, 1 to 64.
    pub nesting_depth: u8,
    /// Organization blocks beyond those of the program that the thread has stack for: for a [`crate::Successor`].
    pub spare_obs: u8,
    /// Minimum cycle time; 0: the next cycle starts at once.
    pub min_cycle: Span,
    /// What happens to a missed deadline of the cycle.
    pub missed: MissedCycle,
    /// What is recorded of every scan.
    pub accounts: AccountsConfig,
    /// Cycle monitoring time; 0: none.
    pub watchdog: Span,
    /// Cyclic interrupts whose interval or phase is not the default. Those of OBs that are not loaded have no effect.
    pub cyclic: Vec<CyclicInterrupt>,
    /// Time-of-day interrupts set by the configuration, not by the program.
    pub time_of_day: Vec<TimeOfDay>,
    /// The byte of bit memory that carries the clock pulses of 10 Hz (bit 0) to 0.5 Hz (bit 7).
    pub clock_memory: Option<u16>,
    /// Time of day at the runtime's time 0, in nanoseconds since 1990-01-01: the date in start information.
    pub date_at_start: u64,
    /// Organization blocks find their start information in the first 20 bytes of their local data. Otherwise these
    /// bytes hold what the previous block left there; SFC 6 works either way.
    pub ob_start_info: bool,
    /// When OB 85 is called for a part of the process image that is not transferred.
    pub image_errors: ImageErrors,
    /// Order number that status lists tell, 20 characters at most; empty: the name of this software.
    pub order: String,
    /// Serial number that they tell, 24 characters at most.
    pub serial: String,
    /// By how many percent of a cycle a job of program status may make a scan longer, 0 to 1000.
    pub test_load: u16,
    /// Commands and questions of links that one scan answers, at least 1.
    pub questions_per_scan: u32,
    /// Peripheral reads answer from the process image of the inputs and peripheral writes land in that of the outputs:
    /// for programs run without modules.
    pub peripheral_from_image: bool,
}

impl CpuConfig {
    /// The defaults with the rules and the accumulators of a family.
    #[must_use]
    pub fn of(family: Family) -> Self {
        let image_errors = match family {
            Family::S7_300 => ImageErrors::None,
            Family::S7_400 => ImageErrors::Each,
        };
        Self { family, accumulators: family.accumulators(), image_errors, ..Self::default() }
    }
}

impl Default for CpuConfig {
    fn default() -> Self {
        Self {
            input_bytes: 128,
            output_bytes: 128,
            memory_bytes: 256,
            timers: 256,
            counters: 256,
            local_bytes: 32 * 1024,
            family: Family::S7_300,
            retentive: Retentive::default(),
            db_pool_bytes: 64 * 1024,
            accumulators: 2,
            nesting_depth: 24,
            spare_obs: 0,
            min_cycle: Span::ZERO,
            missed: MissedCycle::Now,
            accounts: AccountsConfig::default(),
            watchdog: Span::from_millis(150),
            cyclic: Vec::new(),
            time_of_day: Vec::new(),
            clock_memory: None,
            date_at_start: 0,
            ob_start_info: true,
            image_errors: ImageErrors::None,
            order: String::new(),
            serial: "0".to_owned(),
            test_load: 10,
            questions_per_scan: 64,
            peripheral_from_image: false,
        }
    }
}

/// When OB 85 is called because a module does not answer while the process image is transferred.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImageErrors {
    /// Never: an S7-300 as it is delivered.
    #[default]
    None,
    /// At each transfer: an S7-400 as it is delivered.
    Each,
    /// When the error begins and when it ends.
    Changes,
}

/// Where a module's registers lie in the peripheral area.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModuleSlot {
    /// Its name in the station file, for messages.
    pub name: String,
    /// Logical address of its first input byte.
    pub input_address: u32,
    /// Logical address of its first output byte.
    pub output_address: u32,
    /// Where it lies on a bus; none: in the central rack.
    pub bus: Option<BusPlace>,
}

/// The place of a distributed module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusPlace {
    /// The number of the master system, from 1.
    pub master: u8,
    /// The station on it.
    pub station: u8,
    /// The slot in the station; 0 is the station itself.
    pub slot: u8,
}

impl ModuleSlot {
    /// A module whose inputs and outputs begin at the same address, as a CP's do.
    #[must_use]
    pub fn new(name: &str, address: u32) -> Self {
        Self { name: name.to_owned(), input_address: address, output_address: address, bus: None }
    }
}

/// The result of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CycleEnd {
    /// When the next cycle or the next interrupt by time is due. In the past or present: at once.
    pub next_deadline: Instant,
    /// The operating state after it.
    pub state: OperatingState,
    /// False when only interrupts were served because the next cycle was not due yet.
    pub whole: bool,
    /// The cycle began or ended late: [`crate::Cpu::last_scan`] says more.
    pub late: bool,
}
