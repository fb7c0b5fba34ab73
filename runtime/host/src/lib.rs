//! Joins the CPU to what it does not know: loads plugins, starts and supervises driver processes, and shows segments as
//! modules.

// Fenced by the house rules: the plugin interface is C, and a doorbell's descriptor is replaced under its number.
#![allow(unsafe_code)]

pub mod bus;
pub mod driver;
mod fixed_text;
pub mod module;
pub mod plugin;
pub mod supervisor;
