//! The native engine: blocks of statements as machine code, made by Cranelift.
//!
//! The reference engine of `ob1-cpu` defines what every statement means; here the same is done faster. What is rare,
//! and whatever fails, is left to the reference's own functions, so that there is one meaning.

#![allow(unsafe_code)]

mod code;
mod compile;
mod digest;
mod engine;
mod file;
mod flow;
mod frame;
mod hottest;
mod image;
mod inline;
mod place;
mod run;
mod signature;
mod tier;
mod translate;
mod unsaved;
mod watched;

pub use code::{memory_file, seal};
pub use compile::{CompileError, Compiler, Listing, Target};
pub use digest::fingerprint;
pub use engine::{AtLoad, NAME, NAME_FAST, NAME_HOTTEST, Native, synchronise};
pub use file::Order;
pub use hottest::{hottest, is_large};
pub use image::Image;
pub use tier::Tier;

/// Bytes of stack that a nested block takes at most: its code's frame and the helpers between.
const STACK_PER_BLOCK: usize = 6 * 1024;
/// Bytes of a frame at most; a block that needs more is left to the reference.
const FRAME: u32 = 3 * 1024;
