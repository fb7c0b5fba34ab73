//! The process of a bus without its loop: the whole-station simulation runs the same code in virtual time.

pub mod master;
pub mod pump;

pub use master::Master;
pub use pump::Pump;
