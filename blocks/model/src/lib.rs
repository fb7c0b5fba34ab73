//! The vocabulary of an S7 program: areas and addresses, data types and their layout, big-endian cells,
//! blocks and their interfaces, and the faults a program can raise.
//!
//! This crate knows no source text, no engine and no operating system.

#[macro_use]
mod named;

mod address;
mod alarm;
pub mod bcd;
mod block;
pub mod calendar;
mod cell;
pub mod cells;
mod cyclic;
mod debug;
mod diagnostic_events;
mod event_remedies;
mod force;
mod frame;
mod interface;
mod layout;
pub mod moment;
mod operating;
mod pass;
mod point;
mod s5time;
mod types;

pub use address::{Area, BitAddr};
pub use alarm::{
    ALARM_ORDERS, ALARM_VALUE_BYTES, ALARM_VALUES, ALARMS, AlarmAck, AlarmChange, AlarmEvent, AlarmKind, AlarmNow,
    AlarmOrder, AlarmQuery, AlarmState, AlarmTime, AlarmTurn, AlarmValues, DISPLAY_NAME, Displays, alarm_number,
};
pub use block::{BlockId, BlockKind, is_organization_block};
pub use cell::{Cell, CellError, Piece, Width};
pub use cyclic::{CYCLIC_300, CYCLIC_400, CyclicLimits};
pub use debug::{BREAKPOINTS, Breakpoint, DebugAnswer, DebugEnd, DebugOrder, HELD_LOCAL, Held, HeldBlock, Resume};
pub use diagnostic_events::{Access, Event, Fault, FaultKind, Site};
pub use event_remedies::StateChange;
pub use force::{FORCED_300, FORCED_400, Forced, ForcedArea};
pub use frame::{
    FRAME_WORDS, Frame, GROUP_ENTRIES, Head, Put, Run, WATCH_BYTES, WATCH_LINES, WRITE_BYTES, fits_a_share,
};
pub use interface::{Interface, Param, Section};
pub use layout::{Component, Layout, align_to};
pub use operating::{Command, OperatingState};
pub use pass::{CodeAddress, PASS_JOBS, PASS_STATEMENTS, PASS_WAIT, Pass, PassEnd, PassLine, PassOrder};
pub use point::{POINT_JOBS, Point, PointItem, PointOrder, TEST_FUNCTIONS};
pub use s5time::{S5Time, TimerKind};
pub use types::{DataType, Dimension, Field};
