//! Lines of a GPIO chip as a small bus: its configuration, and its master as a machine.

pub(crate) mod config;
mod master;

pub use config::{Bias, Drive, GpioConfig, GpioLine};
pub use master::{GpioMaster, OpenPins, Pins};
