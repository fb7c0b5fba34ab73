//! The CPU: memory, process image, organization blocks, scan loop, diagnostic buffer, access port, and the reference engine
//! that defines what a statement means.

mod ports;

pub use ports::*;
