//! The part of the process `ob1-s7` between the machines of S7 communication and the CPU, without sockets and without a
//! clock for the network. The program around it (`main.rs`) has both; a simulation has others.

mod answers;
mod armed;
pub mod asks;
mod cells;
pub mod config;
pub mod cp;
