//! The CPU on each engine, in virtual time.

#[path = "../common/mod.rs"]
mod common;

mod accounts;
mod addressing;
mod both;
mod calls;
mod clock;
mod cycle;
mod edges;
mod engines;
mod exchange;
mod faults;
mod force;
mod forms;
mod holding;
mod instructions;
mod interrupts;
mod ladder;
mod modules;
mod natives;
mod parameters;
mod passes;
mod pointers;
mod points;
mod programs;
mod questions;
mod raw_lists;
mod recording;
mod retentive;
mod retentive_v1;
mod services;
mod stack;
mod stacks;
mod standard_blocks;
mod system_functions;
mod system_inputs;
mod system_status;
mod tia;
mod timers;
mod walk;
mod why;
