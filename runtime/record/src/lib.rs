//! Recordings: signals of a CPU at every cycle control point, and what happened meanwhile (docs/record.md).
//!
//! [`Capture`] decides what of a CPU's rows is kept: history, trigger, length, parts. [`Writer`] makes the blocks of a
//! file of it, [`Reader`] reads them, also those of a file that was cut off. Nothing here opens a file or reads a
//! clock.

mod capture;
mod event;
mod expression;
mod file;
mod head;
mod order;
mod replay;
mod row;
mod trigger;

pub use capture::{Capture, Taken};
pub use event::Event;
pub use expression::Expression;
pub use file::{Entry, FormatError, MAGIC, Reader, Writer};
pub use head::{Clocks, Head, Signal, datum, number};
pub use order::{Order, Settings};
pub use replay::{Difference, Differences, Pace, Replay, ReplayError, Replayed, Stage};
pub use row::{Row, Scan};
pub use trigger::Trigger;
