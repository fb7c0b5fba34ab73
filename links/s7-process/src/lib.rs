//! What the process `ob1-s7` does between the machines of S7 communication and the CPU: no socket and no clock of the
//! network are here. The program around it (`main.rs`) has both; a simulation has others.

pub mod asks;
mod cells;
pub mod config;
pub mod cp;
