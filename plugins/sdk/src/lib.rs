//! Write a block of an `ob1` program in Rust, without unsafe code.
//!
//! A plugin is a crate of type `cdylib`. It describes the parameters of each block with [`interface!`], implements
//! [`Block`] for a unit type, and lists its blocks once in [`export_plugin!`]:
//!
//! ```
//! use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};
//!
//! interface! {
//!     mod limit {
//!         in     IN: Int;
//!         in     MX: Int;
//!         out    RET: Int;
//!         out    CLIPPED | GEKAPPT: Bool;
//!     }
//! }
//!
//! struct Limit;
//!
//! impl Block for Limit {
//!     const KIND: Kind = Kind::Fc;
//!     const NUMBER: u16 = 210;
//!     const NAME: &'static str = "LIMIT";
//!     const PARAMS: &'static [Param] = limit::PARAMS;
//!     type State = ();
//!     type Module = ();
//!
//!     fn call(cx: &mut Cx<'_>, _state: &()) -> Result<(), Abort> {
//!         let (value, limit) = (cx.get(limit::IN)?, cx.get(limit::MX)?);
//!         cx.set(limit::RET, value.min(limit))?;
//!         cx.set(limit::CLIPPED, value > limit)
//!     }
//! }
//! # fn main() { assert_eq!(limit::PARAMS.len(), 4); assert_eq!(limit::CLIPPED.index(), 3); }
//! ```
//!
//! The plugin's crate also contains
//!
//! ```text
//! ob1_sdk::export_plugin! { name: "limits", version: env!("CARGO_PKG_VERSION"), module_state: (), blocks: [Limit] }
//! ```
//!
//! This belongs in a crate whose only type is `cdylib`: the exported function has the same name in every plugin, and
//! two of them in one program would clash.
//!
//! # Rules
//!
//! - A block runs inside the scan: no allocation, no lock, no system call, no thread, no clock but [`Cx::now`], no
//!   mutable statics.
//! - Pass an [`Abort`] on with `?` at once: the CPU is on its way to STOP.
//! - A panic ends the call and takes the CPU to STOP, with the message in the diagnostic buffer.
// The edge itself: raw pointers of the C interface become safe functions here, so that no plugin needs unsafe code.
#![allow(unsafe_code)]

pub mod abi;
mod areas;
mod block;
mod calls;
mod cx;
#[doc(hidden)]
pub mod export;
mod formal;
mod interface;
mod layout;
mod modules;
mod or_stop;
mod panic;
mod param;
mod reply;
mod settings;
mod state;
mod text;
mod timers;
pub mod types;

pub use areas::{Area, Instance};
pub use block::{Block, Kind};
pub use calls::{Arg, ObInfo};
pub use cx::{Cx, Level, Registers};
pub use formal::{Formal, In, InOut, Out, Readable, Return, Static, Writable};
pub use modules::ModuleInfo;
pub use or_stop::OrStop;
pub use param::{Param, Section};
pub use reply::{Abort, Refused, Reply};
pub use settings::STATION;
pub use state::Zeroable;
pub use timers::{Timer, TimerKind};
