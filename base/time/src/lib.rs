//! Time: an [`Instant`] is a point of it, a [`Span`] the time between two points, both in nanoseconds.
//!
//! The clock is one that never goes back and begins at 0 with its owner: the monotonic clock since the start of a
//! process, or a virtual one in tests and simulations. Each process has its own, so instants of two processes have
//! nothing to do with each other. Nothing here reads a clock: the time is handed in, or comes from a [`Clock`]. So this
//! `Instant` is not the one of `std::time`, which reads a clock; code that needs both writes `time::Instant` for that
//! of the standard library. Shared memory, traces, texts and the plugin interface carry plain nanoseconds (`u64`),
//! converted where they are read and written.
//!
//! An instant is no span: `Instant - Instant = Span`, `Instant + Span = Instant`, and two instants have no sum.
//!
//! ```
//! use ob1_time::{Instant, Span};
//!
//! let asked = Instant::START + Span::from_millis(20);
//! let answered = asked + 3 * Span::MICROSECOND;
//! assert_eq!(answered - asked, Span::from_micros(3));
//! ```
#![no_std]
#![forbid(unsafe_code)]

mod clock;
mod instant;
mod span;
mod watched;

pub use clock::{Clock, Still};
pub use instant::Instant;
pub use span::Span;
pub use watched::WatchedTime;
