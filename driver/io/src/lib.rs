//! What the process of a bus does, without its loop: the whole-station simulation runs the same in virtual time.

pub mod master;
pub mod pump;

pub use master::Master;
pub use pump::Pump;
