//! The CPU: memory, process image, organization blocks, scan loop, diagnostic buffer, exchange with links, and the
//! reference engine that defines what a statement means.
//!
//! [`Cpu::new`] loads a compiled program, native blocks and modules; [`Cpu::cycle`] runs one cycle and says when the
//! next is due. The CPU knows time only through the [`Clock`] it is given and never sleeps: the caller does.

mod accounts;
mod alarms;
mod arena;
mod carried_values;
mod cells;
mod config;
mod context;
mod cpu;
mod cycle;
mod db_pool;
mod diagnostic_buffer;
mod dispatch;
pub mod engine;
mod error;
mod error_obs;
mod exchange;
mod follow;
mod force;
mod holding;
mod interrupts;
mod load;
mod log;
mod machine;
mod made_data_blocks;
mod memory;
mod messages;
mod modules;
mod native;
mod natives;
mod nesting;
mod orders;
mod organization_blocks;
mod points;
mod ports;
mod recording;
mod retentive;
mod retentive_ranges;
mod retentive_v1;
mod scan_position;
mod service_state;
mod services;
mod settings;
mod stacks;
mod standstill;
mod startup;
mod successor;
mod system;
mod szl;
mod szl_outside;
mod szl_record;
mod timers;
mod wall_clock;
mod watching;

pub use accounts::{
    Accounts, AccountsConfig, BlockFigures, Distribution, Figures, Flags, Flight, Histogram, ObFigures, ScanRecord,
    ScanStatistics, Sums,
};
pub use alarms::{AlarmClient, AlarmJob};
pub use carried_values::lost_values;
pub use config::{BusPlace, CpuConfig, CycleEnd, ImageErrors, MOST_STACK_BYTES, ModuleSlot};
pub use cpu::Cpu;
pub use diagnostic_buffer::{DIAG_ENTRIES, DIAG_STOPS, DIAG_TEXT, DiagBuffer, DiagEntry, ShortText};
pub use error::LoadError;
pub use error_obs::InterruptError;
pub use exchange::{Job, LINKS, Link};
pub use force::ForceStep;
pub use holding::{DebugJob, Follower};
pub use load::Surroundings;
pub use log::{LOG_TEXT, LogLine, LogReader};
pub use machine::Attention;
pub use natives::{Natives, Running};
pub use nesting::PLUGIN_STACK_BYTES;
pub use ob1_model::{
    Cell, CellError, Command, Frame, GROUP_ENTRIES, OperatingState, Piece, Put, WATCH_BYTES, WATCH_LINES, WRITE_BYTES,
    Width,
};
pub use ob1_std::DP_DIAGNOSIS;
pub use ob1_std::services::StatusError;
pub use ob1_std::{Abort, Instance, NativeArea, Refused};
pub use ob1_time::{Clock, Still};
pub use orders::{Answer, Ask, Group, LIST_BYTES, Listing, Question, SUMS_AT, TooMuch};
pub use points::PointJob;
pub use ports::*;
pub use recording::{ObRun, RECORDINGS, RecordingClient, Row, Rows};
pub use retentive::Why;
pub use scan_position::ScanPosition;
pub use settings::{CyclicInterrupt, DataRange, Family, Missed, MissedCycle, Retentive, RetentiveData, TimeOfDay};
pub use successor::{Successor, Watches};
pub use system::{standard_block, system_blocks};
pub use wall_clock::date_and_time;
pub use watching::PassJob;

use context::Context;
use memory::Memory;
use modules::{IoError, Modules};
