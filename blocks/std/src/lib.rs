//! Standard blocks: pure functions of state, time and inputs.
//!
//! [`standard_blocks`] lists them all: system functions (SFC, SFB), the IEC functions, the converting blocks, the
//! controllers. An entry has STEP 7's default number, name and parameters, and a function that runs over a [`Context`],
//! which the CPU gives: parameters, memory, modules, and the [`services`] of the system functions.
//!
//! Facts: "System Software for S7-300/400, System and Standard Functions"; its section titles are cited in brackets.

mod alarm_value;
mod any;
mod call;
mod context;
pub mod copy;
mod declare;
mod handling;
mod iec;
mod known;
mod pid;
mod row;
pub mod services;
mod sfb;
mod sfc;
mod table;
#[cfg(test)]
mod tests;
mod text;
mod ti_s7;
pub mod ticks;

pub use any::{AnyPointer, AnyType};
pub use context::{Abort, Context, Done, Instance, ModuleSize, NativeArea, Refused};
pub use known::known_system_function;
pub use row::{Origin, StandardBlock};
pub use sfc::DP_DIAGNOSIS;
pub use table::{standard_block, standard_blocks, system_functions};
