//! System blocks: pure functions of state, time and inputs.
//!
//! [`library`] lists the blocks with their standard numbers, names and parameters; what each does stands in the module of its
//! family. How they reach the CPU's memory is the CPU's business. Facts: "System Software for S7-300/400, System and Standard
//! Functions".

mod any;
mod blocks;
pub mod copy;
pub mod ticks;

pub use any::{AnyPointer, AnyType};
pub use blocks::{SystemBlock, SystemFunction, library};
