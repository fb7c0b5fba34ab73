//! A module as the CPU sees it, over a shared-memory or a heap segment.
//!
//! A [`Segment`] connects the CPU and the driver process of one CP, in the place of the back plane of a rack. It has
//! two ends: [`CpuSide`] belongs to the scan, [`CpSide`] to the driver. Neither waits for the other or trusts what the
//! other has written, and neither allocates or makes a system call after its construction. [`IoImage`] is the simpler
//! memory of `di do ai ao` modules, open to any program. [`BusMemory`] carries the inputs and outputs of a bus, whole
//! images at a time. [`WindowWriter`] and [`WindowReader`] are the ends of a window: the snapshots of the scan that one
//! link may read.
//!
//! The crate knows neither the CPU nor the firmware: what the registers mean is agreed elsewhere. The memory map is in
//! [`layout`] and, for drivers in other languages, in `docs/backplane.md`.
//!
//! ```
//! use ob1_backplane::{CpSide, CpuSide, Freshness, Segment};
//!
//! let segment = Segment::heap();
//! let mut cpu = CpuSide::create(&segment, 16)?;
//! let mut cp = CpSide::attach(&segment)?;
//! cpu.write_outputs(&[1, 0, 0, 30]);
//! let mut registers = [0; 16];
//! assert_eq!(cp.read_outputs(&mut registers), Freshness::Fresh);
//! assert_eq!(registers[..4], [1, 0, 0, 30]);
//! # Ok::<(), ob1_backplane::SegmentError>(())
//! ```
// Memory that two processes share is reached through raw pointers; all of that code is in `segment`, `cells`,
// `io_memory`, `bus_image` and `window`.
#![allow(unsafe_code)]

mod boxes;
mod buffer;
#[cfg(not(loom))]
mod bus_image;
mod bytes;
mod cells;
mod channel;
mod counters;
mod cp_side;
mod cpu_side;
mod events;
mod fault;
mod header;
#[cfg(not(loom))]
mod io_guard;
#[cfg(not(loom))]
mod io_image;
#[cfg(not(loom))]
pub mod io_layout;
#[cfg(not(loom))]
mod io_memory;
#[cfg(not(loom))]
mod io_outputs;
pub mod layout;
#[cfg(not(loom))]
mod memfd;
mod monitor;
mod record;
mod registers;
mod segment;
mod seqlock;
mod sync;
mod times;
mod window;
mod words;

pub use buffer::BufferEntry;
#[cfg(not(loom))]
pub use bus_image::{
    BUS_AREA_BYTES, BUS_COUPLERS, BusCpuSide, BusLook, BusMemory, BusProcessSide, BusSize, COUPLER_WORDS,
};
pub use channel::{Channel, ChannelBlock};
pub use counters::{Counter, Counters, Ends};
pub use cp_side::{ChangeMark, CpSide};
pub use cpu_side::CpuSide;
pub use events::{Event, EventKind};
pub use fault::{Fault, SegmentError, TooLong};
#[cfg(not(loom))]
pub use io_guard::{GuardPage, Guardian};
#[cfg(not(loom))]
pub use io_image::{IoField, IoImage};
#[cfg(not(loom))]
pub use io_outputs::Owner;
pub use monitor::Monitor;
pub use record::{Params, Record};
pub use segment::Segment;
pub use seqlock::Freshness;
pub use sync::AtomicU64;
pub use times::{OrderTimes, SPREAD_BOUNDS, Spread, Stage};
pub use window::{WINDOW_WORDS, WindowHead, WindowReader, WindowWriter};
pub use words::{CpuState, DriverState, Leds, ModemInputs, ModemOutputs, Reason, Why};

// Over heap segments only and without any system interface, so that Miri can run them.
#[cfg(all(test, not(loom)))]
mod tests;
